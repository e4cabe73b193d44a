"""How fast calls are fed to a controller, and the shortest segment that can be fed for ever.

Run by hand: python tests/bench/feed.py [ROWS]. The virtual controller runs in real time (its call log is off); what a
real library's calls take comes on top. Where the FIFO runs dry the rate is as fast as calls can be made.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from support.controller import GUS
from support.hardware import Bench, bench

from gusjob.config.machine import Machine
from gusjob.controllers.gus.calls import Stream
from gusjob.frontend import check_text, read_listing

HEAD = (
    "GT_SetAxisMode(7,1)\nGT_LaserPowerMode(0,100,0,0)\nGT_LaserOutFrq(20,0)\n"
    "GT_SetCrdPrm(1,{2,{1,2,0,0,0,0,0,0},10000,1000,0,1,{0,0,0,0,0,0,0,0}})\nGT_CrdClear(1,0)\n"
    "GT_BufLaserPrfCmd(1,30,0,0)\nGT_BufLaserOn(1,0,0)\n"
)


def short_segments(rows: int, segment_us: float) -> Stream:
    """A straight way there and back in segments that take so long each, at one velocity."""
    step = 10
    vel = step / (segment_us / 1000)
    there = np.abs((np.arange(1, rows + 1) * step + 500_000) % 2_000_000 - 1_000_000) - 500_000
    lines = "".join(f"GT_LnXY(1,{x},0,{vel!r},1000,{vel!r},0)\n" for x in there.tolist()[:-1])
    last = f"GT_LnXY(1,{there[-1]},0,{vel!r},1000,0,0)\nGT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"
    source, _ = check_text((HEAD + lines + last).encode(), "bench.gts")
    assert source is not None
    stream, diagnostics = read_listing(source)
    assert diagnostics == []
    return stream


def fed(made: Bench, rows: int, segment_us: float) -> tuple[bool, float]:
    """Whether so many segments of a length in time can be fed, and how many calls a second were made."""
    stream, machine = short_segments(rows, segment_us), made.machine(Machine())
    made.controller.reset()
    made.controller.options(speed=1, log=0)
    began = time.perf_counter()
    ran = made.run(stream, machine)
    took_s = time.perf_counter() - began
    return not ran.faults, ran.session.link.call_count / took_s


def main() -> None:
    """Print the figures."""
    rows = int(sys.argv[1]) if len(sys.argv) > 1 else 200_000
    with tempfile.TemporaryDirectory() as name:
        made = bench(Path(name), GUS)
        low, high = 0.5, 64.0
        while high / low > 1.05:
            middle = (low * high) ** 0.5
            good, rate = fed(made, rows, middle)
            print(f"  {middle:6.2f} us a segment: {'fed' if good else 'ran dry'} ({rate:,.0f} calls/s)")
            low, high = (low, middle) if good else (middle, high)
        print(f"shortest segment that is fed for ever: {high:.1f} us, {1e6 / high:,.0f} segments/s")
        before = peak_mb()
        fed(made, rows, 2 * high)
        print(f"memory grown by one more run: {peak_mb() - before:.1f} MB")


def peak_mb() -> float:
    """The most memory that this process ever had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    main()
