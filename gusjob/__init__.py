"""Compiler, linter and runner for laser jobs on Googol GUS galvo controllers.

The Python interface: `read` and `read_text` give a JobFile with its diagnostics; `JobFile.simulate` gives a Simulation;
`run_on` runs a job on a controller.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from gusjob.version import __version__

if TYPE_CHECKING:
    from gusjob.api import (
        Control,
        ControllerRun,
        JobError,
        JobFile,
        ReportedDiagnostic,
        Simulation,
        read,
        read_text,
        run_on,
        set_language,
    )

__all__ = [
    "Control",
    "ControllerRun",
    "JobError",
    "JobFile",
    "ReportedDiagnostic",
    "Simulation",
    "__version__",
    "read",
    "read_text",
    "run_on",
    "set_language",
]

_FORMER_NAMES = {"Fault": "ReportedDiagnostic", "Job": "JobFile", "Run": "Simulation", "speak": "set_language"}
"""Names of 0.1 before its release, accepted until 0.2."""


def __getattr__(name: str) -> Any:
    """Import the interface when it is first used: the commands do not need it."""
    known = _FORMER_NAMES.get(name, name)
    if known not in __all__:
        raise AttributeError(f"module 'gusjob' has no attribute '{name}'")
    from gusjob import api

    return getattr(api, known)


def __dir__() -> list[str]:
    return [*__all__, "__doc__", "__name__", "__file__", "__path__"]
