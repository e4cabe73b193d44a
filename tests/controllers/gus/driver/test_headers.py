"""Libraries of another system or processor, by headers made for the test."""

from __future__ import annotations

import platform
import struct
import sys
from pathlib import Path

import pytest

from gusjob.config.machine import Abi
from gusjob.controllers.gus.driver import headers
from gusjob.controllers.gus.driver.headers import BinaryHeader, misfit, own_header, read_header
from gusjob.controllers.gus.driver.inspection import inspect_library
from gusjob.controllers.gus.driver.library import load_library

X86, X86_64, ARM, AARCH64, RISC_V = 3, 62, 40, 183, 243
STEP = "get the library for this system and processor from the vendor"


def elf(machine: int, order: str = "<", *, wide: bool = True) -> bytes:
    """The header of a shared library without parts."""
    head = struct.pack(order + "4sBBB9xHHI", b"\x7fELF", 2 if wide else 1, 1 if order == "<" else 2, 1, 3, machine, 1)
    head += struct.pack(order + ("QQQ" if wide else "III"), 0, 0, 0)
    head += struct.pack(order + "IHHHHHH", 0, 64 if wide else 52, 56 if wide else 32, 0, 0, 0, 0)
    return head.ljust(64, b"\0")


def pe(machine: int, signature: bytes = b"PE\0\0") -> bytes:
    """The begin of a DLL."""
    return b"MZ".ljust(60, b"\0") + struct.pack("<I", 128) + bytes(64) + signature + struct.pack("<H", machine)


@pytest.fixture(name="path")
def _path(tmp_path: Path) -> Path:
    return tmp_path / "libgts.so"


def of(form: str, machine: str = "") -> BinaryHeader:
    return BinaryHeader(form=form, machine=machine)


@pytest.mark.parametrize(
    ("content", "header"),
    [
        (elf(X86_64), of("ELF", "x86-64")),
        (elf(AARCH64), of("ELF", "AArch64")),
        (elf(X86, wide=False), of("ELF", "x86")),
        (elf(8, ">", wide=False), of("ELF", "MIPS")),
        (elf(21, ">"), of("ELF", "PowerPC 64")),
        (elf(999), of("ELF", "ELF machine 999")),
        (pe(0x8664), of("PE", "x86-64")),
        (pe(0xAA64), of("PE", "AArch64")),
        (pe(0x14C), of("PE", "x86")),
        (pe(0x200), of("PE", "PE machine 0x200")),
        (b"\xcf\xfa\xed\xfe" + bytes(60), of("Mach-O")),
        (b"\xca\xfe\xba\xbe\0\0\0\2" + bytes(56), of("Mach-O")),
        (b"\xca\xfe\xba\xbe\0\0\0\x34" + bytes(56), None),  # A Java class.
        (pe(0x8664, b"NE\0\0"), None),
        (pe(0x8664)[:-2], None),
        (b"MZ" + b"\xff" * 62, None),
        (b"MZ is a text", None),
        (elf(X86_64)[:19], None),
        (b"", None),
    ],
)
def test_headers(path: Path, content: bytes, header: BinaryHeader | None) -> None:
    path.write_bytes(content)
    assert read_header(path) == header


def test_a_header_that_can_not_be_read(tmp_path: Path) -> None:
    assert read_header(tmp_path / "none.so") is None
    assert read_header(tmp_path) is None


def test_the_header_of_this_python() -> None:
    own = own_header()
    assert own is not None
    assert own.form == {"win32": "PE", "darwin": "Mach-O"}.get(sys.platform, "ELF")
    if sys.platform == "linux" and platform.machine() in ("x86_64", "aarch64"):
        assert own.machine in {"x86_64": ("x86-64", "x86"), "aarch64": ("AArch64", "ARM")}[platform.machine()]


@pytest.mark.parametrize(
    ("content", "own", "reason"),
    [
        (elf(AARCH64), of("ELF", "x86-64"), "it is for AArch64; this Python needs one for x86-64"),
        (elf(X86_64), of("ELF", "AArch64"), "it is for x86-64; this Python needs one for AArch64"),
        (elf(ARM, wide=False), of("ELF", "x86-64"), "it is for ARM; this Python needs one for x86-64"),
        (elf(RISC_V), of("ELF", "x86-64"), "it is for RISC-V; this Python needs one for x86-64"),
        (pe(0xAA64), of("PE", "x86-64"), "it is for AArch64; this Python needs one for x86-64"),
        (pe(0x8664), of("ELF", "x86-64"), "it is a library for Windows (PE); this Python needs one for Linux"),
        (elf(X86_64), of("PE", "x86-64"), "it is a library for Linux (ELF); this Python needs one for Windows"),
        (b"\xcf\xfa\xed\xfe", of("ELF", "x86"), "it is a library for macOS (Mach-O); this Python needs one for Linux"),
        # The loader's message says more about these.
        (elf(X86_64), of("ELF", "x86-64"), ""),
        (elf(X86, wide=False), of("ELF", "x86-64"), ""),
        (elf(AARCH64), of("ELF", "ARM"), ""),
        (b"\xcf\xfa\xed\xfe", of("Mach-O"), ""),
        (b"a text", of("ELF", "x86-64"), ""),
        (elf(AARCH64), None, ""),
    ],
)
def test_misfits(
    path: Path, monkeypatch: pytest.MonkeyPatch, content: bytes, own: BinaryHeader | None, reason: str
) -> None:
    path.write_bytes(content)
    monkeypatch.setattr(headers, "own_header", lambda: own)
    assert misfit(path) == reason


def other_processor() -> tuple[int, str, str]:
    """A processor that is not this Python's: number and name, and the name of this one's."""
    own = own_header()
    assert own is not None
    return (X86_64, "x86-64", own.machine) if own.machine in ("ARM", "AArch64") else (AARCH64, "AArch64", own.machine)


@pytest.mark.skipif(sys.platform != "linux", reason="glibc's loader")
@pytest.mark.parametrize("bare", [False, True])
def test_a_library_for_another_processor(path: Path, monkeypatch: pytest.MonkeyPatch, bare: bool) -> None:
    """The loader reports that there is no such file."""
    number, name, own = other_processor()
    path.write_bytes(elf(number))
    monkeypatch.setenv("LD_LIBRARY_PATH", f"/no/such/folder:{path.parent}")
    library = path.name if bare else str(path)
    reason = f"it is for {name}; this Python needs one for {own}"
    found = inspect_library(library)
    assert (found.loaded, found.reason, found.next_steps) == (False, reason, (STEP,))
    _, (fault,) = load_library(library, Abi.GTS, 0, [])
    assert fault.rule.code == "GJ901" and reason in fault.message


@pytest.mark.skipif(sys.platform != "linux", reason="glibc's loader")
@pytest.mark.parametrize(
    ("content", "system"), [(pe(0x8664), "Windows (PE)"), (b"\xcf\xfa\xed\xfe" + bytes(60), "macOS (Mach-O)")]
)
def test_a_library_for_another_system(path: Path, content: bytes, system: str) -> None:
    path.write_bytes(content)
    found = inspect_library(str(path))
    assert found.reason == f"it is a library for {system}; this Python needs one for Linux"
    assert found.next_steps == (STEP,)
