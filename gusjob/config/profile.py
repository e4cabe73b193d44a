"""The machine profile: TOML to a Machine, with diagnostics instead of exceptions for what is wrong in it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from gusjob.config.machine import (
    SCANNER_FORM,
    Abi,
    Budget,
    ControllerSettings,
    Interlock,
    Laser,
    Machine,
    Scanner,
    parse_scanner,
)
from gusjob.controllers.gus.ranges import (
    ACCELERATION,
    CARRIER_KHZ,
    CHANNEL,
    LOOKAHEAD_TIME_MS,
    SHORT,
    SWITCH_VALUE,
    VELOCITY,
    Range,
)
from gusjob.diagnostics import model as d
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Span
from gusjob.diagnostics.select import RuleSelection, SelectionLayer
from gusjob.i18n.phrases import Phrase, all_of, any_of, did_you_mean, number, printable, reason_of

PROFILE_NAME = "gusjob.toml"

Wanted = Range | type[str] | type[bool] | type[Abi]
"""What an entry must be: a number in a range, a text, true or false, one of the ABIs."""


def _positive(name: str, unit: str, high: float = math.inf) -> Range:
    return Range(name=name, unit=unit, low=0, high=high, low_open=True, high_open=True, section="profile")


_COORDINATE_MM = Range(name="field", unit="mm", low=-1e6, high=1e6, section="profile")
_PAIR = {"pulses_per_mm", "field_x_mm", "field_y_mm"}
_MACHINE_KEYS: dict[str, Wanted] = {
    "name": str,
    "pulses_per_mm": _positive("pulses per mm", "pulse/mm", 1e7),
    "field_x_mm": _COORDINATE_MM,
    "field_y_mm": _COORDINATE_MM,
    "max_velocity_mm_s": _positive("velocity", "mm/s", 1e9),
    "max_acceleration_mm_s2": _positive("acceleration", "mm/s2", 1e12),
    "period_us": Range(name="period", unit="us", low=1, high=1e6, section="profile"),
    "host_calls_per_s": _positive("calls per second", "1/s", 1e9),
    "chord_tolerance_um": Range(name="chord tolerance", unit="um", low=0.01, high=1000, section="profile"),
}
_LOOKAHEAD_KEYS: dict[str, Wanted] = {
    "time_ms": LOOKAHEAD_TIME_MS,
    "acc_pulse_per_ms2": ACCELERATION,
}
_EXPANSION_KEYS: dict[str, Wanted] = {
    "max_statements": Range(name="statements", unit="", low=1, high=1e8, whole=True, section="profile"),
    "max_depth": Range(name="depth", unit="", low=1, high=150, whole=True, section="profile"),
    "max_includes": Range(name="includes", unit="", low=0, high=32, whole=True, section="profile"),
}
_LASER_KEYS: dict[str, Wanted] = {
    "name": str,
    "channel": CHANNEL,
    "rated_w": _positive("rated power", "W", 1e6),
    "max_frequency_khz": CARRIER_KHZ,
}
_BUDGET_KEYS: dict[str, Wanted] = {
    entry.name: Range(name=entry.name, unit="", low=0, high=1e12, section="profile") for entry in fields(Budget)
}
_RULES_KEYS = ("select", "ignore", "severity")
_CONTROLLER_KEYS: dict[str, Wanted] = {
    "library": str,
    "abi": Abi,
    "configuration": str,
    "card": Range(name="card", unit="", low=0, high=15, whole=True, section="profile"),
    "open_channel": SHORT,
    "open_param": SHORT,
    "axes_off_after": bool,
    "call_timeout_s": Range(name="time-out", unit="s", low=0.01, high=600, section="profile"),
    "link_patience_s": Range(name="patience", unit="s", low=0.01, high=600, section="profile"),
    "position_tolerance_pulse": Range(name="tolerance", unit="pulse", low=0, high=1e6, section="profile"),
}
_INTERLOCK_KEYS: dict[str, Wanted] = {
    "di_type": SHORT,
    "input": Range(name="input", unit="", low=0, high=31, whole=True, section="profile"),
    "value": SWITCH_VALUE,
}
_PATHS = Phrase("a list of tables, [[check.path]]")
_GLOB = Phrase('a text such as "samples/*.job"')
_CODES = Phrase('a list of codes such as ["GJ304", "GJ7"]')
_SEVERITIES = Phrase('a table of codes with "error", "warning" or "note"')
_KNOWN_CODES = Phrase("the code of a rule or the beginning of codes (`gusjob explain` lists them)")
_ONE_OF_SEVERITIES = Phrase('"error", "warning" or "note"')
_STAYS_ERROR = Phrase("left an error: what is refused can't be made less")
_NUMBER, _TEXT, _TABLE, _BOOLEAN = Phrase("a number"), Phrase("a text"), Phrase("a table"), Phrase("true or false")


def find_profile(job: Path) -> Path | None:
    """The nearest gusjob.toml in the job's folder or above it."""
    folder = job.resolve().parent
    return next((p for f in (folder, *folder.parents) if (p := f / PROFILE_NAME).is_file()), None)


def read_machine(path: Path) -> tuple[Machine, list[Diagnostic]]:
    """The profile at `path`; the defaults stand in for what is wrong or missing."""
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        fields = {"reason": reason_of(error)}
        return Machine(), [Diagnostic(rule=rules.UNREADABLE, span=d.NOWHERE, fields=fields, path=str(path))]
    except UnicodeDecodeError as error:
        return Machine(), [
            Diagnostic(rule=rules.NOT_TEXT, span=d.NOWHERE, fields={"reason": error.reason}, path=str(path))
        ]
    machine, diagnostics = parse_machine(text, str(path))
    folder = path.resolve().parent
    machine = replace(machine, selection=replace(machine.selection, folder=str(folder)))
    return _beside(machine, folder), diagnostics


def _beside(machine: Machine, folder: Path) -> Machine:
    """Files that the profile names are looked for beside it; a bare name that is not there is the system's matter."""

    def beside(name: str) -> str:
        return str(folder / name) if name and (folder / name).exists() else name

    controller = machine.controller
    library, configuration = beside(controller.library), beside(controller.configuration)
    return replace(machine, controller=replace(controller, library=library, configuration=configuration))


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
    tables = ("lookahead", "expansion", "laser", "controller", "budget", "check")
    apart = (*tables, "scanner")
    top = {k: v for k, v in data.items() if k not in apart}
    values = reader.table(top, _MACHINE_KEYS, "", extra=apart)
    if "scanner" in data:
        values["scanner"] = reader.scanner(data["scanner"])
    ahead = reader.table(reader.as_table(data.get("lookahead", {}), "lookahead"), _LOOKAHEAD_KEYS, "lookahead")
    values.update({f"lookahead_{k}": v for k, v in ahead.items()})
    limits = reader.table(reader.as_table(data.get("expansion", {}), "expansion"), _EXPANSION_KEYS, "expansion")
    values.update({f"expansion_{k}": int(v) for k, v in limits.items()})
    values["budget"] = Budget(**reader.table(reader.as_table(data.get("budget", {}), "budget"), _BUDGET_KEYS, "budget"))
    values["selection"] = RuleSelection(layers=reader.layers(data.get("check", {})))
    values["controller"] = reader.controller(data.get("controller", {}))
    lasers = data.get("laser", [])
    if not isinstance(lasers, list):
        wanted = Phrase("a list of tables, [[laser]]")
        reader.diagnostic(rules.PROFILE_TYPE, "laser", "", wanted=wanted, found=_kind(lasers))
        lasers = []
    sources: list[Laser] = []
    for at, entry in enumerate(lasers):
        reader.laser_table = at
        row = reader.table(reader.as_table(entry, "laser"), _LASER_KEYS, "laser")
        if "channel" not in row:
            if isinstance(entry, dict) and "channel" in entry:
                continue
            numbers, found = any_of(("0", "1")), Phrase("missing")
            reader.diagnostic(rules.PROFILE_TYPE, "channel", "laser", wanted=numbers, found=found)
            continue
        if any(source.channel == row["channel"] for source in sources):
            taken, value = Phrase("another: it is taken"), number(row["channel"])
            reader.diagnostic(rules.PROFILE_RANGE, "channel", "laser", value=value, range=taken)
            continue
        sources.append(Laser(**{**row, "channel": int(row["channel"])}))
    for axis in ("field_x_mm", "field_y_mm"):
        if axis in values and values[axis][0] >= values[axis][1]:
            ordered = Phrase("[low, high] with low < high")
            reader.diagnostic(rules.PROFILE_RANGE, axis, "", value=str(list(values[axis])), range=ordered)
            del values[axis]
    machine = replace(machine, **values, lasers=tuple(sources))
    reader.check_speeds(machine)
    return (machine, reader.diagnostics) if not reader.diagnostics else (Machine(), reader.diagnostics)


@dataclass(slots=True)
class _Reader:
    """Collects the diagnostics of one profile; TOML bears no positions, so an entry's line is looked up in the text."""

    text: str
    path: str
    laser_table: int = 0
    """Which of the [[laser]] tables is read."""
    diagnostics: list[Diagnostic] = field(default_factory=list)

    def diagnostic(self, rule: d.Rule, key: str, table: str, **fields: Any) -> None:
        name = f"{table}.{key}" if table else key
        self.diagnostics.append(
            Diagnostic(rule=rule, span=self._find(key, table), fields={"key": name, **fields}, path=self.path)
        )

    def as_table(self, value: Any, key: str) -> Mapping[str, Any]:
        if isinstance(value, dict):
            return value
        self.diagnostic(rules.PROFILE_TYPE, key, "", wanted=_TABLE, found=_kind(value))
        return {}

    def table(
        self, data: Mapping[str, Any], keys: Mapping[str, Wanted], table: str, extra: tuple[str, ...] = ()
    ) -> dict[str, Any]:
        values: dict[str, Any] = {}
        known = [*keys, *extra]
        for key, value in data.items():
            if key not in keys:
                from difflib import get_close_matches

                near = get_close_matches(key, known, 1)
                self.diagnostic(rules.PROFILE_UNKNOWN, key, table, hint=did_you_mean(near[0] if near else ""))
            elif (checked := self._entry(key, value, keys[key], table)) is not None:
                values[key] = checked
        return values

    def _entry(self, key: str, value: Any, wanted: Wanted, table: str) -> Any:
        """An entry's value, or None with a diagnostic."""
        if isinstance(wanted, Range):
            return self._pair(key, value, wanted, table) if key in _PAIR else self._number(key, value, wanted, table)
        if wanted is bool:
            if not isinstance(value, bool):
                self.diagnostic(rules.PROFILE_TYPE, key, table, wanted=_BOOLEAN, found=_kind(value))
            return value if isinstance(value, bool) else None
        if not isinstance(value, str):
            self.diagnostic(rules.PROFILE_TYPE, key, table, wanted=_TEXT, found=_kind(value))
            return None
        if wanted is Abi and value not in list(Abi):
            shown = f'"{printable(value)[:40]}"'
            self.diagnostic(
                rules.PROFILE_RANGE, key, table, value=shown, range=Phrase("one of {names}", names=all_of(Abi))
            )
            return None
        return Abi(value) if wanted is Abi else value

    def controller(self, data: Any) -> ControllerSettings:
        """The [controller] table with its [controller.interlock]."""
        entries = dict(self.as_table(data, "controller"))
        inner = entries.pop("interlock", None)
        values = self.table(entries, _CONTROLLER_KEYS, "controller", extra=("interlock",))
        values.update({key: int(values[key]) for key in ("card", "open_channel", "open_param") if key in values})
        interlock = None
        if inner is not None:
            row = self.table(self.as_table(inner, "interlock"), _INTERLOCK_KEYS, "controller.interlock")
            interlock = Interlock(**{key: int(value) for key, value in row.items()})
        return ControllerSettings(**values, interlock=interlock)

    def layers(self, data: Any) -> tuple[SelectionLayer, ...]:
        """The [check] table, with its [[check.path]] tables behind it."""
        entries = dict(self.as_table(data, "check"))
        paths = entries.pop("path", [])
        if not isinstance(paths, list):
            self.diagnostic(rules.PROFILE_TYPE, "path", "check", wanted=_PATHS, found=_kind(paths))
            paths = []
        layers = [self._layer(entries, "check", ())]
        for entry in paths:
            if not isinstance(entry, dict):
                self.diagnostic(rules.PROFILE_TYPE, "path", "check", wanted=_PATHS, found=_kind(paths))
                continue
            layer, glob = self._layer(entry, "check.path", ("glob",)), entry.get("glob")
            if not isinstance(glob, str) or not glob:
                found = _kind(glob) if "glob" in entry else Phrase("missing")
                self.diagnostic(rules.PROFILE_TYPE, "glob", "check.path", wanted=_GLOB, found=found)
                continue
            layers.append(replace(layer, glob=glob))
        return tuple(layer for layer in layers if layer != SelectionLayer(glob=layer.glob))

    def _layer(self, row: Mapping[str, Any], table: str, extra: tuple[str, ...]) -> SelectionLayer:
        """What one table says of rules."""
        known = {key: value for key, value in row.items() if key in _RULES_KEYS}
        others = {key: value for key, value in row.items() if key not in (*known, *extra)}
        self.table(others, {}, table, (*_RULES_KEYS, *extra))
        select, ignore = (self._codes(known.get(key, []), key, table) for key in ("select", "ignore"))
        return SelectionLayer(select=select, ignore=ignore, severity=self._severities(known.get("severity", {}), table))

    def _codes(self, value: Any, key: str, table: str) -> tuple[str, ...]:
        """Codes of rules, or their beginnings."""
        wrong = [code for code in value if not isinstance(code, str)] if isinstance(value, list) else [value]
        if wrong:
            self.diagnostic(rules.PROFILE_TYPE, key, table, wanted=_CODES, found=_kind(wrong[0]))
            return ()
        return tuple(code.upper() for code in value if self._is_code(code.upper(), key, table))

    def _is_code(self, code: str, key: str, table: str) -> bool:
        known = bool(code) and any(rule.startswith(code) for rule in rules.RULES)
        if not known:
            self.diagnostic(rules.PROFILE_RANGE, key, table, value=_quoted(code), range=_KNOWN_CODES)
        return known

    def _severities(self, value: Any, table: str) -> tuple[tuple[str, d.Severity], ...]:
        """Severities by code or beginning of codes."""
        if not isinstance(value, dict):
            self.diagnostic(rules.PROFILE_TYPE, "severity", table, wanted=_SEVERITIES, found=_kind(value))
            return ()
        words = {severity.value: severity for severity in d.Severity}
        found = []
        for code, word in value.items():
            if not self._is_code(code, "severity", table):
                continue
            if not isinstance(word, str) or word not in words:
                shown = _quoted(word) if isinstance(word, str) else _kind(word)
                self.diagnostic(rules.PROFILE_RANGE, "severity", table, value=shown, range=_ONE_OF_SEVERITIES)
            elif code in rules.RULES and rules.RULES[code].severity is d.Severity.ERROR and word != "error":
                self.diagnostic(rules.PROFILE_RANGE, "severity", table, value=f'{code} = "{word}"', range=_STAYS_ERROR)
            else:
                found.append((code, words[word]))
        return tuple(found)

    def scanner(self, value: Any) -> Scanner | None:
        if not isinstance(value, str):
            wanted = Phrase('a text such as "first-order:250us"')
            self.diagnostic(rules.PROFILE_TYPE, "scanner", "", wanted=wanted, found=_kind(value))
            return None
        scanner = parse_scanner(value)
        if isinstance(scanner, Scanner):
            return scanner
        self.diagnostic(rules.PROFILE_RANGE, "scanner", "", value=f'"{printable(value)[:40]}"', range=SCANNER_FORM)
        return None

    def _pair(self, key: str, value: Any, limits: Range, table: str) -> tuple[float, float] | None:
        items = [value, value] if key == "pulses_per_mm" and not isinstance(value, list) else value
        if not isinstance(items, list) or len(items) != 2:
            found = Phrase("a list of {count}", count=len(items)) if isinstance(items, list) else _kind(value)
            self.diagnostic(rules.PROFILE_TYPE, key, table, wanted=Phrase("a list of two numbers"), found=found)
            return None
        first = self._number(key, items[0], limits, table)
        second = None if first is None else self._number(key, items[1], limits, table)
        return None if first is None or second is None else (first, second)

    def _number(self, key: str, value: Any, limits: Range, table: str) -> float | None:
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.diagnostic(rules.PROFILE_TYPE, key, table, wanted=_NUMBER, found=_kind(value))
            return None
        try:
            real = float(value)
        except OverflowError:
            real = math.inf
        if limits.classify_one(real) or not limits.carries(real):
            self.diagnostic(rules.PROFILE_RANGE, key, table, value=number(real), range=_within(limits))
            return None
        return real

    def check_speeds(self, machine: Machine) -> None:
        """The controller's own limits hold for the machine's speeds in pulses."""
        for key, value, limits in (
            ("max_velocity_mm_s", machine.max_velocity_pulse_per_ms, VELOCITY),
            ("max_acceleration_mm_s2", machine.max_acceleration_pulse_per_ms2, ACCELERATION),
        ):
            if limits.classify_one(value):
                written, pulses = number(getattr(machine, key)), f"{number(value)} {limits.unit}"
                shown = Phrase("{value}, that is {pulses}", value=written, pulses=pulses)
                self.diagnostic(rules.PROFILE_RANGE, key, "", value=shown, range=_within(limits))

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


def _quoted(text: str) -> str:
    return f'"{printable(text)[:40]}"'


def _kind(value: Any) -> str:
    names: dict[str, str] = {
        "bool": _BOOLEAN, "int": _NUMBER, "float": _NUMBER, "str": _TEXT, "list": Phrase("a list"), "dict": _TABLE,
        "date": Phrase("date"), "time": Phrase("time"), "datetime": Phrase("datetime"),
    }  # fmt: skip
    return names.get(type(value).__name__, type(value).__name__)


def _within(allowed: Range) -> str:
    return Phrase("in {range}", range=str(allowed))


def _line_of(message: str) -> int:
    digits = "".join(c if c.isdigit() else " " for c in message.partition("line")[2]).split()
    return int(digits[0]) if digits else 1
