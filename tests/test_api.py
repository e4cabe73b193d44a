"""The public Python interface: the example of docs/python.md runs, and numbers equal closed forms."""

from __future__ import annotations

import json
import os
import pickle
import pydoc
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.cli import gusjob as run_gusjob
from support.cli import write
from support.documents import blocks, text_of
from support.tools import MARK, ROOT

import gusjob
from gusjob.lsp.diagnostics import diagnose
from gusjob.lsp.workspace import Workspace

JOB = "LOOKAHEAD OFF\n" + MARK + "LASER POWER 40\nJUMP X 10\nLASER ON\nLINE X 20\nLASER OFF\n"


def test_the_example_of_the_guide_runs(tmp_path: Path) -> None:
    example = "".join(blocks(text_of("docs/python.md"), "python"))
    shutil.copytree(ROOT / "jobs", tmp_path / "jobs")
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", example],
        cwd=tmp_path, capture_output=True, text=True, encoding="utf-8", check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert "GT_SetAxisMode(7,1)" in done.stdout and "3423.67" in done.stdout and "\n8 8mm " in done.stdout
    assert (tmp_path / "co2_cut.png").read_bytes().startswith(b"\x89PNG")


def test_a_run_in_figures(tmp_path: Path) -> None:
    """Twice 10 mm with 100 mm/s and 10000 mm/s2: 110 ms each; the second at 40 %."""
    job = gusjob.read(write(tmp_path, JOB))
    assert job.is_clean and job.diagnostics == ()
    assert job.calls()[-2:] == ["GT_BufLaserOff(1,0,0)", "GT_CrdStart(1,0)"]
    run = job.simulate()
    assert run.totals["duration_ms"] == pytest.approx(220)
    segments = run.segments()
    assert segments["kind"].tolist() == ["jump", "mark"]
    assert segments["ch0_power_ms"] == pytest.approx([0, 4400])
    frame = run.frame()
    assert frame["kind"].to_list() == ["jump", "mark"] and frame["ch0_power_max"].to_list() == [None, 40]
    assert len(run.marks()["line"]) == 1
    ticks = run.ticks()
    assert ticks["ch0_emission_us"].sum() == pytest.approx(110_000)
    pieces = list(run.tick_pieces())
    assert all((np.concatenate([p[name] for p in pieces]) == column).all() for name, column in ticks.items())
    assert [type(axes).__name__ for axes in run.plot(by="order").axes][:1] == ["Axes"]


def test_diagnostics_are_data_and_reported_once(tmp_path: Path) -> None:
    job = gusjob.read(write(tmp_path, JOB.replace("LINE X 20", "LINE X 200")))
    assert [(f.line, f.severity, f.code) for f in job.diagnostics] == [(8, "error", "GJ503")]
    assert not job.is_clean
    for asked in (job.calls, job.simulate, job.simulate):
        with pytest.raises(gusjob.JobError, match=r"1 error: .*GJ503"):
            asked()
    assert len(job.diagnostics) == 1
    warned = gusjob.read(write(tmp_path, JOB.replace("LASER POWER 40", "LASER POWER 100")))
    for _ in range(2):
        warned.calls()
        warned.simulate()
    assert [f.code for f in warned.diagnostics] == ["GJ202"]
    write(tmp_path, "[budget]\npower_pct = 30\n", "gusjob.toml")
    dear = gusjob.read(write(tmp_path, JOB))
    assert [dear.simulate().totals["segments"] for _ in range(2)] == [2, 2]
    assert [f.code for f in dear.diagnostics] == ["GJ606"]
    assert dear.calls()


def test_scanner_machine_and_listing(tmp_path: Path) -> None:
    profile = write(tmp_path, "field_x_mm = [-5, 5]\n", "small.toml")
    path = write(tmp_path, JOB)
    assert [f.code for f in gusjob.read(path, machine=profile).diagnostics] == ["GJ503", "GJ503"]
    late = gusjob.read(path, scanner="delay:5ms").simulate().marks()
    # 5 ms behind a start from rest with 10000 mm/s2 the command is 0.125 mm on, the beam not yet.
    assert late["off_error_um"] == pytest.approx([-125.0])
    with pytest.raises(ValueError, match="is not a scanner"):
        gusjob.read(path, scanner="fast")
    listing = write(tmp_path, "\n".join(gusjob.read(path).calls()), "x.gts")
    assert gusjob.read(listing).simulate().totals["duration_ms"] == pytest.approx(220)


def test_what_can_not_be_read(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"none\.job"):
        gusjob.read(tmp_path / "none.job")
    with pytest.raises(FileNotFoundError, match=r"none\.toml"):
        gusjob.read(write(tmp_path, JOB), machine=tmp_path / "none.toml")
    with pytest.raises(FileNotFoundError, match=r"none\.toml"):
        gusjob.read_text(JOB, machine=tmp_path / "none.toml")
    with pytest.raises(IsADirectoryError if os.name == "posix" else PermissionError):
        gusjob.read(tmp_path)
    with pytest.raises(OSError, match="GJ002"):
        gusjob.read(write(tmp_path, b"\xff\xfeL\0"))
    with pytest.raises(OSError, match="GJ002"):
        gusjob.read_text("LINE X\0 10")
    with pytest.raises(OSError, match="GJ002"):
        gusjob.read_text("LINE X 1 ; \ud800")
    with pytest.raises(AttributeError):
        _ = gusjob.nothing


def test_messages_in_chinese(tmp_path: Path) -> None:
    path = tmp_path / "a.job"
    path.write_text("LNE X 1\n", encoding="utf-8")
    try:
        gusjob.set_language("zh")
        (diagnostic,) = gusjob.read(path).diagnostics
        assert diagnostic.message == "没有以 'LNE' 开头的语句；是否想写 LINE？"
        assert str(diagnostic) == f"{path}:1:1: 错误[GJ102]: {diagnostic.message}"
        with pytest.raises(gusjob.JobError, match="有 1 个错误"):
            gusjob.read(path).simulate()
    finally:
        gusjob.set_language("en")
    (diagnostic,) = gusjob.read(path).diagnostics
    assert diagnostic.message == "no statement begins with 'LNE'; did you mean LINE?"


def test_a_colour_that_is_none_is_named() -> None:
    run = gusjob.read(ROOT / "jobs" / "co2_cut.job").simulate()
    with pytest.raises(ValueError, match="'foo' is none of power, energy, velocity, order"):
        run.plot(by="foo")  # type: ignore[arg-type]  # As somebody without a type checker writes.


@pytest.mark.parametrize("channel", [2, -1, "0"])
def test_a_channel_that_is_none_is_refused(channel: int) -> None:
    run = gusjob.read_text(JOB).simulate()
    with pytest.raises(ValueError, match="is no channel: 0 or 1"):
        run.plot(channel=channel)


ENDS = "LASER MODE DUTY CARRIER 20kHz\nVEL 500\nACC 5000\nLINE X 0.1 END 400\nLINE X 0.2\n"
"""Only the planner sees that this END can't be reached."""


@pytest.mark.parametrize(
    "text",
    [ENDS, JOB, JOB.replace("LINE X 20", "LINE X 200"), "GT_BufLaserOn(1,0,5)\n", JOB + "DWELL 1 ; allow GJ404: x\n"],
)
def test_api_cli_and_editor_agree_on_what_is_clean(tmp_path: Path, text: str) -> None:
    path = write(tmp_path, text, "x.gts" if text.startswith("GT_") else "x.job")
    job = gusjob.read(path)
    done = run_gusjob("check", "--format", "json", path)
    checked = [(d["line"], d["column"], d["code"], d["severity"]) for d in json.loads(done.stdout)["diagnostics"]]
    assert [(d.line, d.column, d.code, d.severity) for d in job.diagnostics] == checked
    assert job.is_clean is (done.exit_code == 0)
    edited = diagnose(str(path), path, path.read_bytes(), Workspace({}))
    assert [(d.span.line, d.span.column, d.rule.code, d.severity.value) for d in edited.diagnostics] == checked
    in_memory = gusjob.read_text(text, name=path)
    assert in_memory.diagnostics == job.diagnostics and in_memory.is_clean is job.is_clean


@pytest.mark.parametrize(
    "table", ['ignore = ["GJ503"]', 'select = ["GJ4"]', '[[check.path]]\nglob = "x.*"\nignore = ["GJ"]']
)
def test_rules_that_the_profile_leaves_out(tmp_path: Path, table: str) -> None:
    write(tmp_path, f"[check]\n{table}\n", "gusjob.toml")
    path = write(tmp_path, JOB.replace("LINE X 20", "LINE X 200"))
    job = gusjob.read(path)
    assert job.diagnostics == () and job.is_clean and repr(job).endswith(": clean>")
    assert run_gusjob("check", path).exit_code == 0
    for asked in (job.calls, job.simulate):  # As the commands, which refuse it all the same.
        with pytest.raises(gusjob.JobError, match=r"1 error: .*GJ503") as refused:
            asked()
        assert [d.code for d in refused.value.diagnostics] == ["GJ503"]
    assert run_gusjob("compile", path).exit_code == 1


def test_an_error_passes_from_process_to_process() -> None:
    with pytest.raises(gusjob.JobError) as refused:
        gusjob.read_text("LINE X", name="a.job").calls()
    copy = pickle.loads(pickle.dumps(refused.value))
    assert str(copy) == str(refused.value) and copy.diagnostics == refused.value.diagnostics


def test_an_end_that_the_planner_refuses_is_an_error() -> None:
    job = gusjob.read_text(ENDS)
    assert not job.is_clean and "GJ506" in {d.code for d in job.diagnostics}
    with pytest.raises(gusjob.JobError, match="GJ506"):
        job.calls()


def test_text_includes_from_the_folder_of_its_name(tmp_path: Path) -> None:
    write(tmp_path, "LINE X 5\n", "part.job")
    job = gusjob.read_text(MARK + 'INCLUDE "part.job"\n', name=tmp_path / "top.job")
    assert job.is_clean and job.calls()[-2].startswith("GT_LnXY(1,5000,0,")
    assert gusjob.read_text("GT_GetHSIOOpt(&v,0);\n", name="x.c").simulate().totals["segments"] == 0


def test_the_module_shows_its_interface_and_nothing_else() -> None:
    assert set(gusjob.__all__) <= set(dir(gusjob)) and "TYPE_CHECKING" not in dir(gusjob)
    shown = pydoc.render_doc(
        gusjob,
        renderer=pydoc.plaintext,  # type: ignore[attr-defined]  # typeshed lacks it.
    )
    for name in (
        "read(path",
        "read_text(text",
        "class JobFile",
        "class Simulation",
        "on_error_um",
        "clamped_ms",
        "power_per_mm_rms_pct",
    ):
        assert name in shown, name
    assert gusjob.Run is gusjob.Simulation and gusjob.Job is gusjob.JobFile and gusjob.speak is gusjob.set_language


def test_documented_columns_are_those_that_come(tmp_path: Path) -> None:
    run = gusjob.read(write(tmp_path, JOB), scanner="delay:250us").simulate()
    for table, doc in ((run.segments(), gusjob.Simulation.segments), (run.marks(), gusjob.Simulation.marks)):
        assert [name for name in table if name not in (doc.__doc__ or "")] == []
    assert [name for name in run.ticks() if name not in (gusjob.Simulation.ticks.__doc__ or "")] == []
    described = gusjob.Simulation.totals.__doc__ or ""
    names = [*run.totals, *run.totals["channels"][0], *run.totals["marking"][0]]
    assert [name for name in names if name not in described] == []


def test_results_show_what_they_are(tmp_path: Path) -> None:
    job = gusjob.read_text(JOB.replace("LINE X 20", "LINE X 200"), name="<b>.job")
    assert repr(job) == "<gusjob.JobFile <b>.job: 1 error>"
    html = job._repr_html_()
    assert "GJ503" in html and "<b>" not in html and "&lt;b&gt;" in html
    run = gusjob.read(write(tmp_path, JOB)).simulate()
    assert repr(run).endswith("x.job: 2 segments, 220 ms, 10 mm marked, channel 0: 110 ms emission up to 40 %>")
    assert "<td>mark_mm</td><td>10</td>" in run._repr_html_()
    headline = run.answer.splitlines()[1]
    assert headline.startswith("OK, ") and headline in run._repr_html_()
