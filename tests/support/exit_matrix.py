"""Each call of a job fails: PYTHONPATH=tests python -m support.exit_matrix [COUNT] [SEED] | --all.

Every call of a run returns every error code: once, from then on, or with all other calls from then on; at once or after
it hung; over a fast link and a slow one; in real time. Then the faults end, and the run is resumed until it is done.
What is promised about it is checked: support.promises. COUNT cases are chosen by the seed. `--only N` runs one case
again and shows its attempts; `--unscaled` hangs for 3 s, with the patience of a profile that sets none.
"""

from __future__ import annotations

import argparse
import math
import os
import random
import shutil
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from support.controller import ALL_CALLS, FOR_EVER, GUS, Fault, Floats, Lit, VirtualController, build
from support.forks import Send, cores, fork, results
from support.promises import Attempt, Verdict, is_stuck, judged
from support.resuming import (
    attempt,
    claims_off,
    compiled,
    is_at_rest,
    quick_machine,
    recorded_of,
    request_of,
    without_guard,
)
from support.tally import result, tallied

from gusjob.config.machine import Machine
from gusjob.controllers.journal.reader import RecordedRun
from gusjob.hardware import locks

CODES = (1, 2, 3, 7, 8, -1, -6, -7, -8)
COUNTS = {1: "once", FOR_EVER: "from then on", ALL_CALLS: "with all calls from then on"}
LATENCIES_US = (0, 1000)
SLOTS = (16, 64, 4096)
POLLS = ("GT_CrdStatus", "GT_CrdSpace", "GT_GetCrdPos")
POLL_COUNT = 30
LATER_S = 0.5
LEFT_LINE = 90_000.0
"""Length of the line that an earlier program left in progress; the job has no such target."""
LEFT_STATES: tuple[dict[str, float], ...] = (
    {},
    {},
    {},
    {
        "leave_on": 3,
        "leave_off_delay_us": 9000,
        "leave_on_delay_us": 2000,
        "leave_fpk_us": 500,
        "leave_distance": 70,
        "leave_moving": LEFT_LINE,
    },
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Timing:
    """How long a call hangs, and the machine's patience."""

    hang_s: float
    machine: Machine


SCALED = Timing(hang_s=0.3, machine=quick_machine())
UNSCALED = Timing(hang_s=3.0, machine=quick_machine(call_timeout_s=2.0, link_patience_s=5.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A fault in one call of a run: the nth of its name. `left`: options for what an earlier program left."""

    number: int
    nth: int
    name: str
    code: int
    count: int
    hangs: bool
    latency_us: int
    slots: int
    left: dict[str, float]

    def __str__(self) -> str:
        how = f"{'hangs and ' if self.hangs else ''}returns {self.code} {COUNTS[self.count]}"
        where = f"{self.latency_us} us, {self.slots} slots{', something left on' if self.left else ''}"
        return f"{self.number}: {self.name} {self.nth} {how}; {where}"


def all_cases(names: Sequence[str]) -> list[Case]:
    """Make every case. `names`: the calls of a run."""
    # Polls come by time: their number is fixed here, so that a case keeps its number.
    counts = Counter(names) | dict.fromkeys(POLLS, POLL_COUNT)
    calls = [(name, nth) for name, count in sorted(counts.items()) for nth in range(1, count + 1)]
    made: list[Case] = []
    for (name, nth), code, count, hangs, latency_us in product(calls, CODES, COUNTS, (False, True), LATENCIES_US):
        # Mixed, so that each call meets each of them with some code.
        number = len(made)
        mixed = random.Random(number)
        made.append(
            Case(
                number=number,
                nth=nth,
                name=name,
                code=code,
                count=count,
                hangs=hangs,
                latency_us=latency_us,
                slots=mixed.choice(SLOTS),
                left=mixed.choice(LEFT_STATES),
            )
        )
    return made


def sampled(cases: Sequence[Case], count: int, seed: int) -> list[Case]:
    """Choose cases, half of them among calls that are not polls, since most calls are polls."""
    chance = random.Random(seed)
    chosen = chance.sample(range(len(cases)), min(count // 2, len(cases)))
    others = [i for i, case in enumerate(cases) if case.name not in POLLS and i not in set(chosen)]
    chosen += chance.sample(others, min(count - len(chosen), len(others)))
    return [cases[i] for i in sorted(chosen)]


def set_up(controller: VirtualController, **options: float) -> None:
    """Switch a controller off and on again."""
    controller.reset()
    controller.options(**options)


def run_case(case: Case, folder: Path, library: Path, expected: Floats, timing: Timing) -> Verdict:
    """Run a case on the controller of this process."""
    controller = VirtualController(library)
    set_up(controller, speed=1, log=0, latency_us=case.latency_us, slots=case.slots, **case.left)
    folder.mkdir()
    if case.hangs:
        controller.fault(Fault.HANG, case.name, case.nth, case.count, timing.hang_s)
    controller.fault(Fault.RETURN, case.name, case.nth, case.count, case.code)
    attempts, journal, stuck = list[Attempt](), None, ""
    while not attempts or not (attempts[-1].is_done or attempts[-1].error or is_stuck(attempts)):
        resume: RecordedRun | None = None
        if journal is not None:
            recorded = recorded_of(journal)
            if isinstance(recorded, str):
                stuck = f"can't be resumed: {recorded}"
                break
            resume = recorded
        attempts.append(_attempt(case, folder, library, len(attempts), resume, timing, controller))
        controller.clear_faults()
        journal = attempts[-1].journal or journal
    lits = controller.lits()
    # Emission on the line that an earlier program left is not that of the run.
    attempts, lits = _without_left(attempts, lits)
    verdict = judged(expected, lits, attempts)
    shutil.rmtree(folder)
    return replace(verdict, wrong=(*verdict.wrong, stuck)) if stuck else verdict


def _attempt(
    case: Case,
    folder: Path,
    library: Path,
    number: int,
    resume: RecordedRun | None,
    timing: Timing,
    controller: VirtualController,
) -> Attempt:
    """Run or resume; look at the controller at once, and again when all calls have returned."""
    mark, journal = controller.lit_count(), folder / f"{number}.journal"
    try:
        request = request_of(folder, library, timing.machine, journal=journal, resume=resume)
        made, outcome = attempt(request, controller)
    except BaseException:  # noqa: BLE001  (it is the result)
        return Attempt(mark=mark, journal=None, error=traceback.format_exc())
    if number == 0:
        time.sleep(LATER_S + (timing.hang_s if case.hangs else 0.0))
        if not made.false_claim and claims_off(outcome) and not is_at_rest(controller):
            made = replace(made, false_claim=f'"{made.message}", but {LATER_S} s later {controller.state()}')
    return made


def _without_left(attempts: list[Attempt], lits: Floats) -> tuple[list[Attempt], Floats]:
    others = lits[:, Lit.X] != LEFT_LINE
    before = [int((~others[: one.mark]).sum()) for one in attempts]
    return [replace(one, mark=one.mark - gone) for one, gone in zip(attempts, before, strict=True)], lits[others]


def reference(folder: Path, library: Path) -> tuple[Floats, list[str]]:
    """Return the lit stretches of a run without faults, and the calls that it makes."""
    found = folder / "reference"
    found.mkdir()

    def work(send: Send) -> None:
        controller = VirtualController(library)
        set_up(controller, speed=1)
        made, _ = attempt(request_of(found, library, quick_machine(), journal=found / "0.journal"), controller)
        assert made.is_done, made
        send({"names": controller.names(), "lits": controller.lits().tolist()})

    child = fork(work, {})
    (line,) = child.lines(math.inf)
    child.kill()
    if "error" in line:
        raise RuntimeError(line["error"])
    return np.array(line["lits"]), line["names"]


def main() -> int:
    """Run cases; the exit code is 1 if a promise was broken."""
    parser = argparse.ArgumentParser(description="Let each call of a job fail, and resume the job.")
    parser.add_argument("count", type=int, nargs="?", default=200)
    parser.add_argument("seed", type=int, nargs="?", default=5)
    parser.add_argument("--all", action="store_true", help="run every case, which takes hours")
    parser.add_argument("--only", type=int, help="run this case only, and show its attempts")
    parser.add_argument("--unscaled", action="store_true", help="calls hang for 3 s")
    parser.add_argument("--workers", type=int, default=4 * cores())
    options = parser.parse_args()
    compiled()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        library = build(folder, GUS)
        locks.LOCK_FOLDER = folder / "locks"
        expected, names = reference(folder, library)
        cases = all_cases(names)
        chosen = cases if options.all else sampled(cases, options.count, options.seed)
        if options.only is not None:
            chosen = [cases[options.only]]

        def run(number: int) -> dict[str, Any]:
            locks.LOCK_FOLDER = folder / f"locks of {os.getpid()}"
            without_guard()
            timing = UNSCALED if options.unscaled else SCALED
            verdict = run_case(cases[number], folder / str(number), library, expected, timing)
            return result(f"case {cases[number]}", verdict)

        numbers = [case.number for case in chosen]
        random.Random(options.seed).shuffle(numbers)
        print(f"{len(cases)} cases, {len(numbers)} of them run")
        return tallied(results(numbers, options.workers, run), is_shown=options.only is not None)


if __name__ == "__main__":
    sys.exit(main())
