"""The C source of the stand-in against the table of the library's functions."""

from __future__ import annotations

import re

from gusjob.controllers.gus.functions import functions
from gusjob.record.stand_in_source import FOLDER, exported, generated_functions, modelled

PROTOTYPE = re.compile(r"^API (GT_\w+)\(((?:[^()]|\n)*)\)", re.MULTILINE)


def prototypes() -> list[tuple[str, list[str]]]:
    """Every function of the C files, with the types of its arguments without the card's number."""
    found = []
    for path in sorted(FOLDER.glob("*.h")):
        for name, parameters in PROTOTYPE.findall(path.read_text(encoding="ascii")):
            text = re.sub(r"\bCARD_ALONE\b|\bCARD\b|\bvoid\b", "", parameters)
            found.append((name, [kind(part) for part in text.split(",") if part.strip()]))
    return found


def kind(parameter: str) -> str:
    """'unsigned long *' of 'unsigned long *pClock'."""
    own = parameter.replace("ULong", "unsigned long").replace("Long", "long")
    words = " ".join(own.replace("*", " * ").split()[:-1])
    return re.sub(r"\* \*", "**", words)


def test_the_models_have_the_arguments_of_the_table() -> None:
    """A wrong size would shift all arguments behind it, and on 32-bit Windows the stack."""
    table = {name: [arg.c_type for arg in function.args] for name, function in functions().items()}
    found = prototypes()
    assert len(found) > 45
    assert {name for name, _ in found} - table.keys() == set()
    # The manual's own forms, beside those of the sister series.
    assert {(name, *types) for name, types in found if types != table[name]} <= {
        ("GT_LaserPowerMode", "short", "double", "double", "short"),
        ("GT_SetPulseWidth", "unsigned short", "short"),
    }
    assert {name for name, types in found if types == table[name]} == modelled()


def test_every_function_is_exported_once() -> None:
    generated = re.findall(r"^API (GT_\w+)\(", generated_functions(), re.MULTILINE)
    assert len(generated) == len(set(generated))
    assert modelled().isdisjoint(generated)
    assert modelled() | set(generated) == exported() == functions().keys()


def one(name: str) -> str:
    """The generated source of a function."""
    found = re.search(rf"^API {name}\(.*?^\}}", generated_functions(), re.MULTILINE | re.DOTALL)
    assert found is not None
    return found[0]


def test_a_function_without_a_model() -> None:
    assert one("GT_PrfTrap") == "\n".join(
        [
            "API GT_PrfTrap(CARD short p0)",
            "{",
            "    double given[] = {(double)p0};",
            '    Call made = {.card = CARD_NUMBER, .name = "GT_PrfTrap", .form = "#", .given = given,',
            "                 .text = NULL};",
            "    double a[] = {0};",
            "    short code = make_call(&made, do_nothing, a, NULL);",
            "    return code;",
            "}",
        ]
    )


def test_lines_in_space_move_the_head() -> None:
    """GT_LnXYZWN(crd, x, y, z, synVel, synAcc, velEnd, segNum, fifo)."""
    assert "make_call(&made, put_line, a, NULL)" in one("GT_LnXYZWN")
    taken = ", ".join(f"(double)p{i}" for i in (0, 1, 2, 4, 5, 6, 8))
    assert f"double a[] = {{{taken}}};" in one("GT_LnXYZWN")


def test_a_line_to_rest_ends_with_0() -> None:
    """GT_LnXYZG0(crd, x, y, z, synVel, synAcc, fifo)."""
    assert "double a[] = {(double)p0, (double)p1, (double)p2, (double)p4, (double)p5, 0, (double)p6};" in one(
        "GT_LnXYZG0"
    )


def test_arcs_in_other_planes_only_take_their_slot() -> None:
    assert "make_call(&made, put_nothing, a, NULL)" in one("GT_ArcYZC")


def test_what_a_getter_answers() -> None:
    """Zeros, where the type tells how long the answer is."""
    assert "*p1 = 0" in one("GT_GetPrfVel")
    assert "= 0;" not in one("GT_GetTrapPrm")
    assert "*p" not in one("GT_GetUuid").replace("char *p0", "")
    assert '.form = "$"' in one("GT_LoadExtConfig")
