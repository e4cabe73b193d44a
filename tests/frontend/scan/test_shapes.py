"""Line shapes: lines that differ only in digits share one, and what is known about a shape is learned once."""

from __future__ import annotations

import numpy as np
import pytest

from gusjob.frontend.scan import scanner, shape_ids, shapes
from gusjob.frontend.scan.rows import Row, Template, TemplateBuilder
from gusjob.frontend.scan.scanner import scan
from gusjob.frontend.scan.shapes import MAX_LINE, ShapeTable, chunks, shapes_of, strip_comments


def test_shape_of_a_line() -> None:
    assert shapes_of(b"LINE X 12.50 Y -3\nLINE X 1.5 Y -30\nA007\n") == [
        b"LINE X 0.0 Y -0",
        b"LINE X 0.0 Y -0",
        b"A0",
        b"",
    ]


def test_chunks_are_whole_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shapes, "CHUNK", 8)
    assert list(chunks(b"abc\ndef\n\nlonger than a chunk\nx")) == [b"abc\ndef", b"", b"longer than a chunk", b"x"]


def test_comments() -> None:
    assert strip_comments(b"a ; b // c\nd // e\nf") == b"a \nd \nf"
    text = b"a / b"
    assert strip_comments(text) is text


def test_a_table_learns_each_shape_once_from_its_first_line() -> None:
    learned: list[bytes] = []

    def learn(code: bytes) -> int:
        learned.append(code)
        return len(learned)

    table = ShapeTable(learn, {b"known": 0})
    codes = [b"X 10", b"known", b"Y 2", b"X 3", b"Y 44"]
    assert list(table.look_up(shapes_of(b"\n".join(codes)), codes.__getitem__)) == [1, 0, 2, 1, 2]
    assert table.of_line(b"Y 5") == 2
    assert table.of_line(b"Z 5") == 3
    assert learned == [b"X 10", b"Y 2", b"Z 5"]


def by_parser(_: int, text: str) -> list[Row]:
    return [Row(op=9, values={0: float(len(text))})]


def words(line: str) -> Template | None:
    """Every number is a column; those that touch a letter are part of a word."""
    builder = TemplateBuilder.of_line(line)
    assert builder is not None
    for start in sorted(builder.unused):
        if start in builder.unused and not line[start - 1 : start].isalpha():
            builder.add(len(builder.slots), start - (line[start - 1 : start] in ("+", "-")))
    return None if line.startswith("?") else builder.build(len(builder.slots))


def test_rows_of_templates_and_of_the_parser() -> None:
    text = b"A 1 2\n\n? 7\nB 5 ; 6\r\nA 3 40\nm2 8\nm3 9\nA 1 -1e5\n"
    rows = scan(text, semicolon_comments=True, learn=words, parse_line=by_parser)
    assert rows.line.tolist() == [1, 3, 4, 5, 6, 7, 8]
    assert rows.op.tolist() == [2, 9, 1, 2, 1, 9, 2]
    assert rows.column(0)[:4].tolist() == [1, 3, 5, 3]
    assert rows.column(1)[[0, 3, 6]].tolist() == [2, 40, -1e5]
    assert rows.column(0)[4:6].tolist() == [8, 4]
    assert np.isnan(rows.column(5)).all()


def test_digits_of_words_are_compared_as_text() -> None:
    text = b"m2 8\nm02 8\nm2 9\nm1234567890123456 1\nm12 1\n"
    rows = scan(text, semicolon_comments=True, learn=words, parse_line=by_parser)
    assert rows.op.tolist() == [1, 9, 1, 9, 9]


def test_comments_and_blank_lines_have_no_numbers_and_no_rows() -> None:
    text = b"; 1\nA 1;2//3;4\r\n  // 5\n\n//\nA 6 // 7 \xe5\xa4\x96\nA 8;\n;\nA 9"
    rows = scan(text, semicolon_comments=True, learn=words, parse_line=by_parser)
    assert rows.line.tolist() == [2, 6, 7, 9]
    assert rows.column(0).tolist() == [1, 6, 8, 9]
    calls = scan(b"A 1; // 2\nB 3; 4\n", semicolon_comments=False, learn=words, parse_line=by_parser)
    assert calls.column(0).tolist() == [1, 3]
    assert calls.column(1)[1] == 4


def test_shapes_of_one_hash_are_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    text = b"A 1\nB 2 3\nC\nA 4\nB 5 6\nC\n" + b"D" * 200 + b" 7\n" + b"D" * 200 + b" 8\n"
    whole = scan(text, semicolon_comments=True, learn=words, parse_line=by_parser)
    monkeypatch.setattr(shape_ids, "_FACTORS", np.zeros_like(shape_ids._FACTORS))
    again = scan(text, semicolon_comments=True, learn=words, parse_line=by_parser)
    for rows in (whole, again):
        assert rows.op.tolist() == [1, 2, 0, 1, 2, 0, 1, 1]
        assert rows.column(0)[[0, 1, 3, 4, 6, 7]].tolist() == [1, 2, 4, 5, 7, 8]


def test_a_number_above_the_limit_goes_to_the_parser() -> None:
    text = b"A 1\nA 1000000000000000\nA 1000000000000001\nA -1e15\nA -2e15\nA 1e400\n"
    rows = scan(text, semicolon_comments=True, learn=words, parse_line=by_parser)
    assert rows.op.tolist() == [1, 1, 9, 1, 9, 9]


def test_digits_before_an_x_may_begin_a_hexadecimal_number() -> None:
    rows = scan(b"A 1X2\nA 0X2\nA 00x2\nA 10X2\n", semicolon_comments=True, learn=words, parse_line=by_parser)
    assert rows.op.tolist() == [1, 9, 9, 1]
    rows = scan(b"A 1x2\nA 00x2\nA 0.0x2\n", semicolon_comments=True, learn=words, parse_line=by_parser)
    assert rows.op.tolist() == [1, 9, 1]


def test_many_chunks_are_read_by_two_threads_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scanner, "CHUNK", 1000)
    text = b"".join(b"A %d ; %d\n%s" % (i, i, b"? 1\n" * (i % 7 == 0)) for i in range(5000))
    rows = scan(text, semicolon_comments=True, learn=words, parse_line=by_parser)
    assert rows.column(0)[rows.op == 1].tolist() == list(range(5000))
    assert (np.diff(rows.line) == 1).all()


def test_a_line_that_is_too_long_goes_to_the_parser() -> None:
    text = b"A 1\n" + b"A 1".ljust(MAX_LINE + 1) + b"\nA 2"
    rows = scan(text, semicolon_comments=True, learn=words, parse_line=by_parser)
    assert rows.op.tolist() == [1, 9, 1]
    assert rows.column(0).tolist() == [1, MAX_LINE + 1, 2]


def test_chunks_make_no_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    text = b"".join(b"A %d %d ; c\n? %d\nB -%d\n" % (i, i * i, i, i) for i in range(300))
    whole = scan(text, semicolon_comments=True, learn=words, parse_line=by_parser)
    monkeypatch.setattr(scanner, "CHUNK", 50)
    parts = scan(text, semicolon_comments=True, learn=words, parse_line=by_parser)
    for name in ("op", "line", "system"):
        assert np.array_equal(getattr(whole, name), getattr(parts, name)), name
    for column in whole.columns:
        assert np.array_equal(whole.column(column), parts.column(column), equal_nan=True)


def test_a_number_that_all_lines_have_takes_no_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scanner, "_MANY_LINES", 1)
    text = b"".join(b"A 7.5 %d -3\n" % i for i in range(20))
    rows = scan(text, semicolon_comments=True, learn=words, parse_line=by_parser)
    assert [rows.column(c).tolist() for c in range(3)] == [[7.5] * 20, list(range(20)), [-3.0] * 20]
    assert [rows.column(c).strides for c in range(3)] == [(0,), (8,), (0,)]
    # Other lines, and other numbers between equal ones.
    numbers = ["7", "7", "07", "70", "8", "7", "123456789", "7"]
    for other in numbers:
        same = ["A 7", "A 7", f"A {other}", "A 7"]
        for lines in (same, ["? a", *same], [*same, "? b"]):
            rows = scan("\n".join(lines).encode(), semicolon_comments=True, learn=words, parse_line=by_parser)
            assert rows.column(0)[rows.op == 1].tolist() == [7, 7, float(other), 7]
            assert rows.column(0)[rows.op == 9].tolist() == [3.0] * (len(lines) - 4)


def test_a_number_that_all_lines_have_beside_one_above_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scanner, "_MANY_LINES", 1)
    text = b"A 7 1\nA 7 2000000000000001\nA 7 3\n"
    rows = scan(text, semicolon_comments=True, learn=words, parse_line=by_parser)
    assert rows.op.tolist() == [2, 9, 2]
    assert rows.column(0).tolist() == [7, len("A 7 2000000000000001"), 7]
