"""Diagnostics as JUnit XML, which CI systems show as tests: a suite a file, a case a diagnostic.

JUnit has no standard of its own; this keeps to the schema of Jenkins' xUnit plugin (junit-10.xsd), the strictest that
is published, and to what GitLab documents. So a case names its file as `classname`: the schema has no `file` there.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from gusjob.diagnostics.model import Diagnostic, Severity
from gusjob.i18n.phrases import printable

CLEAN = "no fault"
"""The case of a file in which nothing was found."""


@dataclass(slots=True, kw_only=True)
class JUnitReport:
    """Suites, file by file. `strict`: warnings fail too; else they stand in the output of a case that passes."""

    strict: bool = False
    suites: list[Element] = field(default_factory=list)

    def add(
        self, path: Path, diagnostics: Sequence[Diagnostic], describe: Callable[[Diagnostic], str], *, readable: bool
    ) -> None:
        """What was found in a file. `describe` says all of a diagnostic; `readable`: the file could be judged."""
        name = _shown(str(path))
        cases = [self._case(diagnostic, describe, readable=readable) for diagnostic in diagnostics]
        _tell_apart(cases)
        cases = cases or [Element("testcase", name=CLEAN, classname=name, time="0")]
        suite = Element("testsuite", {"name": name, **_counts(cases)})
        suite.extend(cases)
        self.suites.append(suite)

    def _case(self, diagnostic: Diagnostic, describe: Callable[[Diagnostic], str], *, readable: bool) -> Element:
        span, code = diagnostic.span, diagnostic.rule.code
        case = Element(
            "testcase",
            name=f"{code} {diagnostic.rule.title} ({span.line}:{span.column})",
            classname=_shown(diagnostic.file),
            time="0",
        )
        kind = self._kind(diagnostic, readable=readable)
        about = {} if kind == "system-out" else {"type": code, "message": printable(diagnostic.localized)}
        SubElement(case, kind, about).text = "\n".join(map(printable, describe(diagnostic).split("\n")))
        return case

    def _kind(self, diagnostic: Diagnostic, *, readable: bool) -> str:
        """How a diagnostic counts: `error` is for a test that could not be made."""
        if not readable:
            return "error"
        fails = diagnostic.severity is Severity.ERROR or (self.strict and diagnostic.severity is Severity.WARNING)
        return "failure" if fails else "system-out"

    def written(self) -> bytes:
        """The file."""
        cases = [case for suite in self.suites for case in suite]
        top = Element("testsuites", {"name": "gusjob check", **_counts(cases)})
        top.extend(self.suites)
        ElementTree.indent(top)
        text: bytes = ElementTree.tostring(top, encoding="utf-8", xml_declaration=True)
        return text + b"\n"


def _shown(name: str) -> str:
    return printable(name.encode("utf-8", "backslashreplace").decode())


def _counts(cases: Sequence[Element]) -> dict[str, str]:
    failures, errors = (sum(case.find(kind) is not None for case in cases) for kind in ("failure", "error"))
    return {"tests": str(len(cases)), "failures": str(failures), "errors": str(errors), "time": "0"}


def _tell_apart(cases: Sequence[Element]) -> None:
    """Cases of one name would count as one: two diagnostics of a rule in one place are numbered."""
    seen: Counter[tuple[str | None, str]] = Counter()
    for case in cases:
        name = case.attrib["name"]
        key = case.get("classname"), name
        seen[key] += 1
        if seen[key] > 1:
            case.set("name", f"{name} #{seen[key]}")
