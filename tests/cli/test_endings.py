"""The ending of an output file decides its format, in every command; --format decides against it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.cli import GOOD, gusjob, write

STARTS: dict[str, dict[str, bytes]] = {
    "compile": {".gts": b"GT_SetAxisMode(", ".json": b'{"schema": "gusjob-calls/1"', ".c": b"/*\n"},
    "report": {
        ".txt": b"x.job\nOK, no", ".json": b'{"schema": "gusjob-report/1"', ".csv": b"line,kind", ".md": b"## ",
        ".html": b"<!DOCTYPE html>", ".parquet": b"PAR1",
    },
    "trace": {".vcd": b"$comment", ".csv": b"time_ms", ".parquet": b"PAR1", ".npz": b"PK\3\4"},
    "plot": {".png": b"\x89PNG", ".svg": b"<?xml", ".pdf": b"%PDF"},
    "check": {
        ".txt": b"x.job:1:1: note[GJ", ".json": b'{\n  "schema": "gusjob-check/1"', ".sarif": b'{\n  "$schema": "https',
        ".sarif.json": b'{\n  "$schema": "https', ".xml": b"<?xml",
    },
}  # fmt: skip
"""What a file of each ending begins with, by the formats themselves; the first one is each command's default."""
OPTIONS = {".txt": "table", ".md": "markdown", ".sarif": "sarif", ".sarif.json": "sarif", ".xml": "junit"}
"""Names of formats that are not those of their endings."""


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write(Path(), "LET unread = 1\n" + GOOD)


@pytest.mark.parametrize(("command", "ending"), [(name, ending) for name in STARTS for ending in STARTS[name]])
def test_the_ending_decides(command: str, ending: str) -> None:
    for name in ("out" + ending, "a.b" + ending.upper()):
        assert gusjob(command, "x.job", "-o", name).exit_code == 0
        assert Path(name).read_bytes().startswith(STARTS[command][ending])


@pytest.mark.parametrize("command", STARTS)
def test_an_ending_without_a_format(command: str) -> None:
    *first, default = reversed(STARTS[command])
    for name in ("x.foo", "x.json.gz", "1.5"):
        done = gusjob(command, "none.job", "-o", name)  # Before anything is read.
        listed = f"{', '.join(reversed(first[1:]))} or {first[0]}" if len(first) > 1 else first[0]
        message = f"{name}: the name of the output file must end in {default}, {listed}; or use --format"
        assert (done.exit_code, message in done.stderr) == (2, True), done.stderr
        assert not Path(name).exists()


@pytest.mark.parametrize("command", STARTS)
def test_a_name_without_an_ending_has_the_default(command: str) -> None:
    start = next(iter(STARTS[command].values()))
    for name in ("out", ".json", "out."):
        done = gusjob(command, "x.job", "-o", name)
        if command == "plot":  # No viewer opens a picture without an ending.
            assert (done.exit_code, "must end in .png, .svg or .pdf" in done.stderr) == (2, True)
        else:
            assert Path(name).read_bytes().startswith(start)
    assert gusjob(command, "x.job", "-o", "-").stdout_bytes.startswith(start)
    assert not Path("-").exists()
    form = {"report": "table", "check": "text"}.get(command, next(iter(STARTS[command]))[1:])
    assert gusjob(command, "x.job", "--format", form, "-o", "./-").exit_code == 0
    assert Path("-").read_bytes().startswith(start)


@pytest.mark.parametrize("command", STARTS)
def test_the_option_wins(command: str) -> None:
    ending = list(STARTS[command])[-1]
    form = OPTIONS.get(ending, ending[1:])
    for name in ("out.foo", "out" + next(iter(STARTS[command])), "out", "-"):
        done = gusjob(command, "x.job", "--format", form, "-o", name)
        assert done.exit_code == 0
        written = done.stdout_bytes if name == "-" else Path(name).read_bytes()
        assert written.startswith(STARTS[command][ending])


@pytest.mark.skipif(os.name == "nt", reason="no such devices")
def test_devices() -> None:
    for command in STARTS:
        assert gusjob(command, "x.job", "-o", "/dev/null").exit_code == 0
    words = [sys.executable, "-m", "gusjob", "compile", "x.job", "-o", "/dev/stdout"]
    assert subprocess.run(words, capture_output=True, check=True).stdout.startswith(b"GT_SetAxisMode(")
    Path("link.json").symlink_to("/dev/stdout")
    words[-1] = "link.json"
    assert subprocess.run(words, capture_output=True, check=True).stdout.startswith(b'{"schema"')


def test_commands_with_one_format() -> None:
    done = gusjob("record", "-o", "calls.json", "--", "true")
    assert (done.exit_code, "calls.json: the name of the output file must end in .gts\n" in done.stderr) == (2, True)
    done = gusjob("record", "-o", "-", "--", "true")
    assert (done.exit_code, "a file called - is ./-" in done.stderr) == (2, True)
    done = gusjob("lsp", "--textmate", "-o", "gusjob.plist")
    assert (done.exit_code, "must end in .json\n" in done.stderr) == (2, True)
    assert gusjob("lsp", "--textmate", "-o", "gusjob.tmLanguage.json").exit_code == 0
