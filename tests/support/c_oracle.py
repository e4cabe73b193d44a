"""What C programs do: texts of c_programs.py are compiled and run, and their calls recorded.

The virtual controller stands in for the vendor's library. It accepts every call (GT_CrdStart never moves anything), so
that the calls that a text makes depend on the text alone. Texts with undefined behaviour are told apart: the compiler
traps it.
"""

from __future__ import annotations

import ctypes
import os
import re
import subprocess
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import count
from pathlib import Path

from support.c_programs import Program
from support.controller import CC, FOR_EVER, Fault, VirtualController, build

from gusjob.controllers.gus.calls import CRD_FIELDS, HOST_CALLS, SIGNATURES, ArgKind

HARNESS = Path(__file__).with_name("c_harness.h")
_BATCH = 100
_FLAGS = ("-std=gnu17", "-O0", "-w", "-shared", "-fPIC", "-fsanitize=undefined,float-cast-overflow")
_TRAP = "-fsanitize-undefined-trap-on-error"
_NOT_TRAPPED = "-fno-sanitize=shift-base,alignment,vptr"
_DEFINED = re.compile(r"(?:#|%:)(?:\s|/\*.*?\*/)*(?:define|undef)\s+([A-Za-z_]\w*)", re.DOTALL)
_HARNESS_MACROS = {"FAST", "printf", "exit", "abort", "assert", "ASSERT", "NULL", "TRACE", "WHEN", "REPEAT", "LASER_ON"}


class Ending(StrEnum):
    """How a program ended."""

    RAN = "ran"
    UNDEFINED = "undefined behaviour or crash"
    ENDLESS = "took a second"
    NOT_C = "does not compile"


_ENDINGS = (Ending.RAN, Ending.UNDEFINED, Ending.ENDLESS)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What a program did: (code, "NAME(arguments)") of every call."""

    ending: Ending
    calls: tuple[tuple[int, str], ...] = ()


@dataclass(slots=True)
class Oracle:
    """Compiles and runs texts in a folder, against one virtual controller."""

    folder: Path
    controller: VirtualController
    library: Path
    numbers: Iterator[int] = field(default_factory=count)
    """Of libraries: a name that was loaded once would be that library for ever."""

    @classmethod
    def of(cls, folder: Path) -> Oracle:
        """Build the controller and what texts include."""
        library = build(folder)
        names = sorted(SIGNATURES | HOST_CALLS)
        signatures = [(SIGNATURES | HOST_CALLS)[name] for name in names]
        fields = "".join(f"{c} {name}{f'[{size}]' if size > 1 else ''}; " for name, c, size, _ in CRD_FIELDS)
        prototypes = [f"typedef struct {{ {fields}}} TCrdPrm;", *(f"{s.prototype};" for s in signatures)]
        (folder / "prologue.h").write_text("\n".join(prototypes) + "\n" + HARNESS.read_text("utf-8"), "utf-8")
        (folder / "gts.h").write_text("", "utf-8")
        (folder / "part.inc").write_text("GT_CrdClear(2, 1);\n", "utf-8")
        return cls(folder=folder, controller=VirtualController(library), library=library)

    def run(self, programs: Sequence[Program]) -> list[Outcome]:
        """Run the programs, each as if alone."""
        groups: list[list[Program]] = [[p] for p in programs if p.whole]
        plain = [p for p in programs if not p.whole]
        groups += [plain[at : at + _BATCH] for at in range(0, len(plain), _BATCH)]
        outcomes: dict[int, Outcome] = {}
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            for built in pool.map(self._build, groups):
                for library, members in built:
                    outcomes |= self._run_library(library, members)
        return [outcomes[p.number] for p in programs]

    def _build(self, programs: list[Program]) -> list[tuple[ctypes.CDLL | None, list[Program]]]:
        """Compile programs into one library; where that fails, into more, down to what does not compile."""
        library = self._compile(programs)
        if library is not None or len(programs) == 1:
            return [(library, programs)]
        middle = len(programs) // 2
        return self._build(programs[:middle]) + self._build(programs[middle:])

    def _compile(self, programs: list[Program]) -> ctypes.CDLL | None:
        assert CC is not None
        stem = f"texts{next(self.numbers)}"
        source, library = self.folder / f"{stem}.c", self.folder / f"{stem}.so"
        parts = ['#include "prologue.h"\n', *map(_function, programs)]
        table = ", ".join(f"(int (*)(int, char **))text_{p.number}" for p in programs)
        parts.append(
            f"int run_number(int at)\n{{\n    return run_text((int (*[])(int, char **)){{{table}}}[at]);\n}}\n"
        )
        source.write_bytes("".join(parts).encode())
        command = [CC, *_FLAGS, _TRAP, _NOT_TRAPPED, "-I", str(self.folder), "-o", str(library), str(source)]
        rpath = f"-Wl,-rpath,{self.library.parent}"
        done = subprocess.run([*command, str(self.library), rpath, "-lm"], capture_output=True, check=False)
        with suppress(OSError):  # A name that nothing defines.
            return ctypes.CDLL(str(library)) if done.returncode == 0 else None
        return None

    def _run_library(self, library: ctypes.CDLL | None, programs: list[Program]) -> dict[int, Outcome]:
        if library is None:
            return {p.number: Outcome(ending=Ending.NOT_C) for p in programs}
        return {p.number: self._run_one(library, at) for at, p in enumerate(programs)}

    def _run_one(self, library: ctypes.CDLL, at: int) -> Outcome:
        self.controller.reset()
        for signature in SIGNATURES.values():
            if not any(arg.kind is ArgKind.POINTER for arg in signature.args):
                self.controller.fault(Fault.RETURN, signature.name, count=FOR_EVER, value=0)
        open_card = getattr(self.controller.library, "GT_Open")  # noqa: B009 (no test control)
        open_card(0, 1)
        ending = _ENDINGS[library.run_number(at)]
        return Outcome(ending=ending, calls=tuple(self.controller.calls()[1:]))


def _function(program: Program) -> str:
    """The text as a function, and an end of its macros."""
    text = program.text.removeprefix("\ufeff")
    spliced = re.sub(r"\\\s*\n", "", text)
    ends = [f"#undef {name}\n" for name in sorted(set(_DEFINED.findall(spliced)) - _HARNESS_MACROS)]
    if program.whole:
        return f"#define main text_{program.number}\n{text}\n#undef main\n{''.join(ends)}"
    return f"static int text_{program.number}(void)\n{{\n{text}\n\n}}\n{''.join(ends)}"
