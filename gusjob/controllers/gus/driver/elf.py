"""Check that an ELF file is complete: loading a truncated one would kill the process with SIGBUS."""

from __future__ import annotations

import struct
from pathlib import Path

_PT_LOAD = 1


def is_truncated(path: str) -> bool:
    """Return whether an ELF file ends before the segments that its program header lists."""
    if not Path(path).is_file():
        return False
    size = Path(path).stat().st_size
    with Path(path).open("rb") as file:
        head = file.read(64)
        if head[:4] != b"\x7fELF":
            return False
        if len(head) < 64:
            return True
        order, wide = ">" if head[5] == 2 else "<", head[4] == 2
        (table,) = struct.unpack_from(order + ("Q" if wide else "I"), head, 32 if wide else 28)
        entry, count = struct.unpack_from(order + "HH", head, 54 if wide else 42)
        if table + entry * count > size:
            return True
        file.seek(table)
        rows = file.read(entry * count)
    # Elf64_Phdr: type, flags, offset, vaddr, paddr, filesz; Elf32_Phdr: type, offset, vaddr, paddr, filesz.
    form, at, length = ("IIQQQQ", 2, 5) if wide else ("IIIII", 1, 4)
    if entry < struct.calcsize(order + form):
        return False
    segments = (struct.unpack_from(order + form, rows, i * entry) for i in range(count))
    return any(segment[at] + segment[length] > size for segment in segments if segment[0] == _PT_LOAD)
