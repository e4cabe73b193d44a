"""Damaged journals are resumed: PYTHONPATH=tests python -m support.mutate [COUNT] [SEED].

Journals of runs that failed or were killed are changed at random, and each is resumed on a controller in the state in
which its run left it. Whatever a journal says: no exception, no emission and no motion but on the path of the job, no
emission in jumps, and the laser is off at the end. Half of the changed journals get right checksums again, as if a bug
had written them. What is left out and marked twice is not checked: in virtual time the driver's clock does not show how
far the motion gets. `--only N` runs one of them again.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from oracles.coverage import PathCells, coverage
from support.controller import GUS, Fault, Floats, Row, VirtualController, build
from support.forks import Fork, Send, cores, fork, results
from support.journals import bare_lines, with_checksums
from support.promises import Attempt
from support.resuming import (
    attempt,
    compiled,
    is_at_rest,
    quick_machine,
    recorded_of,
    request_of,
    without_guard,
)

from gusjob.controllers.gus.driver import fifo, session
from gusjob.hardware import locks
from gusjob.hardware.outcome import Ending
from gusjob.hardware.request import Refusal, read_recorded_run

Chance = random.Random
Mutation = Callable[[bytes, Chance], bytes]
OPTIONS = "speed=0,call_us=20,poll_us=40000,log=0"
BASES = 24
LIMIT_S = 1200.0
OPEN_ENDED = ("part", "broken", "to", "run", "row", "rows", "lead", "begin", "code", "line", "t", "args", "end", "off")


# Mutations of a journal's bytes.


def flip_bits(data: bytes, chance: Chance) -> bytes:
    changed = bytearray(data)
    for _ in range(chance.choice([1, 1, 1, 5, 50])):
        if changed:
            changed[chance.randrange(len(changed))] ^= 1 << chance.randrange(8)
    return bytes(changed)


def truncate(data: bytes, chance: Chance) -> bytes:
    return data[: chance.randint(0, len(data))]


def truncate_at_a_line(data: bytes, chance: Chance) -> bytes:
    lines = data.splitlines(keepends=True)
    return b"".join(lines[: chance.randint(0, len(lines))])


def delete_lines(data: bytes, chance: Chance) -> bytes:
    lines = data.splitlines(keepends=True)
    first = chance.randrange(len(lines) + 1)
    del lines[first : first + chance.choice([1, 1, 2, 10, 100])]
    return b"".join(lines)


def duplicate_lines(data: bytes, chance: Chance) -> bytes:
    lines = data.splitlines(keepends=True)
    first = chance.randrange(len(lines) + 1)
    count = chance.choice([1, 1, 3, 20])
    to = chance.choice([first, chance.randrange(len(lines) + 1), len(lines)])
    return b"".join([*lines[:to], *lines[first : first + count], *lines[to:]])


def reorder_lines(data: bytes, chance: Chance) -> bytes:
    lines = data.splitlines(keepends=True)
    kept = chance.choice([0, 1])
    tail = lines[kept:]
    if chance.random() < 0.5 and len(tail) > 1:
        i, j = chance.randrange(len(tail)), chance.randrange(len(tail))
        tail[i], tail[j] = tail[j], tail[i]
    else:
        chance.shuffle(tail)
    return b"".join([*lines[:kept], *tail])


def binary(data: bytes, chance: Chance) -> bytes:
    return chance.choice(
        [b"", chance.randbytes(chance.randint(1, 5000)), b"\0" * len(data), data + chance.randbytes(50)]
    )


def other_bytes(data: bytes, chance: Chance) -> bytes:
    """Line ends of another system, a byte order mark, zeros in the middle or at the end, everything twice."""
    at = chance.randint(0, len(data))
    return chance.choice(
        [
            data.replace(b"\n", b"\r\n"),
            b"\xef\xbb\xbf" + data,
            data[:at] + b"\0" * 512 + data[at:],
            data[:at] + b"\0" * (len(data) - at),
            data + data,
            data + b"\n\n",
            data.replace(b":", b" : "),
        ]
    )


NUMBERS = (
    b"99999", b"-1", b"-0", b"0", b"1", b"2", b"7", b"40", b"1e300", b"-1e300", b"1e999", b"NaN", b"Infinity", b"0.5",
    b"1e-300", b"9007199254740993", b"18446744073709551616", b"9" * 400, b"null", b"true", b'"1"', b"[]", b"{}",
)  # fmt: skip


def change_numbers(data: bytes, chance: Chance) -> bytes:
    found = list(re.finditer(rb"-?\d+(\.\d+)?([eE][-+]?\d+)?", data))
    for place in sorted(
        chance.sample(found, min(len(found), chance.choice([1, 1, 2, 8]))), key=lambda one: -one.start()
    ):
        number = chance.choice(NUMBERS)
        if chance.random() < 0.3:
            number = (
                b"%d" % (int(float(place.group())) + chance.choice([-2, -1, 1, 2, 10]))
                if len(place.group()) < 15
                else number
            )
        data = data[: place.start()] + number + data[place.end() :]
    return data


def changed_line(data: bytes, chance: Chance, change: Callable[[dict[str, Any]], None], *, name: str = "") -> bytes:
    """Change the object of one line; `name`: of a line that has this field, if there is one."""
    lines = data.splitlines()
    which = [i for i, line in enumerate(lines) if not name or b'"%b":' % name.encode() in line] or list(
        range(len(lines))
    )
    if not which:
        return data
    at = chance.choice(which)
    try:
        found = json.loads(lines[at])
    except (ValueError, RecursionError):
        return data
    if not isinstance(found, dict):
        return data
    change(found)
    lines[at] = json.dumps(found, separators=(",", ":")).encode()
    return b"\n".join(lines) + b"\n"


def odd_value(chance: Chance) -> Any:
    deep: Any = 1
    for _ in range(400):
        deep = [deep]
    return chance.choice(
        [
            None, True, False, -1, 0, 1, 3, 17, 60, 99999, 2**53 + 1, 2**70, 1e300, -1e300, float("nan"), float("inf"),
            0.5, "", "1", "x" * 10_000, [], {}, [1], [1, 2.5], [0, 0.0], [-1, 0], [99999, 1.0], [5, 1e9], [5, -3.0],
            [3, 1.0, 9, 2.0], [None, None], [[]], deep,
        ]
    )  # fmt: skip


def change_fields(data: bytes, chance: Chance) -> bytes:
    name = chance.choice(OPEN_ENDED)

    def change(found: dict[str, Any]) -> None:
        key = name if name in found or chance.random() < 0.2 else chance.choice(list(found) or [name])
        if chance.random() < 0.2:
            found.pop(key, None)
        else:
            found[key] = odd_value(chance)

    return changed_line(data, chance, change, name=name)


def add_marks(data: bytes, chance: Chance) -> bytes:
    """Add a line that a run writes, with values that may be wrong, or in a wrong line."""
    row, along = chance.choice([0, 1, 5, 20, 50, 78, 79, 80, 99999]), chance.choice([0.0, 0.5, 100.0, 3000.0, 1e9])
    marks: list[dict[str, Any]] = [
        {"t": 1.0, "part": row, "run": along, "lead": chance.choice([0, 1, 2, 5]), "to": [row, along]},
        {"t": 1.0, "broken": row, "run": along, "to": [row + chance.choice([0, 0, 1, -3]), along]},
        {"t": 1.0, "end": chance.choice(["done", "failed"]), "row": row, "run": along, "sure": True, "line": 5},
        {"t": 1.0, "off": True}, {"t": 1.0, "off": False}, {"t": 1.0, "rest": True}, {"t": 1.0, "moving": True},
        {"t": 1.0, "cut": True}, {"t": 1.0, "starting": True}, {"t": 0, "resumed": "/no/such/file.journal"},
        {"t": 1.0, "code": 0, "row": row, "line": 5, "call": "GT_LnXY", "args": [1, 0, 0, 500, 200, 0, 0]},
        {"t": 1.0, "code": 0, "line": 5, "call": "GT_CrdSpace", "args": [1, chance.choice([0, 4096, 16, -5, 1e6]), 0]},
        {"t": 1.0, "code": 0, "line": 5, "call": "GT_CrdStatus", "args": [1, 0, chance.choice([0, 10, 1e9]), 0]},
        {"t": 1.0, "code": 0, "line": 5, "call": "GT_GetCrdPos", "args": [1, [chance.uniform(-1e4, 1e4), 0.0]]},
        {"t": 1.0, "code": 0, "line": 5, "call": "GT_CrdClear", "args": [1, 0]},
    ]  # fmt: skip
    lines = data.splitlines(keepends=True)
    at = chance.choice([len(lines), chance.randint(min(1, len(lines)), len(lines))])
    mark = json.dumps(chance.choice(marks), separators=(",", ":")).encode() + b"\n"
    return b"".join([*lines[:at], mark, *lines[at:]])


def change_head(data: bytes, chance: Chance) -> bytes:
    """The head of another job, of another kind of run, of another version, of a run that resumes another one."""
    changes: list[dict[str, Any]] = [
        {"calls": "0" * 64}, {"rows": 12}, {"rows": -1}, {"options": "--no-laser"}, {"options": "--frame"},
        {"schema": "gusjob-journal/1"}, {"schema": "gusjob-journal/999"}, {"job": "/other.job"}, {"begin": None},
        {"begin": [5, 100.0]}, {"begin": [99999, 0.0]}, {"begin": [5, 1e9]}, {"begin": [5, 1.0, 2, 1.0]}, {"begin": []},
        {"resumes": "/no/such/file.journal"}, {"resumes": "0.journal"}, {"resumes": "1.journal"}, {"resumes": None},
        {"library": "", "abi": "gts"}, {"started": "yesterday"},
    ]  # fmt: skip
    head, newline, rest = data.partition(b"\n")
    change = chance.choice(changes)
    return changed_line(head + newline, chance, lambda found: found.update(change)) + rest


def nest(data: bytes, chance: Chance) -> bytes:
    """Nest more deeply than any parser goes."""
    lines = data.splitlines(keepends=True)
    at, depth = chance.randint(0, len(lines)), chance.choice([2000, 200_000])
    return b"".join([*lines[:at], b'{"t":1,"args":' + b"[" * depth + b"]" * depth + b"}\n", *lines[at:]])


MUTATIONS: tuple[Mutation, ...] = (
    flip_bits, truncate, truncate_at_a_line, delete_lines, duplicate_lines, reorder_lines, binary, other_bytes,
    change_numbers, change_numbers, change_fields, change_fields, change_fields, add_marks, add_marks, change_head,
    nest,
)  # fmt: skip


def resealed(data: bytes) -> bytes:
    """Give every line its right checksum again."""
    return with_checksums(bare_lines(data))


@dataclass(frozen=True, slots=True)
class Mutant:
    """How the journals of a run are changed. `target`: which of them, counted from the newest."""

    number: int
    target: int
    mutations: tuple[Mutation, ...]
    is_resealed: bool
    chance: Chance

    def __str__(self) -> str:
        names = ", ".join(mutation.__name__ for mutation in self.mutations)
        return f"{self.number}: {names}{', with checksums' if self.is_resealed else ''} in journal -{self.target + 1}"

    def apply(self, journals: Sequence[bytes]) -> list[bytes]:
        """Return the journals, the newest last."""
        made = list(journals)
        at = max(len(made) - 1 - self.target, 0)
        # A change of a line with its checksum would be found at once; so it is made without, where they are made again.
        data = b"\n".join([*bare_lines(made[at]), b""]) if self.is_resealed else made[at]
        for mutation in self.mutations:
            data = mutation(data, self.chance)
        made[at] = resealed(data) if self.is_resealed else data
        return made


def mutant_of(seed: int, number: int) -> Mutant:
    """Make a mutant by its seed and number."""
    chance = Chance(f"{seed}/{number}")
    return Mutant(
        number=number,
        target=chance.choice([0, 0, 0, 1]),
        mutations=tuple(chance.choices(MUTATIONS, k=chance.choice([1, 1, 2, 3]))),
        is_resealed=chance.random() < 0.5,
        chance=chance,
    )


# Runs whose journals are changed.


@dataclass(frozen=True, slots=True)
class Base:
    """A run, perhaps with a resume, and the machine as they left it."""

    folder: Path
    library: Path
    journals: tuple[bytes, ...]

    @property
    def environment(self) -> dict[str, str]:
        return {"VC_STATE": str(self.folder / "machine.state"), "VC_OPTIONS": OPTIONS}


def hurry(folder: Path) -> None:
    """Poll often, and keep the locks to this folder."""
    locks.LOCK_FOLDER = folder / "locks"
    without_guard()
    fifo.POLL_S = 0.0005
    session._PAUSE_S = 0.002


def base_of(folder: Path, library: Path, chance: Chance) -> Base:
    """Let a run fail or kill it; in half of the cases do the same to a resume."""
    folder.mkdir()
    base, number_of_runs = Base(folder, library, ()), chance.choice([1, 2])
    for number in range(number_of_runs):
        _wait(fork(_interrupted(base, number, chance), base.environment))
    journals = [folder / f"{number}.journal" for number in range(number_of_runs)]
    return replace(base, journals=tuple(one.read_bytes() for one in journals if one.exists()))


def _interrupted(base: Base, number: int, chance: Chance) -> Callable[[Send], None]:
    """Return the work of a run or resume that a fault ends."""
    what, nth, code = (
        chance.choice([Fault.KILL, Fault.KILL, Fault.RETURN]),
        chance.randint(20, 160),
        chance.choice([1, -7]),
    )
    slots, advance_ms = chance.choice([16, 4096]), chance.choice([0, 3, 40, 1000])

    def work(_: Send) -> None:
        hurry(base.folder)
        controller = VirtualController(base.library)
        controller.clear_faults()
        controller.options(slots=slots)
        controller.fault(what, nth=nth, value=code)
        recorded = recorded_of(base.folder / "0.journal") if number else None
        if isinstance(recorded, str):
            return
        journal = base.folder / f"{number}.journal"
        attempt(request_of(base.folder, base.library, quick_machine(), journal=journal, resume=recorded), controller)
        controller.advance(advance_ms)

    return work


def _wait(child: Fork) -> list[dict[str, Any]]:
    """Wait for the end of a fork; return the lines that it sent."""
    lines = list(child.lines(time.perf_counter() + LIMIT_S))
    child.kill()
    os.close(child.end)
    return lines


def whole_run(folder: Path, library: Path) -> tuple[Floats, PathCells]:
    """Return the lit stretches and the path of a run that is not interrupted."""
    folder.mkdir()

    def work(_: Send) -> None:
        hurry(folder)
        controller = VirtualController(library)
        done, _outcome = attempt(request_of(folder, library, quick_machine(), journal=folder / "0.journal"), controller)
        assert done.is_done, done
        np.save(folder / "lits.npy", controller.lits())
        np.save(folder / "rows.npy", controller.rows())

    lines = _wait(fork(work, {"VC_OPTIONS": OPTIONS}))
    assert not lines, lines
    return np.load(folder / "lits.npy"), PathCells.of(np.load(folder / "rows.npy"))


# Mutants.


@dataclass(frozen=True, slots=True)
class Reference:
    """Emission and path of a run that is not interrupted."""

    expected: Floats
    path: PathCells


def run_mutant(mutant: Mutant, base: Base, reference: Reference, controller: VirtualController) -> dict[str, Any]:
    """Resume changed journals, and return the result."""
    controller.recall()
    for old in base.folder.glob("*.journal"):
        old.unlink()
    for number, data in enumerate(mutant.apply(base.journals)):
        (base.folder / f"{number}.journal").write_bytes(data)
    newest = base.folder / f"{len(base.journals) - 1}.journal"
    rows_before, lits_before = len(controller.rows()), controller.lit_count()
    made = Attempt(mark=lits_before, journal=None)
    wrong: list[str] = []
    began = time.perf_counter()
    try:
        recorded = read_recorded_run(newest)
        if isinstance(recorded, Refusal):
            made = replace(made, ending="refused", message=recorded.localized)
        else:
            request = request_of(
                base.folder, base.library, quick_machine(), journal=base.folder / "new.journal", resume=recorded
            )
            made, _outcome = attempt(request, controller)
            # Where it was refused, no call was made.
            if made.ending in (Ending.DONE, Ending.FAILED) and not is_at_rest(controller):
                wrong.append(f"at the end: {controller.state()}")
    except BaseException:  # noqa: BLE001  (it is the result)
        wrong.append(traceback.format_exc())
    lits, rows = controller.lits(), controller.rows()[rows_before:]
    found = coverage(reference.expected, lits, [lits_before])
    wrong += [f"outside: {gap}" for gap in found.outside]
    wrong += [f"off the path: {rows[i, : Row.LENGTH + 1].tolist()}" for i in reference.path.off_path(rows)]
    wrong += [made.false_claim] if made.false_claim else []
    return {
        "case": str(mutant),
        "ending": made.ending,
        "resealed": mutant.is_resealed,
        "attempt": str(made),
        "wrong": wrong,
        "took_s": time.perf_counter() - began,
    }


def mutants_of_base(base: Base, mutants: Sequence[Mutant], reference: Reference) -> list[dict[str, Any]]:
    """Run mutants in a fork of their own, since a library maps one machine."""

    def work(send: Send) -> None:
        hurry(base.folder)
        controller = VirtualController(base.library)
        controller.clear_faults()
        controller.keep()
        warnings.simplefilter("error")
        for mutant in mutants:
            send(run_mutant(mutant, base, reference, controller))

    return _wait(fork(work, base.environment))


def main() -> int:
    """Resume COUNT damaged journals; the exit code is 1 if one of them broke a promise."""
    parser = argparse.ArgumentParser(description="Damage journals at random and resume them.")
    parser.add_argument("count", type=int, nargs="?", default=2000)
    parser.add_argument("seed", type=int, nargs="?", default=5)
    parser.add_argument("--only", type=int, help="run this mutant only, and show its end")
    parser.add_argument("--workers", type=int, default=cores())
    options = parser.parse_args()
    began = time.perf_counter()
    compiled()
    endings, longest_s, broken = Counter[str](), 0.0, False
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        library = build(folder, GUS)
        reference = Reference(*whole_run(folder / "whole", library))

        def run(number: int) -> dict[str, Any]:
            base = base_of(folder / str(number), library, Chance(f"{options.seed}/base {number}"))
            numbers = range(number, options.count, BASES)
            mutants = [mutant_of(options.seed, one) for one in numbers if options.only in (None, one)]
            return {"lines": mutants_of_base(base, mutants, reference) if base.journals else []}

        bases = list(range(BASES)) if options.only is None else [options.only % BASES]
        for made in results(bases, options.workers, run):
            if "error" in made:
                print(made["error"])
                return 1
            for line in made["lines"]:
                if "error" in line:
                    print(line["error"])
                    return 1
                how = "with checksums" if line["resealed"] else "without"
                endings[f"{line['ending'] or 'exception'} {how}"] += 1
                longest_s = max(longest_s, line["took_s"])
                broken = broken or bool(line["wrong"])
                if line["wrong"] or options.only is not None:
                    texts = (*line["wrong"], line["attempt"])
                    print("\n".join([line["case"], *(f"  {text}" for text in texts)]), flush=True)
    print(f"{endings.total()} damaged journals: {', '.join(f'{n} {ending}' for ending, n in endings.most_common())}")
    print(f"the longest took {longest_s:.1f} s, all of them {time.perf_counter() - began:.0f} s")
    return int(broken)


if __name__ == "__main__":
    sys.exit(main())
