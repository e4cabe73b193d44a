"""run_on, the entry that commands and programs share, without a terminal on the virtual controller."""

from __future__ import annotations

import json
import signal
import threading
from pathlib import Path
from typing import Any

import pytest
from support.controller import Fault, Row, needs_controller
from support.hardware import EVERYTHING, LONG, Bench, fresh
from support.tools import MARK, stream_of

from gusjob.config.machine import Abi, Machine
from gusjob.controllers.control import Control, Phase
from gusjob.controllers.gus.model import simulate_stream
from gusjob.controllers.gus.path_position import JOB_START
from gusjob.hardware.outcome import Ending
from gusjob.hardware.progress import Progress, report_to
from gusjob.hardware.request import Refusal, RunMode, RunOptions, RunRequest, read_recorded_run
from gusjob.hardware.run import RunPlan, run_on

pytestmark = needs_controller


@pytest.fixture(autouse=True)
def _poll_often(gus: Bench) -> None:
    fresh(gus, poll_us=3_000)


def request_of(gus: Bench, folder: Path, text: str, **options: Any) -> RunRequest:
    """A request as a program makes it from a job that was compiled and simulated."""
    stream, machine = stream_of(text), gus.machine(Machine())
    trace, _ = simulate_stream(stream, machine)
    assert trace is not None
    given = RunOptions(**({"library": str(gus.path), "abi": Abi.GUS} | options))
    return RunRequest(path=folder / "part.job", stream=stream, trace=trace, machine=machine, options=given)


def lines_of(journal: Path | None) -> list[dict[str, Any]]:
    assert journal is not None
    return [json.loads(line) for line in journal.read_text(encoding="utf-8").splitlines()]


def is_off(gus: Bench) -> bool:
    state = gus.controller.state()
    return not any((*state.emitting, *state.switched_on, state.moving))


def test_a_confirmed_run_is_done(gus: Bench, tmp_path: Path) -> None:
    progress: list[Progress] = []
    request = request_of(gus, tmp_path, EVERYTHING)
    outcome = run_on(request, confirm=True, watch=report_to(progress.append, every_s=0.0))
    assert (outcome.ending, outcome.diagnostics, outcome.is_safe) == (Ending.DONE, (), True)
    assert len(gus.controller.rows()) == 7
    assert is_off(gus)
    assert outcome.journal is not None
    assert outcome.journal.parent == tmp_path
    head, *_, last = lines_of(outcome.journal)
    assert (head["rows"], last["end"]) == (len(request.stream.buffered), "done")
    assert progress[-1].phase is Phase.DONE
    assert progress[-1].share == 1.0


@pytest.mark.parametrize("confirm", [False, None, 1, "yes"])
def test_nothing_is_done_without_confirmation(gus: Bench, tmp_path: Path, confirm: Any) -> None:
    """Only True confirms, or a function that returns it."""
    outcome = run_on(request_of(gus, tmp_path, EVERYTHING), confirm=confirm)
    assert outcome.ending is Ending.UNCONFIRMED
    assert outcome.refusal is not None
    assert gus.controller.calls() == []
    assert list(tmp_path.iterdir()) == []


def test_the_plan_is_what_is_confirmed(gus: Bench, tmp_path: Path) -> None:
    plans: list[RunPlan] = []

    def decline(plan: RunPlan) -> bool:
        plans.append(plan)
        return False

    outcome = run_on(request_of(gus, tmp_path, EVERYTHING), confirm=decline)
    assert outcome.ending is Ending.DECLINED
    assert gus.controller.calls() == []
    (plan,) = plans
    assert (plan.begin, plan.begin_location, plan.abi, plan.journal) == (JOB_START, "", Abi.GUS, outcome.journal)
    assert plan.forecast.emits
    assert plan.remaining_ms == plan.forecast.duration_ms > 0
    assert plan.forecast.box_mm == pytest.approx((-5, 15, -5, 5), abs=20)


def test_a_control_stops_it_from_another_thread_and_it_is_resumed(gus: Bench, tmp_path: Path) -> None:
    request, control = request_of(gus, tmp_path, LONG), Control()

    def stop_in_the_middle() -> None:
        while control.status.row < 20:
            control.sleep(0.0002)
        control.request_stop("the test", abrupt=True)

    thread = threading.Thread(target=stop_in_the_middle)
    thread.start()
    outcome = run_on(request, confirm=True, control=control)
    thread.join()
    assert (outcome.ending, outcome.is_safe) == (Ending.FAILED, True)
    assert [d.rule.code for d in outcome.diagnostics] == ["GJ911"]
    assert "the test" in outcome.diagnostics[0].message
    assert outcome.location == f"part.job:{outcome.diagnostics[0].span.line}"
    assert is_off(gus)
    done = gus.controller.rows()
    assert 0 < len(done) < 60
    assert outcome.journal is not None
    recorded = read_recorded_run(outcome.journal)
    assert not isinstance(recorded, Refusal)
    plans: list[RunPlan] = []

    def accept(plan: RunPlan) -> bool:
        plans.append(plan)
        return True

    again = run_on(request_of(gus, tmp_path, LONG, resume=recorded), confirm=accept)
    assert (again.ending, again.diagnostics) == (Ending.DONE, ())
    assert plans[0].begin_location == "part.job:8"
    assert plans[0].remaining_ms < plans[0].forecast.duration_ms
    rows = gus.controller.rows()
    assert rows[-1, [Row.X1, Row.Y1]].tolist() == [3000, 5900]
    # With the piece of a line that was interrupted, and the jump to it.
    assert 60 <= len(rows) <= 60 + 3
    refused = read_recorded_run(outcome.journal)
    assert isinstance(refused, Refusal)
    assert str(again.journal) in refused.localized


def test_a_control_pauses_it(gus: Bench, tmp_path: Path) -> None:
    control, phases = Control(), list[Phase]()

    def steer(progress: Progress) -> None:
        phases.append(progress.phase)
        if progress.phase is Phase.RUNNING and progress.row >= 20 and Phase.PAUSED not in phases and not control.pause:
            control.toggle_pause()
        elif progress.phase is Phase.PAUSED and control.pause:
            assert is_off(gus)
            control.toggle_pause()

    outcome = run_on(
        request_of(gus, tmp_path, LONG), confirm=True, control=control, watch=report_to(steer, every_s=0.0)
    )
    assert (outcome.ending, outcome.diagnostics) == (Ending.DONE, ())
    assert Phase.PAUSED in phases
    assert len([line for line in lines_of(outcome.journal) if "part" in line]) == 2


def test_a_callback_that_fails_shuts_down_first(gus: Bench, tmp_path: Path) -> None:
    def fail(progress: Progress) -> None:
        if progress.row > 10:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run_on(request_of(gus, tmp_path, LONG), confirm=True, watch=report_to(fail, every_s=0.0))
    assert is_off(gus)


def test_it_runs_in_a_thread_that_can_not_handle_signals(gus: Bench, tmp_path: Path) -> None:
    before, outcomes = signal.getsignal(signal.SIGINT), list[Ending]()
    request = request_of(gus, tmp_path, MARK + "LINE X 5\n")
    thread = threading.Thread(target=lambda: outcomes.append(run_on(request, confirm=True).ending))
    thread.start()
    thread.join()
    assert outcomes == [Ending.DONE]
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.parametrize("mode", [RunMode.FRAME, RunMode.NO_LASER])
def test_dry_runs_are_dark(gus: Bench, tmp_path: Path, mode: RunMode) -> None:
    outcome = run_on(request_of(gus, tmp_path, EVERYTHING, mode=mode), confirm=True)
    assert outcome.ending is Ending.DONE
    rows = gus.controller.rows()
    assert len(rows) == (5 if mode is RunMode.FRAME else 7)
    assert rows[:, [Row.EMISSION0_MS, Row.EMISSION1_MS]].sum() == 0
    assert lines_of(outcome.journal)[0]["options"] == mode.option


def test_from_a_line(gus: Bench, tmp_path: Path) -> None:
    line = next(i for i, text in enumerate(EVERYTHING.splitlines(), 1) if text.startswith("LINE X 5 Y 3"))
    outcome = run_on(request_of(gus, tmp_path, EVERYTHING, from_line=str(line)), confirm=True)
    assert outcome.ending is Ending.DONE
    assert gus.controller.rows()[0, [Row.X1, Row.Y1, Row.EMISSION0_MS]].tolist() == [5000, 0, 0]


def test_what_can_not_be_run_is_refused_with_a_reason(gus: Bench, tmp_path: Path) -> None:
    journal = tmp_path / "old.journal"
    journal.write_text("old", encoding="utf-8")
    for options, part in (
        ({"library": ""}, "needs the vendor's library"),
        ({"from_line": "999"}, "--from-line 999: the job has no motion"),
        ({"journal": journal}, "exists already"),
        ({"journal": tmp_path / "no" / "folder"}, "can't write the journal"),
    ):
        outcome = run_on(request_of(gus, tmp_path, LONG, **options), confirm=True)
        assert outcome.ending is Ending.REFUSED, options
        assert outcome.refusal is not None
        assert part in outcome.refusal.localized
    assert gus.controller.calls() == []
    assert journal.read_text(encoding="utf-8") == "old"


def test_a_library_that_can_not_be_loaded_is_a_diagnostic(gus: Bench, tmp_path: Path) -> None:
    outcome = run_on(request_of(gus, tmp_path, LONG, library=str(tmp_path / "no.so")), confirm=True)
    assert outcome.ending is Ending.INVALID
    assert [d.rule.code for d in outcome.diagnostics] == ["GJ901"]
    assert outcome.journal is None


def test_a_fault_is_a_diagnostic_at_its_line(gus: Bench, tmp_path: Path) -> None:
    gus.controller.fault(Fault.RETURN, "GT_LnXY", 3, 1, 7)
    outcome = run_on(request_of(gus, tmp_path, EVERYTHING), confirm=True)
    assert outcome.ending is Ending.FAILED
    (found,) = outcome.diagnostics
    assert (found.rule.code, found.path) == ("GJ904", str(tmp_path / "part.job"))
    assert EVERYTHING.splitlines()[found.span.line - 1] == "LINE X 5 Y 3"
    assert outcome.is_safe
    assert is_off(gus)


def test_a_laser_that_may_be_on_is_not_called_safe(gus: Bench, tmp_path: Path) -> None:
    gus.controller.fault(Fault.RETURN, "GT_SetHSIOOpt", 3, -1, 7)
    gus.controller.fault(Fault.RETURN, "GT_BufDelay", 1, -1, 7)
    outcome = run_on(request_of(gus, tmp_path, EVERYTHING), confirm=True)
    assert outcome.ending is Ending.FAILED
    assert "GJ912" in [d.rule.code for d in outcome.diagnostics]
    assert not outcome.is_safe


def test_options_that_exclude_each_other(gus: Bench, tmp_path: Path) -> None:
    outcome = run_on(request_of(gus, tmp_path, MARK + "LINE X 5\n"), confirm=True)
    assert outcome.journal is not None
    recorded = read_recorded_run(outcome.journal)
    assert not isinstance(recorded, Refusal)
    for wrong in ({"from_line": "1", "resume": recorded}, {"mode": RunMode.FRAME, "from_line": "1"}):
        with pytest.raises(ValueError, match="from_line"):
            RunOptions(**wrong)
    done = run_on(request_of(gus, tmp_path, MARK + "LINE X 5\n", resume=recorded), confirm=True)
    assert done.ending is Ending.NOTHING_LEFT
