"""Compiler, linter and runner for laser jobs on Googol GUS galvo controllers. For programs: see gusjob.api."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from gusjob.version import __version__

if TYPE_CHECKING:
    from gusjob.api import Fault, Job, JobError, Run, read, set_language

__all__ = ["Fault", "Job", "JobError", "Run", "__version__", "read", "set_language"]


def __getattr__(name: str) -> Any:
    """The interface for programs, imported when it is asked for: the commands do not need it."""
    if name not in __all__:
        raise AttributeError(f"module 'gusjob' has no attribute '{name}'")
    from gusjob import api

    return getattr(api, name)
