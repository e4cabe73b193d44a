"""Comments that suppress a rule on their line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from support.cli import gusjob, write
from support.selection import DIAGNOSTICS, JOB, checked, found


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
def test_a_comment_suppresses_a_rule_on_its_line(tmp_path: Path, comment: str) -> None:
    assert found(write(tmp_path, allowing("DWELL 3", comment))) == DIAGNOSTICS - {(8, "GJ404", "warning")}


def test_several_rules_on_a_line(tmp_path: Path) -> None:
    text = JOB.replace("DWELL 3\n", "LET q = 3\nDWELL 3\n", 1).replace(
        "LET q = 3", "LET q = 3 ; allow GJ142, GJ404: why"
    )
    codes = {(line, code) for line, code, _ in found(write(tmp_path, text))}
    assert codes == {(4, "GJ142"), (8, "GJ145"), (9, "GJ404"), (12, "GJ141")}


@pytest.mark.parametrize(
    ("comment", "line", "code", "expected"),
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
def test_comments_without_effect(tmp_path: Path, comment: str, line: int, code: str, expected: str) -> None:
    loaded = checked(write(tmp_path, allowing("DWELL 3", comment)))
    assert {(f.span.line, f.rule.code, f.severity.value) for f in loaded.diagnostics} == DIAGNOSTICS | {
        (line, code, "warning")
    }
    (reported,) = [f for f in loaded.diagnostics if f.rule.code == code]
    assert expected in reported.message
    source = loaded.text_of(reported.span, reported.path)
    assert source[reported.span.column - 1 : reported.span.end_column - 1] == str(reported.fields["code"])


def test_an_unused_comment_is_reported(tmp_path: Path) -> None:
    path = write(tmp_path, allowing("LINE X 20", "; allow GJ404: it was here once"))
    assert found(path) == DIAGNOSTICS | {(9, "GJ145", "warning")}
    assert gusjob("check", "--strict", "--ignore", "GJ404", str(path)).exit_code == 1


def test_other_comments_mean_nothing(tmp_path: Path) -> None:
    for comment in ("; allow some time: it is hot", "; disallow GJ404: x", "; we allow GJ404: no"):
        assert found(write(tmp_path, allowing("DWELL 3", comment))) == DIAGNOSTICS


def test_a_suppressed_diagnostic_is_not_reported_by_any_command(tmp_path: Path) -> None:
    path = write(tmp_path, allowing("DWELL 3", "; allow GJ404: warmed up"))
    for command in ("check", "run", "compile", "report"):
        assert "GJ404" not in gusjob(command, str(path), "--format", "json").output if command == "report" else True
        assert "GJ404]" not in gusjob(command, str(path)).output


def test_a_warning_raised_to_an_error_can_not_be_suppressed(tmp_path: Path) -> None:
    path = write(tmp_path, allowing("DWELL 3", "; allow GJ404: warmed up"))
    write(tmp_path, '[check.severity]\nGJ404 = "error"\n', "gusjob.toml")
    assert found(path) >= {(8, "GJ404", "error"), (8, "GJ144", "warning")}


def test_in_an_included_file(tmp_path: Path) -> None:
    delay = "LASER DELAY ON 9us OFF 5us"
    write(tmp_path, f"{delay} ; allow GJ306: measured\n{delay}\nDWELL 1 ; allow GJ404: no light\n", "part.job")
    path = write(tmp_path, 'WAIT\nINCLUDE "part.job"\n')
    reported = [(Path(f.file).name, f.span.line, f.rule.code) for f in checked(path).diagnostics]
    assert reported == [("part.job", 2, "GJ306")]  # What is idle here may be needed in another job that includes it.


def test_a_comment_of_a_part_may_be_needed_where_it_is_included(tmp_path: Path) -> None:
    text = "DWELL 5 ; allow GJ404: preheat\n"
    part = write(tmp_path, text, "part.job")
    assert found(part) == {(1, "GJ145", "warning")}
    main = write(tmp_path, JOB.replace("DWELL 3\n", 'INCLUDE "part.job"\n', 1), "main.job")
    assert {code for _, code, _ in found(main)} == {"GJ141", "GJ142"}
    assert found(part) == set()


def test_what_only_the_planner_sees(tmp_path: Path) -> None:
    """GJ811 comes from the planner, so the comment is checked after it."""
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
    on = "GT_BufLaserOn(1,0,0)\nGT_LnXY(1,1000,0,50,5,0,0)"
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
    reported = json.loads(gusjob("check", "--format", "json", str(path)).stdout)
    diagnostics = reported["diagnostics"] if isinstance(reported, dict) else reported
    assert {(f["line"], f["severity"]) for f in diagnostics} == {(4, "warning"), (8, "warning"), (11, "note")}


def test_two_comments_on_a_line(tmp_path: Path) -> None:
    text = allowing("LET p = 3", "; allow GJ142: later ; allow GJ404: here, too").replace("LET p = 3 ", "LET p = 3 ", 1)
    assert found(write(tmp_path, text)) == (DIAGNOSTICS - {(4, "GJ142", "note")}) | {(4, "GJ145", "warning")}


@pytest.mark.parametrize(
    ("line", "profile"), [("GJ813", 'scanner = "delay:100us"\n'), ("GJ515", "host_calls_per_s = 1000\n")]
)
def test_a_rule_that_needs_the_profile_is_unused_only_with_it(tmp_path: Path, line: str, profile: str) -> None:
    path = write(tmp_path, f"DWELL 3 ; allow {line}: tuned by hand\n")
    assert found(path) == set()
    write(tmp_path, profile, "gusjob.toml")
    assert found(path) == {(1, "GJ145", "warning")}


# More diagnostics than are listed.

LIT = "LASER MODE DUTY CARRIER 10kHz\nVEL 100\nACC 5000\nLASER POWER 30\nLASER ON\nLINE X 10\n"


def test_a_warning_after_a_thousand_suppressed_ones_is_reported(tmp_path: Path) -> None:
    allowed = "DWELL 3 ; allow GJ404: preheat\n"
    path = write(tmp_path, LIT + allowed * 1000 + "DWELL 5000\nLINE X 20\nLASER OFF\n")
    assert found(path) == {(1, "GJ005", "warning")}
    assert gusjob("check", "--strict", str(path)).exit_code == 1
    path = write(tmp_path, LIT + allowed * 1200 + "LINE X 20\nLASER OFF\n")
    assert {code for _, code, _ in found(path)} == {"GJ005"}  # No comment is called idle that may not be.


def test_an_error_after_a_thousand_warnings_is_reported(tmp_path: Path) -> None:
    write(tmp_path, '[[check.path]]\nglob = "part.job"\nseverity = { GJ404 = "error" }\n', "gusjob.toml")
    write(tmp_path, "DWELL 3\n", "part.job")
    for many in (999, 1000):
        path = write(tmp_path, LIT + "DWELL 3\n" * many + 'INCLUDE "part.job"\nLINE X 20\nLASER OFF\n', "main.job")
        assert gusjob("run", str(path)).exit_code == 1
        assert gusjob("check", str(path)).exit_code == 1


def test_unused_comments_are_listed_like_other_diagnostics(tmp_path: Path) -> None:
    path = write(tmp_path, "DWELL 3 ; allow GJ404: preheat\n" * 1500)
    reported = [f.rule.code for f in checked(path).diagnostics]
    assert reported.count("GJ145") == 1000 and reported.count("GJ005") == 1


def test_many_comments_are_found_in_one_pass(tmp_path: Path) -> None:
    path = write(tmp_path, "".join(f"LET a{n} = {n} ; allow GJ142: number {n}\n" for n in range(900)) + "WAIT\n")
    assert found(path) == set()
