"""The variables of a listing, as far as its text has set them: numbers, arrays and structs."""

from __future__ import annotations

from collections.abc import Iterable

from msgspec import Struct, field

from gusjob.controllers.gus.calls import CRD_FIELDS, CType, Value
from gusjob.frontend.listing.c_numbers import CNumber, NumberKind, NumberType, number_type
from gusjob.i18n.phrases import Phrase

MAX_ARRAY = 4096
"""Elements of an array whose values are kept."""
_MAY_BE_THE_SAME = Phrase("a name that is declared elsewhere may be a pointer to it")
_FITS_EVERY_TYPE = (0, 1)
"""Numbers that every type of C holds, bool included."""
NEVER_SET = Phrase("it is never set in this file")
_FIELD_TYPES: dict[str, tuple[CType, int]] = {name: (c, count) for name, c, count, _ in CRD_FIELDS}
STRUCT_TYPE = "TCrdPrm"


class UnknownValue(Struct, frozen=True, kw_only=True):
    """A value that the text does not tell. `is_reported`: a diagnostic says why already."""

    reason: str
    is_reported: bool = False


class CArray(Struct, kw_only=True):
    """An array. `element`: type of its elements, None if it is declared elsewhere."""

    values: list[CValue]
    element: NumberType | None = None

    def copy(self) -> CArray:
        """Copy the array."""
        return CArray(values=list(self.values), element=self.element)


class CStruct(Struct, kw_only=True):
    """A struct. `is_crd`: it is declared as a TCrdPrm."""

    fields: dict[str, CValue]
    is_crd: bool = False

    def copy(self) -> CStruct:
        """Copy the struct with its arrays."""
        copied = {k: v.copy() if isinstance(v, CArray) else v for k, v in self.fields.items()}
        return CStruct(fields=copied, is_crd=self.is_crd)


CValue = CNumber | CArray | CStruct | UnknownValue

ZERO = CNumber(value=0.0)


def unknown(reason: str) -> UnknownValue:
    """Make an unknown value."""
    return UnknownValue(reason=reason)


def sets_it(function: str) -> str:
    """Return why the variable that a call sets is not known."""
    return Phrase("{function}() sets it", function=function)


def crd_struct(values: CValue) -> CStruct:
    """Make a TCrdPrm with one value in all of its fields."""
    fields: dict[str, CValue] = {}
    for name, (_, count) in _FIELD_TYPES.items():
        kind = crd_field_type(name)
        fields[name] = values if count == 1 else CArray(values=[values] * count, element=kind)
    return CStruct(fields=fields, is_crd=True)


def crd_field_type(name: str) -> NumberType | None:
    """Return the type of a field of TCrdPrm, or of its elements; None if it has no such field."""
    found = _FIELD_TYPES.get(name)
    return None if found is None else number_type([found[0].value])


class CVariables(Struct):
    """Variables and constants by name.

    Attributes:
        values: Their values. What is not in it was never named.
        types: Types of those that the text declares as numbers.
        declared: Names that the text declares: no function elsewhere can change them.
        escaped: Names whose address was given away.
        codes: Names that a template sets to a call's return code, in lines that are not evaluated in their order, each
            with the first of these lines.
        line: The line that is read now.
        mixed: Names in `codes` that also get other values.
    """

    values: dict[str, CValue] = field(default_factory=dict)
    types: dict[str, NumberType] = field(default_factory=dict)
    declared: set[str] = field(default_factory=set)
    escaped: set[str] = field(default_factory=set)
    codes: dict[str, int] = field(default_factory=dict)
    mixed: set[str] = field(default_factory=set)
    line: int = 0

    def get(self, name: str) -> CValue:
        """Return the value of a name."""
        if name in self.mixed:
            return unknown(Phrase("it is set to return codes and to other values"))
        if self.codes.get(name, self.line) < self.line:
            return CNumber(value=0.0, is_code=True)
        return self.values.get(name, unknown(NEVER_SET))

    def declare(self, name: str, kind: NumberType | None, value: CValue) -> None:
        """Declare a name with its value, converted to its type already."""
        self.declared.add(name)
        self.escaped.discard(name)
        self._mix(name)
        self.types.pop(name, None)
        if kind is not None:
            self.types[name] = kind
        self.values[name] = value

    def set(self, name: str, value: CValue) -> None:
        """Set a name to a value, as an assignment does."""
        kind = self.types.get(name)
        if name not in self.declared:
            self.lose(
                [other for other in self.values if other not in self.declared and other != name], _MAY_BE_THE_SAME
            )
        if not (isinstance(value, CNumber) and value.value == 0):
            self._mix(name)
        if isinstance(value, CNumber):
            value = converted(value, kind)
        elif isinstance(value, CArray | CStruct):
            value = value.copy()
        self.values[name] = value

    def lose(self, names: Iterable[str], reason: str) -> None:
        """Forget the values of some names."""
        for name in names:
            self._mix(name)
            self.values[name] = unknown(reason)

    def _mix(self, name: str) -> None:
        """Note that a name is set to something after a template has set it to a code: its value is not known then."""
        if self.codes.get(name, self.line + 1) <= self.line:
            self.mixed.add(name)

    def lose_escaped(self, reason: str) -> None:
        """Forget what a function elsewhere can change: what is not declared here, or whose address it may have."""
        self.lose([name for name in self.values if name not in self.declared or name in self.escaped], reason)

    def lose_others(self, name: str) -> None:
        """Forget what a name that is declared elsewhere may point to: what is not declared here, and what escaped."""
        known = self.declared - self.escaped
        self.lose([other for other in self.values if other != name and other not in known], _MAY_BE_THE_SAME)

    def lose_all(self, reason: str) -> None:
        """Forget every value that a pointer may point to."""
        self.lose(list(self.values), reason)


def converted(number: CNumber, kind: NumberType | None) -> CValue:
    """Convert a number to the type of the variable that it is assigned to; None: a variable declared elsewhere."""
    if kind is None:
        if number.value not in _FITS_EVERY_TYPE:
            return unknown(Phrase("its type is not known, and may not hold the value: declare it in this file"))
        return CNumber(value=number.value, kind=NumberKind.OPEN, is_code=number.is_code)
    found = kind.convert(number)
    return found if found is not None else unknown(Phrase("the value does not fit its type"))


def plain(value: CValue) -> Value | None:
    """Return a value as an argument of a call: a number, or a tuple of numbers; None if some part is not known."""
    match value:
        case CNumber(is_code=False):
            return value.value
        case CArray():
            parts = [plain(v) for v in value.values]
            return None if any(p is None for p in parts) else tuple(p for p in parts if p is not None)
        case CStruct():
            found = [plain(value.fields.get(name, unknown(NEVER_SET))) for name in _FIELD_TYPES]
            return None if any(p is None for p in found) else tuple(p for p in found if p is not None)
    return None


def why_unknown(value: CValue) -> UnknownValue | None:
    """Find the first part of a value that is not known, with the reason; None if all is known."""
    match value:
        case UnknownValue():
            return value
        case CNumber(is_code=True):
            return unknown(Phrase("it is a return code"))
        case CArray():
            return next((found for v in value.values if (found := why_unknown(v)) is not None), None)
        case CStruct():
            missing = [name for name in _FIELD_TYPES if name not in value.fields]
            lost = [n for n, v in value.fields.items() if n in _FIELD_TYPES and why_unknown(v) is not None]
            names = [name for name in _FIELD_TYPES if name in missing or name in lost]
            if not names:
                return None
            inner = [found for n in lost if (found := why_unknown(value.fields[n])) is not None]
            if inner and not missing and any(found.reason != NEVER_SET for found in inner):
                return inner[0]
            begin = "TCrdPrm name = {0};"
            return unknown(
                Phrase("its fields {fields} are never set; declare it as {begin}", fields=", ".join(names), begin=begin)
            )
    return None
