"""Each listing of tests/listings is read to its calls, or has its errors at their lines and nowhere else."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import pytest
from support.tools import ROOT

from gusjob.controllers.gus.listing import listing
from gusjob.diagnostics.model import Diagnostic, Severity
from gusjob.frontend import Source, read_listing, read_source
from gusjob.frontend.listing import clean_text
from gusjob.frontend.scan import scanner

LISTINGS = ROOT / "tests" / "listings"
FILES = sorted(p for p in LISTINGS.iterdir() if p.suffix not in (".calls", ".errors", ".md"))
_MARK = re.compile(r"// error: (GJ\d+)")


def neighbour(path: Path, suffix: str) -> Path:
    return path.with_name(path.name + suffix)


def read(path: Path) -> tuple[list[str], list[Diagnostic]]:
    source, found = read_source(path)
    assert source is not None, found
    stream, diagnostics = read_listing(source)
    return "".join(listing(stream)).splitlines(), diagnostics


def errors_expected(path: Path) -> Counter[tuple[int, str]]:
    other = neighbour(path, ".errors")
    if other.exists():
        pairs = (line.split(": ") for line in other.read_text(encoding="utf-8").splitlines())
        return Counter((int(line), code) for line, code in pairs)
    lines = path.read_text(encoding="utf-8").splitlines()
    return Counter((n, code) for n, line in enumerate(lines, 1) for code in _MARK.findall(line))


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.name)
def test_a_listing_is_read_to_its_calls_or_refused(path: Path) -> None:
    calls, diagnostics = read(path)
    errors = Counter((f.span.line, f.rule.code) for f in diagnostics if f.severity is Severity.ERROR)
    wanted = neighbour(path, ".calls")
    if wanted.exists():
        assert not errors
        assert calls == wanted.read_text(encoding="utf-8").splitlines()
    else:
        assert errors
        assert errors == errors_expected(path)


def test_there_are_listings_of_both_kinds() -> None:
    kinds = Counter(neighbour(path, ".calls").exists() for path in FILES)
    assert min(kinds.values()) > 20


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.name)
def test_chunks_make_no_difference(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = read(path)
    monkeypatch.setattr(scanner, "CHUNK", 100)
    monkeypatch.setattr(clean_text, "_PART_BYTES", 100)
    assert read(path) == whole


def test_conversions_of_all_chunks_are_put_together(monkeypatch: pytest.MonkeyPatch) -> None:
    text = "".join(f"GT_LnXY(1,{i},{i % 3 / 2},100,2,0,0)\nGT_BufDelay(1,{65536 + i},0)\n" for i in range(40))
    monkeypatch.setattr(scanner, "CHUNK", 200)
    stream, _ = read_listing(Source(name="a.gts", data=text.encode()))
    found = {
        (c.call, c.argument): (c.line.tolist(), c.written.tolist(), c.arrives.tolist()) for c in stream.conversions
    }
    halves = range(1, 40, 3)
    assert found == {
        ("GT_LnXY", "y"): ([2 * i + 1 for i in halves], [0.5] * len(halves), [0.0] * len(halves)),
        ("GT_BufDelay", "ms"): ([2 * i + 2 for i in range(40)], [65536.0 + i for i in range(40)], list(range(40))),
    }
    assert len(stream.conversions) == 2
    assert stream.buffered.p[1::2].tolist() == list(range(40))
    assert stream.buffered.crd.strides == (0,)
