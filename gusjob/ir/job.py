"""The IR of a job: setup statements as frozen dataclasses, the path as columns. Positions in pulse, not yet rounded."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from enum import IntEnum
from typing import Any

import numpy as np
import numpy.typing as npt

from gusjob.config.machine import Machine
from gusjob.controllers.gus.ranges import AUTO_SHARE, RUN_STEP_US, TIMELAG_OFF_US, TIMELAG_ZERO_US, PowerMode
from gusjob.diagnostics.model import CALLED, INCLUDED, NTH_ROUND, ROUND, Remark, Span
from gusjob.i18n.phrases import Phrase, number
from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.geometry import Arcs, arcs_by_either
from gusjob.kinematics.units import PowerUnit


class Op(IntEnum):
    """What a row of the path is. All rows up to DWELL take time; the others act in between."""

    LINE = 0
    JUMP = 1
    ARC_CENTRE = 2
    ARC_RADIUS = 3
    DWELL = 4
    POWER = 5
    FOLLOW = 6
    ON = 7
    OFF = 8

    @property
    def word(self) -> str:
        """As a user writes it."""
        return ("LINE", "JUMP", "ARC", "ARC", "DWELL", "LASER POWER", "LASER FOLLOW", "LASER ON", "LASER OFF")[self]


@dataclass(frozen=True, slots=True, kw_only=True)
class Path:
    """The path, one row a statement; all columns (n,), NaN (0 for whole numbers) where a row does not use one.

    x, y: end point, absolute, pulse; cx, cy: an arc's centre, absolute, pulse; radius: pulse of X, signed; ccw: an
    arc's direction; arc_in_mm: a circle in mm, not in pulses (told apart where the axes differ).

    vel, acc: pulse/ms, pulse/ms2 along an axis with X's pulses per mm; end: forced end velocity, NaN if none;
    vel_in_mm, acc_in_mm, end_in_mm: to be scaled by the segment's own direction where the axes differ; vel_line,
    acc_line: the line that set them. dwell_ms: whole.

    power: direct power; low, high, ratio: follow limits, and ratio per pulse/ms; follow_in_mm: the ratio hangs on
    mm; power_unit, low_unit, high_unit: PowerUnit as written.

    trail: by which calls and rounds the row came about, a number of the job's Trails.
    """

    op: npt.NDArray[np.uint8]
    line: npt.NDArray[np.int32]
    channel: npt.NDArray[np.int8]
    ccw: Bools
    arc_in_mm: Bools
    x: Floats
    y: Floats
    cx: Floats
    cy: Floats
    radius: Floats
    vel: Floats
    acc: Floats
    end: Floats
    vel_line: npt.NDArray[np.int32]
    acc_line: npt.NDArray[np.int32]
    vel_in_mm: Bools
    acc_in_mm: Bools
    end_in_mm: Bools
    dwell_ms: Floats
    power: Floats
    low: Floats
    high: Floats
    ratio: Floats
    follow_in_mm: Bools
    power_unit: npt.NDArray[np.int8]
    low_unit: npt.NDArray[np.int8]
    high_unit: npt.NDArray[np.int8]
    trail: npt.NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.op)

    @property
    def takes_time(self) -> Bools:
        """Rows that become motion or a dwell."""
        return self.op <= Op.DWELL

    @property
    def moves(self) -> Bools:
        """Rows that become motion."""
        return self.op < Op.DWELL


@dataclass(frozen=True, slots=True, kw_only=True)
class LaserMode:
    """LASER MODE: power limits in the mode's unit; carrier in duty modes, pulse width in frequency mode."""

    mode: PowerMode
    low: float
    high: float
    carrier_khz: float | None = None
    pulse_width_us: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LaserDelay:
    """LASER DELAY, by effect."""

    on_delay_us: float
    off_delay_us: float


@dataclass(frozen=True, slots=True, kw_only=True)
class LaserStandby:
    """LASER STANDBY: output while off, PWM modes; None: OFF."""

    pulse: tuple[float, float] | None
    """(kHz, %)"""


@dataclass(frozen=True, slots=True, kw_only=True)
class LaserPrevolt:
    """LASER PREVOLT: output while off, analog mode; None: OFF."""

    prevoltage_v: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class LaserFpk:
    """LASER FPK: (width, gap, off delay) in us; None: OFF."""

    times_us: tuple[float, float, float] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Distance:
    """Settings of LASER DISTANCE: reference in pulse, ratio in power units per mm, axes X Y Z A."""

    reference_pulse: tuple[float, float, float, float]
    ratio_per_mm: tuple[float, float, float, float]
    low: float
    high: float
    low_unit: PowerUnit
    high_unit: PowerUnit
    actual: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class LaserDistance:
    """LASER DISTANCE; None: OFF."""

    settings: Distance | None


@dataclass(frozen=True, slots=True, kw_only=True)
class SwitchNow:
    """LASER ON NOW, LASER OFF NOW."""

    on: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerNow:
    """LASER POWER p NOW."""

    power: float
    unit: PowerUnit


@dataclass(frozen=True, slots=True, kw_only=True)
class Wait:
    """WAIT: motion ends before what follows."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LookAhead:
    """LOOKAHEAD: None is OFF; else (ms, pulse/ms2), NaN where the machine profile's value holds."""

    corner: tuple[float, float] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class SkyWriting:
    """Settings of SKYWRITE: `nprev`, `npost` in 10 us, `limit` a cosine; AUTO is worked out already."""

    mode: float
    timelag_us: float
    shift_us: float
    nprev: float
    npost: float
    limit: float
    limit_given: bool

    @property
    def is_on(self) -> bool:
        """Below 1/8 us it is off (RTC5)."""
        return self.timelag_us >= TIMELAG_OFF_US

    @property
    def lag_us(self) -> float:
        """The time lag that counts."""
        return self.timelag_us if self.timelag_us >= TIMELAG_ZERO_US else 0.0

    @property
    def run_in_us(self) -> float:
        """At mark speed in front of a mark."""
        return RUN_STEP_US * self.nprev

    @property
    def run_out_us(self) -> float:
        """At mark speed behind a mark."""
        return RUN_STEP_US * self.npost

    @property
    def on_us(self) -> float:
        """When the light goes on, counted from the mark's start: not before the run-in is at mark speed."""
        return max(self.lag_us + self.shift_us, -self.run_in_us)


def auto_steps(word: str, timelag_us: float) -> float:
    """NPREV or NPOST where it is AUTO, in 10 us: its share of the time lag, rounded (RTC5)."""
    return math.floor(AUTO_SHARE[word] * timelag_us + 0.5)


@dataclass(frozen=True, slots=True, kw_only=True)
class SkyWrite:
    """SKYWRITE; None: OFF."""

    settings: SkyWriting | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Crd:
    """CRD: coordinate system and FIFO."""

    crd: float
    fifo: float


SetupStatement = (
    LaserMode
    | LaserDelay
    | LaserStandby
    | LaserPrevolt
    | LaserFpk
    | LaserDistance
    | SwitchNow
    | PowerNow
    | Wait
    | LookAhead
    | SkyWrite
    | Crd
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Setup:
    """A setup statement: it stands before row `at` of the path; `word` is how a user calls it.

    `order`: its place among the setup statements; `trail` as in Path.
    """

    what: SetupStatement
    order: int
    at: int
    line: int
    channel: int
    word: str
    trail: int = 0


IN_PATH = (LookAhead, SkyWrite, Crd)
"""Setup statements that speak of the path behind them: nothing is called for them, and no motion is ended."""

SPEED_WORDS = ("VEL", "ACC", "JUMPVEL", "JUMPACC")


@dataclass(frozen=True, slots=True, kw_only=True)
class Speeds:
    """Every velocity and acceleration that was written, used or not, (n,): in pulse/ms (2) with X's pulses per mm.

    `word`: index in SPEED_WORDS; `inline`: a word of LINE or ARC, not a statement; `at`: the row of the path from
    which on it holds, ascending for each word.
    """

    line: npt.NDArray[np.int32]
    word: npt.NDArray[np.int8]
    value: Floats
    in_mm: Bools
    inline: Bools
    trail: npt.NDArray[np.int32]
    at: Indices


Locate = Callable[[int, str], Span]
"""Line and a word in it ('VEL', or '' for the whole statement) to its span."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One step on the way to a statement, with the values of its names.

    `kind`: 'call', 'round', 'nth' (a round without a name) or 'include'.
    """

    line: int
    kind: str
    values: dict[str, float]


@dataclass(slots=True)
class Provenance:
    """By which calls and rounds statements came about, as a tree: each trail is a step and the trail before it.

    Kept in batches, since a loop of a million rounds makes a million trails. Number 0 is the open road.
    """

    firsts: list[int] = field(default_factory=list)
    batches: list[tuple[int, str, tuple[str, ...], Any, tuple[Any, ...]]] = field(default_factory=list)
    count: int = 1

    def add(
        self, line: int, names: tuple[str, ...], before: Any, values: tuple[Any, ...], *, kind: str, count: int
    ) -> int:
        """`count` trails; `before` and each of the values are one for all, or one each. Returns the first's number."""
        first = self.count
        self.firsts.append(first)
        self.batches.append((line, kind, names, before, values))
        self.count += count
        return first

    def steps(self, trail: int) -> list[Step]:
        """The steps of a trail, the innermost first."""
        found = []
        while trail > 0:
            at = bisect_right(self.firsts, trail) - 1
            line, kind, names, before, values = self.batches[at]
            own = trail - self.firsts[at]
            found.append(
                Step(line=line, kind=kind, values={n: float(_one(v, own)) for n, v in zip(names, values, strict=True)})
            )
            trail = int(_one(before, own))
        return found


def _one(values: Any, at: int) -> Any:
    return values[at] if isinstance(values, np.ndarray) else values


def provenance_remarks(trails: Provenance, trail: int, locate: Locate) -> tuple[Remark, ...]:
    """How a statement came about: the calls and rounds, the innermost first."""
    remarks = []
    for step in trails.steps(trail):
        values = ", ".join(f"{name} = {number(value)}" for name, value in step.values.items())
        match step.kind:
            case "call":
                text, fields = CALLED, {"values": Phrase(": {values}", values=values) if values else ""}
            case "include":
                text, fields = INCLUDED, {}
            case "nth":
                text, fields = NTH_ROUND, {"number": number(next(iter(step.values.values())))}
            case _:
                text, fields = ROUND, {"values": values}
        remarks.append(Remark(text=text, span=locate(step.line, ""), fields=fields))
    return tuple(remarks[:MAX_REMARKS])


MAX_REMARKS = 8
"""So many steps of a trail are shown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """A whole job. `setups` in job order. `locate` finds the columns of a diagnostic in the source, when one is
    reported.

    Lines are numbered through all files of a job; `text_of` gives the text of the line of a span, `set_here` where the
    names in a word of a line were set.
    `in_pulses`: it is written in the controller's units (UNITS PULSE). `trails` is None for a job without loops,
    routines and includes.
    """

    name: str
    path: Path
    speeds: Speeds
    setups: tuple[Setup, ...]
    locate: Locate
    text_of: Callable[[Span], str]
    set_here: Callable[[int, str], tuple[Remark, ...]]
    files: tuple[tuple[str, int], ...] = ()
    """Of a job that includes files: the name of each, its own first, and what is added to its line numbers."""
    included: tuple[tuple[str, bytes], ...] = ()
    """Name and text of every file that it includes."""
    in_pulses: bool = False
    whole: bool = True
    """Whether everything in the text is in the job; else what seems to be missing may stand in a line with a
    diagnostic."""
    trails: Provenance | None = None

    def remarks(self, trail: int) -> tuple[Remark, ...]:
        """How a statement came about."""
        return provenance_remarks(self.trails, trail, self.locate) if self.trails is not None and trail else ()

    @property
    def has_forced_ends(self) -> bool:
        """Whether an END is written somewhere: only the planner can say whether it can be met."""
        return not bool(np.isnan(self.path.end).all())

    @property
    def sky_writes(self) -> bool:
        """Whether sky writing is on somewhere: only the planner can say where its run-ins lie."""
        return any(isinstance(s.what, SkyWrite) and s.what.settings and s.what.settings.is_on for s in self.setups)

    def sky_of_rows(self) -> tuple[Indices, tuple[SkyWriting, ...]]:
        """For each row of the path which of the settings is in force, -1 where sky writing is off; and the settings."""
        found: list[SkyWriting] = []
        places, numbers = [0], [-1]
        for setup in self.setups:
            if isinstance(setup.what, SkyWrite):
                settings = setup.what.settings
                on = settings is not None and settings.is_on
                places.append(setup.at)
                numbers.append(len(found) if on else -1)
                found += [settings] if settings is not None and on else []
        return np.repeat(np.array(numbers, dtype=np.intp), np.diff([*places, len(self.path)])), tuple(found)


@dataclass(frozen=True, slots=True, kw_only=True)
class DisplayUnits:
    """Lengths and speeds as messages show them: in the units in which the job is written.

    `per_pulse`, `per_pulse_per_ms`, `per_pulse_per_ms2`: what a value in X's pulses is multiplied with.
    """

    length: str
    speed: str
    acceleration: str
    per_pulse: float
    per_pulse_per_ms: float
    per_pulse_per_ms2: float


def display_units(job: Job, machine: Machine) -> DisplayUnits:
    """The units of a job's messages."""
    if job.in_pulses:
        return DisplayUnits(
            length="pulse", speed="pulse/ms", acceleration="pulse/ms2", per_pulse=1.0, per_pulse_per_ms=1.0,
            per_pulse_per_ms2=1.0,
        )  # fmt: skip
    px = machine.pulses_per_mm[0]
    return DisplayUnits(
        length="mm", speed="mm/s", acceleration="mm/s2", per_pulse=1 / px, per_pulse_per_ms=1e3 / px,
        per_pulse_per_ms2=1e6 / px,
    )  # fmt: skip


def opens_stage(job: Job) -> list[bool]:
    """For each setup statement whether it ends the motion before it and begins a new stage."""
    return [opens for opens, _ in stages_of_setups(job)]


def stages_of_setups(job: Job) -> list[tuple[bool, int]]:
    """For each setup statement whether it begins a new stage, and the first row of its stage.

    Setup statements are carried out at the start of their stage, before all of its rows: those too that stand above
    them, where nothing has moved yet.
    """
    before = np.concatenate([[0], np.cumsum(job.path.takes_time)])
    first, found = 0, []
    for setup in job.setups:
        opens = not isinstance(setup.what, IN_PATH) and bool(before[setup.at] > before[first])
        first = setup.at if opens else first
        found.append((opens, first))
    return found


def with_lines(path: Path, at: Indices, pieces: Indices, x: Floats, y: Floats) -> tuple[Path, Indices]:
    """A path whose rows `at` are `pieces` lines each, to the points x, y (pulse) of all of them in order.

    The last line of each ends where its row did. Returns the path, and for each of its rows the row it comes from.
    """
    counts = np.ones(len(path), dtype=np.intp)
    counts[at] = pieces
    origin = np.repeat(np.arange(len(path)), counts)
    columns: dict[str, npt.NDArray[Any]] = {f.name: getattr(path, f.name)[origin] for f in fields(Path)}
    is_new = np.zeros(len(path), dtype=np.bool_)
    is_new[at] = True
    new = np.flatnonzero(is_new[origin])
    last = np.zeros(len(new), dtype=np.bool_)
    last[np.cumsum(pieces) - 1] = True
    columns["x"][new] = np.where(last, columns["x"][new], x)
    columns["y"][new] = np.where(last, columns["y"][new], y)
    columns["end"][new] = np.where(last, columns["end"][new], np.nan)
    columns["op"][new] = Op.LINE
    return Path(**columns), origin


def chords(arcs: Arcs, radius_mm: Floats, tolerance_um: float) -> tuple[Indices, Floats, Floats]:
    """Arcs as chords within a tolerance: how many each has, and the ends of all of them in order.

    A chord of angle a leaves its circle by r*(1 - cos(a/2)). `radius_mm`: the largest radius of each on the part.
    """
    reach = np.clip(1 - tolerance_um / 1000 / np.maximum(radius_mm, 1e-12), -1, 1)
    pieces = np.maximum(np.ceil(np.abs(arcs.sweep) / (2 * np.arccos(reach))), 1).astype(np.intp)
    which = np.repeat(np.arange(len(pieces)), pieces)
    step = np.arange(len(which)) - (np.cumsum(pieces) - pieces)[which] + 1
    x, y = arcs.pick(which).at(step / pieces[which])
    return pieces, x, y


def arcs_mm(path: Path, at: Indices, machine: Machine) -> Arcs:
    """The arcs at rows `at` as circles in mm, from their unrounded ends."""
    px, py = machine.pulses_per_mm
    before_x = np.concatenate([[0.0], path.x])[at] / px
    before_y = np.concatenate([[0.0], path.y])[at] / py
    ends = (before_x, before_y, path.x[at] / px, path.y[at] / py)
    by_radius = path.op[at] == Op.ARC_RADIUS
    return arcs_by_either(ends, path.cx[at] / px, path.cy[at] / py, path.radius[at] / px, path.ccw[at], by_radius)
