"""Rows and totals of a trace, in mm, ms, the mode's power unit and joules."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from gusjob.config.machine import Machine
from gusjob.i18n.phrases import Phrase, all_of, figure, localized
from gusjob.ir.overrides import NO_OVERRIDES, Overrides
from gusjob.kinematics.arrays import Floats, Indices, picked, where_true
from gusjob.simulate import ChannelTrace, Trace
from gusjob.simulate.events import LaserState
from gusjob.simulate.kinds import SegmentKind
from gusjob.simulate.lengths import mm_per_pulse, segment_mm
from gusjob.simulate.quality.marks import marking_totals, marks_of
from gusjob.tables.columns import ComputedColumns

if TYPE_CHECKING:
    from gusjob.pipeline import Simulated

REPORT_SCHEMA = "gusjob-report/1"

MARKED_SEGMENTS = 100_000
"""Without a scanner, mark quality of a job with more segments is computed only on request, since it takes long."""


def kind_for_people(kind: int) -> str:
    """Return the name of a SegmentKind, localized."""
    return localized(_KINDS[SegmentKind(kind)])


_KINDS = {
    SegmentKind.MARK: Phrase("mark"),
    SegmentKind.JUMP: Phrase("jump"),
    SegmentKind.RUN_IN: Phrase("run_in"),
    SegmentKind.RUN_OUT: Phrase("run_out"),
    SegmentKind.DWELL: Phrase("dwell"),
}


OFF_OUTPUT = {
    "standby_khz": Phrase("standby_khz"),
    "standby_pct": Phrase("standby_pct"),
    "prevoltage_v": Phrase("prevoltage_v"),
}
"""Output to a laser that is off: names as in the JSON, for people."""


def while_off(output: dict[str, float] | None) -> str:
    """Describe the output to a laser that is off; '' if there is none."""
    return all_of(
        Phrase("{name} {value}", name=OFF_OUTPUT[name], value=figure(value)) for name, value in (output or {}).items()
    )


class Report(Struct, frozen=True, kw_only=True, eq=False):
    """Rows and totals of a run.

    Attributes:
        job: Name of the job.
        period_us: Tick of the controller.
        totals: As in the JSON.
        columns: One value per segment, by name, computed when it is read; `kind` holds SegmentKind numbers.
        notes: Further facts: machine, scanner, readings, files, overrides.
        marks: Columns of mark quality, one value per mark; None if it was not computed.
    """

    job: str
    period_us: float
    totals: dict[str, Any]
    columns: Mapping[str, npt.NDArray[Any]]
    notes: dict[str, Any]
    marks: dict[str, npt.NDArray[Any]] | None = None

    @property
    def words(self) -> dict[str, tuple[str, ...]]:
        """Texts of the columns that hold indices: kinds, and the units of a channel whose mode changes."""
        named = {"kind": tuple(kind.word for kind in SegmentKind)}
        for name in self.columns:
            if name.endswith("_unit"):
                entries = (entry for entry in self.totals["channels"] if f"ch{entry['channel']}_unit" == name)
                named[name] = tuple(entry["unit"] for entry in entries)
        return named

    @property
    def overrides(self) -> Overrides:
        """The values of LETs that the job was run with."""
        found: Overrides = self.notes.get("overrides", NO_OVERRIDES)
        return found

    def __len__(self) -> int:
        return len(self.columns["line"])


def report_of(simulated: Simulated, *, marking: bool | None = None) -> Report:
    """Make the report of a simulated file. `marking`: as for make_report."""
    return make_report(
        simulated.trace,
        simulated.machine,
        simulated.files,
        marking=marking,
        profile=simulated.profile,
        overrides=simulated.overrides,
    )


def make_report(
    trace: Trace,
    machine: Machine,
    files: tuple[tuple[str, int], ...] = (),
    *,
    marking: bool | None = None,
    profile: Path | None = None,
    overrides: Overrides = NO_OVERRIDES,
) -> Report:
    """Make the rows and totals of a trace.

    Args:
        trace: The run.
        machine: Its machine.
        files: Name and first line of each file of a job with includes. Then the column `line` counts in the line's own
            file, and the column `file` is an index of `notes["files"]`.
        marking: Whether to compute mark quality; None: with a scanner, and up to MARKED_SEGMENTS segments.
        profile: The machine profile that was read; None: the documented defaults.
        overrides: The values of LETs that the job was run with.
    """
    schedule, stages = trace.schedule, trace.schedule.stage
    computed = _motion_columns(trace, machine)
    for channel in trace.channels:
        computed.update(_channel_columns(channel, stages, machine))
    if files:
        computed["line"] = lambda: own_lines(trace.line, files)[0]
        computed["file"] = lambda: own_lines(trace.line, files)[1]
    columns = ComputedColumns(computed)
    length_mm, kind = columns["length_mm"], columns["kind"]
    totals: list[dict[str, Any]] = []
    for channel in trace.channels:
        totals += _channel_totals(channel, stages, machine)
    notes: dict[str, Any] = {"readings": [{"line": a, "channel": b, "value": c} for a, b, c in trace.readings]}
    notes["machine"] = {"name": machine.name or None, "profile": None if profile is None else _shown(profile)}
    scanner = machine.scanner
    notes["scanner"] = scanner and {"model": scanner.model.value, "tracking_error_us": scanner.tracking_error_us}
    if marking is None:
        marking = scanner is not None or len(length_mm) <= MARKED_SEGMENTS
    marks = marks_of(trace, machine) if marking else None
    if files:
        if marks:
            marks["line"], marks["file"] = own_lines(marks["line"], files)
        notes["files"] = [name for name, _ in files]
    if overrides:
        notes["overrides"] = dict(overrides)
    return Report(
        job=trace.name,
        period_us=trace.period_us,
        totals={
            "segments": len(length_mm),
            "stages": len(schedule.stage_first) - 1,
            "duration_ms": float(schedule.times_ms[-1]),
            **{
                f"{of.word}_mm": float(length_mm[where_true(kind == of)].sum())
                for of in SegmentKind
                if of != SegmentKind.DWELL
            },
            "channels": totals,
            "marking": None if marks is None else marking_totals(trace, marks) if marks else [],
        },
        columns=columns,
        notes=notes,
        marks=marks,
    )


def _shown(path: Path) -> str:
    """Return a path as seen from the current folder, if it is inside."""
    try:
        return path.resolve().relative_to(Path.cwd().resolve()).as_posix()
    except (OSError, ValueError):
        return str(path)


_Computed = dict[str, Callable[[], npt.NDArray[Any]]]


def _motion_columns(trace: Trace, machine: Machine) -> _Computed:
    """Return the columns of motion."""
    schedule, segments = trace.schedule, trace.segments
    px, py = machine.pulses_per_mm
    stage_number = np.arange(1, len(schedule.stage_first), dtype=np.int32)

    def vel_mean() -> Floats:
        mean, takes_time = segment_mm(segments, machine), schedule.duration_ms > 0
        np.divide(mean, schedule.duration_ms, out=mean, where=takes_time)
        mean[~takes_time] = 0.0
        mean *= 1e3
        return mean

    def vel_max() -> Floats:
        highest = np.maximum(schedule.profile.peak, schedule.profile.start)
        highest[schedule.dwell] = 0.0
        highest *= mm_per_pulse(segments, machine)
        highest *= 1e3
        return highest

    return {
        "line": lambda: trace.line,
        "kind": lambda: trace.kind,
        "stage": lambda: picked(stage_number, schedule.stage),
        "x_mm": lambda: segments.x1 / px,
        "y_mm": lambda: segments.y1 / py,
        "length_mm": lambda: segment_mm(segments, machine),
        "start_ms": lambda: schedule.times_ms[:-1],
        "duration_ms": lambda: schedule.duration_ms,
        "vel_mean_mm_s": vel_mean,
        "vel_max_mm_s": vel_max,
    }


def own_lines(
    line: npt.NDArray[np.int32], files: tuple[tuple[str, int], ...]
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int16]]:
    """Convert lines of a job with includes: lines counted in their own files, and indices of the files."""
    if not files:
        return line, np.zeros(len(line), dtype=np.int16)
    bases = np.array([base for _, base in files], dtype=np.int32)
    file = (np.searchsorted(bases, line - 1, side="right") - 1).astype(np.int16)
    return line - bases[file], file


def _channel_columns(channel: ChannelTrace, stages: Indices, machine: Machine) -> _Computed:
    """Return the columns of a channel."""
    emitted, name = channel.emitted, f"ch{channel.channel}_"

    def mean() -> Floats:
        with np.errstate(divide="ignore", invalid="ignore"):
            values: Floats = emitted.power_ms / emitted.emission_ms
        # Rounding in the division must not move a mean out of the range.
        return np.clip(values, emitted.power_min, emitted.power_max, out=values)

    return {
        f"{name}emission_ms": lambda: emitted.emission_ms,
        f"{name}power_min": lambda: emitted.power_min,
        f"{name}power_mean": mean,
        f"{name}power_max": lambda: emitted.power_max,
        f"{name}power_ms": lambda: emitted.power_ms,
        f"{name}joules": lambda: channel.joules(stages, machine),
        f"{name}clamped_ms": lambda: emitted.clamped_ms,
        **({f"{name}unit": lambda: channel.unit_at(stages)} if len(channel.units) > 1 else {}),
    }


def _channel_totals(channel: ChannelTrace, stages: Indices, machine: Machine) -> list[dict[str, Any]]:
    """Return one entry per power unit: a job that changes from duty to analog has two for that channel."""
    emitted, unit_of = channel.emitted, channel.unit_at(stages)
    watts_per_unit, joules = channel.watts_per_unit(stages, machine), channel.joules(stages, machine)
    entries = []
    for number, unit in enumerate(channel.units):
        of_unit = where_true(unit_of == number)
        last = next((s for s in reversed(channel.lasers) if s.power_mode.unit == unit), channel.laser_at_end)
        emission = emitted.emission_ms[of_unit]
        emits = where_true(emission > 0)
        power_max = emitted.power_max[of_unit][emits]
        known = not (np.isnan(_first_value(joules[of_unit])) or np.isnan(joules[of_unit][emits]).any())
        entries.append(
            {
                "channel": channel.channel,
                "unit": unit,
                "emission_ms": float(emission.sum()),
                "power_ms": float(emitted.power_ms[of_unit].sum()),
                "power_max": float(power_max.max()) if len(power_max) else None,
                "power_max_w": float((power_max * watts_per_unit[of_unit][emits]).max())
                if known and len(power_max)
                else None,
                "joules": float(np.nansum(joules[of_unit])) if known else None,
                "clamped_ms": float(emitted.clamped_ms[of_unit].sum()),
                "before_motion_power_ms": channel.before_motion_power_ms if number == 0 else 0.0,
                "off_output": _off_output(last),
                "lit_at_end": channel.emission.on_at_end,
            }
        )
    return entries


def _first_value(values: Floats) -> float:
    return float(values[0]) if len(values) else float("nan")


def _off_output(state: LaserState) -> dict[str, float] | None:
    """Return the standby pulse or pre-voltage of a laser that is off (M 二.2)."""
    if state.power_mode.is_pwm:
        return {"standby_khz": state.standby[0], "standby_pct": state.standby[1]} if state.standby else None
    return None if state.prevoltage_v is None else {"prevoltage_v": state.prevoltage_v}
