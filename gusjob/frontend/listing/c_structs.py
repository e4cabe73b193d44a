"""Initial values of a TCrdPrm: in braces as C reads them, as a listing prints them, and as C# makes them."""

from __future__ import annotations

from collections.abc import Callable

from lark import Token, Tree

from gusjob.frontend.listing.c_numbers import CNumber
from gusjob.frontend.listing.c_variables import (
    ZERO,
    CArray,
    CStruct,
    CValue,
    converted,
    crd_field_type,
    crd_struct,
    unknown,
)
from gusjob.frontend.parse.grammar import subtrees
from gusjob.i18n.phrases import Phrase

Evaluate = Callable[[Tree[Token]], CValue]
"""Evaluates an expression."""
_DOES_NOT_FIT = Phrase("its values do not fit the fields of TCrdPrm")


def new_struct() -> CStruct:
    """Make a TCrdPrm as `new` in C# does, where it has a field for each element: profile1, originPos1."""
    return crd_struct(ZERO)


def initial_struct(members: Tree[Token], evaluate: Evaluate) -> CValue:
    """Make a TCrdPrm of its values in braces; what is left out is 0.

    Without inner braces the values go through the elements of the arrays.
    """
    made, parts = crd_struct(ZERO), subtrees(members)
    if not any(part.data == "members" for part in parts):
        return _flat_struct(made, parts, evaluate)
    for (name, old), part in zip(list(made.fields.items()), parts, strict=False):
        inner = subtrees(part) if part.data == "members" else None
        if isinstance(old, CArray) and inner is not None and len(inner) <= len(old.values):
            old.values[: len(inner)] = [_field_value(value, name, evaluate) for value in inner]
        elif not isinstance(old, CArray) and inner is None:
            made.fields[name] = _field_value(part, name, evaluate)
        else:
            return unknown(_DOES_NOT_FIT)
    return made if len(parts) <= len(made.fields) else unknown(_DOES_NOT_FIT)


def _flat_struct(made: CStruct, parts: list[Tree[Token]], evaluate: Evaluate) -> CValue:
    left = list(parts)
    for name, old in made.fields.items():
        if isinstance(old, CArray):
            taken, left = left[: len(old.values)], left[len(old.values) :]
            old.values[: len(taken)] = [_field_value(value, name, evaluate) for value in taken]
        elif left:
            made.fields[name] = _field_value(left.pop(0), name, evaluate)
    return unknown(_DOES_NOT_FIT) if left else made


def _field_value(tree: Tree[Token], name: str, evaluate: Evaluate) -> CValue:
    value = evaluate(tree)
    return converted(value, crd_field_type(name)) if isinstance(value, CNumber) else value


def printed_struct(members: Tree[Token], evaluate: Evaluate) -> CValue:
    """Make a TCrdPrm with all of its fields, as a listing prints it: nothing is cut to fit."""
    made, parts = crd_struct(ZERO), subtrees(members)
    if len(parts) != len(made.fields):
        return unknown(_DOES_NOT_FIT)
    for (name, old), part in zip(list(made.fields.items()), parts, strict=True):
        size = len(subtrees(part)) if part.data == "members" else None
        if size != (len(old.values) if isinstance(old, CArray) else None):
            return unknown(_DOES_NOT_FIT)
        made.fields[name] = evaluate(part) if size is None else printed_array(part, evaluate)
    return made


def printed_array(members: Tree[Token], evaluate: Evaluate) -> CArray:
    """Make an array of its values, as a listing prints it."""
    return CArray(values=[evaluate(part) for part in subtrees(members)])
