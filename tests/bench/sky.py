"""What sky writing adds to planning: the time of its passes on many short marks, beside that of all other passes.

Run by hand: python tests/bench/sky.py [MARKS]. Mode 1 has reverse motions, modes 2 and 3 have none; `bent`: a quarter
of the marks are arcs, whose switch points wait until all velocities are planned.
"""

from __future__ import annotations

import random
import statistics
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any
from unittest.mock import patch

from gusjob import planner
from gusjob.config.machine import Machine
from gusjob.controllers.gus.lower import lower
from gusjob.frontend import check_text, read_job

OWN = {"add_runs", "run_field_diagnostics", "place_switches"}
PASSES = ("flatten", "split", "quantize", "velocities", *OWN)
RUNS = 5


def job_text(marks: int, mode: int, *, bent: bool) -> Iterator[str]:
    """Marks of up to 1.4 mm at 1000 mm/s, at random places."""
    rng = random.Random(1)
    yield "LASER MODE DUTY CARRIER 20kHz\nLASER POWER 30\nVEL 1000\nACC 1000000\nJUMPVEL 5000\n"
    yield f"SKYWRITE MODE {mode} TIMELAG 250us\n" if mode else "SKYWRITE OFF\n"
    for number in range(marks):
        x, y = rng.uniform(-100, 100), rng.uniform(-100, 100)
        dx, dy = rng.uniform(-1, 1), rng.uniform(-1, 1)
        yield f"JUMP X {x:.3f} Y {y:.3f}\nLASER ON\n"
        if bent and number % 4 == 0:
            yield f"ARC CCW X {x + 1:.3f} Y {y + 1:.3f} R 2\nLASER OFF\n"
        else:
            yield f"LINE X {x + dx:.3f} Y {y + dy:.3f}\nLASER OFF\n"


def plan_seconds(text: str) -> dict[str, float]:
    """Median time of each pass, s; the first run warms up."""
    source, _ = check_text(text.encode(), "bench.job")
    assert source is not None
    machine = Machine()
    job, _ = read_job(source, machine)
    times: dict[str, list[float]] = defaultdict(list)

    def timed(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def run(*args: Any) -> Any:
            begin = time.perf_counter()
            found = function(*args)
            times[name].append(time.perf_counter() - begin)
            return found

        return run

    with ExitStack() as stack:
        for name in PASSES:
            stack.enter_context(patch.object(planner, name, timed(name, getattr(planner, name))))
        for _run in range(RUNS + 1):
            timed("lower", lower)(planner.plan(job, machine))
    return {name: statistics.median(values[1:]) for name, values in times.items()}


def main(words: list[str]) -> None:
    """A table for each mode."""
    marks = int(words[0]) if words else 100_000
    print("| job | sky writing, s | all other passes, s | ratio |\n|---|--:|--:|--:|")
    for mode, bent in ((0, False), (1, False), (2, False), (3, False), (2, True)):
        found = plan_seconds("".join(job_text(marks, mode, bent=bent)))
        own = sum(seconds for name, seconds in found.items() if name in OWN)
        rest = sum(found.values()) - own
        name = f"{marks:,} marks, " + (f"mode {mode}{', bent' if bent else ''}" if mode else "no sky writing")
        print(f"| {name} | {own:.3f} | {rest:.3f} | {own / rest:.2f} |")


if __name__ == "__main__":
    main(sys.argv[1:])
