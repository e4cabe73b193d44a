"""The user's language, and the catalogue of its texts (gettext, made with Babel: see tests/i18n).

The texts in the code are English, and are the keys of the catalogue. Output for programs (JSON, CSV, listings) is
always English.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from gusjob.patterns import lazy_pattern

if TYPE_CHECKING:  # Start-up time is part of the tool: English needs no catalogue.
    from gettext import NullTranslations

LANGUAGES = {"en": "", "zh": "zh_CN"}
"""The languages by their names on the command line, with the folder of the catalogue; English needs none."""
CATALOGUES = Path(__file__).parent / "locale"
DOMAIN = "gusjob"
_SIMPLIFIED = {"", "cn", "sg", "my", "hans"}
"""The regions and scripts after `zh` in the names of locales with Simplified Chinese."""
_WIDE = r"[\u2e80-\ua4cf\uf900-\ufaff\uff00-\uff60]"
_BLANK_BEFORE, _BLANK_BEHIND = lazy_pattern(rf"(?<={_WIDE}) (?=\{{(\w+)}})"), lazy_pattern(rf"(?<=}}) (?={_WIDE})")
_FIELD_BEFORE, _STARTS_WIDE, _ENDS_WIDE = lazy_pattern(r"\{(\w+)}$"), lazy_pattern(_WIDE), lazy_pattern(f"{_WIDE}$")
_VARIABLES = ("LC_ALL", "LC_MESSAGES", "LANG")

_catalogue: NullTranslations | None = None
_language = "en"


def translated(text: str) -> str:
    """Translate a text of the program into the user's language."""
    return _catalogue.gettext(text) if _catalogue is not None and text else text


def typeset(template: str, fields: Mapping[str, object]) -> str:
    """Remove the blanks between Chinese letters of a template and Chinese fields."""

    def before(blank: re.Match[str]) -> str:
        return "" if _STARTS_WIDE.match(str(fields[blank[1]])) else " "

    def behind(blank: re.Match[str]) -> str:
        field = _FIELD_BEFORE.search(template[: blank.start()])
        return "" if field and _ENDS_WIDE.search(str(fields[field[1]])) else " "

    if _catalogue is None:
        return template
    template = _BLANK_BEFORE.sub(before, template)
    return _BLANK_BEHIND.sub(behind, template)


def set_language(name: str) -> None:
    """Set the language of all texts.

    Raises:
        ValueError: The language is not one of LANGUAGES.
    """
    global _catalogue, _language  # A process has one language, as with gettext's own functions.
    if name not in LANGUAGES:
        raise ValueError(f"there is no language {name!r}: {', '.join(LANGUAGES)}")
    if folder := LANGUAGES[name]:
        import gettext

        _catalogue = gettext.translation(DOMAIN, CATALOGUES, [folder])
    else:
        _catalogue = None
    _language = name


def language() -> str:
    """Return the current language, a key of LANGUAGES."""
    return _language


def system_language(environment: Mapping[str, str] | None = None) -> str:
    """Return the language of the system, found as GNU gettext does; English if it is not one of LANGUAGES.

    LANGUAGE is a list and has no effect in the locale C. Windows sets no variables: there it is the language of the
    user interface.
    """
    environment = os.environ if environment is None else environment
    locale = next((value for name in _VARIABLES if (value := environment.get(name))), "")
    if locale in ("C", "POSIX"):
        return "en"
    for name in environment.get("LANGUAGE", "").split(":"):
        if language_of(name) != "en" or name.startswith("en"):
            return language_of(name)
    return language_of(locale or _windows_language())


def language_of(locale: str) -> str:
    """Return the language of a locale's name: zh_CN.UTF-8, zh-Hans-CN, zh_SG and others are `zh`."""
    head, *rest = locale.partition(".")[0].partition("@")[0].replace("-", "_").lower().split("_")
    return "zh" if head == "zh" and (rest or [""])[0] in _SIMPLIFIED else "en"


def _windows_language() -> str:
    """Return the locale's name of the user interface of Windows, '' on other systems."""
    if sys.platform != "win32":
        return ""
    import ctypes
    from locale import windows_locale

    return windows_locale.get(ctypes.windll.kernel32.GetUserDefaultUILanguage(), "")
