"""Time `gusjob` on jobs of one size and many shapes, each beside the plain job of LINEs or the flat text of its path.

Run by hand: python tests/bench/shapes.py --help. README.md in this folder says how to read the table. Like bench.py,
which lends its hands, this process stays small and imports neither numpy nor gusjob.
"""

from __future__ import annotations

import argparse
import math
import statistics
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from bench.commands import HEAD, SHORT, Run, gusjob, markdown, one_of, run, run_count, run_gusjob, write_job

SIZE = 1_000_000
SMALLEST = 1000
SLOW, SLOW_LISTING, SLOW_LOOP, MUCH_MB = 3.0, 2.0, 10.0, 1000.0
"""Above these a row is marked."""

COMMANDS = {name: long for name, long in SHORT.items() if name in ("check", "summary")}
POWERED = (*HEAD, "VEL 800", "ACC 100000", "LASER POWER 50")


# The plain job: a raster of 0.8 mm steps, rows to and fro 0.04 mm apart, so that no mark comes twice.

COLUMNS = 250
LEFT_MM, LOWEST_MM, STEP_MM = -100.0, -85.0, 0.8


def points(count: int) -> Iterator[tuple[float, float]]:
    """`count` places behind the raster's start; a job of another size has other rows, on the same field."""
    row_mm = min(0.04, 160.0 * COLUMNS / count)
    for k in range(1, count + 1):
        row, column = divmod(k, COLUMNS + 1)
        across = COLUMNS - column if row % 2 else column
        yield LEFT_MM + across * STEP_MM, LOWEST_MM + row * row_mm


def lit(head: tuple[str, ...], lines: Iterator[str], tail: tuple[str, ...] = ("LASER OFF",)) -> Iterator[str]:
    """A job of one mark that begins where the raster does."""
    yield from (*head, f"JUMP X {LEFT_MM:g} Y {LOWEST_MM:g}", "LASER ON")
    yield from lines
    yield from tail


def plain(count: int) -> Iterator[str]:
    """LINE X x Y y."""
    return lit(POWERED, (f"LINE X {x:.3f} Y {y:.3f}" for x, y in points(count)))


def comments(count: int) -> Iterator[str]:
    """A comment on every line."""
    text = "; pixel {} of the part, 50 %"
    return lit(POWERED, (f"LINE X {x:.3f} Y {y:.3f} {text.format(k)}" for k, (x, y) in enumerate(points(count))))


def frame(count: int) -> Iterator[str]:
    """A FRAME around all of it."""
    head = (*POWERED, "FRAME SHIFT X 1 Y 2 ROTATE 30 SCALE 0.5")
    return lit(head, (f"LINE X {x:.3f} Y {y:.3f}" for x, y in points(count)), ("LASER OFF", "END"))


def relative(count: int) -> Iterator[str]:
    """The same path under COORDS REL."""

    def lines() -> Iterator[str]:
        yield "COORDS REL"
        before = (LEFT_MM, LOWEST_MM)
        for x, y in points(count):
            yield f"LINE X {x - before[0]:.3f} Y {y - before[1]:.3f}"
            before = x, y

    return lit(POWERED, lines())


def pulses(count: int) -> Iterator[str]:
    """The same path under UNITS PULSE."""
    speeds = ("JUMPVEL 5000", "JUMPACC 500", "VEL 800", "ACC 100")
    yield from ("UNITS PULSE", HEAD[0], *speeds, "LASER POWER 50")
    yield from (f"JUMP X {LEFT_MM * 1000:.0f} Y {LOWEST_MM * 1000:.0f}", "LASER ON")
    yield from (f"LINE X {x * 1000:.0f} Y {y * 1000:.0f}" for x, y in points(count))
    yield "LASER OFF"


def glued(count: int) -> Iterator[str]:
    """Words without blanks between."""
    return lit(POWERED, (f"LINE X{x:.3f}Y{y:.3f}" for x, y in points(count)))


def suffixes(count: int) -> Iterator[str]:
    """Units on the numbers."""
    return lit(POWERED, (f"LINE X {x:.3f}mm Y {y:.3f}mm" for x, y in points(count)))


def velocities(count: int) -> Iterator[str]:
    """VEL in every LINE."""
    return lit(POWERED, (f"LINE X {x:.3f} Y {y:.3f} VEL {500 + k % 300}" for k, (x, y) in enumerate(points(count))))


def dashes(count: int) -> Iterator[str]:
    """JUMP, ON, two LINEs, OFF; `count` statements of these."""
    yield from POWERED
    for x, y in points(count // 5):
        yield f"JUMP X {x:.3f} Y {y:.3f}"
        yield "LASER ON"
        yield f"LINE X {x + 0.3:.3f} Y {y:.3f}"
        yield f"LINE X {x + 0.5:.3f} Y {y:.3f}"
        yield "LASER OFF"


def channels(count: int) -> Iterator[str]:
    """Two lasers in two modes, a power for each before every second LINE."""

    def lines() -> Iterator[str]:
        yield "LASER ON CHANNEL 1"
        for k, (x, y) in enumerate(points(count // 2)):
            if k % 2 == 0:
                yield f"LASER POWER {5 + k % 900 / 10:.1f}"
                yield f"LASER POWER {1 + k % 800 / 100:.2f} CHANNEL 1"
            yield f"LINE X {x:.3f} Y {y:.3f}"

    return lit((*POWERED[:-1], "LASER MODE ANALOG CHANNEL 1"), lines(), ("LASER OFF", "LASER OFF CHANNEL 1"))


def expressions(count: int) -> Iterator[str]:
    """A sum with a name in every number."""
    head = (*POWERED, "LET ox = 1.25", "LET oy = -2.5")
    return lit(head, (f"LINE X (ox+{x:.3f}) Y (oy+{y:.3f})" for x, y in points(count)))


# Loops and routines, and the flat text of the same path.

TURN_DEG, GROWTH_MM, INNER_MM = 1.7, 60.0, 10.0
DOTS = 400


def spiral_flat(rounds: int) -> Iterator[str]:
    """A spiral outwards, a LINE for each round."""
    yield from (*POWERED, f"JUMP X {INNER_MM:g} Y 0", "LASER ON")
    for k in range(1, rounds + 1):
        radius, angle = INNER_MM + k * GROWTH_MM / rounds, math.radians(k * TURN_DEG)
        yield f"LINE X {radius * math.cos(angle):.4f} Y {radius * math.sin(angle):.4f}"
    yield "LASER OFF"


def spiral_for(rounds: int) -> Iterator[str]:
    """The spiral by one FOR."""
    radius = f"({INNER_MM:g} + k*{GROWTH_MM / rounds!r})"
    yield from (*POWERED, f"JUMP X {INNER_MM:g} Y 0", "LASER ON", f"FOR k FROM 1 TO {rounds} STEP 1")
    yield f"LINE X ({radius}*cos(k*{TURN_DEG})) Y ({radius}*sin(k*{TURN_DEG}))"
    yield from ("END", "LASER OFF")


def spiral_let(rounds: int) -> Iterator[str]:
    """The spiral by a loop that carries its radius from round to round."""
    yield from (*POWERED, f"JUMP X {INNER_MM:g} Y 0", "LASER ON")
    yield from (f"LET r = {INNER_MM:g}", f"REPEAT {rounds} AS k", f"LET r = r + {GROWTH_MM / rounds!r}")
    yield from (f"LINE X (r*cos((k+1)*{TURN_DEG})) Y (r*sin((k+1)*{TURN_DEG}))", "END", "LASER OFF")


def dots_flat(calls: int) -> Iterator[str]:
    """Short dashes on a grid, four statements each."""
    yield from POWERED
    for k in range(calls):
        x, y = -100 + k % DOTS * 0.5, -100 + k // DOTS * 0.5
        yield from (f"JUMP X {x:.2f} Y {y:.2f}", "LASER ON", f"LINE X {x + 0.3:.2f}", "LASER OFF")


ROUTINE = ("DEF dash(x, y)", "JUMP X (x) Y (y)", "LASER ON", "LINE X (x+0.3)", "LASER OFF", "END")


def dots_for(calls: int) -> Iterator[str]:
    """The grid by a FOR around a CALL."""
    yield from (*POWERED, *ROUTINE, f"FOR k FROM 0 TO {calls - 1} STEP 1")
    yield from (f"CALL dash(-100 + k % {DOTS}*0.5, -100 + floor(k/{DOTS})*0.5)", "END")


def dots_calls(calls: int) -> Iterator[str]:
    """The grid by a CALL for each dash."""
    yield from (*POWERED, *ROUTINE)
    yield from (f"CALL dash({-100 + k % DOTS * 0.5:.2f}, {-100 + k // DOTS * 0.5:.2f})" for k in range(calls))


@dataclass(frozen=True, slots=True, kw_only=True)
class Shape:
    """A kind of job. `size`: its argument, as a part of the bench's size; `base`: what it is compared with."""

    write: Callable[[int], Iterator[str]]
    base: str
    size: float = 1.0
    slow: float = SLOW
    as_call: Callable[[int, str], str] | None = None
    """How a call is written, with its number: the file is not the job but the listing that it compiles to."""


SHAPES: dict[str, Shape] = {
    "comments": Shape(write=comments, base="plain"),
    "frame": Shape(write=frame, base="plain"),
    "relative": Shape(write=relative, base="plain"),
    "pulse": Shape(write=pulses, base="plain"),
    "glued": Shape(write=glued, base="plain"),
    "suffixes": Shape(write=suffixes, base="plain"),
    "velocities": Shape(write=velocities, base="plain"),
    "dashes": Shape(write=dashes, base="plain"),
    "channels": Shape(write=channels, base="plain"),
    "expressions": Shape(write=expressions, base="plain"),
    "listing": Shape(write=plain, base="plain", slow=SLOW_LISTING, as_call=lambda number, call: f"{call}\n"),
    "listing-crlf": Shape(write=plain, base="plain", as_call=lambda number, call: f"{call};\r\n"),
    "listing-comments": Shape(
        write=plain, base="plain", as_call=lambda number, call: f'{call}; // 07.10. it\'s "call" {number:07}\n'
    ),
    "listing-recorded": Shape(
        write=plain, base="plain", as_call=lambda number, call: f"[{number * 0.1:.1f}] {call} = 0\n"
    ),
    "for": Shape(write=spiral_for, base="spiral", size=0.3, slow=SLOW_LOOP),
    "let": Shape(write=spiral_let, base="spiral", size=0.3, slow=SLOW_LOOP),
    "routine-for": Shape(write=dots_for, base="dots", size=0.1, slow=SLOW_LOOP),
    "routine-calls": Shape(write=dots_calls, base="dots", size=0.1, slow=SLOW_LOOP),
}
BASES: dict[str, Shape] = {
    "plain": Shape(write=plain, base=""),
    "spiral": Shape(write=spiral_flat, base="", size=0.3),
    "dots": Shape(write=dots_flat, base="", size=0.1),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class File:
    """A file to be timed."""

    path: Path
    lines: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """The figures of a command on a shape and, from between those runs, on its base."""

    name: str
    command: str
    lines: int
    runs: list[Run]
    base: list[Run]


def seconds(runs: list[Run]) -> float:
    """The median."""
    return statistics.median(one.seconds for one in runs)


def peak(runs: list[Run]) -> float | None:
    """The highest memory of some runs, None where the system does not tell it."""
    known = [one.peak_mb for one in runs if one.peak_mb is not None]
    return max(known) if known else None


def make_file(name: str, shape: Shape, size: int, folder: Path) -> File:
    """Write a shape's file and see that `check --strict` finds nothing in it (but a listing's note on its FIFO)."""
    path = folder / f"{name}.job"
    lines = write_job(path, shape.write(round(size * shape.size)))
    if shape.as_call is not None:
        compiled, listing = path.with_suffix(".compiled.gts"), path.with_suffix(".gts")
        run(gusjob("compile", "-o", compiled.name, path.name), folder)
        with compiled.open() as calls, listing.open("w", newline="") as file:
            for lines, call in enumerate(calls, start=1):
                file.write(shape.as_call(lines, call.rstrip()))
        path.unlink()
        compiled.unlink()
        path = listing
    run(gusjob("check", path.name), folder)
    return File(path=path, lines=lines)


def measure(name: str, file: File, base: File, command: str, runs: int) -> Row:
    """Base and shape in turn, so that a slow minute hits both alike."""
    row = Row(name=name, command=COMMANDS[command], lines=file.lines, runs=[], base=[])
    for _ in range(runs):
        row.base.append(run_gusjob(base.path, row.command))
        row.runs.append(run_gusjob(file.path, row.command))
        print(f"  {command}: {row.base[-1].seconds:.2f} s, {row.runs[-1].seconds:.2f} s", file=sys.stderr, flush=True)
    return row


def marks(row: Row) -> str:
    """What is above its limit."""
    ratio, most_mb = seconds(row.runs) / seconds(row.base), peak(row.runs)
    slow = ratio > SHAPES[row.name].slow
    return ", ".join(["slow"] * slow + ["memory"] * (most_mb is not None and most_mb > MUCH_MB))


def table(rows: list[Row]) -> list[str]:
    """A row for each shape and command."""
    header = ["shape", "command", "lines", "seconds", "min", "base", "base s", "ratio", "peak MB", "base MB", "above"]
    cells = []
    for row in rows:
        peaks = ["-" if mb is None else f"{mb:.0f}" for mb in (peak(row.runs), peak(row.base))]
        mine, base = seconds(row.runs), seconds(row.base)
        least = min(one.seconds for one in row.runs)
        times = [f"{mine:.2f}", f"{least:.2f}", SHAPES[row.name].base, f"{base:.2f}", f"{mine / base:.2f}"]
        cells.append([row.name, row.command, f"{row.lines:,}", *times, *peaks, marks(row)])
    return markdown(header, cells, texts={0, 1, 5, 10})


def size_of(text: str) -> int:
    """Reads the size."""
    if (size := int(text.replace("_", ""))) < SMALLEST:
        raise argparse.ArgumentTypeError(f"a size is at least {SMALLEST}")
    return size


def main() -> None:
    """Make each shape's file, time it, print the table."""
    parser = argparse.ArgumentParser(description="Time gusjob on jobs of many shapes, each beside a plain one.")
    parser.add_argument("--size", type=size_of, default=SIZE, help="statements of the plain job (%(default)s)")
    parser.add_argument("--runs", type=run_count, default=3, help="runs of each shape and of its base (%(default)s)")
    parser.add_argument("--commands", type=one_of(COMMANDS), default="check", help=f"which of {','.join(COMMANDS)}")
    every = ",".join(SHAPES)
    parser.add_argument("--shapes", type=one_of(SHAPES), default=every, help="which of %(default)s")
    parser.add_argument("--output", type=Path, help="write the table to this file too")
    options = parser.parse_args()
    rows: list[Row] = []
    with tempfile.TemporaryDirectory(prefix="gusjob-bench-") as temporary:
        folder = Path(temporary)
        bases: dict[str, File] = {}
        for name in options.shapes:
            print(f"{name} ...", file=sys.stderr, flush=True)
            shape = SHAPES[name]
            if shape.base not in bases:
                bases[shape.base] = make_file(shape.base, BASES[shape.base], options.size, folder)
            file = make_file(name, shape, options.size, folder)
            rows += [measure(name, file, bases[shape.base], command, options.runs) for command in options.commands]
            file.path.unlink()
    text = "\n".join([f"Median of {options.runs}; base and shape in turn.", "", *table(rows), ""])
    print(text)
    if options.output:
        options.output.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
