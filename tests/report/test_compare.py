"""`report --against`: what moved is named, what did not is not, and any file at all is read without a traceback."""

from __future__ import annotations

import json
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result
from hypothesis import given
from hypothesis import strategies as st
from support.tools import MARK, run_job

from gusjob.cli import cli
from gusjob.report import compare_text
from gusjob.report.compare import Comparison, SegmentComparison, compare
from gusjob.report.earlier import EarlierReport, flat_totals, read_earlier
from gusjob.report.rows import Report
from gusjob.simulate.kinds import SegmentKind

TEXT = MARK + "LASER POWER 50\nJUMP X 5\nLASER ON\nLINE X 10\nLINE Y 10\nLASER POWER 20\nLINE X 0\nLASER OFF\n"
"""Segments in lines 5 (jump), 7, 8 (50 %) and 10 (20 %)."""


def gusjob(*args: object) -> Result:
    return CliRunner().invoke(cli, [str(a) for a in args], catch_exceptions=False)


def entry(**changes: Any) -> dict[str, Any]:
    """Totals of channel 0."""
    return {
        "channel": 0,
        "unit": "%",
        "emission_ms": 30.0,
        "power_ms": 900.0,
        "power_max": 30.0,
        "joules": None,
        **changes,
    }


def earlier_of(*channels: dict[str, Any], **columns: list[Any]) -> dict[str, Any]:
    """A report by hand: three segments in lines 4, 5, 6, marked with 30 % for 10 ms each; changed as told."""
    segments = {
        "line": [4, 5, 6], "kind": ["mark"] * 3, "x_mm": [1.0, 2.0, 3.0], "y_mm": [0.0, 0.0, 0.0],
        "duration_ms": [10.0] * 3, "ch0_emission_ms": [10.0] * 3, "ch0_power_min": [30.0] * 3,
        "ch0_power_mean": [30.0] * 3, "ch0_power_max": [30.0] * 3, "ch0_power_ms": [300.0] * 3,
        "ch0_joules": [None] * 3,
        **columns,
    }  # fmt: skip
    return {
        "schema": "gusjob-report/1", "job": "a.job", "period_us": 250.0,
        "totals": {
            "segments": 3, "duration_ms": 30.0, "mark_mm": 3.0, "jump_mm": 0.0, "channels": [*channels] or [entry()],
        },
        "segments": segments,
    }  # fmt: skip


def report_of(found: dict[str, Any]) -> Report:
    """The same as the program's own report."""
    numbers = {kind.word: int(kind) for kind in SegmentKind}
    columns = {n: np.array(c, dtype=np.float64) for n, c in found["segments"].items() if n != "kind"}
    columns |= {
        "line": np.array(found["segments"]["line"]),
        "kind": np.array([numbers[k] for k in found["segments"]["kind"]]),
    }
    return Report(job="b.job", period_us=found["period_us"], totals=found["totals"], columns=columns, notes={})


def read(tmp_path: Path, found: Any) -> tuple[EarlierReport | None, str]:
    path = tmp_path / "old.json"
    path.write_bytes(found if isinstance(found, bytes) else json.dumps(found).encode())
    return read_earlier(path)


@pytest.fixture
def against(tmp_path: Path) -> Any:
    """Compares two reports by hand, old first."""

    def compared(old: dict[str, Any], new: dict[str, Any], tolerance_pct: float = 1.0) -> Comparison:
        earlier, reason = read(tmp_path, old)
        assert earlier is not None, reason
        return compare(report_of(new), earlier, tolerance_pct)

    return compared


def rows_of(comparison: Comparison) -> SegmentComparison:
    assert comparison.segments is not None
    return comparison.segments


def pairs(comparison: Comparison) -> list[tuple[int, int]]:
    rows = rows_of(comparison)
    return [*zip(rows.old_row.tolist(), rows.new_row.tolist(), strict=True)]


def changed_rows(comparison: Comparison) -> dict[str, list[int]]:
    """Rows of this report where each figure moved."""
    rows = rows_of(comparison)
    return {name: rows.new_row[what.pair].tolist() for name, what in rows.changes.items()}


# Whole jobs.


def lines_named(tmp_path: Path, old: str, new: str, *options: str) -> tuple[int, dict[str, list[int]]]:
    """Exit status, and the lines in which each figure moved."""
    before, now, out = tmp_path / "old.job", tmp_path / "new.job", tmp_path / "old.json"
    before.write_text(old, encoding="utf-8")
    now.write_text(new, encoding="utf-8")
    assert gusjob("report", before, "--format", "json", "-o", out).exit_code == 0
    result = gusjob("report", now, "--against", out, "--format", "json", *options)
    found = json.loads(result.stdout)["against"]
    assert found["same"] == (result.exit_code == 0)
    return result.exit_code, {name: what["line"] for name, what in found["segments"]["moved"].items()}


def test_a_power_that_moves_by_two_percent_names_its_segments(tmp_path: Path) -> None:
    status, named = lines_named(tmp_path, TEXT, TEXT.replace("POWER 50", "POWER 51"))
    assert status == 1
    # From 50 to 51 is 1 in 51, 1.96 %; times do not move.
    assert named == {f"ch0_{n}": [7, 8] for n in ("power_min", "power_mean", "power_max", "power_ms")}
    assert lines_named(tmp_path, TEXT, TEXT.replace("POWER 50", "POWER 51"), "--tolerance", "2%") == (0, {})
    assert lines_named(tmp_path, TEXT, TEXT.replace("POWER 50", "POWER 50.01")) == (0, {})
    assert lines_named(tmp_path, TEXT, TEXT.replace("POWER 50", "POWER 50.01"), "--tolerance", "0")[0] == 1


def test_the_same_job_is_the_same_at_0(tmp_path: Path) -> None:
    assert lines_named(tmp_path, TEXT, TEXT, "--tolerance", "0") == (0, {})


def test_a_comment_on_top_moves_nothing(tmp_path: Path) -> None:
    assert lines_named(tmp_path, TEXT, "; a comment\n" + TEXT, "--tolerance", "0") == (0, {})
    middle = TEXT.replace("LINE Y 10", "; here too\nLINE Y 10")
    assert lines_named(tmp_path, TEXT, "; a comment\n" + middle, "--tolerance", "0") == (0, {})


def test_the_table_says_what_how_far_and_how_much(tmp_path: Path) -> None:
    job, out = tmp_path / "x.job", tmp_path / "old.json"
    job.write_text(TEXT, encoding="utf-8")
    gusjob("report", job, "--format", "json", "-o", out)
    same = gusjob("report", job, "--against", out)
    assert (same.exit_code, same.stdout.splitlines()[0]) == (0, f"SAME within 1 % (against {out})")
    job.write_text(TEXT.replace("POWER 20", "POWER 25"), encoding="utf-8")
    result = gusjob("report", job, "--against", out)
    assert result.exit_code == 1
    lines = result.stdout.splitlines()
    assert lines[0] == f"CHANGED by more than 1 %: 1 total, 1 segment; 0 new, 0 removed (against {out})"
    table = [line.split() for line in lines]
    head = table.index(["segment", "line", "kind", "ch0_power", "ch0_power_ms"])
    assert table[head + 1][:8] == ["4", "10", "mark", "20", "->", "25", "+20", "%"]
    assert lines[head + 3 : head + 5] == [str(job), next(line for line in lines if line.startswith("OK, "))]
    only = gusjob("report", job, "--against", out, "--only-changes")
    assert (only.exit_code, only.stdout.splitlines()) == (1, lines[: head + 2])
    listed = gusjob("report", job, "--against", out, "--format", "csv")
    assert listed.exit_code == 1
    assert "against" not in listed.stdout
    assert "20 -> 25 +20 %" in listed.stderr


def test_errors_of_the_job_keep_their_meaning(tmp_path: Path) -> None:
    job, out = tmp_path / "x.job", tmp_path / "old.json"
    job.write_text(TEXT, encoding="utf-8")
    gusjob("report", job, "--format", "json", "-o", out)
    job.write_text("QQ\n", encoding="utf-8")
    result = gusjob("report", job, "--against", out)
    assert (result.exit_code, result.stdout) == (1, "")
    assert "GJ102" in result.stderr
    assert gusjob("report", tmp_path / "none.job", "--against", out).exit_code == 2


# Two reports by hand.


def test_the_larger_magnitude_counts(against: Any) -> None:
    old = earlier_of(duration_ms=[100.0, 100.0, 99.0])
    assert changed_rows(against(old, earlier_of(duration_ms=[101.0, 101.02, 100.0]))) == {"duration_ms": [1]}
    there = against(old, earlier_of(duration_ms=[101.0, 200.0, 100.0]))
    assert rows_of(there).changes["duration_ms"].change_pct.tolist() == [50.0]


def test_rounding_and_tiny_changes_are_ignored(against: Any) -> None:
    old = earlier_of(duration_ms=[10.0, 0.0, 10.0], ch0_joules=[1.0, 0.0, 1e-7])
    new = earlier_of(duration_ms=[10.0 * (1 + 5e-10), 5e-7, 10.0 + 1e-5], ch0_joules=[1.0, 5e-10, 3e-7])
    assert changed_rows(against(old, new, 0.0)) == {"duration_ms": [2], "ch0_joules": [2]}


def test_null_against_a_number(against: Any) -> None:
    old = earlier_of(ch0_power_mean=[None, None, 30.0])
    new = earlier_of(ch0_power_mean=[None, 30.0, None])
    there = against(old, new)
    assert changed_rows(there) == {"ch0_power_mean": [1, 2]}
    assert np.isnan(rows_of(there).changes["ch0_power_mean"].change_pct).all()


def test_a_changed_kind(against: Any) -> None:
    there = against(earlier_of(), earlier_of(kind=["mark", "jump", "mark"]))
    assert changed_rows(there) == {"kind": [1]}
    assert [row[2] for row in compare_text.segment_rows(rows_of(there))] == ["kind", "mark -> jump"]


def test_kth_of_a_line_with_kth_of_the_line(against: Any) -> None:
    old = earlier_of(line=[4, 5, 4], duration_ms=[1.0, 2.0, 3.0])
    there = against(old, earlier_of(line=[4, 4, 5], duration_ms=[1.0, 3.0, 2.0]))
    assert pairs(there) == [(0, 0), (2, 1), (1, 2)]
    assert changed_rows(there) == {}
    assert pairs(against(old, earlier_of(line=[5, 4, 4], duration_ms=[2.0, 1.0, 3.0]))) == [(1, 0), (0, 1), (2, 2)]


def test_new_and_removed_segments(against: Any) -> None:
    there = against(earlier_of(line=[4, 5, 6]), earlier_of(line=[4, 6, 7], x_mm=[1.0, 3.0, 4.0]))
    rows = rows_of(there)
    assert (pairs(there), rows.vanished.tolist(), rows.appeared.tolist()) == ([(0, 0), (2, 1)], [1], [2])
    assert not rows.shifted
    assert not there.same
    assert [row[:3] for row in compare_text.segment_rows(rows)][1:] == [
        ["3", "7", "new mark"],
        ["-", "5", "removed mark"],
    ]


def longer(lines: list[int], places: list[float]) -> dict[str, Any]:
    """A report of marks that end at these places, in these lines; each takes as long as its place says."""
    same = earlier_of()["segments"]
    columns = {name: [same[name][0]] * len(lines) for name in same}
    return earlier_of(**{**columns, "line": lines, "x_mm": places, "duration_ms": places})


@pytest.mark.parametrize(
    ("lines", "places", "appeared", "vanished"),
    [
        ([5, 6, 7, 8], [1, 2, 3, 4], [], []),  # A comment on top.
        ([4, 6, 9, 12], [1, 2, 3, 4], [], []),  # Comments here and there.
        ([4, 5, 6, 7, 8], [1, 2, 9, 3, 4], [2], []),  # A segment between.
        ([4, 5, 6, 7, 8, 9], [9, 1, 2, 8, 3, 4], [0, 3], []),  # One on top, one between.
        ([4, 5, 6, 7, 8, 9, 10], [1, 9, 2, 8, 8, 3, 4], [1, 3, 4], []),  # Three between.
        ([4, 5, 6], [1, 3, 4], [], [1]),  # One less.
        ([4, 6, 7], [1, 3, 4], [], [1]),  # One less, and its line is empty.
    ],
)
def test_lines_that_shift(
    against: Any, lines: list[int], places: list[float], appeared: list[int], vanished: list[int]
) -> None:
    there = against(longer([4, 5, 6, 7], [1, 2, 3, 4]), longer(lines, places))
    assert (rows_of(there).appeared.tolist(), rows_of(there).vanished.tolist()) == (appeared, vanished)
    assert changed_rows(there) == {}


def test_one_of_many_passes_left_out(against: Any) -> None:
    """Three passes over one outline; the second became comments: lines tell which it was."""
    old = longer([10, 11, 20, 21, 30, 31], [1, 2] * 3)
    there = against(old, longer([10, 11, 30, 31], [1, 2] * 2))
    assert rows_of(there).vanished.tolist() == [2, 3]


def test_an_edited_place_behind_a_comment(against: Any) -> None:
    there = against(longer([4, 5, 6, 7], [1, 2, 3, 4]), longer([5, 6, 7, 8], [1, 2, 7, 4]))
    assert pairs(there) == [(0, 0), (1, 1), (2, 2), (3, 3)]
    assert changed_rows(there) == {"duration_ms": [2]}


def test_an_edited_place_behind_a_new_segment(against: Any) -> None:
    there = against(longer([4, 5, 6, 7], [1, 2, 3, 4]), longer([4, 5, 6, 7, 8], [9, 1, 2, 7, 4]))
    assert pairs(there) == [(0, 1), (1, 2), (2, 3), (3, 4)]
    assert changed_rows(there) == {"duration_ms": [3]}


@pytest.mark.parametrize("places", [[1, 6, 2, 3, 9, 4, 5, 7], [1, 3, 4, 5, 6, 2, 9, 7]])
def test_one_segment_that_changed_its_place_in_the_row(against: Any, places: list[float]) -> None:
    there = against(longer([*range(4, 11)], [*range(1, 8)]), longer([*range(4, 12)], places))
    kept = pairs(there)
    assert len(kept) == 6
    assert all(places[now] == before + 1 for before, now in kept)


def test_a_scaled_job_goes_by_its_lines(against: Any) -> None:
    there = against(longer([4, 5, 6, 7], [1, 2, 3, 4]), longer([4, 5, 7, 8], [2, 4, 6, 8]))
    # Two segments end where others did: that is chance, since fewer would match.
    assert pairs(there) == [(0, 0), (1, 1), (2, 2), (3, 3)]


def test_a_changed_unit_leaves_powers_alone(against: Any) -> None:
    now = earlier_of(
        entry(unit="kHz", power_ms=9.0, emission_ms=60.0), ch0_power_mean=[1.0] * 3, ch0_emission_ms=[20.0] * 3
    )
    there = against(earlier_of(), now)
    assert changed_rows(there) == {"ch0_emission_ms": [0, 1, 2]}
    assert [(t.what, t.channel, t.old, t.new) for t in there.totals] == [
        ("unit", 0, "%", "kHz"),
        ("emission_ms", 0, 30, 60),
    ]
    assert "the unit of channel 0 changed: its powers are not compared" in compare_text.outcome_lines(there)


def test_a_channel_that_is_new(against: Any) -> None:
    lit = {f"ch1_{n}": [None, 5.0, 0.0] for n in ("power_min", "power_mean", "power_max")}
    lit |= {f"ch1_{n}": [0.0, 5.0, 0.0] for n in ("emission_ms", "power_ms", "joules")}
    there = against(earlier_of(), earlier_of(entry(), entry(channel=1, unit="V"), **lit))
    assert next((t.what, t.old, t.new) for t in there.totals) == ("unit", None, "V")
    assert changed_rows(there) == {"ch1_emission_ms": [1], "ch1_joules": [1]}


def test_a_channel_without_output_that_one_report_lacks(against: Any) -> None:
    """A journal has channel 1, too: the run switches it off."""
    one = earlier_of(entry())
    dark = {"channel": 1, "emission_ms": 0.0, "power_ms": 0.0, "power_max": None}
    for new, old in ((one, earlier_of(entry(), entry(**dark))), (earlier_of(entry(), entry(**dark)), one)):
        assert against(old, new).same
    for output in ({"emission_ms": 1.0}, {"lit_at_end": True}, {"off_output": {"standby_pct": 2.0}}):
        assert not against(one, earlier_of(entry(), entry(**{**dark, **output}))).same


def test_totals_move(against: Any) -> None:
    now = earlier_of(entry(power_max=31.0, power_ms=905.0, joules=3.0))
    now["period_us"], now["totals"]["segments"], now["totals"]["mark_mm"] = 125.0, 1001, 3.02
    old = earlier_of()
    old["totals"]["segments"] = 1000
    assert {(t.what, t.old, t.new) for t in against(old, now).totals} == {
        ("period_us", 250, 125), ("segments", 1000, 1001), ("power_max", 30, 31), ("joules", None, 3),
    }  # fmt: skip


def test_what_the_laser_gets_while_off(against: Any) -> None:
    old = earlier_of(entry(off_output={"standby_khz": 5.0, "standby_pct": 2.0}, lit_at_end=False))
    new = earlier_of(entry(off_output={"standby_khz": 5.0, "standby_pct": 3.0}, lit_at_end=True))
    assert {t.what for t in against(old, new).totals} == {"standby_pct", "lit_at_end"}
    assert {t.what for t in against(old, earlier_of(entry(off_output=None))).totals} == {"standby_pct", "standby_khz"}
    assert against(old, earlier_of(entry())).same  # An old version did not say.


def test_a_summary_is_compared_by_totals(tmp_path: Path) -> None:
    job, out = tmp_path / "x.job", tmp_path / "old.json"
    job.write_text(TEXT, encoding="utf-8")
    gusjob("report", job, "--format", "json", "--summary", "-o", out)
    result = gusjob("report", job, "--against", out)
    assert (result.exit_code, "segments are not compared" in result.stdout) == (0, True)
    job.write_text(TEXT.replace("POWER 50", "POWER 51"), encoding="utf-8")
    result = gusjob("report", job, "--against", out, "--format", "json")
    found = json.loads(result.stdout)["against"]
    assert (result.exit_code, found["segments"]) == (1, None)
    assert {t["what"]: (t["old"], t["new"]) for t in found["totals"]}["power_max"] == (50, 51)


def test_rows_left_out_are_counted(against: Any) -> None:
    count = 100
    lines = [*range(1, count + 1)]
    old, new = longer(lines, lines), longer([*lines, 500, 501], [*lines, 1, 2])
    new["segments"]["ch0_power_max"] = [40.0] * (count + 2)
    rows = rows_of(against(old, new))
    _, *shown = compare_text.segment_rows(rows, 40)
    assert len(shown) == 41
    assert shown[-1][2] == "62 more"
    _, *shown = compare_text.segment_rows(rows, 102)
    assert [row[2] for row in shown[-2:]] == ["new mark", "new mark"]
    assert len(shown) == 102


def test_new_and_removed_rows_share_the_limit(against: Any) -> None:
    """Line 1 stays; 30 marks in line 3 are new, 50 in line 2 are gone."""
    old, new = longer([1, *[2] * 50], [*range(1, 52)]), longer([1, *[3] * 30, 4], [1, *range(100, 131)])
    rows = rows_of(against(old, new))
    assert (len(rows.appeared), len(rows.vanished)) == (31, 50)
    _, *shown = compare_text.segment_rows(rows, 40)
    assert [row[2] for row in shown] == ["new mark"] * 31 + ["removed mark"] * 9 + ["41 more"]


# Whatever the file holds.

DEEP = b"[" * 10_000 + b"]" * 10_000


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (b"", "not JSON"),
        (b"\x00\xff\x00", "not JSON"),
        (b"\xff\xfe{\x00", "UTF-16"),
        (b"{", "not JSON"),
        (b'{"schema": NaN}', "not JSON"),
        (b"1" + b"0" * 400, "not JSON"),
        (DEEP, "not JSON"),
        (b'{"schema": "gusjob-report/1", "totals": ' + DEEP + b"}", "not JSON"),
        (b"[]", "not a JSON report"),
        ({}, "not a JSON report"),
        ({"schema": "gusjob-check/1", "diagnostics": []}, "not a JSON report"),
        ({**earlier_of(), "job": 3}, "job is not a JSON string"),
        ({**earlier_of(), "period_us": None}, "period_us is not a number"),
        ({**earlier_of(), "totals": []}, "totals is not a JSON object"),
        ({**earlier_of(), "totals": {"segments": 1}}, "duration_ms is missing"),
        ({**earlier_of(), "segments": None}, "segments is not a JSON object"),
        ({**earlier_of(), "segments": {}}, "is missing"),
        (earlier_of([]), "not a JSON object"),  # type: ignore[arg-type]  # wrong on purpose
        (earlier_of(entry(channel=7)), "unknown channel or unit"),
        (earlier_of(entry(channel=True)), "channel is not a JSON whole number"),
        (earlier_of(entry(unit="|<b>")), "unknown channel or unit"),
        (earlier_of(entry(power_ms="3")), "power_ms is not a number"),
        (earlier_of(entry(off_output=[1])), "off_output is not a JSON object"),
        (earlier_of(entry(off_output={"standby_khz": []})), "standby_khz is not a number"),
        (earlier_of(line=[1, 2]), "differ in length"),
        (earlier_of(line=[1, 2, 2.5]), "line number"),
        (earlier_of(line=[1, 2, -3]), "line number"),
        (earlier_of(line=[1, 2, 1e300]), "line number"),
        (earlier_of(line=[1, 2, None]), "line number"),
        (earlier_of(kind=["mark", "mark", "shine"]), "kind contains a value"),
        (earlier_of(kind=["mark", "mark", []]), "kind contains a value"),
        (earlier_of(x_mm=[1, 2, "3"]), "x_mm contains a value that is not a number"),
        (earlier_of(x_mm=[1, 2, True]), "x_mm contains a value that is not a number"),
        (earlier_of(ch0_joules=[[], [], []]), "ch0_joules contains a value that is not a number"),
        (earlier_of(ch0_joules=3), "ch0_joules is not a JSON array"),  # type: ignore[arg-type]  # wrong on purpose
        (earlier_of(ch1_joules=[1, 2, 3]), "ch1_emission_ms is missing"),
    ],
)  # fmt: skip
def test_files_that_are_no_reports(tmp_path: Path, found: Any, said: str) -> None:
    earlier, reason = read(tmp_path, found)
    assert earlier is None
    assert said in reason
    job = tmp_path / "x.job"
    job.write_text(TEXT, encoding="utf-8")
    result = gusjob("report", job, "--against", tmp_path / "old.json")
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr == f"gusjob: {tmp_path / 'old.json'}: {reason}\n"


def test_files_that_can_not_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    job = tmp_path / "x.job"
    job.write_text(TEXT, encoding="utf-8")
    for path in (tmp_path, tmp_path / "none.json", tmp_path / ("x" * 5000)):
        result = gusjob("report", job, "--against", path)
        assert result.exit_code == 2
        assert "can't read" in result.stderr
    assert read_earlier(Path("a\0b"))[0] is None
    monkeypatch.setattr("gusjob.report.earlier.MAX_EARLIER_MB", 0)
    assert "too large" in read(tmp_path, earlier_of())[1]


def test_what_a_hostile_name_holds_is_not_sent_to_the_terminal(tmp_path: Path) -> None:
    found = earlier_of()
    found["job"] = "\x1b[31m"
    earlier, _ = read(tmp_path, found)
    assert earlier is not None
    assert "\x1b" not in earlier.job
    result = gusjob("report", tmp_path / "x.job", "--against", tmp_path / "\x1b]0;owned\x07.json")
    assert "\x1b" not in result.output


def test_a_byte_order_mark(tmp_path: Path) -> None:
    assert read(tmp_path, b"\xef\xbb\xbf" + json.dumps(earlier_of()).encode())[1] == ""


def test_huge_figures(against: Any) -> None:
    old = earlier_of(x_mm=[1e308, -1e308, 3.0], duration_ms=[1e308, -1e308, 1e-308], line=[2**52, 5, 6])
    assert 0 in changed_rows(against(old, earlier_of(line=[2**52, 5, 6])))["duration_ms"]
    assert changed_rows(against(earlier_of(duration_ms=[1e308] * 3), earlier_of(duration_ms=[-1e308] * 3)))[
        "duration_ms"
    ] == [
        0,
        1,
        2,
    ]


def test_empty_reports(against: Any) -> None:
    nothing = earlier_of(**{name: [] for name in earlier_of()["segments"]})
    assert against(nothing, nothing).same
    assert rows_of(against(nothing, earlier_of())).appeared.tolist() == [0, 1, 2]
    assert rows_of(against(earlier_of(), nothing)).vanished.tolist() == [0, 1, 2]


JUNK = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-5, 2**64 - 1)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=6,
)
COLUMN = st.lists(st.none() | st.floats(allow_nan=False, allow_infinity=False) | st.integers(0, 9), max_size=5) | JUNK


@given(st.fixed_dictionaries({}, optional=dict.fromkeys(earlier_of()["segments"], COLUMN)), JUNK)
def test_junk_is_refused_or_compared(
    tmp_path_factory: pytest.TempPathFactory, columns: dict[str, Any], channel: Any
) -> None:
    folder = tmp_path_factory.mktemp("junk")
    for found in (earlier_of(**columns), {**earlier_of(), **columns}, earlier_of(channel)):
        earlier, reason = read(folder, found)
        assert (earlier is None) == bool(reason)
        if earlier is not None:
            there = compare(report_of(earlier_of()), earlier, 0.0)
            assert compare_text.comparison_text(there)


LINES = st.lists(st.tuples(st.integers(1, 6), st.integers(0, 3)), max_size=8)


@given(LINES, LINES)
def test_every_segment_is_matched_new_or_removed(
    tmp_path_factory: pytest.TempPathFactory, old: list[tuple[int, int]], new: list[tuple[int, int]]
) -> None:
    before, now = (longer([line for line, _ in rows], [float(x) for _, x in rows]) for rows in (old, new))
    earlier, reason = read(tmp_path_factory.mktemp("rows"), before)
    assert earlier is not None, reason
    rows = rows_of(compare(report_of(now), earlier, 0.0))
    assert sorted([*rows.old_row, *rows.vanished]) == [*range(len(old))]
    assert sorted([*rows.new_row, *rows.appeared]) == [*range(len(new))]


# Options.


@pytest.mark.parametrize("text", ["1e1", "1e1%", "-1%", "nan%", "101%", "%", "", "1%%", "٣%"])
def test_what_is_no_tolerance(tmp_path: Path, text: str) -> None:
    result = gusjob("report", tmp_path / "x.job", "--against", tmp_path / "old.json", "--tolerance", text)
    assert result.exit_code == 2
    assert "is not a percentage" in result.output


@pytest.mark.parametrize(("text", "exit_code"), [("5", 1), ("5%", 1), ("20", 0), ("20.0 %", 0), ("19.9", 1)])
def test_a_tolerance_is_a_percentage(tmp_path: Path, text: str, exit_code: int) -> None:
    """From 20 % to 25 % of power is 20 % of the larger value."""
    job, out = tmp_path / "x.job", tmp_path / "old.json"
    job.write_text(TEXT, encoding="utf-8")
    gusjob("report", job, "--format", "json", "-o", out)
    job.write_text(TEXT.replace("POWER 20", "POWER 25"), encoding="utf-8")
    assert gusjob("report", job, "--against", out, "--tolerance", text).exit_code == exit_code


@pytest.mark.parametrize("form", ["json", "csv", "html", "parquet"])
def test_only_changes_is_for_people(tmp_path: Path, form: str) -> None:
    result = gusjob("report", tmp_path / "x.job", "--against", tmp_path / "o.json", "--only-changes", "--format", form)
    assert (result.exit_code, "--only-changes needs --format text or markdown" in result.output) == (2, True)
    result = gusjob("report", tmp_path / "x.job", "--only-changes")
    assert (result.exit_code, "--only-changes needs --against" in result.output) == (2, True)


def test_a_tolerance_without_an_earlier_report(tmp_path: Path) -> None:
    result = gusjob("report", tmp_path / "x.job", "--tolerance", "1%")
    assert result.exit_code == 2
    assert "--tolerance needs --against" in result.output


def test_a_million_segments() -> None:
    """Two lines put into a long job: found, and soon. The bound is wide; a loop over rows is beyond it."""
    count = 1_000_000
    text = run_job(TEXT).report
    base = {name: np.resize(column, count) for name, column in text.columns.items()}
    base |= {"line": np.arange(1, count + 1), "x_mm": np.sin(np.arange(count)), "y_mm": np.cos(np.arange(count) / 3)}
    two = [count // 4, count // 2]
    new = {name: np.insert(column, two, column[0]) for name, column in base.items()}
    new |= {"line": np.arange(1, count + 3), "x_mm": np.insert(base["x_mm"], two, 9.0)}
    totals = dict.fromkeys(flat_totals(text.totals), 0.0)
    began = process_time()
    there = compare(
        Report(job="", period_us=250, totals=text.totals, columns=new, notes={}),
        EarlierReport(path="", job="", totals=totals, columns=base),
        1.0,
    )
    assert process_time() - began < 20
    assert rows_of(there).appeared.tolist() == [count // 4, count // 2 + 1]
    assert rows_of(there).vanished.tolist() == []
    assert changed_rows(there) == {}
