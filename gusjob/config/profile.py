"""Find, read and check the machine profile, gusjob.toml. Every wrong value gets a diagnostic.

The allowed values of an entry are in the annotation of the machine's field (machine.py); rule_tables.py reads [check].
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import Struct, field
from msgspec.structs import replace

from gusjob.config.machine import Machine
from gusjob.controllers.gus.ranges import ACCELERATION, VELOCITY
from gusjob.diagnostics import rules
from gusjob.diagnostics.characters import report_hidden
from gusjob.diagnostics.model import NOWHERE, Diagnostic, Rule, Span
from gusjob.diagnostics.select import RuleSelection
from gusjob.i18n.phrases import Phrase, number, reason_of
from gusjob.inputs import exists, open_input

if TYPE_CHECKING:  # Most jobs have no profile: what reads one is imported when there is one, for a fast start.
    from gusjob.config.table_reader import TableReader
    from gusjob.config.toml_spans import TomlNode

PROFILE_NAME = "gusjob.toml"
MAX_PROFILE_MB = 10
CHECK = "check"
"""The table of a profile that selects rules."""


class Profile(Struct, frozen=True, kw_only=True):
    """A machine profile.

    `machine`: the defaults, if anything is wrong. `selection`: the rules of [check]. `source`: the file, None for the
    defaults or a text. `text`: its text, None if the file can't be read or is not text.
    """

    machine: Machine = field(default_factory=Machine)
    selection: RuleSelection = field(default_factory=RuleSelection)
    diagnostics: tuple[Diagnostic, ...] = ()
    source: Path | None = None
    text: str | None = None


def find_profile(job: Path) -> Path | None:
    """Return the nearest gusjob.toml in the job's folder or above it."""
    folder = job.resolve().parent
    return next((p for f in (folder, *folder.parents) if (p := f / PROFILE_NAME).is_file()), None)


def read_profile(path: Path) -> Profile:
    """Read a profile. Files that it names, and the globs of [check], are relative to its folder."""
    limit = MAX_PROFILE_MB * 1_000_000
    try:
        with open_input(path) as file:  # A pipe can be read only once, and a device may have no end.
            data = file.read(limit + 1)
        if len(data) > limit:
            size = max(path.stat().st_size, len(data)) // 1_000_000
            return _unreadable(rules.TOO_LARGE, path, size=str(size), limit=str(MAX_PROFILE_MB))
    except OSError as error:
        return _unreadable(rules.UNREADABLE, path, reason=reason_of(error))
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        return _unreadable(rules.NOT_TEXT, path, reason=error.reason)
    if "\0" in text:
        return _unreadable(rules.NOT_TEXT, path, reason=Phrase("it holds NUL bytes (a binary file?)"))
    profile = parse_profile(text, str(path))
    folder = path.resolve().parent
    return replace(
        profile,
        machine=_with_paths(profile.machine, folder),
        selection=replace(profile.selection, folder=str(folder)),
        source=path,
        text=text,
    )


def parse_profile(text: str, name: str = "") -> Profile:
    """Read a profile from TOML text. `name`: the path in its diagnostics."""
    import tomllib

    from gusjob.config.rule_tables import read_rule_tables
    from gusjob.config.table_reader import TableReader
    from gusjob.config.toml_spans import error_span, long_integer_span, parse_toml

    text = text.replace("\r\n", "\n").replace("\r", "\n")
    if hidden := report_hidden(text.encode("utf-8", "surrogatepass"), name):
        return Profile(diagnostics=tuple(hidden))
    try:
        root = parse_toml(text)
    except tomllib.TOMLDecodeError as error:
        return _not_toml(name, error_span(str(error), text), str(error))
    except RecursionError:
        return _not_toml(name, NOWHERE, Phrase("its arrays are nested too deep"))
    except ValueError:
        return _not_toml(name, long_integer_span(text), Phrase("an integer has too many digits"))
    reader = TableReader(path=name)
    machine = Machine(**reader.fields(root, Machine, extra=(CHECK,)))
    check = root.value.get(CHECK)
    selection = RuleSelection() if check is None else read_rule_tables(check, reader, CHECK)
    _check_pulses(reader, root, machine)
    if reader.diagnostics:
        return Profile(diagnostics=tuple(reader.diagnostics))
    return Profile(machine=machine, selection=selection)


def _unreadable(rule: Rule, path: Path, **values: str) -> Profile:
    diagnostic = Diagnostic(rule=rule, span=NOWHERE, fields=values, path=str(path))
    return Profile(diagnostics=(diagnostic,), source=path)


def _not_toml(name: str, span: Span, reason: str) -> Profile:
    diagnostic = Diagnostic(rule=rules.PROFILE_SYNTAX, span=span, fields={"reason": reason}, path=name)
    return Profile(diagnostics=(diagnostic,))


def _with_paths(machine: Machine, folder: Path) -> Machine:
    """Resolve the files that the profile names: beside it, or, if there is none, where the system looks for them."""

    def resolved(name: str) -> str:
        return str(folder / name) if name and exists(folder / name) else name

    controller = machine.controller
    library, configuration = resolved(controller.library), resolved(controller.configuration)
    return replace(machine, controller=replace(controller, library=library, configuration=configuration))


def _check_pulses(reader: TableReader, root: TomlNode, machine: Machine) -> None:
    """Check the machine's limits in pulses against the ranges of the controller."""
    from gusjob.config.table_reader import within

    for key, value, limits in (
        ("max_velocity_mm_s", machine.max_velocity_pulse_per_ms, VELOCITY),
        ("max_acceleration_mm_s2", machine.max_acceleration_pulse_per_ms2, ACCELERATION),
    ):
        if limits.classify_one(value):
            written, pulses = number(getattr(machine, key)), f"{number(value)} {limits.unit}"
            shown = Phrase("{value}, that is {pulses}", value=written, pulses=pulses)
            node = root.value.get(key) or root.value.get("pulses_per_mm") or root
            reader.report(rules.PROFILE_RANGE, node.span, key, value=shown, range=within(limits))
