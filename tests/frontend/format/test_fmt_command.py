"""gusjob fmt: files, folders, options, exit codes; a file is changed completely or not at all."""

from __future__ import annotations

import os
import stat
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from support.formatting import patched
from support.tools import MARK

from gusjob.cli import cli
from gusjob.frontend import Source
from gusjob.frontend.format import formatter
from gusjob.frontend.parse.job_reader import JobText, read_job_text


def gusjob(*args: object, given: bytes = b"") -> Result:
    return CliRunner().invoke(cli, ["fmt", *map(str, args)], input=given, catch_exceptions=False)


UGLY = MARK.lower() + "laser power=50\nlaser on\nline x10\nlaser off\n"
PRETTY = MARK + "LASER POWER 50\nLASER ON\nLINE X 10\nLASER OFF\n"


def put(folder: Path, name: str, text: str | bytes) -> Path:
    path = folder / name
    path.parent.mkdir(exist_ok=True, parents=True)
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def seen(folder: Path) -> dict[str, bytes]:
    """Every file of a folder."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_files_and_folders(tmp_path: Path) -> None:
    ugly, pretty = put(tmp_path, "in/ugly.job", UGLY), put(tmp_path, "in/pretty.JOB", PRETTY)
    put(tmp_path, "in/.hidden/a.job", UGLY)
    listed = put(tmp_path, "in/a.gts", "gt_lnxy(1,2);\n")
    alone = put(tmp_path, "other.txt", UGLY)
    os.utime(pretty, (1, 1))
    ran = gusjob(tmp_path / "in", listed, alone)
    assert (ran.exit_code, ran.stdout) == (0, "")
    last = "4 files: 2 changed, 1 unchanged, 1 listing not formatted"
    assert ran.stderr == f"{listed}: listings are not formatted\n{last}\n"
    assert ugly.read_text() == alone.read_text() == PRETTY
    assert pretty.stat().st_mtime == 1
    assert (tmp_path / "in/.hidden/a.job").read_text() == UGLY
    assert listed.read_text() == "gt_lnxy(1,2);\n"
    for option in ("--check", "--diff"):
        ran = gusjob(option, tmp_path / "in", alone)
        assert (ran.exit_code, ran.stdout, ran.stderr) == (0, "", "3 files: 3 unchanged\n")


def test_check_and_diff_write_nothing(tmp_path: Path) -> None:
    ugly, crlf = put(tmp_path, "a.job", UGLY), put(tmp_path, "b.job", b"\xef\xbb\xbfwait\r\n\r\n")
    put(tmp_path, "c.job", PRETTY)
    before = seen(tmp_path)
    ran = gusjob("--check", tmp_path)
    assert (ran.exit_code, ran.stdout) == (1, f"{ugly}\n{crlf}\n")
    assert ran.stderr == "3 files: 2 would change, 1 unchanged\n"
    ran = gusjob("--diff", tmp_path)
    assert ran.exit_code == 1
    first, second = ran.stdout_bytes.split(f"--- {crlf}".encode())
    assert patched(UGLY.encode(), first) == PRETTY.encode()
    assert second.endswith(b"\n-\xef\xbb\xbfwait\r\n-\r\n+\xef\xbb\xbfWAIT\r\n")
    assert seen(tmp_path) == before
    assert gusjob("--check", "--diff", tmp_path).stdout == ran.stdout
    assert gusjob(tmp_path).stderr == "3 files: 2 changed, 1 unchanged\n"
    assert crlf.read_bytes() == b"\xef\xbb\xbfWAIT\r\n"
    assert gusjob("--check", tmp_path).exit_code == 0


def test_a_job_with_errors_is_not_touched(tmp_path: Path) -> None:
    path = put(tmp_path, "bad.job", UGLY + "QQ 1\n")
    ran = gusjob(path, put(tmp_path, "a.job", UGLY))
    assert ran.exit_code == 1
    assert f"{path}:8:1: error[GJ102]" in ran.stderr
    assert "    8 | QQ 1\n" in ran.stderr
    assert ran.stderr.endswith("\n2 files: 1 changed, 1 failed\n")
    assert path.read_text() == UGLY + "QQ 1\n"


def test_files_that_can_not_be_read(tmp_path: Path) -> None:
    good = put(tmp_path, "a.job", UGLY)
    ran = gusjob(tmp_path / "none.job", put(tmp_path, "b.job", b"\xff\xfe"), good)
    assert ran.exit_code == 2
    assert ran.stderr.endswith("3 files: 1 changed, 2 failed\n")
    put(tmp_path, "empty/a.gts", "")
    good.write_text(UGLY)
    ran = gusjob(good, tmp_path / "empty")
    assert ran.exit_code == 2
    assert "there is no .job file in this folder" in ran.stderr
    assert good.read_text() == UGLY  # Either all files are formatted or none.
    assert gusjob().exit_code == 2


def test_standard_input() -> None:
    ran = gusjob("-", given=b"\xef\xbb\xbfwait\r\nline x1")
    assert (ran.exit_code, ran.stdout_bytes) == (0, b"\xef\xbb\xbfWAIT\r\nLINE X 1\r\n")
    assert gusjob("-", given=PRETTY.encode()).stdout == PRETTY
    ran = gusjob("-", "--check", given=b"wait\n")
    assert (ran.exit_code, ran.stdout) == (1, "<stdin>\n")
    ran = gusjob("-", "--diff", given=b"wait")
    assert (ran.exit_code, ran.stdout.splitlines()[3:]) == (1, ["-wait", "\\ No newline at end of file", "+WAIT"])
    ran = gusjob("-", given=b"QQ\n")
    assert (ran.exit_code, ran.stdout_bytes) == (1, b"")
    assert ran.stderr.startswith("<stdin>:1:1: error[")
    assert gusjob("-", given=b"a\0").exit_code == 2
    listed = b"GT_LnXY(1,2,3,4,5,6,7,8);\n"
    assert gusjob("-", given=listed).stdout_bytes == listed


@pytest.mark.skipif(sys.platform == "win32", reason="links and permissions of POSIX")
def test_links_and_permissions_stay(tmp_path: Path) -> None:
    path = put(tmp_path, "far/a.job", UGLY)
    path.chmod(0o640)
    link = tmp_path / "link.job"
    link.symlink_to(path)
    assert gusjob(link).exit_code == 0
    assert link.is_symlink()
    assert path.read_text() == PRETTY
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert seen(tmp_path).keys() == {"far/a.job", "link.job"}


def test_a_job_is_never_partly_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = put(tmp_path, "a.job", UGLY)
    calls: list[tuple[bytes, bytes]] = []

    def fails(self: Path, target: Path) -> None:
        calls.append((self.read_bytes(), Path(target).read_bytes()))
        assert self.parent == path.parent
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", fails)
        ran = gusjob(path)
    assert calls == [(PRETTY.encode(), UGLY.encode())]
    assert ran.exit_code == 2
    assert ran.stderr == f"gusjob: {path}: can't write: no space left on device\n1 file: 1 failed\n"
    assert seen(tmp_path) == {"a.job": UGLY.encode()}


def test_a_job_saved_in_the_meantime_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = put(tmp_path, "a.job", UGLY)

    def saves(source: Source) -> JobText:
        path.write_text("; mine\n")
        return read_job_text(source)

    monkeypatch.setattr(formatter, "read_job_text", saves)
    ran = gusjob(path)
    assert ran.exit_code == 2
    assert "the file was changed in the meantime" in ran.stderr
    assert path.read_text() == "; mine\n"


@pytest.mark.skipif(sys.platform == "win32" or os.geteuid() == 0, reason="root can write everything")
def test_no_permission(tmp_path: Path) -> None:
    path = put(tmp_path, "a.job", UGLY)
    path.chmod(0o400)
    ran = gusjob(path)
    assert (ran.exit_code, path.read_text()) == (2, UGLY)
