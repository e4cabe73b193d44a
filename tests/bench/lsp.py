"""How long an editor waits for diagnostics after a keystroke: `python tests/bench/lsp.py [KEYSTROKES]`.

A scripted session through pygls' client over stdio: a job of 100, 10,000 and 100,000 lines is opened, then in random
lines a digit is typed (one change of one character, incremental sync), and the answer is waited for. Every tenth
keystroke breaks the line, the next one mends it. At 100,000 lines the median is to be below 200 ms.
"""

from __future__ import annotations

import asyncio
import statistics
import sys
import tempfile
import time
from pathlib import Path
from random import Random

from lsprotocol import types as lsp
from pygls.lsp.client import LanguageClient

SIZES = (100, 10_000, 100_000)
HEAD = "LASER MODE DUTY CARRIER 20kHz\nVEL 500mm/s\nACC 50000mm/s2\nLASER POWER 40\nJUMP X 0 Y 0\nLASER ON\n"


def job(lines: int, rng: Random) -> list[str]:
    """Raster work: LASER POWER and LINE in turn."""
    made = HEAD.splitlines()
    while len(made) < lines - 1:
        made.append(f"LINE X {rng.uniform(-50, 50):.3f} Y {rng.uniform(-50, 50):.3f}")
        made.append(f"LASER POWER {rng.uniform(10, 90):.2f}")
    return [*made[: lines - 1], "LASER OFF"]


async def session(lines: int, keystrokes: int) -> tuple[float, list[float]]:
    """Seconds until the first diagnostics after opening, and after each keystroke."""
    client = LanguageClient("gusjob-bench", "1")
    heard: asyncio.Queue[lsp.PublishDiagnosticsParams] = asyncio.Queue()

    @client.feature(lsp.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)  # type: ignore[untyped-decorator]  # pygls'
    def published(params: lsp.PublishDiagnosticsParams) -> None:
        heard.put_nowait(params)

    async def answer(version: int) -> lsp.PublishDiagnosticsParams:
        while True:
            params = await asyncio.wait_for(heard.get(), 60)
            if params.version == version:
                return params

    rng = Random(lines)
    text = job(lines, rng)
    with tempfile.TemporaryDirectory(prefix="gusjob-bench-") as folder:
        uri = (Path(folder) / "bench.job").as_uri()
        await client.start_io(sys.executable, "-m", "gusjob", "lsp")
        await client.initialize_async(lsp.InitializeParams(capabilities=lsp.ClientCapabilities()))
        client.initialized(lsp.InitializedParams())
        begin = time.perf_counter()
        item = lsp.TextDocumentItem(uri=uri, language_id="gusjob", version=0, text="\n".join(text) + "\n")
        client.text_document_did_open(lsp.DidOpenTextDocumentParams(text_document=item))
        await answer(0)
        opened, waited = time.perf_counter() - begin, []
        broken = -1
        for version in range(1, keystrokes + 1):
            number = broken if broken >= 0 else rng.randrange(len(HEAD.splitlines()), lines - 1)
            typed = "#" if version % 10 == 0 and broken < 0 else "" if broken >= 0 else "1"
            end = len(text[number])
            start = end - 1 if broken >= 0 else end
            text[number] = text[number][:start] + typed
            broken = number if typed == "#" else -1
            place = lsp.Range(start=lsp.Position(number, start), end=lsp.Position(number, end))
            change = lsp.TextDocumentContentChangePartial(range=place, text=typed)
            document = lsp.VersionedTextDocumentIdentifier(uri=uri, version=version)
            begin = time.perf_counter()
            client.text_document_did_change(lsp.DidChangeTextDocumentParams(document, [change]))
            found = await answer(version)
            waited.append(time.perf_counter() - begin)
            wrong = any(one.code == "GJ101" for one in found.diagnostics)
            assert wrong == (broken >= 0), "the answer is not this text's"
        await client.shutdown_async(None)
        client.exit(None)
        await client.stop()  # type: ignore[no-untyped-call]  # pygls'
    return opened, waited


def main(keystrokes: int) -> None:
    """Print the table."""
    print("| lines | open, ms | median, ms | p90, ms | worst, ms |")
    print("|------:|---------:|-----------:|--------:|----------:|")
    for lines in SIZES:
        opened, waited = asyncio.run(session(lines, keystrokes))
        tenth = sorted(waited)[int(len(waited) * 0.9)]
        cells = (opened, statistics.median(waited), tenth, max(waited))
        print(f"| {lines:,} | " + " | ".join(f"{1000 * seconds:.0f}" for seconds in cells) + " |", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
