"""The public Python interface: the example of docs/python.md runs, and numbers equal closed forms."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.cli import write
from support.documents import blocks, text_of
from support.tools import MARK, ROOT

import gusjob

JOB = "LOOKAHEAD OFF\n" + MARK + "LASER POWER 40\nJUMP X 10\nLASER ON\nLINE X 20\nLASER OFF\n"


def test_the_example_of_the_guide_runs(tmp_path: Path) -> None:
    (example,) = blocks(text_of("docs/python.md"), "python")
    shutil.copytree(ROOT / "jobs", tmp_path / "jobs")
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", example],
        cwd=tmp_path, capture_output=True, text=True, encoding="utf-8", check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert "GT_SetAxisMode(7,1)" in done.stdout and "3423.67" in done.stdout
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
    ticks = list(run.ticks())
    assert np.concatenate([t["ch0_emission_us"] for t in ticks]).sum() == pytest.approx(110_000)
    assert [type(axes).__name__ for axes in run.plot(by="order").axes][:1] == ["Axes"]


def test_faults_are_data_and_told_once(tmp_path: Path) -> None:
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
    with pytest.raises(OSError, match="no such file"):
        gusjob.read(tmp_path / "none.job")
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
