"""Run a program with the stand-in in its library path, and find out what was recorded and how it ended."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import FrameType

from msgspec import Struct
from msgspec.structs import replace

from gusjob.config.machine import Abi
from gusjob.i18n.phrases import Phrase, reason_of
from gusjob.inputs import exists
from gusjob.record.build import BuildError, Target, built_audit, built_library, library_name, own_target, system_of
from gusjob.record.listings import (
    count_lines,
    end_listing,
    is_recording,
    is_written,
    listings_of,
    locked,
    mark_of,
    set_aside,
    target_of,
)
from gusjob.record.stand_in_source import exported

FILE_VARIABLE, MARK_VARIABLE, TIME_VARIABLE, FAULTS_VARIABLE, LIMIT_VARIABLE, INPUTS_VARIABLE = (
    "GUSJOB_RECORD",
    "GUSJOB_RECORD_OF",
    "GUSJOB_RECORD_TIME",
    "GUSJOB_RECORD_FAULTS",
    "GUSJOB_RECORD_LIMIT",
    "GUSJOB_RECORD_DI",
)
"""What the library reads in the program's environment."""

LIBRARY_STEMS = ("gts", "gus")
"""Names under which programs are known to load the vendor's library: gts.dll, libgts.so."""
DEFAULT_LIMIT_BYTES = 1_000_000_000
MOST_FAULTS = 32
_MOST_SEARCHED_BYTES = 100_000_000
_PROGRESS_S = 1.0
_SEPARATORS = (";",) if sys.platform == "win32" else (":", ";")
"""Between the folders of a library path."""
_NOT_LINKED = {127, 0xC0000139, 0xC0000135}
"""Exit codes of programs whose loader found a symbol or library missing: POSIX; Windows, as unsigned numbers."""


class Fault(Struct, frozen=True, kw_only=True):
    """The nth call of a name returns a code and has no effect; with `lasts` all from then on, too."""

    name: str
    nth: int
    code: int
    lasts: bool = False

    def __str__(self) -> str:
        return f"{self.name}:{self.nth}{'+' if self.lasts else ''}:{self.code}"


class RecordOptions(Struct, frozen=True, kw_only=True):
    """What to run, and how.

    Attributes:
        command: the program and its arguments.
        output: the listing; other cards and processes get files beside it.
        abi: functions of the library.
        is_real_time: motion takes its time; otherwise virtual time goes on with each call.
        faults: calls that fail.
        limit_bytes: a listing stops there.
        library_names: further file names of the library.
        long_bits: 32 or 64 bits of what the vendor's header calls long, as the program declares it; None as in C.
        inputs: what GT_GetDi reads.
        target: system of the program, None for this computer's. A Windows program under Wine needs it.
    """

    command: tuple[str, ...]
    output: Path
    abi: Abi = Abi.GUS
    is_real_time: bool = False
    faults: tuple[Fault, ...] = ()
    limit_bytes: int = DEFAULT_LIMIT_BYTES
    library_names: tuple[str, ...] = ()
    long_bits: int | None = None
    inputs: int = 0
    target: Target | None = None


class Recording(Struct, frozen=True, kw_only=True):
    """What was recorded.

    Attributes:
        listings: the files that were made, that of card 0 first.
        calls: lines of calls and rests in them.
        exit_code: of the program; the negative number of a signal.
        is_cut: a listing has reached its limit, the disk is full, or a process of the program still records.
        missing: functions of the program that the stand-in lacks, if the program could not be loaded or made no call.
        replaced: listings of an earlier recording of this name, which are gone.
        has_wide: a call was refused that has a number from 2**31 on: a negative int where the library has a long?
    """

    listings: tuple[Path, ...]
    calls: int
    exit_code: int
    is_cut: bool = False
    missing: tuple[str, ...] = ()
    replaced: tuple[Path, ...] = ()
    has_wide: bool = False

    @property
    def was_not_loaded(self) -> bool:
        """Whether the program's loader gave up."""
        return self.exit_code & 0xFFFFFFFF in _NOT_LINKED


def parse_fault(text: str) -> Fault | Phrase:
    """Parse NAME:N:CODE or NAME:N+:CODE; return what is wrong with it otherwise."""
    match = re.fullmatch(r"(GT_\w+):([1-9]\d{0,8})(\+?):(-?\d{1,4})", text, re.ASCII)
    if match is None:
        return Phrase("{text}: write NAME:N:CODE or NAME:N+:CODE, such as GT_LnXY:100:1", text=text)
    name, nth, lasts, code = match.groups()
    if not int(code):
        return Phrase("{text}: code 0 is no fault", text=text)
    if name not in exported():
        return Phrase("{name} is not a function of the library", name=name)
    return Fault(name=name, nth=int(nth), code=int(code), lasts=bool(lasts))


def refusal(options: RecordOptions) -> Phrase | None:
    """Return why the listing must not be written where the options say, None if it may be."""
    if not options.command or not options.command[0]:
        return Phrase("there is no program: write it after --")
    try:
        return _refusal_of_output(options)
    except OSError as error:
        return Phrase("{path}: can't write: {reason}", path=options.output, reason=reason_of(error))


def _refusal_of_output(options: RecordOptions) -> Phrase | None:
    output = options.output
    if not target_of(output).parent.is_dir():
        return Phrase("{path}: can't write: {reason}", path=output, reason=Phrase("no such file or directory"))
    if not os.access(target_of(output).parent, os.W_OK | os.X_OK):
        return Phrase("{path}: can't write: {reason}", path=output, reason=Phrase("permission denied"))
    if not exists(output):
        return None
    if not output.is_file():
        return Phrase("{path}: can't write: {reason}", path=output, reason=Phrase("it is not a file"))
    if any(exists(arg) and output.samefile(arg) for arg in options.command):
        return Phrase("{path} is an input of this command: name another output file with -o", path=output)
    if output.stat().st_size > 0 and not is_recording(output):
        return Phrase("{path} is not a recorded listing: name another output file with -o", path=output)
    return None


def record(
    options: RecordOptions,
    on_progress: Callable[[int], None] | None = None,
    on_build: Callable[[], None] = lambda: None,
) -> Recording | Phrase:
    """Run a program and record its calls. The listing is on the disk up to the last call, however the program ends.

    Args:
        options: what to run, and how.
        on_progress: called about once a second with the number of lines so far.
        on_build: called before the stand-in is built, if it must be.

    Returns:
        What was recorded, or why the program was not started.

    Raises:
        BuildError: the stand-in can't be built.
    """
    problem = refusal(options)
    if problem is not None:
        return problem
    other = vendor_library(options)
    if other is not None:
        return Phrase(
            "{path} would be loaded in place of the stand-in, and could drive the controller: move it to another "
            "folder while you record, or put a stand-in beside the program (--build-library)",
            path=other,
        )
    library = built_library(options.abi, options.target, on_build, long_bits=options.long_bits)
    audit = built_audit() if options.target in (None, own_target()) else None
    output = target_of(options.output)
    with locked(output) as is_free:
        old = listings_of(output)
        if not is_free or any(map(is_written, old)):
            return Phrase(
                "{path}: another recording writes this listing: wait for its end, or name another output file with -o",
                path=options.output,
            )
        folder = _placed_library(library, _file_names(options))
        return _run(options, output, _environment(options, output, folder, audit), old, on_progress)


def _run(
    options: RecordOptions,
    output: Path,
    environ: dict[str, str],
    old: list[Path],
    on_progress: Callable[[int], None] | None,
) -> Recording | Phrase:
    """Run the program to its end. The listings of an earlier recording are replaced when it has been started."""
    with _signals_for_the_program() as follow, ExitStack() as stack:
        try:
            aside = stack.enter_context(set_aside(old))
        except OSError as error:
            return Phrase("{path}: can't write: {reason}", path=output, reason=reason_of(error))
        try:
            process = subprocess.Popen(options.command, env=environ)
        except OSError as error:
            return Phrase("{path}: can't be started: {reason}", path=options.command[0], reason=reason_of(error))
        except ValueError:
            return Phrase(
                "{path}: can't be started: {reason}", path=options.command[0], reason=Phrase("a NUL in an argument")
            )
        aside.clear()
        stack.close()
        follow(process)
        exit_code = _wait(process, output, on_progress)
        return _recording(options, output, exit_code, tuple(old))


def _file_names(options: RecordOptions) -> tuple[str, ...]:
    """Return the names under which programs may load the library."""
    names = [library_name(stem, options.target) for stem in LIBRARY_STEMS]
    if system_of(options.target) == "linux":
        names += [f"{stem}.dll" for stem in LIBRARY_STEMS]  # C# programs name the library as on Windows.
    return (*names, *options.library_names)


def _placed_library(library: Path, names: Sequence[str]) -> Path:
    """Return a folder with the library under all names: one file, so that a program that loads two has one machine.

    It stays where it is: a process that outlives the program may load the library later.

    Raises:
        BuildError: it can't be written, or the loader can't take its path.
    """
    folder = library.parent / ("names-" + hashlib.sha256("\0".join(names).encode()).hexdigest()[:16])
    if any(sign in str(folder) for sign in _SEPARATORS):
        raise BuildError(
            Phrase("{path}: the loader takes no path with {signs}", path=folder, signs=" ".join(_SEPARATORS))
        )
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        first = folder / names[0]
        if not first.is_file():
            shutil.copy(library, folder / f".{os.getpid()}")
            (folder / f".{os.getpid()}").replace(first)
        for name in names[1:]:
            _link_library(first, folder / name)
    except OSError as error:
        raise BuildError(Phrase("{path}: can't write: {reason}", path=folder, reason=reason_of(error))) from error
    return folder


def _link_library(library: Path, path: Path) -> None:
    if path.exists():
        return
    try:
        path.hardlink_to(library)
    except FileExistsError:
        return
    except OSError:  # This file system has no links.
        shutil.copy(library, path)


def vendor_library(options: RecordOptions) -> Path | None:
    """Return a library that a Windows program would load in place of the stand-in, None if there is none.

    Windows searches the program's folder, its own folders and the current folder before PATH. The vendor's library
    would drive the real controller.
    """
    if system_of(options.target) != "windows":
        return None
    own = [Path(arg).resolve().parent for arg in options.command if exists(arg) and Path(arg).is_file()]
    program = shutil.which(options.command[0])
    own = [Path(program).resolve().parent, *own] if program is not None else own
    names = {name.lower() for name in _file_names(options)}
    for folder in (*own, *_windows_folders(), Path.cwd()):
        try:
            found = [path for path in folder.iterdir() if path.name.lower() in names]
        except OSError:
            continue
        for path in found:
            if not _is_stand_in(path):
                return path
    return None


def _windows_folders() -> list[Path]:
    """Return the folders of Windows that come before PATH; under Wine those of its prefix."""
    if sys.platform == "win32":
        root = os.environ.get("SYSTEMROOT", "")
        windows = Path(root) if root else None
    else:
        prefix = os.environ.get("WINEPREFIX", "")
        windows = (Path(prefix) if prefix else Path.home() / ".wine") / "drive_c" / "windows"
    return (
        [windows / name for name in ("System32", "system32", "SysWOW64", "syswow64", "System", ".")] if windows else []
    )


def _environment(options: RecordOptions, output: Path, folder: Path, audit: Path | None) -> dict[str, str]:
    """Return the program's environment: the library's folder comes first, and the library's own variables."""
    system = system_of(options.target)
    under_wine = system == "windows" and sys.platform != "win32"
    variable = {"windows": "PATH", "macos": "DYLD_LIBRARY_PATH", "linux": "LD_LIBRARY_PATH"}[system]
    variable = "WINEPATH" if under_wine else variable
    separator = ";" if system == "windows" else ":"
    own = _wine_path(folder) if under_wine else str(folder)
    environ = dict(os.environ)
    environ[variable] = separator.join(part for part in (own, environ.get(variable, "")) if part)
    if audit is not None:
        environ["LD_AUDIT"] = ":".join(part for part in (str(audit), environ.get("LD_AUDIT", "")) if part)
        environ["GUSJOB_RECORD_FOLDER"] = str(folder)
    environ[FILE_VARIABLE] = _wine_path(output) if under_wine else str(output)
    environ[MARK_VARIABLE] = mark_of(output)
    environ[TIME_VARIABLE] = "real" if options.is_real_time else "fast"
    environ[FAULTS_VARIABLE] = ",".join(map(str, options.faults))
    environ[LIMIT_VARIABLE] = str(options.limit_bytes)
    environ[INPUTS_VARIABLE] = str(options.inputs)
    return environ


def _wine_path(path: Path) -> str:
    """Return a path as Windows programs see it under Wine, where Z: is the whole file system."""
    return "Z:" + str(path).replace("/", "\\")


@contextmanager
def _signals_for_the_program() -> Iterator[Callable[[subprocess.Popen[bytes]], None]]:
    """Leave signals to the program: it decides when it ends, and the recording ends after it.

    Ctrl+C on a terminal reaches the program by itself; what only this process gets is passed on.
    """
    program: list[subprocess.Popen[bytes]] = []
    early: list[int] = []

    def pass_on(number: int, _frame: FrameType | None) -> None:
        if number == signal.SIGINT and _is_in_foreground():
            return
        if program:
            program[0].send_signal(number)
        else:
            early.append(number)

    def follow(process: subprocess.Popen[bytes]) -> None:
        """Pass signals on to the program, also those that came before it was known here."""
        program.append(process)
        for number in early:
            process.send_signal(number)

    names = ("SIGINT", "SIGTERM", "SIGHUP") if threading.current_thread() is threading.main_thread() else ()
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    before = {number: signal.signal(number, pass_on) for number in numbers}
    try:
        yield follow
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _is_in_foreground() -> bool:
    """Return whether the terminal sends Ctrl+C to this process, and so to the program, too."""
    if sys.platform == "win32":
        return True
    try:
        terminal = os.open("/dev/tty", os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return False
    try:
        return os.tcgetpgrp(terminal) == os.getpgrp()
    except OSError:
        return False
    finally:
        os.close(terminal)


def _wait(process: subprocess.Popen[bytes], output: Path, on_progress: Callable[[int], None] | None) -> int:
    """Wait for the end of the program; return its exit code."""
    if on_progress is None:
        return process.wait()
    lines = at = 0
    while True:
        try:
            return process.wait(timeout=_PROGRESS_S)
        except subprocess.TimeoutExpired:
            added, at = count_lines(output, at)
            lines += added
            on_progress(lines)


def _recording(options: RecordOptions, output: Path, exit_code: int, replaced: tuple[Path, ...]) -> Recording:
    """Mark the end in each listing, and say what was recorded."""
    listings = listings_of(output)
    ends = [end_listing(path, exit_code) for path in listings]
    recording = Recording(
        listings=tuple(listings),
        calls=sum(end.calls for end in ends),
        exit_code=exit_code,
        is_cut=any(end.is_cut for end in ends) or not output.parent.is_dir(),
        replaced=replaced,
        has_wide=any(end.has_wide for end in ends),
    )
    if listings and not recording.was_not_loaded:
        return recording
    return replace(recording, missing=missing_functions(options.command))


def missing_functions(command: Sequence[str], names: Mapping[str, object] | None = None) -> tuple[str, ...]:
    """Return functions of the vendor that the program's files name and the stand-in lacks.

    A program names the functions that it links to as plain text, whatever its language. GTN_: of the GSN series.
    """
    known = exported() if names is None else names
    found: set[bytes] = set()
    for path in map(Path, command):
        try:
            if path.is_file() and path.stat().st_size <= _MOST_SEARCHED_BYTES:
                found |= set(re.findall(rb"(?<![A-Za-z0-9_])GTN?_[A-Za-z0-9]+(?![A-Za-z0-9_])", path.read_bytes()))
        except (OSError, ValueError):
            continue
    return tuple(sorted(name for name in (text.decode("ascii") for text in found) if name not in known))


def write_library(
    folder: Path,
    abi: Abi,
    target: Target | None = None,
    names: Sequence[str] = (),
    on_build: Callable[[], None] = lambda: None,
    long_bits: int | None = None,
) -> list[Path] | Phrase:
    """Write the stand-in into a folder under the given names, by default gts.dll, libgts.so or libgts.dylib.

    Returns:
        The files, or why they can't be written.

    Raises:
        BuildError: the stand-in can't be built.
    """
    library = built_library(abi, target, on_build, long_bits=long_bits)
    paths = [folder / name for name in (names or [library_name("gts", target)])]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for path in paths:
            if exists(path) and not _is_stand_in(path):
                return Phrase(
                    "{path} is not a gusjob stand-in, so it is not overwritten: name another folder", path=path
                )
        for path in paths:
            shutil.copyfile(library, path)
    except OSError as error:
        return Phrase("{path}: can't write: {reason}", path=folder, reason=reason_of(error))
    return paths


def _is_stand_in(path: Path) -> bool:
    """Return whether a file is a stand-in: the vendor's library must never be overwritten."""
    return path.is_file() and FILE_VARIABLE.encode() in path.read_bytes().replace(b"\0", b"")
