"""The commands as users run them: files, formats, exit status, and messages for files that can't be read."""

from __future__ import annotations

import csv
import io
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from support.cli import GOOD, gusjob, write
from support.journals import with_checksums
from support.tools import MARK, ROOT

from gusjob.cli import common, main
from gusjob.diagnostics.fixes import FIXES
from gusjob.diagnostics.rules import RULES


@pytest.fixture
def good(tmp_path: Path) -> Path:
    path = tmp_path / "good.job"
    path.write_text(GOOD, encoding="utf-8")
    return path


def test_check_exit_status(tmp_path: Path, good: Path) -> None:
    assert gusjob("check", good).exit_code == 0
    warned = write(tmp_path, MARK + "LASER DELAY ON 20 OFF 10\n", "warn.job")
    assert gusjob("check", warned).exit_code == 0
    assert gusjob("check", "--strict", warned).exit_code == 1
    bad = write(tmp_path, "QQ\n", "bad.job")
    assert gusjob("check", good, bad).exit_code == 1
    assert gusjob("check", bad, tmp_path / "none.job").exit_code == 2
    assert gusjob("check", "--format", "xml", good).exit_code == 2


def test_check_as_text(tmp_path: Path) -> None:
    bad = write(tmp_path, MARK + "LASER POWER 120\n")
    lines = gusjob("check", bad).output.splitlines()
    assert lines[0] == f"{bad}:4:13: error[GJ201]: LASER POWER 120 % is outside (0, 100) %"
    assert lines[1] == "    4 | LASER POWER 120"
    assert lines[2] == "      |             ^^^"


def test_check_as_json(tmp_path: Path) -> None:
    bad = write(tmp_path, MARK + "LASER POWER 120\n")
    found = json.loads(gusjob("check", "--format", "json", bad).stdout)
    assert found == {
        "schema": "gusjob-check/1",
        "diagnostics": [
            {
                "path": str(bad), "line": 4, "column": 13, "end_line": 4, "end_column": 16, "severity": "error",
                "code": "GJ201", "message": "LASER POWER 120 % is outside (0, 100) %",
            }
        ],
    }  # fmt: skip


@pytest.mark.parametrize(
    ("content", "code"),
    [
        (b"\xff\xfeL\x00", "GJ002"),
        (b"LINE X \x00 1", "GJ002"),
        (b"LASER ON\nLINE X \xe9\n", "GJ002"),
        (b"", "GJ004"),
        (b" \n; nothing\n", "GJ004"),
    ],
)
@pytest.mark.parametrize("command", ["check", "run", "report", "compile"])
def test_files_that_are_not_jobs(tmp_path: Path, content: bytes, code: str, command: str) -> None:
    result = gusjob(command, write(tmp_path, content))
    assert f"[{code}]" in result.output
    assert result.exit_code == (2 if code == "GJ002" else 0)


@pytest.mark.parametrize("command", ["check", "run", "report", "compile"])
def test_a_folder_without_jobs_and_a_missing_file(tmp_path: Path, command: str) -> None:
    for path in (tmp_path, tmp_path / "none.job"):
        result = gusjob(command, path)
        assert result.exit_code == 2
        assert "GJ001" in result.output or "no .job or .gts file" in result.output


def test_check_searches_folders(tmp_path: Path, good: Path) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    write(inner, "LINE X 1\n", "bad.job")
    write(inner, "LINE X 1\n", "notes.txt")
    hidden = tmp_path / ".hidden"
    hidden.mkdir()
    write(hidden, "QQ\n", "worse.job")
    result = gusjob("check", tmp_path)
    assert result.exit_code == 1
    assert "bad.job:1:1: error[GJ501]" in result.output
    assert "worse.job" not in result.output
    assert "2 files: 2 errors" in result.output


def test_rules_are_selected_and_ignored(tmp_path: Path) -> None:
    path = write(tmp_path, "LINE X 1\nQQ\n")
    assert gusjob("check", path, "--ignore", "GJ5,GJ102").exit_code == 0
    only = gusjob("check", path, "--select", "GJ1")
    assert "GJ102" in only.output
    assert "GJ501" not in only.output
    # The longest matching prefix wins: all of GJ5 but GJ502, and GJ102.
    some = gusjob("check", path, "--select", "GJ5", "--ignore", "GJ502", "--select", "GJ102")
    assert [c for c in ("GJ102", "GJ501", "GJ502") if c in some.output] == ["GJ102", "GJ501"]
    assert gusjob("check", path, "--select", "GJ999").exit_code == 2
    # A file that can't be read fails whatever is ignored.
    assert gusjob("check", tmp_path / "none.job", "--ignore", "GJ0").exit_code == 2


def test_statistics_count_iterations(tmp_path: Path) -> None:
    path = write(tmp_path, MARK + "FOR i FROM 1 TO 300\nLINE X (i)\nEND\n")
    result = gusjob("check", path, "--statistics")
    assert result.exit_code == 1
    assert "      150  GJ503  error    outside the field" in result.output
    counted = json.loads(gusjob("check", path, "--statistics", "--format", "json").stdout)
    assert counted["statistics"] == {"GJ503": 150}
    assert counted["diagnostics"][0]["count"] == 150
    assert counted["diagnostics"][0]["notes"][0]["message"] == "in the iteration where i = 151"


def test_explain() -> None:
    result = gusjob("explain", "gj402")
    assert result.exit_code == 0
    for text in ("GJ402 error: jump with the laser on", "The jump would be marked", "bad:", "    JUMP X 5", "good:"):
        assert text in result.output
    assert "GJ715" in gusjob("explain").output
    missing = gusjob("explain", "GJ4022")
    assert missing.exit_code == 2
    assert "did you mean GJ" in missing.output
    by_name = gusjob("explain", "Jump with the laser on")
    assert by_name.stdout == gusjob("explain", "jump-with-the-laser-on").stdout == result.stdout
    assert "did you mean jump-with-the-laser-on?" in gusjob("explain", "jump-with-laser").output


def test_explain_shows_a_message_with_values_and_whether_there_is_a_fix() -> None:
    shown = gusjob("explain", "GJ306").stdout
    assert "  off delay 50 us is shorter than on delay 60 us; it should usually be longer\n" in shown
    assert "`gusjob check --fix` corrects it" in shown
    assert "--fix" not in gusjob("explain", "GJ402").stdout
    for code in RULES:
        assert "{" not in gusjob("explain", code).stdout.split("\n\n")[1], code


def test_explain_json() -> None:
    explained = json.loads(gusjob("explain", "GJ306", "--format", "json").stdout)
    assert explained["schema"] == "gusjob-explain/1"
    rule = explained["rules"][0]
    assert (rule["code"], rule["name"], rule["fixable"]) == ("GJ306", "off-delay-below-on-delay", True)
    assert rule["message"] == "off delay 50 us is shorter than on delay 60 us; it should usually be longer"
    every = json.loads(gusjob("explain", "--format", "json").stdout)["rules"]
    assert [one["code"] for one in every] == list(RULES)
    assert {one["code"] for one in every if one["fixable"]} == set(FIXES)


def test_explain_loads_little() -> None:
    code = "import sys; from gusjob.cli import main; sys.argv[1:] = ['explain', 'GJ402']\ntry:\n    main()\n"
    code += "except SystemExit:\n    pass\nassert not {'numpy', 'lark'} & sys.modules.keys()"
    subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)


def test_diagnostics_of_an_included_file_name_it(tmp_path: Path) -> None:
    write(tmp_path, "VEL 100\nACC 2000000\n", "setup.job")
    top = write(tmp_path, 'INCLUDE "setup.job"\nLINE X 1\nLINE X 200\n')
    result = gusjob("check", top)
    assert "setup.job:2:5: error[GJ504]" in result.output
    assert "    2 | ACC 2000000" in result.output
    assert "x.job:1:1: note: included here" in result.output
    assert "x.job:3:8: error[GJ503]" in result.output
    found = json.loads(gusjob("check", top, "--format", "json").stdout)["diagnostics"]
    assert sorted(Path(f["path"]).name for f in found) == ["setup.job", "x.job"]


def test_compile_to_c(good: Path) -> None:
    result = gusjob("compile", good, "--format", "c")
    assert result.exit_code == 0
    assert "#include GUSJOB_HEADER" in result.stdout


def test_a_huge_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gusjob.frontend.source.MAX_FILE_MB", 0.001)
    result = gusjob("check", write(tmp_path, b"; " + b"x" * 2000))
    assert result.exit_code == 2
    assert "GJ003" in result.output


def test_run_prints_the_report(good: Path) -> None:
    result = gusjob("run", good)
    assert result.exit_code == 0
    assert result.output.splitlines()[1].startswith("OK, no warnings · 110 ms · laser on 55 ms · peak ")
    assert "2 segments in 1 stage" not in result.output
    tables = gusjob("run", good, "--table").output
    assert tables.startswith(result.output)
    assert "2 segments in 1 stage" in tables
    assert {"mark", "jump"} <= {word for line in tables.splitlines() for word in line.split()[1:2]}


def test_a_job_with_errors_is_not_run(tmp_path: Path) -> None:
    bad = write(tmp_path, MARK + "LASER ON\nLINE X 1\n")
    for command in ("run", "report", "compile"):
        result = gusjob(command, bad)
        assert result.exit_code == 1
        assert "GJ401" in result.output
        assert result.stdout == ""


def test_a_listing_with_refused_calls_is_reported(tmp_path: Path) -> None:
    text = "GT_BufLaserPrfCmd(1,200,0,0)\nGT_LnXY(1,1000,0,50,2,0,0)\nGT_CrdStart(1,0)\n"
    path = write(tmp_path, text, "a.gts")
    result = gusjob("report", path, "--format", "json")
    found = json.loads(result.stdout)
    assert found["totals"]["segments"] == 1
    assert "GJ701" in [f["code"] for f in found["diagnostics"]]
    assert result.exit_code == 1
    unread = gusjob("report", write(tmp_path, "what(\n" + text, "b.gts"), "--format", "json")
    assert (unread.exit_code, json.loads(unread.stdout)["totals"]) == (1, None)


def report(*args: object) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(gusjob("report", *args, "--format", "json").stdout)
    return found


def test_report_json(good: Path) -> None:
    found = report(good)
    assert found["schema"] == "gusjob-report/1"
    assert found["period_us"] == 250
    # JUMP: 5 mm at 100 mm/s, 10000 mm/s2: 10 ms and 0.5 mm up, 45 ms at speed, straight on into LINE, its mirror.
    totals = found["totals"]
    assert totals["segments"] == 2
    assert totals["duration_ms"] == pytest.approx(110)
    assert (totals["mark_mm"], totals["jump_mm"]) == (5, 5)
    (channel,) = totals["channels"]
    assert channel["unit"] == "%"
    assert channel["emission_ms"] == pytest.approx(55)
    assert channel["power_ms"] == pytest.approx(2750)
    assert (channel["power_max"], channel["joules"]) == (50, None)
    columns = found["segments"]
    assert columns["kind"] == ["jump", "mark"]
    assert columns["line"] == [5, 7]
    assert columns["x_mm"] == [5, 10]
    assert columns["start_ms"] == pytest.approx([0, 55])
    assert columns["vel_max_mm_s"] == pytest.approx([100, 100])
    assert columns["vel_mean_mm_s"] == pytest.approx([5 / 0.055, 5 / 0.055])
    assert columns["ch0_power_min"] == [None, 50]
    assert columns["ch0_joules"] == [None, None]
    assert len({len(c) for c in columns.values()}) == 1
    assert not any(name.startswith("ch1") for name in columns)
    assert "segments" not in report(good, "--summary")


def test_report_in_watts(good: Path, tmp_path: Path) -> None:
    profile = write(tmp_path, "[[laser]]\nchannel = 0\nrated_w = 30\n", "m.toml")
    found = report(good, "--machine", profile)
    # Half of 30 W for 55 ms.
    assert found["totals"]["channels"][0]["joules"] == pytest.approx(0.825)
    assert found["segments"]["ch0_joules"][1] == pytest.approx(0.825)


def test_report_csv(good: Path, tmp_path: Path) -> None:
    out = tmp_path / "r.csv"
    assert gusjob("report", good, "--format", "csv", "-o", out).exit_code == 0
    rows = list(csv.DictReader(io.StringIO(out.read_text(encoding="utf-8"))))
    assert [r["kind"] for r in rows] == ["jump", "mark"]
    assert [r["ch0_power_max"] for r in rows] == ["", "50.0"]
    summary = list(csv.DictReader(io.StringIO(gusjob("report", good, "--format", "csv", "--summary").output)))
    assert float(summary[0]["power_ms"]) == pytest.approx(2750)


def test_compile_formats(good: Path, tmp_path: Path) -> None:
    listing = gusjob("compile", good).stdout
    assert listing.splitlines()[-1] == "GT_CrdStart(1,0)"
    found = json.loads(gusjob("compile", good, "--format", "json").stdout)
    assert found["schema"] == "gusjob-calls/1"
    assert [c["call"] for c in found["calls"]][:2] == ["GT_SetAxisMode", "GT_LaserPowerMode"]
    assert found["buffered"]["call"] == [
        "GT_BufLaserPrfCmd", "GT_LnXY", "GT_BufLaserOn", "GT_LnXY", "GT_BufLaserOff",
    ]  # fmt: skip
    assert found["buffered"]["x"] == [0, 5000, 0, 10000, 0]
    out = tmp_path / "a.gts"
    gusjob("compile", good, "-o", out)
    assert report(out)["totals"] == report(good)["totals"]


def test_outputs_that_can_not_be_written(good: Path, tmp_path: Path) -> None:
    before = good.read_bytes()
    for command in ("compile", "report"):
        over = gusjob(command, good, "--format", "json", "-o", good)
        assert over.exit_code == 2
        assert "name another" in over.output
        nowhere = gusjob(command, good, "-o", tmp_path / "no" / "a.json")
        assert nowhere.exit_code == 2
        assert "can't write" in nowhere.output
    assert good.read_bytes() == before


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("command", [["report"], ["compile"], ["check"], ["explain", "GJ402"]])
def test_a_full_disk_is_no_traceback(good: Path, command: list[str], unbuffered: str) -> None:
    good.write_bytes(good.read_bytes() + b"LET unused = 1\n")
    arguments = command if command[0] == "explain" else [*command, str(good)]
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run(
            [sys.executable, "-m", "gusjob", *arguments], stdout=full, stderr=subprocess.PIPE, text=True, check=False,
            env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
        )  # fmt: skip
    assert done.returncode == 2
    assert "Traceback" not in done.stderr and "Exception" not in done.stderr
    assert "standard output: can't write: no space left on device" in done.stderr


def test_a_diagnostic_is_printed_once(tmp_path: Path) -> None:
    path = write(tmp_path, MARK + "LASER POWER 100\nLASER ON\nLINE X 1\nLASER OFF\n")
    assert gusjob("report", path).output.count("GJ202") == 1


def test_an_error_in_the_profile_is_located_there(good: Path, tmp_path: Path) -> None:
    profile = write(tmp_path, "period = 3\n", "m.toml")
    result = gusjob("check", good, "--machine", profile)
    assert result.exit_code == 1
    assert f"{profile}:1:1: error[GJ602]" in result.output
    assert "period_us" in result.output
    assert gusjob("run", good, "--machine", tmp_path / "none.toml").exit_code == 2
    write(tmp_path, "period_us = 10\n", "gusjob.toml")
    assert report(good)["period_us"] == 10


def test_a_job_does_not_control_the_terminal(tmp_path: Path) -> None:
    result = gusjob("check", write(tmp_path, "LINE X \x1b[31m\x07 ; \x1b]0;owned\x07\n"))
    assert result.exit_code == 1
    assert "\x1b" not in result.output
    assert "\x07" not in result.output


def test_help_names_every_command() -> None:
    result = gusjob("--help")
    for name in ("check", "compile", "run", "report"):
        assert name in result.output
        assert gusjob(name, "--help").exit_code == 0
    assert gusjob("burn").exit_code == 2


def test_as_a_module_and_into_a_closed_pipe() -> None:
    job = ROOT / "jobs" / "engrave.job"
    with subprocess.Popen(
        [sys.executable, "-m", "gusjob", "compile", str(job)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline().startswith(b"GT_SetAxisMode")
        process.stdout.close()
        assert b"Traceback" not in process.stderr.read()


def test_an_output_is_complete_or_absent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After an interrupt or a full disk the older file stays, and no other file is left."""
    output = write(tmp_path, "old", "out.txt")

    def pieces(error: BaseException) -> Iterator[bytes]:
        yield b"new"
        raise error

    for error in (KeyboardInterrupt(), OSError(28, "No space left on device")):
        with pytest.raises(SystemExit) as left:
            common.write(pieces(error), output)
        assert left.value.code == 2
        with pytest.raises(SystemExit):
            common.write(pieces(error), tmp_path / "other.txt")
    with pytest.raises(ZeroDivisionError):
        common.write(pieces(ZeroDivisionError()), output)
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {"out.txt": "old"}
    output.chmod(0o640)
    common.write([b"new"], output)
    assert output.read_text() == "new"
    assert os.name != "posix" or output.stat().st_mode & 0o777 == 0o640


def test_a_file_name_does_not_control_the_terminal(tmp_path: Path, good: Path) -> None:
    for words in (["watch", tmp_path / "no\x1b[31m"], ["trace", good, "-o", tmp_path / "no" / "x\x1b[31m"]):
        done = gusjob(*words)
        assert done.exit_code == 2
        assert "\x1b" not in done.output


HEAD = b'{"schema":"gusjob-journal/2","job":"x"}'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (b'{"schema":"gusjob-journal/2","job":"a.j', "it is damaged"),
        (with_checksums([HEAD, b'{"t":0.1,"part":1}']), "it is damaged"),
        (HEAD + b'\n{"t":0.1,"part":1}\n', "it is damaged"),
        (b'{"schema":"gusjob-journal/1","job":"x"}\n', "another version"),
    ],
)
def test_a_damaged_journal(tmp_path: Path, text: bytes, said: str) -> None:
    (tmp_path / "x.journal").write_bytes(text)
    done = gusjob("report", tmp_path / "x.journal")
    assert done.exit_code == 2
    assert said in done.output


@pytest.mark.skipif(sys.platform != "linux", reason="names are text elsewhere")
def test_a_file_name_that_is_not_text(tmp_path: Path) -> None:
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/\xff\xfe.job"))
    path.write_text(GOOD, encoding="utf-8")
    for form in ("table", "json", "csv", "markdown", "html", "parquet"):
        assert gusjob("report", path, "--format", form, "-o", tmp_path / "out").exit_code == 0
    for form in ("vcd", "csv", "parquet", "npz"):
        assert gusjob("trace", path, "--format", form, "-o", tmp_path / "out").exit_code == 0
    assert json.loads(gusjob("report", path, "--format", "json").stdout)["job"].endswith("\\udcff\\udcfe.job")


NO_TEXT = b"LINE X \xe9\n"
"""A text that can't be read."""


@pytest.mark.parametrize("text", [MARK.encode() + b"LASER POWER 120\n", b"what(\n", NO_TEXT, None])
def test_json_of_a_job_that_was_not_run(tmp_path: Path, text: bytes | None) -> None:
    """What reads JSON finds the diagnostics of `check`, and null in place of what was not computed."""
    path, out = tmp_path / "x.job", tmp_path / "out.json"
    if text is not None:
        path.write_bytes(text)
    checked = gusjob("check", path, "--format", "json")
    wanted = {"job": str(path), "diagnostics": json.loads(checked.stdout)["diagnostics"]}
    period_us = None if text in (None, NO_TEXT) else 250
    totals = {"schema": "gusjob-report/1", "period_us": period_us, "totals": None}
    for words, fields in (
        (["report"], {**totals, "segments": None, "marks": None}),
        (["report", "--summary"], totals),
        (["compile"], {"schema": "gusjob-calls/1", "calls": None, "buffered": None}),
    ):
        done = gusjob(*words, path, "-o", out)
        assert done.exit_code == checked.exit_code > 0
        assert json.loads(out.read_bytes()) == wanted | fields
        assert f"[{wanted['diagnostics'][0]['code']}]" in done.stderr
    again = gusjob("report", write(tmp_path, GOOD, "good.job"), "--against", tmp_path / "report.json")
    assert again.exit_code == 2
    gusjob("report", path, "-o", out)
    again = gusjob("report", tmp_path / "good.job", "--against", out)
    message = f"gusjob: {out}: this is the report of a job with errors, which was not simulated\n"
    assert (again.exit_code, again.stderr) == (2, message)


@pytest.mark.parametrize("words", ["report -o x.csv", "report -o x.parquet", "report -o x.txt", "compile -o x.gts",
                                   "compile -o x.c", "plot -o x.svg", "trace -o x.vcd", "trace -o x.csv"])  # fmt: skip
def test_formats_without_diagnostics_are_not_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    output = write(tmp_path, "old", words.split()[-1])
    write(tmp_path, MARK + "LASER POWER 120\n", "bad.job")
    for name, code in (("bad.job", 1), ("none.job", 2)):
        assert gusjob(words.split()[0], name, *words.split()[1:]).exit_code == code
        assert output.read_text(encoding="utf-8") == "old"


def test_the_diagnostics_of_calls(tmp_path: Path) -> None:
    """They are in the JSON also if there are no errors."""
    path = write(tmp_path, "LET unread = 1\n" + GOOD)
    found = json.loads(gusjob("compile", path, "--format", "json").stdout)
    assert [f["severity"] for f in found["diagnostics"]] == ["note"]


def test_without_arguments(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What only reads takes the current folder; what writes does not guess."""
    monkeypatch.chdir(tmp_path)
    empty = gusjob("check")
    assert (empty.exit_code, "there is no .job or .gts file in this folder" in empty.stderr) == (2, True)
    write(tmp_path, "line x 1\n", "a.job")
    (tmp_path / "in").mkdir()
    write(tmp_path / "in", "GT_QQ(1)\n", "b.gts")
    done = gusjob("check", "--format", "json")
    assert {Path(f["path"]).as_posix() for f in json.loads(done.stdout)["diagnostics"]} == {"a.job", "in/b.gts"}
    for words, code, text in (
        ("fmt --check", 1, "1 file: 1 would change"),
        ("fmt --diff", 1, "1 file: 1 would change"),
        ("fmt", 2, "fmt rewrites files: name them"),
        ("check --fix", 2, "--fix rewrites files: name them"),
        ("check --diff", 1, "2 files:"),
    ):
        found = gusjob(*words.split())
        assert (found.exit_code, text in found.stderr) == (code, True), (words, found.stderr)
    assert (tmp_path / "a.job").read_text(encoding="utf-8") == "line x 1\n"
    assert gusjob("fmt", ".").exit_code == 0
    assert (tmp_path / "a.job").read_text(encoding="utf-8") == "LINE X 1\n"


def test_exit_zero(tmp_path: Path) -> None:
    bad = write(tmp_path, "QQ\n", "bad.job")
    done = gusjob("check", "--exit-zero", bad)
    assert (done.exit_code, "error[GJ102]" in done.stdout) == (0, True)
    assert gusjob("check", "--exit-zero", "--format", "json", bad).exit_code == 0
    assert gusjob("check", "--exit-zero", bad, tmp_path / "none.job").exit_code == 2
    assert gusjob("check", "--exit-zero", "--diff", write(tmp_path, GOOD.replace("LASER OFF\n", ""))).exit_code == 0
    both = gusjob("check", "--exit-zero", "--strict", bad)
    assert (both.exit_code, "exclude each other" in both.stderr) == (2, True)


def test_too_little_memory_is_no_traceback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def too_much(*_: object, **__: object) -> None:
        raise MemoryError

    job = tmp_path / "part.job"
    job.write_text("DWELL 1\n", encoding="utf-8")
    monkeypatch.setattr(sys, "argv", ["gusjob", "check", str(job)])
    monkeypatch.setattr("gusjob.pipeline.load", too_much)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert "not enough memory" in capsys.readouterr().err
