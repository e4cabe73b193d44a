"""The structure of the project: direction of imports, class names, top level, start-up; no eval, shell or pickle."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
import tomllib
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from support.tools import ROOT

PACKAGE = ROOT / "gusjob"
MODULES = sorted(PACKAGE.rglob("*.py"))


@cache
def tree(path: Path) -> ast.Module:
    """A module's syntax tree."""
    return ast.parse(path.read_text(encoding="utf-8"))


def nodes(path: Path) -> Iterator[ast.AST]:
    """Every node of a module's syntax tree."""
    return ast.walk(tree(path))


def lint_imports(folder: Path) -> tuple[int, str]:
    """Exit status and output of import-linter on the package in a folder, with its pyproject.toml."""
    code = (
        "import sys; sys.path.insert(0, '.'); from importlinter.cli import lint_imports;"
        "sys.exit(lint_imports(config_filename='pyproject.toml', no_cache=True))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, encoding="utf-8", check=False
    )
    return done.returncode, done.stdout + done.stderr


def test_imports_keep_to_the_contracts() -> None:
    """The contracts in pyproject.toml: layers, and one place for each library."""
    status, output = lint_imports(ROOT)
    assert status == 0, output


PLANTED = {
    "kinematics": "from gusjob.report.rows import Report",
    "i18n": "from gusjob.kinematics import units",
    "lint": "import lark",
    "simulate": "def late() -> None:\n    from rich.text import Text",
    "report": "from matplotlib import pyplot",
    "tune": "from gusjob.controllers.gus.driver import abi",
}
"""Packages, and an import that is against a contract there."""


def test_a_planted_import_is_seen(tmp_path: Path) -> None:
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    shutil.copytree(PACKAGE, tmp_path / "gusjob", ignore=shutil.ignore_patterns("static", "__pycache__", "locale"))
    for package, line in PLANTED.items():
        (tmp_path / "gusjob" / package / "planted.py").write_text(f"{line}\n", encoding="utf-8")
    status, output = lint_imports(tmp_path)
    assert status == 1
    assert [package for package in PLANTED if f"gusjob.{package}.planted -> " not in output] == []


def test_every_module_is_in_a_layer() -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    (layers,) = (contract["layers"] for contract in contracts if contract["type"] == "layers")
    named = {name.strip().split(".")[1] for layer in layers for name in re.split(r"[|:]", layer)}
    entry_points = {"__init__", "__main__", "version", "__pycache__"}
    assert {path.stem for path in PACKAGE.iterdir() if path.suffix in ("", ".py")} - entry_points == named


def test_imports_are_absolute() -> None:
    relative = [path for path in MODULES for n in nodes(path) if isinstance(n, ast.ImportFrom) and n.level]
    assert relative == []


def test_no_test_module_imports_another() -> None:
    """What tests share is in tests/support."""
    found = []
    for path in (ROOT / "tests").rglob("*.py"):
        for node in nodes(path):
            match node:
                case ast.ImportFrom(module=str(module), names=names):
                    imported = [f"{module}.{alias.name}" for alias in names]
                case ast.Import(names=names):
                    imported = [alias.name for alias in names]
                case _:
                    continue
            found += [(path.name, name) for name in imported if re.search(r"(^|\.)test_[a-z_]+(\.|$)", name)]
    assert found == []


def test_class_names_are_unique() -> None:
    """In the whole package, so that a name in a text means one thing; a leading underscore does not count."""
    places = defaultdict(list)
    for path in MODULES:
        for node in nodes(path):
            if isinstance(node, ast.ClassDef):
                places[node.name.lstrip("_")].append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert {name: where for name, where in places.items() if len(where) > 1} == {}


def test_records_are_structs() -> None:
    """Each dataclass would compile its methods at every start."""
    found = [
        path for path in MODULES for n in nodes(path) if isinstance(n, ast.ImportFrom) and n.module == "dataclasses"
    ]
    assert found == []


def test_no_module_compiles_patterns_when_it_is_imported() -> None:
    """It makes lazy_pattern of them: compiling all of them would take much of a start."""

    def compiled(body: list[ast.stmt]) -> Iterator[int]:
        for statement in body:
            if isinstance(statement, ast.ClassDef):
                yield from compiled(statement.body)
            elif not isinstance(statement, ast.FunctionDef):
                found = (n for n in ast.walk(statement) if isinstance(n, ast.Attribute))
                yield from (n.lineno for n in found if ast.unparse(n) == "re.compile")

    assert [f"{path.relative_to(ROOT)}:{line}" for path in MODULES for line in compiled(tree(path).body)] == []


def test_every_module_says_what_it_is() -> None:
    assert [path for path in MODULES if not ast.get_docstring(tree(path))] == []


def test_the_top_level_is_tidy() -> None:
    texts = {"README.md", "README.zh-CN.md", "CHANGELOG.md", "CONTRIBUTING.md", "LICENSE"}
    folders = {"gusjob", "grammar", "jobs", "docs", "tests"}
    made = {"build", "dist", "htmlcov"}
    known = {"pyproject.toml"} | folders | texts
    assert {p.name for p in ROOT.iterdir() if not p.name.startswith(".")} - made == known


UNUSED_BY_A_PLAIN_JOB = (
    "rich",
    "filelock",
    "tomllib",
    "difflib",
    "glob",
    "numpy.ma",
    "gusjob.cli.fixes",
    "gusjob.diagnostics.fixes",
    "gusjob.frontend.expand.expander",
    "gusjob.frontend.includes",
    "gusjob.frontend.listing",
    "gusjob.frontend.parse.foreign",
    "gusjob.frontend.parse.intent",
    "gusjob.frontend.parse.keyword_case",
    "gusjob.frontend.parse.misread",
    "gusjob.frontend.parse.syntax_errors",
    "gusjob.frontend.resolve.frames",
    "gusjob.hardware",
    "gusjob.i18n.spelling",
    "gusjob.view",
)
OF_OTHER_COMMANDS = (
    "json",
    "orjson",
    "gusjob.diagnostics.formats.text",
    "gusjob.planner",
    "gusjob.report",
    "gusjob.simulate",
)
UNUSED_BY_A_HELP_TEXT = ("numpy", "lark", "gusjob.frontend", "gusjob.lint", "gusjob.planner")
PLAIN_JOB = """\
LASER MODE DUTY CARRIER 10
VEL 1000
ACC 100000
LASER POWER 50
LASER ON
LINE X 10 Y 0
LASER OFF
"""


@pytest.mark.parametrize(
    ("words", "unused"),
    [
        (("check",), (*UNUSED_BY_A_PLAIN_JOB, *OF_OTHER_COMMANDS)),
        (("report", "--summary"), UNUSED_BY_A_PLAIN_JOB),
        (("--help",), UNUSED_BY_A_HELP_TEXT),
        (("check", "--help"), UNUSED_BY_A_HELP_TEXT),
        (("explain",), UNUSED_BY_A_HELP_TEXT),
    ],
)
def test_a_plain_job_imports_what_it_needs(words: tuple[str, ...], unused: tuple[str, ...], tmp_path: Path) -> None:
    job = tmp_path / "x.job"
    job.write_text(PLAIN_JOB, encoding="utf-8")
    code = (
        "import sys; from gusjob.cli import main\n"
        "try: main()\nexcept SystemExit: pass\n"
        f"print([m for m in {unused} if m in sys.modules], file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code, *words, str(job)], capture_output=True, text=True, check=True)
    assert done.stderr.splitlines()[-1] == "[]"


@pytest.mark.parametrize(
    ("words", "expected"),
    [("check x.job", True), ("--color never report x.job", True), ("check -h", False), ("explain", False), ("", False)],
)
def test_numpy_is_imported_from_the_top_of_the_stack(words: str, expected: bool) -> None:
    code = "import sys; from gusjob import cli\ncli._call = lambda: print('numpy' in sys.modules)\ncli.main()"
    done = subprocess.run([sys.executable, "-c", code, *words.split()], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == str(expected)


def test_no_eval_no_shell_no_pickle() -> None:
    """Other processes are the guard of a run, the C compiler of the recorder, and the program that it records."""
    functions, modules = {"eval", "exec", "compile"}, {"subprocess", "pickle", "marshal", "shelve"}
    found = []
    for path in MODULES:
        for node in nodes(path):
            match node:
                case ast.Call(func=ast.Name(id=name)) if name in functions:
                    found.append((path.name, name))
                case ast.Import(names=names):
                    found += [(path.name, n.name) for n in names if n.name.split(".")[0] in modules]
                case ast.ImportFrom(module=str(module)) if module.split(".")[0] in modules:
                    found.append((path.name, module))
                case ast.Call(func=ast.Attribute(attr="system" | "popen" as name)) | ast.keyword(arg="shell" as name):
                    found.append((path.name, name))
    assert sorted(found) == [("build.py", "subprocess"), ("recording.py", "subprocess"), ("start.py", "subprocess")]
