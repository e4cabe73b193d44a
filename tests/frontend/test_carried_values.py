"""Values that hold up to the next one, against a loop over the rows."""

from __future__ import annotations

import math
import random

import numpy as np

from gusjob.frontend.resolve.columns import carried, filled
from gusjob.kinematics.arrays import follow_each_other, picked


def test_gaps_have_the_value_before_them() -> None:
    rng = random.Random(1)
    for _ in range(500):
        values = [rng.choice([math.nan, 1.0, 2.0, -3.0]) for _ in range(rng.randrange(9))]
        expected, last = [], 7.0
        for value in values:
            last = last if math.isnan(value) else value
            expected.append(last)
        assert filled(np.array(values), 7.0).tolist() == expected


def test_values_hold_up_to_the_next_one() -> None:
    rng = random.Random(2)
    for _ in range(500):
        count = rng.randrange(1, 9)
        rows = sorted(rng.sample(range(count), rng.randrange(count + 1)))
        values = [float(rng.randrange(100)) for _ in rows]
        expected, last = [], -1.0
        for row in range(count):
            last = values[rows.index(row)] if row in rows else last
            expected.append(last)
        assert carried(np.array(values), np.array(rows, dtype=np.intp), count, -1.0).tolist() == expected


def test_rows_of_a_slice() -> None:
    assert follow_each_other(np.array([3, 4, 5]))
    assert not any(follow_each_other(np.array(rows, dtype=np.intp)) for rows in ([], [3, 5], [1, 3, 2, 4], [2, 2, 4]))
    same = picked(np.broadcast_to(2.0, 9), np.array([1, 5]))
    assert same.tolist() == [2, 2]
    assert same.strides == (0,)
