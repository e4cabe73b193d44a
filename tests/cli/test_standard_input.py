"""`-` as FILE: standard input is read as a file is, under the name of --stdin-filename."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.cli import GOOD, gusjob, write
from support.tools import MARK

BAD = (MARK + "LASER POWER 120\n").encode()
WRITERS = (
    "check --format json", "check --format junit", "fmt", "fmt --check", "compile", "compile --format json",
    "compile --format c", "run", "report", "report --format json", "report --format csv", "report --format markdown",
    "report --format html", "trace --format csv", "trace --format vcd", "plot -o - --format svg",
)  # fmt: skip
CALL = b"GT_LnXY(1,1000,0,50,2,0,0)\nGT_CrdStart(1,0)\n"
BOM = b"\xef\xbb\xbf"


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize("command", WRITERS)
@pytest.mark.parametrize("text", [GOOD, GOOD.replace("LINE", "line"), BAD.decode()], ids=["good", "lower", "bad"])
def test_a_text_is_read_as_its_file_is(command: str, text: str) -> None:
    for name in ("in/a.job", "in/a.gts", "in/a"):
        file = Path(name)
        file.parent.mkdir(exist_ok=True)
        file.write_text(text, encoding="utf-8")
        given = gusjob(*command.split(), "-", "--stdin-filename", name, given=text.encode())
        if command == "fmt":
            direct = gusjob("fmt", name)
            assert given.stdout == (file.read_text(encoding="utf-8") if direct.exit_code == 0 else "")
            assert (given.exit_code, given.stderr) == (direct.exit_code, direct.stderr)
        else:
            direct = gusjob(*command.split(), name)
            assert (given.exit_code, given.stdout_bytes) == (direct.exit_code, direct.stdout_bytes)
            assert given.stderr == direct.stderr


@pytest.mark.parametrize(
    ("text", "code", "exit_code"),
    [
        (b"", "GJ004", 0), (BAD, "GJ201", 1), (b"LINE X \0 1\n", "GJ002", 2), (b"\xff\xfeL\0", "GJ002", 2),
        (CALL, "GJ710", 0), (CALL.decode().encode("utf-16"), "GJ147", 0),
    ],
)  # fmt: skip
def test_the_text_without_a_name(text: bytes, code: str, exit_code: int) -> None:
    """A text with GT_ calls is a listing, any other one a job: as with files that have no known ending."""
    done = gusjob("check", "-", "--format", "json", given=text)
    found = json.loads(done.stdout)["diagnostics"]
    assert done.exit_code == exit_code
    assert ("<stdin>", code) in {(f["path"], f["code"]) for f in found}


def test_a_text_that_is_too_large(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gusjob.frontend.source.MAX_FILE_MB", 0.001)
    for command in ("check", "fmt", "report"):
        done = gusjob(command, "-", given=b"; " + b"x" * 2000)
        assert (done.exit_code, "<stdin>:1:1: error[GJ003]" in done.output) == (2, True)


def test_profile_and_includes_are_looked_for_at_the_name() -> None:
    for folder, period_us in ((Path("in"), 100), (Path(), 50)):
        folder.mkdir(exist_ok=True)
        write(folder, f"period_us = {period_us}\n", "gusjob.toml")
        write(folder, GOOD, "part.job")
    for name, period_us in (([], 50), (["--stdin-filename", "in/new.job"], 100)):
        done = gusjob("report", "-", *name, "--format", "json", given=b'INCLUDE "part.job"\n')
        found = json.loads(done.stdout)
        assert (found["period_us"], found["totals"]["segments"]) == (period_us, 2)
    done = gusjob("check", "-", "--stdin-filename", "in/part.job", given=b'INCLUDE "part.job"\n')
    assert (done.exit_code, "in/part.job:1:" in done.stdout.replace(os.sep, "/")) == (1, True)  # It includes itself.


def test_with_other_files() -> None:
    write(Path(), BAD, "b.job")
    write(Path(), BAD, "-")
    done = gusjob("check", "b.job", "-", "./-", "-", "--format", "json", given=BAD)
    paths = [f["path"] for f in json.loads(done.stdout)["diagnostics"]]
    assert paths == ["b.job", "<stdin>", str(Path("-").absolute())]
    assert gusjob("check", "[-]", given=b"").stdout.startswith(f"{Path('-').absolute()}:4:13: error")


def test_fixes_are_written_to_standard_output() -> None:
    unfinished, listing = GOOD.removesuffix("LASER OFF\n").encode(), CALL.decode().encode("utf-16")
    fixed = gusjob("check", "--fix", "-", given=BOM + unfinished)
    assert (fixed.exit_code, fixed.stdout_bytes) == (0, BOM + GOOD.encode())
    assert fixed.stderr == "1 file: clean; 1 fixed\n"
    for text in (GOOD.encode(), BAD, listing):
        rest = gusjob("check", "--fix", "-", given=text)
        assert rest.stdout_bytes == text
    none = gusjob("check", "--fix", "-", given=b"\0")
    assert (none.exit_code, none.stdout_bytes) == (2, b"")
    done = gusjob("check", "--fix", "-", "--format", "json", "-o", "rest.json", given=unfinished)
    assert (done.exit_code, done.stdout) == (0, GOOD)
    assert json.loads(Path("rest.json").read_bytes())["diagnostics"] == []
    for option in ("--format=json", "--statistics"):
        done = gusjob("check", "--fix", "-", option, given=unfinished)
        assert (done.exit_code, done.stdout, "with -o" in done.stderr) == (2, "", True)
    counted = gusjob("check", "--fix", "-", "--statistics", "-o", "rest.txt", given=BAD)
    assert (counted.stdout_bytes, "1  GJ201" in Path("rest.txt").read_text(encoding="utf-8")) == (BAD, True)
    shown = gusjob("check", "--diff", "-", "--stdin-filename", "a.job", given=unfinished)
    assert (shown.exit_code, shown.stdout.splitlines()[-1]) == (1, "+LASER OFF")
    assert "a.job" in shown.stdout.splitlines()[0]


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("watch -", "can't be used here"),
        ("tune -", "can't be used here"),
        ("check x.job --machine -", "can't be used here"),
        ("report x.job --against -", "can't be used here"),
        ("run - --backend gts", "standard input can't be run on a controller"),
        ("run --backend gts --resume -", "can't be used here"),
        ("run x.job --stdin-filename a.job", "write - as FILE, too"),
        ("check --stdin-filename a.job", "write - as FILE, too"),
        ("fmt x.job --stdin-filename a.job", "write - as FILE, too"),
        ("check - --stdin-filename=", "is not a file name"),
        ("check - --stdin-filename ..", "is not a file name"),
        ("compile - -o x.job --format gts --stdin-filename x.job", "x.job is an input of this command"),
    ],
)
def test_where_it_is_refused(command: str, message: str) -> None:
    write(Path(), GOOD)
    done = gusjob(*command.split(), given=GOOD.encode())
    assert (done.exit_code, message in done.stderr) == (2, True), done.output


@pytest.mark.skipif(os.name == "nt", reason="closes a descriptor")
def test_standard_input_that_is_closed() -> None:
    for command in ("check", "fmt", "report"):
        words = ["sh", "-c", f"'{sys.executable}' -m gusjob {command} - <&-"]
        done = subprocess.run(words, capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (2, "gusjob: standard input: can't read: it is closed\n")
