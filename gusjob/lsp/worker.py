"""Texts are judged beside the editor's messages: one thread, the newest text of each file only."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from lsprotocol.types import Diagnostic, PositionEncodingKind

from gusjob.lsp.desk import Desk
from gusjob.lsp.judge import Judged, Places, judge, shown
from gusjob.lsp.text import Text

LOOK_S = 1.0
"""Files on the disk (profile, includes) are looked at so often: not every editor tells that one has changed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """A text to be judged, with all that is open, as it was when it was asked for. `number` counts what is asked."""

    uri: str
    number: int
    path: Path | None
    text: Text
    open_texts: Mapping[str, bytes]
    uris: Mapping[str, str]
    unit: PositionEncodingKind | str


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What came of a task: what to show by URI."""

    task: Task
    judged: Judged
    shown: dict[str, list[Diagnostic]]


class Worker:
    """The thread. It ends with the process: nobody waits for a job that takes long to judge."""

    def __init__(
        self, done: Callable[[Answer], None], changed: Callable[[str], None], failed: Callable[[str], None]
    ) -> None:
        """Called in the thread: `done`; `changed` where a file on the disk, that an open one hangs on, is another;
        `failed` with what to say of an error that is ours."""
        self._done, self._changed, self._failed = done, changed, failed
        self._pending: dict[str, Task] = {}
        self._desks: dict[str, Desk] = {}
        self._wake = threading.Condition()
        threading.Thread(target=self._run, daemon=True, name="gusjob-lsp").start()

    def ask(self, task: Task) -> None:
        """Judge a text; one of the same file that was not begun yet is forgotten."""
        with self._wake:
            self._pending.pop(task.uri, None)
            self._pending[task.uri] = task
            self._wake.notify()

    def forget(self, uri: str) -> None:
        """A file was closed."""
        with self._wake:
            self._pending.pop(uri, None)
            self._desks.pop(uri, None)

    def _run(self) -> None:
        while True:
            with self._wake:
                if not self._pending:
                    self._wake.wait(LOOK_S)
                task = self._pending.popitem()[1] if self._pending else None
                desks = dict(self._desks)
            try:
                if task is not None:
                    self._judge(task)
                else:
                    self._look(desks)
            except Exception as error:  # noqa: BLE001  (the next text is judged whatever became of this one)
                self._failed(f"an error in gusjob: {type(error).__name__}: {error}")

    def _judge(self, task: Task) -> None:
        desk = Desk(task.open_texts)
        name = task.uri if task.path is None else str(task.path)
        judged = judge(name, task.path, task.text.data, desk)
        places = Places(judged=judged, uri=task.uri, text=task.text, uris=task.uris, unit=task.unit)
        answer = Answer(task=task, judged=judged, shown=shown(places))
        with self._wake:
            self._desks[task.uri] = desk
        self._done(answer)

    def _look(self, desks: dict[str, Desk]) -> None:
        for uri, desk in desks.items():
            if desk.changed:
                with self._wake:
                    self._desks.pop(uri, None)  # Told once.
                self._changed(uri)
