"""Size, time and peak memory of everything that is drawn or written from a run, for short and long jobs.

Run by hand: python tests/bench/outputs.py --help. README.md in this folder says how to read the table. Like bench.py,
which lends its hands, this process stays small and imports neither numpy nor gusjob.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from bench.commands import HEAD, KINDS, gusjob, markdown, run, write_job

OUTPUTS: dict[str, tuple[str, ...]] = {
    "table": ("report", "--summary", "-o", "out.txt"),
    "png": ("plot", "-o", "out.png"),
    "svg": ("plot", "-o", "out.svg"),
    "pdf": ("plot", "-o", "out.pdf"),
    "html": ("report", "--format", "html", "-o", "out.html"),
    "rows": ("report", "--format", "parquet", "-o", "out.parquet"),
    "vcd": ("trace", "-o", "out.vcd"),
    "csv": ("trace", "-o", "out.csv"),
    "parquet": ("trace", "-o", "out.parquet"),
    "npz": ("trace", "-o", "out.npz"),
}
FIELD_MM = 100.0


def near(chance: random.Random, place: list[float], far_mm: float) -> list[float]:
    """A place not far from another, in the field."""
    return [min(max(at + chance.gauss(0, far_mm), -FIELD_MM), FIELD_MM) for at in place]


def wild_job(count: int) -> Iterator[str]:
    """`count` segments in which nothing repeats: random lengths, directions, powers; a jump before each two."""
    chance = random.Random(1)
    place = [0.0, 0.0]
    yield from (*HEAD, "VEL 800", "ACC 1000000", "LASER POWER 50")
    done = 0
    while done < count:
        place = near(chance, place, 2.0)
        yield f"JUMP X {place[0]:.3f} Y {place[1]:.3f}"
        yield f"LASER POWER {chance.uniform(5, 95):.2f}"
        yield "LASER ON"
        for _ in range(2):
            place = near(chance, place, 0.5)
            yield f"LINE X {place[0]:.3f} Y {place[1]:.3f} VEL {chance.uniform(200, 900):.1f}"
        yield "LASER OFF"
        done += 3


JOBS: dict[str, Callable[[int], Iterator[str]]] = {**KINDS, "wild": wild_job}


def row(kind: str, size: int, name: str, folder: Path) -> list[str]:
    """One line of the table."""
    words = OUTPUTS[name]
    done = run(gusjob(words[0], "x.job", *words[1:]), folder)
    out = folder / words[-1]
    megabytes = out.stat().st_size / 1e6
    out.unlink()
    peak = "-" if done.peak_mb is None else f"{done.peak_mb:.0f}"
    print(f"  {kind} {size:,} {name}: {done.seconds:.1f} s", file=sys.stderr, flush=True)
    return [kind, f"{size:,}", name, f"{megabytes:.2f}", f"{done.seconds:.1f}", peak]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--sizes", default="1000,1000000")
    parser.add_argument("--kinds", default="lines,raster,wild", help=f"of {', '.join(JOBS)}")
    parser.add_argument("--outputs", default=",".join(OUTPUTS), help=f"of {', '.join(OUTPUTS)}")
    asked = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for kind in asked.kinds.split(","):
            for size in map(int, asked.sizes.split(",")):
                write_job(folder / "x.job", JOBS[kind](size))
                rows += [row(kind, size, output, folder) for output in asked.outputs.split(",")]
    print("\n".join(markdown(["job", "statements", "output", "MB", "seconds", "peak MB"], rows, texts={0, 2})))


if __name__ == "__main__":
    main()
