"""Compare what the reader of listings makes of random C texts with what a C compiler makes of them.

    PYTHONPATH=tests python -m support.c_mutation COUNT SEED [--piece TEXT] [--all]

A text is refused (any error), or the calls that were read are the calls that the compiled program made, or else they
disagree: then it is shown, made as short as it can be (--all: every text, else one for each piece). --piece: only
texts with pieces whose names contain the words, one piece in each ('' for each piece in turn).
"""

from __future__ import annotations

import argparse
import json
import random
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import islice, zip_longest
from pathlib import Path

from support.c_oracle import Ending, Oracle, Outcome
from support.c_programs import PIECES, Program, programs, with_pieces

from gusjob.controllers.gus.arguments import range_error
from gusjob.controllers.gus.calls import SIGNATURES
from gusjob.controllers.gus.listing import listing
from gusjob.diagnostics.model import Severity, has_errors
from gusjob.frontend.reader import read_listing
from gusjob.frontend.source import check_text

LEAST_READ = 0.3
"""Share of the texts that must be read: a reader that refuses everything is not right."""
_CHUNK = 500
_CALL = re.compile(r"(\w+)\((.*)\)$", re.DOTALL)
_NAME = re.compile(r"\b[A-Za-z_]\w*\b")
_STATUS = ("GT_CrdStatus",)
_MAX_SHOWN = 60
_MAX_TRIES = 150

CallValues = tuple[str, list[object]]
"""A call's name, and its arguments as numbers, lists of them, and None for names."""


class Verdict(StrEnum):
    """What became of a text."""

    REFUSED = "refused"
    AGREES = "agrees"
    DISAGREES = "DISAGREES"
    NOT_COMPARED = "not compared"


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """A text, what was read (and why not), and what the program did."""

    program: Program
    outcome: Outcome
    verdict: Verdict
    read: tuple[str, ...] = ()
    reasons: tuple[str, ...] = ()


def compare(program: Program, outcome: Outcome) -> Comparison:
    """Read a text, and compare its calls with what the compiled program did."""
    read, reasons = read_text(program)
    done = [text for code, text in outcome.calls]
    if outcome.ending is not Ending.RAN or any(code for code, _ in outcome.calls):
        verdict = Verdict.NOT_COMPARED
    elif reasons:
        verdict = Verdict.REFUSED
    else:
        pairs = zip_longest(calls_of(read), calls_of(done))
        wrong = next((pair for pair in pairs if pair[0] != pair[1]), None)
        verdict = Verdict.AGREES if wrong is None else Verdict.DISAGREES
        if wrong is not None and wrong[0] is not None and is_refused_later(wrong[0]):
            verdict, reasons = Verdict.REFUSED, ["GJ701, by the checks of the calls"]
    return Comparison(program=program, outcome=outcome, verdict=verdict, read=tuple(read), reasons=tuple(reasons))


def read_text(program: Program) -> tuple[list[str], list[str]]:
    """The calls that the reader finds, and its errors: "code: message", one for each code."""
    source, found = check_text(program.data, "x.c")
    if source is None:
        return [], [f"{found[0].rule.code}: {found[0].message}"]
    try:
        stream, found = read_listing(source)
    except Exception as error:  # noqa: BLE001 (the text that does it must be shown)
        return [f"CRASH({error!r})"], []
    if has_errors(found):
        errors = {d.rule.code: f"{d.rule.code}: {d.message}" for d in found if d.severity is Severity.ERROR}
        return [], list(errors.values())
    return "".join(listing(stream)).splitlines(), []


def calls_of(lines: Sequence[str]) -> list[CallValues]:
    """Calls without those that have no effect; statuses in a row are one, since polls are read as one."""
    calls: list[CallValues] = []
    for line in lines:
        match = _CALL.match(line)
        assert match is not None, line
        name, arguments = match.groups()
        if name == "CRASH":
            calls.append((name, []))
        if name not in SIGNATURES:
            continue
        text = _NAME.sub("null", arguments).replace("{", "[").replace("}", "]")
        call = (name, json.loads(f"[{text}]"))
        if name not in _STATUS or not calls or calls[-1] != call:
            calls.append(call)
    return calls


def is_refused_later(call: CallValues) -> bool:
    """Whether the checks of the calls refuse an argument: `gusjob check` and `report` end with an error."""
    name, values = call
    if name not in SIGNATURES:
        return False
    for arg, value in zip(SIGNATURES[name].args, values, strict=True):
        if arg.range is not None and isinstance(value, float | int) and range_error(arg.range, arg.name, value):
            return True
    return False


def compare_all(texts: Iterator[Program], oracle: Oracle) -> Iterator[Comparison]:
    """Compare texts, some hundreds at a time."""
    while chunk := list(islice(texts, _CHUNK)):
        yield from map(compare, chunk, oracle.run(chunk))


# ---- By hand -------------------------------------------------------------------------------------------------------


def shortest(comparison: Comparison, oracle: Oracle) -> Comparison:
    """Leave out lines of a text that disagrees, as long as it still does; after some tries it is short enough."""
    found = comparison
    size, tries = max(len(found.program.text.split("\n")) // 2, 1), _MAX_TRIES
    while size and tries > 0:
        lines = found.program.text.split("\n")
        texts = ("\n".join(lines[:at] + lines[at + size :]) for at in range(0, len(lines), size))
        for at, text in enumerate(islice(texts, tries)):
            tries -= 1
            # Each alone: a text that is cut anywhere could disturb its neighbours.
            shorter = replace(found.program, number=at, text=text)
            tried = compare(shorter, oracle.run([shorter])[0])
            if tried.verdict is Verdict.DISAGREES:
                found = tried
                break
        else:
            size //= 2
    return found


def _some(lines: Sequence[str]) -> str:
    """The lines, without the middle of many."""
    return "\n".join(lines if len(lines) <= _MAX_SHOWN else [*lines[:5], "...", *lines[-5:]])


def show(comparison: Comparison) -> None:
    """Print a text that disagrees."""
    program, width = comparison.program, 100
    print("-" * width)
    print(f"pieces: {', '.join(program.pieces) or 'none'}{' (whole program)' if program.whole else ''}")
    print(_some(program.text.replace("\r", "\\r").replace("\f", "\\f").replace("\v", "\\v").split("\n")))
    print(f"read {len(comparison.read)}:", _some(comparison.read), sep="\n")
    print(f"the program called {len(comparison.outcome.calls)}:")
    print(_some([call for _, call in comparison.outcome.calls]), flush=True)


def chosen_texts(arguments: argparse.Namespace) -> Iterator[Program]:
    """The texts of the command line."""
    if arguments.piece is None:
        yield from programs(arguments.count, arguments.seed)
        return
    names = [name for name in PIECES if arguments.piece in name and not name.startswith("whole")]
    for number in range(arguments.count):
        name = names[number % len(names)]
        yield with_pieces(number, (name,), random.Random(f"{arguments.seed} {name} {number}"))


def report(comparisons: Sequence[Comparison]) -> None:
    """Print counts, by piece and by reason."""
    counts = Counter(c.verdict for c in comparisons)
    compared = len(comparisons) - counts[Verdict.NOT_COMPARED]
    endings = Counter(c.outcome.ending.value for c in comparisons if c.verdict is Verdict.NOT_COMPARED)
    print(f"\n{len(comparisons)} texts, {compared} compared; not compared: {dict(endings)}")
    for verdict in (Verdict.AGREES, Verdict.REFUSED, Verdict.DISAGREES):
        print(f"{verdict:>10}: {counts[verdict]} ({counts[verdict] / max(compared, 1):.1%})")
    plain = [c for c in comparisons if not c.program.pieces and c.verdict is not Verdict.NOT_COMPARED]
    refused = [c for c in plain if c.verdict is Verdict.REFUSED]
    print(f"\ntexts without pieces: {len(plain)}, of them {len(refused)} refused:")
    reasons = Counter(reason for c in refused for reason in c.reasons[:1])
    for reason, count in reasons.most_common(_MAX_SHOWN):
        print(f"{count:6} {reason[:110]}")
    print("\ntexts with one piece: agrees / refused / disagrees")
    table: dict[str, Counter[Verdict]] = {}
    for c in comparisons:
        if len(c.program.pieces) == 1:
            table.setdefault(c.program.pieces[0], Counter())[c.verdict] += 1
    order = (Verdict.AGREES, Verdict.REFUSED, Verdict.DISAGREES)
    for name, row in sorted(table.items(), key=lambda item: (not item[1][Verdict.DISAGREES], item[0])):
        print(f"{' '.join(f'{row[v] or chr(46):>4}' for v in order)}  {name}")


def main() -> int:
    """Compare, print, and tell whether all agree."""
    parser = argparse.ArgumentParser()
    parser.add_argument("count", type=int)
    parser.add_argument("seed", type=int)
    parser.add_argument("--piece", help="part of a piece's name; '' for each piece in turn")
    parser.add_argument("--all", action="store_true")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        oracle = Oracle.of(Path(folder))
        comparisons = list(compare_all(chosen_texts(arguments), oracle))
        shown: set[str] = set()
        for c in comparisons:
            name = c.program.pieces[0] if c.program.pieces else ""
            if c.verdict is Verdict.DISAGREES and (arguments.all or (name not in shown and len(shown) < _MAX_SHOWN)):
                shown.add(name)
                show(shortest(c, oracle))
    report(comparisons)
    counts = Counter(c.verdict for c in comparisons)
    enough = counts[Verdict.AGREES] >= LEAST_READ * len(comparisons)
    return 0 if enough and not counts[Verdict.DISAGREES] else 1


if __name__ == "__main__":
    sys.exit(main())
