"""Texts that could be read wrongly: each is refused, or is read as C reads it."""

from __future__ import annotations

import time

import pytest

from gusjob.config.machine import Abi
from gusjob.controllers.gus.listing import listing
from gusjob.diagnostics.model import Severity
from gusjob.frontend import check_text, read_listing


def line(x: str) -> str:
    return f"GT_LnXY(1,{x},0,50,2,0,0);"


def read(text: str | bytes, name: str = "x.c") -> tuple[list[str], list[str]]:
    """The calls, and the codes of the errors."""
    source, found = check_text(text if isinstance(text, bytes) else text.encode(), name)
    assert source is not None, found
    stream, diagnostics = read_listing(source)
    errors = [f.rule.code for f in diagnostics if f.severity is Severity.ERROR]
    return "".join(listing(stream)).splitlines(), errors


@pytest.mark.parametrize(
    ("text", "name"),
    [
        # A call or a change in what stands before a member.
        ("b.Add(GT_BufLaserOn(1,0,0)).Add(GT_BufLaserOff(1,0,0));", "x.cpp"),
        ("x = Wrap(GT_BufLaserOff(1,0,0))->code;", "x.c"),
        (f"int i=0; x = p[i++]->v; {line('i')}", "x.c"),
        (f"int i=0; k=p[i++].Run(&j); {line('i')}", "x.cpp"),
        # A macro that hides a variable.
        (f"double pos[8]={{100,2}};\n#define POS pos\nGT_GetCrdPos(1,POS);\n{line('pos[0]')}", "x.c"),
        (f"long v=100;\n#define P &v\nGT_CrdSpace(1,P,0);\n{line('v')}", "x.c"),
        (f"long v=100;\n#define V v\nReadTarget(&V);\n{line('v')}", "x.c"),
        # What a library's call sets through a pointer.
        (f"long v=5; long *p=&v; v=7; GT_CrdSpace(1,p,0); {line('v')}", "x.c"),
        (f"long v=5; long *p=&v; v=7; GT_GetSts(1,p,1,0); {line('v')}", "x.c"),
        (f"long v=5; long *p=&v; v=7; GT_CrdStatus(1,&run,p,0); {line('v')}", "x.c"),
        # A return code that is something else, too.
        ("long rtn;\nrtn = GT_BufDelay(1,5,0);\nGT_GetSts(1,&rtn,1,0);\nif (rtn & 0x200) return 1;\n", "x.c"),
        ("long rtn;\nrtn = GT_BufDelay(1,5,0);\nReadStatus(&rtn);\nif (rtn) return 1;\n", "x.c"),
        ("long n=5;\nobj->n = GT_CrdClear(1,0);\nif (n) return 1;\nn = GT_BufLaserOff(1,0,0);\n", "x.c"),
        (
            f"double rtn0, rtn00=5;\nrtn0 = GT_BufLaserOff(1,0,0);\nrtn00 = GT_BufLaserOff(1,0,0);\n{line('rtn00')}",
            "x.c",
        ),
        # A statement that goes on in the next line, and code after a return.
        ("long x,y=5;\nx = 5\n- y && GT_BufLaserOn(1,0,0);\n", "x.c"),
        ("return 0; return GT_BufLaserOn(1,0,0);", "x.c"),
        # References of C++.
        (f"long v[2]={{100,2}}; int k; k = ReadTarget(v[0]); {line('v[0]')}", "x.cpp"),
        (f"long v=100; int k; k = ReadTarget(v); {line('v')}", "x.C"),
        (f"long v=1; int k; k=Keep(v); v=7; k=Touch(); {line('v')}", "x.cpp"),
        (
            "mc.TCrdPrm a = new mc.TCrdPrm(); a.profile = new short[8]; mc.TCrdPrm b = a; b.profile[0] = 3;"
            "mc.GT_SetCrdPrm(1, ref a);",
            "x.cs",
        ),
        ("mc.TCrdPrm a = new mc.TCrdPrm(); b = a; b.profile[0] = 3; mc.GT_SetCrdPrm(1, ref a);", "x.cs"),
        ("// a\u2028mc.GT_BufLaserOff(1,0,0);\nGT_CrdClear(1,0);", "x.cs"),
        # Several cards as objects.
        ("card1.GT_CrdClear(1,0); card2.GT_CrdClear(1,0);", "x.cpp"),
        ("cards[0].GT_CrdClear(1,0); cards[1].GT_CrdClear(1,0);", "x.cs"),
        # A comment that ends with the byte of a backslash.
        (b"GT_BufLaserOn(1,0,0);\n// caf\xe9\\\nGT_BufLaserOff(1,0,0);\n", "x.c"),
        # Names whose types are not known.
        (f"mode=1; {line('mode > -1')}", "x.c"),
        ("g=1; GT_BufLaserPrfCmd(1,g*0.1f+0.2f,0,0);", "x.c"),
        (f"g=1; {line('g+16777216.0f')}", "x.c"),
        (f"a=1; b=0; {line('a')}", "x.c"),
        # Lines of the preprocessor.
        (f'#define X 5\n#pragma push_macro("X")\n#undef X\n#define X 7\n#pragma pop_macro("X")\n{line("X")}', "x.c"),
        (f"long X=9;\n#define X 5\n#undef X extra\n{line('X')}", "x.c"),
        # Not evaluated in some builds.
        ("Q_ASSERT(GT_BufLaserOff(1,0,0)==0);", "x.cpp"),
        ("DCHECK(GT_BufLaserOff(1,0,0));", "x.cpp"),
        ("Debug.WriteLine(GT_BufLaserOff(1,0,0));", "x.cs"),
        ("rtn = GT_BufLaserOn(1,0,0) <| ; rtn = GT_BufLaserOff(1,0,0) |>;", "x.c"),
        ("laser.Sleep(100);", "x.cpp"),
        ("GT_BufLaserPrfCmd(1,1.000000059604644775390626f,0,0);", "x.c"),
        ("GT_BufLaserPrfCmd(1,1e400,0,0);", "x.c"),
        # In C no argument can be left out.
        ("GT_BufLaserOn(1);", "x.c"),
        # Deep, or strange.
        (line("1" + "+1" * 350), "x.c"),
        (line("!" * 1500 + "1"), "x.c"),
        (line("(int)" * 1500 + "1"), "x.c"),
        ("[1] AT_REST(3)", "x.gts"),
        ("[1] AT_REST(1) = 1", "x.gts"),
        ("[1] GT_CrdClear(1,0) = 0.5", "x.gts"),
    ],
)
def test_it_is_refused(text: str | bytes, name: str) -> None:
    assert read(text, name)[1]


@pytest.mark.parametrize(
    ("text", "name", "calls"),
    [
        ("GT_CrdStatus(1,0L,0L,0);\nGT_CrdClear(1,0);", "x.gts", ["GT_CrdClear(1,0)"]),
        ("[10L] GT_CrdClear(1,0) = 0", "x.gts", ["GT_CrdClear(1,0)"]),
        ("GT_BufLaserPrfCmd(1,1e-05,0,0)", "x.gts", ["GT_BufLaserPrfCmd(1,0.00001,0,0)"]),
        ("GT_BufLaserPrfCmd(1,5E-09,0,0)", "x.gts", ["GT_BufLaserPrfCmd(1,5e-9,0,0)"]),
        (f"short nResult(0);\nlong x(5);\n{line('x')}", "x.cpp", ["GT_LnXY(1,5,0,50,2,0,0)"]),
        ("::GT_CrdClear(1,0);", "x.cpp", ["GT_CrdClear(1,0)"]),
        ('commandhandler("GT_CrdStart", rtn);\nGT_CrdClear(1,0);', "x.c", ["GT_CrdClear(1,0)"]),
        ("GT_CrdStatus(1,&run,NULL,0);\nGT_CrdClear(1,0);", "x.c", ["GT_CrdStatus(1,run,NULL,0)", "GT_CrdClear(1,0)"]),
        ("short rtn; rtn = -1;\nrtn = GT_CrdClear(1,0);\nif (rtn) return;\n", "x.c", ["GT_CrdClear(1,0)"]),
        (
            "mc.TCrdPrm crd = new mc.TCrdPrm();\ncrd.dimension = 2;\ncrd.profile1 = 1;\ncrd.profile2 = 2;\n"
            "crd.originPos2 = 30;\nmc.GT_SetCrdPrm(1, ref crd);\n",
            "x.cs",
            ["GT_SetCrdPrm(1,{2,{1,2,0,0,0,0,0,0},0,0,0,0,{0,30,0,0,0,0,0,0}})"],
        ),
        (
            "TCrdPrm crd={2,{1,2},500,5,10};\n#define C crd\nmemset(&crd,0,sizeof(TCrdPrm));\nGT_SetCrdPrm(1,&crd);\n",
            "x.c",
            ["GT_SetCrdPrm(1,{0,{0,0,0,0,0,0,0,0},0,0,0,0,{0,0,0,0,0,0,0,0}})"],
        ),
    ],
)
def test_it_is_read(text: str, name: str, calls: list[str]) -> None:
    assert read(text, name) == (calls, [])


@pytest.mark.parametrize(
    "text",
    [
        "#define A0 1\n" + "".join(f"#define A{i} (A{i - 1}+A{i - 1})\n" for i in range(1, 18)) + line("A17"),
        "A 1.5, 2.5\n" * 6000,
        "long a0[2]={1,2};\n" * 1000 + "g=1;\n" * 1000,
        "".join(f"word{i} and another\n" for i in range(1500)),
        "1 +\n" * 2000,
        "(" * 5000,
        "{" * 5000,
        "if (\n" * 3000,
        "/*" * 20000,
        '"' * 20001,
    ],
    ids=["macros", "numbers", "arrays", "prose", "sums", "parentheses", "braces", "if", "comments", "quotes"],
)
def test_hostile_texts_take_no_long_time(text: str) -> None:
    start = time.process_time()
    read(text)
    assert time.process_time() - start < 5  # Each takes below 0.6 s on a quiet machine.


def test_a_recording_is_read_without_a_card_whatever_the_profile_says() -> None:
    text = (
        "// recorded by gusjob record, ABI gts-multi\n[0] GT_LnXY(1,1,20000,30,5,0,0) = 0\n// ended with exit code 0\n"
    )
    source, _ = check_text(text.encode(), "calls.gts")
    assert source is not None
    for abi in (None, Abi.GTS_MULTI):
        stream, found = read_listing(source, abi)
        assert found == []
        assert "".join(listing(stream)) == "GT_LnXY(1,1,20000,30,5,0,0)\n"
