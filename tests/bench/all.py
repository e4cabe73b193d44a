"""All benchmarks of whole commands, as figures and as the tables of docs/benchmarks.md.

Run by hand, on a computer that does nothing else:

    python tests/bench/all.py                       # about ten minutes; writes docs/benchmarks.json and .md
    python tests/bench/all.py --against ../older    # also times an older checkout, in turn; prints the tables only

All that is compared runs in turn: the figures of two runs of this script can't be compared.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from bench.commands import (
    COMMANDS,
    KINDS,
    PROFILE,
    SMALLEST,
    Job,
    Run,
    gusjob,
    make_job,
    one_of,
    run,
    run_count,
    run_gusjob,
    run_lark,
)
from support.benchmark_tables import tables, with_tables

ROOT = Path(__file__).resolve().parents[2]
FIGURES, DOCUMENT = ROOT / "docs" / "benchmarks.json", ROOT / "docs" / "benchmarks.md"
IMPORTS = [sys.executable, "-c", "import numpy, lark, click"]
OF_LISTINGS = ("check", "report --summary", "report json")
STARTS = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Timed:
    """The best of some runs of a command. `peak_mb`: the highest memory, None where the system does not tell it."""

    seconds: float
    peak_mb: float | None


def in_turn(commands: dict[str, Callable[[], Run]], runs: int) -> dict[str, Timed]:
    """Time commands in turn, so that a slow minute hits all alike."""
    done: dict[str, list[Run]] = {name: [] for name in commands}
    for _ in range(runs):
        for name, command in commands.items():
            done[name].append(command())
            print(f"  {name}: {done[name][-1].seconds:.2f} s", file=sys.stderr, flush=True)
    return {
        name: Timed(
            seconds=min(one.seconds for one in all_runs),
            peak_mb=max((one.peak_mb for one in all_runs if one.peak_mb is not None), default=None),
        )
        for name, all_runs in done.items()
    }


def measure_start(folder: Path) -> dict[str, float]:
    """Start-up: `check` of ten lines beside the imports that no command can do without."""
    job = make_job("ten", 10, folder)
    commands = {"imports": lambda: run(IMPORTS, folder), "ten lines": lambda: run_gusjob(job.path, "check", ROOT)}
    found = in_turn(commands, STARTS)
    return {"imports_s": round(found["imports"].seconds, 4), "check_s": round(found["ten lines"].seconds, 4)}


def measure_file(job: Job, path: Path, names: tuple[str, ...], options: argparse.Namespace) -> list[dict[str, Any]]:
    """The rows of a job (or of its listing at `path`): its commands, plain lark, and the older checkout."""
    older, is_job = options.against, path == job.path
    commands: dict[str, Callable[[], Run]] = {}
    for name in names:
        commands[name] = lambda name=name: run_gusjob(path, name, ROOT)  # type: ignore[misc]
        if older is not None:
            commands[f"{name}, before"] = lambda name=name: run_gusjob(path, name, older)  # type: ignore[misc]
    if is_job:
        commands["lark"] = lambda: run_lark(job)
    found = in_turn(commands, options.runs)
    rows = []
    for name in names:
        peak = found[name].peak_mb
        row = {
            "kind": job.kind if is_job else f"listing of {job.kind}",
            "statements": job.statements,
            "command": name,
            "seconds": round(found[name].seconds, 3),
            "lark_s": round(found["lark"].seconds, 3) if is_job else None,
            "peak_mb": None if peak is None else round(peak, 1),
        }
        if older is not None:
            row["before_s"] = round(found[f"{name}, before"].seconds, 3)
        rows.append(row)
    return rows


def measure_all(options: argparse.Namespace) -> dict[str, Any]:
    """All figures."""
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory(prefix="gusjob-bench-") as name:
        folder = Path(name)
        (folder / "gusjob.toml").write_text(PROFILE, encoding="utf-8")
        start = measure_start(folder)
        for kind in options.kinds:
            for size in options.sizes:
                print(f"{kind} {size:,} ...", file=sys.stderr, flush=True)
                job = make_job(kind, size, folder)
                rows += measure_file(job, job.path, tuple(COMMANDS), options)
                if kind == "lines":
                    listing = job.path.with_suffix(".gts")
                    run(gusjob("compile", "-o", listing.name, job.path.name), folder, ROOT)
                    rows += measure_file(job, listing, OF_LISTINGS, options)
                    listing.unlink()
                job.path.unlink()
    packages = {package: version(package) for package in ("numpy", "lark")}
    own = re.search(r'__version__ = "(.+)"', (ROOT / "gusjob" / "version.py").read_text(encoding="utf-8"))
    machine = {"cores": os.cpu_count(), "python": platform.python_version(), **packages}
    return {
        "gusjob": own[1] if own else "",
        "machine": machine,
        "runs": options.runs,
        "start": start,
        "rows": rows,
    }


def sizes(text: str) -> list[int]:
    """Reads sizes with commas between."""
    found = [int(word) for word in text.replace("_", "").split(",")]
    if min(found) < SMALLEST:
        raise argparse.ArgumentTypeError(f"a size is at least {SMALLEST}")
    return found


def checkout(text: str) -> Path:
    """Reads the folder of a checkout."""
    path = Path(text).resolve()
    if not (path / "gusjob" / "__init__.py").is_file():
        raise argparse.ArgumentTypeError(f"{text} is no checkout of gusjob")
    return path


def main() -> None:
    """Measure, write the figures and the document, or print the comparison."""
    kinds = {kind: None for kind in KINDS if kind != "ten"}
    parser = argparse.ArgumentParser(description="Time all commands, beside plain lark and bare imports.")
    parser.add_argument("--sizes", type=sizes, default="100000,1000000", help="statements a job (%(default)s)")
    parser.add_argument("--runs", type=run_count, default=2, help="runs of each command (%(default)s)")
    parser.add_argument("--kinds", type=one_of(kinds), default=",".join(kinds), help="which of %(default)s")
    parser.add_argument("--against", type=checkout, help="an older checkout to compare with; nothing is written")
    options = parser.parse_args()
    figures = measure_all(options)
    print(tables(figures))
    if options.against is None:
        FIGURES.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
        DOCUMENT.write_text(with_tables(DOCUMENT.read_text(encoding="utf-8"), figures), encoding="utf-8")


if __name__ == "__main__":
    main()
