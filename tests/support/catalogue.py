"""The catalogue of Chinese texts: which texts of the program it must have, and how Babel stores it.

Texts of rules and of the command line come from their objects; all others are the literals of Phrase(...) in the
code, and of _(...) in the page's template.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import click
from babel.messages.catalog import Catalog, Message
from babel.messages.extract import extract_from_dir
from babel.messages.mofile import write_mo
from babel.messages.pofile import read_po, write_po
from support.tools import ROOT

from gusjob import __version__
from gusjob.cli import cli
from gusjob.cli.color import COLOR_HELP
from gusjob.cli.language import LANGUAGE_HELP, paragraphs
from gusjob.diagnostics.model import REMARKS
from gusjob.diagnostics.rules import RULES, VARIANTS
from gusjob.i18n.language import CATALOGUES, DOMAIN, LANGUAGES

PACKAGE = ROOT / "gusjob"
FOLDER = CATALOGUES / LANGUAGES["zh"] / "LC_MESSAGES"
PO, MO = FOLDER / f"{DOMAIN}.po", FOLDER / f"{DOMAIN}.mo"
OF_CLICK = (
    "Usage:", "Options", "Commands", "Show this message and exit.", "Show the version and exit.", "Error: {message}",
    "Aborted!", "Try '{command} {option}' for help.", "default: {default}", "required", "Missing argument",
    "Missing option", "Missing parameter", "No such option: {name}", "No such option {name!r}.",
    "No such command {name!r}.",
    "Invalid value: {message}", "Invalid value for {param_hint}: {message}", "Missing command.",
    "{value!r} is not a valid {number_type}.", "{value} is not in the range {range}.",
    "Option {name!r} does not take a value.", "(DEPRECATED)", "env var: {var}",
    "%(prog)s, version %(version)s",
)  # fmt: skip
"""click's own texts in help and usage errors, of versions 8.1 and later."""
OF_CLICK_COUNTED = (
    ("Got unexpected extra argument ({args})", "Got unexpected extra arguments ({args})"),
    ("Option {name!r} requires an argument.", "Option {name!r} requires {nargs} arguments."),
    ("{value!r} is not {choice}.", "{value!r} is not one of {choices}."),
    ("Did you mean {possibility}?", "(Did you mean one of: {possibilities}?)"),
)
"""The same for one and for many; Chinese has one form for both."""


@cache
def needed() -> Catalog:
    """Every text of the program that people read, without translations."""
    catalog = Catalog(fuzzy=False)
    for rule in (*RULES.values(), *VARIANTS):
        for text in (rule.title, rule.text, rule.why):
            catalog.add(text, auto_comments=[rule.code])
    for text in REMARKS:
        catalog.add(text, auto_comments=["remark"])
    for text, of in _helps(cli, "gusjob"):
        catalog.add(text, auto_comments=[of])
    catalog.add(LANGUAGE_HELP, auto_comments=["gusjob --lang"])
    catalog.add(COLOR_HELP, auto_comments=["gusjob --color"])
    for text in OF_CLICK:
        catalog.add(text, auto_comments=["click"])
    for pair in OF_CLICK_COUNTED:
        catalog.add(pair, auto_comments=["click"])
    for file, _, phrase, _, _ in extract_from_dir(PACKAGE, [("**.py", "python")], keywords={"Phrase": None}):
        catalog.add(phrase, auto_comments=[Path(file).as_posix()])
    for file, _, phrase, _, _ in extract_from_dir(PACKAGE, [("**/static/*.html", "jinja2")], keywords={"_": None}):
        catalog.add(phrase, auto_comments=[Path(file).as_posix()])
    return catalog


def _helps(command: click.Command, name: str) -> Iterator[tuple[str, str]]:
    """Texts of a command and all below it, each with what it is about."""
    if command.help:
        yield paragraphs(command.help), name
    for parameter in command.params:
        if text := getattr(parameter, "help", None):
            yield text, f"{name} {parameter.opts[-1]}"
    if isinstance(command, click.Group):
        context = click.Context(command)
        for below in command.list_commands(context):
            found = command.get_command(context, below)
            assert found is not None
            yield from _helps(found, f"{name} {below}")


def kept() -> Catalog:
    """The catalogue in the tree."""
    with PO.open("rb") as file:
        return read_po(file, locale=LANGUAGES["zh"], domain=DOMAIN)


def key(message: Message) -> str:
    """A message's English text, of one that is counted the text for many."""
    return message.id if isinstance(message.id, str) else list(message.id)[-1]


def texts(catalog: Catalog) -> dict[str, str]:
    """Translations by their English texts."""
    return {key(m): m.string if isinstance(m.string, str) else (m.string or [""])[0] for m in catalog if m.id}


def po_bytes(catalog: Catalog) -> bytes:
    """A catalogue as a .po file, in the order of the program's texts, without dates that change with every run."""
    out = io.BytesIO()
    write_po(out, catalog, width=120, no_location=True, omit_header=False, ignore_obsolete=True, sort_output=False)
    head, _, rest = out.getvalue().partition(b"\n\n")
    lines = [line for line in head.split(b"\n") if not line.startswith((b'"POT-', b'"PO-', b'"Generated', b'"Report'))]
    return b"\n".join(lines) + b"\n\n" + rest


def mo_bytes(catalog: Catalog) -> bytes:
    """A catalogue as gettext reads it."""
    out = io.BytesIO()
    write_mo(out, catalog)
    return out.getvalue()


def updated() -> Catalog:
    """What is kept, for the texts that are needed now; new ones are there without a translation."""
    old = texts(kept()) if PO.exists() else {}
    catalog = Catalog(
        locale=LANGUAGES["zh"], domain=DOMAIN, project="gusjob", version=__version__, fuzzy=False,
        header_comment=_HEADER, last_translator="the authors of gusjob", language_team="Simplified Chinese",
    )  # fmt: skip
    for message in needed():
        if message.id:
            translation = old.get(key(message), "")
            catalog.add(
                message.id,
                translation if isinstance(message.id, str) else (translation,),
                auto_comments=message.auto_comments,
            )
    return catalog


_HEADER = "# Simplified Chinese texts of gusjob. Terms are those of the vendor's manual."
