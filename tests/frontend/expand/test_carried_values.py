"""Loops that carry values, against the same loops in Python."""

from __future__ import annotations

import numpy as np
import pytest

from gusjob.config.machine import Machine
from gusjob.frontend import check_text, read_job
from gusjob.ir.job import Job

MACHINE = Machine(pulses_per_mm=(1.0, 1.0))


def read(text: str) -> tuple[Job, list[str]]:
    source, _ = check_text(text.encode(), "x")
    assert source is not None
    job, found = read_job(source, MACHINE)
    return job, [f"{one.span.line} {one.rule.code}" for one in found]


def dwells(text: str) -> list[float]:
    job, found = read(text)
    assert found == []
    found_ms: list[float] = job.path.dwell_ms.tolist()
    return found_ms


@pytest.mark.parametrize("count", [1, 15, 16, 17, 32_768, 32_769, 70_000])
def test_a_value_is_carried_through_all_iterations(count: int) -> None:
    expected, a = [], 0.1
    for i in range(count):
        before, a = a, a * 0.999 + i
        expected += [before, a]
    text = f"LET a = 0.1\nREPEAT {count} AS i\nDWELL (a)\nLET a = a*0.999 + i\nDWELL (a)\nEND\nDWELL (a)\n"
    # Float noise beside whole numbers is settled.
    assert np.allclose(dwells(text), [*expected, a], rtol=1e-12, atol=0)


def test_each_statement_has_the_value_of_its_place() -> None:
    expected, a, b = [], 1.0, 1.0
    for _ in range(40):
        expected.append(a)
        a, b = b, a + b
        expected.append(a)
        a = a + 1
        expected.append(b - a)
    text = "LET a = 1\nLET b = 1\nREPEAT 40\nDWELL (a)\nLET c = a + b\nLET a = b\nLET b = c\nDWELL (a)\nLET a = a + 1\n"
    assert dwells(text + "DWELL (b - a)\nEND\n") == expected


def test_a_value_carried_inside_a_routine_is_local() -> None:
    text = "LET a = 5\nDEF f(n)\nREPEAT n\nLET a = a + 1\nEND\nDWELL (a)\nEND\nCALL f(20)\nDWELL (a)\n"
    assert dwells(text) == [25, 5]


def test_the_loop_variable_may_be_set_and_hides_a_name() -> None:
    text = (
        "LET i = 7\nLET a = 0\nREPEAT 20 AS i\nLET a = a + i\nLET i = 100\nDWELL (i + a)\nEND\nDWELL (i)\nDWELL (a)\n"
    )
    sums = np.cumsum(np.arange(20.0))
    assert dwells(text) == [*(100 + sums), 7, 190]


def test_a_name_may_change_its_kind() -> None:
    text = "LET s = 2\nLET a = 1\nREPEAT 20\nDWELL (a/s)\nLET a = a*1ms/1ms\nLET s = s\nEND\n"
    assert dwells(text) == [0.5] * 20
    text = "LET a = 3\nREPEAT 20 AS i\nIF i == 0\nDWELL (a)\nEND\nIF i > 0\nDWELL (a)\nEND\nLET a = 4ms\nEND\n"
    assert dwells(text) == [3, *[4] * 19]
    text = "LET b = 0\nLET a = 3\nREPEAT 20 AS i\nLET b = b + 1\nDWELL (a)\nLET a = 4ms\nEND\n"
    assert dwells(text) == [3, *[4] * 19]


def test_errors_are_those_of_single_iterations() -> None:
    _, found = read("LET a = 20\nREPEAT 40\nLET a = a - 1\nLET b = 1/a\nDWELL (b)\nEND\n")
    assert found == ["4 GJ123"]
    _, found = read("LET a = 1\nREPEAT 40\nLET a = a + c\nDWELL (a)\nEND\n")
    assert found == ["3 GJ121"]
    _, found = read("LET a = 1\nREPEAT 40\nLET a = a*1mm\nDWELL (a)\nEND\n")
    assert sorted(found) == ["3 GJ122", "4 GJ203"]
    source, _ = check_text(b"LET a = 1\nREPEAT 700\nLET a = a*3\nLINE X (a)\nEND\n", "x")
    assert source is not None
    assert not any("nan" in one.message for one in read_job(source, MACHINE)[1])


def test_small_values_are_carried_exactly() -> None:
    job, _ = read("LET a = 1\nREPEAT 20\nDWELL 1\nLET a = a/4\nLINE X (a)\nEND\n")
    assert job.path.x[1::2].tolist() == [4.0 ** -(k + 1) for k in range(20)]


def test_iterations_are_named_in_diagnostics() -> None:
    source, _ = check_text(b"LET a = 0\nREPEAT 40 AS i\nLET a = a + 1\nDWELL (5 - i/0.5 + a)\nEND\n", "x")
    assert source is not None
    job, _ = read_job(source, MACHINE)
    steps = [job.provenance.steps(int(node))[0].values for node in job.path.provenance] if job.provenance else []
    assert steps == [{"i": i} for i in range(40)]
