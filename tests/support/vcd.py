"""VCD files in tests: run `gusjob trace`, read the file with two readers that are not ours, compare."""

from __future__ import annotations

import io
from bisect import bisect_right
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise, zip_longest
from math import ceil
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from click.testing import CliRunner, Result
from vcd.reader import RealChange, ScalarChange, TokenKind, VarDecl, VectorChange, tokenize

from gusjob.cli import cli

vcdvcd = pytest.importorskip("vcdvcd")
F = Fraction
HEAD = "UNITS PULSE\nLOOKAHEAD OFF\nVEL 10\nACC 10\n"
DUTY = HEAD + "LASER MODE DUTY CARRIER {}\n"
LIT = "LASER POWER {}\nDWELL 1\nLASER ON\nDWELL {}\nLASER OFF\nDWELL 1\n"
NS = 10**6
HALF = F(1, 2) + F(1, 10**4)
"""A moment half way between two ns may go to either."""
Spans = list[tuple[F, F]]


@dataclass(frozen=True)
class Wave:
    """What a file says: (ns, value) by signal."""

    signals: dict[str, list[tuple[int, object]]]
    end: int

    def spans(self, name: str, value: object = "0") -> list[tuple[int, int]]:
        """When a signal has a value."""
        changes = [*self.signals[name], (self.end, None)]
        return [(t, after) for (t, v), (after, _) in pairwise(changes) if v == value]

    def between(self, start: int, end: int) -> dict[str, list[tuple[int, object]]]:
        """The signals in [start, end] ns, as a file of that piece alone would have them."""
        piece = {}
        for name, changes in self.signals.items():
            now = bisect_right([t for t, _ in changes], start) - 1
            piece[name] = [(start, changes[now][1]), *((t, v) for t, v in changes[now + 1 :] if t <= end)]
        return piece


def run(text: str, *options: str, name: str = "x.job") -> Result:
    with TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_text(text, encoding="utf-8")
        return CliRunner().invoke(cli, ["trace", str(path), *options], catch_exceptions=False)


def off(got: Iterable[object], want: Iterable[object]) -> list[tuple[object, object]]:
    """The first entries that differ; pytest itself would compare long lists for minutes."""
    return [(a, b) for a, b in zip_longest(got, want) if a != b][:3]


def read(data: bytes) -> Wave:
    """Both readers find the same; time goes forward, a change changes something, - lines are opposite to +."""
    names: dict[str, str] = {}
    signals: dict[str, list[tuple[int, object]]] = {}
    times: list[int] = []
    for token in tokenize(io.BytesIO(data)):
        if token.kind is TokenKind.CHANGE_TIME:
            times.append(token.time_change)
        elif isinstance(token.data, VarDecl):
            names[token.data.id_code] = token.data.reference
            signals[token.data.reference] = []
        elif isinstance(token.data, ScalarChange | RealChange | VectorChange):
            signals[names[token.data.id_code]].append((times[-1], token.data.value))
    other = vcdvcd.VCDVCD(vcd_string=data.decode())
    assert other.timescale["timescale"] == vcdvcd.vcdvcd.Decimal("1e-9")
    for name, changes in signals.items():
        as_read: Callable[[str], object] = float if name[0] == "A" or name == "line" else str
        assert off([(t, as_read(text)) for t, text in other[f"outputs.{name}"].tv], changes) == [], name
        assert all(a[1] != b[1] and a[0] < b[0] for a, b in pairwise(changes)), name
        if name.endswith("-"):
            opposite = {"0": "1", "1": "0", "x": "x"}
            assert off([(t, opposite[str(v)]) for t, v in changes], signals[name[:-1] + "+"]) == [], name
    assert all(a < b for a, b in pairwise(times))
    return Wave(signals, times[-1])


def wave(text: str, *options: str, name: str = "x.job", code: int = 0) -> Wave:
    done = run(text, *options, name=name)
    assert done.exit_code == code, done.stderr
    return read(done.stdout_bytes)


def same(got: list[tuple[int, int]], want: Iterable[tuple[F, F]]) -> None:
    """Spans in ns against exact ones; spans that meet are one."""
    exact: Spans = []
    for start, end in want:
        if exact and exact[-1][1] == start:
            exact[-1] = (exact[-1][0], end)
        elif start < end:
            exact.append((start, end))
    wrong = [
        (found, float(begin), float(end))
        for found, (begin, end) in zip(got, exact, strict=False)
        if max(abs(found[0] - begin * NS), abs(found[1] - end * NS)) > HALF
    ]
    assert (len(got), wrong[:3]) == (len(exact), []), (got[:3], [(float(a), float(b)) for a, b in exact[:3]])


def periods(begin: F, finish: F, khz: F, duty: Callable[[F], F]) -> Spans:
    """Low parts of a carrier while emitting: from its start on, each with the duty it began with, cut by its end."""
    starts = [begin + k / khz for k in range(ceil((finish - begin) * khz))]
    return [(s, min(s + duty(s) / 100 / khz, finish)) for s in starts]


FREQUENCY = HEAD + "LASER MODE FREQUENCY WIDTH {}\n"
GTS = "GT_SetAxisMode(7,1)\nGT_LaserPowerMode({},0)\n{}GT_CrdClear(1,0)\nGT_BufLaserPrfCmd(1,5,0,0)\n"
GO = "GT_BufDelay(1,1,0)\nGT_BufLaserOn(1,0,0)\nGT_BufDelay(1,2,0)\nGT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"
