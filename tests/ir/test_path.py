"""The path as columns: rows replaced by chords."""

from __future__ import annotations

import numpy as np
import pytest
from support.tools import MARK, job_of

from gusjob.ir.path import Op, with_chords


def test_chords_end_where_their_row_did_and_bear_its_end_velocity_there_alone() -> None:
    path = job_of(MARK + "LINE X 1\nARC CCW X 2 Y 1 I 0 J 1 END 5\nLINE X 3\n").path
    rows, counts = np.array([1]), np.array([3])
    longer, origin = with_chords(path, rows, counts, np.array([1200.0, 1600.0, 0.0]), np.array([10.0, 300.0, 0.0]))
    assert origin.tolist() == [0, 1, 1, 1, 2]
    assert longer.op.tolist() == [Op.LINE] * 5
    assert longer.x.tolist() == pytest.approx([1000, 1200, 1600, 2000, 3000])
    assert longer.y.tolist() == pytest.approx([0, 10, 300, 1000, 1000])
    assert np.isnan(longer.end).tolist() == [True, True, True, False, True]
