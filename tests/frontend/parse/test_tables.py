"""Parser tables: packaged and cached ones give the parser that the grammar gives, and unfit ones are never used."""

from __future__ import annotations

import os
import sys
import tempfile
import zlib
from pathlib import Path

import lark
import pytest
from lark import Lark
from lark.exceptions import UnexpectedInput
from support.tools import ROOT

from gusjob.frontend.parse import tables
from gusjob.frontend.parse.grammar import JOB_GRAMMAR, LISTING_GRAMMAR, grammar_path
from gusjob.frontend.parse.tables import (
    cache_directory,
    cached_tables,
    new_parser,
    packaged_tables,
    parser_from_tables,
    tables_key,
    tables_of,
)

GRAMMARS = (JOB_GRAMMAR, LISTING_GRAMMAR)


def grammar(name: str) -> str:
    return grammar_path(name).read_text(encoding="utf-8")


def lines(name: str) -> list[str]:
    if name == LISTING_GRAMMAR:
        paths = sorted((ROOT / "tests").rglob("*.gts")) + sorted((ROOT / "tests" / "manual").glob("*.c"))
    else:
        paths = [p for folder in (ROOT / "jobs", ROOT / "tests" / "bad") for p in sorted(folder.rglob("*.job"))]
    texts = [p.read_text(encoding="utf-8") for p in paths]
    return sorted({line.split(";")[0] for text in texts if len(text) < 20_000 for line in text.splitlines()})


def outcome(reader: Lark, line: str) -> str:
    try:
        return reader.parse(line).pretty()
    except UnexpectedInput as error:
        accepts = getattr(error, "accepts", None) or getattr(error, "allowed", None) or set()
        return f"{type(error).__name__} {error.column} {sorted(map(str, accepts))}"


def same(one: Lark, other: Lark, name: str) -> bool:
    return all(outcome(one, line) == outcome(other, line) for line in lines(name))


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache directory, and a version of lark that the packaged tables do not fit."""
    monkeypatch.setenv("LOCALAPPDATA" if sys.platform == "win32" else "XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setattr(lark, "__version__", "0.0.1-other")
    found = cache_directory()
    assert found is not None
    assert found.is_relative_to(tmp_path)
    return found


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Grammars whose tables were worked out."""
    texts: list[str] = []

    def counted(text: str) -> Lark:
        texts.append(text)
        return new_parser(text)

    monkeypatch.setattr(tables, "new_parser", counted)
    return texts


# Packaged tables.


@pytest.mark.parametrize("name", GRAMMARS)
def test_packaged_tables_belong_to_the_grammar(name: str, rewrite: bool) -> None:
    text, path = grammar(name), packaged_tables(name)
    key = tables_key(text)
    head = path.read_bytes().partition(b"\n")[0].decode() if path.is_file() else ""
    if rewrite and not head.startswith(key):
        path.write_bytes(tables_of(new_parser(text), key))
        head = path.read_bytes().partition(b"\n")[0].decode()
    assert head.split()[2:3] == [key.split()[2]], "run pytest --rewrite"


@pytest.mark.parametrize("name", GRAMMARS)
def test_packaged_tables_give_the_same_parser(name: str, made: list[str]) -> None:
    if not packaged_tables(name).read_text(encoding="utf-8").startswith(tables_key(grammar(name))):
        pytest.skip("the tables are for another version of lark")
    assert len(lines(name)) > 100
    assert same(parser_from_tables(name, grammar(name)), new_parser(grammar(name)), name)
    assert made == []
    assert packaged_tables(name).stat().st_size < 300_000


def test_line_ends_of_a_checkout_do_not_matter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = grammar(LISTING_GRAMMAR)
    copy = tmp_path / "listing.tables"
    copy.write_bytes(tables_of(new_parser(text), tables_key(text)).replace(b"\n", b"\r\n"))
    assert tables._load(copy, tables_key(text)) is not None


# The cache.


@pytest.mark.parametrize("name", GRAMMARS)
def test_another_lark_makes_tables_once(name: str, cache: Path, made: list[str]) -> None:
    text = grammar(name)
    first = parser_from_tables(name, text)
    assert made == [text]
    assert [path.suffix for path in cache.iterdir()] == [".tables"]
    second = parser_from_tables(name, text)
    assert made == [text]
    assert same(first, second, name)


def test_key_has_format_lark_and_grammar(cache: Path, made: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    text = grammar(LISTING_GRAMMAR)
    parser_from_tables(LISTING_GRAMMAR, text)
    parser_from_tables(LISTING_GRAMMAR, text + "\n// Another grammar.\n")
    monkeypatch.setattr(lark, "__version__", "0.0.2-other")
    parser_from_tables(LISTING_GRAMMAR, text)
    monkeypatch.setattr(tables, "_FORMAT", tables._FORMAT + 1)
    parser_from_tables(LISTING_GRAMMAR, text)
    assert len(made) == 4
    assert len(list(cache.iterdir())) == 4


def cached_file() -> tuple[Path, str]:
    """The cached tables of the listing grammar, and its text."""
    text = grammar(LISTING_GRAMMAR)
    parser_from_tables(LISTING_GRAMMAR, text)
    path = cached_tables(LISTING_GRAMMAR, tables_key(text))
    assert path is not None
    assert path.is_file()
    return path, text


def with_checksum(key: str, content: bytes) -> bytes:
    return f"{key} {zlib.crc32(content.strip()):08x}\n".encode() + content


@pytest.mark.parametrize(
    "damage",
    [
        lambda _, __: b"",
        lambda data, _: data[: len(data) // 2],
        lambda data, _: data.replace(b"NUMBER", b"NUMBEL"),
        lambda data, _: b"1 0.0.1-other 00000000" + data[22:],
        lambda _, __: bytes(range(256)),
        lambda _, key: with_checksum(key, b"{}\n"),
        lambda _, key: with_checksum(key, b"[1, 2]\n"),
        lambda _, key: with_checksum(key, b'{"data": {"parser": 1}, "memo": {}}\n'),
        lambda _, key: with_checksum(key, b"\x80\x04}\n"),
    ],
    ids=["empty", "half", "changed", "other key", "binary", "no tables", "a list", "no parser", "a pickle"],
)
def test_a_damaged_file_is_replaced(damage, cache: Path, made: list[str]) -> None:  # type: ignore[no-untyped-def]
    path, text = cached_file()
    good = path.read_bytes()
    path.write_bytes(damage(good, tables_key(text)))
    assert path.read_bytes() != good
    found = parser_from_tables(LISTING_GRAMMAR, text)
    assert made == [text, text]
    assert same(found, new_parser(text), LISTING_GRAMMAR)
    parser_from_tables(LISTING_GRAMMAR, text)
    assert made == [text, text]


def is_root() -> bool:
    return sys.platform != "win32" and os.geteuid() == 0


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such permissions")
@pytest.mark.parametrize("writable", ["file", "folder"])
def test_files_that_others_can_write_are_not_read(writable: str, cache: Path, made: list[str]) -> None:
    path, text = cached_file()
    (path if writable == "file" else cache).chmod(0o777)
    parser_from_tables(LISTING_GRAMMAR, text)
    assert made == [text, text]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such owners")
def test_files_of_another_user_are_not_read(cache: Path, made: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    _, text = cached_file()
    user = os.geteuid() + 1
    monkeypatch.setattr(os, "geteuid", lambda: user)
    parser_from_tables(LISTING_GRAMMAR, text)
    assert made == [text, text]


@pytest.mark.skipif(is_root() or sys.platform == "win32", reason="this user can write everywhere")
def test_a_directory_that_can_not_be_written(cache: Path, made: list[str]) -> None:
    cache.mkdir(parents=True)
    cache.chmod(0o500)
    text = grammar(LISTING_GRAMMAR)
    try:
        assert same(parser_from_tables(LISTING_GRAMMAR, text), new_parser(text), LISTING_GRAMMAR)
        parser_from_tables(LISTING_GRAMMAR, text)
    finally:
        cache.chmod(0o700)
    assert made == [text, text]
    assert list(cache.iterdir()) == []


def test_a_file_in_place_of_the_directory(cache: Path, made: list[str]) -> None:
    cache.parent.mkdir(parents=True)
    cache.write_bytes(b"")
    text = grammar(LISTING_GRAMMAR)
    assert same(parser_from_tables(LISTING_GRAMMAR, text), new_parser(text), LISTING_GRAMMAR)
    assert made == [text]


@pytest.mark.parametrize("step", ["mkdir", "mkstemp", "fdopen", "replace"])
def test_a_write_that_fails_leaves_nothing_behind(step: str, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*arguments: object, **_: object) -> None:
        if step == "fdopen":
            os.close(arguments[0])  # type: ignore[arg-type]
        raise OSError(30, "Read-only file system")

    owner = {"mkdir": Path, "mkstemp": tempfile, "fdopen": os, "replace": Path}[step]
    text = grammar(LISTING_GRAMMAR)
    with monkeypatch.context() as patch:
        patch.setattr(owner, step, fails)
        found = parser_from_tables(LISTING_GRAMMAR, text)
    assert same(found, new_parser(text), LISTING_GRAMMAR)
    assert not cache.exists() or list(cache.iterdir()) == []


def test_no_home_directory(cache: Path, made: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    def homeless() -> Path:
        raise RuntimeError("Could not determine home directory.")

    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(Path, "home", homeless)
    assert cache_directory() is None
    parser_from_tables(LISTING_GRAMMAR, grammar(LISTING_GRAMMAR))
    assert len(made) == 1
    assert not cache.exists()


def test_a_relative_home_directory_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(Path, "home", lambda: Path("here"))
    assert cache_directory() is None


@pytest.mark.parametrize(
    ("platform", "variables", "folder"),
    [
        ("linux", {}, "~/.cache/gusjob"),
        ("linux", {"XDG_CACHE_HOME": "/x/cache"}, "/x/cache/gusjob"),
        ("linux", {"XDG_CACHE_HOME": "relative"}, "~/.cache/gusjob"),
        ("darwin", {"XDG_CACHE_HOME": "/x/cache"}, "~/Library/Caches/gusjob"),
        ("win32", {"LOCALAPPDATA": "/x/local"}, "/x/local/gusjob"),
        ("win32", {}, "~/AppData/Local/gusjob"),
    ],
)
def test_directory_of_each_platform(
    platform: str, variables: dict[str, str], folder: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    monkeypatch.setattr(sys, "platform", platform)
    assert cache_directory() == Path(folder.replace("~", str(tmp_path)))
