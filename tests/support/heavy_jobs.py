"""Jobs of less than 10 KB that ask for much work: by nesting, by doubling, by long loops, by long expressions."""

from __future__ import annotations

import random

HEAD = "VEL 100\nACC 1000\nLASER MODE DUTY CARRIER 10\nLASER POWER 50\n"


def nested(head: str, depth: int, body: str = "") -> str:
    """Blocks within blocks. `head`: the first lines of each, which one END ends."""
    return (head + "\n") * depth + body + "END\n" * depth


def sums(name: str, count: int) -> str:
    """A sum of a name and itself."""
    return "+".join([name] * count)


def lets(count: int) -> str:
    """LETs of as many names, by the loop variable i."""
    return "".join(f"LET a{k} = i*{k}\n" for k in range(count))


def doubling(count: int, body: str, times: int = 2) -> str:
    """Routines that each call the one before it some times."""
    calls = "".join(f"DEF f{k + 1}()\n" + f"CALL f{k}()\n" * times + "END\n" for k in range(count))
    return f"DEF f0()\n{body}END\n{calls}CALL f{count}()\n"


def including(count: int, head: str = "", times: int = 2) -> dict[str, str]:
    """Files that each include the next one some times."""
    files = {f"f{k}.job": head + f'INCLUDE "f{k + 1}.job"\n' * times for k in range(count)}
    return {**files, f"f{count}.job": "DWELL 1\n"}


CARRIED = "LET a = 0\n"
TEXTS = {
    "empty loops": nested("REPEAT 2", 32),
    "empty loops, too deep": nested("REPEAT 2", 40),
    "empty loops of five": nested("REPEAT 5", 32),
    "empty loops of thousands": nested("REPEAT 1000", 32),
    "empty loops, two in each": nested("REPEAT 2\nEND\nREPEAT 3", 31),
    "loops without END": "REPEAT 2\n" * 1000,
    "LET in loops": nested("REPEAT 2", 31, "LET a = 1\n"),
    "carried LET in loops": CARRIED + nested("REPEAT 2", 30, "LET a = a + 1\n"),
    "IF in loops": "".join(f"REPEAT 2 AS i{k}\nIF i{k} >= 0\n" for k in range(16)) + "END\n" * 32,
    "FRAME in loops": "REPEAT 2\nFRAME SHIFT X 1 ROTATE 5 SCALE 1.01\n" * 16 + HEAD + "LINE X 1\n" + "END\n" * 32,
    "a long carried loop": CARRIED + "REPEAT 4000000\nLET a = a + 1\nEND\n",
    "a long carried loop of lines": CARRIED + "REPEAT 999999\nLET a = a + 0.0001\nLINE X (a)\nEND\n",
    "a long carried loop of IFs": CARRIED + "REPEAT 4000000\nIF a > 1\nLET a = a + 1\nEND\nEND\n",
    "a long carried loop of LETs": CARRIED + "REPEAT 1000000\n" + "LET a = a + 1\n" * 600 + "END\n",
    "carried loops in a loop": "REPEAT 1000 AS j\nLET a = 0\nREPEAT 100000\nLET a = a + j\nEND\nEND\n",
    "loops in a carried loop": CARRIED + "REPEAT 40000\nLET a = a + 1\nREPEAT 60 AS i\nLINE X (i*0.1)\nEND\nEND\n",
    "empty loops in a carried loop": CARRIED + "REPEAT 100000\nLET a = a + 1\n" + "REPEAT 5\nEND\n" * 700 + "END\n",
    "a routine that calls itself twice": "DEF f(n)\nIF n > 0\nCALL f(n-1)\nCALL f(n-1)\nEND\nEND\nCALL f(29)\n",
    "a routine that calls itself in a loop": "DEF f(n)\nIF n > 0\nREPEAT 9\nCALL f(n-1)\nEND\nEND\nEND\nCALL f(50)\n",
    "routines that double": doubling(60, "DWELL 1\n"),
    "empty routines that double": doubling(60, ""),
    "empty routines, twenty calls each": doubling(30, "", 20),
    "many values": f"DEF f({','.join(f'a{k}' for k in range(900))})\nEND\nREPEAT 999999 AS i\nCALL f("
    + ",".join(["i"] * 900)
    + ")\nEND\n",
    "tiny steps": "FOR x FROM 0 TO 1 STEP 1e-9\nDWELL 1\nEND\n",
    "a huge count": "REPEAT 1e15\nDWELL 1\nEND\n",
    "relative moves": HEAD + "COORDS REL\nREPEAT 499000\nLINE X 0.001\nLINE X -0.001\nEND\n",
    "relative moves out of the field": HEAD + "COORDS REL\nREPEAT 499000\nLINE X 1\nLINE X 1\nEND\n",
    "marks": HEAD + "REPEAT 249000 AS i\nLASER ON\nLINE X (i%10) Y 1\nLASER OFF\nJUMP X (i%9) Y 1\nEND\n",
    "computed setup statements": HEAD + "REPEAT 49000 AS i\nLINE X (i%10)\nLASER DELAY ON (i%100) OFF (i%200)\nEND\n",
    "frames": HEAD + "REPEAT 499000 AS i\nFRAME SHIFT X 1 Y 1 ROTATE 5\nLINE X 1\nEND\nEND\n",
    "frames in frames": HEAD + "REPEAT 33000 AS i\n" + "FRAME SHIFT X (i)\n" * 29 + "LINE X 1\n" + "END\n" * 30,
    "deep parentheses": "LET a = " + "(" * 4000 + "1" + ")" * 4000 + "\n",
    "many signs": "LET a = " + "-" * 9000 + "1\n",
    "powers of powers": "LET a = (" + "**".join(["2"] * 2500) + ")\n",
    "a long sum in a loop": f"REPEAT 999999 AS a\nDWELL ({sums('a', 4500)})\nEND\n",
    "long sums in a loop": "REPEAT 100000 AS a\n" + f"LET b = {sums('a', 90)}\n" * 45 + "END\n",
    "sines in a loop": "REPEAT 999999 AS a\n" + "LET b = sin(cos(sin(a)))**2.5\n" * 250 + "END\n",
    "a long condition": "REPEAT 999999 AS a\nIF " + " and ".join(["a > 1"] * 900) + "\nDWELL 1\nEND\nEND\n",
    "many names in a loop": "REPEAT 999999 AS i\n" + lets(550) + "END\n",
    "many names around loops": "REPEAT 1000 AS i\n" + lets(400) + "REPEAT 999\nREPEAT 3\nDWELL 1\nEND\nEND\nEND\n",
    "many names around IFs": "REPEAT 100000 AS i\n" + lets(300) + "IF i % 2 == 0\nDWELL 1\nEND\n" * 100 + "END\n",
    "many IFs": "REPEAT 999999 AS i\n" + "IF i%2==0\nELSE\nEND\n" * 400 + "END\n",
    "IF in IF": "REPEAT 999999 AS i\n" + "IF i > 0\n" * 31 + "DWELL 1\n" + "END\n" * 32,
    "many diagnostics": HEAD
    + "REPEAT 249000 AS i\nLINE X (999+i) Y (sqrt(-1-i)) VEL (0-i)\nLASER POWER (300+i)\nEND\n",
    "many unknown names": "REPEAT 1000 AS i\n" + "DWELL (b)\n" * 900 + "END\n",
    "long names": "".join(f"LET abcdefghij{k} = 1\n" for k in range(200)) + "DWELL (abcdefghik)\n" * 250,
}
FILES = {
    "files that double": including(15),
    "files, forty in each": including(14, times=40),
    "files with LETs": including(14, "LET a = 1\n", 20),
    "files in loops": {
        **{f"f{k}.job": f'REPEAT 2\nINCLUDE "f{k + 1}.job"\nEND\n' for k in range(15)},
        "f15.job": "LET a = 1\n",
    },
    "a file in a loop": {
        "f0.job": "REPEAT 1000\n" + 'INCLUDE "f1.job"\n' * 200 + "END\n",
        "f1.job": "REPEAT 1000\nDWELL 1\nEND\n",
    },
    **{name: {"f0.job": text} for name, text in TEXTS.items()},
}
"""By name, the files of each; the job is f0.job."""


def random_text(seed: int) -> str:
    """Blocks and statements in any order, with large counts."""
    rng = random.Random(seed)
    lines = ["LET a = 1", "DEF f(n)", "IF n > 0", "CALL f(n-1)", "CALL f(n-2)", "END", "DWELL 1", "END"]
    heads = ("REPEAT {} AS i", "REPEAT {}", "FOR k FROM 0 TO {}", "IF a % 2 == 0", "FRAME SHIFT X (a%3) ROTATE 5")
    statements = ("LET a = a + 1", "LET b = a * 2", "DWELL (a % 9)", "LINE X (a % 9)", "CALL f({})", "WAIT", "LASER ON")
    depth = 0
    while len(lines) < rng.choice((20, 60, 300)) or depth:
        if depth and (rng.random() < 0.3 or len(lines) > 300):
            lines.append("END")
            depth -= 1
        elif depth < 12 and rng.random() < 0.5:
            lines.append(rng.choice(heads).format(rng.choice((2, 2, 3, 7, 50, 1000, 100000))))
            depth += 1
        else:
            lines.append(rng.choice(statements).format(rng.choice((2, 5, 20))))
    return "\n".join([*lines, ""])
