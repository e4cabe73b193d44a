"""Runs of one job that are interrupted and resumed until it is done, by run_on on the virtual controller."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from msgspec.structs import replace
from support.controller import State, VirtualController
from support.promises import Attempt
from support.tools import stream_of

from gusjob.cli.hardware import _closing_message
from gusjob.config.machine import Abi, Machine
from gusjob.controllers.gus.calls import Stream
from gusjob.controllers.gus.model import simulate_stream
from gusjob.controllers.journal.reader import RecordedRun
from gusjob.hardware.guard import start as guard_start
from gusjob.hardware.outcome import Ending, RunOutcome
from gusjob.hardware.request import Refusal, RunOptions, RunRequest, read_recorded_run
from gusjob.hardware.run import RunPlan, run_on
from gusjob.simulate import Trace

JOB = """LASER DELAY ON 50us OFF 60us
LASER MODE DUTY CARRIER 10
VEL 500
ACC 200000
LASER POWER 40
JUMP X -5 Y -10
LASER ON
LINE X -2 Y -10
LASER POWER 55
LINE X 0 Y -10
LINE X 5 Y -10
REPEAT 6 AS i
LINE X (5 - i % 2 * 3) Y (i / 4 - 9.5)
END
DWELL 4
ARC CCW X 2 Y -6 R 2
LINE X 1.5 Y -6.1
LASER OFF
JUMP X 4 Y -3
LASER DELAY ON 20us OFF 30us
LASER ON
LASER FOLLOW MIN 5 MAX 60 AT 400
ARC CW I -1 J 0
LINE X 0 Y -2.5
LINE X -4 Y -2
LASER OFF
JUMP X -5 Y -1
LASER FPK WIDTH 20us GAP 20us OFFDELAY 10us
LASER POWER 25
LASER ON
REPEAT 32 AS k
LINE X (k / 5 - 4.7) Y (k % 2 / 2 - 0.5)
END
ARC CCW X 1 Y 1.2 R -1
LASER OFF
LASER FPK OFF
LASER MODE FREQUENCY WIDTH 5us CHANNEL 1
LASER POWER 20 CHANNEL 1
JUMP X 2 Y 3
LASER POWER 45
LASER ON
LASER ON CHANNEL 1
LINE X 2.5 Y 0
LINE X 4 Y 0.5
LASER OFF CHANNEL 1
LINE X 5 Y 4
DWELL 3
LINE X 3 Y 5
LASER OFF
LASER DISTANCE REF X 0 Y 0 RATIO X 1 Y 1 MIN 5 MAX 90
JUMP X 2 Y 6
LASER ON CHANNEL 1
LINE X -2 Y 6.5
LINE X -6 Y 6.5
LASER OFF CHANNEL 1
JUMP X 0 Y 0
"""
"""Five stages, one of them more than two of the smallest FIFO, two channels, every kind of motion, 0.4 s.

No two timed calls of a kind have the same target. Where a laser is switched the path turns: its delays are less than a
pulse there.
"""
MACHINE = Machine()


def quick_machine(**changes: Any) -> Machine:
    """A machine with short patience."""
    settings: dict[str, Any] = {"abi": Abi.GUS, "call_timeout_s": 0.25, "link_patience_s": 0.1} | changes
    return replace(MACHINE, controller=replace(MACHINE.controller, **settings))


@cache
def compiled() -> tuple[Stream, Trace]:
    """The job's calls and their simulation."""
    stream = stream_of(JOB, MACHINE)
    trace, _ = simulate_stream(stream, MACHINE)
    assert trace is not None
    return stream, trace


def without_guard() -> None:
    """Start no guard process from now on: it takes longer to start than a run in virtual time."""
    guard_start._can_start = lambda: False


def request_of(
    folder: Path, library: Path, machine: Machine, *, journal: Path, resume: RecordedRun | None = None
) -> RunRequest:
    """The request of a run or resume of the job."""
    stream, trace = compiled()
    options = RunOptions(library=str(library), abi=Abi.GUS, journal=journal, resume=resume)
    return RunRequest(path=folder / "resumed.job", stream=stream, trace=trace, machine=machine, options=options)


def recorded_of(journal: Path) -> RecordedRun | str:
    """Read the journal to resume; follow one that names another, as a user does.

    Returns:
        The recorded run, or a text that says why none can be resumed.
    """
    seen = set[Path]()
    while True:
        seen.add(journal)
        found = read_recorded_run(journal)
        if not isinstance(found, Refusal):
            return found
        named = [Path(name) for name in re.findall(r"\S+\.journal", found.localized)]
        other = [path for path in named if path.name not in {known.name for known in seen}]
        if not other:
            return f"{found.localized} ({len(seen)} journals refused)"
        journal = other[-1]


def is_at_rest(controller: VirtualController) -> bool:
    """Whether no laser is on and nothing moves."""
    state = controller.state()
    return not any(state.emitting) and not any(state.switched_on) and state.moving == 0


def claims_off(outcome: RunOutcome) -> bool:
    """Whether a run says that its laser is off: by words, or as it was done."""
    return "the laser is off" in str(_closing_message(outcome)) or outcome.ending is Ending.DONE


def false_claim(outcome: RunOutcome, before: State, controller: VirtualController) -> str:
    """Return what an outcome claims although the controller is not so, '' if it claims nothing false."""
    message, now = str(_closing_message(outcome)), controller.state()
    changed = (now.switched_on, now.accepted, now.axes) != (before.switched_on, before.accepted, before.axes)
    if (claims_off(outcome) and not is_at_rest(controller)) or ("NOTHING WAS SWITCHED:" in message and changed):
        return f'"{message}", but {now}'
    return ""


def attempt(
    request: RunRequest,
    controller: VirtualController,
    on_plan: Callable[[float], None] | None = None,
    **options: Any,
) -> tuple[Attempt, RunOutcome]:
    """Run or resume in this process. `on_plan` takes what the plan announces; `options` are more of run_on."""
    plans, mark, before = list[RunPlan](), controller.lit_count(), controller.state()

    def confirm(plan: RunPlan) -> bool:
        plans.append(plan)
        if on_plan is not None:
            on_plan(doubling_mm(plan))
        return True

    outcome = run_on(request, confirm=confirm, **options)
    made = Attempt(
        mark=mark,
        journal=outcome.journal,
        announced_mm=doubling_mm(plans[-1]) if plans else None,
        ending=outcome.ending,
        message=str(_closing_message(outcome) or (outcome.refusal and outcome.refusal.localized) or ""),
        reasons=tuple(f"{found.rule.code} {found.message}" for found in outcome.diagnostics),
        claims_off=claims_off(outcome),
        false_claim=false_claim(outcome, before, controller),
    )
    return made, outcome


def doubling_mm(plan: RunPlan) -> float:
    """The most that a resume marks twice, as its plan announces it."""
    return float(getattr(plan, "doubling_mm", 0.0))
