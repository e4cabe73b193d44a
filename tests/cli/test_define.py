"""-D NAME=VALUE as users give it: what the outputs say about it, and where it is refused."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result
from support.tools import MARK

import gusjob
from gusjob.cli import cli

LETS = "LET dose = 40%\nLET speed = 100mm/s\n"
TEXT = LETS + MARK + "LASER POWER (dose)\nVEL (speed)\nLASER ON\nLINE X 5\nLASER OFF\n"
DEFINED = ("-D", "dose=60%", "--define", "speed=20")
OVERRIDES = {"dose": "60%", "speed": "20"}


@pytest.fixture
def job(tmp_path: Path) -> Path:
    path = tmp_path / "x.job"
    path.write_text(TEXT, encoding="utf-8")
    return path


def run(*args: object) -> Result:
    return CliRunner().invoke(cli, [str(a) for a in args], catch_exceptions=False)


def test_the_job_is_left_as_it_is_and_every_output_names_the_values(job: Path, tmp_path: Path) -> None:
    report = json.loads(run("report", job, *DEFINED, "--format", "json").stdout)
    assert report["overrides"] == OVERRIDES
    assert report["totals"]["channels"][0]["power_max"] == 60
    assert report["segments"]["vel_max_mm_s"] == pytest.approx([20])
    assert json.loads(run("check", job, *DEFINED, "--format", "json").stdout)["overrides"] == OVERRIDES
    for command in ("report", "run"):
        assert run(command, job, *DEFINED).stdout.splitlines()[0] == f"{job}  -D dose=60%, speed=20"
    markdown = run("report", job, *DEFINED, "--format", "markdown").stdout
    assert markdown.splitlines()[2] == "-D `dose=60%, speed=20`"
    listing = run("compile", job, *DEFINED).stdout
    assert listing.startswith("// -D dose=60%, speed=20\n")
    assert "GT_BufLaserPrfCmd(1,60,0,0)" in listing
    assert json.loads(run("compile", job, *DEFINED, "--format", "json").stdout)["overrides"] == OVERRIDES
    assert " * -D dose=60%, speed=20\n" in run("compile", job, *DEFINED, "--format", "c").stdout
    page = tmp_path / "x.html"
    assert run("report", job, *DEFINED, "-o", page).exit_code == 0
    assert "-D dose=60%, speed=20</span>" in page.read_text(encoding="utf-8")
    vcd = run("trace", job, *DEFINED).stdout
    assert "-D dose=60%, speed=20" in vcd.partition("$end")[0]
    assert job.read_text(encoding="utf-8") == TEXT
    # The listing is a listing: it reads as the job did.
    path = tmp_path / "x.gts"
    path.write_text(listing, encoding="utf-8")
    assert gusjob.read(path).simulate().totals == gusjob.read(job, overrides=OVERRIDES).simulate().totals


def test_parquet_and_npz_traces(job: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    for command, name in (("trace", "t.parquet"), ("report", "r.parquet")):
        assert run(command, job, *DEFINED, "-o", tmp_path / name).exit_code == 0
        assert json.loads(parquet.read_schema(tmp_path / name).metadata[b"overrides"]) == OVERRIDES


def test_without_it_no_output_mentions_it(job: Path) -> None:
    for args in (("report",), ("report", "--format", "json"), ("compile",), ("compile", "--format", "c"), ("trace",)):
        shown = run(args[0], job, *args[1:]).stdout
        assert "overrides" not in shown
        assert "-D " not in shown


def test_operators_in_a_c_comment(job: Path) -> None:
    text = run("compile", job, "-D", "speed=((2**3*100mm/s)%700mm/s-5mm/s)", "--format", "c").stdout
    assert text.splitlines()[2] == " * -D speed=((2**3*100mm/s)%700mm/s-5mm/s)"
    assert text.index("*/") == text.index(" */\n") + 1


def test_the_comparison_names_changed_values(job: Path, tmp_path: Path) -> None:
    old = tmp_path / "old.json"
    run("report", job, "-D", "dose=30%", "-o", old)
    result = run("report", job, *DEFINED, "--against", old, "--format", "json")
    changes = [
        {"name": "dose", "old": "30%", "new": "60%"},
        {"name": "speed", "old": None, "new": "20"},
    ]
    assert json.loads(result.stdout)["against"]["overrides"] == changes
    lines = run("report", job, *DEFINED, "--against", old).stdout.splitlines()
    assert "  -D dose: 30% -> 60%" in lines
    assert "  -D speed=20, which the earlier report does not have" in lines
    assert "  the earlier report has -D dose=30%" in run("report", job, "--against", old).stdout.splitlines()
    # Another value alone is no change of the run.
    assert run("report", job, "-D", "dose=(15% * 2)", "--against", old).exit_code == 0
    found = json.loads(old.read_bytes())
    old.write_text(json.dumps(found | {"overrides": {"dose": 3}}), encoding="utf-8")
    refused = run("report", job, "--against", old)
    assert (refused.exit_code, "overrides contains a value that is not a JSON string" in refused.stderr) == (2, True)


@pytest.mark.parametrize(
    ("args", "code", "said"),
    [
        (["check", "-D", "dose"], 2, "dose has no =: write NAME=VALUE"),
        (["check", "-D", "dose=6x"], 2, "dose=6x can't be read"),
        (["check", "-D", "dose=1", "-D", "dose=2"], 2, "dose is given twice: 1 and 2"),
        (["check", "-D", "dos=1"], 1, "error[GJ160]: -D dos: the job does not set dos with LET"),
        (["compile", "-D", "dos=1"], 1, "did you mean dose?"),
        (["check", "--fix", "-D", "dose=1"], 2, "--fix and --diff can't be combined with -D"),
        (["check", "--diff", "-D", "dose=1"], 2, "--fix and --diff can't be combined with -D"),
        (["check", "-D", "dose=500"], 1, "note: dose is 500 by -D, not as written here"),
    ],
)
def test_refusals(job: Path, args: list[str], code: int, said: str) -> None:
    result = run(*args, job)
    assert result.exit_code == code
    assert said in result.output


def test_the_interface_takes_numbers_and_texts() -> None:
    values: list[tuple[Any, float]] = [("60%", 60), (55, 55), (12.5, 12.5), (1e-3, 1e-3)]
    values += [(np.float32(0.5), 0.5), (np.int8(7), 7)]
    for value, power in values:
        file = gusjob.read_text(TEXT, overrides={"dose": value})
        assert file.simulate().totals["channels"][0]["power_max"] == power
    assert gusjob.read_text(TEXT, overrides={"dose": 12.50}).overrides == {"dose": "12.5"}
    assert gusjob.read_text(TEXT, overrides={}).overrides == {}
    for wrong in (True, float("nan"), float("inf"), None, [1], "", "6x", "1;2"):
        with pytest.raises(ValueError, match="value"):
            gusjob.read_text(TEXT, overrides={"dose": wrong})  # type: ignore[dict-item]
    unknown = gusjob.read_text(TEXT, overrides={"dos": 1})
    assert [d.code for d in unknown.diagnostics if d.severity == "error"] == ["GJ160"]
    with pytest.raises(gusjob.JobError, match="GJ160"):
        unknown.simulate()


def test_all_commands_have_it() -> None:
    for command in ("check", "compile", "run", "report", "plot", "trace", "watch"):
        assert re.search(r"-D, --define NAME=VALUE", run(command, "--help").stdout), command
