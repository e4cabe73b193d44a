"""What a run reports at its end, and how it is resumed, in real time on a link with latency."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from support.controller import Fault, VirtualController, needs_controller
from support.hardware import Bench, fresh
from support.journals import bare_lines, with_checksums
from support.promises import Attempt, judged
from support.resuming import attempt, claims_off, quick_machine, recorded_of, request_of

from gusjob.cli.hardware import _closing_message
from gusjob.controllers.journal.reader import read_journal
from gusjob.diagnostics import rules
from gusjob.hardware.outcome import Ending, MachineState, RunOutcome
from gusjob.hardware.request import RunRequest
from gusjob.hardware.run import run_on

pytestmark = needs_controller

LATENCY_US = 1000
FOR_EVER = -1


@pytest.fixture(autouse=True)
def _real_time(gus: Bench) -> None:
    fresh(gus, speed=1, latency_us=LATENCY_US)


def request(gus: Bench, folder: Path, name: str, journal: Path | None = None) -> RunRequest:
    """A run of the job, or a resume of a journal."""
    recorded = recorded_of(journal) if journal else None
    assert not isinstance(recorded, str), recorded
    return request_of(folder, gus.path, quick_machine(), journal=folder / f"{name}.journal", resume=recorded)


def run(gus: Bench, folder: Path, name: str, journal: Path | None = None) -> tuple[Attempt, RunOutcome]:
    return attempt(request(gus, folder, name, journal), gus.controller)


def codes(outcome: RunOutcome) -> list[str]:
    return [found.rule.code for found in outcome.diagnostics]


# What is claimed.


@pytest.mark.parametrize("code", [-6, -7, 1])
def test_a_controller_that_can_not_be_opened_is_not_called_safe(gus: Bench, tmp_path: Path, code: int) -> None:
    """Another program has it, with the laser on."""
    gus.controller.option("leave_on", 1)
    gus.controller.fault(Fault.RETURN, "", 1, FOR_EVER, code)
    _, outcome = run(gus, tmp_path, "first")
    assert outcome.ending is Ending.FAILED
    assert outcome.state is MachineState.UNTOUCHED
    assert not outcome.is_safe
    # With 1 the library counts as one of another ABI, so that no off call is made.
    start = "NOTHING WAS SWITCHED" if code == 1 else "IT IS NOT CONFIRMED THAT THE LASER IS OFF"
    assert _closing_message(outcome).startswith(start)
    assert "check the machine" in _closing_message(outcome)
    assert gus.controller.state().emitting[0]


def test_the_off_call_of_every_abi_is_tried_and_its_result_shown(gus: Bench, tmp_path: Path) -> None:
    gus.controller.option("leave_on", 1)
    gus.controller.fault(Fault.RETURN, "GT_ClrSts", 1, FOR_EVER, -7)
    _, outcome = run(gus, tmp_path, "first")
    assert outcome.state is MachineState.UNTOUCHED
    assert "GT_SetHSIOOpt(0,0) returned 0" in _closing_message(outcome)
    assert "the laser is off" not in _closing_message(outcome)
    assert not any(gus.controller.state().emitting)


def test_a_link_that_fails_once_is_confirmed_and_shut_down(gus: Bench, tmp_path: Path) -> None:
    gus.controller.option("leave_on", 3)
    gus.controller.fault(Fault.RETURN, "GT_ClrSts", 1, 1, -7)
    made, outcome = run(gus, tmp_path, "first")
    assert codes(outcome) == ["GJ904"]
    assert outcome.state is MachineState.OFF
    assert not made.false_claim
    assert not any(gus.controller.state().emitting)


def test_an_open_that_hangs_is_not_called_safe(gus: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gusjob.controllers.gus.driver.link.SLOW_FACTOR", 1)
    gus.controller.option("leave_on", 1)
    gus.controller.fault(Fault.HANG, "GT_Open")
    gus.controller.fault(Fault.RETURN, "GT_ClrSts", 1, FOR_EVER, -6)
    gus.controller.fault(Fault.RETURN, "GT_SetHSIOOpt", 1, FOR_EVER, -6)
    _, outcome = run(gus, tmp_path, "first")
    gus.controller.release()
    assert codes(outcome) == ["GJ905"]
    assert outcome.state is MachineState.UNTOUCHED
    assert gus.controller.state().emitting[0]


@pytest.mark.parametrize("code", [1, 7, -7])
def test_a_motion_that_is_not_known_at_the_end_is_not_at_rest(gus: Bench, tmp_path: Path, code: int) -> None:
    made, _ = run(gus, tmp_path, "whole")
    assert made.ending is Ending.DONE
    whole = gus.controller.calls()
    last = max(number for number, (_, call) in enumerate(whole, 1) if call.startswith("GT_CrdStatus(1"))
    polls = sum(call.startswith("GT_CrdStatus") for _, call in whole[: last - 1])
    fresh(gus, speed=1, latency_us=LATENCY_US)
    # Polls come by time: from the calls after the last stage on.
    gus.controller.fault(Fault.RETURN, "GT_CrdStatus", polls + 40, FOR_EVER, code)
    _, outcome = run(gus, tmp_path, "first")
    if outcome.ending is not Ending.DONE:
        assert not claims_off(outcome)


def test_a_call_that_returns_late_has_its_effect_undone(gus: Bench, tmp_path: Path) -> None:
    """GT_CrdStart hangs, is given up, and starts the motion only then."""
    gus.controller.fault(Fault.HANG_AFTER, "GT_CrdStart", 2, 1, 0.4)
    made, outcome = run(gus, tmp_path, "first")
    assert codes(outcome) == ["GJ905"]
    assert claims_off(outcome)
    gus.controller.advance(0)
    assert not made.false_claim


# Resets.


@pytest.mark.parametrize("code", [1, 2, 3, 7, -7])
@pytest.mark.parametrize("call", ["GT_SetLevelDelay", "GT_DisFPK", "GT_SetLaserDisMode"])
def test_a_refused_reset_ends_the_run_dark(gus: Bench, tmp_path: Path, call: str, code: int) -> None:
    """Else what an earlier program set stays in force: 9 ms of emission after each mark."""
    gus.controller.options(leave_off_delay_us=9000)
    gus.controller.fault(Fault.RETURN, call, 1, 1, code)
    _, outcome = run(gus, tmp_path, "first")
    assert codes(outcome) == ["GJ904"]
    assert call in outcome.diagnostics[0].message
    assert len(gus.controller.lits()) == 0


def test_a_setting_that_is_not_supported_is_a_warning_unless_the_job_needs_it(gus: Bench, tmp_path: Path) -> None:
    gus.controller.fault(Fault.RETURN, "GT_SetPreVltg", 1, FOR_EVER, 8)
    made, outcome = run(gus, tmp_path, "first")
    assert outcome.ending is Ending.DONE
    assert {found.rule for found in outcome.diagnostics} == {rules.NOT_RESET}
    assert [found.fields["channel"] for found in outcome.diagnostics] == [0, 1]
    assert not made.false_claim
    fresh(gus, speed=1, latency_us=LATENCY_US)
    gus.controller.fault(Fault.RETURN, "GT_SetLevelDelay", 1, FOR_EVER, 8)
    _, outcome = run(gus, tmp_path, "second")
    assert codes(outcome) == ["GJ904"]
    assert len(gus.controller.lits()) == 0


# Chains of journals.


def interrupted(gus: Bench, folder: Path, call: str = "GT_LnXY", nth: int = 30) -> Path:
    """Run the job up to a call that is refused in the middle."""
    gus.controller.fault(Fault.RETURN, call, nth, 1, 7)
    made, _ = run(gus, folder, "first")
    gus.controller.clear_faults()
    assert made.journal is not None
    return made.journal


def finished(gus: Bench, folder: Path, journal: Path) -> Attempt:
    last, _ = run(gus, folder, "last", journal)
    assert last.is_done, last
    return last


PLANTS: dict[str, Callable[[VirtualController], None]] = {
    "axis refused": lambda controller: controller.fault(Fault.RETURN, "GT_AxisOn", 1, 1, 1),
    "open failed": lambda controller: controller.fault(Fault.RETURN, "GT_Open", 1, 1, -6),
    "position not read": lambda controller: controller.fault(Fault.RETURN, "GT_GetCrdPos", 1, FOR_EVER, -7),
    "coordinate system refused": lambda controller: controller.fault(Fault.RETURN, "GT_SetCrdPrm", 1, 1, 1),
    "laser on refused": lambda controller: controller.fault(Fault.RETURN, "GT_BufLaserOn", 1, 1, 7),
}


@pytest.mark.parametrize("plant", PLANTS)
def test_a_chain_of_journals_always_has_one_that_can_be_resumed(gus: Bench, tmp_path: Path, plant: str) -> None:
    made, _ = run(gus, tmp_path, "whole")
    assert made.is_done
    expected = gus.controller.lits()
    fresh(gus, speed=1, latency_us=LATENCY_US)
    journal = interrupted(gus, tmp_path)
    attempts = [Attempt(mark=0, journal=journal)]
    for number in range(3):
        PLANTS[plant](gus.controller)
        failed, _ = run(gus, tmp_path, f"failed{number}", journal)  # Always by the first one: it names the newest.
        gus.controller.clear_faults()
        assert failed.ending is Ending.FAILED, failed
        attempts.append(failed)
    newest = attempts[-1].journal
    found = read_journal(journal)
    assert isinstance(found, str)
    assert str(newest) in found
    attempts.append(finished(gus, tmp_path, journal))
    verdict = judged(expected, gus.controller.lits(), attempts)
    assert verdict.is_whole, verdict.found.left_out
    assert verdict.wrong == ()


def test_a_resume_that_was_declined_is_resumed_from_the_position_that_it_found(gus: Bench, tmp_path: Path) -> None:
    made, _ = run(gus, tmp_path, "whole")
    assert made.is_done
    expected = gus.controller.lits()
    fresh(gus, speed=1, latency_us=LATENCY_US)
    # The position can't be read when it is interrupted, so that the resume has to find it.
    gus.controller.fault(Fault.RETURN, "GT_BufLaserPrfCmd", 4, 1, 7)
    gus.controller.fault(Fault.RETURN, "GT_CrdSpace", 12, FOR_EVER, -7)
    first, _ = run(gus, tmp_path, "first")
    gus.controller.clear_faults()
    assert first.ending is Ending.FAILED
    assert first.journal is not None
    declined = run_on(request(gus, tmp_path, "declined", first.journal), confirm=lambda _plan: False)
    assert declined.ending is Ending.DECLINED
    if declined.is_journal_needed:
        assert f"continue with --resume {declined.journal}" in _closing_message(declined)
    attempts = [first, finished(gus, tmp_path, first.journal)]
    verdict = judged(expected, gus.controller.lits(), attempts)
    assert verdict.is_whole, verdict.found.left_out
    assert verdict.wrong == ()


def test_a_journal_that_can_not_be_written_to_is_not_continued(
    gus: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It could be continued twice."""
    asked = request(gus, tmp_path, "second", interrupted(gus, tmp_path))
    made = len(gus.controller.calls())

    def fail(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("gusjob.hardware.run.mark_resumed", fail)
    outcome = run_on(asked, confirm=True)
    assert outcome.ending is Ending.REFUSED
    assert outcome.refusal is not None
    assert "can't write to the journal that is continued" in outcome.refusal.localized
    assert len(gus.controller.calls()) == made


def as_if_killed(journal: Path) -> None:
    """Leave the journal of a run as if its process had been killed before it was switched off."""
    lines = bare_lines(journal.read_bytes())
    off = max(number for number, line in enumerate(lines) if b'"off":true' in line)
    journal.write_bytes(with_checksums(lines[:off]))


def test_after_another_run_the_position_of_a_killed_one_is_lost(gus: Bench, tmp_path: Path) -> None:
    """The controller answers for the run that used it last: where that ended says nothing of the killed one."""
    journal = interrupted(gus, tmp_path, "GT_GetCrdPos", 30)  # In motion.
    as_if_killed(journal)
    made, _ = run(gus, tmp_path, "other")
    assert made.is_done
    calls = len(gus.controller.calls())
    refused, _ = run(gus, tmp_path, "second", journal)
    assert refused.ending is Ending.REFUSED
    assert "another run has used the controller since" in refused.message
    assert str(tmp_path / "other.journal") in refused.message
    assert len(gus.controller.calls()) == calls
    # Nothing was marked in the journal: it can be tried again.
    assert not isinstance(read_journal(journal), str)


def test_a_killed_run_is_resumed_if_no_other_one_used_the_controller(gus: Bench, tmp_path: Path) -> None:
    journal = interrupted(gus, tmp_path, "GT_GetCrdPos", 30)  # In motion.
    as_if_killed(journal)
    assert run(gus, tmp_path, "second", journal)[0].is_done


@pytest.mark.skipif(sys.platform != "linux", reason="names are text elsewhere")
def test_names_that_are_not_text(gus: Bench, tmp_path: Path) -> None:
    folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/\xff"))
    folder.mkdir()
    journal = interrupted(gus, folder, "GT_GetCrdPos", 30)
    gus.controller.fault(Fault.RETURN, "GT_AxisOn", 1, 1, 1)
    failed, _ = run(gus, folder, "second\udcfe", journal)
    assert failed.journal is not None
    gus.controller.clear_faults()
    assert run(gus, folder, "last", failed.journal)[0].is_done


def test_a_chain_that_was_moved_is_read_from_its_own_folder(gus: Bench, tmp_path: Path) -> None:
    """Where it was there may be another chain of the same names."""
    old, new, moved = (tmp_path / name for name in ("old", "new", "moved"))
    for folder in (old, new):
        folder.mkdir()
        journal = interrupted(gus, folder, "GT_GetCrdPos", 30 if folder is old else 60)
        as_if_killed(journal)
        gus.controller.fault(Fault.RETURN, "GT_Open", 1, FOR_EVER, -6)
        assert run(gus, folder, "second", journal)[0].ending is Ending.FAILED
        gus.controller.clear_faults()
        if folder is old:
            old.rename(moved)
    new.rename(old)  # The second chain is now where the first one was.
    first, second = (read_journal(folder / "second.journal") for folder in (moved, old))
    assert not isinstance(first, str) and not isinstance(second, str)
    assert first.part is not None and second.part is not None
    assert first.part.sent == read_sent(moved / "first.journal")
    assert second.part.sent == read_sent(old / "first.journal")
    assert first.part.sent != second.part.sent


def read_sent(journal: Path) -> int:
    """Return the number of buffered calls that a journal recorded as taken."""
    return journal.read_bytes().count(b'"code":0,"row":')
