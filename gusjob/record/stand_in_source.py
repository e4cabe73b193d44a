"""The C source of the stand-in: the files of stand_in/, and the functions without a model, which are generated.

A function that no file of stand_in/ has takes its C arguments from functions.txt, is recorded, and returns 0. A line
or arc in X and Y moves the head all the same; another buffered call takes its slot.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

from gusjob.config.machine import Abi
from gusjob.controllers.gus.functions import Effect, FunctionArg, LibraryFunction, functions
from gusjob.patterns import lazy_pattern

FOLDER = Path(__file__).with_name("stand_in")
MAIN_FILE = FOLDER / "library.c"
AUDIT_FILE = FOLDER / "audit.c"
GENERATED = "functions.h"
ABI_NUMBERS = {Abi.GUS: 0, Abi.GTS: 1, Abi.GTS_MULTI: 2}
"""VC_ABI of the C source."""

_SYMBOL = lazy_pattern(r"^API (GT_\w+)\(", re.MULTILINE)
_NUMBERS = {"short", "long", "unsigned short", "unsigned long", "double", "int", "unsigned int", "char"}
_MOTIONS = {
    "put_line": ("crd", "x", "y", "synVel", "synAcc", "velEnd", "fifo"),
    "put_arc_by_centre": ("crd", "x", "y", "xCenter", "yCenter", "circleDir", "synVel", "synAcc", "velEnd", "fifo"),
    "put_arc_by_radius": ("crd", "x", "y", "radius", "circleDir", "synVel", "synAcc", "velEnd", "fifo"),
}
"""What an effect in calls.h takes, by the names in the table. Without velEnd the motion ends at rest."""
_MOTION_NAMES = {"GT_LnXY": "put_line", "GT_ArcXYC": "put_arc_by_centre", "GT_ArcXYR": "put_arc_by_radius"}


def source_files() -> tuple[Path, ...]:
    """Return all files of the source, in a fixed order."""
    return tuple(sorted(path for path in FOLDER.iterdir() if path.suffix in (".c", ".h")))


@cache
def modelled() -> frozenset[str]:
    """Return the names of the functions that the files of stand_in/ have."""
    texts = (path.read_text(encoding="ascii") for path in source_files())
    return frozenset(name for text in texts for name in _SYMBOL.findall(text))


def exported() -> frozenset[str]:
    """Return the names of all functions of the stand-in."""
    return modelled() | functions().keys()


def generated_functions() -> str:
    """Return the C source of all functions without a model."""
    others = [function for name, function in sorted(functions().items()) if name not in modelled()]
    return "\n".join(["/* Generated: the functions without a model. */", *map(_c_function, others)])


def _c_function(function: LibraryFunction) -> str:
    """Return one function. Its parameters are p0, p1, ...: names of the table may be taken in C."""
    name, args = function.name, function.args
    card = "CARD" if args else "CARD_ALONE"
    parameters = ", ".join(f"{_declared(arg)}p{i}" for i, arg in enumerate(args))
    given = [f"(double)p{i}" for i, arg in enumerate(args) if arg.c_type in _NUMBERS]
    texts = [f"p{i}" for i, arg in enumerate(args) if _is_text(arg)][:1]
    effect, taken = _effect(function)
    lines = [
        f"API {name}({card}{' ' + parameters if parameters else ''})",
        "{",
        f"    double given[] = {{{', '.join(given) or '0'}}};",
        f'    Call made = {{.card = CARD_NUMBER, .name = "{name}", .form = "{_form(args)}", .given = given,',
        f"                 .text = {texts[0] if texts else 'NULL'}}};",
        f"    double a[] = {{{taken or '0'}}};",
        f"    short code = make_call(&made, {effect}, a, NULL);",
        *(
            f"    if (code == DONE && p{i})\n        *p{i} = 0;"
            for i, arg in enumerate(args)
            if name.startswith("GT_Get") and arg.c_type.removesuffix(" *") in _NUMBERS - {"char", arg.c_type}
        ),
        "    return code;",
        "}",
    ]
    return "\n".join(lines) + "\n"


def _declared(arg: FunctionArg) -> str:
    """Return the C type of a parameter; what a pointer to a struct or function points to is never read."""
    if arg.c_type.removesuffix(" *") not in _NUMBERS:
        return "void *"
    own = arg.c_type.replace("unsigned long", "ULong").replace("long", "Long")
    return own if own.endswith("*") else f"{own} "


def _is_text(arg: FunctionArg) -> bool:
    """Return whether an argument is the name of a file or of a thing: a text that the program passes."""
    return arg.c_type == "char *" and ("Name" in arg.name or "File" in arg.name)


def _form(args: tuple[FunctionArg, ...]) -> str:
    """Return how the arguments are written: # a number, $ the first text."""
    marks: list[str] = []
    for arg in args:
        is_text = _is_text(arg) and "$" not in marks
        marks.append("#" if arg.c_type in _NUMBERS else "$" if is_text else "pointer")
    return ",".join(marks)


def _effect(function: LibraryFunction) -> tuple[str, str]:
    """Return the function in C that carries a call out, and what it takes."""
    index = {arg.name: f"(double)p{i}" for i, arg in enumerate(function.args)}
    base = re.sub(r"(G0)?(Override2)?(WN)?$", "", function.name)
    motion = _MOTION_NAMES.get(re.sub(r"^(GT_LnXY)ZA?$", r"\1", base), "")
    if motion and all(name in index or name == "velEnd" for name in _MOTIONS[motion]):
        return motion, ", ".join(index.get(name, "0") for name in _MOTIONS[motion])
    is_buffered = function.effect in (Effect.PATH, Effect.LASER) and {"crd", "fifo"} <= index.keys()
    if is_buffered and re.match("GT_(Buf|Ln|Arc|Helix|CrdData)", function.name):
        return "put_nothing", f"{index['crd']}, {index['fifo']}"
    return "do_nothing", ""
