"""The diff of a formatted job."""

from __future__ import annotations

import os
from random import Random

from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from support.formatting import formatted, patched

from gusjob.frontend.format.unified_diff import unified_diff

EXAMPLES = int(os.environ.get("PROPERTY_EXAMPLES", "30"))


@given(st.integers(0, 2**32))
@settings(max_examples=EXAMPLES, phases=(Phase.explicit, Phase.reuse, Phase.generate))
def test_the_diff_gives_the_formatted_text(seed: int) -> None:
    rng = Random(seed)
    lines = ["WAIT", "WAIT", "WAIT", "WAIT", "wait", "", "", " ", "; c"]
    before = "\n".join(rng.choice(lines) for _ in range(rng.randrange(40))) + rng.choice(("", "\n"))
    after = formatted(before)
    diff = b"".join(unified_diff("a", before.encode(), after.encode()))
    assert bool(diff) == (before != after)
    if diff:
        assert patched(before.encode(), diff) == after.encode()


def test_the_diff_has_three_lines_of_context() -> None:
    before = b"\n".join([b"WAIT"] * 10 + [b"wait"] + [b"WAIT"] * 10) + b"\n"
    diff = b"".join(unified_diff("a", before, before.upper())).decode()
    assert diff == "--- a\n+++ a\n@@ -8,7 +8,7 @@\n WAIT\n WAIT\n WAIT\n-wait\n+WAIT\n WAIT\n WAIT\n WAIT\n"
    for between, hunks in ((6, 1), (7, 2)):
        before = b"wait\n" + b"WAIT\n" * between + b"wait\n"
        assert b"".join(unified_diff("a", before, before.upper())).count(b"@@ -") == hunks
