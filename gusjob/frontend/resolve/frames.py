"""FRAME: scale, then rotate, then shift, in mm; as maps between pulses, whatever an axis has of them per mm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gusjob.ir.path import Op, Path
from gusjob.kinematics.arrays import Bools, Floats, Indices, Ints, running_sum
from gusjob.kinematics.geometry import Arcs, arcs_by_either, sin_cos_deg


@dataclass(frozen=True, slots=True, kw_only=True)
class Frames:
    """x' = a x + b y + e, y' = c x + d y + f, all (frames + 1,); frame 0 is the machine itself. `scale`: in mm."""

    a: Floats
    b: Floats
    c: Floats
    d: Floats
    e: Floats
    f: Floats
    scale: Floats

    def out(self, frame: Ints | int, x: Floats | float, y: Floats | float) -> tuple[Floats, Floats]:
        """Frame to machine."""
        return (
            np.asarray(self.a[frame] * x + self.b[frame] * y + self.e[frame]),
            np.asarray(self.c[frame] * x + self.d[frame] * y + self.f[frame]),
        )

    def unturned(self, frame: Ints | int, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Machine to frame, but for the shift."""
        size = self.a[frame] * self.d[frame] - self.b[frame] * self.c[frame]
        return (
            np.asarray((self.d[frame] * x - self.b[frame] * y) / size),
            np.asarray((self.a[frame] * y - self.c[frame] * x) / size),
        )

    def into(self, frame: int, x: float, y: float) -> tuple[float, float]:
        """Machine to frame."""
        inside_x, inside_y = self.unturned(frame, x - self.e[frame], y - self.f[frame])
        return float(inside_x), float(inside_y)


def frames_of(
    number: Ints, shift_x: Floats, shift_y: Floats, angle_deg: Floats, scale: Floats, parent: Ints,
    pulses_per_mm: tuple[float, float],
) -> Frames:  # fmt: skip
    """All frames, each within those around it. `number` (from 1), shifts in pulse; `parent` by number, 0 for none."""
    count = len(parent)
    px, py = pulses_per_mm
    sine, cosine = sin_cos_deg(angle_deg)
    a, b, c, d = np.ones(count), np.zeros(count), np.zeros(count), np.ones(count)
    e, f, size = np.zeros(count), np.zeros(count), np.ones(count)
    a[number], b[number] = scale * cosine, -scale * sine * (px / py)
    c[number], d[number] = scale * sine * (py / px), scale * cosine
    e[number], f[number], size[number] = shift_x, shift_y, scale
    # From the outside in: a frame is finished when the one around it is.
    level = np.zeros(count, dtype=np.int64)
    above = parent
    while np.any(above > 0):
        level += above > 0
        above = np.where(above > 0, parent[above], 0)
    for one in range(1, int(level.max(initial=0)) + 1):
        own = np.flatnonzero(level == one)
        around = parent[own]
        a[own], b[own], c[own], d[own], e[own], f[own] = (
            a[around] * a[own] + b[around] * c[own],
            a[around] * b[own] + b[around] * d[own],
            c[around] * a[own] + d[around] * c[own],
            c[around] * b[own] + d[around] * d[own],
            a[around] * e[own] + b[around] * f[own] + e[around],
            c[around] * e[own] + d[around] * f[own] + f[around],
        )
        size[own] *= size[around]
    return Frames(a=a, b=b, c=c, d=d, e=e, f=f, scale=size)


def positions_in_frames(x: Floats, y: Floats, relative: Bools, frame: Ints, frames: Frames) -> tuple[Floats, Floats]:
    """Machine positions behind each move, pulse.

    x, y: words in the frame's own pulses, NaN where left out; relative: to where the head is; frame of each move.
    Within a frame an axis that is left out stays where it is as seen from that frame.
    """
    n = len(x)
    if not n:
        return np.zeros(0), np.zeros(0)
    begins = np.concatenate([[True], frame[1:] != frame[:-1]])
    first = np.maximum.accumulate(np.where(begins, np.arange(n), 0))
    locals_, open_ = [], []
    for words in (x, y):
        given = ~np.isnan(words)
        sums = running_sum(np.where(relative & given, words, 0.0))
        base = np.maximum.accumulate(np.where(given & ~relative, np.arange(n), -1))
        known = base >= first
        # Relative to the last absolute word in this frame, or to where the head came in.
        since = sums[1:] - np.where(known, sums[base + 1], sums[first])
        locals_.append(np.where(known, words[base], 0.0) + since)
        open_.append(~known)
    group = np.cumsum(begins) - 1
    starts = np.flatnonzero(begins)
    enter_x, enter_y = np.zeros(len(starts)), np.zeros(len(starts))
    # Where the head came in matters only where a frame's moves begin relative, or with one axis alone.
    for one in np.unique(group[open_[0] | open_[1]]).tolist():
        before = (0.0, 0.0)
        if one:
            last, of = int(starts[one]) - 1, one - 1
            lx = locals_[0][last] + (enter_x[of] if open_[0][last] else 0.0)
            ly = locals_[1][last] + (enter_y[of] if open_[1][last] else 0.0)
            gx, gy = frames.out(int(frame[last]), float(lx), float(ly))
            before = (float(gx), float(gy))
        enter_x[one], enter_y[one] = frames.into(int(frame[starts[one]]), *before)
    local_x = locals_[0] + np.where(open_[0], enter_x[group], 0.0)
    local_y = locals_[1] + np.where(open_[1], enter_y[group], 0.0)
    return frames.out(frame, local_x, local_y)


def bent_arcs(path: Path, at: Indices, frames: Frames, frame: Ints) -> tuple[Arcs, Floats]:
    """The arcs at rows `at` as the circles that they are in the pulses of their frames, but for the frames' shift.

    With them how far the end of each lies from its centre, in the same pulses.
    """
    before = np.concatenate([[0.0], path.x])[at], np.concatenate([[0.0], path.y])[at]
    x1, y1 = frames.unturned(frame, path.x[at], path.y[at])
    cx, cy = frames.unturned(frame, path.cx[at], path.cy[at])
    radius, by_radius = path.radius[at] / frames.scale[frame], path.op[at] == Op.ARC_RADIUS
    arcs = arcs_by_either((*frames.unturned(frame, *before), x1, y1), cx, cy, radius, path.ccw[at], by_radius)
    return arcs, np.hypot(x1 - arcs.cx, y1 - arcs.cy)
