"""Random jobs against a second computation (oracles/skywriting.py)."""

from __future__ import annotations

from dataclasses import replace
from random import Random

import pytest
from oracles import skywriting as ref
from oracles.skywriting import Step
from support.skywriting import CHECKS, SEEDS, Case, Jobs, case_of, compiled, ran
from support.tools import MACHINE

from gusjob.diagnostics.model import Severity
from gusjob.report.rows import make_report


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


def with_spare_switches(steps: list[Step], rng: Random) -> list[Step]:
    """The steps, with switches between them that change nothing."""
    on, found = {0: False, 1: False}, []
    for step in steps:
        found.append(step)
        if step.op in ("on", "off"):
            on[step.channel] = step.op == "on"
        channel = rng.randrange(2)
        if rng.randrange(4) == 0:
            found.append(Step(op="on" if on[channel] else "off", channel=channel))
    return found


@pytest.mark.parametrize("head", ["", "LASER DELAY ON 90us OFF 300us", "LASER FPK WIDTH 3 GAP 900 OFFDELAY 700"])
def test_sky_writing_changes_no_mark(head: str) -> None:
    """What is marked is as long as without sky writing, whole pulses apart, and the laser is off at the end."""
    rng, compared = Random(head), 0
    for _ in range(SEEDS // 10):
        steps = with_spare_switches(Jobs(rng).job(), rng)
        stream, found = compiled(ref.job_text(steps, head=head))
        plain = compiled(ref.job_text([step for step in steps if step.op != "sky"], head=head))[0]
        if any(f.severity is Severity.ERROR for f in found):
            continue
        compared += 1
        sky = ran(stream)
        assert not any(channel.emission.on_at_end for channel in sky.channels)
        lengths = [make_report(trace, MACHINE).totals["mark_mm"] for trace in (sky, ran(plain))]
        assert lengths[0] == pytest.approx(lengths[1], abs=2e-3 * len(steps))
    assert compared > SEEDS // 30
