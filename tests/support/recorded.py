"""Programs for the recorder: written by tests, compiled against the stand-in, recorded."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import pytest

from gusjob.config.machine import Abi
from gusjob.record.build import Target, built_library

CC = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
CXX = shutil.which("c++") or shutil.which("g++") or shutil.which("clang++")
WINE = next(filter(None, [*map(shutil.which, ("wine64", "/usr/lib/wine/wine64"))]), None)
needs_compiler = pytest.mark.skipif(CC is None or sys.platform == "win32", reason="needs a C compiler on POSIX")
needs_cxx = pytest.mark.skipif(CXX is None or sys.platform == "win32", reason="needs a C++ compiler on POSIX")
needs_zig = pytest.mark.skipif(find_spec("ziglang") is None, reason="needs the package ziglang")
needs_wine = pytest.mark.skipif(WINE is None or find_spec("ziglang") is None, reason="needs wine64 and ziglang")

HEADER = Path(__file__).parents[1] / "vendor"
LINE = re.compile(r"\[(?P<ms>[0-9.]+)\] (?P<call>(?P<name>\w+)\(.*\)) = (?P<code>-?\d+)(?: // .*)?")


@cache
def library_folder(folder: Path, abi: Abi) -> Path:
    """A folder with the library under the name that programs link."""
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(built_library(abi), folder / ("libgts.dylib" if sys.platform == "darwin" else "libgts.so"))
    return folder


def compiled(folder: Path, source: str, abi: Abi = Abi.GUS, *flags: str, language: str = "c") -> Path:
    """Compile a program and link it to the stand-in."""
    compiler = CC if language == "c" else CXX
    assert compiler is not None
    path, program = folder / f"program.{language}", folder / "program"
    path.write_text(source, encoding="ascii")
    library = library_folder(folder / "link", abi)
    command = [compiler, "-Wall", f"-I{HEADER}", *flags, "-o", str(program), str(path), f"-L{library}", "-lgts"]
    subprocess.run(command, check=True)
    return program


def compiled_for_windows(folder: Path, source: str, target: Target = Target.X86_64_WINDOWS) -> Path:
    """Compile a Windows program, which loads its library itself."""
    path, program = folder / "program.c", folder / "program.exe"
    path.write_text(source, encoding="ascii")
    command = [sys.executable, "-m", "ziglang", "cc", "-O1", "-target", f"{target}-gnu", "-o", str(program), str(path)]
    subprocess.run(command, check=True, capture_output=True)
    return program


def lines(listing: Path) -> list[str]:
    """The lines of a listing that are no comments."""
    return [line for line in listing.read_text(encoding="ascii").splitlines() if not line.startswith("//")]


def calls(listing: Path) -> list[str]:
    """The calls of a listing with their codes: 'NAME(...) = 0'; rests and times are left out."""
    found = (LINE.fullmatch(line) for line in lines(listing))
    return [f"{match['call']} = {match['code']}" for match in found if match]


def times(listing: Path) -> list[float]:
    """The times of all lines."""
    return [float(line[1 : line.index("]")]) for line in lines(listing)]
