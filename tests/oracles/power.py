"""A slow, plain reference of the simulation, written from the job language's contract alone, to compare with.

One scalar at a time: every tick is looked at, nothing is vectorised, nothing is shared with the package. Times are in
ms, lengths in pulse, velocities in pulse/ms. Decided here where the contract is silent:

- A switch set at rest, or an edge still under way when a stage ends, has come to pass when the next stage starts.
- Light behind the last segment (off delay) belongs to that segment, at velocity 0 at its end point, on the same ticks.
- Power before any power call is 0, and so it is after a change of the power mode; the mode's limits then clamp it.
- Axes of distance follow beyond X and Y stand at 0.
- A limit holds the power if the power lies beyond it by more than rounding (`HELD`); light shorter than rounding
  (`SLIVER`, ms) is none, so that an edge on a tick is on that tick.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

Call = tuple[Any, ...]
"""A call as data: name and arguments, ("GT_LnXY", 1, 100000, 0, 50, 2, 0, 0); arrays as tuples."""

HELD = 1e-9
SLIVER = 1e-9
MOTIONS = {"GT_LnXY", "GT_ArcXYC", "GT_ArcXYR", "GT_BufDelay"}
SWITCHES = {"GT_BufLaserOn", "GT_BufLaserOff"}
POWERS = {"GT_BufLaserPrfCmd", "GT_BufLaserPrfFollow"}
SILENT = {"GT_SetAxisMode", "GT_LaserOutFrq", "GT_SetPulseWidth", "GT_SetWaitPulse", "GT_SetPreVltg", "GT_SetCrdPrm"}


@dataclass
class Channel:
    """What the controller holds of one laser channel between stages."""

    mode: int | None = None
    mode_low: float = -math.inf
    mode_high: float = math.inf
    base: tuple[float, ...] = (0.0,)
    """(power,) or, with velocity follow, (ratio, min, max)."""
    lit: bool = False
    on_delay: float = 0.0
    off_delay: float = 0.0
    fpk: tuple[float, float] | None = None
    """Gap before the first pulse and the late closing, ms."""
    distance: bool = False
    reference: tuple[float, ...] = (0, 0, 0, 0)
    scale: tuple[float, ...] = (1, 1, 1, 1)
    ratio: tuple[float, ...] = (0, 0, 0, 0)
    distance_low: float = -math.inf
    distance_high: float = math.inf

    def setup(self, name: str, args: tuple[Any, ...]) -> None:
        """An immediate call, at rest; the channel itself is no longer among `args`."""
        match name:
            case "GT_LaserPowerMode":
                if self.mode is not None and self.mode != args[0]:
                    self.base = (0.0,)
                self.mode, self.mode_high, self.mode_low = args
            case "GT_LaserPrfCmd":
                self.base = (args[0],)
            case "GT_SetHSIOOpt":
                self.lit = bool(args[0])
            case "GT_SetLevelDelay":
                self.off_delay, self.on_delay = args[0] / 1000, args[1] / 1000
            case "GT_EnaFPK":
                self.fpk = (args[1] / 1000, args[2] / 1000)
            case "GT_DisFPK":
                self.fpk = None
            case "GT_SetLaserDisMode":
                self.distance, self.reference, self.scale = args[0] == 1, args[2], args[3]
            case "GT_SetLaserDisRatio":
                if self.distance:
                    self.ratio, self.distance_low, self.distance_high = args
            case _:
                raise ValueError(f"{name}: not a call of the reference")

    def power(self, base: tuple[float, ...], velocity: float, x: float, y: float) -> tuple[float, bool]:
        """Power at a velocity and a place, and whether a limit holds it."""
        if len(base) == 3:
            ratio, low, high = base
            power, held = _limit(ratio * velocity + low, -math.inf, high)
        else:
            power, held = base[0], False
        if self.distance:
            for axis, place in enumerate((x, y, 0.0, 0.0)):
                power += self.ratio[axis] * abs(place - self.reference[axis]) / self.scale[axis]
            power, there = _limit(power, self.distance_low, self.distance_high)
            held |= there
        power, there = _limit(power, self.mode_low, self.mode_high)
        return power, held | there


def _limit(value: float, low: float, high: float) -> tuple[float, bool]:
    """Value within limits, and whether one of them held it."""
    limited = min(max(value, low), high)
    return limited, abs(limited - value) > HELD * (1 + abs(value))


@dataclass
class Segment:
    """A motion or dwell call: its phases of constant acceleration (duration, velocity at start, acceleration)."""

    x0: float
    y0: float
    x1: float
    y1: float
    length: float = 0.0
    dwell: bool = False
    centre: tuple[float, float] | None = None
    radius: float = 0.0
    angle: float = 0.0
    sweep: float = 0.0
    phases: list[tuple[float, float, float]] = field(default_factory=list)
    end_velocity: float = 0.0

    @property
    def duration(self) -> float:
        """Time of all phases, ms."""
        return math.fsum(p[0] for p in self.phases)

    def travel(self, start: float, vel: float, acc: float, vel_end: float) -> None:
        """Trapezoid from `start` over `vel` to `vel_end`; `vel_end` must be within reach."""
        end = min(vel_end, vel)
        self.end_velocity = end
        if self.length == 0:
            return
        # From both ends the velocity runs towards `vel`; if the way is too short, both runs meet at the peak.
        peak = vel if start > vel else min(vel, math.sqrt(acc * self.length + (start * start + end * end) / 2))
        first, last = abs(start - peak) / acc, abs(peak - end) / acc
        way = self.length - (start + peak) / 2 * first - (peak + end) / 2 * last
        self.phases = [
            (first, start, math.copysign(acc, peak - start)),
            (max(way, 0.0) / peak, peak, 0.0),
            (last, peak, -acc),
        ]

    def state(self, u: float) -> tuple[float, float, float]:
        """(velocity, x, y) at `u` ms after the segment's start."""
        way, velocity = 0.0, 0.0
        for duration, start, acc in self.phases:
            t = min(u, duration)
            velocity = start + acc * t
            way += (start + velocity) / 2 * t
            if u < duration:
                break
            u -= duration
        share = way / self.length if self.length else 0.0
        if self.centre is not None:
            angle = self.angle + self.sweep * share
            x, y = self.centre[0] + self.radius * math.cos(angle), self.centre[1] + self.radius * math.sin(angle)
            return velocity, x, y
        return velocity, self.x0 + (self.x1 - self.x0) * share, self.y0 + (self.y1 - self.y0) * share


def make_segment(call: Call, x: float, y: float, velocity: float) -> Segment:
    """The segment of a motion call that starts at a place with a velocity."""
    name, _, *args = call
    if name == "GT_BufDelay":
        return Segment(x, y, x, y, dwell=True, phases=[(args[0], 0.0, 0.0)])
    segment = Segment(x, y, args[0], args[1])
    dx, dy = segment.x1 - x, segment.y1 - y
    segment.length = math.hypot(dx, dy)
    vel, acc, vel_end, _ = args[-4:]
    if name == "GT_ArcXYC":
        _turn(segment, (x + args[2], y + args[3]), args[4])
    elif name == "GT_ArcXYR":
        radius, direction = args[2], args[3]
        # The centre of the short way lies to the left of the chord if it turns left, else to the right.
        off = math.sqrt(max(radius**2 - segment.length**2 / 4, 0.0)) / segment.length
        side = off if (direction == 1) == (radius > 0) else -off
        _turn(segment, (x + dx / 2 - dy * side, y + dy / 2 + dx * side), direction)
    segment.travel(velocity, vel, acc, vel_end)
    return segment


def _turn(segment: Segment, centre: tuple[float, float], direction: int) -> None:
    """Makes a segment an arc: direction 0 clockwise, 1 counter-clockwise; a full circle if it ends where it starts."""
    segment.centre = centre
    segment.radius = math.hypot(segment.x0 - centre[0], segment.y0 - centre[1])
    segment.angle = math.atan2(segment.y0 - centre[1], segment.x0 - centre[0])
    if (segment.x0, segment.y0) == (segment.x1, segment.y1):
        turn = 2 * math.pi
    else:
        end = math.atan2(segment.y1 - centre[1], segment.x1 - centre[0])
        turn = (end - segment.angle if direction == 1 else segment.angle - end) % (2 * math.pi)
    segment.sweep = turn if direction == 1 else -turn
    segment.length = segment.radius * turn


def merge(spans: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """Spans in order of their starts; empty ones are gone, those that meet or cross are one."""
    merged: list[tuple[float, float]] = []
    for start, end in sorted(s for s in spans if s[0] < s[1]):
        if merged and start <= merged[-1][1]:
            merged[-1] = (merged[-1][0], max(merged[-1][1], end))
        else:
            merged.append((start, end))
    return merged


def emission(channel: Channel, commands: Sequence[tuple[float, bool]], stage_end: float) -> list[tuple[float, float]]:
    """When the channel emits in a stage, from its switch commands (time, on); moves the channel's switch on."""
    spans: list[tuple[float, float]] = []
    start = -math.inf
    for time, on in commands:
        if on and not channel.lit:
            start = time + channel.on_delay
        elif channel.lit and not on:
            spans.append((start, time + channel.off_delay))
        channel.lit = on
    if channel.lit:
        spans.append((start, math.inf))
    spans = merge(spans)
    if channel.fpk is not None:
        spans = [(a + channel.fpk[0], b + channel.fpk[1]) for a, b in spans]
    # Light on at the stage's start emits from its first moment; an on that lasts is the next stage's from the end on.
    return merge((max(a, 0.0), stage_end if b == math.inf else b) for a, b in spans)


def simulate(calls: Iterable[Call], period_us: float, pulses_per_mm: float = 1000.0) -> list[dict[str, Any]]:
    """One dict a motion or dwell call: start_ms, duration_ms, length_pulse, length_mm, x_mm, y_mm, dwell, commanded
    (some channel is commanded on); under `channels` one dict each of emission_ms, power_ms, power_min, power_max,
    clamped_ms."""
    channels = (Channel(), Channel())
    rows: list[dict[str, Any]] = []
    place, clock = (0.0, 0.0), 0.0
    queue: list[Call] = []
    running = False
    for call in [*calls, ("GT_CrdStatus",)]:
        name = call[0]
        if name in MOTIONS | SWITCHES | POWERS:
            queue.append(call)
        elif name == "GT_CrdStart":
            running = True
        elif name == "GT_CrdStatus":
            if running:
                place, clock = _stage(queue, channels, period_us / 1000, place, clock, rows)
                queue, running = [], False
        elif running:
            raise ValueError(f"{name} while the coordinate system moves: not in the reference")
        elif name == "GT_CrdClear":
            queue = []
        elif name not in SILENT:
            channels[call[-1]].setup(name, call[1:-1])
    for row in rows:
        row["length_mm"] = row["length_pulse"] / pulses_per_mm
        row["x_mm"], row["y_mm"] = row.pop("x") / pulses_per_mm, row.pop("y") / pulses_per_mm
    return rows


def _stage(
    queue: Sequence[Call],
    channels: tuple[Channel, Channel],
    period: float,
    place: tuple[float, float],
    clock: float,
    rows: list[dict[str, Any]],
) -> tuple[tuple[float, float], float]:
    """Runs one stage, appends its rows; place and clock at its end."""
    segments: list[Segment] = []
    times = [0.0]
    laser_calls: list[tuple[int, Call]] = []
    velocity = 0.0
    for call in queue:
        if call[0] not in MOTIONS:
            laser_calls.append((len(segments), call))
            continue
        segment = make_segment(call, *place, velocity)
        place, velocity = (segment.x1, segment.y1), segment.end_velocity
        segments.append(segment)
        times.append(times[-1] + segment.duration)
    end = times[-1]

    def state(index: int, time: float) -> tuple[float, float, float]:
        return (0.0, *place) if index == len(segments) else segments[index].state(time - times[index])

    first = len(rows)
    for segment, start in zip(segments, times, strict=False):
        row = {"start_ms": clock + start, "duration_ms": segment.duration, "length_pulse": segment.length}
        rows.append(
            {**row, "x": segment.x1, "y": segment.y1, "dwell": segment.dwell, "channels": {}, "commanded": False}
        )
    for number, channel in enumerate(channels):
        mine = [(at, c) for at, c in laser_calls if c[-1] == number]
        switches = {at: c[0] == "GT_BufLaserOn" for at, c in mine if c[0] in SWITCHES}  # The last one before a segment.
        on = channel.lit
        for index in range(len(segments)):
            on = switches.get(index, on)
            rows[first + index]["commanded"] |= on
        spans = emission(channel, [(times[at], c[0] == "GT_BufLaserOn") for at, c in mine if c[0] in SWITCHES], end)
        # Samples (time, power, held) in force from their time on: at each tick, and at each power call.
        last = max([end, *(b for _, b in spans)])
        todo: list[tuple[float, int, int, tuple[float, ...] | None]] = []
        todo += [(k * period, 0, -1, None) for k in range(math.floor(last / period) + 2)]
        todo += [(times[at], 1, at, tuple(c[2:-2])) for at, c in mine if c[0] in POWERS]
        samples: list[tuple[float, float, bool]] = []
        for time, _, at, base in sorted(todo, key=lambda s: s[:2]):
            channel.base = channel.base if base is None else base
            index = at if at >= 0 else bisect_right(times, time) - 1
            samples.append((time, *channel.power(channel.base, *state(index, time))))
        for index in range(len(segments)):
            window = (times[index], times[index + 1] if index + 1 < len(segments) else math.inf)
            rows[first + index]["channels"][number] = _account(window, spans, samples)
    return place, clock + end


def _account(
    window: tuple[float, float], spans: Sequence[tuple[float, float]], samples: Sequence[tuple[float, float, bool]]
) -> dict[str, Any]:
    """Emission and power of one channel within a window of time."""
    pieces: list[tuple[float, float, bool]] = []
    for start, end in ((max(a, window[0]), min(b, window[1])) for a, b in spans):
        at = bisect_right(samples, start, key=lambda s: s[0]) - 1
        while start < end:
            until = min(end, samples[at + 1][0]) if at + 1 < len(samples) else end
            if until - start > SLIVER:
                pieces.append((until - start, *samples[at][1:]))
            start, at = until, at + 1
    return {
        "emission_ms": math.fsum(p[0] for p in pieces),
        "power_ms": math.fsum(p[0] * p[1] for p in pieces),
        "power_min": min((p[1] for p in pieces), default=None),
        "power_max": max((p[1] for p in pieces), default=None),
        "clamped_ms": math.fsum(p[0] for p in pieces if p[2]),
    }
