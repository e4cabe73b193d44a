"""Files that commands read: a named pipe that nobody writes to must not block them; a shell's pipes are read."""

from __future__ import annotations

import errno
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

import pytest
from support.cli import GOOD, gusjob, write

import gusjob as api
from gusjob.i18n.phrases import reason_of
from gusjob.inputs import exists, open_input

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no named pipes as files")

PATIENCE_S = 20
WHY = "it is a named pipe, not a file"


@pytest.fixture(autouse=True)
def _patience() -> Iterator[None]:
    """Interrupt what blocks."""

    def late(_number: int, _frame: FrameType | None) -> None:
        pytest.fail("it blocks")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(PATIENCE_S)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a job and a named pipe that nobody writes to."""
    monkeypatch.chdir(tmp_path)
    write(tmp_path, GOOD)
    os.mkfifo(tmp_path / "pipe")
    return tmp_path


READERS = (
    "check", "compile", "report", "report --format html", "trace", "plot -o a.png", "tune", "run", "run --backend gts",
    "fmt", "fmt --check", "check --fix", "check --format json",
)  # fmt: skip
WITH_PROFILE = ("check", "compile", "report", "trace", "plot -o a.png", "tune", "run")


@pytest.mark.parametrize(
    "command",
    [
        *(f"{reader} pipe" for reader in READERS),
        *(f"{reader} x.job --machine pipe" for reader in WITH_PROFILE),
        "devices --machine pipe",
        "check p*",
        "report x.job --against pipe",
        "run x.job --backend gts --resume pipe",
        "run --backend gts --resume pipe",
    ],
)
def test_a_named_pipe_is_refused(folder: Path, command: str) -> None:
    done = gusjob(*command.split())
    assert (done.exit_code, WHY in done.output) == (2, True), done.output
    assert {path.name for path in folder.iterdir()} == {"x.job", "pipe"}


def test_a_named_pipe_is_not_included(folder: Path) -> None:
    write(folder, 'VEL 100\nACC 100\nINCLUDE "pipe"\n', "top.job")
    done = gusjob("check", "top.job")
    assert (done.exit_code, "it is not a file" in done.output) == (1, True)


def test_a_named_pipe_in_a_folder_is_no_job(folder: Path) -> None:
    (folder / "pipe").rename(folder / "pipe.job")
    assert gusjob("check", ".").output == "1 file: clean\n"


def test_the_api_refuses_a_named_pipe(folder: Path) -> None:
    for job, profile in (("pipe", None), ("x.job", "pipe")):
        with pytest.raises(OSError, match=WHY) as refused:
            api.read(job, machine=profile)
        assert refused.value.errno == errno.EINVAL


def test_a_link_to_a_named_pipe_is_one(folder: Path) -> None:
    (folder / "link").symlink_to("pipe")
    with pytest.raises(OSError, match=WHY) as refused:
        open_input(Path("link"))
    assert reason_of(refused.value) == WHY


# Libraries: only regular files are loaded.


def listening(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path.relative_to(Path.cwd())))  # The whole path may be too long for a socket.


@pytest.mark.parametrize("command", ["devices", "run x.job --backend gts --abi gts"])
@pytest.mark.parametrize(
    ("library", "why"),
    [
        ("pipe", WHY),
        ("./pipe", WHY),
        ("/dev/null", "it is a device, not a file"),
        ("socket", "it is a socket, not a file"),
        ("folder", "it is a folder, not a library"),
    ],
)
def test_only_a_regular_file_is_loaded(folder: Path, command: str, library: str, why: str) -> None:
    listening(folder / "socket")
    (folder / "folder").mkdir()
    done = gusjob(*command.split(), "--library", library)
    assert done.exit_code == (1 if command == "devices" else 2)
    assert why in done.output


def test_the_profiles_library_is_no_named_pipe(folder: Path) -> None:
    write(folder, "[controller]\nlibrary = 'pipe'\n", "gusjob.toml")
    assert f"pipe can't be loaded: {WHY}" in gusjob("devices").output


@pytest.mark.skipif(sys.platform != "linux", reason="LD_LIBRARY_PATH")
def test_a_bare_name_does_not_lead_to_a_named_pipe(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a process of its own: the loader reads LD_LIBRARY_PATH at its start."""
    (folder / "lib").mkdir()
    (folder / "pipe").rename(folder / "lib" / "libsome.so")
    monkeypatch.setenv("LD_LIBRARY_PATH", str(folder / "lib"))
    done = run("devices", "--library", "libsome.so")
    assert f"libsome.so can't be loaded: {WHY}" in done.stdout


# A shell's pipes.


def run(*args: str, stdin: int | None = None, pass_fds: tuple[int, ...] = ()) -> subprocess.CompletedProcess[str]:
    """Run a command in a process of its own."""
    command = [sys.executable, "-m", "gusjob", *args]
    return subprocess.run(
        command, stdin=stdin, pass_fds=pass_fds, capture_output=True, text=True, check=False, timeout=PATIENCE_S
    )


@pytest.fixture
def pipe() -> Iterator[int]:
    """The reading end of a pipe with a job."""
    reading, writing = os.pipe()
    os.write(writing, GOOD.encode())
    os.close(writing)
    yield reading
    os.close(reading)


def test_a_pipe_of_the_shell_is_read(pipe: int) -> None:
    """As of `gusjob check <(command)`."""
    done = run("check", f"/dev/fd/{pipe}", pass_fds=(pipe,))
    assert (done.returncode, done.stderr) == (0, "1 file: clean\n")


def test_standard_input_is_read(pipe: int) -> None:
    done = run("check", "/dev/stdin", stdin=pipe)
    assert (done.returncode, done.stderr) == (0, "1 file: clean\n")


def test_a_link_to_standard_input_is_read(pipe: int, tmp_path: Path) -> None:
    (tmp_path / "link.job").symlink_to("/dev/stdin")
    done = run("check", str(tmp_path / "link.job"), stdin=pipe)
    assert (done.returncode, done.stderr) == (0, "1 file: clean\n")


def test_standard_input_may_be_a_named_pipe_whose_writer_is_gone(folder: Path) -> None:
    reading = os.open("pipe", os.O_RDONLY | os.O_NONBLOCK)
    Path("pipe").write_text(GOOD, encoding="utf-8")
    os.set_blocking(reading, True)
    try:
        done = run("check", "/dev/stdin", stdin=reading)
    finally:
        os.close(reading)
    assert (done.returncode, done.stderr) == (0, "1 file: clean\n")


def test_a_profile_from_a_pipe_is_read_once() -> None:
    """A pipe has nothing left for a second reader, such as one that shows the line with an error."""
    for command in (("check", "/dev/null"), ("devices",)):
        reading, writing = os.pipe()
        os.write(writing, b"perid_us = 1\n")
        os.close(writing)
        try:
            done = run(*command, "--machine", f"/dev/fd/{reading}", pass_fds=(reading,))
        finally:
            os.close(reading)
        assert (done.returncode, "1 | perid_us = 1" in done.stdout + done.stderr) == (1, True), done.stderr


@pytest.mark.parametrize("command", ["check", "fmt", "watch", "compile", "devices --library", "check x.job --machine"])
def test_a_name_that_is_too_long_is_a_clear_error(folder: Path, command: str) -> None:
    name = "./" + "a" * 300
    assert not exists(name)
    done = gusjob(*command.split(), name)
    assert any(why in done.output for why in ("file name too long", "no such file"))
    assert done.exit_code == (1 if "devices" in command else 2)
