"""The results of many cases: what a worker sends of each, and the figures of all."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from support.promises import Verdict


def result(case: str, verdict: Verdict) -> dict[str, Any]:
    """Return what a worker sends of a case."""
    found = verdict.found
    return {
        "case": case,
        "first": verdict.attempts[0].error or verdict.attempts[0].ending or "killed",
        "done": verdict.is_done,
        "whole": verdict.is_whole,
        "wrong": verdict.wrong,
        "over": verdict.over,
        "attempts": [str(one) for one in verdict.attempts],
        "resumes": len(verdict.attempts) - 1,
        "left_out": found.left_out_pulse,
        "outside": found.outside_pulse,
        "burning_ms": found.burning_ms,
        "doubled": verdict.doubled_pulse,
        "announced": verdict.announced_pulse,
    }


@dataclass(slots=True)
class Tally:
    """All cases so far."""

    firsts: Counter[str] = field(default_factory=Counter)
    """How the first run ended."""
    resumes: int = 0
    done: int = 0
    whole: int = 0
    kept: int = 0
    over: int = 0
    """Cases in which a resume marked more twice than its own plan announced."""
    left_out: float = 0.0
    """Of those that said that they were done."""
    outside: float = 0.0
    burning_ms: float = 0.0
    doubled: tuple[float, float] = (0.0, 0.0)
    """The largest, with what was announced for it."""
    most_over: tuple[float, float] = (0.0, 0.0)
    """The one that is most above what was announced."""

    def add(self, line: dict[str, Any]) -> None:
        self.firsts[line["first"].splitlines()[-1]] += 1
        self.whole += line["whole"]
        self.kept += not line["wrong"]
        self.over += bool(line["over"])
        self.resumes += line["resumes"]
        self.done += line["done"]
        self.left_out = max(self.left_out, line["left_out"] if line["done"] else 0.0)
        self.outside = max(self.outside, line["outside"])
        self.burning_ms = max(self.burning_ms, line["burning_ms"])
        pair = (line["doubled"], line["announced"])
        self.doubled = max(self.doubled, pair)
        self.most_over = max(self.most_over, pair, key=lambda one: one[0] - one[1])

    def __str__(self) -> str:
        runs = ", ".join(f"{count} {first}" for first, count in self.firsts.most_common())
        return (
            f"{self.firsts.total()} runs ({runs}), {self.resumes} resumes: {self.done} done, {self.whole} whole, "
            f"{self.kept} with every promise kept, {self.over} with a resume that doubled more than its own plan said\n"
            f"worst left out {self.left_out:.1f} pulse, outside {self.outside:.1f} pulse, "
            f"burning {self.burning_ms:.0f} ms\n"
            f"most doubled {self.doubled[0]:.1f} pulse, announced {self.doubled[1]:.1f}; "
            f"most above what was announced: {self.most_over[0]:.1f}, announced {self.most_over[1]:.1f}"
        )


def tallied(lines: Iterable[dict[str, Any]], *, is_shown: bool) -> int:
    """Print the cases in which a promise was broken, or all, and the figures at the end.

    Returns:
        The exit code: 1 if a promise was broken, or if a worker failed.
    """
    began, tally, broken = time.perf_counter(), Tally(), False
    for line in lines:
        if "error" in line:
            print(line["error"])
            return 1
        tally.add(line)
        broken = broken or bool(line["wrong"] or line["over"])
        if line["wrong"] or line["over"] or is_shown:
            texts = [f"  {text}" for text in (*line["wrong"], *line["over"], *line["attempts"])]
            print("\n".join([line["case"], *texts]), flush=True)
    print(f"{tally}\n{time.perf_counter() - began:.0f} s")
    return int(broken)
