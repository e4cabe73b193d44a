"""Throw mutated texts at reading, checking, compiling and interpreting; run by hand for hours, with atheris.

    pip install atheris
    python tests/fuzz/fuzz_texts.py -max_total_time=3600 CORPUS_FOLDER jobs tests/bad tests/manual

A text that begins with a line of GT_ calls is read as a listing, all others as a job. Anything that escapes as an
exception is a find, and so is a text that takes long (libFuzzer's -timeout). Limits are lower here than for users, so
that a bomb goes off quickly and the fuzzer gets on.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import atheris  # type: ignore[import-untyped,import-not-found,unused-ignore]  # installed by hand
from msgspec.structs import replace

with atheris.instrument_imports(include=["gusjob"]):
    from gusjob.config.machine import Machine
    from gusjob.controllers.gus.lower import compile_job
    from gusjob.controllers.gus.model import simulate_stream
    from gusjob.diagnostics.formats.text import diagnostic_text
    from gusjob.diagnostics.model import Diagnostic, has_errors
    from gusjob.frontend import check_text, read_job, read_listing
    from gusjob.frontend.expand import ledger
    from gusjob.frontend.source import is_listing_text
    from gusjob.lint import check
    from gusjob.report.rows import make_report

MACHINE = replace(Machine(), expansion_max_statements=5_000)
UNEQUAL = replace(MACHINE, pulses_per_mm=(1000.0, 700.0))
ledger.MAX_STEPS = 5_000
ledger.MAX_SETUPS = 500
SLOW_S_PER_KB = 5.0


def one(data: bytes) -> None:
    """Everything that gusjob does to a text."""
    began = time.perf_counter()
    source, diagnostics = check_text(data, "x")
    if source is None:
        localized(diagnostics)
        return
    machine = UNEQUAL if data[-1:] == b"u" else MACHINE
    if is_listing_text("", source.data):
        stream, diagnostics = read_listing(source)
        localized(diagnostics)
        if not has_errors(diagnostics):
            trace, diagnostics = simulate_stream(stream, machine, is_listing=True)
            localized(diagnostics)
    else:
        job, diagnostics = read_job(source, machine)
        found = [*diagnostics, *check(job, machine)]
        localized(found)
        if not has_errors(found):
            stream, diagnostics = compile_job(job, machine)
            localized(diagnostics)
            if not has_errors(diagnostics):
                trace, diagnostics = simulate_stream(stream, machine)
                localized(diagnostics)
                if has_errors(diagnostics) and not all(f.rule.code == "GJ713" for f in diagnostics):
                    raise AssertionError("what checks clean must run")
                if trace is not None:
                    make_report(trace, machine)
    taken = time.perf_counter() - began
    if taken > SLOW_S_PER_KB * max(len(data) / 1000, 1):
        raise AssertionError(f"{taken:.1f} s for {len(data)} bytes")


def localized(diagnostics: list[Diagnostic]) -> None:
    """Every message can be shown."""
    for diagnostic in diagnostics[:50]:
        diagnostic_text(diagnostic, lambda span, _: "", color=False)


def words() -> str:
    """Every keyword, unit and function, as libFuzzer's dictionary."""
    from gusjob.controllers.gus.calls import SIGNATURES
    from gusjob.frontend.parse.grammar import keywords
    from gusjob.frontend.parse.operators import FUNCTIONS
    from gusjob.kinematics.units import UNITS

    signs = (" (", ")", "==", "<=", "**", "\\x0a", " AS i")
    known = [*sorted(keywords("job.lark")), *UNITS, *FUNCTIONS, *SIGNATURES, *signs]
    return "".join(f'"{word}"\n' if word.startswith("\\") else f'" {word} "\n' for word in known)


if __name__ == "__main__":
    dictionary = Path(tempfile.gettempdir()) / "gusjob_words.dict"
    dictionary.write_text(words(), encoding="utf-8")
    atheris.Setup([*sys.argv, f"-dict={dictionary}", "-max_len=4000", "-timeout=60"], one)
    atheris.Fuzz()
