"""Run the statements of straight-line C: declarations, checks of return codes, and loops that wait for the motion."""

from __future__ import annotations

from lark import Token, Tree
from msgspec import Struct

from gusjob.diagnostics import rules
from gusjob.frontend.listing.c_evaluator import CEvaluator
from gusjob.frontend.listing.c_numbers import CNumber, NumberType, binary, number_type
from gusjob.frontend.listing.c_structs import initial_struct, new_struct
from gusjob.frontend.listing.c_trees import (
    first_token,
    has_effect,
    is_harmless,
    is_output,
    only_leaves,
    run_name,
    status_question,
    without_void,
)
from gusjob.frontend.listing.c_variables import (
    MAX_ARRAY,
    NEVER_SET,
    STRUCT_TYPE,
    ZERO,
    CArray,
    CStruct,
    CValue,
    UnknownValue,
    converted,
    crd_struct,
    sets_it,
    unknown,
)
from gusjob.frontend.listing.listing_diagnostics import control_flow
from gusjob.frontend.parse.grammar import subtrees, tokens
from gusjob.i18n.phrases import Phrase


class CStatements(Struct):
    """Runs items of listing.lark. `checks`: checks of return codes that were passed over."""

    evaluator: CEvaluator
    checks: int = 0

    def run(self, item: Tree[Token]) -> None:
        """Run one item of a listing."""
        self.evaluator.expansions = 0
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
        tree = without_void(tree)
        has_effect = tree.data in ("assign", "step", "call", "logical") or is_output(tree)
        if not has_effect:
            token = first_token(tree)
            if token is not None:
                self.evaluator.report(
                    rules.CALL_SYNTAX, token, found=Phrase("'{text}', which does nothing", text=str(token))
                )
            return
        if self.evaluator.is_ordered(tree):
            self.evaluator.alone = tree
            self.evaluator.expression(tree)

    def _declaration(self, item: Tree[Token]) -> None:
        words = tokens(subtrees(item)[0])
        type_words = [str(t) for t in words if t.type == "TYPE"]
        is_static = any(t == "static" for t in words)
        for declarator in (t for t in subtrees(item) if t.data == "declarator"):
            self._declare(declarator, type_words, is_static)

    def _declare(self, item: Tree[Token], type_words: list[str], is_static: bool) -> None:
        parts, stars = subtrees(item), [t for t in tokens(item) if t.type == "STAR"]
        token = tokens(item)[-1]
        if not self.evaluator.is_plain_name(token):
            return
        name = str(token)
        dimensions = [p for p in parts if p.data == "dimension"]
        initial = next((p for p in parts if p.data != "dimension"), None)
        braces = [p for p in parts if p.data in ("members", "dimension") and has_effect(p)]
        if braces:
            self.evaluator.report(
                rules.CALL_SYNTAX, token, found=Phrase("a call or an assignment inside braces or brackets")
            )
            return
        if initial is not None and not stars:
            self.evaluator.keep_addresses(initial)
        kind = number_type(type_words)
        default: CValue = ZERO if is_static else unknown(NEVER_SET)
        value: CValue
        if stars:
            if initial is not None:
                self.evaluator.give_away(initial)
            value, kind = unknown(Phrase("it is a pointer")), None
        elif any(word.endswith(STRUCT_TYPE) for word in type_words):
            value, kind = self._struct(initial, default) if not dimensions else unknown(NEVER_SET), None
        elif kind is None:
            if initial is not None:
                self.evaluator.expression(initial) if initial.data != "new" else None
            value = unknown(Phrase("its type, {type}, is not read", type=" ".join(type_words)))
        elif dimensions:
            value, kind = self._array(dimensions[0], initial, kind, default), None
        else:
            value = self._scalar(initial, kind, default)
        self.evaluator.variables.declare(name, kind, value)

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
        return (
            self.evaluator.expression(tree)
            if self.evaluator.is_ordered(tree)
            else UnknownValue(reason="", is_reported=True)
        )

    def _array(self, dimension: Tree[Token], initial: Tree[Token] | None, kind: NumberType, default: CValue) -> CValue:
        sizes = [self.evaluator.expression(t) for t in subtrees(dimension)]
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
            return new_struct()
        if initial.data != "members":
            value = self._value_of(initial)
            return self.evaluator.struct_copy(initial, value) if isinstance(value, CStruct) else unknown(NEVER_SET)
        return initial_struct(initial, self.evaluator.expression)

    def _enumeration(self, item: Tree[Token]) -> None:
        following: CValue = ZERO
        for enumerator in subtrees(item):
            token = tokens(enumerator)[0]
            if not self.evaluator.is_plain_name(token):
                return
            given = subtrees(enumerator)
            if given:
                following = self.evaluator.expression(given[0])
                if isinstance(following, CNumber) and not following.is_whole:
                    following = unknown(NEVER_SET)
            self.evaluator.variables.declare(str(token), number_type(["int"]), following)
            following = (
                (binary("+", following, CNumber(value=1.0)) or unknown(NEVER_SET))
                if isinstance(following, CNumber)
                else following
            )

    def _check(self, item: Tree[Token]) -> None:
        """Pass over a check of a return code that is not met after success, and that only leaves or reports."""
        parts, keyword = subtrees(item), tokens(item)[0]
        condition, reactions = parts[0], parts[1:]
        if not self.evaluator.is_ordered(condition):
            return
        value = self.evaluator.expression(condition)
        if isinstance(value, UnknownValue) and value.is_reported:
            return
        if not isinstance(value, CNumber) or not value.is_code or value.value != 0 or not only_leaves(reactions):
            self.evaluator.report(rules.CONTROL_FLOW, keyword, what=control_flow("if"))
            return
        self.checks += 1

    def _wait(self, item: Tree[Token]) -> None:
        """Read a loop that ends with the motion as one question for the status: the program has waited."""
        keyword, parts = tokens(item)[0], subtrees(item)
        is_do = keyword.type == "DO"
        condition, body = (parts[-1], parts[:-1]) if is_do else (parts[0], parts[1:])
        asked = [t for t in map(status_question, body) if t is not None]
        run = run_name(asked[0]) if len(asked) == 1 else None
        harmless = all(status_question(t) is not None or is_harmless(t) for t in body)
        if run is None or not harmless or has_effect(condition) or not self._waits_for(condition, run, is_do):
            self.evaluator.report(rules.CONTROL_FLOW, keyword, what=control_flow(str(keyword)))
            return
        for part in body:
            self._statement(part)

    def _waits_for(self, condition: Tree[Token], run: str, is_do: bool) -> bool:
        """Whether a loop goes on while `run` is 1 and ends when it is 0, and is not left out."""
        variables = self.evaluator.variables
        before = variables.get(run)
        outcomes = []
        for value in (1.0, 0.0):
            variables.values[run] = CNumber(value=value)
            outcomes.append(self.evaluator.expression(condition))
        variables.values[run] = before
        goes_on, ends = outcomes
        if not (isinstance(goes_on, CNumber) and goes_on.value and isinstance(ends, CNumber) and not ends.value):
            return False
        if is_do or (isinstance(before, UnknownValue) and before.reason == sets_it("GT_CrdStatus")):
            return True
        entered = self.evaluator.expression(condition)
        return isinstance(entered, CNumber) and entered.value != 0
