"""INCLUDE: what is read and what never is, and lines that keep their file."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.tools import stream_in

from gusjob.controllers.gus.model import simulate_stream
from gusjob.pipeline import examine_file
from gusjob.report.rows import make_report

HEAD = "LASER MODE DUTY CARRIER 10\nVEL 100\nACC 5000\nLASER POWER 30\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The job's folder, with a job outside of it."""
    inside = tmp_path / "inside"
    (inside / "parts").mkdir(parents=True)
    (tmp_path / "outside.job").write_text("LINE X 1\n", encoding="utf-8")
    return inside


def write(path: Path, text: str) -> Path:
    path.write_bytes(text.encode())
    return path


def localized(top: Path) -> list[tuple[str, str]]:
    return [(f.rule.code, f.message) for f in examine_file(top, None).diagnostics]


@pytest.mark.parametrize("name", ["../outside.job", "parts/../../outside.job", "..\\outside.job"])
def test_nothing_outside_the_folder_is_read(folder: Path, name: str) -> None:
    ((code, message),) = localized(write(folder / "top.job", f'INCLUDE "{name}"\n'))
    assert code == "GJ138"
    assert "outside the job's folder" in message


def test_links_do_not_lead_outside(folder: Path) -> None:
    link = folder / "link.job"
    try:
        link.symlink_to(folder.parent / "outside.job")
    except OSError:
        pytest.skip("this system makes no links")
    ((code, message),) = localized(write(folder / "top.job", 'INCLUDE "link.job"\n'))
    assert code == "GJ138"
    assert "outside the job's folder" in message


@pytest.mark.parametrize("name", ["/outside.job", "C:\\outside.job", "\\\\host\\outside.job"])
def test_only_relative_names(folder: Path, name: str) -> None:
    ((code, message),) = localized(write(folder / "top.job", f'INCLUDE "{name}"\n'))
    assert code == "GJ138"
    assert "relative" in message


def test_a_cycle_ends(folder: Path) -> None:
    write(folder / "parts" / "a.job", 'INCLUDE "b.job"\n')
    write(folder / "parts" / "b.job", 'INCLUDE "a.job"\n')
    assert [m for _, m in localized(write(folder / "top.job", 'INCLUDE "parts/a.job"\n'))] == [
        'can\'t include "a.job": it includes itself'
    ]


def test_lines_are_those_of_their_files(folder: Path) -> None:
    write(
        folder / "parts" / "mark.job", '\ufeff; a part\r\nINCLUDE "move.job"\r\nLASER ON\r\nLINE Y 2\r\nLASER OFF\r\n'
    )
    write(folder / "parts" / "move.job", "JUMP X 5\n")
    top = write(folder / "top.job", HEAD + 'REPEAT 2\nINCLUDE "parts/mark.job"\nJUMP Y 0\nEND\nLINE X 0\n')
    loaded = examine_file(top, None)
    assert loaded.diagnostics == ()
    stream = stream_in(loaded)
    assert stream is not None
    trace, _ = simulate_stream(stream, loaded.machine)
    assert trace is not None
    report = make_report(trace, loaded.machine, loaded.files)
    names = [Path(name).name for name in report.notes["files"]]
    where = zip(report.columns["file"].tolist(), report.columns["line"].tolist(), strict=True)
    iteration = [("move.job", 1), ("mark.job", 4), ("top.job", 7)]
    assert [(names[file], line) for file, line in where] == [*iteration, *iteration, ("top.job", 9)]


def test_the_last_line_of_a_file_is_its_own(folder: Path) -> None:
    """Two files one after the other, of which the first ends with a segment, without a line end."""
    write(folder / "a.job", "LINE X 5")
    write(folder / "b.job", "LINE X 10\n")
    loaded = examine_file(
        write(folder / "top.job", HEAD + 'LASER ON\nINCLUDE "a.job"\nINCLUDE "b.job"\nLASER OFF\n'), None
    )
    assert loaded.diagnostics == ()
    stream = stream_in(loaded)
    assert stream is not None
    trace, _ = simulate_stream(stream, loaded.machine)
    assert trace is not None
    report = make_report(trace, loaded.machine, loaded.files)
    names = [Path(report.notes["files"][file]).name for file in report.columns["file"].tolist()]
    assert list(zip(names, report.columns["line"].tolist(), strict=True)) == [("a.job", 1), ("b.job", 1)]


@pytest.mark.parametrize(("first", "second"), [("a1", "a01"), ("a1.5", "a1.50"), ("p 007", "p 7")])
def test_digits_of_a_name_are_not_numbers(folder: Path, first: str, second: str) -> None:
    """Names whose digits have one value are two files."""
    write(folder / f"{first}.job", "DWELL 1\n")
    write(folder / f"{second}.job", "DWELL 2\n")
    for names in ((first, second), (second, first)):
        top = write(folder / "top.job", "".join(f'INCLUDE "{name}.job"\n' for name in names))
        stream = stream_in(examine_file(top, None))
        assert stream is not None
        assert stream.buffered.p.tolist() == [1 if name == first else 2 for name in names]
