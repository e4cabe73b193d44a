"""Queries on the trees of listing.lark: what a statement is, what it calls, and which names it uses."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from lark import Token, Tree
from msgspec import Struct

from gusjob.frontend.parse.grammar import subtrees, tokens
from gusjob.patterns import lazy_pattern

_LIBRARY = lazy_pattern(r"GTN?_\w+|AT_REST")
HARMLESS_FUNCTIONS = frozenset({
    "printf", "fprintf", "puts", "fputs", "putchar", "fflush", "perror", "getchar", "clock", "sleep", "usleep",
    "nanosleep", "Sleep", "OutputDebugString", "MessageBox", "AfxMessageBox", "_getch", "getch", "GetTickCount",
    "commandhandler", "Commandhandler", "CommandHandler",
})  # fmt: skip
"""Functions of the C library, Windows and the vendor's examples that make no call themselves and change no variable."""
_OWNERS = ("std", "System", "Threading", "Thread")
"""Namespaces and classes in which these are what they seem."""
_STREAMS = ("cout", "cerr", "clog")


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


def qualifier(call: Tree[Token]) -> str:
    """Return the object of a call's function, without blanks: mc, card[1]; '' for none. A namespace is none."""
    callee = call.children[0]
    if not isinstance(callee, Tree) or callee.data != "member" or tokens(callee)[0].type == "SCOPE":
        return ""
    return "".join(str(t) for t in subtrees(callee)[0].scan_values(lambda t: isinstance(t, Token)))


def is_harmless_call(call: Tree[Token]) -> bool:
    """Whether a call is one of a function that makes no call itself and changes no variable."""
    owners = re.findall(r"\w+", qualifier(call))
    return str(called_name(call)) in HARMLESS_FUNCTIONS and all(owner in _OWNERS for owner in owners)


def depth_of(tree: Tree[Token]) -> int:
    """Return the number of levels of a tree."""
    depth, level = 0, [tree]
    while level:
        depth += 1
        level = [part for parent in level for part in subtrees(parent)]
    return depth


def names_in(tree: Tree[Token]) -> list[str]:
    """Return the names in a tree, in their order."""
    return [str(t) for t in tree.scan_values(lambda t: isinstance(t, Token) and t.type == "NAME")]


def without_void(tree: Tree[Token]) -> Tree[Token]:
    """Strip the cast of `(void)GT_LnXY(...)`."""
    if tree.data == "cast" and [str(t) for t in tokens(subtrees(tree)[0])] == ["void"]:
        return subtrees(tree)[1]
    return tree


def status_question(tree: Tree[Token]) -> Tree[Token] | None:
    """Return the call of a statement that asks for the status: GT_CrdStatus(...), rtn = GT_CrdStatus(...)."""
    tree = without_void(tree)
    if tree.data == "assign" and subtrees(tree)[0].data == "name" and tokens(tree)[0] == "=":
        tree = subtrees(tree)[1]
    return tree if tree.data == "call" and called_name(tree) == "GT_CrdStatus" else None


def run_name(call: Tree[Token]) -> str | None:
    """Return the variable that tells whether the motion runs: the first that GT_CrdStatus sets."""
    given = [variable_of(arg) for arg in subtrees(call)[1:] if arg.data in ("address", "by_reference")]
    return given[0] if given else None


def is_harmless(tree: Tree[Token]) -> bool:
    """Whether a statement only reports or lets time pass."""
    tree = without_void(tree)
    if tree.data != "call":
        return is_output(tree) and not has_effect(tree)
    return is_harmless_call(tree) and not any(map(has_effect, subtrees(tree)[1:]))


def is_output(tree: Tree[Token]) -> bool:
    """Whether an expression is the output of C++: std::cout << a << b."""
    while tree.data == "binary" and tokens(tree)[0] == "<<":
        tree = subtrees(tree)[0]
        if tree.data in ("name", "member") and tokens(tree)[-1] in _STREAMS:
            return True
    return False


def in_chain(tree: Tree[Token], effect: Tree[Token], name: str) -> bool:
    """Whether an assignment is in a chain, a = b = 5, whose targets all differ."""
    targets: list[str] = []
    while tree.data == "assign":
        target, source = subtrees(tree)
        targets += names_in(target)
        if tree is effect:
            used = names_in(source)
            return targets.count(name) == 1 and (source.data == "assign" or not used or name not in targets[:-1])
        tree = source
    return False


def _called_names(tree: Tree[Token]) -> Iterator[str]:
    for call in tree.find_data("call"):
        name = called_name(call)
        yield "" if name is None else str(name)


def has_call(tree: Tree[Token]) -> bool:
    """Whether an expression has a call of the library, or one that may be one: a macro, a computed one."""
    return any(not name or is_library_name(name) for name in _called_names(tree))


def has_effect(tree: Tree[Token]) -> bool:
    """Whether evaluating an expression does anything."""
    return any(t.data in ("assign", "step") for t in tree.iter_subtrees()) or any(True for _ in _called_names(tree))


def only_leaves(reactions: Sequence[Tree[Token]]) -> bool:
    """Whether a reaction to an error ends the program or the function, or only reports."""
    left = [r for r in reactions if r.children]
    if any(isinstance(r.children[0], Token) for r in left[-1:]):
        return True
    return bool(left) and all(is_harmless(subtrees(r)[0]) for r in left)


class LoggedCall(Struct, frozen=True, kw_only=True):
    """A call that stands alone in its line. `set_name`: the variable that gets its code; `time`: a log's time."""

    name: Token
    args: list[Tree[Token]]
    set_name: str | None = None
    time: Token | None = None


def logged_call(item: Tree[Token]) -> LoggedCall | None:
    """Take a line with one call apart: rtn = GT_LnXY(...), or [time] GT_LnXY(...) = 0."""
    if item.data not in ("statement", "stamped"):
        return None
    time = tokens(item)[0] if item.data == "stamped" else None
    tree, set_name = subtrees(item)[0], None
    if tree.data == "assign":
        left, right = subtrees(tree)
        if tokens(tree)[0] != "=":
            return None
        if left.data == "name" and right.data == "call":
            set_name, tree = str(tokens(left)[0]), right
        elif left.data == "call" and right.data == "number":
            tree = left
        else:
            return None
    if tree.data != "call" or subtrees(tree)[0].data != "name":
        return None
    name = tokens(subtrees(tree)[0])[0]
    if not is_library_name(str(name)):
        return None
    return LoggedCall(name=name, args=subtrees(tree)[1:], set_name=set_name, time=time)


def number_token(tree: Tree[Token]) -> Token | None:
    """Return a plain number with its sign as one token; None for anything else."""
    if tree.data == "number":
        return tokens(tree)[0]
    if tree.data != "unary" or subtrees(tree)[0].data != "number":
        return None
    sign, number = tokens(tree)[0], tokens(subtrees(tree)[0])[0]
    if sign.type != "SIGN" or sign.end_pos != number.start_pos:
        return None
    return Token("NUMBER", f"{sign}{number}", start_pos=sign.start_pos, line=sign.line, column=sign.column)


def only_begins(item: Tree[Token]) -> bool:
    """Whether an item at the end of a line is a place alone: its assignment, or its call, is on the next line."""
    inner = subtrees(item)[0] if item.data == "statement" else None
    while inner is not None and inner.data in ("cast", "assign"):
        if inner.data == "assign":
            last = subtrees(inner)[-1]
            return last.data == "name" and is_library_name(str(tokens(last)[0]))
        inner = subtrees(inner)[-1]
    return inner is not None and inner.data in ("name", "index", "member")


def variable_of(arg: Tree[Token]) -> str | None:
    """Return the variable that an argument names or is a part of: run, &run, &pos[1], ref run; None for none."""
    tree = subtrees(arg)[0] if arg.data in ("address", "by_reference") else arg
    while tree.data in ("index", "member"):
        tree = subtrees(tree)[0]
    return str(tokens(tree)[0]) if tree.data == "name" else None
