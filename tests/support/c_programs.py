"""Random C texts with GT_ calls, as people's programs have them, to read and to compile.

A text is what a listing file holds: the body of a function (or, rarely, a whole program). Most of it is plain: calls,
declarations, constants, comments and error checks in every usual form. Into it go some *pieces* of c_items.txt: what a
reader can get wrong.
"""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

ITEMS = Path(__file__).with_name("c_items.txt")

_PLACEHOLDER = re.compile(r"\$(body|many|bom|use\(|ff|vt|cr|ls|nel|sp|[cstnkvwzfei])")
_CHARACTERS = {
    "ff": "\f",
    "vt": "\v",
    "cr": "\r",
    "ls": "\u2028",
    "nel": "\u0085",
    "sp": " ",
    "bom": "\ufeff",
}
_TOKEN = re.compile(r'"(?:[^"\\\n]|\\.)*"|\'(?:[^\'\\\n]|\\.)*\'|[A-Za-z_]\w*|\.?\d(?:[eE][+-]|[\w.])*|[^\w\s]')
_DOUBLED = re.compile(r"[-+&|<>=!]=|\+\+|--|&&|\|\||<<=?|>>=?|->|[*/%^]=")
_COMMENT_TEXTS = (
    "switch on",
    "x, y, velocity, acceleration",
    "开激光",
    "GT_LnXY(1,0,0,50,2,0,0);",
    "rtn = GT_CrdClear(1,0); // old",
    "don't",
    'a "quote',
    "if (rtn) return;",
    "50 mm/s = 50 pulse/ms",
    "{ 2; }",
    "#if 0",
    "TODO: x++",
    "// twice",
    "100%",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Program:
    """A text. `pieces`: the names of what was put into it; `whole`: it has its own main."""

    number: int
    text: str
    pieces: tuple[str, ...]
    whole: bool = False

    @property
    def data(self) -> bytes:
        return self.text.encode()


def pieces() -> dict[str, str]:
    """Return the templates of c_items.txt by family and name."""
    found: dict[str, str] = {}
    for part in ITEMS.read_text("utf-8").split("\n@@ ")[1:]:
        name, _, template = part.partition("\n")
        found[name] = template.rstrip("\n")
    return found


PIECES = pieces()
_IN_BODIES = tuple(name for name in PIECES if not name.startswith("whole"))
_WHOLE = tuple(name for name in PIECES if name.startswith("whole"))


def programs(count: int, seed: int) -> Iterator[Program]:
    """Make texts; each depends on the seed and its number only."""
    return (program(number, seed) for number in range(count))


def program(number: int, seed: int) -> Program:
    """Make one text: 40 % without pieces, the others with one to four; every 25th is a whole program."""
    rng = random.Random(f"{seed} {number}")
    if rng.random() < 0.04:
        name = rng.choice(_WHOLE)
        writer = _Writer(rng=rng)
        return Program(number=number, text=writer.fill(PIECES[name]) + "\n", pieces=(name,), whole=True)
    chosen = rng.choices(_IN_BODIES, k=rng.choices((0, 1, 2, 3, 4), (40, 28, 16, 10, 6))[0])
    return with_pieces(number, tuple(chosen), rng)


def with_pieces(number: int, names: tuple[str, ...], rng: random.Random) -> Program:
    """Make a text with some pieces at random positions."""
    writer = _Writer(rng=rng, simple=rng.random() < 0.4)
    statements = [(text, len(writer.whole), len(writer.real)) for text in writer.plain()]
    whole, real = writer.whole, writer.real
    for name in names:
        at = rng.randint(1, len(statements))
        _, wholes, reals = statements[at - 1]
        writer.whole, writer.real = whole[:wholes], real[:reals]  # What is declared above.
        statements.insert(at, (writer.fill(PIECES[name]), wholes, reals))
    text = "\n".join(text for text, _, _ in statements) + rng.choice(("\n", "\n", "\n\n", ""))
    if rng.random() < 0.06:
        text = text.replace("\n", "\r\n")
    if rng.random() < 0.02:
        text = "\ufeff" + text
    return Program(number=number, text=text, pieces=names)


def piece_alone(name: str, seed: int) -> str:
    """Return the text of one piece with nothing around it."""
    return _Writer(rng=random.Random(f"{seed} {name}")).fill(PIECES[name]) + "\n"


def _words(text: str) -> tuple[str, ...]:
    return tuple(text.split())


_LITERALS = _words("0 1 2 3 7 10 100 255 5000 0x1F 010 017 3u 5L 2UL 4ULL 'a' '\\n' 10000 65535")
_REALS = _words("0.5 2.5 1e3 .25 5. 0.1f 1.5F 1e-1 0.1 3.0")
_WHOLE_OPERATORS = _words("+ - * / % << >> & | ^")
_TRUTH_OPERATORS = _words("<< >> & | ^ && || == != < > <= >=")
_REAL_OPERATORS = _words("+ - * / < > == && ||")
_CASTS = ("short", "char", "unsigned char", "long", "unsigned", "int", "unsigned short", "signed char", "_Bool")
_CONDITIONS = ("1", "0", "fast", "more", "thin", "rtn", "!rtn", "rtn == 0", "fast && !more", "2 > 1", "thin || more")
_WHOLE_TYPES = ("long", "int", "short", "const long", "static long", "unsigned long", "long int")
_REAL_TYPES = ("double", "const double", "static const double")


@dataclass(slots=True)
class _Writer:
    """Writes the statements of one text."""

    rng: random.Random
    names: int = 0
    whole: list[str] = field(default_factory=list)
    """Expressions of whole numbers that may be a coordinate: names of variables and macros."""
    real: list[str] = field(default_factory=list)
    long_array: str = ""
    double_array: str = ""
    struct: str = ""
    simple: bool = False
    """Calls with plain numbers, in lines of their own."""
    wild: bool = False
    """Tokens on any line, with comments between them."""

    # Names and values.

    def name(self, stem: str = "") -> str:
        self.names += 1
        return f"{stem or self.rng.choice(('pos', 'x', 'power', 'len', 'val', 'a', 'Step', 'tmp_'))}{self.names}"

    def number(self) -> str:
        return str(self.rng.choice((self.rng.randint(1, 90), self.rng.randint(100, 30000))))

    def coordinate(self) -> str:
        """A whole number in a usual form."""
        n = self.number()
        if self.simple:
            return n
        if self.whole and self.rng.random() < 0.25:
            return self.rng.choice(self.whole)
        forms = (n, n, n, n, f"-{n}", f"-{n}", f"{n}*10", f"(long){n}", f"{n} + 5", f"-({n})", f"{n}L", "1<<8")
        more = (f"0x{int(n):X}", f"(10 - {n})", f"7/2*{n}", f"{n}.0", f"(long)({n}.7)", "0", "0", "+5", f"{n}%7")
        return self.rng.choice(forms + more)

    def amount(self) -> str:
        """A positive number in a usual form."""
        n = str(self.rng.randint(1, 90))
        if self.simple:
            return n
        if self.real and self.rng.random() < 0.25:
            return self.rng.choice(self.real)
        forms = (n, n, n, n, f"{n}.5", f"{n}.0", f"{n}.", ".5", f"{n}e1", f"(double){n}", f"{n}*0.5", f"{n}/4.0")
        return self.rng.choice((*forms, f"(double){n}/2", "100/8", "1.0/3", f"({n} + 0.25)", "25.0f"))

    def integer(self, depth: int = 3) -> str:
        """A random expression of whole numbers."""
        rng = self.rng
        if depth == 0 or rng.random() < 0.2:
            return rng.choice((*_LITERALS, *self.whole[:4]))
        a, b = self.integer(depth - 1), self.integer(depth - 1)
        match rng.randrange(10):
            case 0 | 1 | 2 | 3:
                return f"{a} {rng.choice('+-*/%+-*')} {b}"
            case 4:
                return f"{a} {rng.choice(_TRUTH_OPERATORS)} {b}"
            case 5:
                return f"({rng.choice(_CASTS)})({a})"
            case 6:
                return f"({a} {rng.choice(_WHOLE_OPERATORS)} {b})"
            case 7:
                return f"{rng.choice('-~!+')}({a})"
            case 8:
                return f"({a} ? {b} : {self.integer(depth - 1)})"
            case _:
                return f"({rng.choice(_CASTS)}){rng.choice(_LITERALS)}"

    def expression(self, depth: int = 3) -> str:
        """A random expression of any numbers."""
        rng = self.rng
        if depth == 0 or rng.random() < 0.15:
            return rng.choice((*_REALS, *_LITERALS, *self.real[:3]))
        a, b = self.expression(depth - 1), self.expression(depth - 1)
        match rng.randrange(8):
            case 0 | 1 | 2:
                return f"{a} {rng.choice('+-*/')} {b}"
            case 3:
                return f"({a} {rng.choice(_REAL_OPERATORS)} {b})"
            case 4:
                return f"({rng.choice((*_CASTS, 'float', 'double', 'float'))})({a})"
            case 5:
                return f"({self.integer(2)})"
            case 6:
                return f"-({a})"
            case _:
                return f"({a} ? {b} : {self.expression(depth - 1)})"

    # Calls.

    def call(self) -> str:
        """One call with all its arguments, in one line."""
        rng = self.rng
        crd = rng.choice(("1", "1", "1", "1", "2", "1" if self.simple else "(short)1"))
        fifo, channel = rng.choice(("0", "0", "0", "1")), rng.choice(("0", "0", "1"))
        x, y, a, b = self.coordinate(), self.coordinate(), self.amount(), self.amount()
        speed = f"{a}, {b}, {rng.choice(('0', '0', '0.0', self.amount()))}, {fifo}"
        n = str(rng.randint(1, 900))
        calls = (
            *(f"GT_LnXY({crd}, {x}, {y}, {speed})",) * 6,
            f"GT_ArcXYC({crd}, {x}, {y}, {n}, {rng.choice((a, '-' + n))}, {rng.choice('01')}, {speed})",
            f"GT_ArcXYR({crd}, {x}, {y}, {n}.5, {rng.choice('01')}, {speed})",
            f"GT_BufDelay({crd}, {n}, {fifo})",
            *(f"GT_BufLaserOn({crd}, {fifo}, {channel})",) * 2,
            *(f"GT_BufLaserOff({crd}, {fifo}, {channel})",) * 2,
            *(f"GT_BufLaserPrfCmd({crd}, {a}, {fifo}, {channel})",) * 2,
            f"GT_BufLaserPrfFollow({crd}, {a}, {rng.randint(0, 9)}, {rng.randint(10, 90)}, {fifo}, {channel})",
            f"GT_LaserPrfCmd({a}, {channel})",
            f"GT_LaserOutFrq({a}, {channel})",
            f"GT_SetLevelDelay({n}, {rng.randint(0, 500)}, {channel})",
            f"GT_SetAxisMode({rng.choice('78')}, 1)",
            f"GT_LaserPowerMode({rng.choice('0123')}, {rng.randint(9, 10)}, {rng.choice(('0', '1.5'))}, {channel})",
            f"GT_SetPulseWidth({n}, {channel})",
            f"GT_SetHSIOOpt({rng.choice('01')}, {channel})",
            f"GT_EnaFPK({n}, {rng.randint(0, 50)}, 5, {channel})",
            f"GT_DisFPK({channel})",
            f"GT_CrdClear({crd}, {fifo})",
            f"GT_CrdStart({crd}, 0)",
            f"GT_SetWaitPulse(1, {a}, {b}, {channel})",
            f"GT_SetPreVltg(1, {b}, {channel})",
        )
        return rng.choice(calls)

    def use(self, value: str) -> str:
        """A call that tells a value."""
        forms = ("GT_BufLaserPrfCmd(1, {}, 0, 0)", "GT_BufLaserPrfCmd(1, {}, 0, 0)", "GT_LnXY(1, 10, 20, {}, 2, 0, 0)")
        return self.rng.choice(forms).format(value)

    def statement(self) -> str:
        """A call as a statement, in one of the usual forms."""
        rng, c = self.rng, self.call()
        name = c.partition("(")[0]
        if self.simple:
            return rng.choice(("{};", "rtn = {};")).format(c)
        forms: tuple[Callable[[], str], ...] = (
            *(lambda: f"{c};",) * 4,
            *(lambda: f"rtn = {c};",) * 4,
            lambda: f"rtn |= {c};",
            lambda: f"rtn += {c};",
            lambda: f"(void){c};",
            lambda: f"CHECK({c});",
            lambda: f'commandhandler("{name}", {c});',
            lambda: f"short {self.name('r')} = {c};",
            lambda: f"rtn = {c};\n{self.check()}",
            lambda: f"if ({c}) return{rng.choice(('', ' -1', ' 1'))};",
            lambda: f'if ((rtn = {c}) != 0) {{ printf("{name}: %d\\n", rtn); return; }}',
            lambda: f"if ({c} != 0)\n    return;",
            lambda: f"{c}; {self.call()};",
        )
        return rng.choice(forms)()

    def check(self) -> str:
        """A check of rtn that only leaves."""
        forms = (
            "if (rtn) return;",
            "if (rtn) return rtn;",
            "if (rtn != 0) return -1;",
            'if (rtn != 0)\n{\n    printf("error %d\\n", rtn);\n    return;\n}',
            "if (0 != rtn) { return rtn; }",
            "if (rtn)\n    return 1;",
            'if (rtn) { printf("error; if (x) "); return; }',
        )
        return self.rng.choice(forms)

    # The plain text.

    def plain(self) -> Iterator[str]:
        """The statements of a text without pieces; the first makes rtn."""
        rng = self.rng
        if self.simple:
            yield ""
            for _ in range(rng.randint(1, 6)):
                yield self.statement()
            return
        self.wild = rng.random() < 0.25
        first = rng.choice(("", "short rtn = 0;", "short rtn = 0;", "short rtn;\nrtn = GT_Open(0, 1);"))
        yield rng.choice(("", "// a listing\n", "/* a\n   listing */\n", '#include "gts.h"\n')) + first
        yield from map(self.dressed, self.plain_middle())
        if rng.random() < 0.06:
            yield rng.choice(("return;", "return 0;", "return rtn;"))

    def plain_middle(self) -> Iterator[str]:
        """The statements between the beginning and the end."""
        rng = self.rng
        for _ in range(rng.randint(0, 5)):
            yield self.declaration()
        for _ in range(rng.randint(0, 3)):
            yield self.statement()
        yield from self.coordinate_system()
        for _ in range(rng.randint(2, 12)):
            yield self.statement()
            if rng.random() < 0.12:
                yield self.harmless()
            if self.whole and rng.random() < 0.1:
                yield self.assignment()
        if rng.random() < 0.5:
            yield "rtn = GT_CrdStart(1, 0);"
            yield self.poll()

    def declaration(self) -> str:
        """A constant or a variable that calls use."""
        rng, name, n = self.rng, self.name(), self.number()
        match rng.randrange(9):
            case 0 | 1:
                self.whole.append(name)
                return f"{rng.choice(_WHOLE_TYPES)} {name} = {rng.choice((n, n, n + '*1', '5'))};"
            case 2:
                self.real.append(name)
                return f"{rng.choice(_REAL_TYPES)} {name} = {rng.choice((n + '.5', n, '2.5'))};"
            case 3:
                self.whole.append(name)
                return f"#define {name.upper()} {n}\nlong {name} = {name.upper()};"
            case 4:
                self.whole.append(name.upper())
                return f"#define {name.upper()} {rng.choice((n, f'({n})', f'{n} // x', f'{n} /* x */', '(10*50)'))}"
            case 5:
                self.whole += [f"{name}A", f"{name}B"]
                return f"enum {{ {name}A = {rng.randint(0, 50)}, {name}B }};"
            case 6:
                self.long_array = name
                self.whole += [f"{name}[0]", f"{name}[3]"]
                return f"long {name}[4] = {{{n}, 20{rng.choice((', 30, 40', ', 0', ''))}}};"
            case 7:
                self.double_array = name
                return f"double {name}[4];\n" + "\n".join(f"{name}[{i}] = {i + 1}.5;" for i in range(4))
            case _:
                self.whole.append(name)
                other = self.name()
                return f"long {name}, {other};\n{name} = {n};\n{other} = 5;"

    def coordinate_system(self) -> list[str]:
        """Set up the coordinate system, and the calls that take arrays."""
        rng, statements = self.rng, []
        if rng.random() < 0.7:
            name = self.struct = rng.choice(("crdPrm", "CrdPrm", self.name("prm")))
            fields = ["dimension = 2", f"synVelMax = {self.amount()}", f"synAccMax = {self.amount()}"]
            fields += rng.sample(("evenTime = 50", "profile[0] = 1", "profile[1] = 2", "setOriginFlag = 1"), 3)
            fields += [f"originPos[{rng.randrange(3)}] = {rng.randint(0, 999)}"]
            clear = rng.choice((f"{name}, 0, sizeof({name})", f"{name}, 0, sizeof(TCrdPrm)"))
            start = rng.choice((f"TCrdPrm {name};\nmemset(&{clear});", f"TCrdPrm {name} = {{0}};"))
            if rng.random() < 0.2:
                start = f"TCrdPrm {name} = {{2, {{1, 2}}, {self.amount()}, 5, 10, 1, {{0}}}};"
            lines = "\n".join([start, *(f"{name}.{f};" for f in fields)])
            statements.append(f"{lines}\nrtn = GT_SetCrdPrm(1, &{name});")
        if self.long_array and self.double_array:
            arrays = f"{self.long_array}, {self.double_array}"
            statements.append(f"rtn = GT_SetLaserDisMode(1, 0, {arrays}, 0);")
            statements.append(f"GT_SetLaserDisRatio({self.double_array}, 10, 90.5, 0);")
        statements.append("rtn = GT_CrdClear(1, 0);")
        return statements

    def harmless(self) -> str:
        """A statement without effect on the calls."""
        forms = (
            'printf("GT_LnXY(1,0,0,50,2,0,0);\\n");',
            "Sleep(10);",
            'Log("rtn = %d /* ", rtn);',
            "GT_ClrSts(1, 8);",
            ";",
            'printf("a" "b // c");',
            "rtn = GT_AxisOn(1);",
        )
        return self.rng.choice(forms)

    def assignment(self) -> str:
        """An assignment to a variable that calls use, or a new one."""
        name = self.name()
        old, n = self.rng.choice(self.whole), self.number()
        self.whole.append(name)
        return self.rng.choice((f"long {name} = {n};", f"long {name} = {old} + 100;", f"int {name};\n{name} = {n};"))

    def poll(self) -> str:
        """Wait for the end of the motion, as the vendor's examples do."""
        call = "rtn = GT_CrdStatus(1, &run, &segment, 0);"
        forms = (
            *(call,) * 12,
            f"do\n{{\n    {call}\n}} while (run == 1);",
            f"do {{ {call} }} while (run);",
            f"do {{ Sleep(10); {call} }} while (1 == run);",
            f"do {call}\nwhile (run == 1 && rtn == 0);",
        )
        return self.rng.choice(forms)

    # Layout.

    def dressed(self, statement: str) -> str:
        """A statement with comments and in a random layout."""
        rng = self.rng
        if self.wild and "#" not in statement and "//" not in statement and "/*" not in statement:
            statement = self.spread(statement)
        if rng.random() < 0.15:
            statement += rng.choice((" // {}", "  /* {} */", "\t//{}", " /*{}*/")).format(rng.choice(_COMMENT_TEXTS))
        if rng.random() < 0.08:
            statement = (
                rng.choice(("// {}\n", "/* {} */\n", "/*\n {}\n*/\n", "/* {} */ ")).format(rng.choice(_COMMENT_TEXTS))
                + statement
            )
        if rng.random() < 0.1:
            statement = rng.choice(("", "\t", "    ")) + statement.replace("\n", "\n\t")
        return statement

    def spread(self, statement: str) -> str:
        """The same tokens with other white space, comments and spliced lines between them."""
        rng, tokens = self.rng, _tokens(statement)
        parts: list[str] = []
        for before, token in zip(["", *tokens], tokens, strict=False):
            needed = bool(re.match(r"[\w.]", token) and re.search(r"[\w.]$", before)) or bool(
                before and re.match(r"[-+*/&|<>=!.%^]", token) and re.search(r"[-+*/&|<>=!.%^]$", before)
            )
            choice = rng.random()
            if before == "/":
                parts.append(" ")
            if choice < 0.06:
                parts.append(rng.choice(("\n", "\n\t", " \\\n", "\n\n", "\t", "  ")))
            elif choice < 0.10:
                parts.append(rng.choice(("/* {} */", " /*{}*/ ", " // {}\n")).format(rng.choice(_COMMENT_TEXTS)))
            elif needed or choice < 0.4:
                parts.append(" ")
            parts.append(token)
        return "".join(parts)

    # Pieces.

    def fill(self, template: str) -> str:
        """A piece with its placeholders filled in."""
        known: dict[str, str] = {}
        done: list[str] = []
        at = 0
        while (found := _PLACEHOLDER.search(template, at)) is not None:
            done.append(template[at : found.start()])
            at = found.end()
            if found[1] == "use(":
                start, depth = at, 1
                while depth:
                    depth += {"(": 1, ")": -1}.get(template[at], 0)
                    at += 1
                value = template[start : at - 1]
                done.append(self.use(_PLACEHOLDER.sub(lambda m: self.one(m[1], known), value)))
            else:
                done.append(self.one(found[1], known))
        return "".join([*done, template[at:]])

    def one(self, what: str, known: dict[str, str]) -> str:
        """One placeholder."""
        if what in _CHARACTERS:
            return _CHARACTERS[what]
        if what in "vwzf":
            return known.setdefault(what, self.name())
        match what:
            case "c":
                return self.call()
            case "s":
                return self.rng.choice((f"{self.call()};", f"rtn = {self.call()};", f"CHECK({self.call()});"))
            case "body":
                return " ".join(f"{self.call()};" for _ in range(self.rng.randint(1, 3)))
            case "many":
                return "\n".join(f"GT_LnXY(1,{self.number()},{i},50,2,0,0);" for i in range(260))
            case "t":
                return self.rng.choice(_CONDITIONS)
            case "n":
                return self.number()
            case "k":
                return str(self.rng.randint(2, 4))
            case "e":
                return self.expression()
            case _:
                return self.integer()


def _tokens(statement: str) -> list[str]:
    """The tokens of a statement without comments and directives."""
    tokens: list[str] = []
    for token in _TOKEN.findall(statement):
        if tokens and _DOUBLED.fullmatch(tokens[-1] + token) and tokens[-1] + token in statement:
            tokens[-1] += token
        else:
            tokens.append(token)
    return tokens
