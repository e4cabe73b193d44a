"""Build the stand-in: with the C compiler of this computer, or with the package ziglang, which also builds for others.

A library is built once: it is kept in the user's cache folder, under a hash of source, flags and compiler.
"""

from __future__ import annotations

import hashlib
import os
import platform
import shlex
import shutil
import stat
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from enum import StrEnum
from importlib.util import find_spec
from pathlib import Path

from msgspec import Struct

from gusjob.config.machine import Abi
from gusjob.i18n.phrases import Phrase, reason_of
from gusjob.record.stand_in_source import (
    ABI_NUMBERS,
    AUDIT_FILE,
    GENERATED,
    MAIN_FILE,
    exported,
    generated_functions,
    source_files,
)

_COMPILERS = ("cc", "gcc", "clang")
_FLAGS = ("-std=gnu11", "-O2", "-w", "-shared", "-fvisibility=hidden")


class Target(StrEnum):
    """Processor and system that a library is for."""

    X86_64_WINDOWS = "x86_64-windows"
    X86_WINDOWS = "x86-windows"
    X86_64_LINUX = "x86_64-linux"
    AARCH64_LINUX = "aarch64-linux"
    X86_64_MACOS = "x86_64-macos"
    AARCH64_MACOS = "aarch64-macos"

    @property
    def system(self) -> str:
        """Return windows, linux or macos."""
        return self.value.partition("-")[2]


_ZIG_TARGETS = {
    Target.X86_64_WINDOWS: "x86_64-windows-gnu",
    Target.X86_WINDOWS: "x86-windows-gnu",
    Target.X86_64_LINUX: "x86_64-linux-gnu.2.17",
    Target.AARCH64_LINUX: "aarch64-linux-gnu.2.17",
    Target.X86_64_MACOS: "x86_64-macos",
    Target.AARCH64_MACOS: "aarch64-macos",
}
"""An old C library, so that the library runs on old systems, too."""
_ENDINGS = {"windows": ".dll", "linux": ".so", "macos": ".dylib"}


class BuildError(Exception):
    """The library can't be built; the text is for the user."""

    def __init__(self, message: Phrase) -> None:
        super().__init__(message)
        self.message = message


class Compiler(Struct, frozen=True, kw_only=True):
    """A C compiler. `identity`: changes when the compiler changes; `is_zig`: builds for every target."""

    command: tuple[str, ...]
    identity: str
    is_zig: bool = False


def own_target() -> Target | None:
    """Return the target of this computer's Python; None if it is another one."""
    systems = {"win32": "windows", "darwin": "macos", "linux": "linux"}
    machines = {"amd64": "x86_64", "x86_64": "x86_64", "arm64": "aarch64", "aarch64": "aarch64"}
    machine = machines.get(platform.machine().lower(), "")
    if sys.platform == "win32" and sys.maxsize < 2**32:
        machine = "x86"
    name = f"{machine}-{systems.get(sys.platform, '')}"
    return Target(name) if name in list(Target) else None


def library_name(stem: str, target: Target | None) -> str:
    """Return gts.dll, libgts.so or libgts.dylib."""
    system = system_of(target)
    return f"{stem}.dll" if system == "windows" else f"lib{stem}{_ENDINGS[system]}"


def built_library(
    abi: Abi,
    target: Target | None = None,
    on_build: Callable[[], None] = lambda: None,
    environ: Mapping[str, str] = os.environ,
    long_bits: int | None = None,
) -> Path:
    """Return the library for an ABI and a target, None for this computer; it is built if the cache lacks it.

    Args:
        abi: functions of the library.
        target: what it is for.
        on_build: called before it is built, which takes some seconds, the first time for another target a minute.
        environ: where CC, PATH and the cache folder are found.
        long_bits: 32 or 64 bits of what the vendor's header calls long; None as the target's C.

    Raises:
        BuildError: there is no compiler, it fails, or there is no safe place for the library.
    """
    compiler = find_compiler(target, environ)
    flags = _flags(abi, target, compiler, long_bits)
    library = cache_folder(environ) / _hash(compiler, flags) / library_name("gts", target)
    if not library.is_file():
        on_build()
        _build(compiler, flags, MAIN_FILE, library)
    return library


def built_audit(environ: Mapping[str, str] = os.environ) -> Path | None:
    """Return the library that makes Linux load the stand-in wherever a program looks for the vendor's library.

    None on other systems, and where the C library has no LD_AUDIT.

    Raises:
        BuildError: there is no compiler, or no safe place for the library.
    """
    if sys.platform != "linux":
        return None
    compiler = find_compiler(None, environ)
    flags = _flags(Abi.GUS, None, compiler)
    library = cache_folder(environ) / _hash(compiler, flags) / "audit.so"
    if not library.is_file():
        try:
            _build(compiler, flags, AUDIT_FILE, library)
        except BuildError:
            return None
    return library


def find_compiler(target: Target | None = None, environ: Mapping[str, str] = os.environ) -> Compiler:
    """Return the C compiler of CC, cc, gcc, clang, or zig of the package ziglang; for another target only zig.

    Raises:
        BuildError: there is none.
    """
    is_native = target is None or target == own_target()
    if is_native:
        own = _words_of_cc(environ)
        for words in [own] if own else [[name] for name in _COMPILERS]:
            path = shutil.which(words[0], path=environ.get("PATH"))
            if path is not None:
                path = str(Path(path).absolute())
                about = Path(path).resolve().stat()
                identity = f"{path} {about.st_size} {about.st_mtime_ns}"
                return Compiler(command=(path, *words[1:]), identity=identity)
        if own:
            raise BuildError(Phrase("{program}, which CC names, is not found", program=own[0]))
    if find_spec("ziglang") is not None:
        from importlib.metadata import version

        zig = (sys.executable, "-m", "ziglang", "cc")
        return Compiler(command=zig, identity=f"ziglang {version('ziglang')}", is_zig=True)
    how = 'python -m pip install "gusjob[record]"'
    if is_native:
        raise BuildError(Phrase("there is no C compiler (cc, gcc, clang): install one, or {how}", how=how))
    raise BuildError(Phrase("a library for {target} needs the package ziglang: {how}", target=target, how=how))


def _words_of_cc(environ: Mapping[str, str]) -> list[str]:
    """Split the environment's CC: a compiler and its options."""
    try:
        return shlex.split(environ.get("CC", ""))
    except ValueError:
        raise BuildError(Phrase("CC has a quotation mark without its other half: {text}", text=environ["CC"])) from None


def cache_folder(environ: Mapping[str, str] = os.environ) -> Path:
    """Return the folder of built libraries, made if needed. Only this user can write to it.

    Raises:
        BuildError: it can't be made, or others can write to it: they could replace the library.
    """
    folder = _user_cache(environ) / "gusjob" / "stand-in"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if sys.platform != "win32":
            about = folder.stat()
            if about.st_uid != os.getuid() or about.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
                raise BuildError(
                    Phrase(
                        "{path}: other users can write to this folder; remove their permission (chmod go-w)",
                        path=folder,
                    )
                )
    except OSError as error:
        reason = reason_of(error)
        if sys.platform not in ("win32", "darwin"):
            raise BuildError(
                Phrase(
                    "{path}: can't write: {reason}; name another folder in XDG_CACHE_HOME", path=folder, reason=reason
                )
            ) from error
        raise BuildError(Phrase("{path}: can't write: {reason}", path=folder, reason=reason)) from error
    return folder


def _user_cache(environ: Mapping[str, str]) -> Path:
    """Return the folder for caches of this user."""
    if sys.platform == "win32":
        named = environ.get("LOCALAPPDATA", "")
        return Path(named) if named else Path.home() / "AppData" / "Local"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    named = environ.get("XDG_CACHE_HOME", "")
    return Path(named) if named and Path(named).is_absolute() else Path.home() / ".cache"


def system_of(target: Target | None) -> str:
    """Return windows, linux or macos; None is for this computer."""
    if target is not None:
        return target.system
    return {"win32": "windows", "darwin": "macos"}.get(sys.platform, "linux")


def _flags(abi: Abi, target: Target | None, compiler: Compiler, long_bits: int | None = None) -> tuple[str, ...]:
    """Return what the compiler is called with, without the files."""
    flags = [*_FLAGS, f"-DVC_ABI={ABI_NUMBERS[abi]}", *([f"-DVC_LONG={long_bits}"] if long_bits else [])]
    if compiler.is_zig:
        flags += ["-fno-sanitize=undefined"]
        if target is not None:
            flags += ["-target", _ZIG_TARGETS[target]]
    if system_of(target) == "windows":
        flags += [] if compiler.is_zig else ["-static-libgcc"]
    else:
        flags += ["-fPIC"]
    return tuple(flags)


def _hash(compiler: Compiler, flags: tuple[str, ...]) -> str:
    hashed = hashlib.sha256()
    for path in source_files():
        hashed.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    for text in (generated_functions(), *compiler.command, compiler.identity, *flags):
        hashed.update(text.encode() + b"\0")
    return hashed.hexdigest()[:32]


def _build(compiler: Compiler, flags: tuple[str, ...], source: Path, library: Path) -> None:
    """Build into a folder of its own, then move the library to its place: two processes may build at once."""
    with tempfile.TemporaryDirectory(prefix="building-", dir=library.parent.parent) as name:
        folder = Path(name)
        (folder / GENERATED).write_text(generated_functions(), encoding="ascii")
        built = folder / library.name
        files = [f"-I{folder}", "-o", str(built), str(source)]
        if library.suffix == ".dll":
            exports = folder / "exports.def"  # GT_LnXY, not GT_LnXY@44 as __stdcall functions are named on 32 bits.
            exports.write_text("\n".join(["EXPORTS", *sorted(exported()), ""]), encoding="ascii")
            files += [str(exports)]
        else:
            files += ["-lm", "-lpthread"]
        try:
            done = subprocess.run(
                [*compiler.command, *flags, *files],
                stdin=subprocess.DEVNULL,
                capture_output=True,
                cwd=folder,
                check=False,
            )
        except OSError as error:
            raise BuildError(_failed(compiler, reason_of(error))) from error
        if done.returncode != 0 or not built.is_file():
            raise BuildError(_failed(compiler, done.stderr.decode(errors="replace").strip()[-2000:]))
        try:
            library.parent.mkdir(mode=0o700, exist_ok=True)
            built.replace(library)
        except OSError as error:
            raise BuildError(Phrase("{path}: can't write: {reason}", path=library, reason=reason_of(error))) from error


def _failed(compiler: Compiler, reason: str) -> Phrase:
    reason = reason or Phrase("it says nothing")
    return Phrase("{compiler} can't build the stand-in: {reason}", compiler=" ".join(compiler.command), reason=reason)
