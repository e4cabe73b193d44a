"""[check] of a profile, --select and --ignore, and the comments that allow a rule on a line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from support.cli import gusjob, write

from gusjob.config.profile import parse_profile
from gusjob.diagnostics.model import Diagnostic, Severity, Span
from gusjob.diagnostics.rules import RULES
from gusjob.diagnostics.select import NOTHING_ASKED, RuleSelection, SelectionLayer
from gusjob.pipeline import FileResult, examine_file, selected

# 4: GJ142 (note), 7: GJ404 (warning), 9: GJ141 (note)
JOB = """LASER MODE DUTY CARRIER 10kHz
VEL 100
ACC 5000
LET p = 3
LASER POWER 30
LASER ON
LINE X 10
DWELL 3
LINE X 20
LASER OFF
DEF f()
DWELL 3
END
"""
FAULTS = {(4, "GJ142", "note"), (8, "GJ404", "warning"), (11, "GJ141", "note")}


def checked(path: Path, asked: SelectionLayer = NOTHING_ASKED) -> FileResult:
    return selected(examine_file(path), asked)


def found(path: Path, asked: SelectionLayer = NOTHING_ASKED) -> set[tuple[int, str, str]]:
    """(line, code, severity) of what counts in a file."""
    return {(f.span.line, f.rule.code, f.severity.value) for f in checked(path, asked).diagnostics}


def diagnostic(code: str, path: str = "a.job") -> Diagnostic:
    return Diagnostic(rule=RULES[code], span=Span(line=1), path=path)


# Layers.


@pytest.mark.parametrize(
    ("select", "ignore", "said"),
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
def test_the_longer_beginning_counts(
    select: tuple[str, ...], ignore: tuple[str, ...], said: dict[str, bool | None]
) -> None:
    layer = SelectionLayer(select=select, ignore=ignore)
    assert {code: layer.wants(code) for code in said} == said


def test_the_last_layer_that_says_something_counts(tmp_path: Path) -> None:
    layers = (
        SelectionLayer(ignore=("GJ3",), severity=(("GJ3", Severity.NOTE), ("GJ304", Severity.ERROR))),
        SelectionLayer(glob="samples/*", select=("GJ304",), severity=(("GJ306", Severity.ERROR),)),
        SelectionLayer(glob="samples/old/*", ignore=("GJ304",)),
    )
    selection = RuleSelection(layers=layers, folder=str(tmp_path))
    plain, sample, old = (str(tmp_path / name) for name in ("a.job", "samples/a.job", "samples/old/a.job"))
    assert not selection.wants(diagnostic("GJ304", plain), NOTHING_ASKED)
    assert selection.wants(diagnostic("GJ401", plain), NOTHING_ASKED)
    assert selection.wants(diagnostic("GJ304", sample), NOTHING_ASKED)
    assert not selection.wants(diagnostic("GJ401", sample), NOTHING_ASKED)
    assert not selection.wants(diagnostic("GJ304", old), NOTHING_ASKED)
    # The command line has the last word.
    assert selection.wants(diagnostic("GJ304", plain), SelectionLayer(select=("GJ304",)))
    assert not selection.wants(diagnostic("GJ304", sample), SelectionLayer(ignore=("GJ",)))
    weights = {p: selection.weighed([diagnostic("GJ304", p), diagnostic("GJ306", p)]) for p in (plain, sample)}
    assert [f.severity for f in weights[plain]] == [Severity.ERROR, Severity.NOTE]
    assert [f.severity for f in weights[sample]] == [Severity.ERROR, Severity.ERROR]


def test_an_error_stays_one() -> None:
    selection = RuleSelection(layers=(SelectionLayer(severity=(("GJ4", Severity.NOTE),)),))
    assert [f.severity for f in selection.weighed([diagnostic("GJ401"), diagnostic("GJ404")])] == [
        Severity.ERROR,
        Severity.NOTE,
    ]


# The profile.


def test_check_by_rule_and_by_path(tmp_path: Path) -> None:
    (tmp_path / "samples").mkdir()
    a, b = write(tmp_path, JOB), write(tmp_path / "samples", JOB)
    assert found(a) == FAULTS
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
        name for name in every if not selection.wants(diagnostic("GJ404", str(tmp_path / name)), NOTHING_ASKED)
    } == files


def test_errors_that_are_not_selected_are_counted(tmp_path: Path) -> None:
    path = str(write(tmp_path, JOB.replace("LASER OFF\n", "")))
    assert gusjob("check", "--select", "GJ404", path).stderr.endswith("(3 not selected, 1 of them errors)\n")
    assert gusjob("check", "--ignore", "GJ14", path).stderr.endswith("(2 not selected)\n")


def test_what_is_made_an_error_is_refused_everywhere(tmp_path: Path) -> None:
    path = write(tmp_path, JOB)
    assert gusjob("check", str(path)).exit_code == 0
    assert gusjob("run", str(path)).exit_code == 0
    write(tmp_path, '[check.severity]\nGJ404 = "error"\n', "gusjob.toml")
    for command in ("check", "run", "compile", "report"):
        done = gusjob(command, str(path))
        assert done.exit_code == 1, command
        assert "error[GJ404]" in done.output


def test_what_is_ignored_is_ignored_by_check_alone(tmp_path: Path) -> None:
    path = write(tmp_path, JOB.replace("LASER OFF\n", ""))
    write(tmp_path, '[check]\nignore = ["GJ401"]\n', "gusjob.toml")
    assert gusjob("check", str(path)).exit_code == 0
    assert gusjob("run", str(path)).exit_code == 1
    assert gusjob("check", "--select", "GJ401", str(path)).exit_code == 1


def test_counts_of_what_is_ignored_go_with_it(tmp_path: Path) -> None:
    path = write(tmp_path, "LASER MODE DUTY CARRIER 10\nVEL 1\nACC 1\nLINE X 999\n" + "LINE X 998\nLINE X 999\n" * 1000)
    assert {code for _, code, _ in found(path)} == {"GJ503", "GJ005"}
    assert found(path, SelectionLayer(ignore=("GJ5",))) == set()


@pytest.mark.parametrize(
    ("text", "code", "line", "said"),
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
def test_what_is_wrong_in_check(text: str, code: str, line: int, said: str) -> None:
    profile = parse_profile(text, "gusjob.toml")
    assert [(f.rule.code, f.span.line) for f in profile.diagnostics][:1] == [(code, line)]
    assert said in profile.diagnostics[0].message
    assert profile.selection == RuleSelection()


# Comments.


def allowing(line: str, comment: str) -> str:
    return JOB.replace(f"{line}\n", f"{line} {comment}\n", 1)


@pytest.mark.parametrize(
    "comment",
    [
        "; allow GJ404: the part is warmed up here",
        "// allow GJ404: warmed up",
        ";Allow  gj404 : warmed up",
        "; allow GJ404：预热",
        "; see the sheet ; allow GJ404: warmed up",
        ";\N{IDEOGRAPHIC SPACE}allow\N{IDEOGRAPHIC SPACE}GJ404: warmed up",
        "; allow GJ404: warmed up ; TODO: clamp",
    ],
)
def test_a_rule_is_allowed_on_its_line(tmp_path: Path, comment: str) -> None:
    assert found(write(tmp_path, allowing("DWELL 3", comment))) == FAULTS - {(8, "GJ404", "warning")}


def test_several_rules_on_a_line(tmp_path: Path) -> None:
    text = JOB.replace("DWELL 3\n", "LET q = 3\nDWELL 3\n", 1).replace(
        "LET q = 3", "LET q = 3 ; allow GJ142, GJ404: why"
    )
    codes = {(line, code) for line, code, _ in found(write(tmp_path, text))}
    assert codes == {(4, "GJ142"), (8, "GJ145"), (9, "GJ404"), (12, "GJ141")}


@pytest.mark.parametrize(
    ("comment", "line", "code", "said"),
    [
        ("; allow GJ404", 8, "GJ144", "a reason is missing"),
        ("; allow GJ404: ", 8, "GJ144", "a reason is missing"),
        ("; allow GJ404 since it is warmed up", 8, "GJ144", "a reason is missing"),
        ("; allow GJ4: all of them", 8, "GJ144", "there is no such rule"),
        ("; allow GJ401: it is left on", 8, "GJ144", "an error can't be suppressed"),
        ("; allow GJ145: x", 8, "GJ144", "a diagnostic about a comment"),
        ("; allow: GJ404 it is warmed up", 8, "GJ144", "its form is wrong"),
        ("; allowGJ404: it is warmed up", 8, "GJ144", "its form is wrong"),
    ],
)
def test_what_is_not_followed(tmp_path: Path, comment: str, line: int, code: str, said: str) -> None:
    loaded = checked(write(tmp_path, allowing("DWELL 3", comment)))
    assert {(f.span.line, f.rule.code, f.severity.value) for f in loaded.diagnostics} == FAULTS | {
        (line, code, "warning")
    }
    (told,) = [f for f in loaded.diagnostics if f.rule.code == code]
    assert said in told.message
    source = loaded.text_of(told.span, told.path)
    assert source[told.span.column - 1 : told.span.end_column - 1] == str(told.fields["code"])


def test_what_allows_nothing_is_told(tmp_path: Path) -> None:
    path = write(tmp_path, allowing("LINE X 20", "; allow GJ404: it was here once"))
    assert found(path) == FAULTS | {(9, "GJ145", "warning")}
    assert gusjob("check", "--strict", "--ignore", "GJ404", str(path)).exit_code == 1


def test_other_comments_mean_nothing(tmp_path: Path) -> None:
    for comment in ("; allow some time: it is hot", "; disallow GJ404: x", "; we allow GJ404: no"):
        assert found(write(tmp_path, allowing("DWELL 3", comment))) == FAULTS


def test_an_allowed_fault_is_not_told_by_any_command(tmp_path: Path) -> None:
    path = write(tmp_path, allowing("DWELL 3", "; allow GJ404: warmed up"))
    for command in ("check", "run", "compile", "report"):
        assert "GJ404" not in gusjob(command, str(path), "--format", "json").output if command == "report" else True
        assert "GJ404]" not in gusjob(command, str(path)).output


def test_an_error_of_the_profile_is_not_allowed(tmp_path: Path) -> None:
    path = write(tmp_path, allowing("DWELL 3", "; allow GJ404: warmed up"))
    write(tmp_path, '[check.severity]\nGJ404 = "error"\n', "gusjob.toml")
    assert found(path) >= {(8, "GJ404", "error"), (8, "GJ144", "warning")}


def test_in_an_included_file(tmp_path: Path) -> None:
    delay = "LASER DELAY ON 9us OFF 5us"
    write(tmp_path, f"{delay} ; allow GJ306: measured\n{delay}\nDWELL 1 ; allow GJ404: no light\n", "part.job")
    path = write(tmp_path, 'WAIT\nINCLUDE "part.job"\n')
    told = [(Path(f.file).name, f.span.line, f.rule.code) for f in checked(path).diagnostics]
    assert told == [("part.job", 2, "GJ306")]  # What is idle here may be needed in another job that includes it.


def test_a_comment_of_a_part_may_be_needed_where_it_is_included(tmp_path: Path) -> None:
    text = "DWELL 5 ; allow GJ404: preheat\n"
    part = write(tmp_path, text, "part.job")
    assert found(part) == {(1, "GJ145", "warning")}
    main = write(tmp_path, JOB.replace("DWELL 3\n", 'INCLUDE "part.job"\n', 1), "main.job")
    assert {code for _, code, _ in found(main)} == {"GJ141", "GJ142"}
    assert found(part) == set()


def test_what_only_the_planner_sees(tmp_path: Path) -> None:
    """GJ811 comes from the planner: the allowance is judged when it has spoken."""
    job = (
        "LASER MODE DUTY CARRIER 10kHz\nLASER POWER 30\nACC 5000\nVEL 100\n"
        "SKYWRITE MODE 3 TIMELAG 250us LIMIT -1\nLASER ON\nLINE X 0.2\nLINE X 0.2 Y 10 VEL 10\nLASER OFF\n"
    )
    path = write(tmp_path, job)
    lines = {line for line, code, _ in found(path) if code == "GJ811"}
    if not lines:
        pytest.fail("this job has no GJ811 any more: take another one")
    text = "".join(
        f"{row} ; allow GJ811: slow start\n" if number in lines else f"{row}\n"
        for number, row in enumerate(job.splitlines(), 1)
    )
    assert {code for _, code, _ in found(write(tmp_path, text))}.isdisjoint({"GJ811", "GJ145"})


def test_listings_and_what_check_does_not_look_for(tmp_path: Path) -> None:
    on = "GT_BufLaserOn(1,0,0)\nGT_LnXY(1,1000,0,50,2,0,0)"
    calls = f"{on} // allow GJ708, GJ712, GJ715: the next program goes on\nGT_CrdStart(1,0)\n"
    path = write(tmp_path, calls, "a.gts")
    assert {code for _, code, _ in found(path)} == {"GJ710"}
    path = write(tmp_path, calls.replace("// allow", "// see"), "b.gts")
    assert {code for _, code, _ in found(path)} == {"GJ708", "GJ710", "GJ712", "GJ715"}
    # Of a job what the controller would say is only known when it is run.
    assert found(write(tmp_path, "WAIT ; allow GJ704: known\n")) == set()
    # After an error not everything has been looked for.
    assert {code for _, code, _ in found(write(tmp_path, "DWELL 1 ; allow GJ404: x\nLNE X 1\n"))} == {"GJ102"}


def test_json_tells_the_severity_in_force(tmp_path: Path) -> None:
    path = write(tmp_path, JOB)
    write(tmp_path, '[check.severity]\nGJ142 = "warning"\n', "gusjob.toml")
    told = json.loads(gusjob("check", "--format", "json", str(path)).stdout)
    diagnostics = told["diagnostics"] if isinstance(told, dict) else told
    assert {(f["line"], f["severity"]) for f in diagnostics} == {(4, "warning"), (8, "warning"), (11, "note")}


def test_two_comments_on_a_line(tmp_path: Path) -> None:
    text = allowing("LET p = 3", "; allow GJ142: later ; allow GJ404: here, too").replace("LET p = 3 ", "LET p = 3 ", 1)
    assert found(write(tmp_path, text)) == (FAULTS - {(4, "GJ142", "note")}) | {(4, "GJ145", "warning")}


@pytest.mark.parametrize(
    ("line", "profile"), [("GJ813", 'scanner = "delay:100us"\n'), ("GJ515", "host_calls_per_s = 1000\n")]
)
def test_what_hangs_on_the_profile_is_idle_only_with_it(tmp_path: Path, line: str, profile: str) -> None:
    path = write(tmp_path, f"DWELL 3 ; allow {line}: tuned by hand\n")
    assert found(path) == set()
    write(tmp_path, profile, "gusjob.toml")
    assert found(path) == {(1, "GJ145", "warning")}


# More faults than are listed.

LIT = "LASER MODE DUTY CARRIER 10kHz\nVEL 100\nACC 5000\nLASER POWER 30\nLASER ON\nLINE X 10\n"


def test_a_warning_behind_a_thousand_allowed_ones_is_not_passed_over(tmp_path: Path) -> None:
    allowed = "DWELL 3 ; allow GJ404: preheat\n"
    path = write(tmp_path, LIT + allowed * 1000 + "DWELL 5000\nLINE X 20\nLASER OFF\n")
    assert found(path) == {(1, "GJ005", "warning")}
    assert gusjob("check", "--strict", str(path)).exit_code == 1
    path = write(tmp_path, LIT + allowed * 1200 + "LINE X 20\nLASER OFF\n")
    assert {code for _, code, _ in found(path)} == {"GJ005"}  # No comment is called idle that may not be.


def test_an_error_behind_a_thousand_warnings_is_refused(tmp_path: Path) -> None:
    write(tmp_path, '[[check.path]]\nglob = "part.job"\nseverity = { GJ404 = "error" }\n', "gusjob.toml")
    write(tmp_path, "DWELL 3\n", "part.job")
    for many in (999, 1000):
        path = write(tmp_path, LIT + "DWELL 3\n" * many + 'INCLUDE "part.job"\nLINE X 20\nLASER OFF\n', "main.job")
        assert gusjob("run", str(path)).exit_code == 1
        assert gusjob("check", str(path)).exit_code == 1


def test_idle_comments_are_listed_like_other_faults(tmp_path: Path) -> None:
    path = write(tmp_path, "DWELL 3 ; allow GJ404: preheat\n" * 1500)
    told = [f.rule.code for f in checked(path).diagnostics]
    assert told.count("GJ145") == 1000 and told.count("GJ005") == 1


def test_many_comments_are_found_in_one_pass(tmp_path: Path) -> None:
    path = write(tmp_path, "".join(f"LET a{n} = {n} ; allow GJ142: number {n}\n" for n in range(900)) + "WAIT\n")
    assert found(path) == set()
