"""Columns: values that hold up to the next one, against a loop over the rows; columns with one value."""

from __future__ import annotations

import math
import random

import numpy as np

from gusjob.frontend.resolve.columns import filled
from gusjob.kinematics.arrays import carried, fill_gaps, follow_each_other, joined, picked, unrepeated, with_constant


def test_gaps_have_the_value_before_them() -> None:
    rng = random.Random(1)
    for _ in range(500):
        values = [rng.choice([math.nan, 1.0, 2.0, -3.0]) for _ in range(rng.randrange(9))]
        expected, last = [], 7.0
        for value in values:
            last = last if math.isnan(value) else value
            expected.append(last)
        assert filled(np.array(values), 7.0).tolist() == expected
        column = np.nan_to_num(values)
        fill_gaps(column, np.flatnonzero(np.isnan(values)), 7.0)
        assert column.tolist() == expected


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


def test_a_column_with_one_value_takes_no_memory() -> None:
    same = with_constant(np.full(9, 2.0))
    assert (same.tolist(), same.strides, unrepeated(same).tolist()) == ([2.0] * 9, (0,), [2.0])
    for values in ([], [1.0, 2.0], [1.0, 2.0, 1.0], [math.nan, math.nan], [1.0, math.nan, 1.0]):
        column = np.array(values)
        assert with_constant(column) is column
        assert len(unrepeated(column)) == len(column)


def test_joined_columns_keep_the_one_value_of_all_parts() -> None:
    twos, threes = np.broadcast_to(2.0, 3), np.broadcast_to(3.0, 2)
    assert joined([twos, np.empty(0), twos]).strides == (0,)
    assert joined([twos, np.empty(0), twos]).tolist() == [2.0] * 6
    assert joined([twos, threes]).tolist() == [2.0, 2.0, 2.0, 3.0, 3.0]
    assert joined([np.array([2.0, 2.0]), twos]).tolist() == [2.0] * 5
    assert joined([np.empty(0)]).tolist() == []
