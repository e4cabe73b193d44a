"""Every number that a template reads is the float that Python reads from the same text."""

from __future__ import annotations

import random
from collections.abc import Callable

import numpy as np
import pytest

from gusjob.frontend.scan.rows import Template, TemplateBuilder
from gusjob.frontend.scan.scanner import scan

LEAST, MOST = 1e-100, 1e15


def is_read(text: str) -> bool:
    """Whether a number is within the limits of the language."""
    value = abs(float(text.replace(" ", "")))
    return value == 0 or LEAST <= value <= MOST


def digits(rng: random.Random, most: int) -> str:
    return "".join(rng.choice("0123456789") for _ in range(rng.randint(1, most)))


FORMS: dict[str, Callable[[random.Random], str]] = {
    "whole": lambda r: digits(r, 25),
    "short": lambda r: f"{digits(r, 3)}.{digits(r, 3)}",
    "decimal": lambda r: f"{digits(r, 12)}.{digits(r, 25)}",
    "point first": lambda r: f".{digits(r, 25)}",
    "point last": lambda r: f"{digits(r, 16)}.",
    "any point": lambda r: r.choice([f"{digits(r, 9)}.", f"{digits(r, 9)}.{digits(r, 9)}"]),
    "shortest": lambda r: repr(r.uniform(0, 10 ** r.randint(-3, 3))),
    "seventeen": lambda r: f"{r.uniform(0, 10 ** r.randint(-3, 14)):.17g}",
    "exponent": lambda r: f"{digits(r, 20)}.{digits(r, 20)}e{r.randint(0, 40)}",
    "minus exponent": lambda r: f"{digits(r, 20)}.{digits(r, 20)}E-{digits(r, 3)}",
    "plus exponent": lambda r: f"{digits(r, 20)}e+{digits(r, 25)}",
    "limit": lambda r: str(10**15 + r.randint(-3, 3)) + r.choice([".", ".0", ".5", ".0000000000000000001"]),
    "half": lambda r: f"{2**53 + 2 * r.randint(0, 9) + 1}e-{r.randint(0, 3)}",
}
SIGNS = ("", "-", "+", "- ")


def learn(line: str) -> Template | None:
    builder = TemplateBuilder.of_line(line)
    assert builder is not None
    return builder.build(0) if builder.add(0, 2) and not builder.unused else None


def scanned(texts: list[str]) -> tuple[list[str], list[float]]:
    """The numbers of a column that templates have read, and those that went to the parser."""
    rows = scan(
        "".join(f"X {text}mm\n" for text in texts).encode(),
        semicolon_comments=True,
        learn=learn,
        parse_line=lambda line, _: (),
    )
    return [texts[line - 1] for line in rows.line[rows.op == 0].tolist()], rows.column(0)[rows.op == 0].tolist()


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("sign", SIGNS)
def test_numbers_are_rounded_correctly(form: str, sign: str) -> None:
    rng = random.Random(f"{form} {sign}")
    texts = [sign + FORMS[form](rng) for _ in range(3000)]
    wanted = [text for text in texts if is_read(text)]
    read, values = scanned(texts)
    assert read == wanted
    expected = np.array([float(text.replace(" ", "")) + 0.0 for text in wanted])
    assert np.array(values).tobytes() == expected.tobytes()


def test_each_number_alone() -> None:
    """A number has the same value whatever the others in its chunk are."""
    rng = random.Random(1)
    for form in FORMS:
        for text in [FORMS[form](rng) for _ in range(40)]:
            assert scanned([text])[1] == [float(text)] * is_read(text), text


@pytest.mark.parametrize("text", ["1.2.3", ".", "..", "1..2", "1e5.5", "+-.", ".e5"])
def test_what_is_no_number_has_no_template(text: str) -> None:
    line = f"X {text}mm"
    assert learn(line) is None


def test_a_point_alone_is_no_number() -> None:
    assert scanned([".5", ".", ".25", ".e1"]) == ([".5", ".25"], [0.5, 0.25])
