"""Jobs and readers for tests of the VCD file and of the table of ticks; closed forms of their edges."""

from __future__ import annotations

import io
from bisect import bisect_right
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise, zip_longest
from math import ceil, floor
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
TICK = F(1, 4)
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


def pulses(begin: F, finish: F, steps: list[tuple[F, F]], width: F) -> Spans:
    """Low parts in frequency mode: a pulse at each whole phase; `steps`: moment, kHz."""
    starts: list[F] = []
    phase = F(0)
    for (at, khz), (after, _) in pairwise([(begin, steps[0][1]), *steps[1:], (finish, F(0))]):
        while khz and len(starts) < phase + khz * (after - at):
            starts.append(at + (len(starts) - phase) / khz)
        phase += khz * (after - at)
    return [(s, min(s + width, after)) for s, after in pairwise([*starts, finish])]


def at_ticks(since: F, until: F) -> list[F]:
    """When held power is sampled from a call on."""
    return [since, *(k * TICK for k in range(floor(since / TICK) + 1, ceil(until / TICK)))]


def held(since: F, until: F, value: Callable[[F], F]) -> Callable[[F], F]:
    """Power that is sampled at a call and at the ticks."""
    moments = at_ticks(since, until)
    return lambda t: value(moments[bisect_right(moments, t) - 1])


def trapezoid(since: F, length: F, vel: F, acc: F) -> tuple[F, Callable[[F], F]]:
    """When a motion from rest to rest ends, and its velocity."""
    until = since + vel / acc + length / vel
    return until, lambda t: max(F(0), min(acc * (t - since), vel, acc * (until - t)))


FREQUENCY = HEAD + "LASER MODE FREQUENCY WIDTH {}\n"
GTS = "GT_SetAxisMode(7,1)\nGT_LaserPowerMode({},0)\n{}GT_CrdClear(1,0)\nGT_BufLaserPrfCmd(1,5,0,0)\n"
GO = "GT_BufDelay(1,1,0)\nGT_BufLaserOn(1,0,0)\nGT_BufDelay(1,2,0)\nGT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"
FOLLOW = "ACC 1\nLASER FOLLOW RATIO 3 MIN {} MAX 40\nLASER ON\nLINE X 200\nLASER OFF\nDWELL 1\n"
BOTH = (
    "LASER MODE ANALOG CHANNEL 1\nLASER PREVOLT 0.5 CHANNEL 1\nLASER DELAY ON 0 OFF 450 CHANNEL 1\n"
    "LASER POWER 7 CHANNEL 1\nLASER ON CHANNEL 1\nDWELL 1\nLASER FOLLOW RATIO 0.5 MIN 1 MAX 4 CHANNEL 1\n"
    "LINE X 99\nLASER OFF CHANNEL 1\n"
)
JOBS = {
    "duty": DUTY.format(30) + "LASER DELAY ON 3 OFF 17\n" + LIT.format(37, 3) + LIT.format(99, 2),
    "follow": DUTY.format(20) + FOLLOW.format(5),
    "frequency": FREQUENCY.format(20) + LIT.format(7, 2) + FOLLOW.format(1).replace("RATIO 3", "RATIO 2.9"),
    "analog": HEAD + "LASER MODE ANALOG\nLASER PREVOLT 1\n" + LIT.format(3, 1) + FOLLOW.format(2).replace("40", "9"),
    "fpk": DUTY.format(10) + "LASER FPK WIDTH 1700 GAP 333 OFFDELAY 50\n" + LIT.format(30, 2) + LIT.format(70, 3),
    "standby": DUTY.format(7) + "LASER STANDBY FREQ 11 DUTY 30\n" + LIT.format(50, 2) + "WAIT\n" + LIT.format(9, 1),
    "duty 2": HEAD + "LASER MODE DUTY2 CARRIER 3\n" + LIT.format(30, 3),
    "both": DUTY.format(10) + "LASER STANDBY FREQ 3 DUTY 30\n" + BOTH + LIT.format(20, 2) + "WAIT\n"
    + LIT.format(30, 1),
    "modes": DUTY.format(10) + LIT.format(50, 1) + "LASER MODE ANALOG\n" + LIT.format(3, 1)
    + "LASER MODE FREQUENCY WIDTH 10\n" + LIT.format(5, 2),
}  # fmt: skip


def whole(text: str, *options: str, name: str = "x.job") -> bytes:
    done = run(text, *options, name=name)
    assert done.exit_code == 0, done.stderr
    return done.stdout_bytes
