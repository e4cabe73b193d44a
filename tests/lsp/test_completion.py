"""Completion offers what the parser accepts."""

from __future__ import annotations

from pathlib import Path

from support.editor import editor, folder, run

from gusjob.kinematics.units import UNITS
from gusjob.lsp.completion import accepted, unit_fits


def test_completion_is_what_the_parser_takes(tmp_path: Path) -> None:
    text = (
        'LINE \nJUMP \nLINE X 1 \nLASER MODE \nLASER DELAY ON 5u\nLINE X (2*1)\nINCLUDE "\nLET \nVEL 10m\n'
        "LASER POWER 5\nFOR i FROM 0 \nlaser \nARC CW X1Y2 \nUNITS \nLASER POWER 5 \n"
    )

    async def session() -> None:
        job = folder(tmp_path, job=text, other="WAIT\n") / "job.job"
        async with editor() as ed:
            ed.open(job, text)
            ends = [len(line) for line in text.split("\n")]
            got = [set(await ed.complete(job, n, end)) for n, end in enumerate(ends)]
        assert got[0] == {"X", "Y", "VEL", "ACC", "END"}
        assert got[1] == {"X", "Y"}
        assert got[2] == {"Y", "VEL", "ACC", "END"}
        assert got[3] == {"DUTY", "DUTY2", "FREQUENCY", "ANALOG"}
        assert got[4] == {"us", "ms", "s"}
        assert got[6] == {"other.job"}
        assert got[7] == set()
        assert got[8] == {"m/s", "mm/s", "mm/min", "pulse/ms"}
        assert got[9] == {"%", "Hz", "kHz", "MHz", "V", "mV"}
        assert "TO" in got[10]
        assert got[11] == {"MODE", "DELAY", "STANDBY", "PREVOLT", "FPK", "DISTANCE", "POWER", "FOLLOW", "ON", "OFF"}
        assert got[12] == {"I", "J", "R", "VEL", "ACC", "END"}
        assert got[13] == {"MM", "PULSE"}
        assert got[14] == {"NOW", "CHANNEL"}

    run(session())
    assert {unit for unit in UNITS if unit_fits("VEL 5", unit)} == {"mm/s", "m/s", "mm/min", "pulse/ms"}
    assert accepted("LINE X X") == []
