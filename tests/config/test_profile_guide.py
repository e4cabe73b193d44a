"""docs/profile.md: its table is generated from the entries of the machine, and its example is a valid profile."""

from __future__ import annotations

import re
from collections.abc import Iterator
from enum import StrEnum
from typing import Any

from msgspec import Struct
from support.tools import ROOT

from gusjob.config.entry import Entry, entries_of
from gusjob.config.machine import Laser, Machine, Scanner
from gusjob.config.profile import parse_profile
from gusjob.controllers.gus.ranges import Range
from gusjob.i18n.phrases import number

GUIDE = ROOT / "docs" / "profile.md"
_TABLE = re.compile(r"(<!-- table: entries -->\n).*?(<!-- end -->)", re.DOTALL)


def toml(value: Any) -> str:
    match value:
        case bool():
            return str(value).lower()
        case str():
            return f'"{value}"'
        case (first, second) if first == second:
            return toml(first)
        case tuple():
            return f"[{', '.join(map(toml, value))}]"
        case _:
            return number(value)


def default_of(table: type, name: str) -> Any:
    default = getattr(table(), name)
    return None if default == "" else default


def allowed(entry: Entry) -> str:
    kind = entry.kind
    if isinstance(kind, Range):
        whole = "whole number" if kind.whole else "number"
        return f"two {whole}s in {kind}" if entry.pair and not entry.single else f"{whole} in {kind}"
    if kind is bool:
        return "`true` or `false`"
    if kind is Scanner:
        return "text, see [Scanner](#scanner)"
    return ", ".join(f'`"{value}"`' for value in kind) if issubclass(kind, StrEnum) else "text"


def entries(table: type = Machine, name: str = "") -> Iterator[tuple[str, str, Entry, Any]]:
    """(table, key, entry, default) of every entry of a profile, table by table."""
    inner: list[tuple[type, str]] = []
    for key, (field_name, entry) in entries_of(table).items():
        if isinstance(entry.kind, type) and issubclass(entry.kind, Struct) and entry.kind is not Scanner:
            full = f"{name}.{key}" if name else key
            inner.append((entry.kind, f"[{full}]" if entry.repeated else full))
            continue
        head, _, last = key.rpartition(".")
        yield f"[{head or name}]" if head or name else "", last, entry, default_of(table, field_name)
    for kind, full in inner:
        yield from entries(kind, full)


def guide_table() -> str:
    text, before = "", None
    for table, key, entry, default in entries():
        if table != before:
            text += f"\n### `{table}`\n\n" if table else "### Top level\n\n"
            text += "| entry | allowed | default | meaning |\n|---|---|---|---|\n"
            before = table
        value = f"`{toml(default)}`" if default is not None else "none"
        text += f"| `{key}` | {allowed(entry)} | {value} | {entry.help} |\n"
    return text


def test_the_table_of_entries_equals_the_code(rewrite: bool) -> None:
    text = GUIDE.read_text(encoding="utf-8")
    fresh = _TABLE.sub(lambda found: found[1] + guide_table() + found[2], text)
    if rewrite:
        GUIDE.write_text(fresh, encoding="utf-8", newline="\n")
    else:
        assert text == fresh, "run pytest --rewrite"


def test_every_entry_has_a_help_text() -> None:
    assert [f"{table} {key}" for table, key, entry, _ in entries() if not entry.help] == []


def test_a_profile_of_all_defaults_and_examples_is_valid() -> None:
    """The defaults of the guide read back as the defaults, and every example is allowed."""
    lines, before = list[str](), ""
    for table, key, entry, default in entries():
        if table != before:
            lines.append(table)
            before = table
        lines.append(f"{key} = {toml(default) if default is not None else entry.example}")
    profile = parse_profile("\n".join(lines))
    assert profile.diagnostics == ()
    assert profile.machine.pulses_per_mm == Machine().pulses_per_mm
    assert profile.machine.expansion_max_depth == Machine().expansion_max_depth
    assert profile.machine.lasers == (Laser(channel=0, name="30 W CO2", rated_w=30, max_frequency_khz=25),)


def test_the_example_is_a_valid_profile() -> None:
    (example,) = re.findall(r"```toml\n(.*?)```", GUIDE.read_text(encoding="utf-8"), re.DOTALL)
    profile = parse_profile(example, "gusjob.toml")
    assert profile.diagnostics == ()
    assert profile.machine.controller.interlock is not None
    assert len(profile.selection.layers) == 2
    wrong = parse_profile(example.replace("input = 3", "input = 32"), "gusjob.toml").diagnostics[0]
    shown = f"gusjob.toml:{wrong.span.line}:{wrong.span.column}: error[{wrong.rule.code}]: {wrong.message}"
    assert shown in GUIDE.read_text(encoding="utf-8")
