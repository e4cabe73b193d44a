"""Provenance: nodes in batches, steps from the inside out."""

from __future__ import annotations

import numpy as np

from gusjob.diagnostics.model import Span
from gusjob.ir.provenance import MAX_REMARKS, Provenance


def test_steps_go_from_the_innermost_iteration_outwards() -> None:
    provenance = Provenance()
    call = provenance.add(7, ("a",), 0, (2.5,), kind="call", count=1)
    loop = provenance.add(3, ("k",), call, (np.array([0.0, 1.0, 2.0]),), kind="round", count=3)
    inner = provenance.add(4, ("round",), np.array([loop, loop + 2]), (np.array([1.0, 9.0]),), kind="nth", count=2)
    assert provenance.steps(0) == []
    assert [(step.line, step.kind, step.values) for step in provenance.steps(inner + 1)] == [
        (4, "nth", {"round": 9.0}),
        (3, "round", {"k": 2.0}),
        (7, "call", {"a": 2.5}),
    ]


def test_remarks_show_the_innermost_steps() -> None:
    provenance = Provenance()
    node = 0
    for depth in range(MAX_REMARKS + 3):
        node = provenance.add(depth + 1, (), node, (), kind="include", count=1)
    remarks = provenance.remarks(node, lambda line, word: Span(line=line))
    assert [remark.span.line for remark in remarks] == [MAX_REMARKS + 3 - i for i in range(MAX_REMARKS)]
