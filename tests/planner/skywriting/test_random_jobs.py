"""Random jobs against a second computation (oracles/skywriting.py)."""

from __future__ import annotations

from dataclasses import replace
from random import Random

import pytest
from oracles import skywriting as ref
from support.skywriting import CHECKS, SEEDS, Case, Jobs, case_of


def random_case(seed: int) -> Case | None:
    rng = Random(seed)
    steps = Jobs(rng).job()
    pulses, head, frame, gap = rng.random() < 0.2, "", None, 0.0
    if rng.random() < 0.3:
        head = "\n".join(f"LASER DELAY ON {20 + 5 * c} OFF {30 + 10 * c} CHANNEL {c}" for c in (0, 1))
    if rng.random() < 0.15:
        gap = 4.0
        head += "\nLASER FPK WIDTH 3 GAP 4 OFFDELAY 7\nLASER FPK WIDTH 3 GAP 4 OFFDELAY 7 CHANNEL 1"
    if rng.random() < 0.2:
        frame = rng.randrange(4), (float(rng.randint(-5000, 5000)), float(rng.randint(-5000, 5000)))
        moved = [replace(s, at=ref.framed(s.at, frame), centre=ref.framed(s.centre, frame)) for s in steps]
        moving = [i for i, s in enumerate(moved) if s.op in ("jump", "line", "arc")]
        # Inside a FRAME the path starts where it is: the first motion must not be an arc from (0, 0).
        if moving and moved[moving[0]].op != "arc":
            steps = moved
        else:
            frame = None
    return case_of(steps, pulses=pulses, head=head, frame=frame, gap_us=gap)


@pytest.mark.parametrize("part", range(10))
def test_random_jobs(part: int) -> None:
    """Path, speeds and emission of random jobs are the oracle's."""
    refused = 0
    for seed in range(part * SEEDS // 10, (part + 1) * SEEDS // 10):
        case = random_case(seed)
        refused += case is None
        if case is not None:
            for holds in CHECKS:
                holds(case)
    assert refused <= 1 + SEEDS // 50
