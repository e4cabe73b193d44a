"""`gusjob watch` as users run it: a process, files that are saved, a page that follows."""

from __future__ import annotations

import http.client
import os
import queue
import re
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.cli import GOOD, gusjob, write
from support.tools import MARK

from gusjob.cli import watch_command
from gusjob.cli.serve import PageServer

PATIENCE_S = 20.0

# Ctrl-C is ignored in what a shell started in the background.
_MAIN = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from gusjob.cli import main; main()"


class Watched:
    """A running `gusjob watch`, its lines as they come."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-u", "-c", _MAIN, "watch", "x.job", *arguments],
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            encoding="utf-8",
        )
        self.lines: queue.Queue[str] = queue.Queue()
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.put(line.rstrip("\n"))

    def until(self, text: str) -> str:
        """Wait for the next line with a text."""
        deadline, seen = time.monotonic() + PATIENCE_S, []
        while time.monotonic() < deadline:
            try:
                seen.append(self.lines.get(timeout=0.1))
            except queue.Empty:
                assert self.process.poll() is None or not self.lines.empty(), seen
                continue
            if text in seen[-1]:
                return seen[-1]
        raise AssertionError(f"{text!r} was not printed: {seen}")

    def stop(self) -> int:
        """Press Ctrl-C."""
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(PATIENCE_S)

    def end(self) -> None:
        """Kill it."""
        self.process.kill()
        self.process.wait()
        self.reader.join()
        assert self.process.stdout is not None
        self.process.stdout.close()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write(tmp_path, GOOD)
    return tmp_path


@pytest.fixture
def watched(folder: Path) -> Iterator[Watched]:
    found = Watched(folder)
    yield found
    found.end()


def saved(path: Path, text: str) -> None:
    """Save as editors do: a new file replaces the old one."""
    beside = path.with_suffix(".tmp")
    beside.write_text(text, encoding="utf-8")
    beside.replace(path)


def test_a_job_is_reported_whenever_it_is_saved(folder: Path, watched: Watched) -> None:
    """5 mm of jump and 5 mm of mark; then 15 mm of mark; then an error; then none again."""
    assert "5 mm marked" in watched.until("OK, ")
    watched.until("no problems")
    saved(folder / "x.job", GOOD.replace("LINE X 10", "LINE X 20"))
    assert "15 mm marked" in watched.until("OK, ")
    saved(folder / "x.job", GOOD.replace("LINE X 10", "LINE Q 10"))
    assert watched.until("error[").startswith("x.job:7:6: error[GJ101]")
    (folder / "x.job").write_text(GOOD, encoding="utf-8")
    assert "5 mm marked" in watched.until("OK, ")


@pytest.mark.skipif(os.name != "posix", reason="Ctrl-C can't be sent to a single process elsewhere")
def test_values_of_lets_are_kept(folder: Path) -> None:
    text = "LET dose = 40%\n" + MARK + "LASER POWER (dose)\nLASER ON\nLINE X 5\nLASER OFF\n"
    write(folder, text)
    watched = Watched(folder, "-D", "dose=25%")
    try:
        assert watched.until("x.job  -D") == "x.job  -D dose=25%"
        assert "peak 25 %" in watched.until("laser on")
        saved(folder / "x.job", text.replace("LINE X 5", "LINE X 6"))
        line = watched.until("laser on")
        assert "6 mm marked" in line and "peak 25 %" in line
    finally:
        watched.end()


def test_ctrl_c_ends_it(watched: Watched) -> None:
    watched.until("no problems")
    assert watched.stop() == 0


def test_profile_and_includes_are_watched(folder: Path) -> None:
    """A new profile, an included file that is new and that changes, a file that the job does not include."""
    (folder / "parts").mkdir()
    write(folder, GOOD.replace("LINE X 10", 'INCLUDE "parts/part.job"'))
    found = Watched(folder)
    try:
        found.until("there is no such file")
        write(folder, "LINE X 20\n", "other.job")
        write(folder / "parts", "LINE X 10\n", "part.job")
        assert "5 mm marked" in found.until("OK, ")
        write(folder / "parts", "LINE X 30\n", "part.job")
        assert "25 mm marked" in found.until("OK, ")
        write(folder, "field_x_mm = [-8, 8]\n", "gusjob.toml")
        found.until("error[GJ503]")
    finally:
        found.end()


@pytest.mark.skipif(os.name != "posix", reason="links need a right of their own elsewhere")
def test_includes_of_a_link_are_watched(tmp_path: Path) -> None:
    """They are beside the job, not beside the link to it."""
    folder = tmp_path / "folder"
    folder.mkdir()
    write(folder, GOOD.replace("LINE X 10", 'INCLUDE "part.job"'), "top.job")
    (tmp_path / "x.job").symlink_to(folder / "top.job")
    found = Watched(tmp_path)
    try:
        found.until("there is no such file")
        write(folder, "LINE X 10\n", "part.job")
        assert "5 mm marked" in found.until("OK, ")
        write(folder, "LINE X 30\n", "part.job")
        assert "25 mm marked" in found.until("OK, ")
    finally:
        found.end()


def test_the_page_follows(folder: Path) -> None:
    pytest.importorskip("jinja2", reason="the page needs jinja2")
    found = Watched(folder, "--page")
    try:
        host = found.until("http://").split("http://")[1].split("/")[0]
        found.until("no problems")
        old = events_of(got(host, "/")[1])
        events = http.client.HTTPConnection(host, timeout=PATIENCE_S)
        events.request("GET", old)
        stream = events.getresponse()
        saved(folder / "x.job", GOOD.replace("LINE X 10", "LINE Q 10"))
        assert stream.readline() == b"data: changed\n"
        page = got(host, "/")[1]
        assert b"GJ101" in page
        assert events_of(page) != old
        events.close()
    finally:
        found.end()


def events_of(page: bytes) -> str:
    """The address of a page."""
    found = re.search(rb'"watched":"(/events/[0-9a-f]{16})"', page)
    assert found is not None
    return found[1].decode()


def got(host: str, path: str, **headers: str) -> tuple[int, bytes]:
    connection = http.client.HTTPConnection(host, timeout=PATIENCE_S)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    try:
        return answer.status, answer.read()
    finally:
        connection.close()


def test_only_this_computer_is_served() -> None:
    """Another name for this address (DNS rebinding) gets nothing, nor is there anything but the page."""
    server = PageServer()
    try:
        events = server.new_events()
        server.show(b"<p>1", events)
        host = server.url.split("/")[2]
        port = host.split(":")[1]
        assert got(host, "/") == (200, b"<p>1")
        assert got(host, "/", Host=f"localhost:{port}")[0] == 200
        assert got(host, "/", Host="evil.example")[0] == 403
        assert got(host, events, Host=f"evil.example:{port}")[0] == 403
        assert got(host, "/x.job")[0] == 404
        assert got(host, "/../x.job")[0] == 404
        with pytest.raises(OSError, match=r"in use|only one usage"):
            PageServer(int(port))
    finally:
        server.close()


def test_an_outdated_page_is_notified_at_once() -> None:
    """The job was saved while the page was sent, or the page is of another `watch` at the same port."""
    server = PageServer()
    try:
        host = server.url.split("/")[2]
        first, second = server.new_events(), server.new_events()
        server.show(b"<p>1", first)
        server.show(b"<p>2", second)
        for old in (first, "/events/0123456789abcdef"):
            assert got(host, old) == (200, b"data: changed\n\n")
    finally:
        server.close()


def test_a_browser_that_goes_away(capfd: pytest.CaptureFixture[str]) -> None:
    """It leaves in the middle of a page: nothing is printed, and others are served."""
    server = PageServer()
    try:
        server.show(b"x" * 10_000_000, server.new_events())
        host, port = server.url.split("/")[2].split(":")
        for _ in range(3):
            with socket.create_connection((host, int(port)), timeout=PATIENCE_S) as browser:
                browser.sendall(f"GET / HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n".encode())
                assert browser.recv(100)
                browser.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        assert len(got(f"{host}:{port}", "/")[1]) == 10_000_000
    finally:
        server.close()
    assert capfd.readouterr() == ("", "")


def test_a_port_that_is_taken(folder: Path) -> None:
    pytest.importorskip("jinja2", reason="the page needs jinja2")
    server = PageServer()
    try:
        port = server.url.rstrip("/").split(":")[-1]
        found = gusjob("watch", folder / "x.job", "--page", "--port", port)
        assert found.exit_code == 2
        assert f"can't listen on port {port}" in found.output
    finally:
        server.close()


def test_wrong_usage(folder: Path) -> None:
    assert gusjob("watch", folder / "none.job").exit_code == 2
    assert gusjob("watch", folder / "x.job", "--port", "1").exit_code == 2


@pytest.mark.parametrize("kept_time", [False, True])
def test_an_include_that_is_saved_while_it_is_reported_missing_is_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kept_time: bool
) -> None:
    """The file comes after the job was read and before the wait begins, also with the time of an older file."""
    job, part = write(tmp_path, MARK + 'INCLUDE "part.job"\n'), tmp_path / "part.job"

    def show_and_save(*_args: object, **_options: object) -> None:
        part.write_text("LINE X 10\n", encoding="utf-8")
        if kept_time:
            os.utime(part, (1, 1))

    def wait(path: Path, machine: Path | None, needed: set[Path], seen: watch_command.Stamp) -> None:
        assert part in needed
        assert watch_command._stamp(path, machine, needed) != seen
        raise KeyboardInterrupt

    monkeypatch.setattr(watch_command, "show", show_and_save)
    monkeypatch.setattr(watch_command, "_wait_for_change", wait)
    assert gusjob("watch", job).exit_code == 0


def test_an_include_that_is_saved_while_it_is_reported_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    job, part = write(tmp_path, MARK + 'INCLUDE "part.job"\n'), write(tmp_path, "LINE X 10\n", "part.job")

    def wait(path: Path, machine: Path | None, needed: set[Path], seen: watch_command.Stamp) -> None:
        assert (watch_command._stamp(path, machine, needed) != seen) is saves
        raise KeyboardInterrupt

    monkeypatch.setattr(watch_command, "_wait_for_change", wait)
    saves = False
    os.utime(part, (1, 1))
    assert gusjob("watch", job).exit_code == 0
    saves = True
    monkeypatch.setattr(watch_command, "show", lambda *_a, **_o: part.write_text("LINE X 20\n", encoding="utf-8"))
    assert gusjob("watch", job).exit_code == 0
