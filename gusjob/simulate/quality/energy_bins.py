"""Energy per mm: the power integral in bins along the beam's path of each mark.

This is the only definition of energy per mm. The report's middle and peak, pictures and the page all take it from here,
so their values agree.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from gusjob.config.machine import Machine
from gusjob.kinematics.arrays import Floats, Indices
from gusjob.simulate import ChannelTrace, Trace
from gusjob.simulate.intervals import Intervals
from gusjob.simulate.quality.beam_path import BeamPath, beam_path_of

BIN_MM = 0.05
"""Largest bin of the beam's path over which energy per mm is taken."""

_BLOCK_BINS = 1 << 17


class EnergyBins(Struct, frozen=True, kw_only=True, eq=False):
    """Bins of one channel's marks, in order of time, (b,).

    Attributes:
        first: Index of each mark's first bin, (k + 1,).
        start_ms: Start of each bin.
        per_mm: Power integral per mm, unit*ms/mm; NaN for a mark that does not move.
    """

    first: Indices
    start_ms: Floats
    per_mm: Floats

    @property
    def mark(self) -> Indices:
        """Mark of each bin, (b,)."""
        return np.repeat(np.arange(len(self.first) - 1), np.diff(self.first))


NO_BINS = EnergyBins(first=np.zeros(1, dtype=np.intp), start_ms=np.zeros(0), per_mm=np.zeros(0))


def energy_bins_of(trace: Trace, machine: Machine, channel: ChannelTrace) -> EnergyBins:
    """Compute the bins of all marks of a channel."""
    intervals = channel.emission.intervals
    return energy_bins(machine, channel, beam_path_of(trace, machine, intervals), intervals)


def energy_bins(machine: Machine, channel: ChannelTrace, path: BeamPath, intervals: Intervals) -> EnergyBins:
    """Compute the bins of all marks from the beam's path in them."""
    length = path.mark_mm()
    moves = length >= 1 / max(machine.pulses_per_mm)
    count = np.where(moves, np.maximum(np.ceil(length / BIN_MM - 1e-9), 1), 1).astype(np.intp)
    first = np.concatenate([[0], np.cumsum(count)])
    start, energy = _integrals(channel, path, intervals, length, first)
    with np.errstate(divide="ignore", invalid="ignore"):
        width = np.where(moves, length / count, np.nan)
        energy /= np.repeat(width, count)
    return EnergyBins(first=first, start_ms=start, per_mm=energy)


def _integrals(
    channel: ChannelTrace, path: BeamPath, intervals: Intervals, length: Floats, first: Indices
) -> tuple[Floats, Floats]:
    """Compute start and power integral of equal bins of each mark's length, all marks in a row."""
    count, total = np.diff(first), int(first[-1])
    starts, energy = np.empty(total), np.empty(total)
    for begin in range(0, total, _BLOCK_BINS):
        bins = np.arange(begin, min(begin + _BLOCK_BINS, total) + 1)
        mark = np.searchsorted(first[:-1], np.minimum(bins, total - 1), side="right") - 1
        number = bins - first[mark]
        edge = path.moment(mark, length[mark] * (number / count[mark]))
        edge = np.where(number == 0, intervals.start_ms[mark], edge)
        of = mark[:-1]
        end = np.where(number[:-1] == count[of] - 1, intervals.end_ms[of], edge[1:])
        part = Intervals(stage=intervals.stage[of], start_ms=edge[:-1], end_ms=np.maximum(end, edge[:-1]))
        starts[begin : begin + _BLOCK_BINS] = edge[:-1]
        energy[begin : begin + _BLOCK_BINS] = channel.power.integral(part)
    return starts, energy
