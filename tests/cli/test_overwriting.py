"""No command writes over a file that it reads, whatever name is given to it."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from support.cli import GOOD, gusjob, write

from gusjob.controllers.journal.writer import Journal
from gusjob.inputs import exists

REFUSED = "is an input of this command: name another output file with -o"
NAMES: dict[str, Callable[[Path], Path]] = {
    "plain": lambda path: path,
    "missing folder": lambda path: Path("missing") / ".." / path,
    "folder": lambda path: Path("x") / ".." / path,
    "links": lambda path: linked("link", lambda link: link.symlink_to(path), path),
    "link over a missing folder": lambda path: linked("far", lambda link: link.symlink_to(f"missing/../{path}"), path),
    "hard link": lambda path: linked("hard", lambda link: link.hardlink_to(path), path),
    "case": lambda path: path.with_stem(path.stem.swapcase()),
}
"""Other names of a file in the current folder."""


def linked(name: str, make: Callable[[Path], None], path: Path) -> Path:
    """Make a link with the path's suffix, by which some commands choose a format."""
    link = Path(name + path.stem).with_suffix(path.suffix)
    try:
        make(link)
    except OSError:
        pytest.skip("links are not allowed")
    return link


WRITERS = (
    "compile --format gts", "compile --format json", "compile --format c",
    "report --format table", "report --format json", "report --format csv", "report --format csv --summary",
    "report --format markdown", "report --format html", "report --format parquet",
    "trace --format vcd", "trace --format csv", "trace --format parquet", "trace --format npz",
    "check --format json", "check --format sarif", "check --format junit", "check --fix --format json",
    "check --format text", "check --format github", "check --format gitlab",
    "plot --format png",
)  # fmt: skip


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x").mkdir()


def put(suffix: str) -> dict[str, str]:
    """Write a job, a file that it includes, its profile, and a listing: files, each with arguments that use it."""
    write(Path(), GOOD, f"part{suffix}")
    write(Path(), f'INCLUDE "part{suffix}"\n', f"top{suffix}")
    write(Path(), "period_us = 100\n", f"profile{suffix}")
    assert gusjob("compile", f"part{suffix}", "-o", "calls.gts").exit_code == 0
    job = f"top{suffix} --machine profile{suffix}"
    return {f"top{suffix}": job, f"part{suffix}": job, f"profile{suffix}": job, "calls.gts": "calls.gts"}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("command", WRITERS)
def test_an_input_is_not_overwritten(command: str, name: str) -> None:
    for file, arguments in put(".png" if command.startswith("plot") else ".job").items():
        output, before = NAMES[name](Path(file)), Path(file).read_bytes()
        if name == "case" and not exists(output):
            continue  # Another file, where case counts.
        done = gusjob(*command.split(), *arguments.split(), "-o", output)
        assert (done.exit_code, REFUSED in done.stderr) == (2, True), (file, done.output)
        assert Path(file).read_bytes() == before
    assert not any(path.name.startswith(".gusjob") for path in Path().iterdir())
    assert not Path("missing").exists()


@pytest.mark.parametrize("name", NAMES)
def test_the_earlier_report_is_not_overwritten(name: str) -> None:
    job, old = write(Path(), GOOD), Path("old.json")
    assert gusjob("report", job, "-o", old).exit_code == 0
    output, before = NAMES[name](old), old.read_bytes()
    if name == "case" and not exists(output):
        return
    done = gusjob("report", job, "--against", old, "-o", output)
    assert (done.exit_code, REFUSED in done.stderr) == (2, True)
    assert old.read_bytes() == before


def test_what_is_included_over_a_link_is_not_overwritten() -> None:
    """Files are included relative to the job itself, not to a link to it."""
    (Path("x") / "part.job").write_text(GOOD, encoding="utf-8")
    (Path("x") / "top.job").write_text('INCLUDE "part.job"\n', encoding="utf-8")
    linked("link", lambda link: link.symlink_to("x/top.job"), Path("top.job"))
    done = gusjob("compile", "linktop.job", "--format", "gts", "-o", "x/part.job")
    assert (done.exit_code, REFUSED in done.stderr) == (2, True)
    assert (Path("x") / "part.job").read_text(encoding="utf-8") == GOOD


@pytest.mark.skipif(sys.platform != "linux", reason="names of any bytes")
def test_an_included_file_in_a_folder_whose_name_is_no_text() -> None:
    folder = Path(os.fsdecode(b"\xff"))
    folder.mkdir()
    (folder / "part.job").write_text(GOOD, encoding="utf-8")
    (folder / "top.job").write_text('INCLUDE "part.job"\n', encoding="utf-8")
    done = gusjob("compile", os.fspath(folder / "top.job"), "--format=gts", "-o", os.fspath(folder / "part.job"))
    assert (done.exit_code, "is an input of this command" in done.stderr) == (2, True)
    assert (folder / "part.job").read_text(encoding="utf-8") == GOOD


def test_an_included_file_that_is_no_text_is_not_overwritten() -> None:
    write(Path(), b"\xff\xfe\0", "part.job")
    write(Path(), 'INCLUDE "part.job"\n', "top.job")
    done = gusjob("check", "top.job", "--format", "json", "-o", "part.job")
    assert (done.exit_code, REFUSED in done.stderr) == (2, True)
    assert Path("part.job").read_bytes() == b"\xff\xfe\0"


def test_the_profile_of_a_job_that_can_not_be_read_is_not_overwritten() -> None:
    write(Path(), "period_us = 100\n", "machine.toml")
    done = gusjob("check", "none.job", "--machine", "machine.toml", "--format", "json", "-o", "machine.toml")
    assert (done.exit_code, REFUSED in done.stderr) == (2, True)
    assert Path("machine.toml").read_text(encoding="utf-8") == "period_us = 100\n"


def test_nothing_is_fixed_if_the_output_is_refused() -> None:
    unfinished = GOOD.removesuffix("LASER OFF\n")
    for file in ("a.job", "b.job"):
        write(Path(), unfinished, file)
    write(Path(), "period_us = 100\n", "machine.toml")
    for output in ("missing/../b.job", "machine.toml"):
        done = gusjob("check", "--fix", "--format", "json", "a.job", "b.job", "--machine", "machine.toml", "-o", output)
        assert (done.exit_code, REFUSED in done.stderr) == (2, True)
    assert {Path(file).read_text(encoding="utf-8") for file in ("a.job", "b.job")} == {unfinished}


@pytest.mark.parametrize("name", NAMES)
def test_a_journal_is_a_new_file(name: str) -> None:
    job = write(Path(), GOOD)
    journal = NAMES[name](Path("x.job"))
    if name == "case" and not exists(journal):
        return
    with pytest.raises(OSError):
        Journal(journal, {})
    assert job.read_text(encoding="utf-8") == GOOD


def test_other_outputs_are_written() -> None:
    """A new file over a folder that does not exist, and over a link whose target does not exist yet."""
    job = write(Path(), GOOD)
    for output in ("new.gts", "missing/../over.gts", "x/../x/other.gts"):
        assert gusjob("compile", job, "-o", output).exit_code == 0
    linked("link", lambda link: link.symlink_to("x/target.gts"), Path("x.gts"))
    assert gusjob("compile", job, "-o", "linkx.gts").exit_code == 0
    made = [Path("new.gts"), Path("over.gts"), Path("x") / "other.gts", Path("x") / "target.gts"]
    assert len({path.read_bytes() for path in made}) == 1


def test_an_output_in_a_loop_of_links_is_a_clear_error() -> None:
    job = write(Path(), GOOD)
    linked("loop", lambda link: link.symlink_to("loopx.gts"), Path("x.gts"))
    done = gusjob("compile", job, "-o", "loopx.gts")
    assert (done.exit_code, "can't write: too many levels of symbolic links" in done.stderr) == (2, True)


@pytest.mark.skipif(sys.platform == "win32", reason="no /dev/null")
def test_a_device_may_be_input_and_output() -> None:
    done = gusjob("check", "/dev/null", "--format", "json", "-o", "/dev/null")
    assert (done.exit_code, done.stderr) == (0, "1 file: 1 warning\n")
