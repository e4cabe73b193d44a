"""A C text is read to exactly the calls that it makes when a C compiler compiles it, or it is refused.

By hand, with more texts and with what they show: `PYTHONPATH=tests python -m support.c_mutation 2000 1`.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest
from support.c_mutation import LEAST_READ, Verdict, calls_of, compare_all
from support.c_oracle import Ending, Oracle
from support.c_programs import PIECES, Program, piece_alone, programs
from support.controller import needs_controller

pytestmark = needs_controller

LISTINGS = Path(__file__).parents[2] / "listings"


@pytest.fixture(scope="module")
def oracle(tmp_path_factory: pytest.TempPathFactory) -> Oracle:
    return Oracle.of(tmp_path_factory.mktemp("texts"))


def test_random_texts_are_read_as_c_or_refused(oracle: Oracle) -> None:
    comparisons = list(compare_all(programs(150, 16), oracle))
    counts = Counter(c.verdict for c in comparisons)
    wrong = next((c for c in comparisons if c.verdict is Verdict.DISAGREES), None)
    assert wrong is None, f"{wrong.program.text}\nread: {wrong.read}\ncalled: {wrong.outcome.calls}"
    assert counts[Verdict.AGREES] >= LEAST_READ * len(comparisons)
    assert counts[Verdict.NOT_COMPARED] <= 0.05 * len(comparisons)


@pytest.mark.parametrize(
    ("text", "calls"),
    [
        ("GT_CrdClear(1, 0);\nif (more) GT_CrdClear(2, 0);", ["GT_CrdClear(1,0)"]),
        ("for (i = 1; i < 3; i++) GT_BufDelay(1, i, 0);", ["GT_BufDelay(1,1,0)", "GT_BufDelay(1,2,0)"]),
        ("// a \\\nGT_CrdClear(1, 0);\nGT_DisFPK(0);", ["GT_DisFPK(0)"]),
        ("float p = 0.1;\nGT_LaserPrfCmd(p, 0);", ["GT_LaserPrfCmd(0.10000000149011612,0)"]),
        ("GT_DisFPK(1); exit(0); GT_DisFPK(0);", ["GT_DisFPK(1)"]),
        ("#define X 5\nGT_DisFPK(X - 4);", ["GT_DisFPK(1)"]),
        ("long X = 4;\nGT_DisFPK(X - 4);", ["GT_DisFPK(0)"]),
    ],
)
def test_the_oracle_records_what_a_text_calls(oracle: Oracle, text: str, calls: list[str]) -> None:
    (outcome,) = oracle.run([Program(number=0, text=text, pieces=())])
    assert (outcome.ending, [call for _, call in outcome.calls]) == (Ending.RAN, calls)


@pytest.mark.parametrize(
    ("text", "ending"),
    [
        ("GT_DisFPK(1); n = 1 / n; GT_DisFPK(0);", Ending.UNDEFINED),
        ("k = n = 2147483647; n = n + k + 1; GT_DisFPK(n);", Ending.UNDEFINED),
        ("while (fast) ;", Ending.ENDLESS),
        ("GT_DisFPK(;", Ending.NOT_C),
    ],
)
def test_the_oracle_tells_texts_without_a_meaning(oracle: Oracle, text: str, ending: Ending) -> None:
    good = Program(number=1, text="GT_DisFPK(1);", pieces=())
    bad, fine = oracle.run([Program(number=0, text=text, pieces=()), good])
    assert (bad.ending, fine.ending, fine.calls) == (ending, Ending.RAN, ((0, "GT_DisFPK(1)"),))


def _listings_in_c() -> list[Path]:
    """The listings with calls that a C compiler takes as they are: for one card, without GTN_ calls, in UTF-8."""
    others = ("gbk", "gsn", "multi_card", "other_calls", "utf16", "utf8_bom", "manual_comment")
    return [p for p in sorted(LISTINGS.glob("*.c")) if _calls(p).exists() and not p.name.startswith(others)]


def _calls(listing: Path) -> Path:
    return listing.with_name(f"{listing.name}.calls")


@pytest.mark.parametrize("listing", _listings_in_c(), ids=lambda p: p.name)
def test_the_calls_of_listings_are_what_c_makes(oracle: Oracle, listing: Path) -> None:
    (outcome,) = oracle.run([Program(number=0, text=listing.read_text("utf-8"), pieces=())])
    assert outcome.ending is Ending.RAN
    assert calls_of(_calls(listing).read_text("utf-8").splitlines()) == calls_of([call for _, call in outcome.calls])


@pytest.mark.parametrize("seed", range(2))
def test_each_piece_is_c(oracle: Oracle, seed: int) -> None:
    made = [
        Program(number=number, text=piece_alone(name, seed), pieces=(name,), whole=name.startswith("whole"))
        for number, name in enumerate(PIECES)
    ]
    outcomes = zip(made, oracle.run(made), strict=True)
    assert [p.pieces[0] for p, outcome in outcomes if outcome.ending is Ending.NOT_C] == []
