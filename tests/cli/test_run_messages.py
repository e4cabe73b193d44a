"""gusjob run --backend gts in this process: what it shows, its exit codes."""

from __future__ import annotations

from pathlib import Path

from click.testing import CliRunner
from support.controller import Fault, needs_controller
from support.hardware import EVERYTHING, Bench
from support.tools import MARK

from gusjob.cli.run_command import command

pytestmark = needs_controller


def invoke(gus: Bench, folder: Path, text: str, *options: str) -> tuple[int, str]:
    job = folder / "part.job"
    job.write_text(text, encoding="utf-8")
    argv = [str(job), "--backend", "gts", "--library", str(gus.path), "--abi", "gus", "--yes", "--progress", "none"]
    done = CliRunner().invoke(command, [*argv, *options])
    assert done.exception is None or isinstance(done.exception, SystemExit)
    return done.exit_code, done.output


def test_a_journal_is_never_written_over(gus: Bench, tmp_path: Path) -> None:
    there = tmp_path / "there.journal"
    there.write_text("old", encoding="utf-8")
    code, localized = invoke(gus, tmp_path, MARK + "LINE X 1\n", "--journal", str(there))
    assert code == 2
    assert "exists already" in localized
    assert there.read_text(encoding="utf-8") == "old"
    assert gus.controller.calls() == []


def test_the_plan_shows_the_remaining_time(gus: Bench, tmp_path: Path) -> None:
    text = MARK + "LINE X 10\nDWELL 3000\nLINE X 0\n"
    code, localized = invoke(gus, tmp_path, text)
    assert code == 0
    assert "time     3.22 s" in localized
    code, localized = invoke(gus, tmp_path, text, "--from-line", "6")
    assert code == 0
    assert "time     0.11 s" in localized


def test_a_laser_that_may_be_on_is_not_called_safe(gus: Bench, tmp_path: Path) -> None:
    gus.controller.fault(Fault.RETURN, "GT_SetHSIOOpt", 3, -1, 7)
    gus.controller.fault(Fault.RETURN, "GT_BufDelay", 1, -1, 7)
    code, localized = invoke(gus, tmp_path, EVERYTHING)
    assert code == 1
    assert "GJ912" in localized
    assert "CHECK THE MACHINE" in localized
    assert "the laser is off" not in localized
