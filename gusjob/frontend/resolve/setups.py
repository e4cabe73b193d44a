"""Setup statements in canonical units, each with its position in the path."""

from __future__ import annotations

import math

import numpy as np

from gusjob.controllers.gus.ranges import AUTO_SHARE, AUTO_STEPS, DEFAULT_LIMIT, MODE_LIMIT, PowerMode
from gusjob.frontend.parse.forms import Column
from gusjob.frontend.parse.statement import Quantity, RowOp, Statement, unit_of
from gusjob.frontend.resolve.columns import ResolvedColumns
from gusjob.frontend.resolve.path import ResolvedPath
from gusjob.ir.setup import (
    Crd,
    DistanceFollow,
    LaserDelay,
    LaserDistance,
    LaserFpk,
    LaserMode,
    LaserPrevolt,
    LaserStandby,
    LookAhead,
    PowerNow,
    Setup,
    SetupStatement,
    SkyWrite,
    SkyWriting,
    SwitchNow,
    Wait,
    auto_steps,
)
from gusjob.kinematics.float_noise import settled_one
from gusjob.kinematics.units import UnitSystem, acceleration_pulse_per_ms2


def resolve_setups(
    columns: ResolvedColumns, statements: tuple[Statement, ...], path: ResolvedPath
) -> tuple[Setup, ...]:
    """All setup statements of a job, in its order. `statements`: those that SETUP rows point to."""
    found, rows = [], np.flatnonzero(columns.op == RowOp.SETUP)
    channel, pulses = np.clip(np.nan_to_num(columns.channel()[rows]), 0, 1), columns.units_pulse()
    index, provenance = columns.raw_at(Column.VALUE, rows), columns.provenance()
    for order, (row, path_row) in enumerate(zip(rows.tolist(), path.path_row(rows).tolist(), strict=True)):
        statement = statements[int(index[order])]
        in_pulse = pulses is not None and bool(pulses[row])
        found.append(
            Setup(
                statement=_canonical(statement, in_pulse, columns.machine.pulses_per_mm),
                order=order,
                row=path_row,
                line=int(columns.rows.line[row]),
                channel=int(channel[order]),
                word=_shown_name(statement),
                provenance=int(provenance[row]),
                unknown=int(path.unknown_before[row]),
            )
        )
    return tuple(found)


def _shown_name(statement: Statement) -> str:
    """The statement as a user calls it."""
    if statement.form == "laser_switch":
        return f"LASER {' '.join(statement.options)}"
    return f"{statement.name} NOW" if "NOW" in statement.options else statement.name


def _canonical(statement: Statement, in_pulse: bool, pulses_per_mm: tuple[float, float]) -> SetupStatement:
    """One setup statement in canonical units. `in_pulse`: UNITS PULSE is in force."""
    numbers = {word: settled_one(quantity.value) for word, quantity in statement.words.items()}
    off = "OFF" in statement.options
    match statement.form:
        case "DUTY" | "DUTY2" | "FREQUENCY" | "ANALOG":
            return _mode(PowerMode[statement.form], numbers)
        case "laser_delay":
            return LaserDelay(on_delay_us=numbers["ON"], off_delay_us=numbers["OFF"])
        case "laser_standby":
            return LaserStandby(pulse=None if off else (numbers["FREQ"], numbers["DUTY"]))
        case "laser_prevolt":
            return LaserPrevolt(prevoltage_v=None if off else numbers[""])
        case "laser_fpk":
            return LaserFpk(times_us=None if off else (numbers["WIDTH"], numbers["GAP"], numbers["OFFDELAY"]))
        case "laser_distance":
            return LaserDistance(settings=None if off else _distance(statement, in_pulse, pulses_per_mm))
        case "laser_power":
            return PowerNow(power=numbers[""], unit=unit_of(statement.words[""]))
        case "laser_switch":
            return SwitchNow(on="ON" in statement.options)
        case "crd":
            return Crd(crd=numbers[""], fifo=numbers.get("FIFO", 0.0))
        case "lookahead":
            return LookAhead(corner=None if off else _corner(statement, in_pulse, pulses_per_mm[0]))
        case "skywrite":
            return SkyWrite(settings=None if off else _sky_writing(numbers))
        case _:
            return Wait()


def _is_in_pulse(quantity: Quantity, in_pulse: bool) -> bool:
    """Whether a number is in the controller's units."""
    return quantity.system == UnitSystem.PULSE or (quantity.system == UnitSystem.DEFAULT and in_pulse)


def _corner(statement: Statement, in_pulse: bool, pulse_per_mm: float) -> tuple[float, float]:
    """TIME (ms) and ACC (pulse/ms2) of LOOKAHEAD; NaN where left out."""
    time, acc = statement.words.get("TIME"), statement.words.get("ACC")
    value = math.nan
    if acc is not None:
        value = acc.value if _is_in_pulse(acc, in_pulse) else acceleration_pulse_per_ms2(acc.value, pulse_per_mm)
    return (settled_one(time.value) if time else math.nan, settled_one(value))


def _distance(statement: Statement, in_pulse: bool, pulses_per_mm: tuple[float, float]) -> DistanceFollow:
    """LASER DISTANCE with its reference in pulse."""

    def reference(quantity: Quantity | None, axis: int) -> float:
        if quantity is None:
            return 0.0
        if _is_in_pulse(quantity, in_pulse):
            return settled_one(quantity.value)
        # The profile has no pulses per mm of Z and A: they are as X.
        return float(np.rint(quantity.value * pulses_per_mm[axis if axis < 2 else 0])) + 0.0

    points, ratios = statement.axes["REF"], statement.axes["RATIO"]
    x, y, z, a = (reference(points.get(axis), i) for i, axis in enumerate("XYZA"))
    rx, ry, rz, ra = (settled_one(ratios[axis].value) if axis in ratios else 0.0 for axis in "XYZA")
    return DistanceFollow(
        reference_pulse=(x, y, z, a),
        ratio_per_mm=(rx, ry, rz, ra),
        low=settled_one(statement.words["MIN"].value),
        high=settled_one(statement.words["MAX"].value),
        low_unit=unit_of(statement.words["MIN"]),
        high_unit=unit_of(statement.words["MAX"]),
        actual="SOURCE ACTUAL" in statement.options,
    )


def _mode(mode: PowerMode, numbers: dict[str, float]) -> LaserMode:
    limits = MODE_LIMIT[mode]
    return LaserMode(
        mode=mode,
        low=numbers.get("MIN", limits.low),
        high=numbers.get("MAX", limits.high),
        carrier_khz=numbers.get("CARRIER"),
        pulse_width_us=numbers.get("WIDTH"),
    )


def _sky_writing(numbers: dict[str, float]) -> SkyWriting:
    """SKYWRITE; NPREV and NPOST follow from TIMELAG where they are AUTO, or 65535, which means AUTO to an RTC5."""
    timelag_us = numbers["TIMELAG"]
    steps = {word: numbers.get(word, AUTO_STEPS) for word in AUTO_SHARE}
    steps = {word: auto_steps(word, timelag_us) if n == AUTO_STEPS else n for word, n in steps.items()}
    return SkyWriting(
        mode=numbers["MODE"],
        timelag_us=timelag_us,
        shift_us=numbers.get("SHIFT", 0.0),
        nprev=steps["NPREV"],
        npost=steps["NPOST"],
        limit=numbers.get("LIMIT", DEFAULT_LIMIT),
        limit_given="LIMIT" in numbers,
    )
