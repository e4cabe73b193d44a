"""The project's documents: their texts, code blocks and links."""

from __future__ import annotations

import re
from pathlib import Path

from support.tools import ROOT

ENGLISH, CHINESE = "README.md", "README.zh-CN.md"
GUIDES = sorted((ROOT / "docs").glob("*.md"))
DOCUMENTS = [
    *(ROOT / name for name in (ENGLISH, CHINESE, "CONTRIBUTING.md", "CHANGELOG.md", "gusjob/README.md")),
    *GUIDES,
    *(ROOT / name for name in ("grammar/README.md", "tests/bench/README.md", "tests/schemas/README.md")),
]


def text_of(name: str | Path) -> str:
    """The text of a document, by its path from the top folder."""
    return (ROOT / name).read_text(encoding="utf-8")


def blocks(text: str, kind: str = "") -> list[str]:
    """Code blocks of one kind: the text between ``` and ```."""
    return re.findall(rf"^```{kind}\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)


def prose(text: str) -> str:
    """A text without its code blocks, fenced and indented."""
    return re.sub(
        r"^    .*$", "", re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE), flags=re.MULTILINE
    )


def links(text: str) -> list[str]:
    """Targets of links and pictures."""
    return re.findall(r"\[[^\]]*\]\(([^)\s]+)\)", prose(text))


def anchors(text: str) -> set[str]:
    """Anchors of a text's headings, as GitHub makes them."""
    found = re.findall(r"^#+ (.*)$", re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in found}
