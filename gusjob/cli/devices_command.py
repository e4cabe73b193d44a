"""gusjob devices."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import click

from gusjob.cli.common import exit_code, machine_option, show, write
from gusjob.cli.completion import complete_files
from gusjob.cli.formats import FormatChoice
from gusjob.cli.language import Command
from gusjob.config.machine import Abi
from gusjob.config.profile import find_profile, read_profile
from gusjob.i18n.phrases import Phrase, all_of, any_of, both_of, localized, printable
from gusjob.i18n.width import width, wrapped
from gusjob.pipeline import FileResult, Rejected

if TYPE_CHECKING:  # Start-up time is part of the tool.
    from gusjob.controllers.gus.driver.inspection import VendorLibrary
    from gusjob.hardware.devices import Survey
    from gusjob.hardware.devices.usb import UsbDevice, UsbProblem

_COLUMNS = 110
_SYSTEMS = {"win32": "Windows", "darwin": "macOS", "linux": "Linux"}


@click.command(name="devices", cls=Command)
@click.option(
    "--library",
    "libraries",
    multiple=True,
    metavar="FILE",
    shell_complete=complete_files,
    help="Check this library, too; repeatable. Exit with 1 if it can't be used.",
)
@machine_option
@click.option("--format", "form", type=FormatChoice(["text", "json"]), default="text", show_default=True)
def command(libraries: tuple[str, ...], machine_path: Path | None, form: str) -> None:
    """List the vendor's libraries and the known laser controllers on USB of this computer.

    The command checks the libraries that --library and the machine profile name, and those in the system's folders. It
    loads them, but opens no controller; from USB devices it reads only texts. Exit status: 0, also if nothing is found;
    1 if a library of --library can't be used or the profile has errors, 2 if the profile can't be read.
    """
    from gusjob.hardware.devices import survey

    profile = _profile(machine_path)
    show(profile)
    named = profile.machine.controller.library
    found = survey([*libraries, named] if named else libraries)
    if form == "json":
        write(_json(found), None)
    else:
        click.echo("\n".join(_text(found, named)))
    sys.exit(max(exit_code(profile), int(_has_unusable(found, libraries))))


def _has_unusable(found: Survey, names: Iterable[str]) -> bool:
    """Return whether one of the libraries with these names can't be used."""
    from gusjob.hardware.devices.libraries import whole_path

    paths = {printable(whole_path(name)) for name in names}  # Of two names of one file the first one is listed.
    return any(library.path in paths and not library.abis for library in found.libraries)


def _profile(machine_path: Path | None) -> FileResult:
    """Read the profile that a job in this folder would have. Its errors don't prevent the search."""
    from gusjob.frontend import Source
    from gusjob.frontend.source import shown_name

    path = machine_path or find_profile(Path.cwd() / "x.job")
    if path is None:
        return FileResult(path=Path())
    profile, name = read_profile(path), shown_name(path)
    return Rejected(
        path=path,
        machine=profile.machine,
        diagnostics=profile.diagnostics,
        sources={} if profile.text is None else {name: Source(name=name, data=profile.text.encode())},
        unreadable=profile.text is None,
    )


# As text.


def _text(found: Survey, in_profile: str) -> Iterator[str]:
    system = _SYSTEMS.get(found.platform, found.platform)
    yield localized(Phrase("This computer: {system}, Python with {bits} bits", system=system, bits=found.python_bits))
    yield "\n" + localized(Phrase("Vendor libraries"))
    for library in found.libraries:
        yield from _library(library, in_profile)
    if not any(library.abis for library in found.libraries):
        names = both_of(found.search.names)
        yield from _wrapped(
            Phrase("no library that fits; searched for {names} in {places}", names=names, places=_places(found))
        )
    yield "\nUSB"
    for device in found.usb:
        yield from _usb(device)
    if found.usb_problem:
        yield f"  {_unread(found.usb_problem)}"
        yield from _steps(found.usb_problem.next_steps)
    elif not found.usb:
        yield from _wrapped(Phrase("no known laser controller; searched for {known}", known=_known()))
    yield from _wrapped(Phrase("a Googol GUS or GTS is found only by its library: its USB ids are not public"))
    yield "\n" + localized(Phrase("No controller was opened, no device was changed."))


def _unread(problem: UsbProblem) -> str:
    return localized(Phrase("can't be read: {reason}", reason=problem.reason))


def _library(library: VendorLibrary, in_profile: str) -> Iterator[str]:
    if library.abis:
        yield f"  {library.path}: {localized(_fits(library.abis))}"
        if library.path != printable(in_profile):
            choice = _or(f'"{abi}"' for abi in library.abis)
            lines = Phrase(
                "in gusjob.toml, [controller]: library = '{path}' and abi = {abi}", path=library.path, abi=choice
            )
            yield f"      {localized(lines)}"
        return
    if library.loaded:
        why = Phrase("{path} can't be used: {reason}", path=library.path, reason=library.reason)
    else:
        why = Phrase("{path} can't be loaded: {reason}", path=library.path, reason=library.reason)
    yield f"  {localized(why)}"
    for abi, symbols in library.missing.items():
        lacks = Phrase("for {abi} it lacks {calls}", abi=abi, calls=all_of(symbols))
        yield f"      {localized(lacks)}"
    yield from _steps(library.next_steps)


def _or(words: Iterable[str]) -> str:
    first, *others = words
    for other in others:
        first = Phrase("{first} or {last}", first=first, last=other)
    return first


def _fits(abis: tuple[Abi, ...]) -> str:
    fits = any_of(abis)
    # The multi-card calls have the same names with one more argument.
    return Phrase("{fits}: only opening the controller shows which", fits=fits) if Abi.GTS_MULTI in abis else fits


def _usb(device: UsbDevice) -> Iterator[str]:
    known = device.known
    if known.gusjob:
        driven = Phrase("{name}: gusjob can drive it", name=known.name)
    else:
        driven = Phrase("{name}: gusjob can't drive it yet; {programs} can", name=known.name, programs=known.driven_by)
    yield f"  {known.ids} {localized(driven)}"
    serial = Phrase("serial {serial}", serial=device.serial) if device.serial else ""
    place = Phrase("bus {bus}, address {address}", bus=device.bus, address=device.address)
    held = Phrase("in use by a driver of the system") if device.kernel_driver else ""
    parts = (device.product, serial, "" if device.bus is None else place, held)
    yield f"      {localized(all_of(part for part in parts if part))}"
    if device.problem:
        yield f"      {_unread(device.problem)}"
        yield from _steps(device.problem.next_steps)


def _known() -> str:
    from gusjob.hardware.devices.usb import KNOWN_USB

    return all_of(Phrase("{ids} {name}", ids=known.ids, name=known.short or known.name) for known in KNOWN_USB)


def _places(found: Survey) -> str:
    folders = [printable(folder) for folder in found.search.folders]
    own = [Phrase("the folders of the system's loader")] if found.search.system else []
    return all_of([*folders, *own] or [Phrase("no folder")])


def _wrapped(text: str) -> Iterator[str]:
    shown = localized(text)
    if width(shown) == len(shown):
        yield fill(shown, _COLUMNS, initial_indent="  ", subsequent_indent="      ", break_on_hyphens=False)
        return
    first, *others = wrapped(shown, _COLUMNS - 6).splitlines()
    yield from (f"  {first}", *(f"      {line}" for line in others))


def _steps(steps: Iterable[str]) -> Iterator[str]:
    head = localized(Phrase("next: "))
    for number, step in enumerate(steps):
        yield f"      {' ' * width(head) if number else head}{localized(step)}"


# As JSON.


def _json(found: Survey) -> list[bytes]:
    import orjson

    data = {
        "schema": "gusjob-devices/1",
        "python_bits": found.python_bits,
        "platform": found.platform,
        "searched": {"names": found.search.names, "folders": [printable(folder) for folder in found.search.folders]},
        "libraries": [_library_json(library) for library in found.libraries],
        "usb": [_usb_json(device) for device in found.usb],
        "usb_problem": _problem_json(found.usb_problem),
    }
    return [orjson.dumps(data, option=orjson.OPT_INDENT_2 | orjson.OPT_APPEND_NEWLINE)]


def _library_json(library: VendorLibrary) -> dict[str, Any]:
    return {
        "path": library.path,
        "loaded": library.loaded,
        "reason": library.reason,
        "abis": [abi.value for abi in library.abis],
        "missing": {abi.value: symbols for abi, symbols in library.missing.items()},
        "next_steps": library.next_steps,
    }


def _usb_json(device: UsbDevice) -> dict[str, Any]:
    known = device.known
    return {
        "id": known.ids,
        "name": known.name,
        "sure": known.sure,
        "gusjob_drives": known.gusjob,
        "driven_by": known.driven_by,
        "product": device.product,
        "serial": device.serial,
        "bus": device.bus,
        "address": device.address,
        "kernel_driver": device.kernel_driver,
        "problem": _problem_json(device.problem),
    }


def _problem_json(problem: UsbProblem | None) -> dict[str, Any] | None:
    if problem is None:
        return None
    return {"kind": problem.kind.value, "reason": problem.reason, "next_steps": problem.next_steps}
