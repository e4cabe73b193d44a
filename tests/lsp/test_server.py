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
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from lsprotocol import types as lsp
from pygls.lsp.client import LanguageClient
from support.documents import text_of
from support.editor import PATIENCE_S, SMILE, editor, folder, run
from support.tools import MARK

from gusjob.cli import cli
from gusjob.lsp.diagnostics import diagnose
from gusjob.lsp.text import Text
from gusjob.lsp.worker import Task, TaskResult, Worker
from gusjob.lsp.workspace import Workspace, path_of


def test_looking_for_jobs_that_include_it_makes_them_no_part(tmp_path: Path) -> None:
    """To know whether a comment is idle jobs near by are read: those that do not include the file stay their own."""
    other, path = tmp_path / "b.job", tmp_path / "a.job"
    other.write_text("VEL\n", encoding="utf-8")
    path.write_text("DWELL 3 ; allow GJ404: once\n", encoding="utf-8")
    judged_ = diagnose(str(path), path, path.read_bytes(), Workspace({str(other.resolve()): b"VEL\n"}))
    assert [diagnostic.rule.code for diagnostic in judged_.diagnostics] == ["GJ145"]
    assert judged_.files == frozenset()


@pytest.mark.parametrize(
    ("locale", "options", "reply"),
    [
        ("zh-cn", (), "没有以"),
        ("zh-cn", ("--lang", "en"), "no statement begins with"),
        ("de", (), "no statement begins with"),
        (None, ("--lang", "zh"), "没有以"),
    ],
)
def test_the_editors_language(tmp_path: Path, locale: str | None, options: tuple[str, ...], reply: str) -> None:
    async def session() -> None:
        async with editor(None, *options, locale=locale) as mine:
            path = tmp_path / "a.job"
            mine.open(path, "QQ\n")
            (diagnostic, *_) = await mine.published(path)
            assert reply in diagnostic.message

    run(session())


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
            broken = await ed.published(job)
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
            assert [(d.code, d.range.start.character, d.range.end.character) for d in await ed.published(job)] == [
                ("GJ121", 13, 31)
            ]
            ed.edit(job, (4, 23), (4, 30), "")
            assert await ed.codes(job) == []
            # In a comment, the second of two pairs of surrogates: columns are UTF-16 units.
            ed.edit(job, (4, 30), (4, 32), "\r\nQQ ")
            assert [(d.code, d.range.start) for d in await ed.published(job)] == [("GJ102", lsp.Position(5, 0))]
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
            wrong = await ed.published(head, bool)
            assert [(d.code, d.range.start) for d in wrong] == [("GJ201", lsp.Position(3, 12))]
            assert [(i.location.uri, i.message) for i in wrong[0].related_information] == [
                (job.as_uri(), "included here")
            ]
            ed.close(head)
            assert await ed.codes(job) == []
            # Renamed on the disk: seen without a keystroke.
            head.rename(place / "kopf.job")
            assert "GJ138" in [d.code for d in await ed.published(job, bool)]
            assert await ed.complete(job, 1, 9) == ["kopf.job"]
            ed.edit(job, (1, 9), (1, 17), "kopf.job")
            assert await ed.codes(job) == []
            # Layout.
            ed.edit(job, (6, 2), (6, 6), "   line")
            await ed.published(job)
            params = lsp.DocumentFormattingParams(ed.named(job), lsp.FormattingOptions(tab_size=2, insert_spaces=True))
            (change,) = await ed.client.text_document_formatting_async(params) or ()
            assert change.new_text == "  LINE X 10\r\n"
            assert change.range == lsp.Range(lsp.Position(6, 0), lsp.Position(7, 0))

    run(session())


def test_diagnostics_are_those_of_the_current_text(tmp_path: Path) -> None:
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
                reply = await asyncio.wait_for(ed.received.get(), PATIENCE_S)
                assert reply.version is not None
                assert bool(reply.diagnostics) == bool(reply.version % 2)
                last = reply.version

    run(session())


def test_symbols(tmp_path: Path) -> None:
    async def session() -> None:
        place = folder(tmp_path, job=MARK + "LET a = 1\nDEF f(x)\n  LET b = x\n  FRAME ROTATE 30\n  END\nEND\n")
        job = place / "job.job"
        nested = lsp.DocumentSymbolClientCapabilities(hierarchical_document_symbol_support=True)
        caps = lsp.ClientCapabilities(text_document=lsp.TextDocumentClientCapabilities(document_symbol=nested))
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


@pytest.mark.slow
def test_a_changed_profile_is_read_again(tmp_path: Path) -> None:
    async def session() -> None:
        text = MARK + "LINE X 20\n"
        job = folder(tmp_path, job=text) / "job.job"
        profile = tmp_path / "gusjob.toml"
        async with editor() as ed:
            ed.open(job, text)
            assert await ed.codes(job) == []
            profile.write_text("field_x_mm = [-10, 10]\n", encoding="utf-8")
            assert [d.code for d in await ed.published(job, bool)] == ["GJ503"]
            profile.write_text("field_x_mm = 7\n", encoding="utf-8")
            (reply,) = await ed.published(job, lambda found: found[0].code != "GJ503")
            assert reply.message.startswith("not checked: gusjob.toml: ")
            assert reply.related_information[0].location.uri == profile.as_uri()
            profile.unlink()
            assert await ed.codes(job) == []

    run(session())


def test_an_included_file_is_checked_as_a_part_of_the_job(tmp_path: Path) -> None:
    async def session() -> None:
        place = folder(tmp_path, top=MARK + 'LET w = 5\nINCLUDE "part.job"\n', part="LINE X (w)\n")
        top, part = place / "top.job", place / "part.job"
        async with editor() as ed:
            ed.open(part, "LINE X (w)\n")
            assert "GJ121" in await ed.codes(part)
            ed.open(top, top.read_text(encoding="utf-8"))
            assert [d.code for d in await ed.published(part, lambda found: not found)] == []
            assert await ed.jump(part, 0, 8) == [("top.job", 3, 4)]
            assert "w = 5" in await ed.hover(part, 0, 8)
            ed.close(top)
            assert "GJ121" in [d.code for d in await ed.published(part, bool)]

    run(session())


def test_listings(tmp_path: Path) -> None:
    async def session() -> None:
        path = tmp_path / "a.gts"
        text = f"GT_BufLaserOnn(1,0,0) // {SMILE}\nGT_BufDelay(1,99999,0)\nGT_CrdStart(1,0)\n"
        async with editor() as ed:
            ed.open(path, text)
            found = await ed.published(path)
            assert ("GJ112", 0) in [(d.code, d.range.start.line) for d in found]
            assert [d for d in found if d.range.start.line == 1]
            assert "[0, 16383] ms" in await ed.hover(path, 1, 4)
            assert "GT_LnXY" in await ed.complete(path, 2, 0)

    run(session())


def test_the_worker_goes_on_after_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_malformed_messages() -> None:
    answers, reply, status = speak(
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
    assert reply == b""
    assert status == 0
    by_id = {a["id"]: a for a in answers if "id" in a}
    assert by_id[2]["error"]["code"] == -32601
    assert by_id[3]["error"]["code"] == by_id[4]["error"]["code"] == -32602
    assert "error" in by_id[5]
    assert by_id[99]["result"] is None


def test_positions_outside_the_text() -> None:
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
    answers, reply, status = speak(HELLO, tell("textDocument/didOpen", {"textDocument": OPEN}), *seen, *BYE)
    assert reply == b""
    assert status == 0
    # What was still being worked out at the end is cancelled, all else answered.
    wrong = [a["error"]["code"] for a in answers if "error" in a]
    assert set(wrong) <= {-32800}
    assert sum("result" in a for a in answers) > len(seen) // 2


def test_a_client_that_has_ended() -> None:
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
            reply = await client.initialize_async(lsp.InitializeParams(capabilities=lsp.ClientCapabilities()))
            assert reply.server_info is not None
            assert reply.server_info.name == "gusjob"
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


@given(st.text(max_size=40))
def test_uris(uri: str) -> None:
    path_of(uri)


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
