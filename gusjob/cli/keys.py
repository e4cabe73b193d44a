"""Read the keys that are pressed during a run, without blocking and without Enter."""

from __future__ import annotations

import os
import sys
from typing import Any, Self, TypeAlias

from gusjob.patterns import lazy_pattern


def _stdin_terminal() -> int | None:
    """Return the file descriptor of standard input if it is a terminal."""
    try:
        fd = sys.stdin.fileno()
    except (AttributeError, OSError, ValueError):  # Standard input is missing, no file, or closed.
        return None
    return fd if os.isatty(fd) else None


if sys.platform == "win32":
    import msvcrt

    class WindowsKeys:
        """Reads keys from the console; there are none without one."""

        def __init__(self) -> None:
            self.listening = _stdin_terminal() is not None
            """Whether keys can be typed at all."""

        def __enter__(self) -> Self:
            """Prepare nothing."""
            return self

        def __exit__(self, *_: object) -> None:
            """Restore nothing."""

        def pressed(self) -> str:
            """Return all keys typed since the last call, '' if none. Arrows and function keys are left out."""
            typed = []
            while self.listening and msvcrt.kbhit():
                # Not getwch: kbhit does not see the second half that getwch keeps of an arrow or function key.
                key = msvcrt.getch()
                if key in (b"\x00", b"\xe0") and msvcrt.kbhit():
                    msvcrt.getch()
                else:
                    typed.append(key)
            return b"".join(typed).decode("ascii", "ignore")

    Keys: TypeAlias = WindowsKeys

else:
    import select
    import termios
    from contextlib import suppress

    _NAMED_KEY = lazy_pattern(r"\x1b(\[[0-?]*[ -/]*[@-~]|O[ -~])")
    """What arrows and function keys send: it begins with an Escape that nobody pressed."""

    class PosixKeys:
        """Reads keys from the terminal; there are none without one, or while this process is in the background.

        Within the context, after the first call of pressed(), keys come at once and are not echoed. Ctrl+C is still a
        signal.
        """

        def __init__(self) -> None:
            self._fd = _stdin_terminal()
            self._before: list[Any] | None = None

        @property
        def listening(self) -> bool:
            """Whether keys can be typed at all."""
            return self._fd is not None

        def __enter__(self) -> Self:
            """Change nothing yet: the process may be in the background now."""
            return self

        def __exit__(self, *_: object) -> None:
            """Restore the terminal, except from the background: the shell has it then."""
            if self._fd is not None and self._before is not None and _in_foreground(self._fd):
                with suppress(termios.error):  # It may be gone.
                    termios.tcsetattr(self._fd, termios.TCSANOW, self._before)

        def pressed(self) -> str:
            """Return all keys typed since the last call, '' if none. Arrows and function keys are left out.

            Raises:
                OSError: the terminal is gone.
            """
            if self._fd is None or not _in_foreground(self._fd):
                return ""
            try:
                self._set_key_mode(self._fd)
            except termios.error as error:  # Not an OSError by itself.
                raise OSError(*error.args) from error
            ready, _, _ = select.select([self._fd], [], [], 0)
            typed = os.read(self._fd, 1024) if ready else b""
            return _NAMED_KEY.sub("", typed.decode("ascii", "ignore"))

        def _set_key_mode(self, fd: int) -> None:
            """Switch line mode and echo off: at the first call, and again after a shell changed that (Ctrl+Z, fg)."""
            mode = termios.tcgetattr(fd)
            if not mode[3] & (termios.ICANON | termios.ECHO):
                return
            self._before = self._before or termios.tcgetattr(fd)
            mode[0] &= ~termios.IXON  # Ctrl+S would block the panel, and with it the thread that watches the run.
            mode[3] &= ~(termios.ICANON | termios.ECHO)
            mode[6][termios.VMIN], mode[6][termios.VTIME] = 1, 0
            termios.tcsetattr(fd, termios.TCSANOW, mode)  # Not FLUSH: a stop typed too early is a stop.

    Keys: TypeAlias = PosixKeys

    def _in_foreground(fd: int) -> bool:
        """Return whether this process is in the foreground; in the background the terminal would stop it."""
        try:
            return os.tcgetpgrp(fd) == os.getpgrp()
        except OSError:  # It controls another session, or is gone.
            return False
