"""Diagnostics as SARIF 2.1.0, the format of code scanning. Sections (§) are those of the OASIS standard."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any
from urllib.parse import quote

import orjson
from msgspec import Struct, field

from gusjob.diagnostics.formats.fingerprints import Fingerprints
from gusjob.diagnostics.formats.text import TextOf
from gusjob.diagnostics.model import Diagnostic, Rule, Span
from gusjob.diagnostics.rules import RULES
from gusjob.i18n.language import language, translated
from gusjob.i18n.phrases import Phrase, localized, printable
from gusjob.patterns import lazy_pattern
from gusjob.version import __version__

SCHEMA = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"
ROOT = "%SRCROOT%"
"""The folder in which gusjob was called, usually the top of a checkout."""
FINGERPRINT = "gusjobLine/v1"
"""The project's own name (§3.27.17): GitHub adds its own fingerprint and rejects another value under that name."""

_LANGUAGES = {"en": "en-US", "zh": "zh-CN"}
_FULL_STOP, _BAD, _GOOD = Phrase("."), Phrase("Bad"), Phrase("Good")
_LINK = lazy_pattern(r"\[(?=[^\[\]]*\]\()")


class SarifLog(Struct, kw_only=True):
    """One run of the tool, file by file; no source text is kept.

    A diagnostic that several jobs share (in a file that they include, or in their profile) is one result, since it has
    one position to correct.
    """

    results: dict[tuple[object, ...], dict[str, Any]] = field(default_factory=dict)
    notifications: list[dict[str, Any]] = field(default_factory=list)
    fingerprints: Fingerprints = field(default_factory=Fingerprints)

    def add(self, path: Path, diagnostics: Iterable[Diagnostic], text_of: TextOf, *, readable: bool) -> None:
        """Add the diagnostics of a file. `readable`: the file could be checked at all."""
        for diagnostic in diagnostics:
            location = _location(path, diagnostic.path, diagnostic.span)
            if readable:
                self._add_result(path, diagnostic, location, text_of)
            else:
                self.notifications.append(_message(diagnostic) | {"locations": [location]})

    def _add_result(self, path: Path, diagnostic: Diagnostic, location: dict[str, Any], text_of: TextOf) -> None:
        uri = str(location["physicalLocation"]["artifactLocation"]["uri"])
        key = (diagnostic.rule.code, diagnostic.message, uri, *location["physicalLocation"]["region"].items())
        result = self.results.get(key)
        if result is None:
            result = self.results[key] = _message(diagnostic) | {
                "locations": [location],
                "occurrenceCount": 0,
                "partialFingerprints": {FINGERPRINT: self.fingerprints.of(diagnostic, uri, text_of)},
                "relatedLocations": [],
            }
        result["occurrenceCount"] += diagnostic.count
        for remark in diagnostic.remarks:
            related = _location(path, diagnostic.path, remark.span)
            related["message"] = {"text": message_text(remark.localized)}
            if related not in result["relatedLocations"]:
                result["relatedLocations"].append(related)

    def to_bytes(self) -> bytes:
        """Return the log file."""
        results = [_without_defaults(result) for result in self.results.values()]
        rules, notices = _numbered(results, "ruleId"), _numbered(self.notifications, "ruleId")
        run = {
            "language": _LANGUAGES[language()],
            "tool": {
                "driver": {
                    "name": "gusjob",
                    "version": __version__,
                    "rules": [descriptor(RULES[code]) for code in rules],
                    "notifications": [descriptor(RULES[code]) for code in notices],
                }
            },
            "invocations": [
                {
                    "executionSuccessful": not self.notifications,
                    "toolExecutionNotifications": [_notification(n, notices) for n in self.notifications],
                }
            ],
            "originalUriBaseIds": {ROOT: {"description": {"text": "The folder that gusjob was called in."}}},
            "columnKind": "unicodeCodePoints",
            "results": [{"ruleIndex": rules[result["ruleId"]], **result} for result in results],
        }
        log = {"$schema": SCHEMA, "version": "2.1.0", "runs": [run]}
        return orjson.dumps(log, option=orjson.OPT_INDENT_2 | orjson.OPT_APPEND_NEWLINE)


def _message(diagnostic: Diagnostic) -> dict[str, Any]:
    return {
        "ruleId": diagnostic.rule.code,
        "level": diagnostic.severity.value,
        "message": {"text": message_text(diagnostic.localized)},
    }


def message_text(text: str) -> str:
    """Escape a message: double its braces (§3.11.5) and break its links (§3.11.6), which may be a user's text."""
    return _LINK.sub(r"\\[", printable(text).replace("{", "{{").replace("}", "}}"))


def _location(path: Path, name: str, span: Span) -> dict[str, Any]:
    """Return a location (§3.28). `name`: the text's name in the diagnostics, in which odd characters are replaced."""
    shown = str(path).encode("utf-8", "backslashreplace").decode()
    file = Path(span.path or name)
    return {
        "physicalLocation": {
            "artifactLocation": artifact(path if str(file) == shown else file),
            "region": _region(span),
        }
    }


def artifact(path: Path) -> dict[str, str]:
    """Return the location of a file (§3.4): relative inside the current folder, without '..'; otherwise absolute."""
    absolute = Path(os.path.abspath(path))  # noqa: PTH100  (resolve() would follow links)
    try:
        below = absolute.relative_to(Path.cwd()).as_posix()
    except ValueError:
        return {"uri": absolute.as_uri()}
    return {"uri": quote(os.fsencode(below)), "uriBaseId": ROOT}


def _region(span: Span) -> dict[str, int]:
    """Return a region: lines and columns from 1, the end column after the last character (§3.30)."""
    region = {"startLine": span.line}
    if span.end_column:
        end_line = max(span.end_line, span.line)
        least = span.column if end_line == span.line else 1
        region |= {"startColumn": span.column, "endLine": end_line, "endColumn": max(span.end_column, least)}
    elif span.column > 1:
        region["startColumn"] = span.column
    return region


def _without_defaults(result: dict[str, Any]) -> dict[str, Any]:
    """Remove the count of a single occurrence and an empty list of locations."""
    return {
        name: value
        for name, value in result.items()
        if not (name == "occurrenceCount" and value == 1) and not (name == "relatedLocations" and not value)
    }


def _numbered(entries: list[dict[str, Any]], name: str) -> dict[str, int]:
    """Return the rules that occur in entries, sorted, with their indices."""
    return {code: index for index, code in enumerate(sorted({entry[name] for entry in entries}))}


def _notification(entry: dict[str, Any], indices: dict[str, int]) -> dict[str, Any]:
    """Return the notification of a file that could not be read (§3.58)."""
    code = entry["ruleId"]
    rest = {name: value for name, value in entry.items() if name != "ruleId"}
    return {"descriptor": {"id": code, "index": indices[code]}, **rest}


def descriptor(rule: Rule) -> dict[str, Any]:
    """Return the descriptor of a rule (§3.49)."""
    words = re.findall(r"\w+", rule.title.replace("'", ""))
    return {
        "id": rule.code,
        "name": "".join(word[0].upper() + word[1:] for word in words),
        "shortDescription": {"text": _sentence(translated(rule.title))},
        "fullDescription": {"text": _sentence(translated(rule.why))},
        "help": {"text": _help(rule, "{}:\n\n{}"), "markdown": _help(rule, "**{}:**\n\n```\n{}\n```")},
        "defaultConfiguration": {"level": rule.severity.value},
    }


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:] + ("" if text.endswith((".", "!", "?", "。")) else localized(_FULL_STOP))


def _help(rule: Rule, example: str) -> str:
    """Return the reason for a rule and its examples. `example`: the format of an example."""
    parts = [_sentence(translated(rule.why))]
    examples = ((_BAD, rule.bad), (_GOOD, rule.good))
    parts += [example.format(localized(name), text.rstrip("\n")) for name, text in examples if text]
    parts += (
        [localized(Phrase("Section {section} of the controller's manual.", section=rule.section))]
        if rule.section
        else []
    )
    return "\n\n".join(parts)
