"""Diagnostics as JUnit XML, which CI systems show as tests: a suite for each file, a case for each diagnostic.

JUnit has no standard. This module follows the schema of Jenkins' xUnit plugin (junit-10.xsd), the strictest that is
published, and the documentation of GitLab. A case names its file as `classname`, since the schema has no `file` there.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from msgspec import Struct, field

from gusjob.diagnostics.formats.text import TextOf, diagnostic_text
from gusjob.diagnostics.model import Diagnostic, Severity
from gusjob.i18n.phrases import printable

CLEAN = "no problems"
"""The name of the case of a file without diagnostics."""


class JUnitReport(Struct, kw_only=True):
    """Suites, file by file. `strict`: warnings fail, too; otherwise they are in the output of a case that passes."""

    strict: bool = False
    suites: list[Element] = field(default_factory=list)

    def add(self, path: Path, diagnostics: Sequence[Diagnostic], text_of: TextOf, *, readable: bool) -> None:
        """Add the diagnostics of a file. `readable`: the file could be checked at all."""
        name = _valid(str(path))
        cases = [self._case(diagnostic, text_of, readable=readable) for diagnostic in diagnostics]
        _number_equal_names(cases)
        cases = cases or [Element("testcase", name=CLEAN, classname=name, time="0")]
        suite = Element("testsuite", {"name": name, **_counts(cases)})
        suite.extend(cases)
        self.suites.append(suite)

    def _case(self, diagnostic: Diagnostic, text_of: TextOf, *, readable: bool) -> Element:
        span, code = diagnostic.span, diagnostic.rule.code
        case = Element(
            "testcase",
            name=f"{code} {diagnostic.rule.title} ({span.line}:{span.column})",
            classname=_valid(diagnostic.file),
            time="0",
        )
        kind = self._result(diagnostic, readable=readable)
        attributes = {} if kind == "system-out" else {"type": code, "message": printable(diagnostic.localized)}
        text = diagnostic_text(diagnostic, text_of, color=False)
        SubElement(case, kind, attributes).text = "\n".join(map(printable, text.split("\n")))
        return case

    def _result(self, diagnostic: Diagnostic, *, readable: bool) -> str:
        """Return the element of a case's result: `error` is for a test that could not run."""
        if not readable:
            return "error"
        fails = diagnostic.severity is Severity.ERROR or (self.strict and diagnostic.severity is Severity.WARNING)
        return "failure" if fails else "system-out"

    def to_bytes(self) -> bytes:
        """Return the XML file."""
        cases = [case for suite in self.suites for case in suite]
        top = Element("testsuites", {"name": "gusjob check", **_counts(cases)})
        top.extend(self.suites)
        ElementTree.indent(top)
        text: bytes = ElementTree.tostring(top, encoding="utf-8", xml_declaration=True)
        return text + b"\n"


def _valid(name: str) -> str:
    """Return a file's name without characters that XML does not allow."""
    return printable(name.encode("utf-8", "backslashreplace").decode())


def _counts(cases: Sequence[Element]) -> dict[str, str]:
    failures, errors = (sum(case.find(kind) is not None for case in cases) for kind in ("failure", "error"))
    return {"tests": str(len(cases)), "failures": str(failures), "errors": str(errors), "time": "0"}


def _number_equal_names(cases: Sequence[Element]) -> None:
    """Number cases of equal names, two diagnostics of a rule at one position: CI systems would count them as one."""
    seen: Counter[tuple[str | None, str]] = Counter()
    for case in cases:
        name = case.attrib["name"]
        key = case.get("classname"), name
        seen[key] += 1
        if seen[key] > 1:
            case.set("name", f"{name} #{seen[key]}")
