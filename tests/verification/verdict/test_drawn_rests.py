"""What 95 % of the built boards keep, against boards drawn and solved from the text of the deck."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.analysis import OperatingPoint
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from taction.system.array_types import Floats
from taction.verification.report.documents.verdict import verdict_document
from taction.verification.report.views.answer_view import answer_text, yield_text
from taction.verification.verdict.verify import verify
from tests.support.making import make_scene

T, STRAIN, LAMBDA = np.array([[1.0, 0.3], [-0.2, 0.8]]), np.array([0.6, -0.4]), 0.1
DESIGN: dict[str, Any] = {
    "capacitance": "1nF",
    "lambda": LAMBDA,
    "gain": "100kohm",
    "unit_conductance": "10uS",
    "opamp": {"base": "ua741", "input_errors": "typical"},
}
BOARDS, SIGMAS = 3000, 4.0
OFFSET, BIAS, SCATTER, CURRENT = 6e-3 / 3.0, 80e-9, (500e-9 - 80e-9) / 3.0, 200e-9 / 3.0
REJECTION = 10.0 ** (-70.0 / 20.0) / 3.0
"""Of a uA741: typical bias current and largest sizes of its sheet, three standard deviations."""


def expanded(text: str) -> list[tuple[str, list[str], float]]:
    """Return name, nodes and value of every card; those of an op-amp are named ``Xv_1.Vos``."""
    cells: dict[str, tuple[list[str], list[list[str]]]] = {}
    board: list[list[str]] = []
    inside = board
    for words in map(str.split, text.splitlines()):
        if words and words[0] == ".subckt":
            inside = []
            cells[words[1]] = words[2:], inside
        elif words and words[0] == ".ends":
            inside = board
        elif words and words[0][0] in "RCIVGEX":
            inside.append(words)
    found = [(words[0], words[1:-1], float(words[-1])) for words in board if words[0][0] != "X"]
    for name, *nodes, model in (words for words in board if words[0][0] == "X"):
        ports, body = cells[model]
        outer = dict(zip(ports, nodes, strict=True)) | {"0": "0"}
        found += [
            (f"{name}.{own}", [outer.get(n, f"{name}.{n}") for n in inner], float(value))
            for own, *inner, value in body
        ]
    return found


def drawn(cards: list[tuple[str, list[str], float]], uniform: bool) -> list[Floats]:
    """Return the values of every card (BOARDS,): resistors within 1 %, op-amps by their sheet."""
    random, rows = np.random.default_rng(40), list[Floats]()
    opamps = {name.partition(".")[0] for name, _, _ in cards if "." in name}
    bias = {each: BIAS + SCATTER * random.standard_normal(BOARDS) for each in sorted(opamps)}
    for name, _, value in cards:
        opamp, _, part = name.partition(".")
        z = random.standard_normal(BOARDS)
        own = {"Vos": OFFSET * z, "Ecn": 0.5 * REJECTION * z}
        if part == "Ibn":
            rows.append(bias[opamp] - 0.5 * CURRENT * z)
        elif not part and name[0] == "R":
            size = random.uniform(-1.0, 1.0, BOARDS) if uniform else z / 3.0
            rows.append(value * np.exp(size * math.log1p(0.01)))
        else:
            rows.append(own.get(part, np.full(BOARDS, value)))
    return rows


def at_rest(cards: list[tuple[str, list[str], float]], values: list[Floats]) -> Floats:
    """Return v_1 and v_2 of every board, V, (BOARDS, 2), by modified nodal analysis."""
    nodes = sorted({n for _, own, _ in cards for n in own} - {"0"})
    branches = [name for name, _, _ in cards if name.rpartition(".")[2][0] in "VE"]
    place = {each: k for k, each in enumerate([*nodes, *branches])}
    place["0"] = size = len(place)  # ground: a row that is struck out
    A, b = np.zeros((BOARDS, size + 1, size + 1)), np.zeros((BOARDS, size + 1))
    for (name, own, _), value in zip(cards, values, strict=True):
        kind, at, j = name.rpartition(".")[2][0], [place[n] for n in own], place.get(name, size)
        if kind in "RG":
            (p, q), (r, s) = at[:2], at[-2:]
            each = 1.0 / value if kind == "R" else value
            for row, column, sign in ((p, r, 1), (p, s, -1), (q, r, -1), (q, s, 1)):
                A[:, row, column] += sign * each
        elif kind == "I":
            b[:, at[0]] -= value
            b[:, at[1]] += value
        elif kind in "VE":
            for node, sign in zip(at[:2], (1.0, -1.0), strict=True):
                A[:, node, j] += sign
                A[:, j, node] += sign
            if kind == "V":
                b[:, j] += value
            else:
                A[:, j, at[2]] -= value
                A[:, j, at[3]] += value
    found = np.linalg.solve(A[:, :size, :size], b[:, :size, None])[:, :, 0]
    return found[:, [place["v_1"], place["v_2"]]]


@pytest.mark.parametrize("distribution", ["normal", "uniform"])
@pytest.mark.parametrize("tolerance", [0.02, 0.05])
def test_the_sentence_about_the_yield_is_true_of_drawn_boards(
    distribution: str, tolerance: float
) -> None:
    """Both numbers that a verdict says of built boards, in the unit of its check."""
    tolerances = {"resistor": 0.01, "opamp_gain": 0.0, "distribution": distribution}
    problem = {"kind": "matrix", "matrix": T.tolist(), "strain": STRAIN.tolist()}
    checks = {"steady_state": {"tolerance": tolerance}, "settling_time": {"band": 0.5}}
    scene = make_scene(
        problem=problem, design=DESIGN, tolerances=tolerances, checks=checks,
        analysis={"engine": "statespace"},
    )  # fmt: skip
    verdict = verify(scene)
    cards = expanded(write_deck(synthesise(scene), OperatingPoint()).text)
    target = np.linalg.solve(T.T @ T + LAMBDA * np.eye(2), T.T @ STRAIN)
    away = np.abs(at_rest(cards, drawn(cards, distribution == "uniform")) - target).max(axis=1)
    share = float((away <= tolerance * np.abs(target).max()).mean())
    said = re.search(r"at most ([\d.]+) % of built boards pass: the others rest beyond ([\d.]+) %",
                     yield_text(verdict.answer))  # fmt: skip
    assert said is not None
    assert float(said[2]) == 100.0 * tolerance
    found, built = verdict_document(verdict)["answer"], verdict.answer.built
    assert built is not None
    assert (found["boards"], found["yield_at_most"]) == (0.95, built.most)
    assert found["built_error"] == pytest.approx(built.distance / verdict.answer.unit)
    assert built.error < 0.1 * built.distance
    beside = SIGMAS * math.sqrt(share * (1.0 - share) / BOARDS)
    assert -beside <= float(said[1]) / 100.0 - share < 0.1 + beside
    wide = re.search(r"95 % of built boards within ([\d.]+) %", answer_text(verdict.answer))
    assert wide is not None
    beside = SIGMAS * math.sqrt(0.95 * 0.05 / BOARDS)
    low, high = np.quantile(away / np.abs(target).max(), [0.95 - beside, 0.95 + beside])
    assert low < float(wide[1]) / 100.0 < 1.1 * high  # it rounds up, and has a bound on its error
