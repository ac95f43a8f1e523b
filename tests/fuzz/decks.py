"""Decks of another hand: what `taction check` reads, and what it must not do with them."""

from __future__ import annotations

import math
from pathlib import Path

from hypothesis import strategies as st

import taction
from tests.fuzz.edits import BYTE_EDITS, SHARE, Edit, edited, line, splice, value
from tests.fuzz.target import Target
from tests.support.designer_decks import DECKS as DESIGNERS
from tests.support.paths import ROOT

NAMES = ("wien", "sallen-key-gain", "cccs-mirror", "transimpedance-closed", "gyrator")
LTSPICE = """* C:\\filters\\a.asc
X§U1 0 N1 vcc vee out level.2 Avol=1Meg GBW=10Meg Rin=500Meg
V1 vcc 0 5
R1 N1 in° 10k tol=1
R2 out N1 2k2
C1 out net#1 1µ Rser=10m Lser=1n Rpar=1Meg
B1 net#1 0 V=0.5*v(out)-i(V2)*2+0.1
E1 b 0 POLY(2) in° 0 out 0 0 1 {gain}
L1 b 0 1m Rser=1 Cpar=5p
V2 in° 0 SINE(0 1 1k) AC 1 Rser=50
.param gain=2 C={1/(2*pi*1k)}
.lib UniversalOpamps2.sub
.end
"""
CASES = (
    *("kicad-nested-subckt.cir", "limit-silent.cir", "linearise-model-comma.cir"),
    *("param-override.cir", "pz2-rl.cir", "refused-k-one.net", "refused-level2.net"),
    *("refused-orcad-tc.cir", "refused-tc-pair.cir", "refused-rkm-4r7.cir", "t-abs.cir"),
    *("refused-portnum-ac.cir", "agauss-random.cir", "dot-name.cir", "xeq-IndexError.cir"),
)
BASES = (
    *(DESIGNERS[name].encode() for name in NAMES),
    LTSPICE.encode(),
    *((ROOT / "tests" / "data" / "cases" / name).read_bytes() for name in CASES),
)
VALUES = (
    *("0", "-1", "1e400", "1e-400", "nan", "inf", "1k5", "1meg", "1M", "1u", "1µ", "{gain}"),
    *("{1/0}", "{", "}", "'2*gain'", "{gain", "{pow(10,400)}", "{sqrt(-1)}", "9" * 400, "in"),
    "0 0",
)
LINES = (
    *("", "+", "+ 1k", ".end", ".ends", ".subckt a b c", ".subckt", "X1 in out a", "X1", ")"),
    *("*#shell x", ".control\nshell touch ran\n.endc", ".control", ".endc"),
    *(".include ../secret.inc", ".lib", ".include /dev/zero", ".include deck.cir"),
    *(".lib deck.cir a", ".include .", ".param", ".param x", ".param gain=gain"),
    *(".func f(x) {f(x)}", ".global out", "R9 out out 1k", "C9 out 0 -1n", "R9 out 0 0"),
    *("L9 out 0 1m", "K1 L1 L9 2", "V9 in 0 1", "E9 out 0 out 0 1", "F9 out 0 v9 1"),
    *("B1 out 0 v=2*v(in)", "B1 a b i=v(", "E9 out 0 poly(1) in 0 0 {gain}", "C9 a b 1n Rser="),
    *("X9 a b out opamp aol=0", "X9 a b c d e level.3a phimargin=90", "E9 a 0 in 0 laplace=1/s"),
    *("Q1 out in 0 m", "D1 out 0 m", ".model m d", "B1 out 0 v=v(in)^2", "S1 out 0 in 0 m"),
    *("V9 x 0 PULSE(", "V9 x 0 PWL()", "V9 x 0 PWL(0 0 1)", "I9 0 out SIN(0 1)", "V9 x 0 AC"),
    *(".tran 1n 1u uic", ".ic v(out)=1", ".options temp=-400", ".step param gain 1 2 1"),
    ".temp 1e9",
)
PIECES = (*"0 ({'=,.+x;", "v(", "a=", "{(", "1 ", "+ 1\n", "R9 a 0 1\n", ".include a b\n", "f(")


def repeated(share: float, piece: str, exponent: float) -> Edit:
    """Insert a piece many times, as hostile decks do."""
    return splice(share, 0, (piece * int(10.0**exponent)).encode())


EDITS = (
    st.builds(repeated, SHARE, st.sampled_from(PIECES), st.floats(0.0, 5.0)),
    st.builds(value, SHARE, st.sampled_from(VALUES)),
    st.builds(
        line, SHARE, st.sampled_from(LINES).map(lambda new: lambda old: old + b"\n" + new.encode())
    ),
    st.builds(line, SHARE, st.sampled_from(LINES).map(lambda new: lambda old: new.encode())),
    *BYTE_EDITS,
)


def _examine(content: bytes, folder: Path) -> str:
    inside = folder / "deck"
    inside.mkdir()
    (folder / "secret.inc").write_text("Rsecret in 0 1\n")
    (inside / "deck.cir").write_bytes(content)
    try:
        found = taction.check(inside / "deck.cir", ngspice=False)
    finally:
        assert {each.name for each in folder.rglob("*")} == {"deck", "deck.cir", "secret.inc"}
    assert "Rsecret" not in {knob.name for knob in found.circuit.knobs}
    for pole, bound in zip(found.poles.poles.tolist(), found.poles.errors.tolist(), strict=True):
        assert math.isfinite(abs(pole))
        assert bound >= 0.0
    return "read, " + ("stable" if found.poles.known_stable else "not known to be stable")


DECKS = (Target("decks", edited(BASES, EDITS), _examine),)
