"""Why a program may have made no call of the stand-in, as far as its files show it."""

from __future__ import annotations

import shutil
import struct
from collections.abc import Sequence
from pathlib import Path

from gusjob.controllers.gus.driver.headers import own_header, read_header
from gusjob.i18n.phrases import Phrase
from gusjob.inputs import exists
from gusjob.record.build import Target, system_of

_NEEDS_A_LOADER = 3
"""Type of the program header that names the loader (ELF)."""


def reason_of_silence(command: Sequence[str], target: Target | None) -> Phrase:
    """Return why a program made no call, or what it may be."""
    found = shutil.which(command[0])
    program = Path(found) if found is not None else Path(command[0])
    for path in (program, *map(Path, command[1:])):
        header = read_header(path) if exists(path) else None
        if header is not None and header.form == "PE" and system_of(target) != "windows":
            fitting = Target.X86_WINDOWS if header.machine == "x86" else Target.X86_64_WINDOWS
            return Phrase("{path} is a Windows program: record it with --target {target}", path=path, target=fitting)
    header, own = read_header(program), own_header()
    if header is not None and header.form == "ELF":
        if _is_static(program):
            return Phrase("{path} is linked statically: it loads no library and can't be recorded", path=program)
        if own is not None and target is None and header.machine != own.machine:
            return Phrase(
                "{path} is for {machine}, and the stand-in is built for {own}",
                path=program,
                machine=header.machine,
                own=own.machine,
            )
    return Phrase(
        "it loads no library of the vendor, one of another name (--library-name), or one that is beside the program "
        "and is loaded first"
    )


def _is_static(program: Path) -> bool:
    """Return whether an ELF program needs no loader."""
    try:
        with program.open("rb") as file:
            head = file.read(64)
            order, is_wide = ">" if head[5] == 2 else "<", head[4] == 2
            (first,) = struct.unpack_from(order + ("Q" if is_wide else "I"), head, 32 if is_wide else 28)
            size, count = struct.unpack_from(order + "HH", head, 54 if is_wide else 42)
            file.seek(first)
            table = file.read(size * count)
        types = {struct.unpack_from(order + "I", table, i * size)[0] for i in range(count)}
    except (OSError, struct.error, IndexError):
        return False
    return bool(types) and _NEEDS_A_LOADER not in types
