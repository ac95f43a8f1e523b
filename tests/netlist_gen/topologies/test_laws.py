"""What `docs/closed-loop.md` states of closed-loop boards, with the poles of the engine."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.board.circuit import GROUND, Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.board.wired_arrays import joined_resistors
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.questions import questions
from taction.system.errors import InputError
from taction.verification.stability.poles import poles
from tests.netlist_gen.topologies.test_loops import (
    A0,
    G0,
    ONE_POLE,
    WAYS,
    WT,
    pseudo_matrix,
    scene,
    signed,
    stacked,
)


def nodal(circuit: Circuit) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return Y of the inputs, F to the outputs, and E: ``Y v_in = -F v``, ``E v_in = v+ - v-``."""
    outputs = {cell.output: place for place, cell in enumerate(circuit.opamps)}
    held = {GROUND, *outputs, *(source.node for source in circuit.voltages)}
    joined = [each for each in joined_resistors(circuit) if math.isfinite(each[2])]
    nodes = dict.fromkeys(node for a, b, _ in joined for node in (a, b) if node not in held)
    free = {node: place for place, node in enumerate(nodes)}
    Y, F = np.zeros((len(free), len(free))), np.zeros((len(free), len(outputs)))
    for a, b, ohms in joined:
        for node, other in ((a, b), (b, a)):
            if node not in free:
                continue
            Y[free[node], free[node]] += 1.0 / ohms
            if other in free:
                Y[free[node], free[other]] -= 1.0 / ohms
            elif other in outputs:
                F[free[node], outputs[other]] -= 1.0 / ohms
    E = np.zeros((len(outputs), len(free)))
    for row, cell in enumerate(circuit.opamps):
        for node, sign in ((cell.noninverting, 1.0), (cell.inverting, -1.0)):
            if node in free:
                E[row, free[node]] += sign
    return Y, F, E


@pytest.mark.parametrize("topology", ["inv", "pinv", "ridge"])
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("wires", [{}, {"word_line": 30.0, "sense": 5.0}])
def test_the_poles_are_those_of_the_conductances(topology: str, way: str, wires: Any) -> None:
    """``v' = wt S v - wp v``, inputs over outputs S; a second pole needs a > wt t2 b²."""
    circuit = synthesise(with_values(scene(topology, way, opamp=ONE_POLE), {"wires": wires}))
    Y, F, E = nodal(circuit)
    modes = np.linalg.eigvals(E @ np.linalg.solve(Y, F))
    found = poles(circuit)
    allowed = 2.0 * found.resolution + 1e-9 * float(abs(found.poles).max())
    least = float(modes.real.min())
    assert found.rightmost.real == pytest.approx(-WT * (least + 1.0 / A0), abs=allowed)
    ringing = modes[np.abs(modes.imag) > 1e-9 * np.abs(modes)]
    if least > 0.0 and len(ringing):
        edge = float((ringing.real / (WT * ringing.imag**2)).min())  # t2, A0 without limit
        for factor, stable in ((0.999, True), (1.001, False)):
            (model,) = circuit.models.values()
            model = replace(model, dc_gain=1e12, second_pole=1.0 / (math.tau * factor * edge))
            other = replace(circuit, models=dict.fromkeys(circuit.models, model))
            assert poles(other).known_stable is stable


def test_the_fastest_gf_is_near_the_fastest_board(rng: np.random.Generator) -> None:
    """gf = 2 sigma_min sqrt(c/d), with the mean inverse loads c and d = 1/(r + gf)."""
    X = G0 * rng.uniform(0.2, 1.0, (6, 4))
    over = np.geomspace(1e-2 * G0, 1e2 * G0, 801)
    rates = [np.linalg.eigvals(pseudo_matrix(X, gf)).real.max() for gf in over.tolist()]
    far = np.linalg.svd(X, compute_uv=False)[-1] ** 2 / X.sum(axis=0).mean()
    best = 2.0 * far + 2.0 * math.sqrt(far * far + far * X.sum(axis=1).mean())
    there = float(np.linalg.eigvals(pseudo_matrix(X, best)).real.max())
    assert there < 0.5 * min(rates)  # at least half as fast as the fastest board
    assert min(rates) < 10.0 * rates[0]  # far from it a board is at least ten times slower


@pytest.mark.parametrize("topology", ["pinv", "ridge"])
def test_the_loads_are_a_lyapunov_matrix(topology: str, rng: np.random.Generator) -> None:
    """With P of the loads and K = P A, ``(K + K')/2`` is nowhere above 0, whatever gf is."""
    T = signed(rng, 6, 4)
    X = G0 * (stacked(T) if topology == "ridge" else T)
    for gf in (1e-9, 1e-5, 1e-1):
        A = pseudo_matrix(X, gf)
        plus, minus = np.maximum(X, 0.0), np.maximum(-X, 0.0)
        loads = (np.maximum(plus.sum(axis=axis), minus.sum(axis=axis)) for axis in (1, 0))
        rows, columns = loads
        K = np.append(rows + gf, columns)[:, None] * A
        assert np.linalg.eigvalsh(0.5 * (K + K.T)).max() <= 1e-12 * np.abs(K).max()


def test_a_key_without_effect_is_a_question() -> None:
    text = " ".join(questions(scene("inv", gain="1kohm")))
    assert "design.gain has no effect with topology = 'inv'" in text
    text = " ".join(questions(scene("integrator", **{"lambda": 0.1})))
    assert "design.feedback_conductance has no effect" in text


def test_scalings_of_a_board_without_a_gain_are_refused() -> None:
    from taction.verification.design.scaling import scale

    with pytest.raises(InputError, match="tune --over feedback_conductance"):
        scale(scene("pinv"))
