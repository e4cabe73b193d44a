"""The language server, driven over stdio by pygls' client as an editor would; positions against pygls' own texts."""

from __future__ import annotations

import asyncio
import json
import os
import queue
import re
import socket
import subprocess
import sys
import tomllib
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from lsprotocol import types as lsp
from pygls.lsp.client import LanguageClient
from pygls.workspace import PositionCodec, TextDocument
from support.documents import text_of
from support.tools import MARK, ROOT

from gusjob.cli import cli
from gusjob.controllers.gus.ranges import Range
from gusjob.diagnostics.model import Span
from gusjob.frontend.parse.forms import FORMS
from gusjob.frontend.parse.grammar import keywords
from gusjob.kinematics.units import UNITS
from gusjob.lsp.completion import accepted, unit_fits
from gusjob.lsp.diagnostics import SourceLocations, diagnose, lsp_diagnostics
from gusjob.lsp.reference import RANGES, form_of, keyword_text
from gusjob.lsp.text import Text, utf8
from gusjob.lsp.textmate import GRAMMAR_PATH, textmate
from gusjob.lsp.worker import Task, TaskResult, Worker
from gusjob.lsp.workspace import Workspace, path_of, uri_of
from gusjob.pipeline import examine_file

PATIENCE_S = 30.0
SMILE = "\N{GRINNING FACE}"


class Editor:
    """A client with what it has heard."""

    def __init__(self, client: LanguageClient) -> None:
        self.client = client
        self.heard: asyncio.Queue[lsp.PublishDiagnosticsParams] = asyncio.Queue()
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

    async def told(self, path: Path, wanted: Callable[[list[lsp.Diagnostic]], bool] | None = None) -> list[Any]:
        """The next diagnostics of a file's newest version, such as are wanted."""
        while True:
            said = await asyncio.wait_for(self.heard.get(), PATIENCE_S)
            found = list(said.diagnostics)
            newest = said.version is None or said.version == self.versions.get(said.uri)
            if said.uri == path.as_uri() and newest and (wanted is None or wanted(found)):
                return found

    async def codes(self, path: Path) -> list[str]:
        return [str(one.code) for one in await self.told(path)]

    def named(self, path: Path) -> lsp.TextDocumentIdentifier:
        return lsp.TextDocumentIdentifier(uri=path.as_uri())

    async def hover(self, path: Path, line: int, character: int) -> str:
        asked = lsp.HoverParams(self.named(path), lsp.Position(line, character))
        said = await self.client.text_document_hover_async(asked)
        if said is None:
            return ""
        assert isinstance(said.contents, lsp.MarkupContent)
        return said.contents.value

    async def complete(self, path: Path, line: int, character: int) -> list[str]:
        asked = lsp.CompletionParams(self.named(path), lsp.Position(line, character))
        said = await self.client.text_document_completion_async(asked)
        assert said is None or isinstance(said, lsp.CompletionList)
        return [] if said is None else [item.insert_text or item.label for item in said.items]

    async def jump(self, path: Path, line: int, character: int) -> list[tuple[str, int, int]]:
        asked = lsp.DefinitionParams(self.named(path), lsp.Position(line, character))
        localized: Any = await self.client.text_document_definition_async(asked)
        return [(Path(one.uri).name, one.range.start.line, one.range.start.character) for one in localized or []]


@asynccontextmanager
async def editor(
    capabilities: lsp.ClientCapabilities | None = None, *options: str, locale: str | None = None
) -> AsyncIterator[Editor]:
    """A server that is started, and ended as the protocol has it."""
    client = LanguageClient("test", "1")
    mine = Editor(client)

    @client.feature(lsp.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)  # type: ignore[untyped-decorator]  # pygls'
    def published(params: lsp.PublishDiagnosticsParams) -> None:
        mine.heard.put_nowait(params)

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
        said = await process.stderr.read()
        process._transport.close()
    assert said == b""
    assert process.returncode == 0


def test_looking_for_jobs_that_include_it_makes_them_no_part(tmp_path: Path) -> None:
    """To know whether a comment is idle jobs near by are read: those that do not include the file stay their own."""
    other, path = tmp_path / "b.job", tmp_path / "a.job"
    other.write_text("VEL\n", encoding="utf-8")
    path.write_text("DWELL 3 ; allow GJ404: once\n", encoding="utf-8")
    judged_ = diagnose(str(path), path, path.read_bytes(), Workspace({str(other.resolve()): b"VEL\n"}))
    assert [diagnostic.rule.code for diagnostic in judged_.diagnostics] == ["GJ145"]
    assert judged_.files == frozenset()


@pytest.mark.parametrize(
    ("locale", "options", "said"),
    [
        ("zh-cn", (), "不应出现在这里"),
        ("zh-cn", ("--lang", "en"), "is not allowed here"),
        ("de", (), "is not allowed here"),
        (None, ("--lang", "zh"), "不应出现在这里"),
    ],
)
def test_the_editors_language(tmp_path: Path, locale: str | None, options: tuple[str, ...], said: str) -> None:
    async def session() -> None:
        async with editor(None, *options, locale=locale) as mine:
            path = tmp_path / "a.job"
            mine.open(path, "VEL\n")
            (diagnostic, *_) = await mine.told(path)
            assert said in diagnostic.message

    run(session())


def run(session: Coroutine[Any, Any, None]) -> None:
    asyncio.run(session)


def folder(tmp_path: Path, **files: str) -> Path:
    """A folder with jobs in it."""
    for name, text in files.items():
        (tmp_path / f"{name}.job").write_text(text, encoding="utf-8", newline="")
    return tmp_path


# The session.

JOB = (
    f"; {SMILE} setup\r\n"
    'INCLUDE "head.job"\r\n'
    "LET pitch = 500um  ; between lines\r\n"
    "DEF row(n)\r\n"
    f"  JUMP X 0 Y (n * pitch)  ; {SMILE}{SMILE}\r\n"
    "  LASER ON\r\n"
    "  LINE X 10\r\n"
    "  LASER OFF\r\n"
    "END\r\n"
    "REPEAT 3 AS i\r\n"
    "  CALL row(i)\r\n"
    "END\r\n"
)


def test_a_session(tmp_path: Path) -> None:
    async def session() -> None:
        place = folder(tmp_path, head=MARK + "LASER POWER 40\n", job=JOB)
        job, head = place / "job.job", place / "head.job"
        async with editor() as ed:
            ed.open(job, JOB)
            assert await ed.codes(job) == []
            # Break: behind two surrogate pairs in the line before, and in a comment's line.
            ed.edit(job, (6, 2), (6, 6), "LIEN")
            broken = await ed.told(job)
            assert [(d.code, d.range.start, d.range.end) for d in broken] == [
                ("GJ102", lsp.Position(6, 2), lsp.Position(6, 6))
            ]
            assert broken[0].severity is lsp.DiagnosticSeverity.Error
            assert broken[0].code_description is None
            # Mend, by what it proposes.
            actions: Any = await ed.client.text_document_code_action_async(
                lsp.CodeActionParams(ed.named(job), broken[0].range, lsp.CodeActionContext([]))
            )
            (edit,) = actions[0].edit.changes[job.as_uri()]
            assert edit.new_text == "LINE"
            start, end = edit.range.start, edit.range.end
            ed.edit(job, (start.line, start.character), (end.line, end.character), edit.new_text)
            assert await ed.codes(job) == []
            ed.edit(job, (4, 23), (4, 23), " * oops")
            assert [(d.code, d.range.start.character, d.range.end.character) for d in await ed.told(job)] == [
                ("GJ121", 13, 31)
            ]
            ed.edit(job, (4, 23), (4, 30), "")
            assert await ed.codes(job) == []
            # In a comment, the second of two pairs of surrogates: columns are UTF-16 units.
            ed.edit(job, (4, 30), (4, 32), "\r\nQQ ")
            assert [(d.code, d.range.start) for d in await ed.told(job)] == [("GJ102", lsp.Position(5, 0))]
            ed.edit(job, (4, 30), (5, 3), SMILE)
            assert await ed.codes(job) == []
            # Look, jump, complete.
            assert "pitch = 0.5 mm" in await ed.hover(job, 4, 20)
            assert await ed.jump(job, 4, 20) == [("job.job", 2, 4)]
            assert await ed.jump(job, 4, 14) == [("job.job", 3, 4)]
            assert await ed.jump(job, 10, 8) == [("job.job", 3, 4)]
            assert await ed.jump(job, 10, 11) == [("job.job", 9, 12)]
            assert await ed.jump(job, 1, 12) == [("head.job", 0, 0)]
            assert "DEF row(n)" in await ed.hover(job, 10, 9)
            assert await ed.hover(job, 0, 4) == ""
            assert await ed.complete(job, 10, 7) == ["row"]
            assert await ed.complete(job, 1, 9) == ["head.job"]
            assert {"n", "pitch", "hypot"} <= set(await ed.complete(job, 4, 14))
            assert "i" not in await ed.complete(job, 4, 14)
            assert await ed.complete(job, 0, 5) == []
            # The include in the editor counts, not the one on the disk.
            ed.open(head, MARK)
            assert await ed.codes(job) == ["GJ403"]
            ed.edit(head, (3, 0), (3, 0), "LASER POWER 140\n")
            wrong = await ed.told(head, bool)
            assert [(d.code, d.range.start) for d in wrong] == [("GJ201", lsp.Position(3, 12))]
            assert [(i.location.uri, i.message) for i in wrong[0].related_information] == [
                (job.as_uri(), "included here")
            ]
            ed.close(head)
            assert await ed.codes(job) == []
            # Renamed on the disk: seen without a keystroke.
            head.rename(place / "kopf.job")
            assert "GJ138" in [d.code for d in await ed.told(job, bool)]
            assert await ed.complete(job, 1, 9) == ["kopf.job"]
            ed.edit(job, (1, 9), (1, 17), "kopf.job")
            assert await ed.codes(job) == []
            # Layout.
            ed.edit(job, (6, 2), (6, 6), "   line")
            await ed.told(job)
            asked = lsp.DocumentFormattingParams(ed.named(job), lsp.FormattingOptions(tab_size=2, insert_spaces=True))
            (change,) = await ed.client.text_document_formatting_async(asked) or ()
            assert change.new_text == "  LINE X 10\r\n"
            assert change.range == lsp.Range(lsp.Position(6, 0), lsp.Position(7, 0))

    run(session())


def test_what_is_told_is_told_of_that_very_text(tmp_path: Path) -> None:
    """Keystrokes faster than answers: none is of another text than its version says, and the last one comes."""

    async def session() -> None:
        text = MARK + "".join(f"JUMP X {n % 90} Y 0\n" for n in range(20_000))
        job = folder(tmp_path, job=text) / "job.job"
        async with editor() as ed:
            ed.open(job, text)
            assert await ed.codes(job) == []
            for _ in range(8):
                ed.edit(job, (9_000, 0), (9_000, 4), "JMUP")
                await asyncio.sleep(0.01)
                ed.edit(job, (9_000, 0), (9_000, 4), "JUMP")
                await asyncio.sleep(0.01)
            last = 0
            while last < 16:
                said = await asyncio.wait_for(ed.heard.get(), PATIENCE_S)
                assert said.version is not None
                assert bool(said.diagnostics) == bool(said.version % 2)
                last = said.version

    run(session())


def test_symbols(tmp_path: Path) -> None:
    async def session() -> None:
        place = folder(tmp_path, job=MARK + "LET a = 1\nDEF f(x)\n  LET b = x\n  FRAME ROTATE 30\n  END\nEND\n")
        job = place / "job.job"
        told = lsp.DocumentSymbolClientCapabilities(hierarchical_document_symbol_support=True)
        caps = lsp.ClientCapabilities(text_document=lsp.TextDocumentClientCapabilities(document_symbol=told))
        async with editor(caps) as ed:
            ed.open(job, job.read_text(encoding="utf-8"))
            found: Any = await ed.client.text_document_document_symbol_async(lsp.DocumentSymbolParams(ed.named(job)))
            assert [s.name for s in found] == ["LASER MODE DUTY CARRIER 10", "a", "f"]
            assert [s.name for s in found[2].children] == ["b", "FRAME ROTATE 30"]
            assert (found[2].range.start.line, found[2].range.end) == (4, lsp.Position(8, 3))
        async with editor() as ed:
            ed.open(job, job.read_text(encoding="utf-8"))
            found = await ed.client.text_document_document_symbol_async(lsp.DocumentSymbolParams(ed.named(job)))
            assert [s.name for s in found] == ["LASER MODE DUTY CARRIER 10", "a", "f", "b", "FRAME ROTATE 30"]

    run(session())


def test_the_profile_is_read_anew(tmp_path: Path) -> None:
    async def session() -> None:
        text = MARK + "LINE X 20\n"
        job = folder(tmp_path, job=text) / "job.job"
        profile = tmp_path / "gusjob.toml"
        async with editor() as ed:
            ed.open(job, text)
            assert await ed.codes(job) == []
            profile.write_text("field_x_mm = [-10, 10]\n", encoding="utf-8")
            assert [d.code for d in await ed.told(job, bool)] == ["GJ503"]
            profile.write_text("field_x_mm = 7\n", encoding="utf-8")
            (said,) = await ed.told(job, lambda found: found[0].code != "GJ503")
            assert said.message.startswith("not checked: gusjob.toml: ")
            assert said.related_information[0].location.uri == profile.as_uri()
            profile.unlink()
            assert await ed.codes(job) == []

    run(session())


def test_an_included_file_is_judged_as_a_part_of_the_job(tmp_path: Path) -> None:
    async def session() -> None:
        place = folder(tmp_path, top=MARK + 'LET w = 5\nINCLUDE "part.job"\n', part="LINE X (w)\n")
        top, part = place / "top.job", place / "part.job"
        async with editor() as ed:
            ed.open(part, "LINE X (w)\n")
            assert "GJ121" in await ed.codes(part)
            ed.open(top, top.read_text(encoding="utf-8"))
            assert [d.code for d in await ed.told(part, lambda found: not found)] == []
            assert await ed.jump(part, 0, 8) == [("top.job", 3, 4)]
            assert "w = 5" in await ed.hover(part, 0, 8)
            ed.close(top)
            assert "GJ121" in [d.code for d in await ed.told(part, bool)]

    run(session())


def test_listings(tmp_path: Path) -> None:
    async def session() -> None:
        path = tmp_path / "a.gts"
        text = f"GT_BufLaserOnn(1,0,0) // {SMILE}\nGT_BufDelay(1,99999,0)\nGT_CrdStart(1,0)\n"
        async with editor() as ed:
            ed.open(path, text)
            found = await ed.told(path)
            assert ("GJ112", 0) in [(d.code, d.range.start.line) for d in found]
            assert [d for d in found if d.range.start.line == 1]
            assert "[0, 16383] ms" in await ed.hover(path, 1, 4)
            assert "GT_LnXY" in await ed.complete(path, 2, 0)

    run(session())


def test_a_text_that_breaks_the_judge_is_not_the_last_one(monkeypatch: pytest.MonkeyPatch) -> None:
    done: queue.Queue[TaskResult | str] = queue.Queue()
    worker = Worker(done.put, done.put, done.put)

    def task(text: bytes) -> Task:
        return Task(uri="u", number=1, path=None, text=Text(text), open_texts={}, uris={}, unit="utf-16")

    with monkeypatch.context() as broken:
        broken.setattr("gusjob.lsp.worker.diagnose", None)
        worker.submit(task(b"WAIT"))
        assert "error in gusjob: TypeError" in str(done.get(timeout=PATIENCE_S))
    worker.submit(task(b"QQ"))
    answer = done.get(timeout=PATIENCE_S)
    assert isinstance(answer, TaskResult)
    assert [d.code for d in answer.published["u"]] == ["GJ102"]


# What a client may send.


def speak(*messages: object, end: bool = True) -> tuple[list[dict[str, Any]], bytes, int]:
    """Messages (or bytes) to a server; its answers, standard error, exit status."""
    sent = b""
    for message in messages:
        body = message if isinstance(message, bytes) else json.dumps(message).encode()
        sent += b"Content-Length: %d\r\n\r\n%s" % (len(body), body)
    words = [sys.executable, "-m", "gusjob", "lsp"]
    process = subprocess.run(words, input=sent, capture_output=True, timeout=60, check=False)
    answers, rest = [], process.stdout
    while rest:
        head, _, rest = rest.partition(b"\r\n\r\n")
        assert head.startswith(b"Content-Length: ")  # Nothing but the protocol.
        length = int(head.split(b"Content-Length: ")[1].split(b"\r\n")[0])
        answers.append(json.loads(rest[:length]))
        rest = rest[length:]
    return answers, process.stderr, process.returncode


def ask(number: int, method: str, params: object) -> dict[str, object]:
    return {"jsonrpc": "2.0", "id": number, "method": method, "params": params}


def tell(method: str, params: object = None) -> dict[str, object]:
    return {"jsonrpc": "2.0", "method": method, "params": params}


HELLO = ask(1, "initialize", {"processId": None, "rootUri": None, "capabilities": {}})
OPEN = {"uri": "untitled:one", "languageId": "gusjob", "version": 1, "text": f"LINE X 1 ; {SMILE}\n"}
BYE = (ask(99, "shutdown", None), tell("exit"))


def test_messages_that_are_none() -> None:
    answers, said, status = speak(
        HELLO,
        b"{",
        b"[]",
        b"17",
        b"\xff\xfe",
        ask(2, "gusjob/unheard", {}),
        tell("gusjob/unheard", {}),
        ask(3, "textDocument/hover", {"textDocument": 5}),
        ask(4, "textDocument/hover", None),
        tell("textDocument/didChange", {"textDocument": {"uri": "file:///none", "version": 1}, "contentChanges": []}),
        ask(5, "workspace/executeCommand", {"command": "rm"}),
        *BYE,
    )
    assert said == b""
    assert status == 0
    by_id = {a["id"]: a for a in answers if "id" in a}
    assert by_id[2]["error"]["code"] == -32601
    assert by_id[3]["error"]["code"] == by_id[4]["error"]["code"] == -32602
    assert "error" in by_id[5]
    assert by_id[99]["result"] is None


def test_places_that_are_none() -> None:
    """Every question at places in the text, behind it and far away; of files that are not open, too."""
    far = 2**31 - 1
    questions: list[dict[str, object]] = []
    for method in ("hover", "completion", "definition"):
        for line, character in ((0, 0), (0, 11), (0, 12), (0, far), (1, 0), (2, 5), (far, far)):
            for uri in ("untitled:one", "file:///not/open.job", "no uri at all"):
                params = {"textDocument": {"uri": uri}, "position": {"line": line, "character": character}}
                questions.append(ask(len(questions) + 10, f"textDocument/{method}", params))
    edits = [
        {"range": {"start": {"line": far, "character": far}, "end": {"line": 0, "character": 2}}, "text": "\ud83d"},
        {"range": {"start": {"line": 0, "character": 13}, "end": {"line": 0, "character": far}}, "text": "\r"},
        {"text": "LINE X 1\0\n"},
        {"text": 'INCLUDE "' + "x" * 300 + '.job"\nLET a = b\nLET b = a\nCALL c(a)\n' + "(" * 500},
    ]
    changes = [
        tell("textDocument/didChange", {"textDocument": {"uri": "untitled:one", "version": n}, "contentChanges": [e]})
        for n, e in enumerate(edits, 2)
    ]
    own = {"textDocument": {"uri": "untitled:one"}}
    more = [
        ask(5, "textDocument/documentSymbol", own),
        ask(6, "textDocument/formatting", {**own, "options": {"tabSize": 2, "insertSpaces": True}}),
        ask(7, "textDocument/codeAction", {
            **own, "context": {"diagnostics": []},
            "range": {"start": {"line": 0, "character": 0}, "end": {"line": far, "character": 0}},
        }),
    ]  # fmt: skip
    both = [part for change in changes for part in (change, *more, *questions)]
    seen = [{**q, "id": number} if "id" in q else q for number, q in enumerate(both, 1000)]
    answers, said, status = speak(HELLO, tell("textDocument/didOpen", {"textDocument": OPEN}), *seen, *BYE)
    assert said == b""
    assert status == 0
    # What was still being worked out at the end is cancelled, all else answered.
    wrong = [a["error"]["code"] for a in answers if "error" in a]
    assert set(wrong) <= {-32800}
    assert sum("result" in a for a in answers) > len(seen) // 2


def test_a_client_that_is_gone() -> None:
    assert speak(HELLO, tell("textDocument/didOpen", {"textDocument": OPEN}))[1:] == (b"", 1)
    assert speak(HELLO, tell("exit"))[1:] == (b"", 1)
    assert speak()[1:] == (b"", 1)
    words = [sys.executable, "-m", "gusjob", "lsp"]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()  # Nobody reads any more.
        body = json.dumps(HELLO).encode()
        process.stdin.write(b"Content-Length: %d\r\n\r\n%s" % (len(body), body))
        process.stdin.close()
        assert process.wait(30) == 1
        assert b"Traceback" not in process.stderr.read()


def test_tcp() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        refused = CliRunner().invoke(cli, ["lsp", "--tcp", str(port)])
        assert refused.exit_code == 2
        assert f"can't listen on port {port}" in refused.output
    with subprocess.Popen(
        [sys.executable, "-m", "gusjob", "lsp", "--tcp", str(port)], stderr=subprocess.PIPE
    ) as process:

        async def session() -> None:
            client = LanguageClient("test", "1")
            for _ in range(200):
                try:
                    await client.start_tcp("127.0.0.1", port)
                    break
                except OSError:
                    await asyncio.sleep(0.05)
            said = await client.initialize_async(lsp.InitializeParams(capabilities=lsp.ClientCapabilities()))
            assert said.server_info is not None
            assert said.server_info.name == "gusjob"
            await client.shutdown_async(None)
            client.exit(None)
            assert client.protocol.writer is not None
            await asyncio.sleep(0.1)
            client.protocol.writer.close()
            await client.stop()  # type: ignore[no-untyped-call]  # pygls'

        run(session())
        assert process.wait(30) == 0
        assert process.stderr is not None
        assert process.stderr.read() == b""


def test_nothing_outside_the_folder_is_read(tmp_path: Path) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    (tmp_path / "secret.job").write_text("LET secret = 1\n", encoding="utf-8")
    (inner / "mine.job").write_text("WAIT\n", encoding="utf-8")
    (inner / "link.job").symlink_to(tmp_path / "secret.job")
    text = 'INCLUDE "../secret.job"\nINCLUDE "link.job"\n'

    async def session() -> None:
        job = inner / "job.job"
        async with editor() as ed:
            ed.open(job, text)
            assert [c for c in await ed.codes(job) if c != "GJ004"] == ["GJ138", "GJ138"]
            assert await ed.complete(job, 0, 9) == ["mine.job"]
            assert await ed.jump(job, 0, 12) == await ed.jump(job, 1, 12) == []

    run(session())


# The same as `gusjob check`.

FILES = [
    p for kind in ("job", "gts") for p in sorted(ROOT.glob(f"tests/*/*.{kind}")) + sorted(ROOT.glob(f"jobs/*.{kind}"))
]


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_diagnostics_are_those_of_check(path: Path) -> None:
    data = path.read_bytes()
    desk = Workspace({str(path.resolve()): data})
    mine = diagnose(str(path), path, data, desk)
    text = Text(data)
    found = lsp_diagnostics(SourceLocations(diagnosis=mine, uri=uri_of(path), text=text, uris={}, unit="utf-16"))
    wanted = examine_file(path, None).diagnostics
    lines = data.decode().split("\n")
    own = [f for f in wanted if not f.span.path][:500]
    assert [(d.code, d.range.start) for d in found[uri_of(path)]] == [
        (
            f.rule.code,
            lsp.Position(
                f.span.line - 1,
                units(lines[f.span.line - 1][: f.span.column - 1])
                if f.span.end_column
                else units(re.match(r"\s*", lines[f.span.line - 1])[0]),  # type: ignore[index]  # it always matches
            ),
        )
        for f in own
    ]
    elsewhere = {uri: got for uri, got in found.items() if uri != uri_of(path) and got}
    assert sum(map(len, elsewhere.values())) == sum(bool(f.span.path) for f in wanted)


def units(text: str) -> int:
    return len(text.encode("utf-16-le")) // 2


# Texts and places.

TEXTS = st.text(st.sampled_from("ab \n\r\té" + SMILE), max_size=30)
PLACES = st.builds(lsp.Position, st.integers(0, 8), st.integers(0, 12))


@given(TEXTS, st.lists(st.tuples(PLACES, PLACES, TEXTS), max_size=4))
def test_edits_are_those_of_another_reader(text: str, edits: list[tuple[lsp.Position, lsp.Position, str]]) -> None:
    """pygls' own text, line by line in Python, is the other reader."""
    other = TextDocument(
        "file:///a", text, version=0, position_codec=PositionCodec(encoding=lsp.PositionEncodingKind.Utf16)
    )
    mine = Text(utf8(text))
    for start, end, new in edits:
        lines = [re.sub(r"[\r\n]+$", "", line) for line in re.split(r"(?<=\n)|(?<=\r)(?!\n)", other.source)]
        places = []
        for place in (start, end):
            # Within the text: where a place is beyond it, the readers may differ; and not between two surrogates.
            line = min(place.line, len(lines) - 1)
            character = min(place.character, units(lines[line]))
            inside = lines[line].encode("utf-16-le")[: 2 * character].decode("utf-16-le", "ignore")
            places.append(lsp.Position(line, units(inside)))
        places.sort(key=lambda p: (p.line, p.character))
        change = lsp.TextDocumentContentChangePartial(range=lsp.Range(*places), text=new)
        other.apply_change(change)
        mine = mine.edited(change)
        assert mine.data.decode() == other.source
        assert mine.starts.tolist() == Text(mine.data).starts.tolist()


@given(TEXTS, st.sampled_from(["utf-8", "utf-16", "utf-32"]))
def test_places_there_and_back(text: str, unit: str) -> None:
    mine = Text(utf8(text), lsp.PositionEncodingKind(unit))
    at = 0
    for character in text:
        place = mine.position(at)
        assert mine.offset(place) == at or mine.data[at - 1 : at + 1] == b"\r\n"
        at += len(character.encode())


@given(TEXTS)
def test_spans_stand_where_they_stand(text: str) -> None:
    """A line and column of gusjob's (lines end at LF) and the editor's place (at CR, too) are the same character."""
    mine = Text(utf8(text))
    for number, line in enumerate(text.split("\n"), 1):
        for column, character in enumerate(line, 1):
            if character not in "\r":
                place = mine.range(Span(line=number, column=column, end_line=number, end_column=column + 1))
                got = mine.data[mine.offset(place.start) : mine.offset(place.end)].decode()
                assert got == character


def test_half_a_pair_and_a_mark_at_the_start() -> None:
    assert utf8("a\ud83db") == b"a?b"
    text = Text(b"\xef\xbb\xbfQQ 1")
    place = text.range(Span(line=1, column=1, end_line=1, end_column=3))
    assert (place.start.character, place.end.character) == (1, 3)


@given(st.text(max_size=40))
def test_uris(uri: str) -> None:
    path_of(uri)


def test_uris_of_files(tmp_path: Path) -> None:
    path = tmp_path / "a b%20ü#?.job"
    assert path_of(uri_of(path)) == path
    for none in ("untitled:Untitled-1", "file:///a%00b", "git:/a", "", "file://elsewhere/a.job"):
        assert path_of(none) is None


# What is known of words.


def limits_of() -> list[tuple[str, str, Range]]:
    return [(form, word, one) for form, words in RANGES.items() for word, ranges in words.items() for one in ranges]


SAMPLES = {
    "crd": "CRD {} FIFO {FIFO}", "channel": "CHANNEL {}", "VEL": "VEL {}", "ACC": "ACC {}", "JUMPVEL": "JUMPVEL {}",
    "JUMPACC": "JUMPACC {}", "line": "LINE X {X} Y {Y} VEL {VEL} ACC {ACC} END {END}", "jump": "JUMP X {X} Y {Y}",
    "arc": "ARC CW X {X} Y {Y} R {R} VEL {VEL} ACC {ACC} END {END}", "dwell": "DWELL {}",
    "lookahead": "LOOKAHEAD TIME {TIME} ACC {ACC}",
    "skywrite": "SKYWRITE MODE {MODE} TIMELAG {TIMELAG} SHIFT {SHIFT} NPREV {NPREV} NPOST {NPOST} LIMIT {LIMIT}",
    "DUTY": "LASER MODE DUTY CARRIER {CARRIER} MIN {MIN} MAX {MAX}",
    "DUTY2": "LASER MODE DUTY2 CARRIER {CARRIER} MIN {MIN} MAX {MAX}",
    "FREQUENCY": "LASER MODE FREQUENCY WIDTH {WIDTH} MIN {MIN} MAX {MAX}",
    "ANALOG": "LASER MODE ANALOG MIN {MIN} MAX {MAX}", "laser_delay": "LASER DELAY ON {ON} OFF {OFF}",
    "laser_standby": "LASER STANDBY FREQ {FREQ} DUTY {DUTY}", "laser_prevolt": "LASER PREVOLT {}",
    "laser_fpk": "LASER FPK WIDTH {WIDTH} GAP {GAP} OFFDELAY {OFFDELAY}",
    "laser_distance": "LASER DISTANCE REF X 0 Y 0 RATIO X 1 Y 1 MIN {MIN} MAX {MAX}",
    "laser_power": "LASER POWER {}", "laser_follow": "LASER FOLLOW RATIO {RATIO} MIN {MIN} MAX {MAX}",
}  # fmt: skip
GOOD = {
    "": "1", "FIFO": "0", "X": "1000", "Y": "1000", "VEL": "10", "ACC": "1", "END": "0", "R": "9000", "TIME": "5",
    "MODE": "2", "TIMELAG": "100", "SHIFT": "0", "NPREV": "20", "NPOST": "20", "LIMIT": "0.5", "CARRIER": "20",
    "MIN": "1", "MAX": "9", "WIDTH": "20", "ON": "1", "OFF": "1", "FREQ": "5", "DUTY": "5", "GAP": "5", "OFFDELAY": "5",
    "RATIO": "1",
}  # fmt: skip
MODES = {"%": "DUTY CARRIER 20", "kHz": "FREQUENCY WIDTH 0", "V": "ANALOG"}


@pytest.mark.parametrize(("form", "word", "limit"), limits_of(), ids=str)
def test_a_hover_names_the_range_that_the_check_knows(form: str, word: str, limit: Range) -> None:
    """A value far outside is refused with the very range that the hover shows."""
    from support.tools import MACHINE

    from gusjob.frontend import check_text, read_job
    from gusjob.lint import check

    now = word == "NOW"
    value = "1e9" if limit.high < 1e9 else "2e9" if limit.high < 2e9 else "-5" if limit.low >= 0 else None
    if value is None or (form == "laser_distance" and word == "RATIO"):
        assert limit.high == float("inf")
        return
    words = {**GOOD, ("" if now else word): value}
    sample = re.sub(r"\{(\w*)\}", lambda m: words[m[1]], SAMPLES[form]) + (" NOW" if now else "")
    mode = "ANALOG" if form in ("laser_prevolt", "ANALOG") else "DUTY CARRIER 20"
    if form in ("laser_power", "laser_follow", "laser_distance"):
        mode = {"%": "DUTY CARRIER 20", "kHz": "FREQUENCY WIDTH 1", "V": "ANALOG", "": "DUTY CARRIER 20"}[limit.unit]
    head = "UNITS PULSE\nVEL 100\nACC 5\n" + ("" if form in MODES or form.isupper() else f"LASER MODE {mode}\n")
    source, _ = check_text(f"{head}{sample}\nLASER POWER 5\nLASER ON\nLINE X 5000\nLASER OFF\n".encode(), "a.job")
    assert source is not None
    job, diagnostics = read_job(source, MACHINE)
    said = [
        str(f.fields.get("range")) for f in [*diagnostics, *check(job, MACHINE)] if f.rule.code in ("GJ201", "GJ504")
    ]
    assert str(limit) in said or (limit.unit.startswith("pulse/ms") and said), (sample, said)


def test_every_word_has_a_hover() -> None:
    for form in FORMS.values():
        assert keyword_text(form.name, form.name.split()[0]), form.name
        for word in form.words:
            if word:
                assert keyword_text(f"{form.name} {word} 1", word), (form.name, word)
    assert keyword_text("LINE X10Y20", "Y")
    assert "二.2" in keyword_text("LASER DELAY ON 5 OFF 9", "ON")
    assert "not in DUTY2" in keyword_text("LASER FPK WIDTH 5", "FPK")
    assert form_of("LASER OFF NOW") == form_of("laser on") == "laser_switch"


def test_completion_is_what_the_parser_takes(tmp_path: Path) -> None:
    text = (
        'LINE \nJUMP \nLINE X 1 \nLASER MODE \nLASER DELAY ON 5u\nLINE X (2*1)\nINCLUDE "\nLET \nVEL 10m\n'
        "LASER POWER 5\nFOR i FROM 0 \nlaser \nARC CW X1Y2 \nUNITS \nLASER POWER 5 \n"
    )

    async def session() -> None:
        job = folder(tmp_path, job=text, other="WAIT\n") / "job.job"
        async with editor() as ed:
            ed.open(job, text)
            ends = [len(line) for line in text.split("\n")]
            got = [set(await ed.complete(job, n, end)) for n, end in enumerate(ends)]
        assert got[0] == {"X", "Y", "VEL", "ACC", "END"}
        assert got[1] == {"X", "Y"}
        assert got[2] == {"Y", "VEL", "ACC", "END"}
        assert got[3] == {"DUTY", "DUTY2", "FREQUENCY", "ANALOG"}
        assert got[4] == {"us", "ms", "s"}
        assert got[6] == {"other.job"}
        assert got[7] == set()
        assert got[8] == {"m/s", "mm/s", "mm/min", "pulse/ms"}
        assert got[9] == {"%", "Hz", "kHz", "MHz", "V", "mV"}
        assert "TO" in got[10]
        assert got[11] == {"MODE", "DELAY", "STANDBY", "PREVOLT", "FPK", "DISTANCE", "POWER", "FOLLOW", "ON", "OFF"}
        assert got[12] == {"I", "J", "R", "VEL", "ACC", "END"}
        assert got[13] == {"MM", "PULSE"}
        assert got[14] == {"NOW", "CHANNEL"}

    run(session())
    assert {unit for unit in UNITS if unit_fits("VEL 5", unit)} == {"mm/s", "m/s", "mm/min", "pulse/ms"}
    assert accepted("LINE X X") == []


FIXES = [
    ("LNE X 1", "LINE X 1"),
    ("lne X 1", "line X 1"),
    ("LASER POWR 5", "LASER POWER 5"),
    ("LINE X (sine(30))", "LINE X (sin(30))"),
    ("LINE X 10 mm", "LINE X 10mm"),
    ("IF 1 = 2\nEND", "IF 1 == 2\nEND"),
    ("DEF pause(t)\nDWELL (t)\nEND\nCALL paus(3)", "DEF pause(t)\nDWELL (t)\nEND\nCALL pause(3)"),
    ("LET pitch = 2\nLINE X (ptich)", "LET pitch = 2\nLINE X (pitch)"),
]


def test_quick_fixes(tmp_path: Path) -> None:
    async def session() -> None:
        job = tmp_path / "job.job"
        async with editor() as ed:
            for before, after in FIXES:
                ed.open(job, MARK + before + "\n")
                await ed.told(job, bool)
                whole = lsp.Range(lsp.Position(0, 0), lsp.Position(99, 0))
                localized: Any = await ed.client.text_document_code_action_async(
                    lsp.CodeActionParams(ed.named(job), whole, lsp.CodeActionContext([]))
                )
                text = Text(utf8(MARK + before + "\n"))
                for edit in localized[0].edit.changes[job.as_uri()]:
                    text = text.edited(lsp.TextDocumentContentChangePartial(range=edit.range, text=edit.new_text))
                assert text.data.decode() == MARK + after + "\n"
                ed.close(job)

    run(session())


MENDED = [
    ("LASER DELAY ON 60 OFF 50\nwait", "Fix: off delay below on delay", "LASER DELAY ON 60 OFF 60\nwait"),
    ("LINE X 10；\u00e9\nline X 2", "Fix: unexpected word", "LINE X 10;\u00e9\nline X 2"),
    ("line X 10\r\nLINE x 2 ; line", "Fix: keyword in lower case", "LINE X 10\r\nLINE X 2 ; line"),
    ("LASER POWER 3\nLASER ON\nLINE X 2", "Fix: laser left on", "LASER POWER 3\nLASER ON\nLINE X 2\nLASER OFF"),
]


def test_mends_are_quick_fixes(tmp_path: Path) -> None:
    """One at a time, of the text in the editor, and only where it keeps its word."""

    async def session() -> None:
        job = tmp_path / "job.job"
        whole = lsp.Range(lsp.Position(0, 0), lsp.Position(99, 0))
        async with editor() as ed:

            async def actions(text: str) -> Any:
                ed.open(job, text)
                await ed.told(job, bool)
                localized: Any = await ed.client.text_document_code_action_async(
                    lsp.CodeActionParams(ed.named(job), whole, lsp.CodeActionContext([]))
                )
                ed.close(job)
                return localized or []

            for before, title, after in MENDED:
                for bom in ("", "\ufeff"):
                    found = [action for action in await actions(bom + MARK + before) if action.title == title]
                    assert len(found) == 1
                    text = Text(utf8(bom + MARK + before))
                    for edit in found[0].edit.changes[job.as_uri()]:
                        text = text.edited(lsp.TextDocumentContentChangePartial(range=edit.range, text=edit.new_text))
                    assert text.data.decode() == bom + MARK + after
            refused = "LASER POWER 3\nLINE X 1\nLASER ON\n"  # LASER OFF would have nothing to mark.
            assert [action.title for action in await actions(MARK + refused)] == []

    run(session())


def test_what_is_not_read_is_faded(tmp_path: Path) -> None:
    text = MARK + "LET a = 1\nDEF f()\nEND\nWAIT\n"
    path = tmp_path / "job.job"
    mine = diagnose(str(path), path, utf8(text), Workspace({str(path.resolve()): utf8(text)}))
    found = lsp_diagnostics(SourceLocations(diagnosis=mine, uri="u", text=Text(utf8(text)), uris={}, unit="utf-16"))[
        "u"
    ]
    assert [(d.code, d.tags) for d in found] == [(c, [lsp.DiagnosticTag.Unnecessary]) for c in ("GJ142", "GJ141")]


# What stands in files.


def test_the_textmate_grammar_is_made_from_the_grammar(rewrite: bool) -> None:
    if rewrite:
        GRAMMAR_PATH.write_text(textmate(), encoding="utf-8", newline="\n")
    assert GRAMMAR_PATH.read_text(encoding="utf-8") == textmate(), "run pytest --rewrite"
    assert CliRunner().invoke(cli, ["lsp", "--textmate"]).output == textmate()


def test_the_textmate_grammar_colours_every_word() -> None:
    made = json.loads(textmate())
    patterns = [(p.get("name", "number"), re.compile(p["match"])) for p in made["patterns"]]

    def colours(line: str) -> list[tuple[str, str]]:
        """As an engine does: at each place the first pattern that fits, then on behind it."""
        at, found = 0, []
        while at < len(line):
            hits = [(m.start(), n, name, m) for n, (name, one) in enumerate(patterns) if (m := one.search(line, at))]
            if not hits:
                break
            _, _, name, match = min(hits, key=lambda hit: hit[:2])
            found.append((match[0], name.split(".")[0]))
            at = max(match.end(), at + 1)
        return found

    for word in keywords("job.lark"):
        assert colours(word)[0][1] == "keyword", word
    for unit in UNITS:
        assert colours(f"5{unit}") == [(f"5{unit}", "number")], unit
    assert colours("X10Y-2.5mm ; X") == [
        ("X", "keyword"), ("10", "number"), ("Y", "keyword"), ("2.5mm", "number"), ("; X", "comment")
    ]  # fmt: skip
    assert colours("hypot(pi, width_1)") == [("hypot", "support"), ("pi", "constant"), ("width_1", "variable")]


def test_the_set_ups_of_the_guide_can_be_read() -> None:
    text = text_of("docs/editors.md")
    blocks = re.findall(r"```(\w+)\n(.*?)```", text, re.DOTALL)
    assert {kind for kind, _ in blocks} >= {"json", "lua", "toml"}
    for kind, block in blocks:
        if kind == "json":
            json.loads(block)
        elif kind == "toml":
            server = tomllib.loads(block)["language-server"]["gusjob"]
            assert (server["command"], server["args"]) == ("gusjob", ["lsp"])
        elif kind == "lua":
            bare = re.sub(r"'[^']*'|--.*", "", block)
            assert all(bare.count(a) == bare.count(b) for a, b in ("{}", "()"))
            assert "cmd = { 'gusjob', 'lsp' }" in block


def test_without_the_extra_it_says_which(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygls", None)
    result = CliRunner().invoke(cli, ["lsp"])
    assert result.exit_code == 2
    assert 'python -m pip install "gusjob[lsp]"' in result.output


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no terminals here")
def test_a_terminal_is_no_editor() -> None:
    ours, theirs = os.openpty()
    try:
        done = subprocess.run([sys.executable, "-m", "gusjob", "lsp"], stdin=theirs, capture_output=True, timeout=60)
    finally:
        os.close(ours)
        os.close(theirs)
    assert done.returncode == 2
    assert b"an editor must start" in done.stderr
