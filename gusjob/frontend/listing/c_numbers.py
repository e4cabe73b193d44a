"""Numbers as C computes them: whole and floating types, their conversions and operators.

Whole numbers are read as 32 bits wide, which every C compiler agrees on: `long` is wider on some. A result that would
not fit, or that depends on the width of a type, has no value.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from enum import IntEnum

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from gusjob.patterns import lazy_pattern


class NumberKind(IntEnum):
    """Type of a number after C's promotions, in the order of C's conversions.

    OPEN: a whole number in a variable that is declared elsewhere, perhaps as a floating type.
    """

    INT = 0
    UNSIGNED = 1
    OPEN = 2
    FLOAT = 3
    DOUBLE = 4


class CNumber(Struct, frozen=True, kw_only=True):
    """A number of a C program. `is_code`: it is made of return codes, each taken as 0, as of a call that worked."""

    value: float
    kind: NumberKind = NumberKind.INT
    is_code: bool = False

    @property
    def is_whole(self) -> bool:
        """Whether its type has whole numbers only."""
        return self.kind <= NumberKind.OPEN


INT_MIN, INT_MAX, UINT_MAX = -(2**31), 2**31 - 1, 2**32 - 1


class NumberType(Struct, frozen=True, kw_only=True):
    """A C type of numbers: a whole type with its range, or a floating one.

    `c`: its name where the library takes arrays of it, else ''.
    """

    kind: NumberKind
    low: float = -math.inf
    high: float = math.inf
    is_bool: bool = False
    c: str = ""

    def convert(self, number: CNumber) -> CNumber | None:
        """Convert a number to the type, as an assignment or a cast does; None where compilers differ."""
        value = number.value
        if self.is_bool:
            return CNumber(value=float(value != 0), is_code=number.is_code)
        if self.kind is NumberKind.FLOAT:
            value = _single(value)
        elif self.kind is not NumberKind.DOUBLE:
            value = float(math.trunc(value)) if math.isfinite(value) else math.nan
        if not (math.isfinite(value) and self.low <= value <= self.high):
            return None
        return replace(number, value=value + 0.0, kind=self.kind)


_INT = NumberType(kind=NumberKind.INT, low=INT_MIN, high=INT_MAX)
_LONG = NumberType(kind=NumberKind.INT, low=INT_MIN, high=INT_MAX, c="long")
_UINT = NumberType(kind=NumberKind.UNSIGNED, low=0, high=UINT_MAX)
_SHORT = NumberType(kind=NumberKind.INT, low=-(2**15), high=2**15 - 1)
_USHORT = NumberType(kind=NumberKind.INT, low=0, high=2**16 - 1)
_BYTE = NumberType(kind=NumberKind.INT, low=0, high=255)
_CHAR = NumberType(kind=NumberKind.INT, low=0, high=127)
"""Plain char may be signed or not."""
_BOOL = NumberType(kind=NumberKind.INT, is_bool=True)
_DOUBLE = NumberType(kind=NumberKind.DOUBLE, c="double")
_FLOAT = NumberType(kind=NumberKind.FLOAT)
_SBYTE = NumberType(kind=NumberKind.INT, low=-128, high=127)

_TYPES = {
    "short": _SHORT,
    "short int": _SHORT,
    "signed short": _SHORT,
    "signed short int": _SHORT,
    "unsigned short": _USHORT,
    "unsigned short int": _USHORT,
    "int": _INT,
    "signed": _INT,
    "signed int": _INT,
    "long": _LONG,
    "long int": _LONG,
    "signed long": _LONG,
    "signed long int": _LONG,
    "unsigned": _UINT,
    "unsigned int": _UINT,
    "unsigned long": _UINT,
    "unsigned long int": _UINT,
    "char": _CHAR,
    "signed char": _SBYTE,
    "unsigned char": _BYTE,
    "bool": _BOOL,
    "_Bool": _BOOL,
    "double": _DOUBLE,
    "float": _FLOAT,
    # Windows and C#.
    "byte": _BYTE,
    "sbyte": _SBYTE,
    "ushort": _USHORT,
    "uint": _UINT,
    "BYTE": _BYTE,
    "WORD": _USHORT,
    "DWORD": _UINT,
    "BOOL": _INT,
    "SHORT": _SHORT,
    "USHORT": _USHORT,
    "INT": _INT,
    "UINT": _UINT,
    "LONG": _LONG,
    "ULONG": _UINT,
    "DOUBLE": _DOUBLE,
    "FLOAT": _FLOAT,
    "Int16": _SHORT,
    "UInt16": _USHORT,
    "Int32": _INT,
    "UInt32": _UINT,
    "int8_t": _SBYTE,
    "uint8_t": _BYTE,
    "int16_t": _SHORT,
    "uint16_t": _USHORT,
    "int32_t": _INT,
    "uint32_t": _UINT,
}


def number_type(words: list[str]) -> NumberType | None:
    """Find the type that some words name, qualifiers left out; None for one that is not read (long long, void)."""
    found = _TYPES.get(" ".join(words))
    if found is None and len(words) > 1:  # C takes them in any order: long unsigned.
        order = ("signed", "unsigned", "short", "long", "char", "int")
        if all(word in order for word in words) and len(set(words)) == len(words):
            found = _TYPES.get(" ".join(sorted(words, key=order.index)))
    return found


_LITERAL = lazy_pattern(
    r"(?P<hex>0x[0-9a-f]+)(?P<hex_suffix>[ul]*)|(?P<digits>[0-9.]+(?:e[+-]?[0-9]+)?)(?P<suffix>[ulfd]*)"
)
_MAX_DIGITS = 300
_FLOAT_DIGITS = 16


def literal(text: str) -> CNumber | None:
    """Read a number of C; None if it is none, or too large for its type."""
    match = _LITERAL.fullmatch(text.lower())
    if match is None or len(text) > _MAX_DIGITS:
        return None
    digits, suffix = match["digits"], match["suffix"] or match["hex_suffix"] or ""
    if match["hex"] is None and ("." in digits or "e" in digits or suffix in ("f", "d")):
        # The precision of long double depends on the compiler; more digits would be rounded twice.
        if suffix not in ("", "f") or (suffix == "f" and len(digits) > _FLOAT_DIGITS):
            return None
        value = float(digits)
        if not math.isfinite(value):
            return None
        return CNumber(value=_single(value) if suffix == "f" else value, kind=_floating(suffix))
    if not re.fullmatch("u?l{0,2}|l{1,2}u", suffix):
        return None
    whole = int(match["hex"], 16) if match["hex"] else int(digits)
    unsigned = "u" in suffix or (match["hex"] is not None and whole > INT_MAX)
    if whole > UINT_MAX:
        return None
    return CNumber(value=float(whole), kind=NumberKind.UNSIGNED if unsigned else NumberKind.INT)


def _floating(suffix: str) -> NumberKind:
    return NumberKind.FLOAT if suffix == "f" else NumberKind.DOUBLE


def unary(operator: str, number: CNumber) -> CNumber | None:
    """Apply -, +, ! or ~; None where the result has no value that all compilers agree on."""
    value = number.value
    match operator:
        case "+":
            return number
        case "-":
            return _checked(replace(number, value=0.0 - value if number.is_whole else -value))
        case "!":
            return CNumber(value=float(value == 0), is_code=number.is_code)
        case "~" if number.kind is NumberKind.INT:
            return _checked(replace(number, value=float(~int(value))))
    return None


def binary(operator: str, left: CNumber, right: CNumber) -> CNumber | None:
    """Apply an operator of two numbers; None where the result has no value that all compilers agree on."""
    is_code = left.is_code or right.is_code
    a, b = left.value, right.value
    kind = max(left.kind, right.kind)
    if NumberKind.OPEN in (left.kind, right.kind) and (a < 0 or b < 0 or NumberKind.FLOAT in (left.kind, right.kind)):
        return None
    if any(n.kind is NumberKind.INT and not INT_MIN <= n.value <= INT_MAX for n in (left, right)):
        return None
    if kind is NumberKind.FLOAT:
        a, b = _single(a), _single(b)
    if kind is NumberKind.UNSIGNED and operator not in ("<<", ">>") and (a < 0 or b < 0):
        return None  # The negative number becomes a large one.
    if operator in _COMPARISONS:
        return CNumber(value=float(_COMPARISONS[operator](a, b)), is_code=is_code)
    whole = kind <= NumberKind.OPEN
    if operator in _WHOLE_ONLY:
        if not whole:
            return None
        value = _whole_operator(operator, int(a), int(b), kind)
    elif operator == "/":
        value = _quotient(a, b, kind)
    else:
        value = _ARITHMETIC[operator](a, b)
    if value is None:
        return None
    if operator in ("<<", ">>"):
        kind = left.kind
    if kind is NumberKind.FLOAT:
        value = _single(value)
    return _checked(CNumber(value=value, kind=kind, is_code=is_code))


_COMPARISONS: dict[str, Callable[[float, float], bool]] = {
    "==": lambda a, b: a == b,
    "!=": lambda a, b: a != b,
    "<": lambda a, b: a < b,
    "<=": lambda a, b: a <= b,
    ">": lambda a, b: a > b,
    ">=": lambda a, b: a >= b,
}
_ARITHMETIC: dict[str, Callable[[float, float], float]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
}
_WHOLE_ONLY = ("%", "<<", ">>", "&", "|", "^")
_SHIFT_LIMIT = 31


def _whole_operator(operator: str, a: int, b: int, kind: NumberKind) -> float | None:
    match operator:
        case "%":
            return (
                None
                if b == 0 or (a == INT_MIN and b == -1)
                else float(a - b * int(_quotient(a, b, NumberKind.INT) or 0))
            )
        case "<<":
            return float(a << b) if a >= 0 and 0 <= b < _SHIFT_LIMIT else None
        case ">>":
            return float(a >> b) if a >= 0 and 0 <= b < _SHIFT_LIMIT else None
        case "&":
            return float(a & b)
        case "|":
            return float(a | b)
    return float(a ^ b)


def _quotient(a: float, b: float, kind: NumberKind) -> float | None:
    """Divide; whole numbers are cut towards 0. What is cut depends on the type, so an open one must divide evenly."""
    if b == 0:
        return None
    if kind >= NumberKind.FLOAT:
        return a / b
    quotient = abs(int(a)) // abs(int(b))
    if kind is NumberKind.OPEN and quotient * abs(b) != abs(a):
        return None
    return float(quotient if (a < 0) == (b < 0) else -quotient)


def _checked(number: CNumber) -> CNumber | None:
    """Return a number that fits its type, or None."""
    value = number.value
    if number.kind >= NumberKind.FLOAT:
        return number if math.isfinite(value) else None
    # An open number may be unsigned, or have any whole type.
    low, high = (0, UINT_MAX) if number.kind is NumberKind.UNSIGNED else (INT_MIN, INT_MAX)
    if number.kind is NumberKind.OPEN:
        low, high = 0, INT_MAX
    return replace(number, value=value + 0.0) if low <= value <= high else None


def _single(value: float) -> float:
    """Round to a C float."""
    with np.errstate(over="ignore"):
        return float(np.float32(value))
