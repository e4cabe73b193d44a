"""The command line as a shell sees it: help, completion, -q, --color, names of options, what a start imports."""

from __future__ import annotations

import io
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from itertools import product
from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result
from support.cli import GOOD, gusjob, write
from support.panel import Terminal
from support.tools import MARK, ROOT

from gusjob.cli import cli
from gusjob.cli.anywhere import value_given
from gusjob.cli.color import terminal_console
from gusjob.diagnostics.rules import RULES

COMMANDS = (
    "check", "fmt", "explain", "compile", "run", "report", "plot", "trace", "watch", "lsp", "tune", "devices", "record",
    "help",
)  # fmt: skip
BAD = MARK + "LASER POWER 120\n"
WARNED = GOOD + "LASER DELAY ON 20 OFF 10\n"
UNFORMATTED = "VEL   100\nACC 100\n"
ON_POSIX = pytest.mark.skipif(os.name != "posix", reason="no POSIX shells and pseudo-terminals")


def python(code: str, *arguments: str, **variables: str) -> subprocess.CompletedProcess[str]:
    """Run code in another process."""
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        capture_output=True, text=True, encoding="utf-8", check=False, cwd=ROOT, env={**os.environ, **variables},
    )  # fmt: skip


# Help.


@pytest.mark.parametrize(
    ("words", "lang"), [((), "en"), (("--lang", "zh"), "zh"), (("--lang=zh", "--color", "never"), "zh")]
)
def test_no_command_is_wrong_usage_and_prints_the_help(words: Sequence[str], lang: str) -> None:
    bare, asked = gusjob(*words), gusjob("--help", "--lang", lang)
    assert (bare.exit_code, bare.stdout, bare.stderr) == (2, "", asked.stdout)
    assert ("用法" in bare.stderr) == (lang == "zh")


def test_no_command_as_a_process() -> None:
    done = subprocess.run([sys.executable, "-m", "gusjob"], capture_output=True, text=True, cwd=ROOT, check=False)
    assert (done.returncode, done.stdout, "Traceback" in done.stderr) == (2, "", False)
    assert done.stderr.startswith("Usage: ")


def test_help_is_that_of_the_command() -> None:
    assert tuple(cli.commands or cli.list_commands(None)) == COMMANDS  # type: ignore[arg-type]
    assert gusjob("help").output == gusjob("--help").output
    for name in COMMANDS:
        helped = gusjob("help", name)
        assert (helped.exit_code, helped.output) == (0, gusjob(name, "--help").output)
    assert gusjob("help", "nonsense").exit_code == 2
    assert gusjob("-V").output == gusjob("--version").output


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("", None),
        ("--lang", None),
        ("--lang=", None),
        ("--lang fr", None),
        ("check --lang zh", "zh"),
        ("--lang=zh check", "zh"),
        ("--lang zh check --lang en", "en"),
        ("--lang zh check --lang", "zh"),
        ("record -- prog --lang zh", None),
        ("record --lang en -- --lang zh", "en"),
        ("check x--lang=zh --langs=zh --lang-x zh", None),
    ],
)
def test_an_option_anywhere_in_a_command_line(words: str, found: str | None) -> None:
    assert value_given(words.split(), "--lang", ("en", "zh")) == found


# Completion.


def completed(shell: str, words: Sequence[str], *more: str) -> list[str]:
    """What click answers a shell that completes the last word: its kind and value."""
    *before, last = words
    line = " ".join(["gusjob", *before, *([last] if shell == "fish" or last else [])])
    variables = {
        "_GUSJOB_COMPLETE": f"{shell}_complete",
        "COMP_WORDS": line,
        "COMP_CWORD": last if shell == "fish" else str(len(words)),
    }
    done = CliRunner().invoke(
        cli, [], prog_name="gusjob", complete_var="_GUSJOB_COMPLETE", env=variables, catch_exceptions=False
    )
    assert done.exit_code == 0, done.output
    lines = done.output.splitlines()
    if shell == "zsh":
        return [f"{kind},{value}" for kind, value in zip(lines[::3], lines[1::3], strict=True) if kind]
    return [line.partition("\t")[0] for line in lines if line]


def plain(*values: str) -> list[str]:
    return [f"plain,{value}" for value in values]


COMPLETIONS = {
    "": plain(*COMMANDS),
    "re": plain("report", "record"),
    "--lang ": plain("en", "zh"),
    "--lang zh re": plain("report", "record"),
    "check --color a": plain("auto", "always"),
    "check --format j": plain("json", "junit"),
    "check --prof": plain("--profile"),
    "check --select GJ81": plain(*(code for code in RULES if code.startswith("GJ81"))),
    "check --ignore gj81": plain(*(code for code in RULES if code.startswith("GJ81"))),
    "explain GJ101 GJ81": plain(*(code for code in RULES if code.startswith("GJ81"))),
    "help fm": plain("fmt"),
    "run --backend ": plain("sim", "gts"),
}
FILES = (
    "check a", "fmt a", "compile a", "run a", "report a", "plot a", "trace a", "watch a", "tune a", "check --profile a",
    "check --machine a", "report -o a", "run --library a", "devices --library a", "run --resume a",
    "report --against a", "record a",
)  # fmt: skip


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_shell_completes_words(shell: str) -> None:
    assert {line: completed(shell, line.split(" ")) for line in COMPLETIONS} == COMPLETIONS
    for line in FILES:
        assert [found.partition(",")[0] for found in completed(shell, line.split(" "))] == ["file"], line
    assert completed(shell, ["record", "--build-library", "a"])[0].startswith("dir")


def test_the_last_code_of_a_list_is_completed() -> None:
    assert completed("bash", ["check", "--select", "GJ401,GJ812"]) == plain("GJ401,GJ812")


def test_completion_without_a_shell_is_no_traceback() -> None:
    code = "from gusjob.cli import main; main()"
    for variables in ({}, {"COMP_WORDS": "gusjob", "COMP_CWORD": "x"}):
        done = python(code, _GUSJOB_COMPLETE="bash_complete", **variables)
        assert (done.returncode, done.stdout, done.stderr) == (1, "", "")


BASH = """
eval "$(_GUSJOB_COMPLETE=bash_source gusjob)" || exit 1
compopt() { printf 'compopt %s %s\\n' "$@"; }
complete_words() {
    COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMPREPLY=()
    _gusjob_completion gusjob
    echo "${COMPREPLY[*]}"
}
complete_words gusjob ""
complete_words gusjob --lang zh re
complete_words gusjob check --format = j
complete_words gusjob check --format = json --color = ne
complete_words gusjob explain GJ811
complete_words gusjob check jobs
"""
ZSH = """
compdef() { :; }
compadd() { local name=$@[-1]; echo "compadd ${(P)name}"; }
_describe() { echo "describe ${(P)3}"; }
_path_files() { echo "files"; }
eval "$(_GUSJOB_COMPLETE=zsh_source gusjob)" || exit 1
words=(gusjob check --format j); CURRENT=4; _gusjob_completion
words=(gusjob explain GJ811); CURRENT=3; _gusjob_completion
words=(gusjob check jobs); CURRENT=3; _gusjob_completion
"""
FISH = """
_GUSJOB_COMPLETE=fish_source gusjob | source
complete -C "gusjob explain GJ811"
complete -C "gusjob check --format js"
"""


def in_shell(shell: str, script: str, folder: Path) -> list[str]:
    """Run a script in which gusjob is this one."""
    program = folder / "gusjob"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m gusjob "$@"\n', encoding="utf-8")
    program.chmod(0o755)
    path = f"{folder}{os.pathsep}{os.environ['PATH']}"
    variables = {**os.environ, "PATH": path, "PYTHONPATH": str(ROOT), "LC_ALL": "C.UTF-8"}
    variables |= {"HOME": str(folder), "ZDOTDIR": str(folder)}  # No start files of a user.
    done = subprocess.run([shell, "-c", script], capture_output=True, text=True, env=variables, cwd=ROOT, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return [line.partition("\t")[0] for line in done.stdout.splitlines()]


def is_bash_new() -> bool:
    """Whether bash can complete: 4.4 or later."""
    if shutil.which("bash") is None:
        return False
    newer = "(( BASH_VERSINFO[0] * 100 + BASH_VERSINFO[1] >= 404 ))"
    return subprocess.run(["bash", "-c", newer], check=False).returncode == 0


@ON_POSIX
def test_the_shells_of_this_computer_complete(tmp_path: Path) -> None:
    """The protocol is tested everywhere; here what the shells make of it."""
    if is_bash_new():
        assert in_shell("bash", BASH, tmp_path) == [
            " ".join(COMMANDS), "report record", "json junit", "never", "GJ811", "compopt -o default", "",
        ]  # fmt: skip
    if shutil.which("zsh"):
        assert in_shell("zsh", ZSH, tmp_path) == [
            "compadd json junit",
            f"describe GJ811:{RULES['GJ811'].title}",
            "files",
        ]
    if shutil.which("fish"):
        assert in_shell("fish", FISH, tmp_path) == ["GJ811", "json"]


# -q.


def test_quiet_leaves_results_errors_and_warnings(tmp_path: Path) -> None:
    good, bad = write(tmp_path, GOOD, "good.job"), write(tmp_path, BAD, "bad.job")
    warned = write(tmp_path, WARNED, "warned.job")
    noted = write(tmp_path, GOOD.replace("VEL", "vel"), "noted.job")
    listing = write(tmp_path, gusjob("compile", good).stdout, "a.gts")
    silent: tuple[tuple[object, ...], ...] = (
        ("check", good), ("check", noted), ("check", "--fix", good), ("fmt", "--check", good), ("fmt", listing),
        ("compile", good, "-o", tmp_path / "b.gts"), ("report", good, "-o", tmp_path / "a.json"),
        ("trace", good, "-o", tmp_path / "a.csv"),
    )  # fmt: skip
    for words in silent:
        done = gusjob(*words, "-q")
        assert (done.exit_code, done.output) == (0, ""), words
    assert "note[" in gusjob("check", noted).stdout and "1 listing" in gusjob("fmt", listing).stderr
    for path, found in ((bad, "error[GJ201]"), (warned, "warning[")):
        for command in ("check", "compile", "report", "run"):
            assert found in gusjob(command, "--quiet", path).output, (command, path)
    results: tuple[tuple[object, ...], ...] = (
        ("run", good), ("report", good), ("check", "--format", "json", noted), ("check", "--statistics", noted),
    )  # fmt: skip
    for words in results:
        loud = gusjob(*words)
        assert loud.stdout and gusjob(*words, "-q").stdout == loud.stdout
    tuned = gusjob("tune", good, "--scanner", "first-order:250us")
    (statement,) = (line for line in tuned.output.splitlines() if line.startswith("LASER DELAY ON "))
    assert gusjob("tune", good, "--scanner", "first-order:250us", "-q").output == statement + "\n"


# Colours.

COLOR_RUNS = """
import contextlib, io, json, os, sys
from gusjob.cli import cli
for run in json.loads(sys.argv[1]):
    for name in ("NO_COLOR", "FORCE_COLOR", "TERM"):
        os.environ.pop(name, None)
    os.environ.update(run["variables"])
    print("\\n#", flush=True)
    with contextlib.suppress(SystemExit):
        cli(run["words"])
"""


def outputs(runs: list[dict[str, object]], *, terminal: bool) -> list[str]:
    """Standard output of runs of commands, which is a terminal or a pipe."""
    command = [sys.executable, "-c", COLOR_RUNS, json.dumps(runs)]
    variables = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"}
    if not terminal:
        done = subprocess.run(command, stdout=subprocess.PIPE, env=variables, cwd=ROOT, check=True)
        return done.stdout.decode().split("#")[1:]
    import pty

    master, slave = pty.openpty()
    raw = bytearray()
    with subprocess.Popen(command, stdout=slave, env=variables, cwd=ROOT) as child:
        os.close(slave)
        try:
            while piece := os.read(master, 4096):
                raw += piece
        except OSError:  # Linux: the other end is closed.
            pass
    os.close(master)
    assert child.returncode == 0
    return raw.decode().split("#")[1:]


def expected_color(option: str, variables: dict[str, str], *, terminal: bool) -> bool:
    """The documented order, as a list of who may decide."""
    deciding = (
        (option == "always", True),
        (option == "never", False),
        (bool(variables.get("NO_COLOR")), False),
        (bool(variables.get("FORCE_COLOR")), True),
        (variables["TERM"] == "dumb", False),
        (True, terminal),
    )
    return next(color for decides, color in deciding if decides)


@pytest.mark.parametrize("terminal", [False, pytest.param(True, marks=ON_POSIX)])
def test_who_decides_on_colors(tmp_path: Path, terminal: bool) -> None:
    bad = str(write(tmp_path, BAD))
    runs: list[dict[str, object]] = []
    expected = []
    for option, no, force, term in product(
        ("", "auto", "always", "never"), (None, "", "1"), (None, "", "1"), ("xterm", "dumb")
    ):
        variables = {"TERM": term} | ({} if no is None else {"NO_COLOR": no})
        variables |= {} if force is None else {"FORCE_COLOR": force}
        words = ["check", bad, "--color", option] if option else ["check", bad]
        runs.append({"words": words, "variables": variables})
        expected.append(expected_color(option, variables, terminal=terminal))
    assert ["\x1b[" in text for text in outputs(runs, terminal=terminal)] == expected


def test_every_output_with_colors_follows_the_option(tmp_path: Path) -> None:
    bad, good = str(write(tmp_path, BAD, "bad.job")), str(write(tmp_path, GOOD, "good.job"))
    loose, lower = str(write(tmp_path, UNFORMATTED, "loose.job")), str(write(tmp_path, "vel 100\n" + GOOD, "lower.job"))
    commands = (
        ["check", bad], ["run", good], ["report", good], ["report", good, "--format", "text"], ["fmt", "--diff", loose],
        ["check", "--diff", lower],
    )  # fmt: skip
    runs: list[dict[str, object]] = []
    for words, color in product(commands, ("always", "never")):
        runs.append({"words": ["--color", color, *words], "variables": {"TERM": "dumb"}})
        runs.append({"words": [*words, f"--color={color}"], "variables": {}})
    texts = [f"{text.strip()}\n" for text in outputs(runs, terminal=False)]
    assert ["\x1b[" in text for text in texts] == [True, True, False, False] * len(commands)
    for before in range(0, len(texts), 4):
        bare = {
            re.sub(r" *$", "", re.sub(r"\x1b\[[0-9;]*m", "", text), flags=re.MULTILINE)
            for text in texts[before : before + 4]
        }
        assert len(bare) == 1
    # A file is no terminal: it has no colours, whatever the option says of the screen.
    gusjob("report", good, "--color", "always", "--format", "table", "-o", tmp_path / "a.txt")
    assert b"\x1b" not in (tmp_path / "a.txt").read_bytes()


@pytest.mark.parametrize("color", [True, False])
def test_the_panel_and_the_status_line_follow_too(monkeypatch: pytest.MonkeyPatch, color: bool) -> None:
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("NO_COLOR" if color else "FORCE_COLOR", "1")  # The option comes before them, for rich, too.
    with click.Context(cli, color=color).scope():
        monkeypatch.setattr(sys, "stderr", io.StringIO())
        assert terminal_console() is None  # With colours or without: where there is no terminal, nothing moves.
        screen = Terminal()
        monkeypatch.setattr(sys, "stderr", screen)
        console = terminal_console()
    assert console is not None and console.is_terminal
    console.print("[red]stopping[/red]")
    assert ("\x1b[31m" in screen.getvalue()) == color


# Names.


def test_both_names_of_the_profile(tmp_path: Path) -> None:
    job = write(tmp_path, GOOD)
    profile = write(tmp_path, "[[laser]]\nrated_w = 30\n", "m.toml")
    outcomes = [gusjob("report", job, "--summary", name, profile).output for name in ("--profile", "--machine")]
    assert outcomes[0] == outcomes[1] != gusjob("report", job, "--summary").output
    for command in ("check", "compile", "run", "report", "plot", "trace", "watch", "tune", "devices"):
        assert re.search(r"--profile, --machine (FILE|PATH)", gusjob(command, "--help").output), command


@pytest.mark.parametrize("words", [("check", "x.job"), ("report", "x.job"), ("devices",)])
def test_table_and_text_are_one_format(words: Sequence[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path, GOOD)
    found = [gusjob(*words, "--format", name) for name in ("table", "text")]
    assert (found[0].exit_code, found[0].output) == (0, found[1].output)
    assert found[0].output == gusjob(*words).output


def test_a_library_that_can_not_be_used(tmp_path: Path) -> None:
    """2 for a run, as for other wrong requests; 1 for devices, whose answer it is."""
    job, text = write(tmp_path, GOOD), write(tmp_path, "no library\n" * 50, "libgts.so")
    on_hardware = ("run", job, "--backend", "gts", "--yes")

    def status(done: Result, part: str) -> tuple[int, bool]:
        return done.exit_code, part in done.output

    assert status(gusjob(*on_hardware, "--library", text, "--abi", "gts"), "GJ901") == (2, True)
    assert status(gusjob(*on_hardware), "needs the vendor's library") == (2, True)
    unknown = gusjob(*on_hardware, "--library", text)
    abis = "--abi gus (GUS, as in the laser manual), gts (GTS, one card) or gts-multi (GTS, several cards)"
    assert status(unknown, abis) == (2, True)
    assert f"gusjob devices --library {text}" in unknown.output
    assert status(gusjob("devices", "--library", text), f"{text} can't be loaded: ") == (1, True)
    assert status(gusjob("devices", "--library", tmp_path / "none.so", "--format", "json"), '"loaded": false') == (
        1,
        True,
    )
    assert gusjob("devices").exit_code == 0


# Start-up.

STARTS = """
import contextlib, io, os, sys
class Refused:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("numpy", "lark", "rich"):
            raise AssertionError(f"{words}: imports {name}")
sys.meta_path.insert(0, Refused())
from gusjob.cli import cli
for line in sys.argv[1].splitlines():
    words = line.split()
    try:
        cli(words, prog_name="gusjob", complete_var="_GUSJOB_COMPLETE")
    except SystemExit as end:
        assert end.code == 0, words
"""


def test_help_needs_no_large_library() -> None:
    """numpy alone takes as long to import as a help text takes to print."""
    lines = ["--help", "--version", "explain", "explain GJ101", "help", "help check"]
    done = python(STARTS, "\n".join([*lines, *(f"{command} --help" for command in COMMANDS)]))
    assert (done.returncode, done.stderr) == (0, "")
    for words in ("gusjob r", "gusjob check --select GJ", "gusjob run a"):
        variables = {"_GUSJOB_COMPLETE": "bash_complete", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
        done = python(STARTS, "x", **variables)
        assert (done.returncode, done.stderr, bool(done.stdout)) == (0, "", True)


NOT_IN_A_RUN = (
    "rich",
    "numpy.ma",
    "gusjob.planner.skywriting.marks",
    "gusjob.hardware",
    "gusjob.view",
    "tomllib",
    "filelock",
)


def test_a_short_run_imports_what_it_uses(tmp_path: Path) -> None:
    job = write(tmp_path, GOOD)
    code = (
        "import sys, contextlib\nfrom gusjob.cli import cli\n"
        "with contextlib.suppress(SystemExit): cli(['run', sys.argv[1]])\n"
        f"print([name for name in {NOT_IN_A_RUN} if name in sys.modules])"
    )
    done = python(code, str(job))
    assert done.stdout.splitlines()[-1] == "[]", done
