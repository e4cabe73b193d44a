"""The server: the editor's messages to the rooms that know the answers, and back."""

from __future__ import annotations

import asyncio
import gc
import logging
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, TypeVar, cast

from lsprotocol import types as lsp
from pygls.lsp.server import LanguageServer
from pygls.protocol import JsonRPCNotification, LanguageServerProtocol, default_converter, lsp_method

from gusjob.i18n.language import language_of, set_language
from gusjob.lsp.asked import Asked
from gusjob.lsp.complete import complete
from gusjob.lsp.desk import path_of
from gusjob.lsp.edits import fixes, laid_out
from gusjob.lsp.judge import Judged
from gusjob.lsp.look import definition, hover, symbols
from gusjob.lsp.text import Text, utf8
from gusjob.lsp.worker import Answer, Task, Worker
from gusjob.version import __version__

T = TypeVar("T")

HOST = "127.0.0.1"
_INVALID_PARAMS = -32602


@dataclass(slots=True)
class Document:
    """An open file. `asked` counts how often it was given to the worker; `judged` is the newest answer."""

    uri: str
    path: Path | None
    text: Text
    version: int
    asked: int = 0
    judged: Judged | None = None
    judged_text: Text | None = None

    @property
    def key(self) -> str:
        """By what other files know it."""
        return "" if self.path is None else str(_resolved(self.path))


def _resolved(path: Path) -> Path:
    try:
        return path.resolve()
    except (OSError, RuntimeError):  # A loop of links.
        return path


class Protocol(LanguageServerProtocol):
    """pygls' own, but for texts (held as bytes: a keystroke in a large one must cost little) and for messages that
    are not what the protocol says."""

    _server: Server

    @lsp_method(lsp.TEXT_DOCUMENT_DID_OPEN)
    def lsp_text_document__did_open(self, params: lsp.DidOpenTextDocumentParams) -> None:
        self._server.opened(params.text_document)

    @lsp_method(lsp.TEXT_DOCUMENT_DID_CHANGE)
    def lsp_text_document__did_change(self, params: lsp.DidChangeTextDocumentParams) -> None:
        self._server.changed(params)

    @lsp_method(lsp.TEXT_DOCUMENT_DID_CLOSE)
    def lsp_text_document__did_close(self, params: lsp.DidCloseTextDocumentParams) -> None:
        self._server.closed(params.text_document.uri)

    def structure_message(self, data: dict[str, Any]) -> Any:
        """A message; one that is not of its form is answered, and passed over."""
        try:
            return super().structure_message(data)
        except Exception as error:  # noqa: BLE001  (whatever a client sends)
            if "id" in data and "method" in data:
                reply = lsp.ResponseError(code=_INVALID_PARAMS, message=f"{data['method']}: wrong parameters: {error}")
                self._send_response(data["id"], error=reply)
            return JsonRPCNotification(method="$/nothing", jsonrpc=self.VERSION, params=None)


@dataclass(slots=True)
class _Shown:
    """What is shown of a file, by the open file that was judged."""

    by_top: dict[str, list[lsp.Diagnostic]] = field(default_factory=dict)


class Server(LanguageServer):
    """What is open, and what was said of it. All of it lives in the event loop; only the worker judges."""

    def __init__(self) -> None:
        """Not yet listening."""
        super().__init__("gusjob", __version__, protocol_cls=Protocol, converter_factory=default_converter)
        self.documents: dict[str, Document] = {}
        self.shown: dict[str, _Shown] = {}
        self.ended_well = False
        self._loop: asyncio.AbstractEventLoop | None = None
        self._worker = Worker(
            self._from_worker(self._judged), self._from_worker(self._look_again), self._from_worker(self._say)
        )

    # Texts.

    @property
    def unit(self) -> lsp.PositionEncodingKind | str:
        """What columns count."""
        return self.server_capabilities.position_encoding or lsp.PositionEncodingKind.Utf16

    def opened(self, item: lsp.TextDocumentItem) -> None:
        """A file is open in the editor: what is on the disk does not count any more."""
        self._loop = asyncio.get_running_loop()
        text = Text(utf8(item.text), self.unit)
        document = Document(uri=item.uri, path=path_of(item.uri), text=text, version=item.version)
        self.documents[item.uri] = document
        self._ask_all(document)

    def changed(self, params: lsp.DidChangeTextDocumentParams) -> None:
        """A text was edited."""
        document = self.documents.get(params.text_document.uri)
        if document is None:
            return
        for change in params.content_changes:
            document.text = document.text.edited(change)
        document.version = params.text_document.version
        self._ask_all(document)

    def closed(self, uri: str) -> None:
        """A file is closed: what was said of it goes, and the disk counts again."""
        document = self.documents.pop(uri, None)
        if document is None:
            return
        self._worker.forget(uri)
        self._show(uri, {})
        self._ask_dependents(document)
        for name in document.judged.files if document.judged else ():
            for other in self.documents.values():
                if other.key == name:
                    self._ask(other)

    # Judging.

    def _ask_all(self, document: Document) -> None:
        self._ask(document)
        self._ask_dependents(document)

    def _ask_dependents(self, document: Document) -> None:
        """Open files that include this one hang on its text."""
        for other in self.documents.values():
            if other is not document and other.judged is not None and _reads(other.judged, document.key):
                self._ask(other)

    def _ask(self, document: Document) -> None:
        document.asked += 1
        self._worker.ask(self.task(document))

    def task(self, document: Document) -> Task:
        """A document as it stands, with all that is open."""
        others = [one for one in self.documents.values() if one.path is not None]
        return Task(
            uri=document.uri,
            number=document.asked,
            path=document.path,
            text=document.text,
            open_texts={one.key: one.text.data for one in others},
            uris={one.key: one.uri for one in others},
            unit=self.unit,
        )

    def _from_worker(self, do: Callable[[T], None]) -> Callable[[T], None]:
        """A function that is called in the event loop, whichever thread asks."""

        def called(what: T) -> None:
            if self._loop is not None:
                with suppress(RuntimeError):  # The loop has ended: so does all.
                    self._loop.call_soon_threadsafe(do, what)

        return called

    def _look_again(self, uri: str) -> None:
        document = self.documents.get(uri)
        if document is not None:
            self._ask(document)

    def _say(self, message: str) -> None:
        """Into the editor's log."""
        with suppress(OSError, ValueError):  # The client is gone.
            self.window_log_message(lsp.LogMessageParams(type=lsp.MessageType.Error, message=message))

    def _judged(self, answer: Answer) -> None:
        """An answer is shown if nothing was typed since."""
        document = self.documents.get(answer.task.uri)
        if document is None or answer.task.number != document.asked:
            return
        document.judged, document.judged_text = answer.judged, answer.task.text
        self._show(document.uri, answer.shown)

    def _show(self, top: str, fresh: dict[str, list[lsp.Diagnostic]]) -> None:
        """What one look says in place of what it said before."""
        old = [uri for uri, shown in self.shown.items() if top in shown.by_top]
        for uri in {*old, *fresh}:
            shown = self.shown.setdefault(uri, _Shown())
            if uri in fresh:
                shown.by_top[top] = fresh[uri]
            else:
                shown.by_top.pop(top, None)
        for uri in sorted({*old, *fresh}):
            self._publish(uri)

    def _publish(self, uri: str) -> None:
        """All that is said of a file. One that an open job includes is judged as a part of it, not by itself: what it
        lacks stands in the job."""
        document = self.documents.get(uri)
        by_top = self.shown[uri].by_top
        tops = [top for top in by_top if top != uri and top in self.documents]
        if document is not None:
            tops = [top for top in tops if not self._includes(document, top)]
        chosen = tops or ([uri] if uri in by_top else [])
        found: list[lsp.Diagnostic] = []
        for top in chosen:
            found += [one for one in by_top[top] if one not in found]
        version = document.version if document is not None else None
        with suppress(OSError, ValueError):  # The client is gone.
            self.text_document_publish_diagnostics(
                lsp.PublishDiagnosticsParams(uri=uri, diagnostics=found, version=version)
            )
        if not by_top:
            del self.shown[uri]

    def _includes(self, document: Document, uri: str) -> bool:
        other = self.documents.get(uri)
        return other is not None and document.judged is not None and _reads(document.judged, other.key)

    # Questions.

    def asked(self, uri: str) -> Asked | None:
        """What is needed to answer a question about a text; None if it is not open."""
        document = self.documents.get(uri)
        if document is None:
            return None
        tops = (one for one in self.documents.values() if one.judged is not None and one is not document)
        top = next((one for one in tops if one.judged and _reads(one.judged, document.key)), document)
        current = document.judged if document.judged_text is document.text else None
        return Asked(task=self.task(document), top=self.task(top), judged=current)


def _reads(judged: Judged, key: str) -> bool:
    return bool(key) and key in judged.files


async def _aside(answer: Callable[..., T], *given: Any) -> T:
    """An answer worked out beside the event loop: a large file takes some time."""
    return await asyncio.get_running_loop().run_in_executor(None, answer, *given)


def make_server(*, follow: bool = False) -> Server:
    """A server with all that it offers."""
    server = Server()

    @server.feature(lsp.INITIALIZE)
    def greeted(params: lsp.InitializeParams) -> None:
        if follow and params.locale:
            set_language(language_of(params.locale))

    @server.feature(lsp.TEXT_DOCUMENT_DID_SAVE)
    def saved(params: lsp.DidSaveTextDocumentParams) -> None:
        server._look_again(params.text_document.uri)

    @server.feature(lsp.WORKSPACE_DID_CHANGE_WATCHED_FILES)
    def watched(_params: lsp.DidChangeWatchedFilesParams) -> None:
        for uri in server.documents:
            server._look_again(uri)

    @server.feature(lsp.SHUTDOWN)
    def shut_down(_params: None) -> None:
        server.ended_well = True

    @server.feature(lsp.TEXT_DOCUMENT_HOVER)
    async def hovered(params: lsp.HoverParams) -> lsp.Hover | None:
        asked = server.asked(params.text_document.uri)
        return None if asked is None else await _aside(hover, asked, params.position)

    @server.feature(lsp.TEXT_DOCUMENT_COMPLETION, lsp.CompletionOptions(trigger_characters=[" ", '"', "/", "("]))
    async def completed(params: lsp.CompletionParams) -> lsp.CompletionList | None:
        asked = server.asked(params.text_document.uri)
        return None if asked is None else await _aside(complete, asked, params.position)

    @server.feature(lsp.TEXT_DOCUMENT_DEFINITION)
    async def defined(params: lsp.DefinitionParams) -> list[lsp.Location] | None:
        asked = server.asked(params.text_document.uri)
        return None if asked is None else await _aside(definition, asked, params.position)

    @server.feature(lsp.TEXT_DOCUMENT_DOCUMENT_SYMBOL)
    async def listed(
        params: lsp.DocumentSymbolParams,
    ) -> list[lsp.DocumentSymbol] | list[lsp.SymbolInformation] | None:
        asked = server.asked(params.text_document.uri)
        if asked is None:
            return None
        told = server.client_capabilities.text_document
        nested = bool(told and told.document_symbol and told.document_symbol.hierarchical_document_symbol_support)
        return await _aside(symbols, asked, nested)

    @server.feature(lsp.TEXT_DOCUMENT_FORMATTING)
    async def formatted(params: lsp.DocumentFormattingParams) -> list[lsp.TextEdit] | None:
        asked = server.asked(params.text_document.uri)
        if asked is None:
            return None
        edits = await _aside(laid_out, asked)
        document = server.documents.get(params.text_document.uri)
        return edits if document is not None and document.text is asked.task.text else None

    @server.feature(
        lsp.TEXT_DOCUMENT_CODE_ACTION, lsp.CodeActionOptions(code_action_kinds=[lsp.CodeActionKind.QuickFix])
    )
    async def fixed(params: lsp.CodeActionParams) -> list[lsp.CodeAction] | None:
        asked = server.asked(params.text_document.uri)
        return None if asked is None else await _aside(fixes, asked, params.range)

    return server


class _Pipe:
    """Standard output to a client that may be gone: then nobody is to be told, and the input's end ends the server."""

    def __init__(self, stdout: BinaryIO) -> None:
        self._stdout = stdout

    def write(self, data: bytes) -> int:
        with suppress(OSError, ValueError):
            self._stdout.write(data)
        return len(data)

    def flush(self) -> None:
        with suppress(OSError, ValueError):
            self._stdout.flush()

    def close(self) -> None:
        with suppress(OSError, ValueError):
            self._stdout.close()


def _settle() -> None:
    """What goes wrong with a client's message is told to the client; nobody reads standard error. A judged text makes
    many objects and hardly a cycle: looking for them takes longer than judging."""
    gc.freeze()
    gc.set_threshold(200_000, 50, 100)
    for name in ("pygls", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)


def serve_pipes(stdin: BinaryIO, stdout: BinaryIO, *, follow: bool = False) -> int:
    """Serve over standard input and output until the client ends it or is gone; 0 if it said so before (LSP 3.17,
    exit). `follow`: speak the editor's language."""
    _settle()
    server = make_server(follow=follow)
    server.start_io(stdin, cast(BinaryIO, _Pipe(stdout)))
    return 0 if server.ended_well else 1


def serve_port(port: int, *, follow: bool = False) -> int:
    """The same for one client on this computer. Raises OSError if the port can't be had."""
    _settle()
    server = make_server(follow=follow)
    with suppress(SystemExit):
        server.start_tcp(HOST, port)
    return 0 if server.ended_well else 1


if sys.platform == "win32":  # A client that dies breaks its pipe, of which asyncio would tell in a traceback there.
    logging.getLogger("asyncio.windows_events").setLevel(logging.CRITICAL + 1)
