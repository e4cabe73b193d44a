"""Diagnostics as SARIF 2.1.0, the form that code scanning reads. Sections (§) are those of the OASIS standard."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any
from urllib.parse import quote

import orjson

from gusjob.diagnostics.model import Diagnostic, Rule, Span
from gusjob.diagnostics.rules import RULES
from gusjob.i18n.language import language, translated
from gusjob.i18n.phrases import Phrase, localized, printable
from gusjob.version import __version__

SCHEMA = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"
ROOT = "%SRCROOT%"
"""The folder that gusjob was called in: in a checkout, the checkout's."""
FINGERPRINT = "gusjobLine/v1"
"""Our own name (§3.27.17): GitHub's upload adds its own, and complains of a foreign value under that name."""

_LANGUAGES = {"en": "en-US", "zh": "zh-CN"}
_FULL_STOP, _BAD, _GOOD = Phrase("."), Phrase("Bad"), Phrase("Good")
_LINK = re.compile(r"\[(?=[^\[\]]*\]\()")


@dataclass(slots=True, kw_only=True)
class SarifLog:
    """One run of the tool, gathered file by file; no source text is kept.

    A diagnostic that is met through several jobs (in a file that they include, in their profile) is one result: it has
    one place to mend.
    """

    results: dict[tuple[object, ...], dict[str, Any]] = field(default_factory=dict)
    notifications: list[dict[str, Any]] = field(default_factory=list)
    alike: Counter[tuple[str, str, str]] = field(default_factory=Counter)

    def add(
        self, path: Path, diagnostics: Iterable[Diagnostic], text_of: Callable[[Span, str], str], *, readable: bool
    ) -> None:
        """What was found in a file. `text_of` gives a span's source line; `readable`: the file could be judged."""
        for diagnostic in diagnostics:
            place = _place(path, diagnostic.path, diagnostic.span)
            if readable:
                self._result(path, diagnostic, place, text_of)
            else:
                self.notifications.append(_said(diagnostic) | {"locations": [place]})

    def _result(
        self, path: Path, diagnostic: Diagnostic, place: dict[str, Any], text_of: Callable[[Span, str], str]
    ) -> None:
        uri = str(place["physicalLocation"]["artifactLocation"]["uri"])
        key = (diagnostic.rule.code, diagnostic.message, uri, *place["physicalLocation"]["region"].items())
        result = self.results.get(key)
        if result is None:
            result = self.results[key] = _said(diagnostic) | {
                "locations": [place],
                "occurrenceCount": 0,
                "partialFingerprints": {FINGERPRINT: self._fingerprint(diagnostic, uri, text_of)},
                "relatedLocations": [],
            }
        result["occurrenceCount"] += diagnostic.count
        for remark in diagnostic.remarks:
            other = _place(path, diagnostic.path, remark.span) | {"message": {"text": message_text(remark.localized)}}
            if other not in result["relatedLocations"]:
                result["relatedLocations"].append(other)

    def _fingerprint(self, diagnostic: Diagnostic, uri: str, text_of: Callable[[Span, str], str]) -> str:
        """The same for as long as the line reads the same, wherever it stands: equal lines are counted from the top."""
        span = diagnostic.span
        whole_file = span.line == 1 and span.column == 1 and not span.end_column
        text = "" if whole_file else " ".join(text_of(span, diagnostic.path).split())
        alike = (diagnostic.rule.code, uri, text)
        self.alike[alike] += 1
        return sha256("\0".join([*alike, str(self.alike[alike])]).encode()).hexdigest()

    def written(self) -> bytes:
        """The log file."""
        results = [_tidy(result) for result in self.results.values()]
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


def _said(diagnostic: Diagnostic) -> dict[str, Any]:
    return {
        "ruleId": diagnostic.rule.code,
        "level": diagnostic.severity.value,
        "message": {"text": message_text(diagnostic.localized)},
    }


def message_text(text: str) -> str:
    """A message in which a user's text does nothing: braces are doubled (§3.11.5), links taken apart (§3.11.6)."""
    return _LINK.sub(r"\\[", printable(text).replace("{", "{{").replace("}", "}}"))


def _place(path: Path, name: str, span: Span) -> dict[str, Any]:
    """A location (§3.28). `name`: what the text is called; of the file at `path` that may be a stand-in."""
    shown = str(path).encode("utf-8", "backslashreplace").decode()
    file = Path(span.path or name)
    return {
        "physicalLocation": {
            "artifactLocation": artifact(path if str(file) == shown else file),
            "region": _region(span),
        }
    }


def artifact(path: Path) -> dict[str, str]:
    """Where a file is (§3.4): below this folder relative to it, without '..'; elsewhere absolute."""
    absolute = Path(os.path.abspath(path))  # noqa: PTH100  (resolve() would follow links: the name is wanted)
    try:
        below = absolute.relative_to(Path.cwd()).as_posix()
    except ValueError:
        return {"uri": absolute.as_uri()}
    return {"uri": quote(os.fsencode(below)), "uriBaseId": ROOT}


def _region(span: Span) -> dict[str, int]:
    """Lines and columns from 1, the end column behind the last character (§3.30)."""
    region = {"startLine": span.line}
    if span.end_column:
        end_line = max(span.end_line, span.line)
        least = span.column if end_line == span.line else 1
        region |= {"startColumn": span.column, "endLine": end_line, "endColumn": max(span.end_column, least)}
    elif span.column > 1:
        region["startColumn"] = span.column
    return region


def _tidy(result: dict[str, Any]) -> dict[str, Any]:
    """Without what says nothing: one occurrence, no other places."""
    return {
        name: value
        for name, value in result.items()
        if not (name == "occurrenceCount" and value == 1) and not (name == "relatedLocations" and not value)
    }


def _numbered(entries: list[dict[str, Any]], name: str) -> dict[str, int]:
    """Rules that are mentioned, in their order, with their indices."""
    return {code: index for index, code in enumerate(sorted({entry[name] for entry in entries}))}


def _notification(localized: dict[str, Any], indices: dict[str, int]) -> dict[str, Any]:
    """A file that could not be judged (§3.58)."""
    code = localized["ruleId"]
    rest = {name: value for name, value in localized.items() if name != "ruleId"}
    return {"descriptor": {"id": code, "index": indices[code]}, **rest}


def descriptor(rule: Rule) -> dict[str, Any]:
    """A rule (§3.49)."""
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
    """Why a rule is there, and its examples in a form of their own."""
    parts = [_sentence(translated(rule.why))]
    examples = ((_BAD, rule.bad), (_GOOD, rule.good))
    parts += [example.format(localized(name), text.rstrip("\n")) for name, text in examples if text]
    parts += (
        [localized(Phrase("Section {section} of the controller's manual.", section=rule.section))]
        if rule.section
        else []
    )
    return "\n\n".join(parts)
