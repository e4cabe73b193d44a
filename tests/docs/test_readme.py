"""README.md and the other documents: short, complete, and true: outputs are what the commands print, links resolve."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from click import Context
from support import documents
from support.cli import gusjob
from support.documents import CHINESE, ENGLISH, GUIDES, blocks, text_of
from support.tools import ROOT, diagnostics_in

from gusjob.cli import cli

MAX_WORDS = 1800
MAX_PICTURE_KB = 200
JOB_WITH_AN_ERROR = """LASER MODE DUTY CARRIER 10kHz
LET w = 60
VEL 100
ACC 10000
LASER POWER 50
DEF row(n)
  JUMP X 0 Y (n)
  LASER ON
  LINE X (n*w)
  LASER OFF
END
FOR i FROM 1 TO 5
CALL row(i)
END
"""


def test_the_readme_is_short() -> None:
    assert len(text_of(ENGLISH).split()) <= MAX_WORDS


def test_the_example_checks_clean() -> None:
    assert diagnostics_in(blocks(text_of(ENGLISH))[0]) == []


@pytest.mark.parametrize(("readme", "language"), [(ENGLISH, "en"), (CHINESE, "zh")])
def test_outputs_are_what_the_commands_print(
    readme: str, language: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rewrite: bool
) -> None:
    monkeypatch.chdir(tmp_path)
    text = text_of(readme)
    (tmp_path / "first.job").write_text(blocks(text)[0], encoding="utf-8")
    (tmp_path / "a.job").write_text(JOB_WITH_AN_ERROR, encoding="utf-8")
    printed = [
        gusjob("run", "first.job", "--lang", language).stdout,
        gusjob("check", "a.job", "--lang", language).stdout,
    ]
    shown = blocks(text, "text")
    assert len(shown) == len(printed)
    if rewrite:
        fresh = re.sub(
            r"^```text\n.*?^```$", lambda _: f"```text\n{printed.pop(0)}```", text, flags=re.DOTALL | re.MULTILINE
        )
        (ROOT / readme).write_text(fresh, encoding="utf-8", newline="\n")
    else:
        assert shown == printed, "run pytest --rewrite"


def test_the_table_names_every_command() -> None:
    assert re.findall(r"^\| `gusjob (\w+)", text_of(ENGLISH), re.MULTILINE) == cli.list_commands(Context(cli))


def test_the_table_names_every_guide() -> None:
    named = re.findall(r"^\| \[docs/([\w-]+\.md)\]", text_of(ENGLISH), re.MULTILINE)
    assert sorted(named) == [path.name for path in GUIDES]


@pytest.mark.parametrize("command", ["python -m pip install . && gusjob run ", 'python -m pip install ".[test]" && '])
def test_ci_finds_the_commands(command: str) -> None:
    """`.ci/run` reads them from here; there must be one of each."""
    assert text_of(ENGLISH).count(f"\n    {command}") == 1


def test_the_picture_is_small() -> None:
    picture = ROOT / "docs" / "report-page.png"
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert picture.stat().st_size < MAX_PICTURE_KB * 1000


def broken_links(path: Path, text: str) -> list[str]:
    """Relative links of a document that lead nowhere."""
    found = []
    for link in documents.links(text):
        name, _, anchor = link.partition("#")
        if "://" in link:
            continue
        target = (path.parent / name).resolve() if name else path
        if not target.exists() or (anchor and anchor not in documents.anchors(target.read_text(encoding="utf-8"))):
            found.append(link)
    return found


def test_links_resolve() -> None:
    broken = {path.name: broken_links(path, path.read_text(encoding="utf-8")) for path in documents.DOCUMENTS}
    assert {name: links for name, links in broken.items() if links} == {}


def test_a_broken_link_is_seen() -> None:
    path = ROOT / ENGLISH
    assert broken_links(path, "[a](docs/none.md) [b](grammar/README.md#nowhere) ![c](docs/no.png)") == [
        "docs/none.md", "grammar/README.md#nowhere", "docs/no.png",
    ]  # fmt: skip
    assert broken_links(path, "[a](grammar/README.md#every-range) [b](#try-it) [c](https://pre-commit.com)") == []


def test_nothing_is_promised_that_is_not_there() -> None:
    """gusjob is on no package index, and has no tags yet."""
    for path in documents.DOCUMENTS:
        text = path.read_text(encoding="utf-8")
        assert not re.search(r"pip install gusjob\b|rev: v\d", text), path


def test_python_examples_are_python(tmp_path: Path) -> None:
    for path in documents.DOCUMENTS:
        for block in blocks(path.read_text(encoding="utf-8"), "python"):
            compile(block, str(path), "exec")


def test_the_profiles_of_the_guides_are_accepted(tmp_path: Path) -> None:
    job = tmp_path / "part.job"
    job.write_text("VEL 100\n", encoding="utf-8")
    found = [
        block for path in GUIDES for block in blocks(path.read_text(encoding="utf-8"), "toml") if "[check]" in block
    ]
    assert found
    for block in found:
        (tmp_path / "gusjob.toml").write_text(block, encoding="utf-8")
        assert gusjob("check", "--strict", job).exit_code == 0, block
