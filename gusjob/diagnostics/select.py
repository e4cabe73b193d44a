"""Which diagnostics count, and how much: what [check] of a profile and the command line say of rules, for all files or
some.

Rules are named by their codes or by the beginnings of codes: GJ4 is every rule of light.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from functools import lru_cache
from pathlib import Path

from gusjob.diagnostics import rules
from gusjob.diagnostics.model import WEIGHTS, Diagnostic, Severity


@dataclass(frozen=True, slots=True, kw_only=True)
class SelectionLayer:
    """What one place says of rules. `glob`: of which files, from the profile's folder; '' of all."""

    glob: str = ""
    select: tuple[str, ...] = ()
    """Only these."""
    ignore: tuple[str, ...] = ()
    """All but these; of two beginnings that fit, in either, the longer one counts."""
    severity: tuple[tuple[str, Severity], ...] = ()

    def wants(self, code: str) -> bool | None:
        """Whether a rule counts; None where nothing is said of it."""
        chosen, left_out = _longest(code, self.select), _longest(code, self.ignore)
        if not chosen and not left_out:
            return False if self.select else None
        return chosen > left_out

    def weight(self, code: str) -> Severity | None:
        """The severity that a rule is to have; None where nothing is said of it."""
        length = _longest(code, (prefix for prefix, _ in self.severity))
        return dict(self.severity)[code[:length]] if length else None


NOTHING_ASKED = SelectionLayer()


@dataclass(frozen=True, slots=True, kw_only=True)
class RuleSelection:
    """Layers, of which the last one that says something of a rule counts. `folder`: where globs start."""

    layers: tuple[SelectionLayer, ...] = ()
    folder: str = ""

    def of(self, file: str) -> list[SelectionLayer]:
        """The layers that speak of a file."""
        return [one for one in self.layers if not one.glob or _fits(_below(file, self.folder), one.glob)]

    def wants(self, diagnostic: Diagnostic, last: SelectionLayer) -> bool:
        """Whether a diagnostic counts. `last`: what the command line says."""
        code = str(diagnostic.fields["code"]) if diagnostic.rule is rules.MORE else diagnostic.rule.code
        said = [wanted for layer in (*self.of(diagnostic.file), last) if (wanted := layer.wants(code)) is not None]
        return said[-1] if said else True

    def weighed(self, diagnostics: Iterable[Diagnostic]) -> list[Diagnostic]:
        """Diagnostics with the severities that the layers give them; an error stays one."""
        return [self._weighed(diagnostic) if self.layers else diagnostic for diagnostic in diagnostics]

    def _weighed(self, diagnostic: Diagnostic) -> Diagnostic:
        if (
            diagnostic.rule is rules.MORE
        ):  # One of those that are not listed may be in a file of which more is demanded.
            given = [layer.weight(str(diagnostic.fields["code"])) for layer in self.layers]
            return diagnostic.at_least(max((one for one in given if one), key=WEIGHTS.index, default=Severity.NOTE))
        said = [
            weight for layer in self.of(diagnostic.file) if (weight := layer.weight(diagnostic.rule.code)) is not None
        ]
        if not said or diagnostic.severity is Severity.ERROR:
            return diagnostic
        return replace(diagnostic, weight=said[-1])


def _fits(name: str, glob: str) -> bool:
    """Whether a file is meant: * is any text, `**/` may be nothing, and a folder's name means all that is in it."""
    pattern = glob.replace("\\", "/").removeprefix("./").rstrip("/")
    patterns = [pattern, f"{pattern}/*", *([pattern[3:]] if pattern.startswith("**/") else [])]
    return any(fnmatch(name, one.replace("/**/", "/*")) for one in patterns)


def _longest(code: str, prefixes: Iterable[str]) -> int:
    return max((len(prefix) for prefix in prefixes if code.startswith(prefix)), default=0)


@lru_cache(maxsize=1000)
def _below(file: str, folder: str) -> str:
    """A file's name from a folder on, with slashes; where it lies elsewhere, all of it."""
    try:
        path = Path(file).resolve()
        return (path.relative_to(folder) if path.is_relative_to(folder) else path).as_posix()
    except (OSError, ValueError, RuntimeError):  # No name of a file, or a loop of links.
        return file
