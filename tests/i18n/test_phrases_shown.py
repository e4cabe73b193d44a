"""Output for people can be translated: reports, comparisons, tune, devices, run, watch, errors of a run.

In a language of dots only the words of the job, of files, units and options are left.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from functools import cache
from itertools import product
from pathlib import Path
from types import SimpleNamespace

import click
import pytest
from click.testing import CliRunner
from msgspec.structs import replace
from rich.cells import cell_len
from rich.console import Console
from support.controller import build, needs_controller
from support.journals import with_checksums
from support.tools import MARK, ROOT, calls_of, stream_of

from gusjob.cli import (
    devices_command,
    plot_command,
    report_command,
    run_command,
    trace_command,
    tune_command,
    watch_command,
)
from gusjob.cli.hardware import _laser_text
from gusjob.cli.page import too_long
from gusjob.cli.panel import panel
from gusjob.cli.progress_lines import plain_line
from gusjob.cli.run_display import STOP_KEYS
from gusjob.config.machine import Abi
from gusjob.controllers.control import Phase
from gusjob.controllers.gus.calls import Call
from gusjob.controllers.gus.driver import inspection
from gusjob.controllers.gus.driver.fifo import Interrupted
from gusjob.controllers.gus.driver.inspection import inspect_library
from gusjob.controllers.gus.driver.library import _load_error
from gusjob.controllers.gus.driver.link import MEANINGS, meaning
from gusjob.controllers.gus.driver.requirements import check_stream
from gusjob.controllers.gus.driver.session import Session
from gusjob.controllers.gus.driver.shutdown import _laser_diagnostic, _motion_diagnostic
from gusjob.controllers.journal.reader import read_journal
from gusjob.hardware import devices
from gusjob.hardware.devices import Survey
from gusjob.hardware.devices import usb as usb_module
from gusjob.hardware.devices.libraries import SearchPaths
from gusjob.hardware.devices.usb import KNOWN_USB, UsbDevice, UsbProblem, UsbProblemKind
from gusjob.hardware.progress import PlannedPower, Progress
from gusjob.i18n import language as translate
from gusjob.i18n.phrases import localized
from gusjob.report.earlier import read_earlier

UNITS = {"kHz", "mm", "mm/s", "ms", "us", "um", "s", "x", "y", "ms/mm", "mJ", "mJ/mm", "uJ", "m"}
JOB = (
    MARK
    + """COORDS ABS
REPEAT 3 AS i
LASER POWER (10 + i * 10)
LASER ON
LINE X (i + 1) Y 2
LINE X 3 Y (i + 1)
LASER OFF
JUMP X 0 Y 0
END
"""
)
SKY = MARK + "SKYWRITE MODE 1 TIMELAG 100us NPREV 20 NPOST 20\nLASER POWER 40\nLASER ON\nLINE X 5\nLASER OFF\n"
TWO = """LASER MODE DUTY CARRIER 10
LASER MODE ANALOG CHANNEL 1
LASER STANDBY FREQ 5kHz DUTY 2
VEL 100
ACC 10000
LASER POWER 40
LASER POWER 4 CHANNEL 1
LASER ON
LASER ON CHANNEL 1
LINE X 5 Y 5
LASER OFF
LASER OFF CHANNEL 1
"""
LONG = MARK + "LASER POWER 40\nREPEAT 60 AS i\nLASER ON\nLINE X (i % 2 + 1) Y (i / 10)\nLASER OFF\nJUMP X 0 Y 0\nEND\n"


class _Letters:
    """A catalogue: each letter of a text that was looked up is another one."""

    def __init__(self, letter: str) -> None:
        self.letter = letter

    def gettext(self, text: str) -> str:
        parts = re.split(r"(\{[^{}]*\})", text)
        return "".join(p if p.startswith("{") else re.sub("[A-Za-z]", self.letter, p) for p in parts)


@pytest.fixture(name="dots")
def _dots(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(translate, "_catalogue", _Letters("·"))


@pytest.fixture(name="wide")
def _wide(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(translate, "_catalogue", _Letters("中"))


def left(text: str, *known: str) -> set[str]:
    """English words in a text; a job's own, units, and the controller's calls are none."""
    for word in sorted(known, key=len, reverse=True):
        text = text.replace(word, "")
    return {word for word in re.findall(r"[A-Za-z_]*[a-z][\w/]*", text) if word not in UNITS and word[:3] != "GT_"}


JSON_READER = re.compile(r"(?<=·: )[a-z][^·(]*(?= \(·)")
"""The JSON reader's own text, which is not translated."""


def out(command: click.Command, *arguments: object) -> str:
    """Output of a command, on both streams."""
    result = CliRunner().invoke(command, [str(a) for a in arguments], catch_exceptions=False)
    assert result.exit_code in (0, 1, 2)
    return str(result.output)


def wrong(command: click.Command, *arguments: object) -> str:
    """The message of a command about its arguments, without click's own text."""
    with pytest.raises(click.ClickException) as found:
        command.main([str(a) for a in arguments], standalone_mode=False)
    return found.value.message


@cache
def texts() -> dict[str, str]:
    """The files of a folder."""
    left_on = [call for call in calls_of(TWO) if not call.startswith("GT_BufLaserOff")]
    listing = "\n".join([*left_on, "GT_GetHSIOOpt(&V,0)"])
    return {"J.job": JOB, "S.job": SKY, "T.job": TWO, "L.job": LONG, "B.job": "LINE X 1\n", "C.gts": listing}


@pytest.fixture(name="folder")
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name, text in texts().items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


# Reports.


@pytest.mark.usefixtures("dots")
def test_reports(folder: Path) -> None:
    (folder / "M.toml").write_text("[[laser]]\nchannel = 0\nrated_w = 30\n", encoding="utf-8")
    names = ("J.job", "S.job", "T.job", "L.job", "C.gts")
    options = ((), ("--summary",), ("--no-marks",), ("--marks", "--scanner", "first-order:100us"))
    wrong = {}
    for name, form, more in product(names, ("table", "markdown"), options):
        text = out(report_command.command, name, "--machine", "M.toml", "--format", form, *more)
        # The model of the scanner is an option's value.
        wrong[name, form, more] = left(text, name, "M.toml", "first-order ") if "·" in text else text
    assert {case: words for case, words in wrong.items() if words} == {}


@pytest.mark.usefixtures("dots")
def test_reports_of_jobs(monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = {}
    monkeypatch.chdir(ROOT)
    for path, form in product(sorted((ROOT / "jobs").rglob("*.job")), ("table", "markdown")):
        text = out(report_command.command, path, "--format", form, "--no-marks")
        files = [str(path), *(str(found) for found in path.parent.rglob("*.job")), "(sky writing examples"]
        files += [found.relative_to(Path.cwd()).as_posix() for found in path.parent.glob("gusjob.toml")]
        wrong[path.stem, form] = left(text, *files, "first-order")
    assert len(wrong) > 40
    assert {case: words for case, words in wrong.items() if words} == {}


@pytest.mark.usefixtures("dots")
def test_a_job_that_was_not_run(folder: Path) -> None:
    assert left(out(report_command.command, "B.job", "--format", "markdown"), "B.job") == set()


CHANGES = (
    (JOB, JOB), (JOB, JOB.replace("ACC 10000", "ACC 20000")), (JOB, "// new\n" + JOB.replace("10 + i", "20 + i")),
    (JOB, JOB.replace("JUMP X 0 Y 0\n", "JUMP X 0 Y 0\nDWELL 5\n")), (LONG, LONG.replace("REPEAT 60", "REPEAT 6")),
    (JOB, JOB.replace("LASER ON\n", "")), (TWO, TWO.replace("FREQ 5kHz", "FREQ 6kHz")), (SKY, SKY.replace("20", "30")),
    (TWO, JOB), (JOB, JOB.replace("MODE DUTY CARRIER 10", "MODE ANALOG").replace("10 + i * 10", "1 + i")),
)  # fmt: skip
"""Jobs before and after a change."""


def test_comparisons(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = {}
    for number, (before, after) in enumerate(CHANGES):
        (folder / "J.job").write_text(before, encoding="utf-8")
        with monkeypatch.context() as english:
            english.setattr(translate, "_catalogue", None)
            out(report_command.command, "J.job", "-o", "OLD.JSON", "--format", "json")
        (folder / "J.job").write_text(after, encoding="utf-8")
        monkeypatch.setattr(translate, "_catalogue", _Letters("·"))
        for form in ("table", "markdown", "csv"):
            output = ("-o", "X") if form == "csv" else ()
            text = out(report_command.command, "J.job", "--against", "OLD.JSON", "--format", form, *output)
            assert "OLD.JSON" in text
            wrong[number, form] = left(text, "J.job", "OLD.JSON", "(i + 1)", "AS i", "i = 0")
    assert {case: words for case, words in wrong.items() if words} == {}


def test_totals_only(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out(report_command.command, "J.job", "-o", "OLD.JSON", "--format", "json", "--summary")
    monkeypatch.setattr(translate, "_catalogue", _Letters("·"))
    assert left(out(report_command.command, "L.job", "--against", "OLD.JSON"), "L.job", "OLD.JSON") == set()


def test_no_earlier_report(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out(report_command.command, "J.job", "-o", "OLD.JSON", "--format", "json")
    good = json.loads((folder / "OLD.JSON").read_text())
    totals, segments = good["totals"], good["segments"]
    channel = totals["channels"][0]
    broken = [
        {}, {**good, "totals": []}, {**good, "totals": {**totals, "mark_mm": "1"}}, {**good, "job": 1},
        {**good, "totals": {**totals, "channels": [1]}}, {**good, "totals": {**totals, "channels": {}}},
        {**good, "totals": {**totals, "channels": [{**channel, "unit": "W"}]}},
        {**good, "totals": {**totals, "channels": [{**channel, "channel": "0"}]}},
        {**good, "segments": {**segments, "kind": ["WAY"]}}, {**good, "segments": {**segments, "line": [1.5]}},
        {**good, "segments": {**segments, "line": []}}, {**good, "segments": {**segments, "x_mm": ["1"]}},
        {**good, "segments": {**segments, "line": [0.5] * len(segments["line"])}},
    ]  # fmt: skip
    texts = [*(json.dumps(one).encode() for one in broken), b"\xff\xfe{", b"{1"]
    monkeypatch.setattr(translate, "_catalogue", _Letters("·"))
    path = folder / "BAD.JSON"
    # Names of fields of the JSON.
    names = [*good, *totals, *segments, *channel, "mark, jump, run_in, run_out, dwell"]
    for text in texts:
        path.write_bytes(text)
        found, reason = read_earlier(path)
        assert found is None
        assert left(JSON_READER.sub("", localized(reason)), *names, "gusjob-report/1") == set(), text
    assert left(localized(read_earlier(folder / "NONE")[1])) == set()
    assert left(localized(read_earlier(Path("A\0"))[1])) == set()


# Other commands.


@pytest.mark.usefixtures("dots")
def test_tune(folder: Path) -> None:
    scanners = ("first-order:200us", "delay:200us", "first-order:5ms", "delay:0us", "first-order:0us", "delay:90ms")
    options = ((), ("--skywrite",), ("--channel", "1"), ("--write",))
    wrong = {}
    for scanner, name, more in product(scanners, ("J.job", "S.job", "T.job", "C.gts"), options):
        (folder / name).write_text(texts()[name], encoding="utf-8")
        text = out(tune_command.command, name, "--scanner", scanner, *more)
        model = scanner.partition(":")[0]
        lines = [line for line in text.splitlines() if not re.match(r"(LASER DELAY|SKYWRITE) ", line)]
        known = (name, "gusjob: ", f"{model} ", f"{model}:", "us")
        wrong[scanner, name, more] = left("\n".join(lines), *known) - {"·"}
    assert {case: words for case, words in wrong.items() if words} == {}


@pytest.mark.parametrize(
    "text",
    [JOB.replace("LASER MODE DUTY CARRIER 10\n", "LASER MODE DUTY CARRIER 10\nLASER DELAY ON 1us OFF 1us\n" * 2),
     JOB.replace("VEL", "LASER DELAY ON 1us OFF 1us\nSKYWRITE MODE 1 TIMELAG 10us NPREV 2 NPOST 2\nVEL")],
)  # fmt: skip
@pytest.mark.usefixtures("dots")
def test_jobs_that_can_not_be_tuned(folder: Path, text: str) -> None:
    (folder / "J.job").write_text(text, encoding="utf-8")
    for more in ((), ("--skywrite",)):
        texts_shown = out(tune_command.command, "J.job", "--scanner", "first-order:200us", *more)
        lines = [line for line in texts_shown.splitlines() if not re.match(r"(LASER DELAY|SKYWRITE) ", line)]
        assert left("\n".join(lines), "J.job", "gusjob: ", "first-order") == set()
    assert left(out(tune_command.command, "J.job"), "gusjob: ") == set()


def _surveys() -> Iterator[Survey]:
    search = SearchPaths(names=("A.so", "B.so"), folders=("/A", "/B"), system=True)
    yield Survey(search=replace(search, folders=(), system=False), libraries=(), usb=(), usb_problem=None)
    for platform in ("linux", "win32", "darwin"):
        steps = usb_module._NO_BACKEND_STEPS[platform]
        problem = UsbProblem(kind=UsbProblemKind.NO_BACKEND, reason=usb_module._NO_BACKEND, next_steps=steps)
        yield Survey(search=search, libraries=(), usb=(), usb_problem=problem, platform=platform)
        errors = [*(OSError(number, "") for number in usb_module._ERRORS), NotImplementedError()]
        problems = [usb_module._usb_problem(error, known, platform) for error in errors for known in KNOWN_USB]
        found = (
            UsbDevice(known=known, bus=1, address=2, serial="S", product="P", kernel_driver=True, problem=problem)
            for known, problem in zip(KNOWN_USB * len(errors), problems, strict=True)
        )
        usb = (*found, UsbDevice(known=replace(KNOWN_USB[0], gusjob=True), bus=None, address=None))
        yield Survey(search=search, libraries=(), usb=usb, usb_problem=None, platform=platform)


# Systems, programs and boards by their makers' names, commands to type, what is to be written into files.
NAMES = (
    "Windows", "macOS", "Linux", "Python", "MeerK40t", "EzCad2", "LightBurn", "Whisperer", "RDWorks", "NewlyDraw",
    "pip install libusb-package", 'SUBSYSTEM=="usb", ATTR{idVendor}', "ATTR{idProduct}", 'TAG+="uaccess"', ".so",
)  # fmt: skip


@pytest.mark.usefixtures("dots")
def test_devices_on_usb(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for found in _surveys():
        monkeypatch.setattr(devices, "survey", lambda _named, found=found: found)
        text = re.sub(r"\b[0-9a-f]{4}:[0-9a-f]{4}\b", "", out(devices_command.command))
        text = re.sub(r'=="[0-9a-f]{4}"', "", text)
        assert left(text, *NAMES) == set()


@pytest.mark.usefixtures("dots")
def test_libraries(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "CUT.so").write_bytes(b"\x7fELF")
    (folder / "F").mkdir()
    signs = ("[WinError 193]", "one of its dependencies", "WinError 126")
    texts_shown = [_load_error("/bin/sh", sign) for sign in signs]
    libraries = [
        *(inspect_library(str(path)) for path in ("/NO.so", folder / "F", folder / "CUT.so")),
        *(
            replace(inspect_library("/NO.so"), reason=why, next_steps=inspection._next_steps(why))
            for why in texts_shown
        ),
        *(replace(inspect_library("/NO.so"), next_steps=(step,)) for _, step in inspection._NEXT_STEPS),
        *(replace(inspect_library("/NO.so"), loaded=True, abis=tuple(abis)) for abis in (Abi, [Abi.GUS])),
        replace(inspect_library("/NO.so"), loaded=True, missing={Abi.GTS: ("GT_A", "GT_B")}),
        inspection._unfitting("/C.so", {}),
        inspection._unfitting("/C.so", {Abi.GTS: ("GT_A",)}),
    ]
    search = SearchPaths(names=("A.so", "B.so"), folders=())
    found = Survey(search=search, libraries=tuple(libraries), usb=(), usb_problem=None)
    monkeypatch.setattr(devices, "survey", lambda _named: found)
    text = re.sub(r"\b[0-9a-f]{4}:[0-9a-f]{4}\b", "", out(devices_command.command))
    abis = ("gts-multi", "gts", "gus", *signs)
    assert left(text.replace(str(folder), ""), *NAMES, "/bin/sh", "GT_A", *abis) == set()


@pytest.mark.usefixtures("dots")
def test_run(folder: Path) -> None:
    for name in ("J.job", "T.job", "C.gts"):
        assert left(out(run_command.command, name), name) == set(), name


def test_status(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    texts_shown: list[str] = []

    class Collected:
        def __enter__(self) -> Callable[[str], None]:
            return texts_shown.append

        def __exit__(self, *_: object) -> None: ...

    monkeypatch.setattr(run_command, "_status_line", lambda _path: Collected())
    out(run_command.command, "J.job")
    monkeypatch.setattr(translate, "_catalogue", _Letters("·"))
    assert len(texts_shown) == 3
    assert {word for text in texts_shown for word in left(localized(text))} == set()


@pytest.mark.parametrize("name", ["J.job", "B.job"])
@pytest.mark.usefixtures("dots")
def test_watch(folder: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    def ended(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(watch_command, "_wait_for_change", ended)
    head, _, text = out(watch_command.command, name).partition("\n")
    assert left(head, name) == set()
    # The job's own line is shown below an error.
    assert left(text, name, "LINE X 1") == set()


def test_wrong_usage(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(translate, "_catalogue", _Letters("·"))
    cases: list[tuple[click.Command, tuple[str, ...]]] = [
        *((report_command.command, ("J.job", *more)) for more in (
            ("--tolerance", "X"), ("--tolerance", "1"), ("--tolerance", "1%"), ("--marks", "--format", "csv"),
            ("--summary", "--format", "html"))),
        *((plot_command.command, ("J.job", "-o", *more)) for more in (
            ("A.png", "--size", "X"), ("A.png", "--size", "1x1"), ("A.X",), ("A.png", "--zoom", "0", "0", "0", "0"),
            ("A.png", "--zoom", "0", "0", "1e9", "1"), ("A.png", "--zoom", "0", "0", "1", "1", "--field"),
            ("A.png", "--size", "2000x2000", "--dpi", "1200"))),
        *((trace_command.command, ("J.job", *more)) for more in (
            ("--from", "X"), ("--from", "5s"), ("--from", "line:900"), ("--to", "line:1"))),
        (tune_command.command, ("J.job", "--mode", "1")), (watch_command.command, ("J.job", "--port", "1")),
        *((run_command.command, more) for more in (
            (), ("--backend", "gts"), ("J.job", "--backend", "gts", "--frame", "--no-laser"),
            ("J.job", "--backend", "gts", "--frame", "--from-line", "1"))),
    ]  # fmt: skip
    for command, arguments in cases:
        text = wrong(command, *arguments)
        assert "·" in text
        # The value is shown as it was typed; a form is an option's value.
        assert left(text, "csv", "html", "png", "svg", "pdf", "--from", "--to") == set(), arguments
    stops = [
        (run_command.command, ("J.job", "--yes", "--frame")), (watch_command.command, ("NONE",)),
        (run_command.command, ("J.job", "--backend", "gts")), (tune_command.command, ("J.job",)),
        (report_command.command, ("J.job", "--against", "NONE")), (run_command.command, ("B.job", "--backend", "gts")),
        (report_command.command, ("J.job", "--against", "J.job")),
    ]  # fmt: skip
    for command, arguments in stops:
        text = out(command, *arguments)
        known = ("J.job", "B.job", "LINE X 1", "gusjob: ", "--yes", "--frame", "gus|gts|gts-multi")
        assert left(JSON_READER.sub("", text), *known) == set(), arguments


@pytest.mark.usefixtures("dots")
def test_too_long() -> None:
    class Long:
        def __len__(self) -> int:
            return 10**9

    assert left(localized(too_long(Long()))) == set()  # type: ignore[arg-type]


# The panel, and errors of a run.

NOW = Progress(
    job="J.job", phase=Phase.RUNNING, row=1, rows=9, segment=1000, segments=2000, location="J.job:7",
    x_mm=1.0, y_mm=-2.0, queued=100, slots=4096, elapsed_s=3.0, done_ms=1000.0, total_ms=9000.0,
    lasers=(PlannedPower(channel=0, unit="%", power=40.0), PlannedPower(channel=1, unit="V", power=float("nan"))),
)  # fmt: skip


def _drawn(now: Progress, *, listening: bool) -> str:
    console = Console(width=80, record=True, force_terminal=True)
    with console.capture() as shown:
        console.print(panel(now, listening=listening))
    return re.sub(r"\x1b\[[0-9;]*m", "", shown.get())


@pytest.mark.parametrize("phase", list(Phase))
@pytest.mark.usefixtures("dots")
def test_panel_and_lines(phase: Phase) -> None:
    now = replace(NOW, phase=phase)
    for text in (_drawn(now, listening=True), _drawn(now, listening=False), plain_line(now)):
        assert left(text, "J.job") == set()


def test_errors_of_a_run(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stream = stream_of(JOB)
    crd = stream.buffered.crd.copy()
    crd[-1] = 2
    stream = replace(
        stream,
        buffered=replace(stream.buffered, crd=crd),
        calls=(*stream.calls, Call(name="GT_Reset", args=(), at=0, line=1)),
    )
    diagnostics = [*check_stream(stream), *(_motion_diagnostic(code) for code in (0, *MEANINGS, 99, -99))]
    diagnostics += [_laser_diagnostic(0, code, powered) for code in MEANINGS for powered in (False, True)]
    monkeypatch.setattr(translate, "_catalogue", _Letters("·"))
    for diagnostic in diagnostics:
        assert left(diagnostic.localized) == set()
    assert [left(localized(text)) for code in (*MEANINGS, 99, -99) for text in meaning(code)] == [set()] * 20


@pytest.mark.usefixtures("dots")
def test_files_that_are_not_journals(folder: Path) -> None:
    head = b'{"schema":"gusjob-journal/2","job":"","calls":"","rows":1,"options":"","begin":[0,0],"resumes":"OTHER"}'
    path, other = folder / "J.JOURNAL", folder / "OTHER"
    other.write_bytes(with_checksums([head.replace(b'"OTHER"', b"null")]))
    resumed, part = b'{"t":0,"resumed":"OTHER"}', b'{"t":0,"part":0}'
    sound = [with_checksums(lines) for lines in ([head], [head, resumed], [head, part])]
    for text in (b"{}\n", head.replace(b"/2", b"/1"), head, *sound, sound[1].replace(b"OTHER", b"other", 1)):
        path.write_bytes(text)
        found = read_journal(path)
        assert isinstance(found, str)
        assert "·" in localized(found)
        assert left(localized(found), "gusjob-journal/2") == set()


@needs_controller
def test_runs_on_a_controller(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    library = build(folder)
    monkeypatch.setenv("VC_OPTIONS", "speed=50,log=0")
    monkeypatch.setattr("gusjob.cli.hardware._can_ask", lambda: True)
    monkeypatch.setattr(translate, "_catalogue", _Letters("·"))
    (folder / "D.job").write_text(MARK + "LINE X 1\n", encoding="utf-8")
    (folder / "N.job").write_text("COORDS ABS\n", encoding="utf-8")
    hardware = ("--backend", "gts", "--library", library, "--abi", "gus", "--progress", "lines")

    def run(*arguments: object, answer: str = "y\n") -> str:
        done = CliRunner().invoke(run_command.command, [*map(str, arguments), *map(str, hardware)], input=answer)
        assert done.exception is None or isinstance(done.exception, SystemExit)
        text = done.output.replace(str(folder), "").replace(library.name, "")
        # click's own, a fault's source line, the vendor's library.
        return re.sub(r" \[y/N\]: [yn]|^ .*\|.*$|--··· gus", "", text, flags=re.MULTILINE)

    known = ("J.job", "D.job", "N.job", "L.job", "gusjob: ", "--frame", "--from-line", "--no-laser")
    texts_shown = [
        run("J.job", "--journal", "A.JOURNAL"),
        run("J.job", "--journal", "A.JOURNAL"),
        run("J.job", "--journal", "NONE/A.JOURNAL"),
        run("J.job", "--journal", "B.JOURNAL", "--frame"),
        run("D.job", "--journal", "C.JOURNAL"),
        run("D.job", "--journal", "D.JOURNAL", answer="n\n"),
        run("N.job", "--journal", "E.JOURNAL", "--frame"),
        run("J.job", "--journal", "F.JOURNAL", "--no-laser", "--from-line", "9"),
        run("J.job", "--journal", "G.JOURNAL", "--from-line", "99"),
        run("J.job", "--journal", "H.JOURNAL", "--resume", "A.JOURNAL"),
        run("L.job", "--journal", "H.JOURNAL", "--resume", "A.JOURNAL"),
        run("J.job", "--journal", "H.JOURNAL", "--resume", "F.JOURNAL"),
        run("J.job", "--journal", "H.JOURNAL", "--no-laser", "--resume", "A.JOURNAL"),
        run("J.job", "--resume", "NONE"),
        run("A.JOURNAL"),
        wrong(run_command.command, "J.job", *hardware, "--from-line", "1", "--resume", "A.JOURNAL"),
    ]
    for text in texts_shown:
        assert "·" in text
        assert left(text, *known) == set(), text


@needs_controller
@pytest.mark.usefixtures("dots")
def test_a_run_that_is_stopped(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    library = build(folder)
    monkeypatch.setattr(Session, "run", _stopped)
    hardware = ("--backend", "gts", "--library", library, "--abi", "gus", "--progress", "none", "--yes")
    text = out(run_command.command, "J.job", *hardware, "--journal", "A.JOURNAL")
    text = re.sub(r"^ .*\|.*$|--··· gus", "", text.replace(str(folder), ""), flags=re.MULTILINE)
    assert left(text.replace(library.name, ""), "J.job", "gusjob: ") == set()


def _stopped(session: Session, _part: object) -> None:
    session.control.request_stop(STOP_KEYS["q"])
    raise Interrupted


@pytest.mark.usefixtures("dots")
def test_what_a_laser_will_do() -> None:
    def channel(*found: float) -> SimpleNamespace:
        return SimpleNamespace(channel=0, unit="%", remaining=lambda _number: found)

    for found in ((0.0, 0.0, 0.0), (5.0, 40.0, 30.0), (5.0, 40.0, float("nan"))):
        assert left(localized(_laser_text(channel(*found), 0))) == set()  # type: ignore[arg-type]


# Columns stay straight.


def _starts(line: str, cells: int) -> list[int]:
    """In which columns of a terminal the first cells of a table's row begin."""
    return [cell_len(line[: found.start()]) for found in re.finditer(r"(?<![^ ] )(?<=  )\S|^\S", line)][:cells]


@pytest.mark.usefixtures("wide")
def test_wide_characters_keep_columns_straight(folder: Path) -> None:
    tuned = out(tune_command.command, "J.job", "--scanner", "first-order:200us").splitlines()
    first = tuned.index("") + 2
    rows = tuned[first : tuned.index("", first)]
    figures = rows[2:]  # Below two heads and the number of marks.
    assert len(figures) == 9
    assert len({cell_len(row) for row in (rows[0], *figures)}) == 1
    assert len({tuple(_starts(row, 2)) for row in figures}) == 1
    drawn = _drawn(NOW, listening=True).splitlines()
    assert {cell_len(row) for row in drawn} == {80}


def test_wide_characters_in_a_comparison(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out(report_command.command, "J.job", "-o", "OLD.JSON", "--format", "json")
    (folder / "J.job").write_text(JOB.replace("10 + i", "20 + i"), encoding="utf-8")
    monkeypatch.setattr(translate, "_catalogue", _Letters("中"))
    text = out(report_command.command, "J.job", "--against", "OLD.JSON", "--only-changes")
    _, totals, segments = text.rstrip("\n").split("OLD.JSON")[1].split("\n\n")
    power = [line for line in totals.splitlines() if "%" in line.partition("->")[0]]
    assert len({tuple(_starts(line, 3)) for line in power}) == 1 < len(power)
    assert len({tuple(_starts(line, 3)) for line in segments.splitlines()}) == 1 < len(segments.splitlines())


@pytest.mark.usefixtures("wide")
def test_wide_characters_are_wrapped(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    search = SearchPaths(names=("A.so", "B.so"), folders=("/A", "/B"))
    monkeypatch.setattr(devices, "survey", lambda _named: Survey(search=search, libraries=(), usb=(), usb_problem=None))
    lines = out(devices_command.command).splitlines()
    assert 90 < max(cell_len(line) for line in lines if line.startswith("  ")) <= 110
