"""[check] of a profile, --select and --ignore."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.cli import gusjob, write
from support.selection import DIAGNOSTICS, JOB, found

from gusjob.config.profile import parse_profile
from gusjob.diagnostics.model import Diagnostic, Severity, Span
from gusjob.diagnostics.rules import RULES
from gusjob.diagnostics.select import EMPTY_LAYER, RuleSelection, SelectionLayer


def diagnostic(code: str, path: str = "a.job") -> Diagnostic:
    return Diagnostic(rule=RULES[code], span=Span(line=1), path=path)


# Layers.


@pytest.mark.parametrize(
    ("select", "ignore", "expected"),
    [
        ((), (), {"GJ401": None, "GJ304": None}),
        (("GJ4",), (), {"GJ401": True, "GJ304": False}),
        ((), ("GJ4",), {"GJ401": False, "GJ304": None}),
        (("GJ4",), ("GJ401",), {"GJ401": False, "GJ404": True, "GJ304": False}),
        (("GJ401",), ("GJ4",), {"GJ401": True, "GJ404": False, "GJ304": False}),
        (("GJ40",), ("GJ4", "GJ404"), {"GJ401": True, "GJ404": False, "GJ412": False}),
        (("GJ4",), ("GJ4",), {"GJ401": False, "GJ304": False}),
    ],
)  # fmt: skip
def test_the_longest_prefix_wins(
    select: tuple[str, ...], ignore: tuple[str, ...], expected: dict[str, bool | None]
) -> None:
    layer = SelectionLayer(select=select, ignore=ignore)
    assert {code: layer.selects(code) for code in expected} == expected


def test_the_last_layer_that_mentions_a_rule_wins(tmp_path: Path) -> None:
    layers = (
        SelectionLayer(ignore=("GJ3",), severity=(("GJ3", Severity.NOTE), ("GJ304", Severity.ERROR))),
        SelectionLayer(glob="samples/*", select=("GJ304",), severity=(("GJ306", Severity.ERROR),)),
        SelectionLayer(glob="samples/old/*", ignore=("GJ304",)),
    )
    selection = RuleSelection(layers=layers, folder=str(tmp_path))
    plain, sample, old = (str(tmp_path / name) for name in ("a.job", "samples/a.job", "samples/old/a.job"))
    assert not selection.selects(diagnostic("GJ304", plain), EMPTY_LAYER)
    assert selection.selects(diagnostic("GJ401", plain), EMPTY_LAYER)
    assert selection.selects(diagnostic("GJ304", sample), EMPTY_LAYER)
    assert not selection.selects(diagnostic("GJ401", sample), EMPTY_LAYER)
    assert not selection.selects(diagnostic("GJ304", old), EMPTY_LAYER)
    # The command line wins.
    assert selection.selects(diagnostic("GJ304", plain), SelectionLayer(select=("GJ304",)))
    assert not selection.selects(diagnostic("GJ304", sample), SelectionLayer(ignore=("GJ",)))
    weights = {p: selection.with_severities([diagnostic("GJ304", p), diagnostic("GJ306", p)]) for p in (plain, sample)}
    assert [f.severity for f in weights[plain]] == [Severity.ERROR, Severity.NOTE]
    assert [f.severity for f in weights[sample]] == [Severity.ERROR, Severity.ERROR]


def test_an_error_stays_an_error() -> None:
    selection = RuleSelection(layers=(SelectionLayer(severity=(("GJ4", Severity.NOTE),)),))
    assert [f.severity for f in selection.with_severities([diagnostic("GJ401"), diagnostic("GJ404")])] == [
        Severity.ERROR,
        Severity.NOTE,
    ]


# The profile.


def test_check_by_rule_and_by_path(tmp_path: Path) -> None:
    (tmp_path / "samples").mkdir()
    a, b = write(tmp_path, JOB), write(tmp_path / "samples", JOB)
    assert found(a) == DIAGNOSTICS
    write(
        tmp_path,
        '[check]\nignore = ["GJ141"]\nseverity = { GJ404 = "error" }\n'
        '[[check.path]]\nglob = "samples/*.job"\nignore = ["GJ142"]\n[check.path.severity]\nGJ404 = "note"\n',
        "gusjob.toml",
    )
    assert found(a) == {(4, "GJ142", "note"), (8, "GJ404", "error")}
    assert found(b) == {(8, "GJ404", "note")}
    assert found(a, SelectionLayer(select=("GJ14",))) == {(4, "GJ142", "note"), (11, "GJ141", "note")}


@pytest.mark.parametrize(
    ("glob", "files"),
    [
        ("*.job", {"a.job", "sub/b.job", "sub/deep/c.job"}),
        ("**/*.job", {"a.job", "sub/b.job", "sub/deep/c.job"}),
        ("./a.job", {"a.job"}),
        ("sub", {"sub/b.job", "sub/deep/c.job"}),
        ("sub/", {"sub/b.job", "sub/deep/c.job"}),
        ("sub\\b.job", {"sub/b.job"}),
        ("sub/**/*.job", {"sub/b.job", "sub/deep/c.job"}),
        ("b.job", set()),
        ("[", set()),
    ],
)
def test_globs(tmp_path: Path, glob: str, files: set[str]) -> None:
    selection = RuleSelection(layers=(SelectionLayer(glob=glob, ignore=("GJ",)),), folder=str(tmp_path.resolve()))
    every = ("a.job", "sub/b.job", "sub/deep/c.job")
    assert {
        name for name in every if not selection.selects(diagnostic("GJ404", str(tmp_path / name)), EMPTY_LAYER)
    } == files


def test_errors_that_are_not_selected_are_counted(tmp_path: Path) -> None:
    path = str(write(tmp_path, JOB.replace("LASER OFF\n", "")))
    assert gusjob("check", "--select", "GJ404", path).stderr.endswith("(3 not selected, 1 of them errors)\n")
    assert gusjob("check", "--ignore", "GJ14", path).stderr.endswith(
        "(2 not selected); 1 can be corrected with --fix\n"
    )


def test_a_warning_raised_to_an_error_stops_every_command(tmp_path: Path) -> None:
    path = write(tmp_path, JOB)
    assert gusjob("check", str(path)).exit_code == 0
    assert gusjob("run", str(path)).exit_code == 0
    write(tmp_path, '[check.severity]\ngj404 = "error"\n', "gusjob.toml")
    for command in ("check", "run", "compile", "report"):
        done = gusjob(command, str(path))
        assert done.exit_code == 1, command
        assert "error[GJ404]" in done.output


def test_ignored_rules_are_ignored_only_by_check(tmp_path: Path) -> None:
    path = write(tmp_path, JOB.replace("LASER OFF\n", ""))
    write(tmp_path, '[check]\nignore = ["GJ401"]\n', "gusjob.toml")
    assert gusjob("check", str(path)).exit_code == 0
    assert gusjob("run", str(path)).exit_code == 1
    assert gusjob("check", "--select", "GJ401", str(path)).exit_code == 1


def test_the_count_of_an_ignored_rule_is_ignored_too(tmp_path: Path) -> None:
    path = write(tmp_path, "LASER MODE DUTY CARRIER 10\nVEL 1\nACC 1\nLINE X 999\n" + "LINE X 998\nLINE X 999\n" * 1000)
    assert {code for _, code, _ in found(path)} == {"GJ503", "GJ005"}
    assert found(path, SelectionLayer(ignore=("GJ5",))) == set()


@pytest.mark.parametrize(
    ("text", "code", "line", "expected"),
    [
        ('[check]\nselct = ["GJ4"]\n', "GJ602", 2, "check.selct is not an entry of a machine profile; did you"),
        ("[check]\nignore = [4]\n", "GJ603", 2, "check.ignore must be a list of codes such as"),
        ('[check]\nselect = ["gj4"]\nignore = "gj4"\n', "GJ603", 3, "not a text"),
        ('[[check.path]]\nglobs = "a"\n', "GJ602", 2, "check.path.globs is not an entry of a machine profile; did you"),
        ("[check]\nselect = 4\n", "GJ603", 2, "check.select must be a list of codes"),
        ('[check]\nselect = ["GJ4", 4]\n', "GJ603", 2, "check.select must be a list of codes"),
        ('[check]\nignore = ["GJX"]\n', "GJ604", 2, 'check.ignore is "GJX"; it must be the code of a rule'),
        ('[check]\nignore = [""]\n', "GJ604", 2, 'check.ignore is ""'),
        ('[check]\nseverity = "error"\n', "GJ603", 2, "check.severity must be a table of codes"),
        ('[check]\nseverity = { GJ4 = "fatal" }\n', "GJ604", 2, 'check.severity is "fatal"; it must be "error"'),
        ("[check]\nseverity = { GJ4 = 1 }\n", "GJ604", 2, "check.severity is a number; it must be"),
        ('[check]\nseverity = { GJ9X = "note" }\n', "GJ604", 2, 'check.severity is "GJ9X"'),
        ('[check]\nseverity = { GJ401 = "note" }\n', "GJ604", 2, "the severity of an error can't be lowered"),
        ("check = 3\n", "GJ603", 1, "check must be a table, not a number"),
        ("[check]\npath = 3\n", "GJ603", 2, "check.path must be a list of tables"),
        ('[[check.path]]\nignore = ["GJ4"]\n', "GJ603", 1, "not missing"),
        ('[[check.path]]\nglob = "*"\nfoo = 1\n', "GJ602", 3, "check.path.foo is not an entry"),
        ("[check]\npath = [3]\n", "GJ603", 2, "check.path must be a list of tables"),
    ],
)  # fmt: skip
def test_wrong_entries_of_check(text: str, code: str, line: int, expected: str) -> None:
    profile = parse_profile(text, "gusjob.toml")
    assert [(f.rule.code, f.span.line) for f in profile.diagnostics][:1] == [(code, line)]
    assert expected in profile.diagnostics[0].message
    assert profile.selection == RuleSelection()
