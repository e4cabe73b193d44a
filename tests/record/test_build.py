"""The library: built once, in a safe place, for this system and for others."""

from __future__ import annotations

import os
import stat
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from support.recorded import needs_compiler, needs_zig

from gusjob.config.machine import Abi
from gusjob.controllers.gus.driver.headers import read_header
from gusjob.record.build import BuildError, Target, built_library, find_compiler, library_name, own_target
from gusjob.record.stand_in_source import exported


def environ(tmp_path: Path, **more: str) -> dict[str, str]:
    """An environment with a cache folder of its own."""
    return {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache"), **more}


linux = pytest.mark.skipif(sys.platform != "linux", reason="sets the cache folder as on Linux")


@linux
@needs_compiler
def test_it_is_built_once_for_each_abi(tmp_path: Path) -> None:
    built: list[int] = []
    paths = [
        built_library(abi, None, lambda: built.append(1), environ(tmp_path)) for abi in (Abi.GUS, Abi.GUS, Abi.GTS)
    ]
    assert len(built) == 2
    assert paths[0] == paths[1] != paths[2]
    assert paths[0].is_relative_to(tmp_path / "cache" / "gusjob" / "stand-in")
    assert [path.name for path in (tmp_path / "cache" / "gusjob" / "stand-in").glob("building*")] == []
    for folder in (paths[0].parent, paths[0].parent.parent):
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700


@linux
@needs_compiler
def test_two_processes_build_at_once(tmp_path: Path) -> None:
    code = "from gusjob.record.build import *; print(built_library(Abi.GUS))"
    processes = [
        subprocess.Popen([sys.executable, "-c", code], env=environ(tmp_path), stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    found = {process.communicate()[0] for process in processes}
    assert [process.returncode for process in processes] == [0, 0]
    assert len(found) == 1
    assert read_header(Path(found.pop().strip())) is not None


@linux
@needs_compiler
def test_a_folder_that_others_can_write_to(tmp_path: Path) -> None:
    """They could put a library of their own there."""
    folder = tmp_path / "cache" / "gusjob" / "stand-in"
    folder.mkdir(parents=True)
    folder.chmod(0o777)
    with pytest.raises(BuildError, match="other users can write to this folder"):
        built_library(Abi.GUS, environ=environ(tmp_path))


@linux
def test_a_cache_that_can_not_be_made(tmp_path: Path) -> None:
    (tmp_path / "cache").write_text("")
    with pytest.raises(
        BuildError, match=r"cache/gusjob/stand-in: can't write: .*; name another folder in XDG_CACHE_HOME"
    ):
        built_library(Abi.GUS, environ=environ(tmp_path))


@needs_compiler
def test_the_compiler_of_cc_comes_first(tmp_path: Path) -> None:
    own = tmp_path / "my-cc"
    own.write_text("#!/bin/sh\nexit 3\n")
    own.chmod(0o755)
    compiler = find_compiler(environ=environ(tmp_path, CC=f"{own} -m64"))
    assert compiler.command == (str(own), "-m64")
    with pytest.raises(BuildError, match="no-such-cc, which CC names, is not found"):
        find_compiler(environ=environ(tmp_path, CC="no-such-cc"))
    with pytest.raises(BuildError, match='CC has a quotation mark without its other half: "x'):
        find_compiler(environ=environ(tmp_path, CC='"x'))


@linux
def test_a_compiler_that_fails(tmp_path: Path) -> None:
    own = tmp_path / "my-cc"
    own.write_text("#!/bin/sh\necho no licence >&2\nexit 3\n")
    own.chmod(0o755)
    with pytest.raises(BuildError, match="my-cc can't build the stand-in: no licence"):
        built_library(Abi.GUS, environ=environ(tmp_path, CC=str(own)))


def test_without_any_compiler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gusjob.record.build.find_spec", lambda _name: None)
    with pytest.raises(BuildError, match=r"there is no C compiler .*: install one, or python -m pip install"):
        find_compiler(environ={"PATH": str(tmp_path)})
    other = Target.AARCH64_MACOS if own_target() is not Target.AARCH64_MACOS else Target.X86_WINDOWS
    with pytest.raises(BuildError, match=f"a library for {other} needs the package ziglang"):
        find_compiler(other, environ=dict(os.environ))


def test_names() -> None:
    assert library_name("gts", Target.X86_WINDOWS) == "gts.dll"
    assert library_name("gts", Target.AARCH64_LINUX) == "libgts.so"
    assert library_name("gts", Target.X86_64_MACOS) == "libgts.dylib"


def exports_of_dll(path: Path) -> tuple[str, ...]:
    """The exported names of a DLL."""
    data = path.read_bytes()
    pe = struct.unpack_from("<I", data, 60)[0]
    sections, optional = struct.unpack_from("<H", data, pe + 6)[0], pe + 24
    wide = struct.unpack_from("<H", data, optional)[0] == 0x20B
    table = struct.unpack_from("<I", data, optional + (112 if wide else 96))[0]
    first = optional + struct.unpack_from("<H", data, pe + 20)[0]
    places = [struct.unpack_from("<4I", data, first + 40 * i + 8) for i in range(sections)]

    def at(address: int) -> Any:
        return next(raw + address - start for size, start, _, raw in places if start <= address < start + size)

    count, names = (
        struct.unpack_from("<I4xI", data, at(table) + 24)[0],
        struct.unpack_from("<I", data, at(table) + 32)[0],
    )
    addresses = struct.unpack_from(f"<{count}I", data, at(names))
    return tuple(data[at(a) : data.index(b"\0", at(a))].decode() for a in addresses)


@pytest.mark.slow
@needs_zig
@pytest.mark.parametrize(("target", "machine"), [(Target.X86_64_WINDOWS, "x86-64"), (Target.X86_WINDOWS, "x86")])
def test_windows(target: Target, machine: str) -> None:
    """All functions, by their names alone: no GT_LnXY@44."""
    library = built_library(Abi.GTS, target)
    header = read_header(library)
    assert header is not None
    assert (header.form, header.machine) == ("PE", machine)
    assert exports_of_dll(library) == tuple(sorted(exported()))


@pytest.mark.slow
@needs_zig
@pytest.mark.parametrize(
    ("target", "form", "machine"),
    [
        (Target.X86_64_LINUX, "ELF", "x86-64"),
        (Target.AARCH64_LINUX, "ELF", "AArch64"),
        (Target.AARCH64_MACOS, "Mach-O", ""),
    ],
)
def test_other_systems(target: Target, form: str, machine: str) -> None:
    header = read_header(built_library(Abi.GUS, target))
    assert header is not None
    assert (header.form, header.machine) == (form, machine)
