"""The encoding of columns: they are decoded as they were, within the rounding that a size limit asks for."""

from __future__ import annotations

import numpy as np
import pytest
from support.pages import NAN, Columns, round_trip

from gusjob.view.page.encode import MANTISSA_BITS, UNITS_PER_MM, encode, rounded
from gusjob.view.page.render import MAX_BYTES


def test_columns_come_back() -> None:
    random = np.random.default_rng(1)
    count = 5000
    rows: Columns = {
        "line": random.integers(-(2**31), 2**31 - 1, count, dtype=np.int32), "kind": np.arange(count).astype(np.int8),
        "file": random.integers(-300, 300, count).astype(np.int16), "x_mm": random.normal(0, 100, count),
        "duration_ms": random.random(count), "ch0_power_max": np.where(random.random(count) < 0.2, NAN, 7.3),
        "start_ms": np.arange(count, dtype=np.float64),
    }  # fmt: skip
    found, back = round_trip({"rows": rows})
    assert found.bits == 23 and found.digits == 6
    assert "start_ms" not in back["rows"], "the page adds up the durations"
    for name in ("line", "kind", "file"):
        assert np.array_equal(back["rows"][name], rows[name]) and back["rows"][name].dtype == rows[name].dtype
    for name in ("duration_ms", "ch0_power_max"):
        assert np.array_equal(back["rows"][name], rows[name].astype(np.float32), equal_nan=True)
    assert np.abs(back["rows"]["x_mm"] - rows["x_mm"]).max() <= 0.5 / UNITS_PER_MM + 1e-12


def test_rounding_does_not_add_up_along_a_path() -> None:
    x = np.cumsum(np.full(100_000, 0.01234567))
    _, back = round_trip({"strokes": {"row": np.arange(100_000, dtype=np.int32), "x_mm": x}})
    assert np.abs(back["strokes"]["x_mm"] - x).max() <= 0.5 / UNITS_PER_MM + 1e-9


@pytest.mark.parametrize("bits", MANTISSA_BITS)
def test_mantissa_is_rounded_to_nearest(bits: int) -> None:
    random = np.random.default_rng(2)
    values = random.normal(0, 1, 10_000) * 10.0 ** random.integers(-20, 20, 10_000)
    found = rounded(values, bits).astype(np.float64)
    assert (np.abs(found - values) <= np.abs(values) * 2.0 ** -(bits + 1) * (1 + 1e-6)).all()
    assert np.array_equal(rounded(found, bits), found), "a second rounding changes nothing"
    assert not (rounded(values, bits).view(np.uint32) & ((1 << (23 - bits)) - 1)).any()


def test_rounding_at_the_ends() -> None:
    most = float(np.finfo(np.float32).max)
    for bits in MANTISSA_BITS:
        found = rounded(np.array([0.0, -0.0, NAN, np.inf, most, -most, 1e300, 12.5, -40.0, 1e-45]), bits)
        assert np.isnan(found[[2, 3]]).all()
        assert np.isfinite(np.delete(found, [2, 3])).all()
        assert found[0] == 0 and found[7] == 12.5 and found[8] == -40.0


@pytest.mark.slow
def test_figures_are_rounded_only_as_far_as_needed() -> None:
    random = np.random.default_rng(3)
    tables: dict[str, Columns] = {"rows": {f"c{n}": random.random(200_000) for n in range(8)}}
    sizes = []
    for budget in (10_000_000, 7_000_000, 5_200_000, 3_900_000):
        found, back = round_trip(tables, budget)
        assert found.size <= budget
        sizes.append(found.bits)
        error = np.abs(back["rows"]["c0"] - tables["rows"]["c0"]) / tables["rows"]["c0"]
        assert error.max() <= 2.0 ** -(found.bits + 1) * 1.01
    assert sizes == list(MANTISSA_BITS)
    assert round_trip(tables, 1000)[0].bits == 8, "the least there is, though it does not fit"


def test_equal_columns_are_stored_once() -> None:
    column = np.random.default_rng(4).random(50_000)
    one = encode({"rows": {"a": column}}, MAX_BYTES)
    three = encode({"rows": {"a": column, "b": column.copy()}, "strokes": {"c": column}}, MAX_BYTES)
    assert three.size == one.size and [e["same"] for e in three.directory] == [-1, 0, 0]
    assert encode({"rows": {"a": column, "b": column[::-1]}}, MAX_BYTES).size > 1.9 * one.size


def power_columns(count: int) -> Columns:
    """Columns of which some follow from others; a third of the segments is dark, one takes no time."""
    random = np.random.default_rng(8)
    on = np.arange(count) % 3 > 0
    mean, ms = np.where(on, random.uniform(5, 95, count), NAN), random.uniform(1, 2, count)
    power_ms = np.where(on, mean * ms, 0.0)
    length = random.random(count)
    return {
        "length_mm": length, "duration_ms": ms, "vel_mean_mm_s": length / ms * 1e3, "ch0_power_mean": mean,
        "ch0_emission_ms": np.where(on, ms, 0.0), "ch0_power_ms": power_ms, "ch0_joules": power_ms * 30 / 1e5,
        "ch1_power_mean": mean, "ch1_emission_ms": np.where(on, ms, 0.0), "ch1_power_ms": power_ms * 1.001,
        "ch1_joules": np.where(np.arange(count) < count / 2, NAN, power_ms),
    }  # fmt: skip


def test_columns_that_follow_from_others_are_not_stored() -> None:
    rows = power_columns(3000)
    found, back = round_trip({"rows": rows})
    assert {e["name"] for e in found.directory if e["how"]} == {"vel_mean_mm_s", "ch0_power_ms", "ch0_joules"}
    for name, column in rows.items():
        assert np.allclose(back["rows"][name], column, rtol=5e-7, atol=0, equal_nan=True), name


def test_a_column_that_does_not_fit_is_refused() -> None:
    with pytest.raises(OverflowError):
        encode({"rows": {"line": np.array([2**40])}}, MAX_BYTES)
    with pytest.raises(TypeError):
        encode({"rows": {"line": np.array(["a"])}}, MAX_BYTES)
