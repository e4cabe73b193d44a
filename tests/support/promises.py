"""What is promised about a run that is interrupted and resumed until it is done, whatever the controller."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from oracles.coverage import Coverage, Floats, Gap, coverage

from gusjob.hardware.outcome import Ending

PULSES_PER_MM = 1000
MOST_RESUMES = 8
DONE = (Ending.DONE, Ending.NOTHING_LEFT)


@dataclass(frozen=True, slots=True, kw_only=True)
class Attempt:
    """One run or resume.

    `mark`: number of lit stretches before it; `announced_mm`: what its plan said may be marked twice, None without a
    plan; `ending`: '' if the process was killed; `message`: the closing message; `reasons`: the diagnostics;
    `claims_off`: whether it says that the laser is off, by words or as it was done; `false_claim`: what the closing
    message claims although it is not so.
    """

    mark: int
    journal: Path | None
    announced_mm: float | None = None
    ending: str = ""
    message: str = ""
    reasons: tuple[str, ...] = ()
    error: str = ""
    claims_off: bool = False
    false_claim: str = ""

    @property
    def is_done(self) -> bool:
        return self.ending in DONE

    def __str__(self) -> str:
        what = self.error or self.ending or "killed"
        plan = "no plan" if self.announced_mm is None else f"announces {self.announced_mm:.3f} mm"
        return f"{what} ({plan}): {self.message}{''.join(f'; {reason}' for reason in self.reasons)}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What came out of a run and its resumes.

    `wrong`: each broken promise; `over`: the resumes that marked more twice than their own plan announced, though all
    of them together may not.
    """

    found: Coverage
    attempts: tuple[Attempt, ...]
    wrong: tuple[str, ...]
    over: tuple[str, ...]

    @property
    def is_done(self) -> bool:
        """Whether the last resume said so."""
        return self.attempts[-1].is_done

    @property
    def is_whole(self) -> bool:
        return self.is_done and not self.found.left_out

    @property
    def doubled_pulse(self) -> float:
        return float(self.found.doubled.sum())

    @property
    def announced_pulse(self) -> float:
        return sum(one.announced_mm or 0.0 for one in self.attempts) * PULSES_PER_MM


def is_stuck(attempts: Sequence[Attempt]) -> bool:
    """Whether more resumes change nothing: the last two failed alike without a plan, or there were enough."""
    ends = [one.reasons for one in attempts[-2:] if one.reasons and one.announced_mm is None]
    return len(attempts) > MOST_RESUMES or (len(ends) == 2 and ends[0] == ends[1])


def judged(expected: Floats, lits: Floats, attempts: Sequence[Attempt], tolerance_pulse: float = 1.0) -> Verdict:
    """Check what is promised: nothing left out, doubled no more than announced, nothing outside, no false claim.

    Args:
        expected: lit stretches of a run that was not interrupted.
        lits: lit stretches of all attempts.
        attempts: the run and its resumes.
        tolerance_pulse: for each piece, and for the doubling of each attempt.
    """
    found = coverage(expected, lits, [one.mark for one in attempts[1:]], tolerance_pulse)
    wrong, over = _listed("outside", found.outside) + _listed("wrong power", found.wrong_power), list[str]()
    for number, (one, doubled) in enumerate(zip(attempts, found.doubled.tolist(), strict=True)):
        announced = (one.announced_mm or 0.0) * PULSES_PER_MM
        if doubled > announced + tolerance_pulse:
            over.append(f"attempt {number} doubled {doubled:.1f} pulse, announced {announced:.1f}")
        wrong += [f"attempt {number} claims {one.false_claim}"] if one.false_claim else []
        wrong += [f"attempt {number} failed: {one.error}"] if one.error else []
    if attempts[-1].is_done:
        wrong += _listed("left out", found.left_out)
    else:
        wrong.append(f"not done after {len(attempts) - 1} resumes")
    verdict = Verdict(found=found, attempts=tuple(attempts), wrong=tuple(wrong), over=tuple(over))
    if verdict.doubled_pulse > verdict.announced_pulse + tolerance_pulse * len(attempts):
        more = f"doubled {verdict.doubled_pulse:.1f} pulse, announced {verdict.announced_pulse:.1f} in all"
        verdict = replace(verdict, wrong=(*verdict.wrong, more))
    return verdict


def _listed(what: str, gaps: Sequence[Gap]) -> list[str]:
    """The first three of them."""
    more = [f"and {len(gaps) - 3} more pieces, in all {sum(gap.size for gap in gaps):.1f}"] if len(gaps) > 3 else []
    return [f"{what}: {text}" for text in (*map(str, gaps[:3]), *more)]
