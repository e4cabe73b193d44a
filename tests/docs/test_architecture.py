"""gusjob/README.md names files, functions and classes that exist, and every package."""

from __future__ import annotations

import ast
import re
from pathlib import Path

from support.documents import text_of
from support.tools import ROOT

PACKAGE = ROOT / "gusjob"


def defined(path: Path) -> set[str]:
    """Names that a module defines at its top level or in a class, as `name` and `Class.name`."""
    names: set[str] = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        match node:
            case ast.FunctionDef(name=name):
                names.add(name)
            case ast.ClassDef(name=name, body=body):
                names |= {name, *(f"{name}.{inner.name}" for inner in body if isinstance(inner, ast.FunctionDef))}
            case ast.Assign(targets=[ast.Name(id=name)]) | ast.AnnAssign(target=ast.Name(id=name)):
                names.add(name)
    return names


def missing(text: str) -> list[str]:
    """Files and names in a text, as `path/file.py` and `path/file.py:name`, that do not exist in gusjob/."""
    found = []
    for name, _, member in re.findall(r"`([\w/]+\.(py|c|lark))(?::([\w.]+))?`", text):
        path = next((top / name for top in (PACKAGE, ROOT / "grammar", ROOT) if (top / name).is_file()), None)
        if path is None or (member and member not in defined(path)):
            found.append(f"{name}:{member}")
    return found


def test_named_files_and_functions_exist() -> None:
    text = text_of("gusjob/README.md")
    assert len(re.findall(r"`[\w/]+\.py:[\w.]+`", text)) > 20
    assert missing(text) == []


def test_a_missing_function_is_seen() -> None:
    assert missing("`api.py:none` and `none.py`, but `api.py:read` and `api.py`") == ["api.py:none", "none.py:"]


def test_every_package_is_described() -> None:
    packages = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    described = set(re.findall(r"^\| `(\w+)/", text_of("gusjob/README.md"), re.MULTILINE))
    assert described == packages
