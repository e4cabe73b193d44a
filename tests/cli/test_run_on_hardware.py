"""gusjob run --backend gts as people run it: a process of its own, the virtual controller that outlives it."""

from __future__ import annotations

import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from click.testing import CliRunner
from support.cli import GOOD
from support.controller import GTS_MULTI, GUS, Floats, Row, needs_controller
from support.controller import build as build_controller
from support.hardware import EVERYTHING
from support.killed_commands import JOB, executed, killed, resume, whole_run
from support.tools import MARK

from gusjob.cli.run_command import command

pytestmark = needs_controller

SLOW = MARK + "VEL 10\nLASER POWER 40\nLASER ON\nREPEAT 200 AS i\nLINE X (i % 2 * 3) Y (i / 100)\nEND\nLASER OFF\n"


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_controller(tmp_path_factory.mktemp("controller"), GUS)


@dataclass(slots=True)
class Desk:
    """A folder with a job, and a controller whose state outlives processes."""

    folder: Path
    library: Path
    speed: float = 50.0

    @property
    def state(self) -> Path:
        return self.folder / "machine.state"

    @property
    def environment(self) -> dict[str, str]:
        # No terminal of the tester: what is told goes into pipes.
        return os.environ | {"VC_STATE": str(self.state), "VC_OPTIONS": f"speed={self.speed},log=0", "COLUMNS": "80"}

    def job(self, text: str) -> Path:
        path = self.folder / "part.job"
        path.write_text(text, encoding="utf-8")
        return path

    def started(self, *arguments: str | Path) -> subprocess.Popen[str]:
        options = ["--backend", "gts", "--library", str(self.library), "--abi", "gus"]
        return subprocess.Popen(
            [sys.executable, "-m", "gusjob", "run", *map(str, arguments), *options], env=self.environment, text=True,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
        )  # fmt: skip

    def run(self, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
        process = self.started(*arguments)
        out, err = process.communicate(timeout=60)
        return subprocess.CompletedProcess(process.args, process.returncode, out, err)

    def rows(self) -> Floats:
        return executed(self.library, self.state)

    def lit(self) -> bool:
        """Whether light comes out, or the switch says so."""
        code = (
            "import sys, pathlib; sys.path.insert(0, sys.argv[1]); from support.controller import VirtualController;"
            "s = VirtualController(pathlib.Path(sys.argv[2])).state();"
            "print(any(s.emitting) or any(s.switched_on), s.moving)"
        )
        here = str(Path(__file__).parents[1])
        done = subprocess.run(
            [sys.executable, "-c", code, here, str(self.library)], env=self.environment, capture_output=True, text=True,
            check=True,
        )  # fmt: skip
        assert done.stdout.split()[1] == "0", "it moves"
        return done.stdout.split()[0] == "True"

    def journals(self) -> list[Path]:
        return sorted(self.folder.glob("*.journal"))


@pytest.fixture
def desk(tmp_path: Path, library: Path) -> Iterator[Desk]:
    yield Desk(tmp_path, library)


def test_a_whole_run(desk: Desk) -> None:
    done = desk.run(desk.job(EVERYTHING), "--yes", "--progress", "none")
    assert done.returncode == 0, done.stderr
    assert "--abi gus (GUS, as in the laser manual)" in done.stderr
    assert "X -5.000 to 15.000 mm" in done.stderr
    assert "laser 0  up to" in done.stderr
    assert "laser 1  up to 20 kHz" in done.stderr
    assert "done in" in done.stderr
    assert not desk.lit()
    (journal,) = desk.journals()
    head, *lines = (json.loads(line) for line in journal.read_text(encoding="utf-8").splitlines())
    assert head["schema"] == "gusjob-journal/2"
    assert lines[-1]["end"] == "done"
    times = [line["t"] for line in lines]
    assert times == sorted(times)
    sent = [line for line in lines if "row" in line and "call" in line]
    assert [line["row"] for line in sent] == list(range(head["rows"]))
    assert all({"t", "code", "line", "call", "args"} <= line.keys() for line in lines if "call" in line)
    assert len(desk.rows()) == 7


def test_a_quiet_run(desk: Desk) -> None:
    """It prints nothing if all is well, and all that is wrong."""
    job = desk.job(GOOD)
    done = desk.run(job, "--yes", "-q")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert desk.run(job, "--yes", "-q", "--progress", "json").stdout.count('"phase":"done"') == 1
    unconfirmed = desk.run(job, "-q")
    assert (unconfirmed.returncode, "must be confirmed" in unconfirmed.stderr) == (2, True)
    desk.speed = 1.0
    process = desk.started(desk.job(SLOW), "--yes", "-q", "--progress", "json")
    assert process.stdout is not None
    assert any('"phase":"running"' in line for line in process.stdout)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert (process.returncode, "the laser is off and the motion stopped" in error) == (1, True)


def test_the_report_of_a_journal_is_that_of_the_job(desk: Desk) -> None:
    job = desk.job(EVERYTHING)
    assert desk.run(job, "--yes", "--progress", "none").returncode == 0

    def report(path: Path) -> dict[str, object]:
        argv = [sys.executable, "-m", "gusjob", "report", str(path), "--format", "json", "--no-marks"]
        done = subprocess.run(argv, capture_output=True, text=True, check=True)
        found: dict[str, object] = json.loads(done.stdout)
        return found

    of_job, of_journal = report(job), report(desk.journals()[0])
    assert of_journal["totals"] == of_job["totals"]
    assert of_journal["segments"] == of_job["segments"]


def test_without_an_answer_nothing_is_done(desk: Desk) -> None:
    done = desk.run(desk.job(SLOW))
    assert done.returncode == 2
    assert "--yes" in done.stderr
    assert not desk.state.exists() or len(desk.rows()) == 0
    assert desk.journals() == []


@pytest.mark.parametrize(("answer", "code"), [("n\n", 1), ("\n", 1), ("y\n", 0)])
def test_the_answer_counts(desk: Desk, monkeypatch: pytest.MonkeyPatch, answer: str, code: int) -> None:
    job = desk.job(MARK + "LASER POWER 40\nLASER ON\nLINE X 1\nLASER OFF\n")
    monkeypatch.setattr("gusjob.cli.hardware._can_ask", lambda: True)
    options = ["--backend", "gts", "--library", str(desk.library), "--abi", "gus", "--progress", "none"]
    done = CliRunner().invoke(command, [str(job), *options], input=answer)
    assert done.exit_code == code, done.output
    assert ("not started" in done.output) == bool(code)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (MARK + "LASER POWER 40\nLASER ON\nLINE X 1\n", "GJ401"),
        (MARK + "LASER POWER 400\nLINE X 1\n", "GJ2"),
        (MARK + "LINE X 1000\n", "GJ503"),
    ],
)
def test_a_job_with_errors_is_refused(desk: Desk, text: str, said: str) -> None:
    done = desk.run(desk.job(text), "--yes")
    assert done.returncode == 1
    assert said in done.stderr
    assert "not started" in done.stderr
    assert desk.journals() == []


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--frame", "--no-laser"], "leave out --no-laser"),
        (["--from-line", "99999"], "no motion or laser call"),
        (["--from-line", "0"], "no motion or laser call"),
        (["--resume", "nothing.journal"], "can't read the journal"),
        (["--journal", "no/such/folder/x"], "can't write the journal"),
    ],
)
def test_wrong_usage(desk: Desk, arguments: list[str], said: str) -> None:
    done = desk.run(desk.job(SLOW), "--yes", *arguments)
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("option", ["--library", "--abi", "--yes", "--frame", "--no-laser", "--journal", "--from-line"])
def test_options_of_hardware_are_refused_by_the_simulator(desk: Desk, option: str) -> None:
    value = {"--abi": ["gus"], "--from-line": ["3"], "--library": ["x"], "--journal": ["x"]}.get(option, [])
    done = CliRunner().invoke(command, [str(desk.job(SLOW)), option, *value])
    assert done.exit_code == 2
    assert f"{option}: only with --backend gts" in done.output


def test_library_and_abi_may_be_in_the_profile(desk: Desk) -> None:
    profile = desk.folder / "gusjob.toml"
    profile.write_text(f"[controller]\nlibrary = '{desk.library}'\nabi = \"gus\"\n", encoding="utf-8")
    job = desk.job(MARK + "LINE X 1\n")
    argv = [sys.executable, "-m", "gusjob", "run", str(job)]
    # The backend itself may not: a profile found beside a job must not turn a look into light.
    assert "OK, no warnings" in subprocess.run(argv, capture_output=True, text=True, check=True).stdout
    assert not desk.state.exists()
    done = subprocess.run(
        [*argv, "--backend", "gts", "--yes"], env=desk.environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert len(desk.rows()) == 1


def test_without_a_library_the_message_names_the_options(desk: Desk) -> None:
    argv = [sys.executable, "-m", "gusjob", "run", str(desk.job(SLOW)), "--backend", "gts", "--yes"]
    done = subprocess.run(argv, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "--library PATH" in done.stderr
    assert "gusjob devices" in done.stderr


def test_a_wrong_abi_on_the_command_line(tmp_path: Path) -> None:
    multi = Desk(tmp_path, build_controller(tmp_path, GTS_MULTI))
    done = multi.run(multi.job(SLOW), "--yes", "--progress", "none")
    assert done.returncode == 2
    assert "part.job:1:1: error[GJ903]" in done.stderr
    assert "--abi gts" in done.stderr


# Stopped from outside.


def in_motion(desk: Desk, process: subprocess.Popen[str], row: int = 20) -> None:
    """Wait until a run has come to a row."""
    until = time.monotonic() + 30
    while time.monotonic() < until and process.poll() is None:
        found = desk.journals()
        polled = re.findall(rb'"call":"GT_CrdStatus","args":\[1,1,(\d+)', found[-1].read_bytes()) if found else []
        if polled and int(polled[-1]) >= row:
            return
        time.sleep(0.01)
    raise AssertionError(f"it never came there: {process.communicate()}")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("signals", "said"),
    [
        (["SIGINT"], "Ctrl+C"),
        (["SIGINT", "SIGINT"], "Ctrl+C"),
        (["SIGTERM"], "SIGTERM"),
        (["SIGHUP"], "SIGHUP"),
        (["SIGQUIT"], "SIGQUIT"),
    ],
)
def test_signals_switch_the_laser_off_and_the_run_is_resumed(desk: Desk, signals: list[str], said: str) -> None:
    job = desk.job(SLOW)
    process = desk.started(job, "--yes", "--progress", "none")
    in_motion(desk, process)
    for name in signals:  # By name: not every system has them all.
        process.send_signal(getattr(signal, name))
    _, err = process.communicate(timeout=30)
    assert process.returncode == 1
    assert "GJ911" in err
    assert f"stopped here by {said}" in err
    assert re.search(r"part\.job:8:", err)
    assert "the laser is off and the motion stopped" in err
    assert not desk.lit()
    first = desk.rows()
    assert len(first) < 200
    # The journal says with what to go on, without naming the job.
    done = desk.run("--resume", desk.journals()[0], "--yes", "--progress", "none")
    assert done.returncode == 0, done.stderr
    assert "the head moves there with the laser off" in done.stderr
    rows = desk.rows()[len(first) :]
    assert rows[-1, [Row.X1, Row.Y1]].tolist() == [3000, 1990]
    left = 200 - len(first)
    assert left <= len(rows) <= left + 5  # A smooth stop went on dark for a while; that is run again
    assert not desk.lit()
    twice = desk.run("--resume", desk.journals()[0], "--yes", "--progress", "none")
    assert twice.returncode == 2
    assert f"resumed already: resume {desk.journals()[1]}" in twice.stderr
    again = desk.run("--resume", desk.journals()[1], "--yes", "--progress", "none")
    assert again.returncode == 0
    assert "nothing to resume" in again.stderr


def test_a_resumed_run_takes_its_values_from_the_journal(desk: Desk) -> None:
    job = desk.job("LET dose = 40%\n" + SLOW.replace("LASER POWER 40", "LASER POWER (dose)"))
    process = desk.started(job, "-D", "dose=25%", "--yes", "--progress", "none")
    in_motion(desk, process)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=30)
    assert "-D       dose=25%" in err
    other = desk.run("--resume", desk.journals()[0], "-D", "dose=40%", "--yes", "--progress", "none")
    assert other.returncode == 2
    assert "this is the journal of a run with -D dose=25%: leave out -D" in other.stderr
    done = desk.run("--resume", desk.journals()[0], "--yes", "--progress", "none")
    assert done.returncode == 0, done.stderr
    head, *lines = (json.loads(line) for line in desk.journals()[-1].read_text(encoding="utf-8").splitlines())
    assert head["overrides"] == {"dose": "25%"}
    assert {line["args"][1] for line in lines if line.get("call") == "GT_BufLaserPrfCmd"} == {25}


def phase_reached(process: subprocess.Popen[str], phase: str) -> bool:
    """Wait until a run reports a phase; False if it ends before."""
    assert process.stdout is not None
    return any(json.loads(text)["phase"] == phase for text in process.stdout)


def test_ctrl_z_pauses_and_sigcont_continues(desk: Desk) -> None:
    process = desk.started(desk.job(SLOW), "--yes", "--progress", "json")
    in_motion(desk, process)
    process.send_signal(signal.SIGTSTP)
    assert phase_reached(process, "paused")
    assert not desk.lit()
    process.send_signal(signal.SIGCONT)
    assert phase_reached(process, "running")
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=30)
    assert "GJ911" in err


def test_a_reader_that_goes_away_ends_the_run(desk: Desk) -> None:
    process = desk.started(desk.job(SLOW), "--yes", "--progress", "json")
    in_motion(desk, process)
    assert process.stdout is not None
    process.stdout.close()
    process.stdout = None
    _, err = process.communicate(timeout=30)
    assert process.returncode == 1
    assert "closed terminal or pipe" in err
    assert not desk.lit()


@pytest.mark.slow
def test_killed_runs_resume(desk: Desk) -> None:
    """A few, as commands; support.kill does it two hundred times without."""
    whole, took_s = whole_run(desk.folder, desk.library)
    assert len(whole) > 180
    chance = random.Random(7)
    for number in range(3):
        state, journal, _ = killed(
            desk.folder, desk.library, chance.uniform(0, took_s), number, chance.choice([64, 4096])
        )
        assert resume(desk.folder, desk.library, state, journal, whole, chance.choice([0.0, 0.5])) == ""


def test_a_controller_that_was_restarted_is_an_error(desk: Desk) -> None:
    state, journal, _ = killed(desk.folder, desk.library, 0.4, 0)
    state.unlink()
    done = desk.run("--resume", journal, "--yes", "--progress", "none")
    assert done.returncode == 1
    assert "GJ914" in done.stderr
    assert "--from-line" in done.stderr
    assert len(desk.rows()) == 0


def test_a_journal_of_other_calls_is_refused(desk: Desk) -> None:
    _, journal, _ = killed(desk.folder, desk.library, 0.2, 0)
    (desk.folder / "kill.job").write_text(JOB.replace("POWER 40", "POWER 41"), encoding="utf-8")
    done = desk.run("--resume", journal, "--yes", "--progress", "none")
    assert done.returncode == 2
    assert "the job or its profile has changed" in done.stderr


# Where to begin, and without light.


def test_from_line_rebuilds_the_state(desk: Desk) -> None:
    lines = EVERYTHING.splitlines()
    line = next(i for i, text in enumerate(lines, 1) if text.startswith("LINE X 5 Y 3"))
    done = desk.run(desk.job(EVERYTHING), "--yes", "--progress", "none", "--from-line", str(line))
    assert done.returncode == 0, done.stderr
    rows = desk.rows()
    way, first = rows[0], rows[1]
    assert (way[Row.X1], way[Row.Y1], way[Row.EMISSION0_MS]) == (5000, 0, 0)
    assert (first[Row.X1], first[Row.Y1]) == (5000, 3000)
    # 40 %, from the beginning but for the on delay of 50 us and with the off delay of 60.
    assert first[Row.EMISSION0_MS] == pytest.approx(first[Row.DURATION_MS] + 0.01)
    assert first[Row.POWER0_MS] == pytest.approx(40 * first[Row.EMISSION0_MS])
    assert len(rows) == 6
    sent = [json.loads(text) for text in desk.journals()[0].read_text(encoding="utf-8").splitlines()]
    calls = [line["call"] for line in sent if "call" in line]
    assert calls.index("GT_LaserPowerMode") < calls.index("GT_SetCrdPrm") < calls.index("GT_LnXY")


def test_the_frame_and_no_laser_are_dark(desk: Desk) -> None:
    job = desk.job(EVERYTHING)
    framed = desk.run(job, "--yes", "--progress", "none", "--frame")
    assert framed.returncode == 0, framed.stderr
    assert "once around the marks" in framed.stderr
    assert desk.rows()[:, [Row.EMISSION0_MS, Row.EMISSION1_MS]].sum() == 0
    count = len(desk.rows())
    assert count == 5
    assert desk.run(job, "--yes", "--progress", "none", "--no-laser").returncode == 0
    rows = desk.rows()[count:]
    assert len(rows) == 7
    assert rows[:, [Row.EMISSION0_MS, Row.EMISSION1_MS]].sum() == 0
    for journal in desk.journals():
        told = re.findall(r'"call":"(GT_\w*(?:Laser|FPK|HSIO|Pulse|Level)\w*)","args":\[([^]]*)', journal.read_text())
        assert {name for name, _ in told} == {"GT_SetHSIOOpt"}
        assert all(args.startswith("0") for _, args in told)


def test_progress_for_a_parent_program(desk: Desk) -> None:
    done = desk.run(desk.job(SLOW.replace("200", "80")), "--yes", "--progress", "json")
    assert done.returncode == 0, done.stderr
    told = [json.loads(line) for line in done.stdout.splitlines()]
    assert told[-1]["phase"] == "done"
    assert [t["row"] for t in told] == sorted(t["row"] for t in told)
    assert {t["schema"] for t in told} == {"gusjob-progress/1"}
    assert told[-1]["segments"] == 80


def test_a_controller_that_marks_when_it_is_opened_is_stopped(desk: Desk) -> None:
    process = desk.started(desk.job(SLOW), "--yes", "--progress", "none")
    in_motion(desk, process)
    process.kill()
    process.communicate()
    # The FIFO goes on, lit. The next run, of anything, turns that off first.
    other = desk.folder / "other.job"
    other.write_text(MARK + "LINE X 1\n", encoding="utf-8")
    before = len(desk.rows())
    assert desk.run(other, "--yes", "--progress", "none").returncode == 0
    rows = desk.rows()
    assert len(rows) - before < 150
    assert rows[-1, [Row.X1, Row.Y1]].tolist() == [1000, 0]
    assert not desk.lit()
