"""Diagnostics of a profile point at the entry that is wrong: each case marks it with << and >>."""

from __future__ import annotations

import re

import pytest

from gusjob.config.profile import parse_profile

CASES = {
    "the second of two tables": '[[check.path]]\nglob = "a"\n[[check.path]]\nglob = <<"">>\n',
    "an inline table": "budget = { duration_s = 1, power_pct = <<-1>> }\n",
    "a dotted key": "controller.abi = 'gus'\ncontroller.card = <<99>>\n",
    "a dotted key with blanks and quotes": 'controller . "card" = <<99>>\n',
    "the second laser": "[[laser]]\nchannel = 0\nrated_w = 30\n[[laser]]\nchannel = 1\nrated_w = <<-3>>\n",
    "a laser in an inline array": "laser = [{channel = 0}, {channel = 1, rated_w = <<0>>}]\n",
    "a quoted key": '"period_us" = <<0>>\n',
    "a key with an escape": '"period\\u005fus" = <<0>>\n',
    "an unknown quoted key": '<<"period us">> = 0\n',
    "a value in an array": 'field_x_mm = [-10, <<"10">>]\n',
    "a value in an array over several lines": "field_y_mm = [\n  -1, # from\n  <<1e9>>, # to\n]\n",
    "a code in a list": '[check]\nignore = ["GJ4", <<"GJX">>, "GJ5"]\n',
    "a code in a list of another table": '[check]\nignore = ["GJ4"]\n[[check.path]]\nglob = "*"\nignore = [<<4>>]\n',
    "a severity": '[check.severity]\nGJ304 = "warning"\nGJ404 = <<"fatal">>\n',
    "a code with a severity": '[check]\nseverity = { <<GJX>> = "note" }\n',
    "a list that is too long": "field_y_mm = <<[1, 2, 3]>>\n",
    "a table that is none": "period_us = 100\nlookahead = <<1>>\n",
    "a nested table that is none": "[controller]\ninterlock = <<3>>\n",
    "a nested table": "[controller]\ncard = 1\n[controller.interlock]\ninput = <<32>>\n",
    "a channel by default that is taken": "[[laser]]\nchannel = 0\n[[<<laser>>]]\nrated_w = 3\n",
    "two channels by default": "laser = [{}, <<{rated_w = 3}>>]\n",
    "an unknown entry": "[controller]\n<<crad>> = 1\n",
    "an unknown table": "[<<controler>>]\ncard = 1\n",
    "the same name in a comment, a text and another table": (
        '# period_us = 0\nname = "period_us = 0"\n[expansion]\nmax_depth = 9\n[lookahead]\ntime_ms = <<-1>>\n'
    ),
    "a text over several lines": 'name = """\nperiod_us = 1\n"""\nperiod_us = <<0>>\n',
    "two values on lines with CRLF": "period_us = <<0>>\r\nchord_tolerance_um = <<0>>\r\n",
    "a channel that is taken": "[[laser]]\nchannel = 1\n[[laser]]\nchannel = <<1>> # again\n",
    "a velocity that is too fast in pulses": "pulses_per_mm = 1e3\nmax_velocity_mm_s = <<1e8>>\n",
    "pulses that are too fine": "pulses_per_mm = <<4000>>\n",
    "a quoted key is no dotted key": '<<"expansion.max_depth">> = 3\n',
    "an integer that Python does not convert": f"[controller]\ncard = <<{'9' * 5000}>>\n",
    "such an integer in an array": f"field_x_mm = [1,\n <<-{'1_0' * 3000}>>]\n",
    "wide characters": 'name = "激光"\n<<"名">> = 3\n',
}

Position = tuple[int, int, int, int]


def marked(case: str) -> tuple[str, list[Position]]:
    """A text without its marks, and the positions that were marked."""
    text, starts, positions = "", list[tuple[int, int]](), list[Position]()
    for part in re.split("(<<|>>)", case):
        here = (text.count("\n") + 1, len(text) - text.rfind("\n"))
        match part:
            case "<<":
                starts.append(here)
            case ">>":
                positions.append((*starts[-1], *here))
            case _:
                text += part
    return text, positions


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_a_diagnostic_points_at_its_entry(case: str) -> None:
    text, positions = marked(case)
    spans = [d.span for d in parse_profile(text).diagnostics]
    assert [(s.line, s.column, s.end_line, s.end_column) for s in spans] == positions


@pytest.mark.parametrize(
    ("text", "line", "column"),
    [
        ("period_us = = 3\n", 1, 13),
        ("name = 'a'\nperiod_us 3\n", 2, 11),
        ("period_us = [\n1,\n", 3, 1),  # "at end of document"
        ("[laser]\nchannel = 0\n[laser]\n", 3, 7),
    ],
)
def test_what_is_not_toml_is_reported_at_its_position(text: str, line: int, column: int) -> None:
    (diagnostic,) = parse_profile(text).diagnostics
    assert diagnostic.rule.code == "GJ601"
    assert (diagnostic.span.line, diagnostic.span.column) == (line, column)


def test_nesting_that_is_too_deep_is_reported() -> None:
    (diagnostic,) = parse_profile("a = " + "[" * 100_000).diagnostics
    assert diagnostic.rule.code == "GJ601"


def test_a_second_table_has_a_diagnostic_of_its_own() -> None:
    """Two [[check.path]] with a bad glob each: two diagnostics, each in its table."""
    text, positions = marked('[[check.path]]\nglob = <<"">>\n[[check.path]]\nglob = <<3>>\n')
    found = parse_profile(text).diagnostics
    assert [(d.span.line, d.span.column, d.span.end_line, d.span.end_column) for d in found] == positions
    assert [d.message for d in found] == [
        'check.path.glob must be a text such as "samples/*.job", not empty',
        'check.path.glob must be a text such as "samples/*.job", not a number',
    ]
