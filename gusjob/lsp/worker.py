"""A thread that checks texts while the server answers requests. Only the newest text of each file is checked."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from pathlib import Path

from lsprotocol.types import Diagnostic, PositionEncodingKind
from msgspec import Struct

from gusjob.lsp.diagnostics import Diagnosis, SourceLocations, diagnose, lsp_diagnostics
from gusjob.lsp.text import Text
from gusjob.lsp.workspace import Workspace

POLL_S = 1.0
"""Interval in which files on the disk (profile, includes) are checked for changes: not every editor reports them."""


class Task(Struct, frozen=True, kw_only=True):
    """A text to check, with the state of all open texts.

    Attributes:
        number: Counts the tasks of a document.
        open_texts: All open texts by resolved path.
        uris: URIs of open files by resolved path.
        unit: What columns count.
    """

    uri: str
    number: int
    path: Path | None
    text: Text
    open_texts: Mapping[str, bytes]
    uris: Mapping[str, str]
    unit: PositionEncodingKind | str


class TaskResult(Struct, frozen=True, kw_only=True):
    """The result of a task. `published`: the diagnostics for the editor, by URI."""

    task: Task
    diagnosis: Diagnosis
    published: dict[str, list[Diagnostic]]


class Worker:
    """The thread. It is a daemon, so that the server can end during a long check."""

    def __init__(
        self, done: Callable[[TaskResult], None], changed: Callable[[str], None], failed: Callable[[str], None]
    ) -> None:
        """Start the thread, which calls the functions.

        Args:
            done: Called with each result.
            changed: Called with the URI of a document if a file on which it depends has changed on the disk.
            failed: Called with a message after an internal error.
        """
        self._done, self._changed, self._failed = done, changed, failed
        self._pending: dict[str, Task] = {}
        self._workspaces: dict[str, Workspace] = {}
        self._wake = threading.Condition()
        threading.Thread(target=self._run, daemon=True, name="gusjob-lsp").start()

    def submit(self, task: Task) -> None:
        """Queue a task in place of a queued one of the same document."""
        with self._wake:
            self._pending.pop(task.uri, None)
            self._pending[task.uri] = task
            self._wake.notify()

    def forget(self, uri: str) -> None:
        """Drop the tasks and files of a closed document."""
        with self._wake:
            self._pending.pop(uri, None)
            self._workspaces.pop(uri, None)

    def _run(self) -> None:
        while True:
            with self._wake:
                if not self._pending:
                    self._wake.wait(POLL_S)
                task = self._pending.popitem()[1] if self._pending else None
                workspaces = dict(self._workspaces)
            try:
                if task is not None:
                    self._check(task)
                else:
                    self._poll(workspaces)
            except Exception as error:  # noqa: BLE001  (the thread must go on with the next task)
                self._failed(f"an error in gusjob: {type(error).__name__}: {error}")

    def _check(self, task: Task) -> None:
        workspace = Workspace(task.open_texts)
        name = task.uri if task.path is None else str(task.path)
        diagnosis = diagnose(name, task.path, task.text.data, workspace)
        locations = SourceLocations(diagnosis=diagnosis, uri=task.uri, text=task.text, uris=task.uris, unit=task.unit)
        result = TaskResult(task=task, diagnosis=diagnosis, published=lsp_diagnostics(locations))
        with self._wake:
            self._workspaces[task.uri] = workspace
        self._done(result)

    def _poll(self, workspaces: dict[str, Workspace]) -> None:
        for uri, workspace in workspaces.items():
            if workspace.changed:
                with self._wake:
                    self._workspaces.pop(uri, None)  # Each change is reported once.
                self._changed(uri)
