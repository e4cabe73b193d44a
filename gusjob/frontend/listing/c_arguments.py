"""Arguments as C passes them: a number becomes one of the argument's type, and the controller gets that.

A number that does not fit is reported when the calls are executed (Stream.conversions), as everything that the
controller makes of a call: the report is made of the calls as they arrive. Where C does not define what arrives, the
call is left out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from msgspec import Struct, field

from gusjob.controllers.gus.calls import (
    BUFFERED,
    CRD_FIELDS,
    WHOLE_TYPES,
    Arg,
    ArgKind,
    ArgumentConversion,
    CType,
    Signature,
    Value,
)
from gusjob.frontend.listing.c_numbers import CNumber, NumberKind
from gusjob.frontend.listing.c_variables import CArray, CStruct, CValue
from gusjob.frontend.listing.call_rows import COLUMNS, REALS_COLUMN
from gusjob.frontend.scan.rows import Rows
from gusjob.kinematics.arrays import Bools, Floats, Indices, picked, unrepeated

_EXACT = 2.0**53
"""Up to here every whole number is exact as it is read; C has no larger integer literal than 2^64 anyway."""


def arriving(values: Floats, is_real: Bools, c: CType) -> Floats:
    """Convert numbers to a whole type of C, (k,); NaN where C does not define the result.

    A fraction is cut off (C11 6.3.1.4). A whole number too large for the type is taken modulo 2^bits: C defines this
    for unsigned types, and every compiler does it for signed ones (6.3.1.3). For a floating number too large for the
    type nothing is defined (6.3.1.4). `is_real` (k,): floating numbers.
    """
    low, high = WHOLE_TYPES[c]
    cut = np.trunc(values)
    fits = (cut >= low) & (cut <= high)
    wrapped = np.mod(np.where(np.abs(cut) <= _EXACT, cut, 0.0) - low, high - low + 1.0) + low
    defined = ~is_real & (np.abs(cut) <= _EXACT)
    return np.where(fits, cut, np.where(defined, wrapped, np.nan)) + 0.0


class ArgumentConverter(Struct):
    """Converts the arguments of calls to their types.

    `found`: the numbers that do not arrive as they are written, by argument.
    """

    wide_pulse_width: bool = False
    """GT_SetPulseWidth takes an unsigned long, as in the sister series."""
    found: list[ArgumentConversion] = field(default_factory=list)

    def type_of(self, call: str, arg: Arg) -> CType:
        """Return the type of an argument, or of the elements of an array."""
        return CType.ULONG if self.wide_pulse_width and (call, arg.name) == ("GT_SetPulseWidth", "width") else arg.c

    def call(self, signature: Signature, values: list[CValue | None], given: list[Value], line: int) -> list[Value]:
        """Convert the arguments of a call that is not buffered; [] if C does not define them."""
        converted, noted = list(given), len(self.found)
        for i, (arg, value) in enumerate(zip(signature.args, values, strict=False)):
            converted[i] = self._value(signature.name, arg, value, given[i], line)
        undefined = any(np.isnan(c.arrives).any() for c in self.found[noted:])
        return [] if undefined else converted

    def _value(self, call: str, arg: Arg, value: CValue | None, given: Value, line: int) -> Value:
        """Convert one argument."""
        if arg.kind is ArgKind.WHOLE and isinstance(value, CNumber):
            return self._number(call, arg.name, value, self.type_of(call, arg), line)
        if arg.kind is ArgKind.ARRAY and isinstance(value, CArray):
            return self._array(call, arg.name, value, arg.c, line)
        if arg.kind is ArgKind.STRUCT and isinstance(value, CStruct) and isinstance(given, tuple):
            fields = list[Value]()
            for (name, c, count, _), part, old in zip(CRD_FIELDS, _crd_values(value), given, strict=True):
                is_array = count > 1 and isinstance(part, CArray)
                one = part if isinstance(part, CNumber) else None
                fields.append(
                    self._array(call, name, part, c, line)
                    if is_array and isinstance(part, CArray)
                    else (old if one is None else self._number(call, name, one, c, line))
                )
            return tuple(fields)
        return given

    def _array(self, call: str, name: str, array: CArray, c: CType, line: int) -> Value:
        return tuple(self._number(call, name, one, c, line) for one in array.values if isinstance(one, CNumber))

    def _number(self, call: str, name: str, number: CNumber, c: CType, line: int) -> float:
        if c not in WHOLE_TYPES:
            return number.value
        is_real = np.array([number.kind >= NumberKind.FLOAT])
        values = np.array([number.value])
        arrives = arriving(values, is_real, c)
        if arrives[0] != number.value:
            self.note(call, name, c, np.array([line], dtype=np.int32), values, arrives)
        return float(arrives[0])

    def note(
        self, call: str, name: str, c: CType, line: npt.NDArray[np.int32], written: Floats, arrives: Floats
    ) -> None:
        """Note numbers that do not arrive as they are written."""
        self.found.append(
            ArgumentConversion(call=call, argument=name, c=c, line=line, written=written, arrives=arrives)
        )

    def rows(self, parts: Sequence[Rows]) -> list[Rows]:
        """Convert the arguments of buffered calls; without the calls that C does not define."""
        noted = len(self.found)
        made = [self._converted(rows) for rows in parts]
        self.found[noted:] = _by_argument(self.found[noted:])
        return made

    def _converted(self, rows: Rows) -> Rows:
        """Convert the arguments of some rows."""
        columns, undefined = dict(rows.columns), np.zeros(len(rows.op), dtype=np.bool_)
        for kind, signature in BUFFERED.items():
            at: Indices = np.flatnonzero(rows.op == kind)
            for arg in signature.args if len(at) else ():
                column = COLUMNS.index(arg.column)
                if arg.c not in WHOLE_TYPES or column not in columns:
                    continue
                written = picked(columns[column], at)
                if _all_arrive(unrepeated(written), arg.c):
                    continue
                reals = np.nan_to_num(rows.column(REALS_COLUMN)[at]).astype(np.int64)
                arrives = arriving(written, (reals >> column & 1) == 1, arg.c)
                changed = np.flatnonzero(~np.isnan(written) & (arrives != written))
                if not len(changed):
                    continue
                columns[column] = columns[column].copy()
                columns[column][at] = arrives
                undefined[at[changed[np.isnan(arrives[changed])]]] = True
                self.note(signature.name, arg.name, arg.c, rows.line[at[changed]], written[changed], arrives[changed])
        made = Rows(op=rows.op, line=rows.line, system=rows.system, columns=columns)
        return made.pick(~undefined) if undefined.any() else made


def _all_arrive(values: Floats, c: CType) -> bool:
    """Whether all numbers are of a whole type of C; NaN is not."""
    low, high = WHOLE_TYPES[c]
    return bool(values.min() >= low and values.max() <= high and (np.trunc(values) == values).all())


def _by_argument(found: list[ArgumentConversion]) -> list[ArgumentConversion]:
    """Put the numbers of each argument of each call together."""
    parts: dict[tuple[str, str, CType], list[ArgumentConversion]] = {}
    for one in found:
        parts.setdefault((one.call, one.argument, one.c), []).append(one)
    return [
        ArgumentConversion(
            call=call,
            argument=argument,
            c=c,
            line=np.concatenate([one.line for one in of_argument]),
            written=np.concatenate([one.written for one in of_argument]),
            arrives=np.concatenate([one.arrives for one in of_argument]),
        )
        for (call, argument, c), of_argument in parts.items()
    ]


def reals_mask(signature: Signature, is_real: list[bool]) -> float:
    """Return which columns of a buffered call are written as floating numbers, as bits of one number."""
    pairs = zip(signature.args, is_real, strict=False)
    return float(sum(1 << COLUMNS.index(arg.column) for arg, real in pairs if real and arg.kind is ArgKind.WHOLE))


def is_real(value: CValue | None) -> bool:
    """Whether a value is a floating number."""
    return isinstance(value, CNumber) and value.kind >= NumberKind.FLOAT


def _crd_values(struct: CStruct) -> list[CValue]:
    return [struct.fields[name] for name, *_ in CRD_FIELDS]
