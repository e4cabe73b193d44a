"""gusjob.run_on: a run on the virtual controller from Python, as docs/hardware.md describes it."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from support.cli import write
from support.controller import needs_controller
from support.hardware import EVERYTHING, LONG, Bench, fresh

import gusjob

pytestmark = needs_controller


@pytest.fixture
def options(gus: Bench) -> dict[str, Any]:
    """Which library a run uses."""
    fresh(gus, poll_us=3_000)
    return {"library": gus.path, "abi": "gus"}


def is_off(gus: Bench) -> bool:
    state = gus.controller.state()
    return not any((*state.emitting, *state.switched_on, state.moving))


def test_a_confirmed_job_is_run(gus: Bench, options: dict[str, Any], tmp_path: Path) -> None:
    path = write(tmp_path, EVERYTHING)
    shares: list[float] = []
    outcome = gusjob.run_on(gusjob.read(path), confirm=True, on_progress=lambda p: shares.append(p.share), **options)
    assert (outcome.ending, outcome.reason, outcome.diagnostics, outcome.is_safe) == ("done", "", (), True)
    assert len(gus.controller.rows()) == 7 and is_off(gus)
    assert outcome.journal is not None and outcome.journal.parent == tmp_path and shares[-1] == 1.0
    assert gusjob.read(outcome.journal).simulate().totals["segments"] == 7


@pytest.mark.parametrize("confirm", [False, None, 1, "yes"])
def test_nothing_is_sent_without_confirmation(
    gus: Bench, options: dict[str, Any], tmp_path: Path, confirm: Any
) -> None:
    outcome = gusjob.run_on(write(tmp_path, EVERYTHING), confirm=confirm, **options)
    assert outcome.ending == "unconfirmed" and "confirmed" in outcome.reason
    assert len(gus.controller.rows()) == 0 and list(tmp_path.glob("*.journal")) == []


def test_a_plan_can_be_declined(gus: Bench, options: dict[str, Any], tmp_path: Path) -> None:
    plans: list[Any] = []

    def decline(plan: Any) -> bool:
        plans.append(plan)
        return False

    outcome = gusjob.run_on(write(tmp_path, EVERYTHING), confirm=decline, **options)
    assert outcome.ending == "declined" and plans[0].forecast.emits
    assert len(gus.controller.rows()) == 0


def test_a_run_is_stopped_and_continued(gus: Bench, options: dict[str, Any], tmp_path: Path) -> None:
    path, control = write(tmp_path, LONG), gusjob.Control()

    def stop(progress: Any) -> None:
        if progress.row > 2:
            control.request_stop("the test")

    first = gusjob.run_on(path, confirm=True, control=control, on_progress=stop, **options)
    assert first.ending == "failed" and first.is_safe and is_off(gus)
    assert [(d.code, d.severity) for d in first.diagnostics] == [("GJ911", "error")] and first.location.startswith(
        "x.job:"
    )
    again = gusjob.run_on(path, confirm=True, resume=first.journal, **options)
    assert again.ending == "done" and is_off(gus)


def test_what_may_not_be_run_is_not_run(gus: Bench, options: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(gusjob.JobError, match="GJ401"):
        gusjob.run_on(write(tmp_path, EVERYTHING + "LASER ON\n"), confirm=True, **options)
    write(tmp_path, "[budget]\nduration_s = 0.001\n", "gusjob.toml")
    with pytest.raises(gusjob.JobError, match="GJ60"):
        gusjob.run_on(write(tmp_path, EVERYTHING), confirm=True, **options)
    (tmp_path / "gusjob.toml").unlink()
    path = write(tmp_path, EVERYTHING)
    with pytest.raises(ValueError, match="frame"):
        gusjob.run_on(path, confirm=True, mode="frame", from_line=3, **options)
    with pytest.raises(ValueError, match="sideways"):
        gusjob.run_on(path, confirm=True, mode="sideways", **options)  # type: ignore[arg-type]
    done = gusjob.run_on(path, confirm=True, mode="no-laser", **options)
    assert done.ending == "done" and done.journal is not None
    with pytest.raises(ValueError, match="journal"):
        gusjob.run_on(done.journal, confirm=True, **options)
    refused = gusjob.run_on(path, confirm=True, resume=tmp_path / "none.journal", **options)
    assert refused.ending == "refused" and "none.journal" in refused.reason
    unfit = gusjob.run_on(path, confirm=True, library=tmp_path / "none.so", abi="gus")
    assert unfit.ending == "invalid" and [d.code for d in unfit.diagnostics] == ["GJ901"]


DOSE = "LET dose = 40%\n" + LONG.replace("LASER POWER 40\n", "LASER POWER (dose)\n")


def test_a_run_is_continued_with_its_overrides(gus: Bench, options: dict[str, Any], tmp_path: Path) -> None:
    assert "(dose)" in DOSE
    path, control = write(tmp_path, DOSE), gusjob.Control()
    plans: list[Any] = []

    def stop(progress: Any) -> None:
        if progress.row > 2:
            control.request_stop("the test")

    def confirm(plan: Any) -> bool:
        plans.append(plan)
        return True

    job = gusjob.read(path, overrides={"dose": "60%"})
    first = gusjob.run_on(job, confirm=confirm, control=control, on_progress=stop, **options)
    assert (first.ending, dict(plans[0].overrides)) == ("failed", {"dose": "60%"})
    assert first.journal is not None
    assert json.loads(first.journal.read_bytes().splitlines()[0])["overrides"] == {"dose": "60%"}
    made = len(gus.controller.rows())
    for wrong, said in (({"dose": 50}, "with -D dose=60%"), ({}, "with -D dose=60%")):
        other = gusjob.read(path, overrides=wrong)
        refused = gusjob.run_on(other, confirm=True, resume=first.journal, **options)
        assert refused.ending == "refused" and said in refused.reason
    assert len(gus.controller.rows()) == made
    again = gusjob.run_on(path, confirm=confirm, resume=first.journal, **options)
    assert (again.ending, dict(plans[1].overrides)) == ("done", {"dose": "60%"})
    assert again.journal is not None
    powers = re.findall(rb'"call":"GT_BufLaserPrfCmd","args":\[1,([^,]+)', again.journal.read_bytes())
    assert {float(power) for power in powers} == {60.0}


def test_a_run_without_overrides_is_not_continued_with_some(
    gus: Bench, options: dict[str, Any], tmp_path: Path
) -> None:
    path, control = write(tmp_path, DOSE), gusjob.Control()

    def stop(progress: Any) -> None:
        if progress.row > 2:
            control.request_stop("the test")

    first = gusjob.run_on(path, confirm=True, control=control, on_progress=stop, **options)
    job = gusjob.read(path, overrides={"dose": "40%"})
    refused = gusjob.run_on(job, confirm=True, resume=first.journal, **options)
    assert refused.ending == "refused" and "of a run without -D" in refused.reason
