"""What a run shows of itself (panel, lines, JSON lines), and the keys that steer it."""

from __future__ import annotations

import errno
import importlib.util
import io
import json
import math
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from support.panel import Bench, Terminal, bench_of_job
from support.tools import ROOT

from gusjob.cli.keys import Keys
from gusjob.controllers.control import Phase, RunStatus
from gusjob.hardware.forecast import Forecast

ON_POSIX = pytest.mark.skipif(sys.platform == "win32", reason="a POSIX terminal")
NASTY = "[red]x[blink]\x1b[2J\n\u202e.job"


class Gone(Terminal):
    """A terminal or pipe that nobody holds any more."""

    error = OSError(errno.EIO, "gone")

    def write(self, text: str) -> int:
        raise self.error


@pytest.fixture(name="bench")
def _bench() -> Bench:
    return bench_of_job()


@pytest.fixture(name="terminal")
def _terminal(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """A terminal of 80 columns as stderr of the bench."""
    return plug_in(bench, monkeypatch, Terminal())


def plug_in(bench: Bench, monkeypatch: pytest.MonkeyPatch, terminal: Terminal) -> Terminal:
    for name in ("NO_COLOR", "FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE"):
        monkeypatch.delenv(name, raising=False)
    for name, value in {"TERM": "xterm", "COLUMNS": "80", "LINES": "25"}.items():
        monkeypatch.setenv(name, value)
    bench.stderr = terminal
    return terminal


def screen(raw: str, columns: int) -> list[str]:
    """What a terminal shows after a text: lines, cursor up and down, erased lines; colours are passed over."""
    lines, row, column = [[" "] * columns], 0, 0
    for found in re.finditer(r"\x1b\[([?0-9;]*)([A-Za-z])|(.)", raw, re.DOTALL):
        number, command, char = found.groups()
        if command == "A":
            row -= int(number or 1)
            assert row >= 0
        elif command == "K":
            lines[row] = [" "] * columns
        elif command:
            assert command in "mhl", found[0]
        elif char == "\r":
            column = 0
        elif char == "\n":
            row, column = row + 1, 0
            lines += [[" "] * columns] * (row == len(lines))
        else:
            assert column < columns, "a line that does not fit"
            lines[row][column] = char
            column += 1
    return ["".join(line).rstrip() for line in lines]


def shown(raw: str, columns: int = 80) -> dict[str, str]:
    """The rows of the panel that the screen shows, by their first word; '' is the last row, of the keys."""
    top, *rows, bottom = [line for line in screen(raw, columns) if line]
    assert len(top) == len(bottom) == columns
    inner = [row[1:-1].strip() for row in rows]
    return {line.split()[0]: " ".join(line.split()[1:]) for line in inner[:-1]} | {"": inner[-1]}


def lines_of(text: str) -> list[str]:
    assert not text or text.endswith("\n")
    return text.splitlines()


# JSON.


def test_json_line_is_complete(bench: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    lit = int(np.flatnonzero(bench.stream.buffered.kind == 0)[1])
    with bench.watch("json") as watcher:
        bench.be(Phase.RUNNING, lit)
        bench.now_s += 1.5
        watcher.tick()
    out, err = capsys.readouterr()
    assert err == ""
    (line,) = lines_of(out)
    assert json.loads(line) == {
        "schema": "gusjob-progress/1", "phase": "running", "row": lit, "rows": len(bench.stream.buffered),
        "segment": 1, "segments": 4, "file": "test.job", "line": 7, "x_mm": 12.34, "y_mm": -3.0,
        "queued": 1024, "slots": 4096,
        "elapsed_s": 0.0, "done_ms": pytest.approx(110, abs=1), "total_ms": pytest.approx(110 + 210 + 60 + 110, abs=2),
        "doubling_mm": 0.0,
        "channels": [{"channel": 0, "unit": "%", "power": 40.0}],
    }  # fmt: skip


@pytest.mark.parametrize("phase", list(Phase))
def test_power_is_null_where_no_light_is_planned(
    bench: Bench, capsys: pytest.CaptureFixture[str], phase: Phase
) -> None:
    rows = np.flatnonzero(bench.stream.buffered.kind == 0)
    with bench.watch("json") as watcher:
        for row in (int(rows[1]), int(rows[0]), len(bench.stream.buffered)):
            bench.be(phase, row)
            bench.ticks(watcher, 0.2)
    powers = [json.loads(line)["channels"][0]["power"] for line in lines_of(capsys.readouterr().out)]
    assert powers[-3:] == [40.0 if phase in (Phase.FILLING, Phase.RUNNING) else None, None, None]


def test_json_comes_five_times_a_second_and_with_each_phase(bench: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    with bench.watch("json") as watcher:
        bench.be(Phase.RUNNING)
        bench.ticks(watcher, 10)
        many = len(lines_of(capsys.readouterr().out))
        assert 45 <= many <= 51
        bench.be(Phase.STOPPING)
        watcher.tick()
        bench.be(Phase.PAUSED)
        watcher.tick()
    assert [json.loads(line)["phase"] for line in lines_of(capsys.readouterr().out)] == ["stopping", "paused"]


def test_what_came_after_the_last_tick_is_told(bench: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    with bench.watch("json") as watcher:
        watcher.tick()
        bench.be(Phase.RUNNING, 2)
        watcher.tick()
        bench.be(Phase.RUNNING, 3)
    assert [json.loads(line)["row"] for line in lines_of(capsys.readouterr().out)] == [0, 2, 3]


def test_a_pause_is_no_time(bench: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    with bench.watch("json") as watcher:
        watcher.tick()
        for phase, seconds in ((Phase.RUNNING, 2), (Phase.PAUSED, 100), (Phase.RUNNING, 3)):
            bench.be(phase)
            bench.ticks(watcher, seconds)
    last = json.loads(lines_of(capsys.readouterr().out)[-1])
    assert last["elapsed_s"] == pytest.approx(5.0, abs=0.2)


# Lines.


def test_lines_come_with_each_phase_and_every_five_seconds(bench: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    told: list[tuple[float, str]] = []
    with bench.watch("auto") as watcher:  # stderr is no terminal.
        for phase, seconds in ((Phase.FILLING, 1), (Phase.RUNNING, 11), (Phase.PAUSED, 6), (Phase.FILLING, 1)):
            bench.be(phase)
            for _ in range(seconds * 50):
                bench.now_s += 0.02
                watcher.tick()
                told += [(bench.now_s - 100, line.split()[0]) for line in lines_of(capsys.readouterr().err)]
    expected = [(0, "filling"), (1, "running"), (6, "running"), (11, "running"), (12, "paused"), (17, "paused")]
    assert [word for _, word in told] == [word for _, word in [*expected, (18, "filling")]]
    assert [at for at, _ in told] == pytest.approx([*(at for at, _ in expected), 18], abs=0.1)


def test_a_job_of_many_stages_does_not_flood(bench: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    with bench.watch("lines") as watcher:
        for _ in range(100):
            for phase, seconds in ((Phase.FILLING, 0.18), (Phase.RUNNING, 0.02)):
                bench.be(phase)
                bench.ticks(watcher, seconds)
    assert len(lines_of(capsys.readouterr().err)) == 2 + 3 + 1  # The last one is the end.


def test_a_line_says_it_all(bench: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    bench.forecast = replace(
        bench.forecast, duration_ms=4000e3, row_ms=np.linspace(0, 4000e3, len(bench.stream.buffered) + 1)
    )
    bench.be(Phase.RUNNING, 2)
    bench.control.status = replace(bench.control.status, x_pulse=-0.4)
    with bench.watch("lines") as watcher:
        watcher.tick()
        bench.path = "part.job"
        bench.be(Phase.PAUSED, 2)
        watcher.tick()
    first, second = lines_of(capsys.readouterr().err)
    share = 2 / len(bench.stream.buffered)
    seconds = math.floor(4000 * share)
    assert first == (
        f"running  {math.floor(100 * share)} %  {seconds // 60}:{seconds % 60:02} of 1:06:40  line 6  "
        "X 0.000 Y -3.000 mm  FIFO 1024/4096"
    )
    assert "  line part.job:6  " in second


@pytest.mark.parametrize("name", ["json", "lines", "none"])
def test_a_stream_that_is_closed_from_the_start(bench: Bench, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setattr(sys, "stderr", None)
    monkeypatch.setattr(sys, "stdout", None)
    with bench.watch(name) as watcher:
        bench.ticks(watcher, 1)


def test_none_shows_nothing(bench: Bench, terminal: Terminal, capsys: pytest.CaptureFixture[str]) -> None:
    with bench.watch("none") as watcher:
        bench.ticks(watcher, 10)
    assert capsys.readouterr().out == terminal.getvalue() == ""


# What may be odd.


@pytest.mark.parametrize("mode", ["auto", "lines", "json"])
@pytest.mark.parametrize("row", [0, 3, 10**9, -1])
@pytest.mark.parametrize("empty", [True, False])
def test_nothing_to_do_and_no_time_for_it(
    bench: Bench, terminal: Terminal, capsys: pytest.CaptureFixture[str], mode: str, row: int, empty: bool
) -> None:
    """No rows at all, or rows that take no time; a controller that tells nonsense of itself."""
    if empty:
        none = bench.stream.buffered.pick(np.arange(0))
        bench.stream = replace(bench.stream, buffered=none, intent=None)
    rows = len(bench.stream.buffered)
    bench.forecast = Forecast(
        duration_ms=0.0, row_ms=np.zeros(rows + 1), timed=np.zeros(rows, dtype=np.intp), box_mm=None, channels=()
    )
    bench.control.status = RunStatus(
        phase=Phase.RUNNING, row=row, x_pulse=math.nan, y_pulse=math.inf, queued=9, slots=0
    )
    with bench.watch(mode) as watcher:
        watcher.tick()
    done = empty or row >= rows
    if mode == "json":
        fields = json.loads(capsys.readouterr().out)
        assert (fields["x_mm"], fields["channels"], fields["total_ms"]) == (None, [], 0)
        assert fields["line"] == (None if empty else int(bench.stream.buffered.line[min(max(row, 0), rows - 1)]))
    elif mode == "lines":
        assert f"  {100 if done else 0} %  0:00 of 0:00  " in terminal.getvalue()
    else:
        assert shown(terminal.getvalue())["running"].endswith(" 100 %" if done else " 0 %")


def test_names_do_not_steer_the_terminal(bench: Bench, terminal: Terminal) -> None:
    bench.stream, bench.path = replace(bench.stream, name=f"folder/{NASTY}"), f"[/red]/{NASTY}"
    shows = "[red]x[blink]�[2J��.job"
    with bench.watch("lines") as watcher:
        watcher.tick()
    assert terminal.getvalue().count("\n") == 1
    assert f"line [/red]/{shows}:4 " in terminal.getvalue()
    assert "\x1b" not in terminal.getvalue()
    terminal.seek(0), terminal.truncate(0)
    with bench.watch("auto") as watcher:
        watcher.tick()
    rows = shown(terminal.getvalue())
    assert rows["job"] == shows
    assert rows["line"] == f"[/red]/{shows}:4"


@pytest.mark.parametrize("mode", ["auto", "lines"])
@pytest.mark.parametrize("error", [OSError(errno.EIO, "gone"), BrokenPipeError(errno.EPIPE, "gone")])
def test_a_terminal_that_is_gone_comes_out_of_tick(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, mode: str, error: OSError
) -> None:
    gone = plug_in(bench, monkeypatch, Gone())
    monkeypatch.setattr(Gone, "error", error)
    keep = os.dup(1)  # What rich makes of a broken pipe turns stdout off, too.
    try:
        with bench.watch(mode) as watcher:
            with pytest.raises(OSError):
                watcher.tick()
            bench.be(Phase.STOPPING)
    finally:
        os.dup2(keep, 1)
        os.close(keep)
    assert gone.getvalue() == ""


def test_a_terminal_that_goes_during_the_run(bench: Bench, terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    with bench.watch("auto") as watcher:
        watcher.tick()
        monkeypatch.setattr(sys, "stderr", Gone())
        bench.be(Phase.RUNNING)
        with pytest.raises(OSError, match="gone"):
            bench.ticks(watcher, 1)


def test_a_terminal_that_goes_at_the_end(bench: Bench, terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    with bench.watch("auto") as watcher:
        watcher.tick()
        monkeypatch.setattr(sys, "stderr", Gone())
    assert terminal.getvalue()


@pytest.mark.parametrize(("mode", "name"), [("json", "stdout"), ("lines", "stderr")])
def test_lines_are_written_at_once(bench: Bench, monkeypatch: pytest.MonkeyPatch, mode: str, name: str) -> None:
    written = io.BytesIO()
    with io.TextIOWrapper(written) as pipe:
        monkeypatch.setattr(sys, name, pipe)
        with bench.watch(mode) as watcher:
            watcher.tick()
            assert written.getvalue().endswith(b"\n")


def test_a_pipe_that_is_closed_comes_out_of_tick(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", Gone())
    with bench.watch("json") as watcher, pytest.raises(OSError, match="gone"):
        watcher.tick()


# The panel.


def test_the_panel_shows_it_all(bench: Bench, terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")  # The rest of a bar is blank then.
    lit = int(np.flatnonzero(bench.stream.buffered.kind == 0)[1])
    with bench.watch("auto") as watcher:
        watcher.tick()
        bench.be(Phase.RUNNING, lit)
        bench.ticks(watcher, 65.5)
        assert "\x1b[?25h" not in terminal.getvalue()
    rows = shown(terminal.getvalue())
    assert terminal.getvalue().endswith("\x1b[?25h")
    bar, fifo = rows.pop("running"), rows.pop("FIFO")
    assert bar.endswith(" 22 %")
    assert bar.count("━") == pytest.approx(0.225 * 62, abs=1)
    assert fifo.endswith(" 1024/4096")
    assert fifo.count("━") == pytest.approx(0.25 * 57, abs=1)
    assert rows == {
        "job": "test.job",
        "segments": "1 of 4",
        "time": "1:05 elapsed, 0:00 left",
        "line": "test.job:7",
        "position": "X 12.340 Y -3.000 mm",
        "laser": "0 on as planned, 40 %",
        "": "Ctrl+C stop (twice: at once)",
    }


def test_the_panel_is_drawn_at_most_eight_times_a_second(bench: Bench, terminal: Terminal) -> None:
    with bench.watch("auto") as watcher:
        for i in range(100):
            bench.be((Phase.FILLING, Phase.RUNNING, Phase.PAUSED)[i % 3], i % 5)
            bench.ticks(watcher, 0.1)
        drawn = terminal.getvalue().count("╭")
    assert 60 <= drawn <= 81


@pytest.mark.parametrize(("phase", "said"), [(Phase.RUNNING, "off as planned"), (Phase.PAUSED, "-")])
def test_a_dark_laser(bench: Bench, terminal: Terminal, phase: Phase, said: str) -> None:
    bench.be(phase)
    with bench.watch("auto") as watcher:
        watcher.tick()
    assert shown(terminal.getvalue())["laser"] == f"0 {said}"


def test_a_dumb_terminal_gets_lines(bench: Bench, terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "dumb")
    with bench.watch("auto") as watcher:
        watcher.tick()
    assert terminal.getvalue().startswith("opening  0 %  ")


def test_an_ascii_terminal(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    class Ascii(Terminal):
        encoding = "ascii"

    terminal = plug_in(bench, monkeypatch, Ascii())
    monkeypatch.setenv("COLUMNS", "23")
    with bench.watch("auto") as watcher:
        watcher.tick()
    assert terminal.getvalue().isascii()


# Keys.


class Typed:
    """Keys that are typed by a test."""

    listening = True
    waiting = ""

    def __enter__(self) -> Typed:
        return self

    def __exit__(self, *_: object) -> None: ...

    def pressed(self) -> str:
        typed, self.waiting = self.waiting, ""
        return typed


@pytest.mark.parametrize("mode", ["auto", "lines"])
@pytest.mark.parametrize(
    ("typed", "pause", "stop", "who"),
    [
        ("x\n", False, 0, ""),
        ("p", True, 0, ""),
        (" ", True, 0, ""),
        ("P P", True, 0, ""),
        ("q", False, 1, "key q"),
        ("S", False, 1, "key s"),
        ("\x1b", False, 1, "key Escape"),
        ("sq", False, 2, "key s"),
        ("pq", True, 1, "key q"),
    ],
)
def test_keys_steer(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, terminal: Terminal, mode: str, typed: str, pause: bool, stop: int,
    who: str,
) -> None:  # fmt: skip
    keys, control = Typed(), bench.control
    monkeypatch.setattr("gusjob.cli.run_display.Keys", lambda: keys)
    with bench.watch(mode) as watcher:
        bench.be(Phase.PAUSED)
        watcher.tick()
        keys.waiting = typed
        bench.ticks(watcher, 0.02)  # Keys are heeded in every tick.
        assert (bool(control.pause), control.stop, control.stopped_by) == (pause, stop, who)
    if mode == "auto":
        assert shown(terminal.getvalue())[""] == "p continue q stop (twice: at once)".replace(" q", "  q")


def test_no_keys_without_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    for stdin in (sys.stdin, None, io.StringIO("qqq")):
        monkeypatch.setattr(sys, "stdin", stdin)
        with Keys() as keys:
            assert (keys.listening, keys.pressed()) == (False, "")


@pytest.fixture(name="pty")
def _pty() -> Iterator[tuple[int, int]]:
    """(master, slave) of a terminal."""
    import pty

    master, slave = pty.openpty()
    yield master, slave
    for fd in (master, slave):
        with suppress(OSError):  # A test may have hung up.
            os.close(fd)


def attributes(fd: int) -> list[Any]:
    import termios

    return termios.tcgetattr(fd)


def quiet(fd: int) -> bool:
    """Whether keys come at once and are not echoed, Ctrl+C is a signal, and Ctrl+S does not hold the terminal."""
    import termios

    reading, flags = attributes(fd)[0], attributes(fd)[3]
    held = reading & termios.IXON or flags & (termios.ICANON | termios.ECHO)
    return bool(not held and flags & termios.ISIG)


CHILD = """
import os, sys
sys.path[:0] = [{root!r}, {tests!r}]
terminal = os.open({terminal!r}, os.O_RDWR)  # The first one that a new session opens is its own.
os.dup2(terminal, 0), os.dup2(terminal, 2)
"""


@contextmanager
def in_session(slave: int, code: str, **env: str) -> Iterator[subprocess.Popen[str]]:
    """Python code in a session of its own, at a terminal; it does not outlive a test that fails."""
    head = CHILD.format(root=str(ROOT), tests=str(ROOT / "tests"), terminal=os.ttyname(slave))
    removed = ("NO_COLOR", "FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE", "COLUMNS", "LINES")
    kept = {name: value for name, value in os.environ.items() if name not in removed}
    with subprocess.Popen(
        [sys.executable, "-c", head + code],
        start_new_session=True,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=kept | {"TERM": "xterm", "PYTHONIOENCODING": "utf-8"} | env,
    ) as child:
        try:
            yield child
        finally:
            child.kill()


def read_until(master: int, raw: bytearray, done: Callable[[], bool], seconds: float = 15.0) -> None:
    """Read what comes to a terminal until something is so."""
    import select

    until = time.monotonic() + seconds
    while not done():
        assert time.monotonic() < until, bytes(raw)
        if select.select([master], [], [], 0.02)[0]:
            raw += os.read(master, 65536)


PANEL = """
import time
from gusjob.controllers.control import Phase
from support.panel import bench_of_job
bench = bench_of_job("a folder of a long name/" * 4)
with bench.watch("auto") as watcher:
    while bench.control.stop < 2:
        time.sleep(0.01)
        bench.be(Phase.PAUSED if bench.control.pause else Phase.RUNNING, 4)
        bench.ticks(watcher, 0.1)
    print(bench.control.stopped_by)
    if {fail}:
        raise KeyboardInterrupt
"""


@ON_POSIX
@pytest.mark.parametrize(("columns", "fail"), [(80, False), (40, True), (20, False), (120, False)])
def test_panel_and_keys_on_a_terminal(pty: tuple[int, int], columns: int, fail: bool) -> None:
    import fcntl
    import struct
    import termios

    master, slave = pty
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 50, columns, 0, 0))
    before, raw = attributes(slave), bytearray()
    with in_session(slave, PANEL.format(fail=fail)) as child:
        read_until(master, raw, lambda: raw.count(b"running") > 1)
        assert quiet(slave)
        os.write(master, b"p")
        read_until(master, raw, lambda: b"paused" in raw)
        os.write(master, b"\x1b[A\x1bOP\x1b[15~p")  # Arrow up, F1, F5 are no Escape.
        again = len(raw)
        read_until(master, raw, lambda: b"running" in raw[again:])
        os.write(master, b"\x1b")
        time.sleep(0.1)
        os.write(master, b"q")
        read_until(master, raw, lambda: child.poll() is not None)
        assert child.stdout is not None
        assert child.stdout.read() == "key Escape\n"
        assert (child.returncode != 0) == fail
    assert attributes(slave) == before
    read_until(master, raw, lambda: raw.count(b"\x1b[?25h") == 1)
    drawn = raw.decode().partition("\x1b[?25h")[0]
    lines = screen(drawn, columns)
    assert max(map(len, lines)) == min(columns, 80)
    text = re.sub(r"[│╭╮╰╯─\s]", "", "".join(lines))  # As if nothing were folded.
    whole = ("test.job", "running", "segments", "X 12.340", "laser 0", "FIFO", "1024", "p pause", "at once)")
    for words in (*whole, "a folder of a long name/" * 4 + ":"):
        assert words.replace(" ", "") in text


@ON_POSIX
def test_ctrl_c_is_a_signal(pty: tuple[int, int]) -> None:
    master, slave = pty
    code = (
        "import signal, time\nfrom gusjob.cli.keys import Keys\n"
        "heard = []\nsignal.signal(signal.SIGINT, lambda *_: heard.append(1))\n"
        "with Keys() as keys:\n    keys.pressed(); os.write(2, b'ready')\n"
        "    while not heard:\n        time.sleep(0.01); assert keys.pressed() == ''\n"
    )
    raw = bytearray()
    with in_session(slave, code) as child:
        read_until(master, raw, lambda: b"ready" in raw)
        os.write(master, b"\x03")
        assert child.wait(30) == 0


@ON_POSIX
def test_a_process_in_the_background_leaves_the_terminal_alone(pty: tuple[int, int]) -> None:
    """One that touches it is stopped by the system."""
    _, slave = pty
    before = attributes(slave)
    code = (
        "import subprocess\nwork = '''from gusjob.cli.keys import Keys\n"
        "with Keys() as keys:\n    assert keys.listening\n    assert keys.pressed() == keys.pressed() == str()'''\n"
        "subprocess.run([sys.executable, '-c', work], process_group=0, timeout=20, check=True)\n"
    )
    with in_session(slave, code, PYTHONPATH=str(ROOT)) as child:
        assert child.wait(40) == 0
    assert attributes(slave) == before


@ON_POSIX
def test_a_terminal_of_another_session_is_left_alone(pty: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    master, slave = pty
    before = attributes(slave)
    with os.fdopen(os.dup(slave)) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        with Keys() as keys:
            os.write(master, b"q\n")
            assert keys.pressed() == ""
            assert attributes(slave) == before


@ON_POSIX
def test_a_terminal_that_hangs_up(pty: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    """Its errors are OSErrors, and leaving is quiet."""
    master, slave = pty
    monkeypatch.setattr("gusjob.cli.keys._in_foreground", lambda _fd: True)
    with os.fdopen(os.dup(slave)) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        with Keys() as keys:
            assert keys.pressed() == ""
            assert quiet(slave)
            os.close(master)
            with pytest.raises(OSError):
                keys.pressed()


def keys_of_windows(monkeypatch: pytest.MonkeyPatch, console: ModuleType) -> ModuleType:
    """The module as Windows sees it."""
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setitem(sys.modules, "msvcrt", console)
    spec = importlib.util.spec_from_file_location("keys_of_windows", ROOT / "gusjob" / "cli" / "keys.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("terminal", [True, False])
def test_keys_of_a_windows_console(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, terminal: bool) -> None:
    """Ctrl+Left comes as 0xe0 and an s, F1 as 0 and a semicolon: neither is a key of ours; à is 0xe0 alone."""
    typed = [b"p", b"\xe0", b"s", b"\x00", b";", b"Q", b"\x1b", b"\xe0"]
    console: Any = ModuleType("msvcrt")
    console.kbhit = lambda: bool(typed)
    console.getch = lambda: typed.pop(0)
    module: Any = keys_of_windows(monkeypatch, console)
    monkeypatch.setattr(os, "isatty", lambda _fd: terminal)
    with (tmp_path / "stdin").open("w+") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        with module.Keys() as keys:
            assert keys.pressed() == ("pQ\x1b" if terminal else "")
            assert keys.pressed() == ""
