"""Evaluate straight-line C: declarations, assignments and expressions, and which calls of the library they make.

A value that the text does not tell is an UnknownValue with its reason: the call that uses it is reported. What would
decide whether a call is made is reported as control flow.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from lark import Token, Tree

from gusjob.diagnostics import rules
from gusjob.frontend.listing.c_numbers import CNumber, NumberType, binary, literal, number_type, unary
from gusjob.frontend.listing.c_variables import (
    MAX_ARRAY,
    NEVER_SET,
    STRUCT_TYPE,
    ZERO,
    CArray,
    CStruct,
    CValue,
    CVariables,
    UnknownValue,
    converted,
    crd_field_type,
    crd_struct,
    sets_it,
    unknown,
)
from gusjob.frontend.parse.grammar import subtrees, tokens
from gusjob.frontend.parse.misread import nearest
from gusjob.i18n.phrases import Phrase, did_you_mean

_LIBRARY = re.compile(r"GTN?_\w+|AT_REST")
_CONSTANTS = {"true": 1.0, "false": 0.0, "TRUE": 1.0, "FALSE": 0.0}
HARMLESS_FUNCTIONS = frozenset({
    "printf", "fprintf", "puts", "fputs", "putchar", "fflush", "perror", "getchar", "clock", "sleep", "usleep",
    "nanosleep", "Sleep", "OutputDebugString", "MessageBox", "AfxMessageBox", "_getch", "getch", "GetTickCount",
})  # fmt: skip
"""Functions of the C library, Windows and .NET that make no call of the library and change no variable."""
_NOT_EVALUATED = re.compile(r"_?assert|_?ASSERTE?|Assert|ATLASSERT|(?:ATL)?TRACE\d?|static_assert|_Static_assert")
"""Functions and macros whose arguments some builds leave out."""
_STREAMS = ("cout", "cerr", "clog")
_PROBE_DEPTH = 20
"""Macros that may stand for each other."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CMacro:
    """A macro without arguments. `tree` None: its text is no expression. `is_operand`: it needs no parentheses."""

    text: str
    tree: Tree[Token] | None
    is_operand: bool


def called_name(call: Tree[Token]) -> Token | None:
    """Return the name of a call's function, without what qualifies it (mc.GT_LnXY); None if it is computed."""
    callee = call.children[0]
    if isinstance(callee, Tree) and callee.data in ("name", "member"):
        return tokens(callee)[-1]
    return None


def is_library_name(name: str) -> bool:
    """Whether a name is one of a call that the reader reads."""
    return _LIBRARY.fullmatch(name) is not None


def first_token(tree: Tree[Token]) -> Token | None:
    """Return the first token of a tree."""
    return next((t for t in tree.scan_values(lambda _: True) if isinstance(t, Token)), None)


@dataclass(slots=True)
class CEvaluator:
    """Evaluates trees of listing.lark.

    Attributes:
        report: Called with a rule, a token and the rule's fields.
        call_library: Called with the name of a call of the library and its arguments.
        has_references: A function may change a variable that it is given by its name (C++).
    """

    report: Callable[..., None]
    call_library: Callable[[Token, str, Sequence[Tree[Token]]], None]
    has_references: bool
    variables: CVariables = field(default_factory=CVariables)
    macros: dict[str, CMacro] = field(default_factory=dict)
    checks: int = 0
    """Checks of return codes that were passed over."""
    reported_functions: set[str] = field(default_factory=set)
    """Functions that were reported already, by name, or by rule and name."""
    _depth: int = 0
    _alone: Tree[Token] | None = None
    """The expression that is a statement of its own: nobody uses its value."""

    # Statements.

    def run(self, item: Tree[Token]) -> None:
        """Run one item of a listing."""
        match item.data:
            case "declaration":
                self._declaration(item)
            case "enumeration":
                self._enumeration(item)
            case "check":
                self._check(item)
            case "wait":
                self._wait(item)
            case "statement":
                self._statement(subtrees(item)[0])
            case _:
                pass

    def _statement(self, tree: Tree[Token]) -> None:
        tree = _without_void(tree)
        has_effect = tree.data in ("assign", "step", "call", "logical") or _is_output(tree)
        if not has_effect:
            token = first_token(tree)
            if token is not None:
                self.report(rules.CALL_SYNTAX, token, found=Phrase("'{text}', which does nothing", text=str(token)))
            return
        if self._is_ordered(tree):
            self._alone = tree
            self.expression(tree)

    def _is_ordered(self, tree: Tree[Token]) -> bool:
        """Whether the order of an expression's effects does not matter, or C says it; else it is reported."""
        names = [str(t) for t in tree.scan_values(lambda t: isinstance(t, Token) and t.type == "NAME")]
        for effect in tree.iter_subtrees():
            if effect.data not in ("assign", "step") or effect is tree:
                continue
            target = subtrees(effect)[0]
            name = next((t for t in target.scan_values(lambda t: isinstance(t, Token) and t.type == "NAME")), None)
            if name is not None and names.count(str(name)) > 1 and not _in_chain(tree, effect, str(name)):
                self.report(
                    rules.CALL_SYNTAX, name, found=Phrase("{name} set and used in one statement", name=str(name))
                )
                return False
        return True

    def _declaration(self, item: Tree[Token]) -> None:
        words = tokens(subtrees(item)[0])
        type_words = [str(t) for t in words if t.type == "TYPE"]
        is_static = any(t == "static" for t in words)
        for declarator in (t for t in subtrees(item) if t.data == "declarator"):
            self._declare(declarator, type_words, is_static)

    def _declare(self, item: Tree[Token], type_words: list[str], is_static: bool) -> None:
        parts, stars = subtrees(item), [t for t in tokens(item) if t.type == "STAR"]
        token = tokens(item)[-1]
        if not self._is_plain_name(token):
            return
        name = str(token)
        dimensions = [p for p in parts if p.data == "dimension"]
        initial = next((p for p in parts if p.data != "dimension"), None)
        braces = [p for p in parts if p.data in ("members", "dimension") and _has_effect(p)]
        if braces:
            self.report(rules.CALL_SYNTAX, token, found=Phrase("calls or changes inside braces or brackets"))
            return
        if initial is not None and not stars:
            self._keep_addresses(initial)
        kind = number_type(type_words)
        default: CValue = ZERO if is_static else unknown(NEVER_SET)
        value: CValue
        if stars:
            if initial is not None:
                self._give_away(initial)
            value, kind = unknown(Phrase("it is a pointer")), None
        elif any(word.endswith(STRUCT_TYPE) for word in type_words):
            value, kind = self._struct(initial, default) if not dimensions else unknown(NEVER_SET), None
        elif kind is None:
            if initial is not None:
                self.expression(initial) if initial.data != "new" else None
            value = unknown(Phrase("its type, {type}, is not read", type=" ".join(type_words)))
        elif dimensions:
            value, kind = self._array(dimensions[0], initial, kind, default), None
        else:
            value = self._scalar(initial, kind, default)
        self.variables.declare(name, kind, value)

    def _scalar(self, initial: Tree[Token] | None, kind: NumberType, default: CValue) -> CValue:
        if initial is None:
            return converted(default, kind) if isinstance(default, CNumber) else default
        if initial.data == "members":
            members = subtrees(initial)
            if len(members) > 1:
                return unknown(NEVER_SET)
            initial = members[0] if members else None
            if initial is None:
                return converted(ZERO, kind)
        value = self._value_of(initial)
        return converted(value, kind) if isinstance(value, CNumber) else value

    def _value_of(self, tree: Tree[Token]) -> CValue:
        if tree.data == "new":
            return unknown(Phrase("it is a new object"))
        return self.expression(tree) if self._is_ordered(tree) else UnknownValue(reason="", is_reported=True)

    def _array(self, dimension: Tree[Token], initial: Tree[Token] | None, kind: NumberType, default: CValue) -> CValue:
        sizes = [self.expression(t) for t in subtrees(dimension)]
        members = subtrees(initial) if initial is not None and initial.data == "members" else None
        size = len(members or ()) if not sizes else sizes[0].value if isinstance(sizes[0], CNumber) else -1
        if not 0 < size <= MAX_ARRAY or (initial is not None and members is None):
            return unknown(Phrase("it is an array whose size or content is not read"))
        values = [self._scalar(member, kind, default) for member in members or ()]
        if len(values) > size:
            return unknown(Phrase("it has more values than elements"))
        rest = converted(ZERO, kind) if members is not None else self._scalar(None, kind, default)
        return CArray(values=[*values, *[rest] * (int(size) - len(values))], element=kind)

    def _struct(self, initial: Tree[Token] | None, default: CValue) -> CValue:
        """Make a TCrdPrm as C initializes one; what is left out is 0."""
        if initial is None:
            return crd_struct(default)
        if initial.data == "new":
            # Arrays of a new object of C# are null until they are assigned.
            made = crd_struct(ZERO)
            made.fields |= {k: unknown(NEVER_SET) for k, v in made.fields.items() if isinstance(v, CArray)}
            return made
        if initial.data != "members":
            value = self._value_of(initial)
            return value.copy() if isinstance(value, CStruct) else unknown(NEVER_SET)
        return self.struct_of(initial)

    def struct_of(self, members: Tree[Token], *, is_argument: bool = False) -> CValue:
        """Make a TCrdPrm of its members in braces. `is_argument`: as a listing prints it, so nothing is cut to fit."""
        made = crd_struct(ZERO)
        parts = subtrees(members)
        if is_argument:
            return self._printed_struct(made, parts)
        if parts and all(part.data != "members" for part in parts):
            return self._flat_struct(made, parts)
        for (name, old), part in zip(list(made.fields.items()), parts, strict=False):
            if isinstance(old, CArray) != (part.data == "members"):
                return unknown(Phrase("its values do not fit the fields of TCrdPrm"))
            if isinstance(old, CArray):
                values = subtrees(part)
                if len(values) > len(old.values):
                    return unknown(Phrase("its values do not fit the fields of TCrdPrm"))
                for i, value in enumerate(values):
                    old.values[i] = self._converted(value, crd_field_type(name))
            else:
                made.fields[name] = self._converted(part, crd_field_type(name))
        return (
            made if len(parts) <= len(made.fields) else unknown(Phrase("its values do not fit the fields of TCrdPrm"))
        )

    def _printed_struct(self, made: CStruct, parts: list[Tree[Token]]) -> CValue:
        """Fill a struct with all of its fields, as they are printed."""
        if len(parts) != len(made.fields):
            return unknown(Phrase("its values do not fit the fields of TCrdPrm"))
        for (name, old), part in zip(list(made.fields.items()), parts, strict=True):
            inner = subtrees(part) if part.data == "members" else None
            if isinstance(old, CArray) != (inner is not None) or (
                isinstance(old, CArray) and len(inner or ()) != len(old.values)
            ):
                return unknown(Phrase("its values do not fit the fields of TCrdPrm"))
            made.fields[name] = self.expression(part) if inner is None else self.array_of(inner)
        return made

    def array_of(self, parts: list[Tree[Token]]) -> CArray:
        """Make an array of values as they are printed."""
        return CArray(values=[self.expression(part) for part in parts])

    def _flat_struct(self, made: CStruct, parts: list[Tree[Token]]) -> CValue:
        """Fill a struct from values without inner braces: they go through the elements of its arrays."""
        left = list(parts)
        for name, old in made.fields.items():
            if not left:
                break
            if isinstance(old, CArray):
                count = min(len(old.values), len(left))
                for i in range(count):
                    old.values[i] = self._converted(left.pop(0), crd_field_type(name))
            else:
                made.fields[name] = self._converted(left.pop(0), crd_field_type(name))
        return unknown(Phrase("its values do not fit the fields of TCrdPrm")) if left else made

    def _converted(self, tree: Tree[Token], kind: NumberType | None) -> CValue:
        value = self.expression(tree)
        return converted(value, kind) if isinstance(value, CNumber) else value

    def _enumeration(self, item: Tree[Token]) -> None:
        following: CValue = ZERO
        for enumerator in subtrees(item):
            token = tokens(enumerator)[0]
            if not self._is_plain_name(token):
                return
            given = subtrees(enumerator)
            if given:
                following = self.expression(given[0])
                if isinstance(following, CNumber) and not following.is_whole:
                    following = unknown(NEVER_SET)
            self.variables.declare(str(token), number_type(["int"]), following)
            following = (
                (binary("+", following, CNumber(value=1.0)) or unknown(NEVER_SET))
                if isinstance(following, CNumber)
                else following
            )

    def _check(self, item: Tree[Token]) -> None:
        """Pass over a check of a return code that is not met after success, and that only leaves or reports."""
        parts, keyword = subtrees(item), tokens(item)[0]
        condition, reactions = parts[0], parts[1:]
        if not self._is_ordered(condition):
            return
        value = self.expression(condition)
        if isinstance(value, UnknownValue) and value.is_reported:
            return
        if not isinstance(value, CNumber) or not value.is_code or value.value != 0 or not _only_leaves(reactions):
            self.report(rules.CONTROL_FLOW, keyword, word="if")
            return
        self.checks += 1

    def _wait(self, item: Tree[Token]) -> None:
        """Read a loop that ends with the motion as one question for the status: the program has waited."""
        keyword, parts = tokens(item)[0], subtrees(item)
        is_do = keyword.type == "DO"
        condition, body = (parts[-1], parts[:-1]) if is_do else (parts[0], parts[1:])
        asked = [t for t in map(_question, body) if t is not None]
        run = _run_name(asked[0]) if len(asked) == 1 else None
        harmless = all(_question(t) is not None or _is_harmless(t) for t in body)
        if run is None or not harmless or _has_effect(condition) or not self._waits_for(condition, run, is_do):
            self.report(rules.CONTROL_FLOW, keyword, word=str(keyword))
            return
        for part in body:
            self._statement(part)

    def _waits_for(self, condition: Tree[Token], run: str, is_do: bool) -> bool:
        """Whether a loop goes on while `run` is 1 and ends when it is 0, and is not left out."""
        variables = self.variables
        before = variables.get(run)
        outcomes = []
        for value in (1.0, 0.0):
            variables.values[run] = CNumber(value=value)
            outcomes.append(self.expression(condition))
        variables.values[run] = before
        goes_on, ends = outcomes
        if not (isinstance(goes_on, CNumber) and goes_on.value and isinstance(ends, CNumber) and not ends.value):
            return False
        if is_do or (isinstance(before, UnknownValue) and before.reason == sets_it("GT_CrdStatus")):
            return True
        entered = self.expression(condition)
        return isinstance(entered, CNumber) and entered.value != 0

    # Expressions.

    def expression(self, tree: Tree[Token]) -> CValue:
        """Evaluate an expression; calls of the library in it are made."""
        found: CValue = _EXPRESSIONS[tree.data](self, tree)
        return found

    def _operand(self, tree: Tree[Token]) -> CValue:
        """Evaluate an operand. A macro without parentheses would be torn apart by the operator."""
        if tree.data == "name" and (macro := self.macros.get(str(tokens(tree)[0]))) and not macro.is_operand:
            return unknown(Phrase("it is a macro without parentheses"))
        return self.expression(tree)

    def _name(self, tree: Tree[Token]) -> CValue:
        name = str(tokens(tree)[0])
        macro = self.macros.get(name)
        if is_library_name(name) and name.startswith("GT"):
            self.report(rules.CALL_SYNTAX, tokens(tree)[0], found=Phrase("{call} without arguments", call=name))
            return UnknownValue(reason="", is_reported=True)
        if macro is None:
            is_constant = name in _CONSTANTS and name not in self.variables.values
            return CNumber(value=_CONSTANTS[name]) if is_constant else self.variables.get(name)
        if macro.tree is None or self._depth > _PROBE_DEPTH:
            return unknown(Phrase("it is a macro that is no number"))
        self._depth += 1
        value = self.expression(macro.tree)
        self._depth -= 1
        return value

    def _number(self, tree: Tree[Token]) -> CValue:
        return literal(str(tokens(tree)[0])) or unknown(Phrase("it is no number that C can hold"))

    def _octal(self, tree: Tree[Token]) -> CValue:
        token = tokens(tree)[0]
        digits = str(token)[1:]
        no_octal = bool(set(digits) & set("89"))
        value = Phrase("not defined (8 and 9 are not octal digits)") if no_octal else str(int(digits, 8))
        self.report(rules.CALL_OCTAL, token, found=f"0{digits}", value=value)
        return UnknownValue(reason="", is_reported=True)

    def _no_number(self, tree: Tree[Token]) -> CValue:
        return unknown(Phrase("it is no number"))

    def _size(self, tree: Tree[Token]) -> CValue:
        if _has_effect(tree):
            self.report(rules.CONTROL_FLOW, tokens(tree)[0], word="sizeof")
        return unknown(Phrase("its size depends on the compiler"))

    def _assign(self, tree: Tree[Token]) -> CValue:
        target, source = subtrees(tree)
        operator = str(tokens(tree)[0])
        if target.data == "call":
            self.report(rules.CALL_SYNTAX, tokens(tree)[0], found=f"'{operator}'")
            return UnknownValue(reason="", is_reported=True)
        if _has_effect(target):
            return self._refused_place(target)
        if source.data == "new":
            return self._set(target, self._new(source))
        if source.data != "assign":
            self._keep_addresses(source)
        value = self.expression(source) if operator == "=" else self._operand(source)
        if operator != "=":
            value = self._binary_value(operator[:-1], self.expression(target), value)
        return self._set(target, value)

    def _keep_addresses(self, source: Tree[Token]) -> None:
        """Note that the program keeps an address: what is there can change from now on."""
        if source.data == "call":
            return  # The call gets it, and says what becomes of it.
        given = self.addressed(source)
        self.variables.escaped |= given
        self.variables.lose(given, Phrase("a pointer to it is kept"))

    def _refused_place(self, target: Tree[Token]) -> CValue:
        """Report a place that is computed by a call or a change of a variable."""
        token = first_token(target)
        assert token is not None
        self.report(rules.CALL_SYNTAX, token, found=Phrase("a place that depends on a call"))
        return UnknownValue(reason="", is_reported=True)

    def _new(self, tree: Tree[Token]) -> CValue:
        word, sizes = str(tokens(tree)[-1]), [self.expression(t) for t in subtrees(tree)]
        if word.endswith(STRUCT_TYPE) and not sizes:
            return self._struct(tree, ZERO)
        kind = number_type([word])
        if kind is not None and sizes and isinstance(sizes[0], CNumber) and 0 < sizes[0].value <= MAX_ARRAY:
            return CArray(values=[converted(ZERO, kind)] * int(sizes[0].value), element=kind)
        return unknown(Phrase("it is a new object"))

    def _set(self, target: Tree[Token], value: CValue) -> CValue:
        """Assign a value; returns what the target then has."""
        if target.data == "name":
            token = tokens(target)[0]
            if not self._is_plain_name(token):
                return UnknownValue(reason="", is_reported=True)
            self.variables.set(str(token), value)
            return self.variables.get(str(token))
        place = self._place(target)
        if place is None:
            self.variables.lose_all(Phrase("a write through a pointer may have changed it"))
            return unknown(NEVER_SET)
        return self._set_part(*place, value)

    def _place(self, target: Tree[Token]) -> tuple[Token, Token | None, Tree[Token] | None] | None:
        """Take a target apart: name, field and index; None for what a pointer may point to."""
        index = None
        if target.data == "index":
            target, index = subtrees(target)
        member = None
        if target.data == "member":
            if tokens(target)[0].type != "DOT":
                return None
            member, target = tokens(target)[-1], subtrees(target)[0]
        if target.data != "name" or not self._is_plain_name(tokens(target)[0]):
            return None
        return tokens(target)[0], member, index

    def _set_part(self, token: Token, member: Token | None, index: Tree[Token] | None, value: CValue) -> CValue:
        name = str(token)
        holder = self.variables.values.get(name)
        if member is not None:
            if not self._is_plain_name(member):
                return UnknownValue(reason="", is_reported=True)
            holder = self._struct_for(name, member, holder)
            if holder is None:
                return UnknownValue(reason="", is_reported=True)
        kind = crd_field_type(str(member)) if member is not None else None
        if index is None:
            assert isinstance(holder, CStruct)
            made = converted(value, kind) if isinstance(value, CNumber) else value
            holder.fields[str(member)] = made.copy() if isinstance(made, CArray) else made
            return made
        array = holder.fields.get(str(member)) if isinstance(holder, CStruct) else holder
        number = self.expression(index)
        if isinstance(holder, CStruct) and not isinstance(array, CArray):
            array = self._field_array(holder, str(member), kind)
        if name not in self.variables.declared:
            self.variables.lose_others(name)
        if not isinstance(array, CArray):
            if name in self.variables.declared or not isinstance(number, CNumber):
                # Not an array of this file: a pointer, which may point anywhere.
                self.variables.lose_all(Phrase("a write through a pointer may have changed it"))
                return unknown(NEVER_SET)
            array = CArray(values=[])
            self.variables.values[name] = array
        return _set_element(array, number, value)

    def _struct_for(self, name: str, member: Token, holder: CValue | None) -> CStruct | None:
        """Return the struct of a name, made where the text does not declare it; None with a report for no field."""
        if not isinstance(holder, CStruct):
            holder = CStruct(fields={})
            self.variables.values[name] = holder
        if holder.is_crd and crd_field_type(str(member)) is None:
            self.report_field(member)
            return None
        return holder

    def report_field(self, member: Token) -> None:
        """Report a field that TCrdPrm does not have."""
        near = nearest(str(member), crd_struct(ZERO).fields)
        self.report(rules.UNKNOWN_FIELD, member, field=str(member), hint=did_you_mean(near))

    def crd_fields(self, value: CStruct) -> tuple[str, str] | None:
        """Find a field that TCrdPrm does not have, with a hint; make a struct of another place a TCrdPrm."""
        wrong = next((name for name in value.fields if crd_field_type(name) is None), None)
        if wrong is not None:
            return wrong, did_you_mean(nearest(wrong, crd_struct(ZERO).fields))
        return None

    def _field_array(self, holder: CStruct, member: str, kind: NumberType | None) -> CArray:
        """Make the array of a field that was not set yet."""
        count = 8 if kind is not None else 0
        made = CArray(values=[unknown(NEVER_SET)] * count, element=kind)
        holder.fields[member] = made
        return made

    def _binary(self, tree: Tree[Token]) -> CValue:
        left, right = subtrees(tree)
        if _has_call(left) and _has_call(right) and not _is_output(tree):
            self.report(rules.CONTROL_FLOW, tokens(tree)[0], word=str(tokens(tree)[0]))
            return UnknownValue(reason="", is_reported=True)
        return self._binary_value(str(tokens(tree)[0]), self._operand(left), self._operand(right))

    def _binary_value(self, operator: str, left: CValue, right: CValue) -> CValue:
        for value in (left, right):
            if isinstance(value, UnknownValue):
                return value
        if not isinstance(left, CNumber) or not isinstance(right, CNumber):
            return unknown(Phrase("it is an address"))
        found = binary(operator, left, right)
        return found or unknown(Phrase("the result of {operator} depends on the compiler", operator=operator))

    def _logical(self, tree: Tree[Token]) -> CValue:
        left_tree, right_tree = subtrees(tree)
        operator = tokens(tree)[0]
        left = self._operand(left_tree)
        if not isinstance(left, CNumber):
            if _has_effect(right_tree) and not (isinstance(left, UnknownValue) and left.is_reported):
                self.report(rules.CONTROL_FLOW, operator, word=str(operator))
                return UnknownValue(reason="", is_reported=True)
            return left
        decided = (left.value != 0) == (operator == "||")
        if decided:
            return CNumber(value=float(left.value != 0), is_code=left.is_code)
        right = self._operand(right_tree)
        if not isinstance(right, CNumber):
            return right
        return CNumber(value=float(right.value != 0), is_code=left.is_code or right.is_code)

    def _unary(self, tree: Tree[Token]) -> CValue:
        operator, value = str(tokens(tree)[0]), self._operand(subtrees(tree)[0])
        if not isinstance(value, CNumber):
            return value
        found = unary(operator, value)
        return found or unknown(Phrase("the result of {operator} depends on the compiler", operator=operator))

    def _address(self, tree: Tree[Token]) -> CValue:
        return unknown(Phrase("it is an address"))

    def _cast(self, tree: Tree[Token]) -> CValue:
        kind, inner = subtrees(tree)
        value = self._operand(inner)
        words = [str(t) for t in tokens(kind) if t.type == "TYPE"]
        found = number_type(words)
        if any(t.type == "STAR" for t in tokens(tree)) or found is None:
            return unknown(Phrase("it is no number")) if words != ["void"] else value
        if not isinstance(value, CNumber):
            return value
        return found.convert(value) or unknown(Phrase("its type can't hold the value that it was given"))

    def _step(self, tree: Tree[Token]) -> CValue:
        operator, target = str(tokens(tree)[0])[0], subtrees(tree)[0]
        if _has_effect(target):
            return self._refused_place(target)
        before = self.expression(target)
        after = self._set(target, self._binary_value(operator, before, CNumber(value=1.0)))
        return after if isinstance(tree.children[0], Token) else before

    def _index(self, tree: Tree[Token]) -> CValue:
        array, index = (self._operand(part) for part in subtrees(tree))
        if isinstance(array, UnknownValue):
            return array
        if not isinstance(array, CArray) or not isinstance(index, CNumber) or not index.is_whole:
            return unknown(Phrase("it is an element that is not known"))
        at = int(index.value)
        return array.values[at] if 0 <= at < len(array.values) else unknown(NEVER_SET)

    def _member(self, tree: Tree[Token]) -> CValue:
        kind, name = tokens(tree)
        holder = self._operand(subtrees(tree)[0]) if kind.type == "DOT" else unknown(NEVER_SET)
        if isinstance(holder, CStruct):
            if holder.is_crd and crd_field_type(str(name)) is None:
                self.report_field(name)
                return UnknownValue(reason="", is_reported=True)
            return holder.fields.get(str(name), unknown(NEVER_SET))
        return holder if isinstance(holder, UnknownValue) else unknown(NEVER_SET)

    # Calls.

    def _call(self, tree: Tree[Token]) -> CValue:
        name, args = called_name(tree), subtrees(tree)[1:]
        if name is None:
            token = first_token(tree)
            assert token is not None
            self.report(rules.CALL_SYNTAX, token, found=Phrase("a call through an expression"))
            return UnknownValue(reason="", is_reported=True)
        if any(arg.data in ("address", "by_reference", "members") and _has_effect(arg) for arg in args):
            self.report(rules.CALL_SYNTAX, name, found=Phrase("a place that depends on a call"))
            return UnknownValue(reason="", is_reported=True)
        if sum(map(_has_call, args)) > 1:
            self.report(rules.CONTROL_FLOW, name, word=Phrase("several calls as arguments of one"))
            return UnknownValue(reason="", is_reported=True)
        text = str(name)
        if (macro := self.macros.get(text)) is not None:
            text = macro.text if re.fullmatch(r"[A-Za-z_]\w*", macro.text) and macro.text not in self.macros else ""
            if not text:
                self.report(rules.CALL_SYNTAX, name, found=Phrase("the macro {name} as a call", name=str(name)))
                return UnknownValue(reason="", is_reported=True)
        if is_library_name(text):
            self.call_library(name, text, args)
            return CNumber(value=0.0, is_code=True)
        return self._function(name, text, args, is_alone=tree is self._alone)

    def _function(self, token: Token, name: str, args: Sequence[Tree[Token]], *, is_alone: bool) -> CValue:
        """Call a function that is none of the library: it may change what it can reach.

        One that gives no value and sets nothing can only be there for what it does: it may make calls itself.
        """
        wraps = any(map(_has_call, args))
        if _NOT_EVALUATED.fullmatch(name) and any(map(_has_effect, args)):
            self.report(rules.CONTROL_FLOW, token, word=name)
            return UnknownValue(reason="", is_reported=True)
        for arg in args:
            if arg.data not in ("by_reference", "address", "members", "null"):
                self.expression(arg)
        if name == "memset" and self._memset(args):
            return unknown(NEVER_SET)
        harmless = name in HARMLESS_FUNCTIONS
        reason = Phrase("{function}() may have changed it", function=name)
        sets = is_alone and any(map(self.addressed, args))
        for arg in args:
            given = self.addressed(arg) if not harmless or arg.data != "name" else set()
            self.variables.escaped |= given
            self.variables.lose(given, reason)
            if self.has_references and not harmless and arg.data == "name":
                self.variables.lose([str(tokens(arg)[0])], reason)
        if not harmless:
            self.variables.lose_escaped(reason)
        rule = rules.CALL_IGNORED if harmless else rules.FUNCTION_OF_VALUES
        if is_alone and not sets and not harmless:
            rule = rules.UNREAD_FUNCTION
        if not self.reported_functions & {name, f"{rule.code} {name}"} and not (wraps and not harmless):
            self.reported_functions.add(f"{rule.code} {name}")
            self.report(rule, token, call=name)
        return unknown(Phrase("{function}() gives it", function=name))

    def addressed(self, tree: Tree[Token]) -> set[str]:
        """Find the variables whose address an expression gives: &x, ref x, an array, a part of one, array + 1."""
        found = {
            name for part in tree.iter_subtrees() if (name := _given_name(part)) is not None and part.data != "name"
        }
        indexed = [id(subtrees(part)[0]) for part in tree.find_data("index")]
        for part in tree.find_data("name"):
            name = str(tokens(part)[0])
            if isinstance(self.variables.values.get(name), CArray) and id(part) not in indexed:
                found.add(name)
        for part in tree.find_data("member"):
            holder = _given_name(Tree("address", [part]))
            if id(part) not in indexed and holder is not None and isinstance(self._part(part), CArray):
                found.add(holder)
        return found

    def _part(self, member: Tree[Token]) -> CValue | None:
        """Return the field that an expression names, without any report."""
        holder = self.variables.values.get(str(_given_name(Tree("address", [member]))))
        return holder.fields.get(str(tokens(member)[-1])) if isinstance(holder, CStruct) else None

    def _memset(self, args: Sequence[Tree[Token]]) -> bool:
        """Run memset(&name, 0, sizeof(name)) or memset(&name, 0, sizeof(TCrdPrm)); False for any other use."""
        if len(args) != 3 or args[2].data != "size" or any(t.type == "STAR" for t in tokens(args[2])):
            return False
        place, (size,) = args[0], subtrees(args[2])
        target = subtrees(place)[0] if place.data == "address" else place
        if target.data != "name" or args[1].data != "number" or self.expression(args[1]) != ZERO:
            return False
        name = str(tokens(target)[0])
        old = self.variables.values.get(name)
        is_whole = size.data == "name" and str(tokens(size)[0]) == name
        is_crd = size.data == "type" and str(tokens(size)[-1]).endswith(STRUCT_TYPE)
        if place.data == "name":  # Of an array: a struct has no address without &.
            if is_whole and isinstance(old, CArray) and old.element is not None:
                old.values[:] = [converted(ZERO, old.element)] * len(old.values)
                return True
            return False
        if is_crd and (old is None or isinstance(old, CStruct)):
            self.variables.values[name] = crd_struct(ZERO)
            return True
        if is_whole and isinstance(old, CStruct) and old.is_crd:
            self.variables.values[name] = crd_struct(ZERO)
            return True
        return False

    def _give_away(self, tree: Tree[Token]) -> None:
        """Evaluate what a pointer is set to: what it points to can change from now on."""
        if tree.data not in ("address", "null", "new", "members"):
            self.expression(tree)
        for token in tree.scan_values(lambda t: isinstance(t, Token) and t.type == "NAME"):
            self.variables.escaped.add(str(token))
            self.variables.lose([str(token)], Phrase("a pointer to it is kept"))

    def _is_plain_name(self, token: Token) -> bool:
        """Whether a name is no macro, which would be replaced; else it is reported."""
        if str(token) not in self.macros:
            return True
        self.report(rules.CALL_SYNTAX, token, found=Phrase("the macro {name} as a name", name=str(token)))
        return False


_EXPRESSIONS: dict[str, Callable[[CEvaluator, Tree[Token]], CValue]] = {
    "name": CEvaluator._name,
    "number": CEvaluator._number,
    "octal": CEvaluator._octal,
    "text": CEvaluator._no_number,
    "null": CEvaluator._no_number,
    "members": CEvaluator._no_number,
    "new": CEvaluator._no_number,
    "by_reference": CEvaluator._address,
    "address": CEvaluator._address,
    "size": CEvaluator._size,
    "assign": CEvaluator._assign,
    "binary": CEvaluator._binary,
    "logical": CEvaluator._logical,
    "unary": CEvaluator._unary,
    "cast": CEvaluator._cast,
    "step": CEvaluator._step,
    "index": CEvaluator._index,
    "member": CEvaluator._member,
    "call": CEvaluator._call,
}


def _set_element(array: CArray, number: CValue, value: CValue) -> CValue:
    if not isinstance(number, CNumber) or not number.is_whole:
        array.values[:] = [unknown(Phrase("an element that is not known was set"))] * len(array.values)
        return unknown(NEVER_SET)
    at = int(number.value)
    made = converted(value, array.element) if isinstance(value, CNumber) else value
    if array.element is None and 0 <= at < MAX_ARRAY:  # Declared elsewhere: its size is not known.
        array.values += [unknown(NEVER_SET)] * (at + 1 - len(array.values))
    if not 0 <= at < len(array.values):
        array.values[:] = [unknown(Phrase("an element outside of it was set"))] * len(array.values)
        return unknown(NEVER_SET)
    array.values[at] = made
    return made


def _without_void(tree: Tree[Token]) -> Tree[Token]:
    """Strip the cast of `(void)GT_LnXY(...)`."""
    if tree.data == "cast" and [str(t) for t in tokens(subtrees(tree)[0])] == ["void"]:
        return subtrees(tree)[1]
    return tree


def _question(tree: Tree[Token]) -> Tree[Token] | None:
    """Return the call of a statement that asks for the status: GT_CrdStatus(...), rtn = GT_CrdStatus(...)."""
    tree = _without_void(tree)
    if tree.data == "assign" and subtrees(tree)[0].data == "name" and tokens(tree)[0] == "=":
        tree = subtrees(tree)[1]
    return tree if tree.data == "call" and called_name(tree) == "GT_CrdStatus" else None


def _run_name(call: Tree[Token]) -> str | None:
    """Return the variable that tells whether the motion runs: the first that GT_CrdStatus sets."""
    given = [_given_name(arg) for arg in subtrees(call)[1:] if arg.data in ("address", "by_reference")]
    return given[0] if len(given) == 2 else None


def _is_harmless(tree: Tree[Token]) -> bool:
    """Whether a statement only reports or lets time pass."""
    tree = _without_void(tree)
    if tree.data != "call":
        return _is_output(tree) and not _has_effect(tree)
    return str(called_name(tree)) in HARMLESS_FUNCTIONS and not any(map(_has_effect, subtrees(tree)[1:]))


def _is_output(tree: Tree[Token]) -> bool:
    """Whether an expression is the output of C++: std::cout << a << b."""
    while tree.data == "binary" and tokens(tree)[0] == "<<":
        tree = subtrees(tree)[0]
        if tree.data in ("name", "member") and tokens(tree)[-1] in _STREAMS:
            return True
    return False


def _in_chain(tree: Tree[Token], effect: Tree[Token], name: str) -> bool:
    """Whether an assignment is in a chain, a = b = 5, whose targets all differ."""
    targets: list[str] = []
    while tree.data == "assign":
        target, source = subtrees(tree)
        targets += [str(t) for t in target.scan_values(lambda t: isinstance(t, Token) and t.type == "NAME")]
        if tree is effect:
            used = [str(t) for t in source.scan_values(lambda t: isinstance(t, Token) and t.type == "NAME")]
            return targets.count(name) == 1 and (source.data == "assign" or not used or name not in targets[:-1])
        tree = source
    return False


def _calls(tree: Tree[Token]) -> Iterator[str]:
    for call in tree.find_data("call"):
        name = called_name(call)
        yield "" if name is None else str(name)


def _has_call(tree: Tree[Token]) -> bool:
    """Whether an expression has a call of the library, or one that may be one: a macro, a computed one."""
    return any(not name or is_library_name(name) for name in _calls(tree))


def _has_effect(tree: Tree[Token]) -> bool:
    """Whether evaluating an expression does anything."""
    return any(t.data in ("assign", "step") for t in tree.iter_subtrees()) or any(True for _ in _calls(tree))


def _only_leaves(reactions: Sequence[Tree[Token]]) -> bool:
    """Whether a reaction to an error ends the program or the function, or only reports."""
    left = [r for r in reactions if r.children]
    if any(isinstance(r.children[0], Token) for r in left[-1:]):
        return True
    return bool(left) and all(_is_harmless(subtrees(r)[0]) for r in left)


def _given_name(arg: Tree[Token]) -> str | None:
    """Return the variable that an argument gives a function to change: &x, ref x, an array; None for none."""
    tree = arg
    if tree.data in ("address", "by_reference"):
        tree = subtrees(tree)[0]
    while tree.data in ("index", "member") and subtrees(tree) and (tree is not arg):
        tree = subtrees(tree)[0]
    if tree.data == "name":
        return str(tokens(tree)[0])
    return None
