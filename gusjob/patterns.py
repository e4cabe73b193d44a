"""Regular expressions that are compiled when they are first used: all of them would take much of a start."""

from __future__ import annotations

import re
from typing import Any, AnyStr, cast


class _Uncompiled:
    """A pattern whose methods are looked up when they are first called, and then are those of the compiled one."""

    def __init__(self, text: Any, flags: re.RegexFlag) -> None:
        self._given = text, flags

    def __getattr__(self, name: str) -> Any:
        found = getattr(re.compile(*self._given), name)
        setattr(self, name, found)
        return found


def lazy_pattern(text: AnyStr, flags: re.RegexFlag = re.NOFLAG) -> re.Pattern[AnyStr]:
    """Return a pattern as re.compile does, which is compiled when it is first used."""
    return cast("re.Pattern[AnyStr]", _Uncompiled(text, flags))
