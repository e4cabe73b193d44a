"""Time whole gusjob commands on generated jobs, beside plain lark reading the same text line by line.

Run by hand: python tests/bench/commands.py --help. README.md in this folder says how to read the tables.

This process stays small on purpose: it streams the jobs to disk and imports neither numpy nor gusjob. On Linux the peak
memory of a child never reads lower than that of the process that started it.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from importlib.metadata import version
from itertools import islice
from pathlib import Path
from typing import Any

GRAMMAR = Path(__file__).resolve().parents[2] / "grammar" / "job.lark"
PERIOD_US = 10.0
PROFILE = f'name = "bench"\nperiod_us = {PERIOD_US:g}\n'
DEFAULT_SIZES = "1000,10000,100000,1000000,3000000"
SMALLEST = 20
CHUNK_LINES = 20_000
LARK_LINES = 100_000
"""Plain lark reads at most so many lines; beyond, its time is scaled."""

COMMANDS: dict[str, tuple[str, ...]] = {
    "check": ("check", "{job}"),
    "report --summary": ("report", "--summary", "{job}"),
    "report json": ("report", "--format", "json", "-o", "{out}", "{job}"),
    "compile": ("compile", "--format", "gts", "-o", "{out}", "{job}"),
}
SHORT = {"check": "check", "summary": "report --summary", "json": "report json", "compile": "compile", "lark": "lark"}
HIDDEN = "lark-lines"


# The jobs. VEL and the lengths are chosen together: 50 ticks of 10 us a statement, 50 million for a million of them.

HEAD = ("LASER MODE DUTY CARRIER 10", "JUMPVEL 5000", "JUMPACC 500000")
RADIUS_MM = 99.0
STEP_MM = 0.2
PITCH_MM = 0.15
RIPPLE_MM = 0.25
RIPPLE_LENGTH_MM = 12.0
PIXEL_MM = 0.8
PIXELS = 250
ROW_MM = 0.1


def lines_job(count: int) -> Iterator[str]:
    """`count` statements: a spiral inwards, in steps of 0.2 mm, under velocity follow.

    A ripple along the path gives look-ahead, and with it the power, something to do at every size (265..500 mm/s). The
    pitch shrinks where the disc would else be too small; the innermost tenth of its area stays free.
    """
    speed = ("VEL 500", "ACC 100000", "LASER POWER 50", f"JUMP X {RADIUS_MM:.3f} Y 0")
    head = (*HEAD, *speed, "LASER ON", "LASER FOLLOW MIN 5 MAX 90 AT 1000mm/s")
    lines = count - len(head) - 1
    pitch = min(PITCH_MM, 0.9 * math.pi * RADIUS_MM**2 / (lines * STEP_MM))
    yield from head
    for k in range(1, lines + 1):
        radius = math.sqrt(RADIUS_MM**2 - k * STEP_MM * pitch / math.pi)
        angle = math.tau * (RADIUS_MM - radius) / pitch
        radius += RIPPLE_MM * math.sin(math.tau * k * STEP_MM / RIPPLE_LENGTH_MM)
        yield f"LINE X {radius * math.cos(angle):.3f} Y {radius * math.sin(angle):.3f}"
    yield "LASER OFF"


def raster_job(count: int) -> Iterator[str]:
    """`count` statements: a power for each pixel of 0.8 mm, rows to and fro, at most 0.1 mm apart."""
    head = (*HEAD, "VEL 800", "ACC 1000000", "LASER POWER 50", "JUMP X -100 Y -100", "LASER ON")
    body = count - len(head) - 1
    row_mm = min(ROW_MM, PIXEL_MM * PIXELS / (body // 2 // (PIXELS + 1) + 1))
    yield from head
    for k in range(body):
        row, column = divmod(k // 2 + 1, PIXELS + 1)
        if k % 2 == 0:
            yield f"LASER POWER {5 + (column * 37 + row * 11) % 900 / 10:.1f}"
        else:
            across = PIXELS - column if row % 2 else column
            yield f"LINE X {-100 + across * PIXEL_MM:.3f} Y {-100 + row * row_mm:.3f}"
    yield "LASER OFF"


def distance_job(count: int) -> Iterator[str]:
    """The spiral of `lines_job` under distance follow: more power the farther from the centre."""
    lines = (line for line in lines_job(count) if not line.startswith("LASER FOLLOW"))
    yield next(lines)
    yield "LASER DISTANCE REF X 0 Y 0 RATIO X 0.1 Y 0.1 MIN 5 MAX 90"
    yield from lines


def sky_job(count: int) -> Iterator[str]:
    """`count` statements: marks of 0.8 mm with sky writing, at most 0.1 mm apart in rows to and fro."""
    speeds = ("JUMPVEL 5000", "JUMPACC 1000000", "VEL 1000", "ACC 1000000")
    head = (HEAD[0], *speeds, "LASER POWER 50", "SKYWRITE MODE 2 TIMELAG 250us")
    rest = (count - len(head)) % 4
    marks = (count - len(head)) // 4
    row_mm = min(ROW_MM, 200 / (marks // (PIXELS // 2) + 1))
    yield from head
    for k in range(marks):
        row, column = divmod(k, PIXELS // 2)
        across = 2 * PIXEL_MM * (PIXELS // 2 - 1 - column if row % 2 else column)
        x, y = -100 + across + (PIXEL_MM if row % 2 else 0), -100 + row * row_mm
        yield f"JUMP X {x:.3f} Y {y:.3f}"
        yield "LASER ON"
        yield f"LINE X {x + (-PIXEL_MM if row % 2 else PIXEL_MM):.3f}"
        yield "LASER OFF"
    yield from ("DWELL 1",) * rest


def ten_job(count: int) -> Iterator[str]:
    """A job of ten lines, whatever `count` says: what start-up costs."""
    yield from ("LASER MODE DUTY CARRIER 10", "VEL 1000", "ACC 100000", "LASER POWER 50", "LASER ON")
    yield from ("LINE X 10 Y 0", "LINE X 10 Y 10", "LINE X 0 Y 10", "LINE X 0 Y 0", "LASER OFF")


KINDS: dict[str, Callable[[int], Iterator[str]]] = {
    "ten": ten_job,
    "lines": lines_job,
    "raster": raster_job,
    "distance": distance_job,
    "sky": sky_job,
}


def write_job(path: Path, statements: Iterator[str]) -> int:
    """Write a job in chunks; returns its number of statements."""
    written = 0
    with path.open("w", encoding="utf-8", newline="\n") as file:
        while chunk := list(islice(statements, CHUNK_LINES)):
            file.write("\n".join(chunk) + "\n")
            written += len(chunk)
    return written


# Running and measuring.


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One run of one command. `peak_mb` and `user_s` (CPU time) are None where the system does not tell them."""

    seconds: float
    peak_mb: float | None
    user_s: float | None
    output: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """A generated job. `ticks`: its duration in controller periods."""

    kind: str
    path: Path
    statements: int
    megabytes: float
    ticks: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """The figures of one command on one job. `scaled`: measured on the first lines only, then multiplied."""

    job: Job
    command: str
    median_s: float
    min_s: float
    peak_mb: float | None
    scaled: bool = False


def run(command: list[str], folder: Path, checkout: Path | None = None) -> Run:
    """Run a command to its end, in `folder`; a failure ends the bench with what the command said.

    `checkout`: where gusjob is imported from, None for what is installed.
    """
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    if checkout is not None:
        environment["PYTHONPATH"] = str(checkout)
    with tempfile.TemporaryFile(dir=folder) as out:
        start = time.perf_counter()
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.STDOUT, cwd=folder, env=environment
        )
        peak_mb, user_s, code = _wait(process)
        seconds = time.perf_counter() - start
        out.seek(0)
        output = out.read(100_000).decode("utf-8", errors="replace")
    if code != 0:
        sys.exit(f"{' '.join(command)}\nended with {code}:\n{output}")
    return Run(seconds=seconds, peak_mb=peak_mb, user_s=user_s, output=output)


def _wait(process: subprocess.Popen[bytes]) -> tuple[float | None, float | None, int]:
    """Wait for a child: its peak memory in MB (getrusage would give the largest child so far), CPU time, exit code."""
    if sys.platform == "win32":
        return None, None, process.wait()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    per_mb = 1e6 if sys.platform == "darwin" else 1e6 / 1024
    return usage.ru_maxrss / per_mb, usage.ru_utime, process.returncode


def gusjob(*words: str) -> list[str]:
    """The command line of gusjob, in this Python."""
    return [sys.executable, "-m", "gusjob", *words]


def make_job(kind: str, size: int, folder: Path) -> Job:
    """Generate a job, see that `check` finds no error in it, and count its ticks."""
    path = folder / f"{kind}_{size}.job"
    statements = write_job(path, KINDS[kind](size))
    if kind != "ten" and statements != size:
        sys.exit(f"{path.name}: {statements} statements instead of {size}")
    run(gusjob("check", path.name), folder)
    totals = folder / "totals.json"
    run(gusjob("report", "--summary", "--format", "json", "-o", totals.name, path.name), folder)
    duration_ms = json.loads(totals.read_text(encoding="utf-8"))["totals"]["duration_ms"]
    megabytes = path.stat().st_size / 1e6
    ticks = duration_ms * 1000 / PERIOD_US
    return Job(kind=kind, path=path, statements=statements, megabytes=megabytes, ticks=ticks)


def run_gusjob(path: Path, name: str, checkout: Path | None = None) -> Run:
    """One run of a gusjob command on a file; what it writes is deleted. `checkout`: as in `run`."""
    out = path.with_name("out.tmp")
    words = [word.format(job=path.name, out=out.name) for word in COMMANDS[name]]
    done = run(gusjob(*words), path.parent, checkout)
    out.unlink(missing_ok=True)
    return done


def run_lark(job: Job) -> Run:
    """One run of plain lark on a job: start-up as it is, the lines' time scaled if not all of them were read."""
    done = run([sys.executable, str(Path(__file__).resolve()), HIDDEN, job.path.name], job.path.parent)
    told = json.loads(done.output)
    return replace(done, seconds=done.seconds + told["seconds"] * (job.statements / told["lines"] - 1))


def measure(job: Job, commands: list[str], runs: int) -> list[Row]:
    """Run the commands on a job, all of them in turn, `runs` times over, so that a slow minute hits all alike."""
    done: dict[str, list[Run]] = {command: [] for command in commands}
    for command in [*commands] * runs:
        one = run_lark(job) if command == "lark" else run_gusjob(job.path, command)
        done[command].append(one)
        print(f"  {command}: {one.seconds:.2f} s", file=sys.stderr, flush=True)
    return [_row(job, command, runs_of) for command, runs_of in done.items()]


def _row(job: Job, command: str, done: list[Run]) -> Row:
    seconds = [run.seconds for run in done]
    peaks = [run.peak_mb for run in done if run.peak_mb is not None]
    return Row(
        job=job,
        command=command,
        median_s=statistics.median(seconds),
        min_s=min(seconds),
        peak_mb=max(peaks) if peaks else None,
        scaled=command == "lark" and job.statements > LARK_LINES,
    )


# The yardstick.


def lark_lines(path: Path) -> None:
    """Parse the first lines of a job one by one with nothing but lark and the grammar; print lines and seconds."""
    from lark import Lark, Token, Transformer

    class Pairs(Transformer[Token, Any]):
        """(name, value) tuples, as cheaply as lark can make them."""

        def value(self, children: list[Token]) -> float | str:
            """A number; the text where a unit is glued on."""
            text = "".join(children)
            try:
                return float(text)
            except ValueError:
                return text

        def word(self, children: list[Any]) -> tuple[str, Any]:
            """A keyword and its number."""
            return children[0].type, children[-1]

        def __getattr__(self, rule: str) -> Callable[[list[Any]], tuple[str, Any]]:
            """Every other rule: its name and its children. No callback for `_rules` and terminals."""
            if rule.startswith("_") or not rule.islower():
                raise AttributeError(rule)
            return lambda children: (rule, tuple(children))

    grammar = GRAMMAR.read_text(encoding="utf-8")
    parser = Lark(grammar, parser="lalr", lexer="basic", maybe_placeholders=False, transformer=Pairs())
    with path.open(encoding="utf-8") as file:
        lines = [line.rstrip("\n") for line in islice(file, LARK_LINES)]
    start = time.perf_counter()
    for line in lines:
        parser.parse(line)
    print(json.dumps({"lines": len(lines), "seconds": time.perf_counter() - start}))


# The tables.


def markdown(header: list[str], rows: list[list[str]], texts: set[int]) -> list[str]:
    """A markdown table, padded to be read as plain text; the columns in `texts` stand left, numbers right."""
    widths = [max(len(row[i]) for row in [header, *rows]) for i in range(len(header))]

    def line(cells: list[str]) -> str:
        pairs = zip(cells, widths, strict=True)
        return "| " + " | ".join(c.ljust(w) if i in texts else c.rjust(w) for i, (c, w) in enumerate(pairs)) + " |"

    rule = "|" + "|".join("-" * (w + 2) if i in texts else "-" * (w + 1) + ":" for i, w in enumerate(widths)) + "|"
    return [line(header), rule, *map(line, rows)]


def lark_ratio(row: Row, rows: list[Row]) -> float | None:
    """How many times as long plain lark takes for the same job; None if it was not run."""
    found = (r.median_s for r in rows if r.command == "lark" and r.job is row.job)
    return next((seconds / row.median_s for seconds in found), None)


def main_table(rows: list[Row]) -> list[str]:
    """Every figure: one row for each job and command."""
    header = ["kind", "statements", "MB", "ticks", "command", "seconds", "min", "statements/s", "peak MB", "lark/this"]
    cells = []
    for row in rows:
        mark = "~" if row.scaled else ""
        ratio = lark_ratio(row, rows)
        cells.append(
            [
                row.job.kind,
                f"{row.job.statements:,}",
                f"{row.job.megabytes:.2f}",
                f"{row.job.ticks:,.0f}",
                row.command,
                f"{mark}{row.median_s:.2f}",
                f"{mark}{row.min_s:.2f}",
                f"{row.job.statements / row.median_s:,.0f}",
                "-" if row.peak_mb is None else f"{mark}{row.peak_mb:.0f}",
                "-" if ratio is None else f"{ratio:.1f}",
            ]
        )
    return markdown(header, cells, texts={0, 4})


def size_table(rows: list[Row], figure: Callable[[Row], str]) -> list[str]:
    """One figure for each kind and command, the sizes side by side."""
    rows = [row for row in rows if row.job.kind != "ten"]
    sizes = sorted({row.job.statements for row in rows})
    names = list(dict.fromkeys((row.job.kind, row.command) for row in rows))
    at = {(row.job.kind, row.command, row.job.statements): figure(row) for row in rows}
    cells = [[*name, *(at.get((*name, size), "-") for size in sizes)] for name in names]
    return markdown(["kind", "command", *(f"{size:,}" for size in sizes)], cells, texts={0, 1})


def result(rows: list[Row], runs: int) -> str:
    """All tables as markdown."""
    packages = ", ".join(f"{name} {version(name)}" for name in ("gusjob", "lark", "numpy"))
    python = f"{platform.python_implementation()} {platform.python_version()}"
    system = f"{platform.system()} {platform.machine()}, {os.cpu_count()} CPUs"
    out = [f"{packages}; {python}; {system}; median of {runs}; period {PERIOD_US:g} us.", "", *main_table(rows), ""]
    if any(row.scaled for row in rows):
        out += [
            f"~: lark read the first {LARK_LINES:,} lines only; time scaled to all of them, memory as measured.",
            "",
        ]
    big = [row for row in rows if row.job.kind != "ten"]
    if big:
        out += ["Seconds per million statements (start-up included):", ""]
        out += [*size_table(big, lambda row: f"{row.median_s / row.job.statements * 1e6:.2f}"), ""]
    ratios = {id(row): lark_ratio(row, rows) for row in big if row.command != "lark"}
    if any(ratio is not None for ratio in ratios.values()):
        own = [row for row in big if ratios.get(id(row)) is not None]
        out += ["Time of plain lark / time of the command:", ""]
        out += [*size_table(own, lambda row: f"{ratios[id(row)]:.1f}"), ""]
    return "\n".join(out)


# The command line.


def _sizes(text: str) -> list[int]:
    sizes = [int(word) for word in text.replace("_", "").split(",")]
    if min(sizes) < SMALLEST:
        raise argparse.ArgumentTypeError(f"a size is at least {SMALLEST}")
    return sizes


def one_of(known: dict[str, Any]) -> Callable[[str], list[str]]:
    """Reads names with commas between, all of them known."""

    def chosen(text: str) -> list[str]:
        names = text.split(",")
        wrong = [name for name in names if name not in known]
        if wrong:
            raise argparse.ArgumentTypeError(f"{wrong[0]!r} is none of {', '.join(known)}")
        return names

    return chosen


def run_count(text: str) -> int:
    """Reads a number of runs."""
    if (runs := int(text)) < 1:
        raise argparse.ArgumentTypeError("at least one run")
    return runs


def arguments(words: list[str]) -> argparse.Namespace:
    """The command line, read."""
    parser = argparse.ArgumentParser(description="Time whole gusjob commands on generated jobs, beside plain lark.")
    parser.add_argument("--sizes", type=_sizes, default=DEFAULT_SIZES, help="statements a job (%(default)s)")
    parser.add_argument("--runs", type=run_count, default=3, help="runs of each command (%(default)s)")
    every = ",".join(SHORT)
    parser.add_argument("--commands", type=one_of(SHORT), default=every, help="which of %(default)s")
    every = ",".join(KINDS)
    parser.add_argument("--kinds", type=one_of(KINDS), default=every, help="which of %(default)s")
    parser.add_argument("--output", type=Path, help="write the tables to this file too")
    return parser.parse_args(words)


def main(words: list[str]) -> None:
    """Run the bench, or, as its own child, the yardstick."""
    if words[:1] == [HIDDEN]:
        lark_lines(Path(words[1]))
        return
    options = arguments(words)
    jobs = [(kind, size) for kind in options.kinds for size in ([10] if kind == "ten" else options.sizes)]
    rows: list[Row] = []
    with tempfile.TemporaryDirectory(prefix="gusjob-bench-") as name:
        folder = Path(name)
        (folder / "gusjob.toml").write_text(PROFILE, encoding="utf-8")
        for kind, size in jobs:
            print(f"{kind} {size:,} ...", file=sys.stderr, flush=True)
            job = make_job(kind, size, folder)
            rows += measure(job, [SHORT[short] for short in options.commands], options.runs)
            job.path.unlink()
    text = result(rows, options.runs)
    print(text)
    if options.output:
        options.output.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
