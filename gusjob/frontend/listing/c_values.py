"""Values of C code: numbers, variables with arrays and structs, and which values an argument takes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from lark import Token, Tree

from gusjob.controllers.gus.calls import ArgKind, Value
from gusjob.frontend.parse.grammar import subtrees, tokens
from gusjob.i18n.phrases import Phrase

EXPECTED_ARGUMENT = {
    ArgKind.WHOLE: Phrase("a whole number"),
    ArgKind.REAL: Phrase("a number"),
    ArgKind.ARRAY: Phrase("an array of four numbers"),
    ArgKind.POINTER: Phrase("a variable"),
    ArgKind.STRUCT: Phrase("a TCrdPrm"),
}
"""What an argument takes, by its kind."""
_MAX_ARRAY = 64
_CRD_FIELDS = ("dimension", "profile", "synVelMax", "synAccMax", "evenTime", "setOriginFlag", "originPos")
"""Fields of TCrdPrm; profile and originPos are arrays of 8."""
_CRD_ARRAYS = ("profile", "originPos")


@dataclass(slots=True)
class CVariables:
    """The variables of a program, as far as its text has set them."""

    values: dict[str, Value] = field(default_factory=dict)
    structs: dict[str, dict[str, Value]] = field(default_factory=dict)
    """Fields of each struct."""

    def declare(self, item: Tree[Token]) -> None:
        """Add `long pos = 0, *p;`: the value is known where it is a number."""
        for name in (t for t in subtrees(item) if t.data == "pointer_name"):
            numbers = [value for value in subtrees(name) if value.data == "number"]
            if numbers:
                self.values[str(tokens(name)[0])] = self.value(numbers[-1])

    def declare_array(self, item: Tree[Token]) -> None:
        """Add `long pos[4] = {0};`; the rest is 0, as in C."""
        parts = [part for part in subtrees(item) if part.data != "type"]
        value = self.value(parts[-1])
        size = self.value(parts[0]) if len(parts) > 1 else 0.0
        if isinstance(value, tuple) and isinstance(size, float) and len(value) < size <= _MAX_ARRAY:
            value = (*value, *(0.0,) * (int(size) - len(value)))
        self.values[str(tokens(item)[0])] = value

    def assign(self, item: Tree[Token]) -> None:
        """Run `name = value;`, `crdPrm.synVelMax = 500;` or `crdPrm.profile[0] = 1;`."""
        names, parts = [str(t) for t in tokens(item)], subtrees(item)
        value = self.value(parts[-1])
        if len(names) == 1:
            self.values[names[0]] = value
            return
        fields = self.structs.setdefault(names[0], {})
        if len(parts) == 1:
            fields[names[1]] = value
            return
        index = self.value(parts[0])
        found = fields.get(names[1])
        members: list[Value] = list(found) if isinstance(found, tuple) else [0.0] * 8
        if isinstance(index, float) and 0 <= index < len(members):
            members[int(index)] = value
        fields[names[1]] = tuple(members)

    def value(self, tree: Tree[Token]) -> Value:
        """A number, a struct or array, or a name (its value if one is known)."""
        if tree.data == "number":
            return _number(tokens(tree)[0])
        if tree.data == "struct":
            return tuple(self.value(part) for part in subtrees(tree))
        name = str(tokens(tree)[0])
        if name in self.structs:
            fields = self.structs[name]
            return tuple(fields.get(f, (0.0,) * 8 if f in _CRD_ARRAYS else 0.0) for f in _CRD_FIELDS)
        return self.values.get(name, name)


def fits_argument(kind: ArgKind, value: Value) -> bool:
    """Whether a value is of an argument's kind, and finite."""
    match kind:
        case ArgKind.WHOLE | ArgKind.REAL:
            return _is_finite(value)
        case ArgKind.ARRAY:
            return isinstance(value, tuple) and len(value) == 4 and all(map(_is_finite, value))
        case ArgKind.STRUCT:
            return isinstance(value, str) or _is_crd_parameter(value)
        case ArgKind.POINTER:
            return False


def _is_finite(value: Value) -> bool:
    return isinstance(value, float) and math.isfinite(value)


def _is_crd_parameter(value: Value) -> bool:
    """Whether a value is a TCrdPrm."""
    if not isinstance(value, tuple) or len(value) != len(_CRD_FIELDS):
        return False
    return all(
        isinstance(part, tuple) and len(part) == 8 and all(map(_is_finite, part))
        if name in _CRD_ARRAYS
        else _is_finite(part)
        for name, part in zip(_CRD_FIELDS, value, strict=True)
    )


def _number(token: Token) -> float:
    text = str(token).rstrip("uUlL")
    sign = -1.0 if text.startswith("-") else 1.0
    text = text.lstrip("+-")
    if text.lower().startswith("0x"):
        return sign * float(int(text, 16)) if len(text) < 300 else float("inf")
    return sign * float(text.rstrip("fF"))
