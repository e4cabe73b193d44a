"""Kill runs by SIGKILL at random moments and resume them: PYTHONPATH=tests python -m support.kill [COUNT] [SEED].

The virtual controller outlives the process, as hardware does: it continues with what is in its FIFO. Each killed run is
resumed with a random fault in one of the calls, and then until it is done. What is promised about it is checked:
support.promises. Each run is a fork of a process that has everything imported; the library is loaded in the fork only,
since it maps the machine's state when it is loaded. `--only N` runs one case again and shows its attempts.
"""

from __future__ import annotations

import argparse
import io
import os
import random
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from support.controller import GUS, Fault, Floats, VirtualController, build
from support.forks import Fork, Send, cores, fork, results
from support.promises import Attempt, Verdict, is_stuck, judged
from support.resuming import (
    attempt,
    compiled,
    quick_machine,
    recorded_of,
    request_of,
)
from support.tally import result, tallied

from gusjob.controllers.journal.reader import RecordedRun
from gusjob.hardware.locks import LOCK_FOLDER
from gusjob.hardware.outcome import Ending

LATENCY_US = 1000
SLOTS = (16, 64, 4096)
CODES = (1, 2, 3, 7, 8, -1, -6, -7, -8)
HANG_S = 0.3
RUN_S = 0.75
"""About as long as a run takes."""
LIMIT_S = 60.0
"""A run that takes longer is killed, and the case has failed."""


# One controller.


@dataclass(frozen=True, slots=True)
class LastingController:
    """A virtual controller whose state is in a file, and the journals of its runs."""

    folder: Path
    library: Path
    options: str
    guard_switches_off: bool = False

    @property
    def environment(self) -> dict[str, str]:
        return {"VC_STATE": str(self.folder / "machine.state"), "VC_OPTIONS": self.options}

    def run(
        self, name: str, resume: RecordedRun | None, plant: Callable[[VirtualController], None], kill_s: float = LIMIT_S
    ) -> Attempt:
        """Run or resume in a fork, and kill it after a time."""
        journal = self.folder / f"{name}.journal"

        def work(send: Send) -> None:
            controller = VirtualController(self.library)
            controller.clear_faults()
            send({"mark": controller.lit_count()})
            plant(controller)
            machine = quick_machine(guard_switches_off=self.guard_switches_off)
            request = request_of(self.folder, self.library, machine, journal=journal, resume=resume)
            made, _ = attempt(request, controller, lambda announced_mm: send({"announced_mm": announced_mm}))
            send({"end": made.ending, "message": made.message, "reasons": made.reasons, "claim": made.false_claim})

        child = fork(work, self.environment)
        try:
            made, until_s = Attempt(mark=0, journal=None), time.perf_counter() + LIMIT_S
            for line in self._lines(child, until_s, kill_s):
                if "mark" in line:
                    made = replace(made, mark=line["mark"])
                elif "announced_mm" in line:
                    made = replace(made, announced_mm=line["announced_mm"])
                elif "error" in line:
                    made = replace(made, error=line["error"])
                else:
                    made = replace(made, ending=Ending(line["end"]), message=line["message"], false_claim=line["claim"])
                    made = replace(made, reasons=tuple(line["reasons"]))
        finally:
            child.kill()
            os.close(child.end)
        if time.perf_counter() >= until_s:
            made = replace(made, error=f"it took longer than {LIMIT_S:g} s")
        # Killed before its first line, a run has sent nothing.
        has_begun = journal.exists() and b"\n" in journal.read_bytes()
        return replace(made, journal=journal if has_begun else None)

    @staticmethod
    def _lines(child: Fork, until_s: float, kill_s: float) -> Iterator[dict[str, Any]]:
        """Yield lines; from the first one on, for the time after which the process is to be killed."""
        for line in child.lines(until_s):
            yield line
            until_s = time.perf_counter() + kill_s
            break
        yield from child.lines(until_s)

    def lits(self) -> Floats:
        """Return the lit stretches of all runs."""
        found = self.folder / "lits.npy"

        def work(_: Send) -> None:
            table = io.BytesIO()
            np.save(table, VirtualController(self.library).lits())
            found.write_bytes(table.getvalue())

        child = fork(work, self.environment)
        os.waitpid(child.pid, 0)
        os.close(child.end)
        made: Floats = np.load(found)
        return made


# Cases.


@dataclass(frozen=True, slots=True)
class Case:
    """What happens to one run. `fault`: for its first resume, in the call of number `call`."""

    number: int
    kill_s: float
    slots: int
    wait_s: float
    fault: Fault
    value: float
    call: int
    newest: bool
    """Whether the journal of a resume that was killed is resumed, or once more the one that it resumed."""
    guard_switches_off: bool

    def __str__(self) -> str:
        where = f"{self.fault.name} {self.value:g} at call {self.call} of the resume after {self.wait_s:g} s"
        guard = ", its guard switches off" if self.guard_switches_off else ""
        return f"{self.number}: killed after {self.kill_s:.4f} s, {self.slots} slots{guard}; {where}"


def case_of(seed: int, number: int) -> Case:
    """Make a case by its seed and number."""
    chance = random.Random(f"{seed}/{number}")
    fault = chance.choice(
        [Fault.RETURN] * 5
        + [Fault.AFTER] * 2
        + [Fault.KILL, Fault.KILL_AFTER] * 2
        + [Fault.HANG, Fault.HANG_RETURN, Fault.HANG_AFTER]
    )
    is_code = fault in (Fault.RETURN, Fault.AFTER)
    hangs = fault in (Fault.HANG, Fault.HANG_RETURN, Fault.HANG_AFTER)
    return Case(
        number=number,
        kill_s=chance.uniform(0, RUN_S),
        slots=chance.choice(SLOTS),
        wait_s=chance.choice([0.0, 0.0, 0.05, 0.5]),
        fault=fault,
        value=chance.choice(CODES) if is_code else HANG_S if hangs else 0.0,
        call=chance.choice([chance.randint(1, 30), chance.randint(1, 300)]),
        newest=chance.random() < 0.5,
        guard_switches_off=chance.random() < 0.25,
    )


def run_case(case: Case, folder: Path, library: Path, expected: Floats) -> Verdict:
    """Run a case."""
    folder.mkdir()
    # A controller is known by its library: each worker has controllers of its own. A guard knows no other folder of
    # locks than that of all runs.
    library = Path(shutil.copy(library, folder))
    options = f"speed=1,log=0,latency_us={LATENCY_US},slots={case.slots}"
    machine = LastingController(folder, library, options, case.guard_switches_off)
    first = machine.run("0", None, lambda _: None, case.kill_s)
    attempts, journal, stuck, until_s = [first], first.journal, "", time.perf_counter() + LIMIT_S

    def plant(controller: VirtualController) -> None:
        if len(attempts) == 1:
            controller.fault(case.fault, nth=case.call, value=case.value)

    while not attempts[-1].is_done and not is_stuck(attempts):
        if len(attempts) == 1:
            time.sleep(case.wait_s)
        resume: RecordedRun | None = None
        if journal is not None:
            recorded = recorded_of(journal)
            if isinstance(recorded, str):
                stuck = f"can't be resumed: {recorded}"
                break
            resume = recorded
        made = machine.run(str(len(attempts)), resume, plant)
        if made.ending is Ending.BUSY and time.perf_counter() < until_s:
            time.sleep(0.1)  # The guard of the run that was killed has the controller.
            continue
        attempts.append(made)
        if made.journal is not None and (made.ending or case.newest or journal is None):
            journal = made.journal
    verdict = judged(expected, machine.lits(), attempts)
    shutil.rmtree(folder, ignore_errors=True)  # A guard may still write there.
    return replace(verdict, wrong=(*verdict.wrong, stuck)) if stuck else verdict


def whole_run(folder: Path, library: Path) -> Floats:
    """Return the stretches of a run that is not killed."""
    folder.mkdir()
    machine = LastingController(folder, library, f"speed=1,log=0,latency_us={LATENCY_US}")
    made = machine.run("whole", None, lambda _: None)
    assert made.is_done, made
    expected = machine.lits()
    shutil.rmtree(folder)
    return expected


def forget_locks(folder: Path) -> None:
    """Remove the lock files that killed runs of jobs in this folder left."""
    for holder in LOCK_FOLDER.glob("*.holder"):
        with suppress(OSError):
            if str(folder) in holder.read_text(encoding="utf-8"):
                holder.with_suffix(".lock").unlink()
                holder.unlink()


def main() -> int:
    """Kill COUNT runs; the exit code is 1 if a promise was broken."""
    parser = argparse.ArgumentParser(description="Kill runs at random moments and resume them.")
    parser.add_argument("count", type=int, nargs="?", default=200)
    parser.add_argument("seed", type=int, nargs="?", default=5)
    parser.add_argument("--only", type=int, help="run this case only, and show its attempts")
    parser.add_argument("--workers", type=int, default=2 * cores())
    options = parser.parse_args()
    compiled()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        library = build(folder, GUS)
        expected = whole_run(folder / "whole", library)
        numbers = [options.only] if options.only is not None else list(range(options.count))

        def run(number: int) -> dict[str, Any]:
            case = case_of(options.seed, number)
            return result(f"seed {options.seed}, case {case}", run_case(case, folder / str(number), library, expected))

        code = tallied(results(numbers, options.workers, run), is_shown=options.only is not None)
        forget_locks(folder)
        return code


if __name__ == "__main__":
    sys.exit(main())
