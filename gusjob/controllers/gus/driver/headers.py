"""System and processor of a library, from its header: the loader may only report that there is no such file."""

from __future__ import annotations

import struct
import sys
from pathlib import Path

from msgspec import Struct

from gusjob.i18n.phrases import Phrase

_ELF_MACHINES = {
    2: "SPARC", 3: "x86", 8: "MIPS", 20: "PowerPC", 21: "PowerPC 64", 22: "S/390", 40: "ARM", 43: "SPARC 64",
    62: "x86-64", 183: "AArch64", 243: "RISC-V", 258: "LoongArch",
}  # fmt: skip
_PE_MACHINES = {0x14C: "x86", 0x8664: "x86-64", 0x1C0: "ARM", 0x1C4: "ARM", 0xAA64: "AArch64"}
_MACH_O_MAGICS = (b"\xfe\xed\xfa\xce", b"\xfe\xed\xfa\xcf", b"\xce\xfa\xed\xfe", b"\xcf\xfa\xed\xfe")
_UNIVERSAL_MAGIC, _MOST_PARTS = b"\xca\xfe\xba\xbe", 20
"""Java's class files begin with the same bytes; the number after them is larger there."""

_OTHER_BITS = ({"x86", "x86-64"}, {"ARM", "AArch64"}, {"PowerPC", "PowerPC 64"}, {"SPARC", "SPARC 64"})
"""Processors that differ in their bits: one computer often runs the programs of both."""
_SYSTEMS = {"ELF": "Linux", "PE": "Windows", "Mach-O": "macOS"}


class BinaryHeader(Struct, frozen=True, kw_only=True):
    """The header of a library or program. `form`: ELF, PE or Mach-O; `machine`: '' if it is not read."""

    form: str
    machine: str = ""


def misfit(path: Path) -> str:
    """Return why a library is not for this Python, as far as its header shows it: system or processor.

    A library that only has other bits is not reported.
    """
    theirs, own = read_header(path), own_header()
    if theirs is None or own is None:
        return ""
    if theirs.form != own.form:
        return Phrase(
            "it is a library for {system} ({form}); this Python needs one for {own}",
            system=_SYSTEMS[theirs.form],
            form=theirs.form,
            own=_SYSTEMS[own.form],
        )
    both = {theirs.machine, own.machine}
    if len(both) == 1 or "" in both or both in _OTHER_BITS:
        return ""
    return Phrase("it is for {machine}; this Python needs one for {own}", machine=theirs.machine, own=own.machine)


def own_header() -> BinaryHeader | None:
    """Return the header of this Python; None if it is not known."""
    program = Path("/proc/self/exe")
    return read_header(program if sys.platform == "linux" and program.exists() else Path(sys.executable))


def read_header(path: Path) -> BinaryHeader | None:
    """Read the header of a library or program; None if it is neither, or can't be read."""
    try:
        with path.open("rb") as file:
            head = file.read(64)
            if head[:2] == b"MZ" and len(head) == 64:
                file.seek(struct.unpack_from("<I", head, 60)[0])
                return _pe(file.read(6))
    except (OSError, ValueError):
        return None
    if head[:4] == b"\x7fELF" and len(head) >= 20:
        (number,) = struct.unpack_from((">" if head[5] == 2 else "<") + "H", head, 18)
        return BinaryHeader(form="ELF", machine=_ELF_MACHINES.get(number, f"ELF machine {number}"))
    return BinaryHeader(form="Mach-O") if _is_mach_o(head) else None


def _pe(head: bytes) -> BinaryHeader | None:
    if head[:4] != b"PE\0\0" or len(head) < 6:
        return None
    (number,) = struct.unpack_from("<H", head, 4)
    return BinaryHeader(form="PE", machine=_PE_MACHINES.get(number, f"PE machine {number:#x}"))


def _is_mach_o(head: bytes) -> bool:
    if head[:4] in _MACH_O_MAGICS:
        return True
    return head[:4] == _UNIVERSAL_MAGIC and int.from_bytes(head[4:8]) <= _MOST_PARTS
