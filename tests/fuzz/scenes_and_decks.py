"""Scenes, and decks of another hand: what is read, and what must not be done with it."""

from __future__ import annotations

import json
import math
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

import taction
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.scene import Scene, load_scene
from taction.system.documents import plain
from taction.verification.reference.lambda_rule import resolve_lambda
from taction.verification.report.documents.verdict import verdict_document
from taction.verification.report.renderers.terminal import page_text
from taction.verification.report.views.verdict_view import view
from taction.verification.studies.regression.regress import baseline_text, observe
from taction.verification.verdict.board_files import deck_of
from taction.verification.verdict.verify import Verdict, verify
from tests.fuzz.edits import (
    BYTE_EDITS,
    LINE_EDIT,
    SCALE_EDIT,
    SHARE,
    VALUE_EDIT,
    Target,
    edited,
    edits,
    line,
    splice,
    value,
)
from tests.support.designer_decks import DECKS as DESIGNERS
from tests.support.entries import FAST
from tests.support.paths import ROOT, SCENES

BASES = [file.read_bytes() for file in sorted(SCENES.glob("*.toml"))]
BASES += [FAST.format(limit="1s", capacitance="10pF", opamp="ua741").encode()] * 6
EDITS = (SCALE_EDIT, SCALE_EDIT, SCALE_EDIT, VALUE_EDIT, LINE_EDIT, *BYTE_EDITS[:4])
MATRIX = SCENES / "custom-matrix"
MOST_ENTRIES = 3000  # of T: larger boards are parsed, not built
RUNS_COMMANDS = re.compile(
    r"^\s*(?:\.(?:control|include|lib)|\*#|\*ng_script|a\d)", re.MULTILINE | re.I
)
TINY = 24  # entries of T of a board that is simulated


def examine(content: bytes, folder: Path) -> str:
    """Run the stages of a scene as far as its size allows."""
    file = folder / "scene.toml"
    file.write_bytes(content)
    (folder / "custom-matrix").symlink_to(MATRIX)
    scene = load_scene(file)
    _check_round_trip(scene, folder / "again.toml")
    channels = getattr(scene.problem, "channels", 4)
    size = channels * (getattr(scene.problem, "sensors", 4) or channels)
    if size > MOST_ENTRIES:
        return "accepted, not built"
    problem = make_problem(scene)
    scene = resolve_lambda(scene)
    if problem.matrix.size > TINY:
        designed = synthesise(scene, problem)
        deck = deck_of(scene)
        circuit = deck.circuit  # whose op-amps may have their limits
        assert not RUNS_COMMANDS.search(deck.text), deck.text
        assert write_deck(circuit, deck.analysis).text == deck.text
        plain_one = replace(circuit, models=designed.models)
        assert write_deck(plain_one, deck.analysis) == write_deck(designed, deck.analysis)
        return "built"
    verdict = verify(scene.with_engine("statespace"), problem=problem)
    _check_reports(verdict)
    if verdict.outcome.value == "pass" and scene.design.amplifier == "linear":
        _check_solution(verdict, problem)
    shutil.rmtree(folder / "custom-matrix", ignore_errors=True)
    return f"verified: {verdict.outcome.value}"


def _check_round_trip(scene: Scene, file: Path) -> None:
    """Fail unless the scene's values, written as TOML, are the same scene."""
    values = scene.model_dump(mode="json", by_alias=True, exclude_none=True)
    file.write_text(_table(values), encoding="utf-8")
    again = load_scene(file)
    same = again.model_dump(mode="json") == scene.model_dump(mode="json")  # arrays as lists
    assert same, file.read_text(encoding="utf-8")


def _table(values: dict[str, Any]) -> str:
    return "\n".join(f"{json.dumps(key)} = {_text(item)}" for key, item in values.items())


def _text(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(k)} = {_text(v)}" for k, v in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_text, value)) + "]"
    if isinstance(value, float):
        return repr(value)
    return json.dumps(value, ensure_ascii=True).replace("\x7f", "\\u007f")


def _check_reports(verdict: Verdict) -> None:
    """Fail unless the verdict can be printed, and written as JSON and as a baseline."""
    assert verdict.outcome.value.upper() in page_text(view(verdict))
    assert json.dumps(plain(verdict_document(verdict)), allow_nan=False)
    text = baseline_text({"scene.toml": observe(verdict)})
    assert json.loads(text)["scenes"]["scene.toml"]["outcome"] == verdict.outcome.value


def _check_solution(verdict: Verdict, problem: InverseProblem) -> None:
    """Fail unless a linear board that passes has the solution of the stacked least squares."""
    design, T = verdict.scene.design, problem.matrix
    volts, G0 = design.unit_voltage, design.unit_conductance
    R = 1.786e6 if design.resistance is None else design.resistance
    lam = 1.0 / (R * design.gain * G0**2) if design.lam is None else design.lam
    assert isinstance(lam, float)
    channels = T.shape[1]
    left = np.vstack([T, np.sqrt(lam) * np.eye(channels)])
    right = np.concatenate([problem.strain, np.zeros(channels)])
    u = np.linalg.lstsq(left, right, rcond=None)[0] * volts
    amplitude = float(np.abs(u).max())
    largest = float(np.abs(verdict.steady.values - u).max())
    assert largest <= 1.01 * verdict.scene.checks.steady_state.tolerance * amplitude


SCENE = Target("scenes", edited(BASES, EDITS, most=2), examine)

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
DECK_BASES = (
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


def repeated(content: bytes, share: float, piece: str, exponent: float) -> bytes:
    """Insert a piece many times, as hostile decks do."""
    return splice(content, share, 0, (piece * int(10.0**exponent)).encode())


def _below(new: str) -> Callable[[bytes], bytes]:
    return lambda old: old + b"\n" + new.encode()


def _instead(new: str) -> Callable[[bytes], bytes]:
    return lambda old: new.encode()


DECK_EDITS = (
    edits(repeated, SHARE, st.sampled_from(PIECES), st.floats(0.0, 5.0)),
    edits(value, SHARE, st.sampled_from(VALUES)),
    edits(line, SHARE, st.sampled_from([*map(_below, LINES), *map(_instead, LINES)])),
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


DECKS = (Target("decks", edited(DECK_BASES, DECK_EDITS), _examine),)
