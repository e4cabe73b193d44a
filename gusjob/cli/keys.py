"""The keys that are typed while a run goes on, without waiting for Enter and without waiting at all."""

from __future__ import annotations

import os
import sys
from typing import Any, Self


def _stdin_terminal() -> int | None:
    """The file descriptor of standard input if a person can type there."""
    try:
        fd = sys.stdin.fileno()
    except (AttributeError, OSError, ValueError):  # Standard input is missing, no file, or closed.
        return None
    return fd if os.isatty(fd) else None


if sys.platform == "win32":
    import msvcrt

    class Keys:
        """Keys from the console; none without one."""

        def __init__(self) -> None:
            self.listening = _stdin_terminal() is not None
            """Whether keys can come at all."""

        def __enter__(self) -> Self:
            """Nothing is to be prepared."""
            return self

        def __exit__(self, *_: object) -> None:
            """Nothing is to be restored."""

        def pressed(self) -> str:
            """All keys typed since the last time, '' if none. Arrows and function keys are left out."""
            typed = []
            while self.listening and msvcrt.kbhit():
                # Not getwch: kbhit does not see the second half that getwch keeps of an arrow or function key.
                key = msvcrt.getch()
                if key in (b"\x00", b"\xe0") and msvcrt.kbhit():
                    msvcrt.getch()
                else:
                    typed.append(key)
            return b"".join(typed).decode("ascii", "ignore")

else:
    import re
    import select
    import termios
    from contextlib import suppress

    _NAMED_KEY = re.compile(r"\x1b(\[[0-?]*[ -/]*[@-~]|O[ -~])")
    """What arrows and function keys send: it begins with an Escape that nobody pressed."""

    class Keys:
        """Keys from the terminal; none without one, or while this process is in its background.

        Within the context, from the first look on, keys come at once and are not echoed. Ctrl+C is a signal still.
        """

        def __init__(self) -> None:
            self._fd = _stdin_terminal()
            self._before: list[Any] | None = None

        @property
        def listening(self) -> bool:
            """Whether keys can come at all."""
            return self._fd is not None

        def __enter__(self) -> Self:
            """The terminal is changed when it is looked at: the process may be in the background now."""
            return self

        def __exit__(self, *_: object) -> None:
            """The terminal is as it was; from the background it isn't touched, the shell has it."""
            if self._fd is not None and self._before is not None and _in_foreground(self._fd):
                with suppress(termios.error):  # It may be gone.
                    termios.tcsetattr(self._fd, termios.TCSANOW, self._before)

        def pressed(self) -> str:
            """All keys typed since the last time, '' if none. Arrows and function keys are left out.

            OSError: the terminal is gone.
            """
            if self._fd is None or not _in_foreground(self._fd):
                return ""
            try:
                self._take_keys(self._fd)
            except termios.error as error:  # Not an OSError by itself.
                raise OSError(*error.args) from error
            ready, _, _ = select.select([self._fd], [], [], 0)
            typed = os.read(self._fd, 1024) if ready else b""
            return _NAMED_KEY.sub("", typed.decode("ascii", "ignore"))

        def _take_keys(self, fd: int) -> None:
            """Keys one by one, no echo: at the first look, and again when a shell has changed that (Ctrl+Z, fg)."""
            mode = termios.tcgetattr(fd)
            if not mode[3] & (termios.ICANON | termios.ECHO):
                return
            self._before = self._before or termios.tcgetattr(fd)
            mode[0] &= ~termios.IXON  # Ctrl+S would hold the panel, and with it the thread that watches over the run.
            mode[3] &= ~(termios.ICANON | termios.ECHO)
            mode[6][termios.VMIN], mode[6][termios.VTIME] = 1, 0
            termios.tcsetattr(fd, termios.TCSANOW, mode)  # Not FLUSH: a stop typed too early is a stop.

    def _in_foreground(fd: int) -> bool:
        """Whether the terminal is this process's at the moment; another's stops whoever touches it."""
        try:
            return os.tcgetpgrp(fd) == os.getpgrp()
        except OSError:  # It controls another session, or is gone.
            return False
