"""Which diagnostics are reported, and with which severity: [check] of a profile, and --select and --ignore.

Rules are named by their codes or by prefixes of codes: GJ4 stands for all rules of that family.
"""

from __future__ import annotations

from collections.abc import Iterable
from fnmatch import fnmatch
from functools import lru_cache
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from gusjob.diagnostics import rules
from gusjob.diagnostics.model import SEVERITY_ORDER, Diagnostic, Severity


class SelectionLayer(Struct, frozen=True, kw_only=True):
    """The settings of one table or of the command line. The longest prefix that matches a code wins.

    `glob`: the files that it applies to, relative to the profile's folder; '' for all. `select`: only these rules;
    `ignore`: all but these; `severity`: by prefix.
    """

    glob: str = ""
    select: tuple[str, ...] = ()
    ignore: tuple[str, ...] = ()
    severity: tuple[tuple[str, Severity], ...] = ()

    def selects(self, code: str) -> bool | None:
        """Whether a rule is reported; None if the layer does not mention it."""
        selected, ignored = _longest(code, self.select), _longest(code, self.ignore)
        if not selected and not ignored:
            return False if self.select else None
        return selected > ignored

    def severity_of(self, code: str) -> Severity | None:
        """Return the severity that a rule is to have; None if the layer does not mention it."""
        length = _longest(code, (prefix for prefix, _ in self.severity))
        return dict(self.severity)[code[:length]] if length else None


EMPTY_LAYER = SelectionLayer()


class RuleSelection(Struct, frozen=True, kw_only=True):
    """Layers, of which the last one that mentions a rule wins. `folder`: where globs start."""

    layers: tuple[SelectionLayer, ...] = ()
    folder: str = ""

    def layers_for(self, file: str) -> list[SelectionLayer]:
        """Return the layers that apply to a file."""
        return [layer for layer in self.layers if not layer.glob or _matches(_relative(file, self.folder), layer.glob)]

    def selects(self, diagnostic: Diagnostic, last: SelectionLayer) -> bool:
        """Whether a diagnostic is reported. `last`: the layer of the command line."""
        code = str(diagnostic.fields["code"]) if diagnostic.rule is rules.NOT_LISTED else diagnostic.rule.code
        answers = [layer.selects(code) for layer in (*self.layers_for(diagnostic.file), last)]
        return next((answer for answer in reversed(answers) if answer is not None), True)

    def with_severities(self, diagnostics: Iterable[Diagnostic]) -> list[Diagnostic]:
        """Return the diagnostics with the severities of the layers; an error stays an error."""
        return [self._with_severity(diagnostic) if self.layers else diagnostic for diagnostic in diagnostics]

    def _with_severity(self, diagnostic: Diagnostic) -> Diagnostic:
        if diagnostic.rule is rules.NOT_LISTED:  # Those that are not listed may be in a file with a higher severity.
            given = [layer.severity_of(str(diagnostic.fields["code"])) for layer in self.layers]
            highest = max((one for one in given if one), key=SEVERITY_ORDER.index, default=Severity.NOTE)
            return diagnostic.at_least(highest)
        if diagnostic.severity is Severity.ERROR:
            return diagnostic
        answers = [layer.severity_of(diagnostic.rule.code) for layer in self.layers_for(diagnostic.file)]
        severity = next((answer for answer in reversed(answers) if answer is not None), None)
        return diagnostic if severity is None else replace(diagnostic, severity_override=severity)


def _matches(name: str, glob: str) -> bool:
    """Whether a glob matches a file: * is any text, `**/` may be empty, and a folder stands for all that is in it."""
    pattern = glob.replace("\\", "/").removeprefix("./").rstrip("/")
    patterns = [pattern, f"{pattern}/*", *([pattern[3:]] if pattern.startswith("**/") else [])]
    return any(fnmatch(name, one.replace("/**/", "/*")) for one in patterns)


def _longest(code: str, prefixes: Iterable[str]) -> int:
    """Return the length of the longest prefix that matches a code."""
    return max((len(prefix) for prefix in prefixes if code.startswith(prefix)), default=0)


@lru_cache(maxsize=1000)
def _relative(file: str, folder: str) -> str:
    """Return a file's name relative to a folder, with slashes; the whole path if the file is not in the folder."""
    try:
        path = Path(file).resolve()
        return (path.relative_to(folder) if path.is_relative_to(folder) else path).as_posix()
    except (OSError, ValueError, RuntimeError):  # No valid name, or a loop of links.
        return file
