"""The house: imports go one way, lark and rich stay in their rooms, start-up stays light, no eval and no shell."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest
from support.tools import ROOT

ORDER = (
    "limits", "translate", "phrases", "diagnostics", "rules", "selection", "allowance", "units", "columns", "machine",
    "profile", "motion", "geometry", "job", "stream", "listing", "c_program", "syntax", "layout", "checks", "planner",
    "interpreter", "backend", "report", "loading", "mend", "signals", "drawing", "page", "lsp", "tune", "api", "cli",
)  # fmt: skip
"""Top to bottom: a room imports from itself and from rooms above it."""

ONLY = {
    "lark": ("syntax",), "rich": ("report", "cli"), "click": ("cli",), "pyarrow": ("columns",), "vcd": ("signals",),
    "matplotlib": ("drawing", "api"), "polars": ("api",), "jinja2": ("page",),
    "pygls": ("lsp",), "lsprotocol": ("lsp",),
}  # fmt: skip
"""Libraries and the rooms that may import them."""


def room_of(path: Path) -> str:
    return path.relative_to(ROOT / "gusjob").parts[0].removesuffix(".py")


def imported(tree: ast.AST) -> list[str]:
    names = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "absolute imports only"
            names += [node.module or "", *(f"{node.module}.{alias.name}" for alias in node.names)]
    return names


def diagnostics(room: str, source: str) -> list[str]:
    found = []
    for name in imported(ast.parse(source)):
        parts = name.split(".")
        if parts[0] == "gusjob" and len(parts) > 1 and parts[1] in ORDER and room in ORDER:
            if ORDER.index(parts[1]) > ORDER.index(room):
                found.append(f"{room} imports {name}")
        elif parts[0] in ONLY and room not in ONLY[parts[0]]:
            found.append(f"{room} imports {name}")
    return found


@pytest.mark.parametrize("path", sorted((ROOT / "gusjob").rglob("*.py")), ids=lambda p: p.stem)
def test_imports_go_one_way(path: Path) -> None:
    assert diagnostics(room_of(path), path.read_text(encoding="utf-8")) == []


def test_a_planted_import_is_seen() -> None:
    assert diagnostics("planner", "from gusjob.report.rows import Report")
    assert diagnostics("checks", "import lark")
    assert diagnostics("limits", "from gusjob import units")
    assert not diagnostics("cli", "from gusjob.report.rows import Report")


def test_every_room_has_its_place() -> None:
    rooms = {room_of(p) for p in (ROOT / "gusjob").rglob("*.py")} - {"__init__", "__main__"}
    assert rooms == set(ORDER)


def test_the_top_level_is_tidy() -> None:
    texts = {"README.md", "README.zh-CN.md", "CHANGELOG.md", "LICENSE"}
    known = {"pyproject.toml", "gusjob", "grammar", "jobs", "tests"} | texts
    made = {"build", "dist"}
    assert {p.name for p in ROOT.iterdir() if not p.name.startswith(".")} - made == known


def test_check_imports_nothing_heavy() -> None:
    code = (
        "import sys; from gusjob.cli import main; sys.argv = ['gusjob', 'check', sys.argv[1]]\n"
        "try: main()\nexcept SystemExit: pass\n"
        "heavy = 'rich', 'gusjob.simulate', 'gusjob.planner', 'gusjob.report', 'tomllib', 'numpy.ma'\n"
        "print([m for m in heavy if m in sys.modules])"
    )
    job = ROOT / "jobs" / "co2_cut.job"
    done = subprocess.run([sys.executable, "-c", code, str(job)], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_no_eval_no_shell_no_pickle() -> None:
    for path in (ROOT / "gusjob").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                assert node.func.id not in ("eval", "exec", "compile"), path
        names = imported(ast.parse(path.read_text(encoding="utf-8")))
        assert not {"subprocess", "pickle", "marshal", "shelve"} & {n.split(".")[0] for n in names}, path
