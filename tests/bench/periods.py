"""Time of a report of one job at several controller periods: the number of ticks must not matter.

Run by hand: python tests/bench/periods.py --help. README.md in this folder says how to read the table.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from bench.commands import KINDS, Run, gusjob, markdown, run, run_count, write_job

PERIODS_US = (1, 10, 100, 250, 1000)
HEADER = ["period us", "ticks", "user s", "seconds", "peak MB"]


def profile(folder: Path, period_us: int) -> None:
    """Write the machine profile."""
    (folder / "gusjob.toml").write_text(f'name = "bench"\nperiod_us = {period_us}\n', encoding="utf-8")


def ticks(folder: Path, job: str, period_us: int) -> float:
    """Duration of a job in periods."""
    run(gusjob("report", "--summary", "--format", "json", "-o", "totals.json", job), folder)
    totals = json.loads((folder / "totals.json").read_text(encoding="utf-8"))["totals"]
    return float(totals["duration_ms"]) * 1000 / period_us


def row(period_us: int, count: float, runs: list[Run]) -> list[str]:
    """Best of the runs at one period."""
    users = [one.user_s for one in runs if one.user_s is not None]
    peaks = [one.peak_mb for one in runs if one.peak_mb is not None]
    user, peak = (f"{min(users):.2f}" if users else "-"), (f"{max(peaks):.0f}" if peaks else "-")
    return [f"{period_us:,}", f"{count:,.0f}", user, f"{min(one.seconds for one in runs):.2f}", peak]


def main() -> None:
    """Run report --summary at every period in turn, so that a slow minute hits all alike."""
    parser = argparse.ArgumentParser(description="Time report --summary at controller periods of 1 to 1000 us.")
    parser.add_argument("--size", type=int, default=1_000_000, help="statements of the job (%(default)s)")
    parser.add_argument("--kind", choices=list(KINDS), default="lines", help="kind of job (%(default)s)")
    parser.add_argument("--runs", type=run_count, default=3, help="runs at each period (%(default)s)")
    options = parser.parse_args()
    done: dict[int, list[Run]] = {period_us: [] for period_us in PERIODS_US}
    with tempfile.TemporaryDirectory(prefix="gusjob-bench-") as name:
        folder, job = Path(name), "periods.job"
        write_job(folder / job, KINDS[options.kind](options.size))
        for period_us in PERIODS_US * options.runs:
            profile(folder, period_us)
            done[period_us].append(run(gusjob("report", "--summary", job), folder))
        counts = {}
        for period_us in PERIODS_US:
            profile(folder, period_us)
            counts[period_us] = ticks(folder, job, period_us)
    rows = [row(period_us, counts[period_us], runs) for period_us, runs in done.items()]
    print("\n".join(markdown(HEADER, rows, texts=set())))


if __name__ == "__main__":
    main()
