"""What CI systems read: SARIF, JUnit, GitHub, GitLab by their schemas and rules; output files, folders, globs."""

from __future__ import annotations

import json
import os
import re
from importlib import import_module
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlparse
from urllib.request import url2pathname
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner, Result
from hypothesis import given, settings
from hypothesis import strategies as st
from support.tools import MARK, ROOT

from gusjob.cli import cli
from gusjob.diagnostics.formats.github import GitHubAnnotations
from gusjob.diagnostics.formats.sarif import FINGERPRINT, descriptor, message_text
from gusjob.diagnostics.model import Diagnostic, Span
from gusjob.diagnostics.rules import EMPTY, RULES

jsonschema: Any = import_module("jsonschema")
xmlschema: Any = import_module("xmlschema")

SCHEMAS = ROOT / "tests" / "schemas"
GOOD = MARK + "LASER POWER 50\nJUMP X 5\nLASER ON\nLINE X 10\nLASER OFF\n"
WARNED = MARK + "LASER DELAY ON 20 OFF 10\n"
NOTED = "LET unread = 1\n" + GOOD
SARIF = jsonschema.Draft4Validator(json.loads((SCHEMAS / "sarif-schema-2.1.0.json").read_text(encoding="utf-8")))
JUNIT = xmlschema.XMLSchema(str(SCHEMAS / "junit-10.xsd"))


def gusjob(*args: object) -> Result:
    return CliRunner().invoke(cli, [str(a) for a in args], catch_exceptions=False)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder, in which gusjob is called."""
    folder = tmp_path / "checkout"
    folder.mkdir()
    monkeypatch.chdir(folder)
    for variable in ("GITHUB_WORKSPACE", "CI_PROJECT_DIR"):  # Those of the CI that runs the tests.
        monkeypatch.delenv(variable, raising=False)
    return folder


def write(path: Path, text: str | bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


# SARIF


def sarif(*args: object, exit_code: int | None = None) -> dict[str, Any]:
    """The run of a log that is valid by the schema, and whose indices point where they say."""
    result = gusjob("check", "--format", "sarif", *args)
    assert exit_code is None or result.exit_code == exit_code, result.output
    log = json.loads(result.stdout)
    SARIF.validate(log)
    (run,) = log["runs"]
    driver = run["tool"]["driver"]
    assert [driver["rules"][r["ruleIndex"]]["id"] for r in run["results"]] == [r["ruleId"] for r in run["results"]]
    assert {rule["id"] for rule in driver["rules"]} == {r["ruleId"] for r in run["results"]}
    said = [n["descriptor"] for invocation in run["invocations"] for n in invocation["toolExecutionNotifications"]]
    assert [driver["notifications"][d["index"]]["id"] for d in said] == [d["id"] for d in said]
    assert dict(run)["columnKind"] == "unicodeCodePoints"
    return dict(run)


def place(location: dict[str, Any]) -> tuple[str, int, int, int, int]:
    """(uri, line, column, end line, end column) of a location."""
    physical = location["physicalLocation"]
    region = physical["region"]
    line, column = region["startLine"], region.get("startColumn", 1)
    end = region.get("endLine", line), region.get("endColumn", column)
    return (physical["artifactLocation"]["uri"], line, column, *end)


def fingerprints(run: dict[str, Any]) -> list[str]:
    return [result["partialFingerprints"][FINGERPRINT] for result in run["results"]]


def test_a_result(here: Path) -> None:
    write(here / "jobs" / "x.job", MARK + "LASER POWER 120\n")
    run = sarif("jobs", exit_code=1)
    (result,) = run["results"]
    del result["partialFingerprints"]
    assert result == {
        "ruleId": "GJ201", "ruleIndex": 0, "level": "error",
        "message": {"text": "LASER POWER 120 % is outside (0, 100) %"},
        "locations": [
            {
                "physicalLocation": {
                    "artifactLocation": {"uri": "jobs/x.job", "uriBaseId": "%SRCROOT%"},
                    "region": {"startLine": 4, "startColumn": 13, "endLine": 4, "endColumn": 16},
                }
            }
        ],
    }  # fmt: skip
    driver = run["tool"]["driver"]
    assert driver["name"] == "gusjob"
    assert gusjob("--version").output.split()[-1] == driver["version"]
    assert "informationUri" not in driver
    assert "%SRCROOT%" in run["originalUriBaseIds"]
    assert run["invocations"] == [{"executionSuccessful": True, "toolExecutionNotifications": []}]


def test_every_fault_is_a_result(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT / "tests")
    found = json.loads(gusjob("check", "--format", "json", "bad", "good").stdout)["diagnostics"]
    wanted = {
        (f["path"], f["line"], f["column"], f["end_line"], f["end_column"], f["code"], f["severity"]) for f in found
    }
    run = sarif("bad", "good", exit_code=1)
    made = [(*place(result["locations"][0]), result["ruleId"], result["level"]) for result in run["results"]]
    assert len(found) > 100
    assert {(unquote(one[0]), *one[1:]) for one in made} == wanted
    # What is told of several jobs is one result: as often as it was told.
    assert sum(f.get("count", 1) for f in found) == sum(r.get("occurrenceCount", 1) for r in run["results"])
    assert len(set(fingerprints(run))) == len(run["results"])


@pytest.mark.parametrize("rule", RULES.values(), ids=RULES.keys())
def test_a_rule(rule: Any) -> None:
    made = descriptor(rule)
    definitions = SARIF.schema["definitions"]
    jsonschema.Draft4Validator({**definitions["reportingDescriptor"], "definitions": definitions}).validate(made)
    assert re.fullmatch(r"([A-Z0-9]\w*)+", made["name"])
    assert made["shortDescription"]["text"].lower() == rule.title.lower() + "."
    assert made["fullDescription"]["text"].rstrip(".")[1:] == rule.why.rstrip(".")[1:]
    for example in (rule.bad, rule.good):
        assert example.rstrip("\n") in made["help"]["text"]
        assert example.rstrip("\n") in made["help"]["markdown"]
    assert made["defaultConfiguration"] == {"level": rule.severity.value}


def test_columns_count_code_points(here: Path) -> None:
    text = 'INCLUDE "\U0001d11e\U0001d11e.job" QQ\n'
    write(here / "x.job", text)
    places = [place(result["locations"][0]) for result in sarif("x.job")["results"]]
    assert "QQ" in [text[column - 1 : end - 1] for _, _, column, _, end in places]


@pytest.mark.parametrize("name", ["a b.job", "50%#1?.job", "täg/ö&ü.job", "c:d.job", "[x](y).job"])
def test_names_of_files_are_uris(here: Path, name: str) -> None:
    if os.name == "nt" and set(name) & set('?:"'):
        pytest.skip("Windows allows no such name")
    write(here / name, "QQ\n")
    (result,) = sarif(name)["results"]
    location = result["locations"][0]["physicalLocation"]["artifactLocation"]
    assert re.fullmatch(r"([A-Za-z0-9_.~/-]|%[0-9A-F]{2})+", location["uri"])  # RFC 3986, 2.3.
    assert unquote(location["uri"]) == name
    assert location["uriBaseId"] == "%SRCROOT%"


def test_a_name_that_is_no_text(here: Path) -> None:
    try:
        Path(os.fsdecode(b"\xff.job")).write_text("QQ\n", encoding="utf-8")
    except (OSError, UnicodeError):
        pytest.skip("this file system takes names of text only")
    uris = [place(result["locations"][0])[0] for result in sarif(".")["results"]]
    assert uris == ["%FF.job"]
    (finding,) = json.loads(gusjob("check", "--format", "gitlab", ".").stdout)
    ((_, properties, _),) = annotated(gusjob("check", "--format", "github", ".").stdout)
    assert finding["location"]["path"] == properties["file"] == "\\xff.job"


def test_files_elsewhere_are_absolute(here: Path) -> None:
    outside = write(here.parent / "out side.job", "QQ\n")
    write(here / "in" / "x.job", "QQ\n")
    for name in (outside, Path("..") / outside.name):
        (result,) = sarif(name)["results"]
        location = result["locations"][0]["physicalLocation"]["artifactLocation"]
        assert "uriBaseId" not in location
        assert urlparse(location["uri"]).scheme == "file"
        assert Path(url2pathname(urlparse(location["uri"]).path)) == outside
    # The same file, however it is written.
    for name in (here / "in" / "x.job", Path("in") / ".." / "in" / "x.job"):
        assert place(sarif(name)["results"][0]["locations"][0])[0] == "in/x.job"


def test_rounds_and_other_places(here: Path) -> None:
    # X i for i = 1..300: from 151 on it is outside of -150..150 mm, 150 times, and first in the round i = 151.
    write(here / "x.job", MARK + "FOR i FROM 1 TO 300\nLINE X (i)\nEND\n")
    (result,) = sarif("x.job")["results"]
    assert result["ruleId"] == "GJ503"
    assert result["occurrenceCount"] == 150
    related = [(r["message"]["text"], place(r)[:2]) for r in result["relatedLocations"]]
    assert ("in the iteration where i = 151", ("x.job", 4)) in related


def test_a_fault_in_a_shared_file_is_one_result(here: Path) -> None:
    write(here / "setup.job", "VEL 100\nACC 2000000\n")
    for name in ("a.job", "b.job"):
        write(here / name, '; first\nINCLUDE "setup.job"\nLINE X 1\n')
    run = sarif("a.job", "b.job")
    (result,) = run["results"]
    assert place(result["locations"][0])[:3] == ("setup.job", 2, 5)
    assert result["occurrenceCount"] == 2
    assert [place(r)[:2] for r in result["relatedLocations"]] == [("a.job", 2), ("b.job", 2)]


def test_fingerprints_stay_with_their_lines(here: Path) -> None:
    lines = [*MARK.splitlines(), "LINE X 200", "LINE X 300", "LINE X 200"]
    job = write(here / "x.job", "\n".join(lines))
    before = fingerprints(sarif(job))
    assert len(set(before)) == 3
    write(job, "\n".join(["; one", "", *lines[:3], "DWELL 1ms", *lines[3:]]))
    assert fingerprints(sarif(job)) == before
    write(job, "\n".join([*lines[:3], *(f"   {line.replace(' ', '  ')}" for line in lines[3:])]))
    assert fingerprints(sarif(job)) == before
    write(job, "\n".join([*lines[:4], "LINE X 301", *lines[5:]]))
    after = fingerprints(sarif(job))
    assert [a == b for a, b in zip(after, before, strict=True)] == [True, False, True]
    moved = write(here / "y.job", "\n".join(lines))
    assert not set(fingerprints(sarif(moved))) & set(before)


def test_a_fault_of_a_whole_file_keeps_its_fingerprint(here: Path) -> None:
    job = write(here / "x.job", "; nothing\n")
    before = fingerprints(sarif(job))
    write(job, "; more\n; nothing\n")
    assert len(before) == 1
    assert fingerprints(sarif(job)) == before


def test_strict_leaves_levels_alone(here: Path) -> None:
    write(here / "x.job", WARNED)
    lax, strict = sarif("x.job", exit_code=0), sarif("--strict", "x.job", exit_code=1)
    assert [result["level"] for result in lax["results"]] == ["warning"]
    assert strict == lax


def test_files_that_cannot_be_read(here: Path) -> None:
    write(here / "x.job", "QQ\n")
    write(here / "y.job", b"LINE X \xe9\n")
    run = sarif("none.job", "x.job", "y.job", exit_code=2)
    assert [result["ruleId"] for result in run["results"]] == ["GJ102"]
    (invocation,) = run["invocations"]
    assert invocation["executionSuccessful"] is False
    said = invocation["toolExecutionNotifications"]
    assert [(n["descriptor"]["id"], n["level"], place(n["locations"][0])[0]) for n in said] == [
        ("GJ001", "error", "none.job"),
        ("GJ002", "error", "y.job"),
    ]


def test_only_what_is_selected(here: Path) -> None:
    write(here / "x.job", "LINE X 1\nQQ\n")
    assert [result["ruleId"] for result in sarif("x.job", "--select", "GJ1")["results"]] == ["GJ102"]


def test_a_profile_is_judged_once(here: Path) -> None:
    write(here / "gusjob.toml", "period_us = -1\n")
    for name in ("a.job", "b.job"):
        write(here / name, GOOD)
    (result,) = sarif(".")["results"]
    assert result["locations"][0]["physicalLocation"]["artifactLocation"]["uri"] == "gusjob.toml"
    assert result["occurrenceCount"] == 2


@given(st.text(max_size=30))
def test_braces_in_a_message_are_no_placeholders(text: str) -> None:
    # str.format reads doubled braces as SARIF does (3.11.5), and complains of single ones.
    made = message_text(text).format()
    assert len(made.replace("\\[", "[")) == len(text.replace("\\[", "["))
    assert not re.search(r"(?<!\\)\[[^\[\]]*\]\(", made)


def test_links_in_a_message_are_text() -> None:
    assert message_text("[x](1)") == "\\[x](1)"
    assert message_text("x [mm] {y}") == "x [mm] {{y}}"


# JUnit


def junit(*args: object, exit_code: int | None = None) -> ElementTree.Element:
    """The top element of a file that is valid by the schema, and whose counts are true."""
    result = gusjob("check", "--format", "junit", *args)
    assert exit_code is None or result.exit_code == exit_code, result.output
    JUNIT.validate(result.stdout)
    top = ElementTree.fromstring(result.stdout)
    for element in (top, *top):
        cases = list(element.iter("testcase"))
        assert int(element.attrib["tests"]) == len(cases) > 0
        for count, kind in (("failures", "failure"), ("errors", "error")):
            assert int(element.attrib[count]) == sum(case.find(kind) is not None for case in cases)
    return top


def outcomes(suite: ElementTree.Element) -> list[str]:
    """What became of each case."""
    return [next((child.tag for child in case), "passed") for case in suite.iter("testcase")]


def test_a_suite_a_file_and_a_case_a_fault(here: Path) -> None:
    names = {"good.job": GOOD, "warn.job": WARNED, "note.job": NOTED, "bad.job": "QQ\nZZ\n"}
    for name, text in names.items():
        write(here / name, text)
    top = junit(*names, "none.job", exit_code=2)
    assert {suite.get("name"): outcomes(suite) for suite in top} == {
        "good.job": ["passed"],
        "warn.job": ["system-out"],
        "note.job": ["system-out"],
        "bad.job": ["failure", "failure"],
        "none.job": ["error"],
    }
    strict = junit("--strict", *names, exit_code=1)
    assert [kind for suite in strict for kind in outcomes(suite)] == [
        "passed", "failure", "system-out", "failure", "failure",
    ]  # fmt: skip


def test_a_failure_says_what_the_text_says(here: Path) -> None:
    write(here / "x.job", MARK + "LASER POWER 120\n")
    (case,) = junit("x.job", exit_code=1).iter("testcase")
    assert case.attrib == {"name": "GJ201 value out of range (4:13)", "classname": "x.job", "time": "0"}
    (failure,) = case
    assert failure.attrib == {"type": "GJ201", "message": "LASER POWER 120 % is outside (0, 100) %"}
    assert failure.text is not None
    assert failure.text.splitlines() == gusjob("check", "x.job").stdout.splitlines()


def test_every_fault_is_a_case(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT / "tests")
    found = json.loads(gusjob("check", "--format", "json", "bad", "good").stdout)["diagnostics"]
    top = junit("bad", "good")
    wanted = sorted((f["path"], f["code"], f["line"], f["column"]) for f in found)
    made, keys = [], []
    for suite in top:
        for case in suite:
            name = re.fullmatch(r"(GJ\d+) .* \((\d+):(\d+)\)( #\d+)?", case.attrib["name"])
            keys.append((suite.get("name"), case.get("classname"), case.get("name")))
            if name:
                made.append((case.attrib["classname"], name[1], int(name[2]), int(name[3])))
    assert sorted(made) == wanted
    assert len(set(keys)) == len(keys)


def test_text_that_xml_does_not_hold(here: Path) -> None:
    name = "a&b'.job" if os.name == "nt" else "a<b>&'\"\x01\n]]>.job"
    write(here / name, b"\x01\x1b[31m ]]> <x> & \"'\xef\xbf\xbe\xef\xbf\xbf\xc2\x85\xe2\x80\xa8\nLINE X ]]> 1\n")
    top = junit(name, exit_code=1)
    assert "]]>" in "".join(top.itertext())
    shown = "".join(c if c.isprintable() else "\ufffd" for c in name)
    assert [suite.get("name") for suite in top] == [shown]


@settings(max_examples=60, deadline=None)
@given(data=st.one_of(st.text(max_size=60).map(lambda t: t.encode("utf-8", "ignore")), st.binary(max_size=40)))
def test_any_file_makes_valid_logs(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    job = write(tmp_path_factory.mktemp("any") / "x.job", data)
    run, top = sarif(job), junit(job)
    told = len(run["results"]) + len(run["invocations"][0]["toolExecutionNotifications"])
    assert told <= len(list(top.iter("testcase")))
    assert len(annotated(gusjob("check", "--format", "github", job).stdout)) == len(gitlab(job)) == told


# GitHub


def annotated(text: str) -> list[tuple[str, dict[str, str], str]]:
    """Commands with their properties and messages, read as GitHub's runner reads the lines of a log."""
    found = []
    for line in text.split("\n")[:-1]:
        command, head, message = re.fullmatch("::([a-z]+) (.*?)::(.*)", line).groups()  # type: ignore[union-attr]
        properties = dict(part.split("=", 1) for part in head.split(","))
        escapes = {"%0D": "\r", "%0A": "\n", "%3A": ":", "%2C": ",", "%25": "%"}
        for written, read in escapes.items():
            properties = {name: value.replace(written, read) for name, value in properties.items()}
            message = message.replace(written, read) if read not in ":," else message
        found.append((command, properties, message))
    return found


def test_an_annotation(here: Path) -> None:
    name = "a,b%25.job" if os.name == "nt" else "a:b,c%0A.job"
    write(here / "jobs" / name, "LET w = 120\n" + MARK + "LASER POWER (w)\n")
    done = gusjob("check", "--format", "github", "jobs")
    assert (done.exit_code, done.stderr) == (1, "1 file: 1 error\n")
    assert done.stdout.count("\n") == 1
    ((command, properties, message),) = annotated(done.stdout)
    file = f"jobs/{name}"
    assert (command, properties) == (
        "error",
        {"file": file, "line": "5", "endLine": "5", "col": "13", "endColumn": "16", "title": "GJ201"},
    )
    first, *notes = message.split("\n")
    assert first == f"{file}:5:13: LASER POWER 120 % is outside (0, 100) %"
    assert notes == [f"note: {Path(file)}:1:1: w is set here"]


def test_severities_and_positions(monkeypatch: pytest.MonkeyPatch) -> None:
    """All problems of our samples, each position once; columns only within a line, since the runner drops others."""
    monkeypatch.chdir(ROOT / "tests")
    monkeypatch.delenv("GITHUB_WORKSPACE", raising=False)
    found = json.loads(gusjob("check", "--format", "json", "bad", "good").stdout)["diagnostics"]
    commands = {"error": "error", "warning": "warning", "note": "notice"}
    wanted = {
        (commands[f["severity"]], Path(f["path"]).as_posix(), f["line"], f["end_line"], f["code"], f["message"])
        for f in found
    }
    read = annotated(gusjob("check", "--format", "github", "bad", "good").stdout)
    made = [
        (command, p["file"], int(p["line"]), int(p["endLine"]), p["title"], message) for command, p, message in read
    ]
    assert len(made) > 100
    assert {one[:-1] for one in made} == {one[:-1] for one in wanted}
    for *place, message in wanted:
        assert any(one[:-1] == tuple(place) and f": {message}" in one[-1] for one in made), message
    for _, p, _ in read:
        assert ("col" in p) == ("endColumn" in p)
        if "col" in p:
            assert p["line"] == p["endLine"] and int(p["col"]) <= int(p["endColumn"])


def test_columns_of_several_lines_are_left_out() -> None:
    """The runner drops them, and says so in its debug log."""
    made = GitHubAnnotations()
    spans = [Span(line=2, column=3, end_line=4, end_column=5), Span(line=2, column=3), Span(line=2, end_column=1)]
    made.add(Path("a"), [Diagnostic(rule=EMPTY, span=span, fields={"what": "x"}) for span in spans], lambda *_: "",
             readable=True)  # fmt: skip
    places = [
        {name: p[name] for name in p.keys() - {"file", "title"}} for _, p, _ in annotated(made.to_bytes().decode())
    ]
    assert places == [
        {"line": "2", "endLine": "4"},
        {"line": "2", "endLine": "2"},
        {"line": "2", "endLine": "2", "col": "1", "endColumn": "1"},
    ]


# GitLab

GITLAB = jsonschema.Draft7Validator(
    {
        "type": "array",
        "items": {
            "type": "object",
            "required": ["description", "check_name", "fingerprint", "severity", "location"],
            "properties": {
                "description": {"type": "string", "minLength": 1},
                "check_name": {"type": "string", "minLength": 1},
                "fingerprint": {"type": "string", "minLength": 1},
                "severity": {"enum": ["info", "minor", "major", "critical", "blocker"]},
                "location": {
                    "type": "object",
                    "required": ["path", "lines"],
                    "properties": {
                        "path": {"type": "string", "pattern": "^(?!\\./)[^\\\\]+$"},
                        "lines": {
                            "type": "object",
                            "required": ["begin"],
                            "properties": {"begin": {"type": "integer", "minimum": 1}},
                        },
                    },
                },
            },
        },
    }
)
"""What GitLab's documentation of its Code Quality format says. The schema that GitLab itself applies to each finding
(codeclimate.json) requires less: description, fingerprint, severity and location, with these types."""


def gitlab(*args: object, exit_code: int | None = None) -> list[dict[str, Any]]:
    """The findings of a valid report; GitLab shows those of one fingerprint as one."""
    result = gusjob("check", "--format", "gitlab", *args)
    assert exit_code is None or result.exit_code == exit_code, result.output
    found: list[dict[str, Any]] = json.loads(result.stdout)
    GITLAB.validate(found)
    assert len({finding["fingerprint"] for finding in found}) == len(found)
    return found


def test_a_finding(here: Path) -> None:
    write(here / "jobs" / "x.job", MARK + "LASER POWER 120\n")
    write(here / "jobs" / "good.job", GOOD)
    (finding,) = gitlab("jobs", exit_code=1)
    del finding["fingerprint"]
    assert finding == {
        "description": "GJ201: LASER POWER 120 % is outside (0, 100) %",
        "check_name": "GJ201",
        "severity": "major",
        "location": {"path": "jobs/x.job", "lines": {"begin": 4}},
    }
    assert gitlab("jobs/good.job", exit_code=0) == []
    write(here / "jobs" / "x.job", NOTED.replace("LASER POWER 50", "LASER POWER 100"))
    assert [finding["severity"] for finding in gitlab("jobs", "none.job", exit_code=2)] == ["info", "minor", "blocker"]


def test_every_problem_is_a_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT / "tests")
    monkeypatch.delenv("CI_PROJECT_DIR", raising=False)
    found = json.loads(gusjob("check", "--format", "json", "bad", "good").stdout)["diagnostics"]
    wanted = {(Path(f["path"]).as_posix(), f["line"], f["code"]) for f in found}
    made = gitlab("bad", "good", exit_code=1)
    assert {(f["location"]["path"], f["location"]["lines"]["begin"], f["check_name"]) for f in made} == wanted


def test_findings_keep_their_fingerprints(here: Path) -> None:
    lines = [*MARK.splitlines(), "LINE X 200", "LINE X 300", "LINE X 200"]
    job = write(here / "x.job", "\n".join(lines))
    before = [finding["fingerprint"] for finding in gitlab(job)]
    write(job, "\n".join(["; one", "", *lines[:3], "DWELL 1ms", *lines[3:]]))
    assert [finding["fingerprint"] for finding in gitlab(job)] == before


@pytest.mark.parametrize(("form", "variable"), [("github", "GITHUB_WORKSPACE"), ("gitlab", "CI_PROJECT_DIR")])
def test_paths_are_those_of_the_checkout(here: Path, monkeypatch: pytest.MonkeyPatch, form: str, variable: str) -> None:
    """Also in a folder of it, over a link, and for a file that several jobs share, which is shown once."""
    write(here / "jobs" / "parts" / "setup.job", "VEL 100\nACC 2000000\n")
    for name in ("a.job", "b.job"):
        write(here / "jobs" / name, 'INCLUDE "parts/setup.job"\nLINE X 1\n')
    outside = write(here.parent / "outside.job", "QQ\n")
    link = here.parent / "link"
    tops = [here]
    if os.name == "posix":
        link.symlink_to(here)
        tops.append(link)
    monkeypatch.chdir(here / "jobs")
    for top in tops:
        monkeypatch.setenv(variable, str(top))
        for files in (["."], [here / "jobs"], ["../jobs/a.job", "parts/setup.job"]):
            text = gusjob("check", "--format", form, "--select", "GJ504", *files).stdout
            paths = [finding["location"]["path"] for finding in json.loads(text)] if form == "gitlab" else []
            paths = paths or [properties["file"] for _, properties, _ in annotated(text)]
            assert paths == ["jobs/parts/setup.job"]
        text = gusjob("check", "--format", form, "../../outside.job").stdout
        assert outside.as_posix().replace(":", "%3A" if form == "github" else ":") in text


# -o and PATHS


@pytest.mark.parametrize("form", ["text", "json", "sarif", "junit", "github", "gitlab"])
def test_output_goes_to_a_file(here: Path, form: str) -> None:
    write(here / "x.job", "QQ\n")
    printed = gusjob("check", "--format", form, "x.job")
    result = gusjob("check", "--format", form, "-o", "out", "x.job")
    assert (result.exit_code, result.stdout) == (1, "")
    assert result.stderr == "1 file: 1 error\n"
    assert (here / "out").read_bytes() == printed.stdout_bytes
    over = gusjob("check", "--format", form, "-o", "x.job", "x.job")
    assert over.exit_code == 2
    assert (here / "x.job").read_text(encoding="utf-8") == "QQ\n"
    nowhere = gusjob("check", "--format", form, "-o", "none/out", "x.job")
    assert nowhere.exit_code == 2
    assert "can't write" in nowhere.stderr


def test_what_does_not_go_together(here: Path) -> None:
    write(here / "x.job", GOOD)
    others = [["--statistics", "--format", form] for form in ("sarif", "junit", "github", "gitlab")]
    for args in (*others, ["--statistics", "-o", "out.xml"], ["--strict", "--exit-zero"]):
        result = gusjob("check", "x.job", *args)
        assert result.exit_code == 2
        assert "Usage" in result.stderr
    assert not (here / "out.xml").exists()


def checked(*paths: object) -> list[str]:
    """The files that are checked, in order."""
    return [str(suite.get("name")).replace(os.sep, "/") for suite in junit(*paths)]


def test_globs(here: Path) -> None:
    for name in ("b.job", "a.job", "c.gts", "d.txt", "in/e.job", "in/deep/f.JOB", ".hidden/g.job", "in/.h.job"):
        write(here / name, GOOD if not name.endswith("gts") else "GT_CrdStart(1,0)\n")
    assert checked("*.job") == ["a.job", "b.job"]
    assert checked("[bc].*") == ["b.job", "c.gts"]
    assert checked("?.job", "in/*") == ["a.job", "b.job", "in/deep/f.JOB", "in/e.job"]
    assert checked("**/e.job", "**/a.job") == ["in/e.job", "a.job"]
    assert checked(here / "in" / "*.job") == [(here / "in" / "e.job").as_posix()]
    assert checked("**/*.job") == ["a.job", "b.job", "in/e.job"]


@pytest.mark.parametrize("pattern", ["*.gts", "in/*.job", "[x].job", "**/*.gts", "empty*"])
def test_a_glob_that_finds_nothing(here: Path, pattern: str) -> None:
    write(here / "a.job", GOOD)
    (here / "empty").mkdir()
    result = gusjob("check", "a.job", pattern)
    assert result.exit_code == 2
    assert result.stdout == ""
    assert result.stderr == f"gusjob: {pattern}: no file matches\n"


def test_a_name_with_brackets_is_a_name(here: Path) -> None:
    write(here / "part[1].job", GOOD)
    write(here / "part1.job", GOOD)
    assert checked("part[1].job") == ["part[1].job"]


def test_a_file_named_twice_is_checked_once(here: Path) -> None:
    write(here / "a.job", GOOD)
    write(here / "in" / "b.job", GOOD)
    assert checked("in/../a.job", "a.job", "./a.job", here / "a.job", "*.job", ".") == ["in/../a.job", "in/b.job"]
    result = gusjob("check", "none.job", "./none.job")
    assert "1 file: 1 error" in result.stderr


def test_a_link_is_a_name_of_its_own(here: Path) -> None:
    write(here / "a.job", GOOD)
    try:
        (here / "b.job").symlink_to("a.job")
    except OSError:
        pytest.skip("links need rights here")
    assert checked(".") == ["a.job", "b.job"]
