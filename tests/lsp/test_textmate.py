"""The TextMate grammar."""

from __future__ import annotations

import json
import re

from click.testing import CliRunner

from gusjob.cli import cli
from gusjob.frontend.parse.grammar import keywords
from gusjob.kinematics.units import UNITS
from gusjob.lsp.textmate import GRAMMAR_PATH, textmate


def test_the_textmate_grammar_is_made_from_the_grammar(rewrite: bool) -> None:
    if rewrite:
        GRAMMAR_PATH.write_text(textmate(), encoding="utf-8", newline="\n")
    assert GRAMMAR_PATH.read_text(encoding="utf-8") == textmate(), "run pytest --rewrite"
    assert CliRunner().invoke(cli, ["lsp", "--textmate"]).output == textmate()


def test_the_textmate_grammar_colours_every_word() -> None:
    made = json.loads(textmate())
    patterns = [(p.get("name", "number"), re.compile(p["match"])) for p in made["patterns"]]

    def colours(line: str) -> list[tuple[str, str]]:
        """As an engine does: at each place the first pattern that fits, then on behind it."""
        at, found = 0, []
        while at < len(line):
            hits = [(m.start(), n, name, m) for n, (name, one) in enumerate(patterns) if (m := one.search(line, at))]
            if not hits:
                break
            _, _, name, match = min(hits, key=lambda hit: hit[:2])
            found.append((match[0], name.split(".")[0]))
            at = max(match.end(), at + 1)
        return found

    for word in keywords("job.lark"):
        assert colours(word)[0][1] == "keyword", word
    for unit in UNITS:
        assert colours(f"5{unit}") == [(f"5{unit}", "number")], unit
    assert colours("X10Y-2.5mm ; X") == [
        ("X", "keyword"), ("10", "number"), ("Y", "keyword"), ("2.5mm", "number"), ("; X", "comment")
    ]  # fmt: skip
    assert colours("hypot(pi, width_1)") == [("hypot", "support"), ("pi", "constant"), ("width_1", "variable")]
