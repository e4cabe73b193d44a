"""The machine profile: TOML to a frozen dataclass, with diagnostics instead of exceptions for what is wrong in it."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

from gusjob import diagnostics as d
from gusjob import rules
from gusjob.diagnostics import Diagnostic, Span
from gusjob.limits import ACCELERATION, CARRIER_KHZ, CHANNEL, LOOKAHEAD_TIME_MS, POWER_NOW, VELOCITY, PowerMode, Range
from gusjob.units import US_PER_MS, acceleration_pulse_per_ms2, velocity_pulse_per_ms

PROFILE_NAME = "gusjob.toml"


@dataclass(frozen=True, slots=True, kw_only=True)
class Laser:
    """One laser source. `rated_w`: watts at full power, None if unknown; `max_frequency_khz`: its highest response."""

    channel: int
    name: str = ""
    rated_w: float | None = None
    max_frequency_khz: float | None = None

    def watts_per_unit(self, mode: PowerMode, pulse_width_us: float) -> float | None:
        """Average watts for one unit of power (1 %, 1 kHz, 1 V), or None if the rated power is unknown.

        Duty: rated * duty. Analog: rated * V / 10 (the full scale of M 二.2). Frequency: rated * f * width, that is
        the share of time in which the PWM line is active.
        """
        if self.rated_w is None:
            return None
        match mode:
            case PowerMode.DUTY | PowerMode.DUTY2:
                return self.rated_w / POWER_NOW[mode].high
            case PowerMode.ANALOG:
                return self.rated_w / POWER_NOW[mode].high
            case PowerMode.FREQUENCY:
                return self.rated_w * pulse_width_us / 1000


class ScannerModel(StrEnum):
    """How mirrors follow the command: so much later, or as a low pass of first or (critically damped) second order."""

    DELAY = "delay"
    FIRST_ORDER = "first-order"
    SECOND_ORDER = "second-order"


@dataclass(frozen=True, slots=True, kw_only=True)
class Scanner:
    """How the beam lags behind the command. At constant speed every model lags by speed * tracking error."""

    model: ScannerModel
    tracking_error_us: float

    def __str__(self) -> str:
        """As it is written."""
        return f"{self.model.value}:{self.tracking_error_us:g}us"


SCANNER_FORM = "delay:TIME, first-order:TIME or second-order:TIME, such as first-order:250us, with a TIME of 0 to 1 s"
"""How a scanner is written."""

_SCANNER_MAX_US = 1e6
_SCANNER_TEXT = re.compile(rf"({'|'.join(ScannerModel)}):((?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?) ?(us|ms|s)?", re.ASCII)


def parse_scanner(text: str) -> Scanner | str:
    """A scanner from `first-order:250us`, or what is wrong with the text. Units: us (also without a unit), ms, s."""
    shown = f'"{d.printable(text)[:40]}"'
    found = _SCANNER_TEXT.fullmatch(text.strip())
    if not found:
        return f"{shown} is not a scanner: write {SCANNER_FORM}"
    unit_us = {"ms": US_PER_MS, "s": US_PER_MS**2}.get(found[3], 1.0)
    lag_us = float(found[2]) * unit_us
    if lag_us > _SCANNER_MAX_US:
        return f"the time in {shown} is above 1 s: write {SCANNER_FORM}"
    return Scanner(model=ScannerModel(found[1]), tracking_error_us=lag_us)


@dataclass(frozen=True, slots=True, kw_only=True)
class Machine:
    """What a job runs on. The defaults are the documented ones of the job language."""

    name: str = "default"
    pulses_per_mm: tuple[float, float] = (1000.0, 1000.0)
    field_x_mm: tuple[float, float] = (-150.0, 150.0)
    field_y_mm: tuple[float, float] = (-150.0, 150.0)
    max_velocity_mm_s: float = 10_000.0
    max_acceleration_mm_s2: float = 1e6
    period_us: float = 250.0
    lookahead_time_ms: float = 5.0
    lookahead_acc_pulse_per_ms2: float = 1.0
    chord_tolerance_um: float = 1.0
    host_calls_per_s: float | None = None
    expansion_max_statements: int = 3_000_000
    expansion_max_depth: int = 64
    expansion_max_includes: int = 16
    scanner: Scanner | None = None
    """None: the beam is where the command is."""
    lasers: tuple[Laser, ...] = field(default=())

    @property
    def equal_axes(self) -> bool:
        """Whether X and Y have the same pulses per mm."""
        return self.pulses_per_mm[0] == self.pulses_per_mm[1]

    @property
    def max_velocity_pulse_per_ms(self) -> float:
        """The velocity limit for the coordinate system, on the finer axis."""
        return velocity_pulse_per_ms(self.max_velocity_mm_s, max(self.pulses_per_mm))

    @property
    def max_acceleration_pulse_per_ms2(self) -> float:
        """The acceleration limit for the coordinate system, on the finer axis."""
        return acceleration_pulse_per_ms2(self.max_acceleration_mm_s2, max(self.pulses_per_mm))

    def laser(self, channel: int) -> Laser:
        """The laser of a channel; one of unknown power if the profile names none."""
        return next((x for x in self.lasers if x.channel == channel), Laser(channel=channel))


def _positive(name: str, unit: str, high: float = math.inf) -> Range:
    return Range(name=name, unit=unit, low=0, high=high, low_open=True, high_open=True, section="profile")


_COORDINATE_MM = Range(name="field", unit="mm", low=-1e6, high=1e6, section="profile")
_PAIR = {"pulses_per_mm", "field_x_mm", "field_y_mm"}
_MACHINE_KEYS: dict[str, Range] = {
    "pulses_per_mm": _positive("pulses per mm", "pulse/mm", 1e7),
    "field_x_mm": _COORDINATE_MM,
    "field_y_mm": _COORDINATE_MM,
    "max_velocity_mm_s": _positive("velocity", "mm/s", 1e9),
    "max_acceleration_mm_s2": _positive("acceleration", "mm/s2", 1e12),
    "period_us": Range(name="period", unit="us", low=1, high=1e6, section="profile"),
    "host_calls_per_s": _positive("calls per second", "1/s", 1e9),
    "chord_tolerance_um": Range(name="chord tolerance", unit="um", low=0.01, high=1000, section="profile"),
}
_LOOKAHEAD_KEYS: dict[str, Range] = {
    "time_ms": LOOKAHEAD_TIME_MS,
    "acc_pulse_per_ms2": ACCELERATION,
}
_EXPANSION_KEYS: dict[str, Range] = {
    "max_statements": Range(name="statements", unit="", low=1, high=1e8, whole=True, section="profile"),
    "max_depth": Range(name="depth", unit="", low=1, high=150, whole=True, section="profile"),
    "max_includes": Range(name="includes", unit="", low=0, high=32, whole=True, section="profile"),
}
_LASER_KEYS: dict[str, Range] = {
    "channel": CHANNEL,
    "rated_w": _positive("rated power", "W", 1e6),
    "max_frequency_khz": CARRIER_KHZ,
}
_TEXTS = {"name"}
_NUMBER = "a number"


def find_profile(job: Path) -> Path | None:
    """The nearest gusjob.toml in the job's folder or above it."""
    folder = job.resolve().parent
    return next((p for f in (folder, *folder.parents) if (p := f / PROFILE_NAME).is_file()), None)


def read_machine(path: Path) -> tuple[Machine, list[Diagnostic]]:
    """The profile at `path`; the defaults stand in for what is wrong or missing."""
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        fault = Diagnostic(
            rule=rules.UNREADABLE, span=d.NOWHERE, fields={"reason": error.strerror or "unreadable"}, path=str(path)
        )
        return Machine(), [fault]
    except UnicodeDecodeError as error:
        return Machine(), [
            Diagnostic(rule=rules.NOT_TEXT, span=d.NOWHERE, fields={"reason": error.reason}, path=str(path))
        ]
    return parse_machine(text, str(path))


def parse_machine(text: str, path: str = "") -> tuple[Machine, list[Diagnostic]]:
    """A profile from TOML text, with a diagnostic for every entry that is wrong."""
    import tomllib  # Most jobs have no profile: start-up time is part of the tool.

    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        span = Span(line=getattr(error, "lineno", None) or _line_of(str(error)))
        return Machine(), [Diagnostic(rule=rules.PROFILE_SYNTAX, span=span, fields={"reason": str(error)}, path=path)]
    reader = _Reader(text=text, path=path)
    machine = Machine()
    tables = ("lookahead", "expansion", "laser")
    apart = (*tables, "scanner")
    top = {k: v for k, v in data.items() if k not in apart}
    values = reader.table(top, _MACHINE_KEYS, "", extra=apart)
    if "scanner" in data:
        values["scanner"] = reader.scanner(data["scanner"])
    ahead = reader.table(reader.as_table(data.get("lookahead", {}), "lookahead"), _LOOKAHEAD_KEYS, "lookahead")
    values.update({f"lookahead_{k}": v for k, v in ahead.items()})
    limits = reader.table(reader.as_table(data.get("expansion", {}), "expansion"), _EXPANSION_KEYS, "expansion")
    values.update({f"expansion_{k}": int(v) for k, v in limits.items()})
    lasers = data.get("laser", [])
    if not isinstance(lasers, list):
        reader.fault(rules.PROFILE_TYPE, "laser", "", wanted="a list of tables, [[laser]]", found=_kind(lasers))
        lasers = []
    sources: list[Laser] = []
    for number, entry in enumerate(lasers):
        reader.laser_table = number
        row = reader.table(reader.as_table(entry, "laser"), _LASER_KEYS, "laser")
        if "channel" not in row:
            if isinstance(entry, dict) and "channel" in entry:
                continue
            reader.fault(rules.PROFILE_TYPE, "channel", "laser", wanted="0 or 1", found="missing")
            continue
        if any(source.channel == row["channel"] for source in sources):
            reader.fault(
                rules.PROFILE_RANGE, "channel", "laser", value=d.number(row["channel"]), range="another: it is taken"
            )
            continue
        sources.append(Laser(**{**row, "channel": int(row["channel"])}))
    for axis in ("field_x_mm", "field_y_mm"):
        if axis in values and values[axis][0] >= values[axis][1]:
            reader.fault(
                rules.PROFILE_RANGE, axis, "", value=str(list(values[axis])), range="[low, high] with low < high"
            )
            del values[axis]
    machine = replace(machine, **values, lasers=tuple(sources))
    reader.check_speeds(machine)
    return (machine, reader.faults) if not reader.faults else (Machine(), reader.faults)


@dataclass(slots=True)
class _Reader:
    """Collects the faults of one profile; TOML bears no positions, so an entry's line is looked up in the text."""

    text: str
    path: str
    laser_table: int = 0
    """Which of the [[laser]] tables is read."""
    faults: list[Diagnostic] = field(default_factory=list)

    def fault(self, rule: d.Rule, key: str, table: str, **fields: Any) -> None:
        name = f"{table}.{key}" if table else key
        self.faults.append(
            Diagnostic(rule=rule, span=self._find(key, table), fields={"key": name, **fields}, path=self.path)
        )

    def as_table(self, value: Any, key: str) -> Mapping[str, Any]:
        if isinstance(value, dict):
            return value
        self.fault(rules.PROFILE_TYPE, key, "", wanted="a table", found=_kind(value))
        return {}

    def table(
        self, data: Mapping[str, Any], keys: Mapping[str, Range], table: str, extra: tuple[str, ...] = ()
    ) -> dict[str, Any]:
        values: dict[str, Any] = {}
        known = [*keys, *_TEXTS, *extra]
        for key, value in data.items():
            if key in _TEXTS and table not in ("lookahead", "expansion"):
                if isinstance(value, str):
                    values[key] = value
                else:
                    self.fault(rules.PROFILE_TYPE, key, table, wanted="a text", found=_kind(value))
            elif key not in keys:
                from difflib import get_close_matches

                near = get_close_matches(key, known, 1)
                self.fault(rules.PROFILE_UNKNOWN, key, table, hint=f"; did you mean {near[0]}?" if near else "")
            elif key in _PAIR:
                pair = self._pair(key, value, keys[key], table)
                values.update({key: pair} if pair else {})
            elif (checked := self._number(key, value, keys[key], table)) is not None:
                values[key] = checked
        return values

    def scanner(self, value: Any) -> Scanner | None:
        if not isinstance(value, str):
            self.fault(
                rules.PROFILE_TYPE, "scanner", "", wanted='a text such as "first-order:250us"', found=_kind(value)
            )
            return None
        scanner = parse_scanner(value)
        if isinstance(scanner, Scanner):
            return scanner
        self.fault(rules.PROFILE_RANGE, "scanner", "", value=f'"{d.printable(value)[:40]}"', range=SCANNER_FORM)
        return None

    def _pair(self, key: str, value: Any, limits: Range, table: str) -> tuple[float, float] | None:
        items = [value, value] if key == "pulses_per_mm" and not isinstance(value, list) else value
        if not isinstance(items, list) or len(items) != 2:
            found = f"a list of {len(items)}" if isinstance(items, list) else _kind(value)
            self.fault(rules.PROFILE_TYPE, key, table, wanted="a list of two numbers", found=found)
            return None
        first = self._number(key, items[0], limits, table)
        second = None if first is None else self._number(key, items[1], limits, table)
        return None if first is None or second is None else (first, second)

    def _number(self, key: str, value: Any, limits: Range, table: str) -> float | None:
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.fault(rules.PROFILE_TYPE, key, table, wanted=_NUMBER, found=_kind(value))
            return None
        try:
            real = float(value)
        except OverflowError:
            real = math.inf
        if limits.verdict(real) or not limits.carries(real):
            self.fault(rules.PROFILE_RANGE, key, table, value=d.number(real), range=f"in {limits}")
            return None
        return real

    def check_speeds(self, machine: Machine) -> None:
        """The controller's own limits hold for the machine's speeds in pulses."""
        for key, value, limits in (
            ("max_velocity_mm_s", machine.max_velocity_pulse_per_ms, VELOCITY),
            ("max_acceleration_mm_s2", machine.max_acceleration_pulse_per_ms2, ACCELERATION),
        ):
            if limits.verdict(value):
                shown = f"{d.number(getattr(machine, key))}, that is {d.number(value)} {limits.unit}"
                self.fault(rules.PROFILE_RANGE, key, "", value=shown, range=f"in {limits}")

    def _find(self, key: str, table: str) -> Span:
        """The line of an entry or table; the head of the entry's table, or the first line, where there is none."""
        inside, lasers, head = "", -1, d.NOWHERE
        for index, line in enumerate(self.text.splitlines(), 1):
            bare = line.split("#")[0].strip()
            is_head = bare.startswith("[")
            name = bare.strip("[] ") if is_head else bare.split("=")[0].strip(" \"'")
            if is_head:
                inside = name
                lasers += name == "laser"
            column = line.find(name) + 1
            span = Span(line=index, column=column, end_line=index, end_column=column + len(name))
            here = inside == table and (table != "laser" or lasers == self.laser_table)
            if name == key and (here or is_head):
                return span
            head = span if here and is_head else head
        return head


def _kind(value: Any) -> str:
    names = {bool: "true or false", int: _NUMBER, float: _NUMBER, str: "a text", list: "a list", dict: "a table"}
    return names.get(type(value), type(value).__name__)


def _line_of(message: str) -> int:
    digits = "".join(c if c.isdigit() else " " for c in message.partition("line")[2]).split()
    return int(digits[0]) if digits else 1
