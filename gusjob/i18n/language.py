"""The user's language: which one it is, and the catalogue of texts in it (gettext; made with Babel, see tests).

The texts in the code are English, and are the catalogue's keys. What programs read (JSON, CSV, listings) stays English.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # Start-up time is part of the tool: English needs no catalogue.
    from gettext import NullTranslations

LANGUAGES = {"en": "", "zh": "zh_CN"}
"""Every language by its name on the command line, with the folder of its catalogue; English needs none."""
CATALOGUES = Path(__file__).parent / "locale"
DOMAIN = "gusjob"
_SIMPLIFIED = {"", "cn", "sg", "my", "hans"}
"""What may follow `zh` in the name of a locale in which Simplified Chinese is read."""
_WIDE = r"[\u2e80-\ua4cf\uf900-\ufaff\uff00-\uff60]"
_BLANK_BEFORE, _BLANK_BEHIND = re.compile(rf"(?<={_WIDE}) (?=\{{(\w+)}})"), re.compile(rf"(?<=}}) (?={_WIDE})")
_FIELD_BEFORE, _STARTS_WIDE, _ENDS_WIDE = re.compile(r"\{(\w+)}$"), re.compile(_WIDE), re.compile(f"{_WIDE}$")
_VARIABLES = ("LC_ALL", "LC_MESSAGES", "LANG")

_catalogue: NullTranslations | None = None
_spoken = "en"


def translated(text: str) -> str:
    """A text of the program in the user's language; as it is where that is English."""
    return _catalogue.gettext(text) if _catalogue is not None and text else text


def typeset(template: str, fields: Mapping[str, object]) -> str:
    """A template in which blanks stand between Chinese and other letters, without those beside Chinese fields."""

    def before(blank: re.Match[str]) -> str:
        return "" if _STARTS_WIDE.match(str(fields[blank[1]])) else " "

    def behind(blank: re.Match[str]) -> str:
        field = _FIELD_BEFORE.search(template, 0, blank.start())
        return "" if field and _ENDS_WIDE.search(str(fields[field[1]])) else " "

    if _catalogue is None:
        return template
    template = _BLANK_BEFORE.sub(before, template)
    return _BLANK_BEHIND.sub(behind, template)


def set_language(name: str) -> None:
    """Say everything in a language of LANGUAGES from here on. Raises ValueError for another one."""
    global _catalogue, _spoken  # A process speaks one language, as gettext's own functions do.
    if name not in LANGUAGES:
        raise ValueError(f"there is no language {name!r}: {', '.join(LANGUAGES)}")
    if folder := LANGUAGES[name]:
        import gettext

        _catalogue = gettext.translation(DOMAIN, CATALOGUES, [folder])
    else:
        _catalogue = None
    _spoken = name


def language() -> str:
    """The language that is spoken, a key of LANGUAGES."""
    return _spoken


def system_language(environment: Mapping[str, str] | None = None) -> str:
    """The language that the system is set to, as GNU gettext finds it; English where it is none of ours.

    LANGUAGE is a list, and counts for nothing in the locale C. Windows sets no variables; there it is the language in
    which Windows itself speaks.
    """
    environment = os.environ if environment is None else environment
    locale = next((value for name in _VARIABLES if (value := environment.get(name))), "")
    if locale in ("C", "POSIX"):
        return "en"
    for wanted in environment.get("LANGUAGE", "").split(":"):
        if language_of(wanted) != "en" or wanted.startswith("en"):
            return language_of(wanted)
    return language_of(locale or _windows_language())


def language_of(locale: str) -> str:
    """The language of LANGUAGES that a locale's name asks for: zh_CN.UTF-8, zh-Hans-CN, zh_SG ... are `zh`."""
    head, *rest = locale.partition(".")[0].partition("@")[0].replace("-", "_").lower().split("_")
    return "zh" if head == "zh" and (rest or [""])[0] in _SIMPLIFIED else "en"


def _windows_language() -> str:
    """The language of Windows' own menus, as a locale's name."""
    if sys.platform != "win32":
        return ""
    import ctypes
    from locale import windows_locale

    return windows_locale.get(ctypes.windll.kernel32.GetUserDefaultUILanguage(), "")
