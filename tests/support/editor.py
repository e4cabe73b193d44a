"""An editor for tests: a language client that talks to a server process."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from lsprotocol import types as lsp
from pygls.lsp.client import LanguageClient

PATIENCE_S = 30.0
SMILE = "\N{GRINNING FACE}"
"""A character of two UTF-16 units."""


def utf16_units(text: str) -> int:
    """Length of a text in UTF-16 units."""
    return len(text.encode("utf-16-le")) // 2


class Editor:
    """A client with what it has heard."""

    def __init__(self, client: LanguageClient) -> None:
        self.client = client
        self.received: asyncio.Queue[lsp.PublishDiagnosticsParams] = asyncio.Queue()
        self.versions: dict[str, int] = {}

    def open(self, path: Path, text: str) -> None:
        self.versions[path.as_uri()] = 0
        item = lsp.TextDocumentItem(uri=path.as_uri(), language_id="gusjob", version=0, text=text)
        self.client.text_document_did_open(lsp.DidOpenTextDocumentParams(text_document=item))

    def edit(self, path: Path, start: tuple[int, int], end: tuple[int, int], text: str) -> None:
        uri = path.as_uri()
        self.versions[uri] += 1
        place = lsp.Range(start=lsp.Position(*start), end=lsp.Position(*end))
        self.client.text_document_did_change(
            lsp.DidChangeTextDocumentParams(
                text_document=lsp.VersionedTextDocumentIdentifier(uri=uri, version=self.versions[uri]),
                content_changes=[lsp.TextDocumentContentChangePartial(range=place, text=text)],
            )
        )

    def close(self, path: Path) -> None:
        self.client.text_document_did_close(lsp.DidCloseTextDocumentParams(self.named(path)))

    async def published(self, path: Path, wanted: Callable[[list[lsp.Diagnostic]], bool] | None = None) -> list[Any]:
        """The next diagnostics of a file's newest version, such as are wanted."""
        while True:
            reply = await asyncio.wait_for(self.received.get(), PATIENCE_S)
            found = list(reply.diagnostics)
            newest = reply.version is None or reply.version == self.versions.get(reply.uri)
            if reply.uri == path.as_uri() and newest and (wanted is None or wanted(found)):
                return found

    async def codes(self, path: Path) -> list[str]:
        return [str(one.code) for one in await self.published(path)]

    def named(self, path: Path) -> lsp.TextDocumentIdentifier:
        return lsp.TextDocumentIdentifier(uri=path.as_uri())

    async def hover(self, path: Path, line: int, character: int) -> str:
        params = lsp.HoverParams(self.named(path), lsp.Position(line, character))
        reply = await self.client.text_document_hover_async(params)
        if reply is None:
            return ""
        assert isinstance(reply.contents, lsp.MarkupContent)
        return reply.contents.value

    async def complete(self, path: Path, line: int, character: int) -> list[str]:
        params = lsp.CompletionParams(self.named(path), lsp.Position(line, character))
        reply = await self.client.text_document_completion_async(params)
        assert reply is None or isinstance(reply, lsp.CompletionList)
        return [] if reply is None else [item.insert_text or item.label for item in reply.items]

    async def jump(self, path: Path, line: int, character: int) -> list[tuple[str, int, int]]:
        params = lsp.DefinitionParams(self.named(path), lsp.Position(line, character))
        locations: Any = await self.client.text_document_definition_async(params)
        return [(Path(one.uri).name, one.range.start.line, one.range.start.character) for one in locations or []]


@asynccontextmanager
async def editor(
    capabilities: lsp.ClientCapabilities | None = None, *options: str, locale: str | None = None
) -> AsyncIterator[Editor]:
    """A server that is started, and ended as the protocol has it."""
    client = LanguageClient("test", "1")
    mine = Editor(client)

    @client.feature(lsp.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)  # type: ignore[untyped-decorator]  # pygls'
    def published(params: lsp.PublishDiagnosticsParams) -> None:
        mine.received.put_nowait(params)

    await client.start_io(sys.executable, "-m", "gusjob", "lsp", *options)
    process: Any = client._server
    mine_can = capabilities or lsp.ClientCapabilities()
    await client.initialize_async(lsp.InitializeParams(capabilities=mine_can, locale=locale))
    client.initialized(lsp.InitializedParams())
    try:
        yield mine
    finally:
        await asyncio.wait_for(client.shutdown_async(None), PATIENCE_S)
        client.exit(None)
        await asyncio.wait_for(client.stop(), PATIENCE_S)  # type: ignore[no-untyped-call]  # pygls'
        reply = await process.stderr.read()
        process._transport.close()
    assert reply == b""
    assert process.returncode == 0


def run(session: Coroutine[Any, Any, None]) -> None:
    asyncio.run(session)


def folder(tmp_path: Path, **files: str) -> Path:
    """A folder with jobs in it."""
    for name, text in files.items():
        (tmp_path / f"{name}.job").write_text(text, encoding="utf-8", newline="")
    return tmp_path
