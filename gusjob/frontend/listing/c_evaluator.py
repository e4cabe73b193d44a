"""Evaluate expressions of straight-line C: their values, what they assign, and which calls of the library they make.

A value that the text does not tell is an UnknownValue with its reason: the call that uses it is reported. What would
decide whether a call is made is reported as control flow.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

from lark import Token, Tree
from msgspec import Struct, field

from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Rule
from gusjob.frontend.listing.c_numbers import CNumber, NumberType, binary, literal, number_type, unary
from gusjob.frontend.listing.c_structs import new_struct
from gusjob.frontend.listing.c_trees import (
    called_name,
    first_token,
    has_call,
    has_effect,
    in_chain,
    is_harmless_call,
    is_library_name,
    is_output,
    names_in,
    qualifier,
    variable_of,
)
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
    unknown,
)
from gusjob.frontend.listing.listing_diagnostics import control_flow
from gusjob.frontend.parse.grammar import subtrees, tokens
from gusjob.i18n.phrases import Phrase, did_you_mean
from gusjob.i18n.spelling import nearest
from gusjob.patterns import lazy_pattern

_CONSTANTS = {"true": 1.0, "false": 0.0, "TRUE": 1.0, "FALSE": 0.0}
_NOT_EVALUATED = lazy_pattern(r"\w*(?:assert|debug|trace)\w*|DCHECK\w*", re.IGNORECASE | re.ASCII)
"""Functions and macros whose arguments some builds leave out."""
_MACRO_DEPTH = 8
"""Levels of macros in macros."""
_MAX_EXPANSIONS = 1000
"""Macros that one statement may use."""
_NUMBERED = lazy_pattern(r"(profile|originPos)([1-8])")
"""Fields of TCrdPrm in C#, which has one for each element."""


class CMacro(Struct, frozen=True, kw_only=True):
    """A macro without arguments. `tree` None: its text is no expression. `is_operand`: it needs no parentheses."""

    text: str
    tree: Tree[Token] | None
    is_operand: bool


def no_library(token: Token, name: str, owner: str, args: Sequence[Tree[Token]]) -> None:
    """Make no call."""


class CEvaluator(Struct):
    """Evaluates trees of listing.lark.

    Attributes:
        report: Called with a rule, a token and the rule's fields.
        call_library: Called with the name of a call of the library, what qualifies it (mc in mc.GT_LnXY), and its
            arguments.
        has_references: A function may change a variable that it is given by its name (C++).
        shares_arrays: The copy of a struct has the same arrays (C#).
    """

    report: Callable[..., None]
    has_references: bool
    shares_arrays: bool = False
    call_library: Callable[[Token, str, str, Sequence[Tree[Token]]], None] = no_library
    variables: CVariables = field(default_factory=CVariables)
    macros: dict[str, CMacro] = field(default_factory=dict)
    reported_functions: set[str] = field(default_factory=set)
    """Functions that were reported already, by name, or by rule and name."""
    expansions: int = 0
    """Macros that the statement has used."""
    _depth: int = 0
    alone: Tree[Token] | None = None
    """The expression that is a statement of its own: nobody uses its value."""

    def expression(self, tree: Tree[Token]) -> CValue:
        """Evaluate an expression; calls of the library in it are made."""
        found: CValue = _EXPRESSIONS[tree.data](self, tree)
        return found

    def is_ordered(self, tree: Tree[Token]) -> bool:
        """Whether the order of an expression's effects does not matter, or C says it; else it is reported."""
        names = names_in(tree)
        for effect in tree.iter_subtrees():
            if effect.data not in ("assign", "step") or effect is tree:
                continue
            target = subtrees(effect)[0]
            name = next((t for t in target.scan_values(lambda t: isinstance(t, Token) and t.type == "NAME")), None)
            if name is not None and names.count(str(name)) > 1 and not in_chain(tree, effect, str(name)):
                self.report(
                    rules.CALL_SYNTAX, name, found=Phrase("{name} set and used in one statement", name=str(name))
                )
                return False
        return True

    def is_plain_name(self, token: Token) -> bool:
        """Whether a name is no macro, which would be replaced; else it is reported."""
        if str(token) not in self.macros:
            return True
        self.report(rules.CALL_SYNTAX, token, found=Phrase("the macro {name} as a name", name=str(token)))
        return False

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
        self.expansions += 1
        if macro.tree is None or self._depth > _MACRO_DEPTH or self.expansions > _MAX_EXPANSIONS:
            self.report(rules.CALL_SYNTAX, tokens(tree)[0], found=Phrase("the macro {name} as a value", name=name))
            return UnknownValue(reason="", is_reported=True)
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
        if has_effect(tree):
            self.report(rules.CONTROL_FLOW, tokens(tree)[0], what=Phrase("sizeof does not make the calls in it"))
        return unknown(Phrase("its size depends on the compiler"))

    def _assign(self, tree: Tree[Token]) -> CValue:
        target, source = subtrees(tree)
        operator = str(tokens(tree)[0])
        if target.data == "call":
            self.report(rules.CALL_SYNTAX, tokens(tree)[0], found=f"'{operator}'")
            return UnknownValue(reason="", is_reported=True)
        if has_effect(target):
            return self._refused_place(target)
        if source.data == "new":
            return self._set(target, self._new(source))
        if source.data != "assign":
            self.keep_addresses(source)
        value = self.expression(source) if operator == "=" else self._operand(source)
        if isinstance(value, CStruct):
            value = self.struct_copy(source, value)
        if operator != "=":
            value = self._binary_value(operator[:-1], self.expression(target), value)
        return self._set(target, value)

    def struct_copy(self, source: Tree[Token], value: CStruct) -> CValue:
        """Copy a struct; in C# neither is known then, since a change of one array changes both."""
        if not self.shares_arrays:
            return value.copy()
        self.give_away(source)
        return unknown(Phrase("it can change through a pointer"))

    def keep_addresses(self, source: Tree[Token]) -> None:
        """Note that the program keeps an address: what is there can change from now on."""
        if source.data == "call":
            return  # The call gets it, and says what becomes of it.
        given = self.addressed(source)
        self.variables.escaped |= given
        self.variables.lose(given, Phrase("it can change through a pointer"))

    def _refused_place(self, target: Tree[Token]) -> CValue:
        """Report a place that is computed by a call or a change of a variable."""
        token = first_token(target)
        assert token is not None
        self.report(rules.CALL_SYNTAX, token, found=Phrase("an assignment target with a call or ++ in it"))
        return UnknownValue(reason="", is_reported=True)

    def _new(self, tree: Tree[Token]) -> CValue:
        word, sizes = str(tokens(tree)[-1]), [self.expression(t) for t in subtrees(tree)]
        if word.endswith(STRUCT_TYPE) and not sizes:
            return new_struct()
        kind = number_type([word])
        if kind is not None and sizes and isinstance(sizes[0], CNumber) and 0 < sizes[0].value <= MAX_ARRAY:
            return CArray(values=[converted(ZERO, kind)] * int(sizes[0].value), element=kind)
        return unknown(Phrase("it is a new object"))

    def _set(self, target: Tree[Token], value: CValue) -> CValue:
        """Assign a value; returns what the target then has."""
        if target.data == "name":
            token = tokens(target)[0]
            if not self.is_plain_name(token):
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
            if index is None and (numbered := _NUMBERED.fullmatch(str(member))) is not None:
                member = member.update(value=numbered[1])
                index = Tree("number", [Token("NUMBER", str(int(numbered[2]) - 1))])
        if target.data != "name" or not self.is_plain_name(tokens(target)[0]):
            return None
        return tokens(target)[0], member, index

    def _set_part(self, token: Token, member: Token | None, index: Tree[Token] | None, value: CValue) -> CValue:
        name = str(token)
        holder = self.variables.values.get(name)
        if member is not None:
            if not self.is_plain_name(member):
                return UnknownValue(reason="", is_reported=True)
            holder = self._struct_for(name, member, holder)
            if holder is None:
                return UnknownValue(reason="", is_reported=True)
        kind = crd_field_type(str(member)) if member is not None else None
        if index is None:
            assert isinstance(holder, CStruct)
            made = converted(value, kind) if isinstance(value, CNumber) else value
            holder.fields[str(member)] = made.copy() if isinstance(made, CArray) else made
            if isinstance(made, CStruct):
                holder.fields[str(member)] = unknown(Phrase("it is no number"))
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

    def report_field(self, member: Token, name: str = "") -> None:
        """Report a field that TCrdPrm does not have, at a token."""
        wrong = name or str(member)
        near = nearest(wrong, crd_struct(ZERO).fields)
        self.report(rules.UNKNOWN_FIELD, member, field=wrong, hint=did_you_mean(near))

    def wrong_field(self, value: CValue) -> str | None:
        """Find a field of a struct that TCrdPrm does not have; None for none."""
        fields = value.fields if isinstance(value, CStruct) else {}
        return next((name for name in fields if crd_field_type(name) is None), None)

    def _field_array(self, holder: CStruct, member: str, kind: NumberType | None) -> CArray:
        """Make the array of a field that was not set yet."""
        count = 8 if kind is not None else 0
        made = CArray(values=[unknown(NEVER_SET)] * count, element=kind)
        holder.fields[member] = made
        return made

    def _binary(self, tree: Tree[Token]) -> CValue:
        left, right = subtrees(tree)
        if has_call(left) and has_call(right) and not is_output(tree):
            self.report(
                rules.CONTROL_FLOW,
                tokens(tree)[0],
                what=Phrase(
                    "the order of the calls around '{operator}' depends on the compiler", operator=str(tokens(tree)[0])
                ),
            )
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
            if has_effect(right_tree) and not (isinstance(left, UnknownValue) and left.is_reported):
                self.report(rules.CONTROL_FLOW, operator, what=control_flow(str(operator)))
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
        if has_effect(tree):
            return self._refused_place(tree)
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
        return found.convert(value) or unknown(Phrase("the value does not fit its type"))

    def _step(self, tree: Tree[Token]) -> CValue:
        operator, target = str(tokens(tree)[0])[0], subtrees(tree)[0]
        if has_effect(target):
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
        if has_effect(subtrees(tree)[0]):
            return self._refused_place(tree)
        holder = self._operand(subtrees(tree)[0]) if kind.type == "DOT" else unknown(NEVER_SET)
        if isinstance(holder, CStruct) and (numbered := _NUMBERED.fullmatch(str(name))) is not None:
            array = holder.fields.get(numbered[1])
            return array.values[int(numbered[2]) - 1] if isinstance(array, CArray) else unknown(NEVER_SET)
        if isinstance(holder, CStruct):
            if holder.is_crd and crd_field_type(str(name)) is None:
                self.report_field(name)
                return UnknownValue(reason="", is_reported=True)
            return holder.fields.get(str(name), unknown(NEVER_SET))
        return holder if isinstance(holder, UnknownValue) else unknown(NEVER_SET)

    def _call(self, tree: Tree[Token]) -> CValue:
        name, args = called_name(tree), subtrees(tree)[1:]
        if name is None or any(map(has_effect, subtrees(subtrees(tree)[0]))):
            token = first_token(tree)
            assert token is not None
            self.report(rules.CALL_SYNTAX, token, found=Phrase("a function that is not called by its name"))
            return UnknownValue(reason="", is_reported=True)
        if any(arg.data in ("address", "by_reference", "members") and has_effect(arg) for arg in args):
            self.report(rules.CALL_SYNTAX, name, found=Phrase("an assignment target with a call or ++ in it"))
            return UnknownValue(reason="", is_reported=True)
        if sum(map(has_call, args)) > 1:
            self.report(rules.CONTROL_FLOW, name, what=Phrase("several calls are arguments of one call"))
            return UnknownValue(reason="", is_reported=True)
        text = str(name)
        if (macro := self.macros.get(text)) is not None:
            is_name = macro.tree is not None and macro.tree.data == "name"
            text = macro.text if is_name and macro.text not in self.macros else ""
            if not text:
                self.report(rules.CALL_SYNTAX, name, found=Phrase("the macro {name} as a call", name=str(name)))
                return UnknownValue(reason="", is_reported=True)
        if is_library_name(text):
            self.call_library(name, text, qualifier(tree), args)
            return CNumber(value=0.0, is_code=True)
        return self._function(tree, name, text)

    def _function(self, call: Tree[Token], token: Token, name: str) -> CValue:
        """Call a function that is none of the library: it may change what it can reach.

        One that gives no value and sets nothing can only be there for what it does: it may make calls itself.
        """
        args, is_alone = subtrees(call)[1:], call is self.alone
        wraps = any(map(has_call, args))
        if any(map(_NOT_EVALUATED.fullmatch, (name, *names_in(subtrees(call)[0])))) and any(map(has_effect, args)):
            self.report(rules.CONTROL_FLOW, token, what=Phrase("some builds leave out {name}", name=name))
            return UnknownValue(reason="", is_reported=True)
        for arg in args:
            if arg.data not in ("by_reference", "address", "members", "null"):
                self.expression(arg)
        if name == "memset" and self._memset(args):
            return unknown(NEVER_SET)
        harmless = name == str(token) and is_harmless_call(call)
        owner = re.match(r"\w+", qualifier(call))
        reason = Phrase("{function}() may have changed it", function=name)
        sets = is_alone and any(map(self.addressed, args))
        for arg in args:
            given = self.addressed(arg) if not harmless or arg.data != "name" else set()
            self.variables.escaped |= given
            self.variables.lose(given, reason)
            if self.has_references and not harmless and (place := variable_of(arg)) is not None:
                self.variables.escaped.add(place)
                self.variables.lose([place], reason)
        if owner is not None and owner[0] in self.variables.values:  # A method of the object.
            self.variables.lose([owner[0]], reason)
        if not harmless:
            self.variables.lose_escaped(reason)
        if harmless or not wraps:
            rule = rules.UNREAD_FUNCTION if is_alone and not sets else rules.FUNCTION_OF_VALUES
            self._report_function(rules.CALL_IGNORED if harmless else rule, token, name)
        return unknown(Phrase("{function}() returns it", function=name))

    def _report_function(self, rule: Rule, token: Token, name: str) -> None:
        """Report a function, once for each rule."""
        key = f"{rule.code} {name}"
        if not self.reported_functions & {name, key}:
            self.reported_functions.add(key)
            self.report(rule, token, call=name)

    def addressed(self, tree: Tree[Token]) -> set[str]:
        """Find the variables whose address an expression gives: &x, ref x, an array, a part of one, array + 1.

        A macro gives those of its text.
        """
        given = [*tree.find_data("address"), *tree.find_data("by_reference")]
        found = {name for part in given if (name := variable_of(part)) is not None}
        indexed = [id(subtrees(part)[0]) for part in tree.find_data("index")]
        for part in tree.find_data("name"):
            name = str(tokens(part)[0])
            if isinstance(self.variables.values.get(name), CArray) and id(part) not in indexed:
                found.add(name)
        for name in names_in(tree):
            found |= self._names_of_macro(name)
        for part in tree.find_data("member"):
            holder = variable_of(part)
            if id(part) not in indexed and holder is not None and isinstance(self._part(part), CArray):
                found.add(holder)
        return found

    def _names_of_macro(self, name: str) -> set[str]:
        """Find all names that a macro stands for; none for a name that is no macro."""
        found: set[str] = set()
        waiting = [name]
        while waiting:
            macro = self.macros.get(waiting.pop())
            names = set(re.findall(r"[A-Za-z_]\w*", macro.text)) if macro is not None else set()
            waiting += names - found
            found |= names
        return found

    def _part(self, member: Tree[Token]) -> CValue | None:
        """Return the field that an expression names, without any report."""
        holder = self.variables.values.get(str(variable_of(member)))
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
        if name in self.macros:
            return False
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
        if is_whole and old is None:  # Declared elsewhere: if a call takes it as a TCrdPrm, it is one.
            self.variables.values[name] = CStruct(fields=crd_struct(ZERO).fields)
            return True
        return False

    def give_away(self, tree: Tree[Token]) -> None:
        """Evaluate what a pointer is set to: what it points to can change from now on."""
        if tree.data not in ("null", "new", "members"):
            self.expression(tree)
        for token in tree.scan_values(lambda t: isinstance(t, Token) and t.type == "NAME"):
            self.variables.escaped.add(str(token))
            self.variables.lose([str(token)], Phrase("it can change through a pointer"))


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
