"""The tables [check] and [[check.path]] of a profile: which rules are reported, with which severity."""

from __future__ import annotations

from msgspec.structs import replace

from gusjob.config.table_reader import MISSING, TableReader, quoted, type_name
from gusjob.config.toml_spans import TomlNode
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Severity
from gusjob.diagnostics.select import RuleSelection, SelectionLayer
from gusjob.i18n.phrases import Phrase

_KEYS = ("select", "ignore", "severity")
_PATH, _GLOB = "path", "glob"

_TABLE = Phrase("a table")
_PATH_TABLES = Phrase("a list of tables, [[check.path]]")
_GLOB_TEXT, _EMPTY = Phrase('a text such as "samples/*.job"'), Phrase("empty")
_CODES = Phrase('a list of codes such as ["GJ304", "GJ7"]')
_SEVERITY_TABLE = Phrase('a table of codes with "error", "warning" or "note"')
_KNOWN_CODES = Phrase("the code of a rule or a prefix of codes (`gusjob explain` lists them)")
_SEVERITIES = Phrase('"error", "warning" or "note"')
_STAYS_ERROR = Phrase('"error": the severity of an error can\'t be lowered')


def read_rule_tables(node: TomlNode, reader: TableReader, name: str) -> RuleSelection:
    """Read [check] with its [[check.path]] tables, which are layers above it."""
    if not isinstance(node.value, dict):
        reader.report_type(node, name, _TABLE)
        return RuleSelection()
    layers = [_layer(node, reader, name, _PATH)]
    paths = node.value.get(_PATH)
    if paths is not None:
        layers += _path_layers(paths, reader, f"{name}.{_PATH}")
    return RuleSelection(layers=tuple(layer for layer in layers if layer != SelectionLayer(glob=layer.glob)))


def _path_layers(paths: TomlNode, reader: TableReader, name: str) -> list[SelectionLayer]:
    if not isinstance(paths.value, list):
        reader.report_type(paths, name, _PATH_TABLES)
        return []
    layers = []
    for node in paths.value:
        if not isinstance(node.value, dict):
            reader.report_type(node, name, _PATH_TABLES)
            continue
        layer, glob = _layer(node, reader, name, _GLOB), node.value.get(_GLOB)
        if glob is None or not isinstance(glob.value, str) or not glob.value:
            found = MISSING if glob is None else _EMPTY if glob.value == "" else type_name(glob.value)
            span = (glob or node).span
            reader.report(rules.PROFILE_TYPE, span, f"{name}.{_GLOB}", wanted=_GLOB_TEXT, found=found)
            continue
        layers.append(replace(layer, glob=glob.value))
    return layers


def _layer(node: TomlNode, reader: TableReader, name: str, extra: str) -> SelectionLayer:
    """Read the rules of one table. `extra`: its key that is read elsewhere."""
    codes: dict[str, tuple[str, ...]] = {}
    severity: tuple[tuple[str, Severity], ...] = ()
    for key, child in node.value.items():
        full_key = f"{name}.{key}"
        if key == "severity":
            severity = _severities(child, reader, full_key)
        elif key in _KEYS:
            codes[key] = _codes(child, reader, full_key)
        elif key != extra:
            reader.report_unknown(child, full_key, key, [*_KEYS, extra])
    return SelectionLayer(select=codes.get("select", ()), ignore=codes.get("ignore", ()), severity=severity)


def _codes(node: TomlNode, reader: TableReader, key: str) -> tuple[str, ...]:
    """Read a list of codes or beginnings of codes."""
    wrong = [item for item in node.value if not isinstance(item.value, str)] if isinstance(node.value, list) else [node]
    for item in wrong:
        reader.report_type(item, key, _CODES)
    if wrong:
        return ()
    known = [item.value.upper() for item in node.value if _is_known(item.value.upper(), item, reader, key)]
    return tuple(known)


def _is_known(code: str, node: TomlNode, reader: TableReader, key: str) -> bool:
    known = bool(code) and any(rule.startswith(code) for rule in rules.RULES)
    if not known:
        reader.report_range(node, key, quoted(code), _KNOWN_CODES)
    return known


def _severities(node: TomlNode, reader: TableReader, key: str) -> tuple[tuple[str, Severity], ...]:
    """Read the table of severities by code or beginning of codes."""
    if not isinstance(node.value, dict):
        reader.report_type(node, key, _SEVERITY_TABLE)
        return ()
    words = {severity.value: severity for severity in Severity}
    found = []
    for written, child in node.value.items():
        code, word = written.upper(), child.value
        if not _is_known(code, replace(child, span=child.key_span), reader, key):
            continue
        if not isinstance(word, str) or word not in words:
            shown = quoted(word) if isinstance(word, str) else type_name(word)
            reader.report_range(child, key, shown, _SEVERITIES)
        elif code in rules.RULES and rules.RULES[code].severity is Severity.ERROR and word != "error":
            reader.report_range(child, key, f'{code} = "{word}"', _STAYS_ERROR)
        else:
            found.append((code, words[word]))
    return tuple(found)
