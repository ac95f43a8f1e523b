"""Closed formulas of closed-loop boards, against state matrices that are written by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.questions import questions
from taction.netlist_gen.topologies.frame.table import TOPOLOGIES
from taction.system.errors import InputError
from taction.verification.engines.statespace.linearised.board import LinearBoard
from tests.netlist_gen.topologies.test_loops import (
    A0,
    G0,
    GF,
    LAM,
    ONE_POLE,
    WAYS,
    WT,
    board,
    inverse_matrix,
    lagged,
    loads,
    pseudo_matrix,
    scene,
    signed,
    two_poles,
)


def law(circuit: Circuit, name: str) -> float:
    found = {each.name: each.value for each in TOPOLOGIES[circuit.topology].laws(circuit)}
    return found[name]


@pytest.mark.parametrize("way", WAYS)
def test_the_rightmost_pole_of_inv(way: str, rng: np.random.Generator) -> None:
    T = signed(rng, 5, 5)
    modes = np.linalg.eigvals(inverse_matrix(G0 * T, way, 0.0))
    circuit = board(T, np.ones(5), "inv", way, opamp=ONE_POLE)
    found = law(circuit, "rightmost_pole")
    assert found == pytest.approx(WT * modes.real.max() - WT / A0, rel=1e-9)
    poles = LinearBoard(circuit).state_space.modes.poles
    assert found == pytest.approx(poles.real.max(), rel=1e-9)


@pytest.mark.parametrize("topology", ["inv", "pinv"])
def test_the_least_second_pole_is_an_edge(topology: str, rng: np.random.Generator) -> None:
    """The matrix with a lag t2 behind every op-amp is stable above it, and not below."""
    if topology == "inv":
        T = 0.6 * np.eye(4) + 0.5 * np.roll(np.eye(4), 1, axis=1) + 0.001
        A = -loads(T, 1) @ T
        gain = 1e12
    else:
        T = rng.uniform(0.2, 1.0, (6, 4))
        A, gain = pseudo_matrix(G0 * T, GF), 1e12
    opamp = {**ONE_POLE, "dc_gain": gain}
    least = law(board(T, np.ones(len(T)), topology, opamp=opamp), "second_pole")
    above, below = (lagged(A, 1.0 / (math.tau * f)) for f in (1.001 * least, 0.999 * least))
    assert above < 0.0 < below + WT / A0


def test_the_least_gf_is_near_that_of_the_state_matrix(rng: np.random.Generator) -> None:
    """Mean loads in the place of all loads: within a tenth."""
    X, t2 = G0 * rng.uniform(0.2, 1.0, (6, 4)), 8e-9
    low, high = 1e-3 * G0, 1e3 * G0
    for _ in range(60):
        gf = math.sqrt(low * high)
        low, high = (gf, high) if lagged(pseudo_matrix(X, gf), t2) > 0.0 else (low, gf)
    circuit = board(X / G0, np.ones(6), "pinv", opamp=two_poles(t2))
    assert law(circuit, "least_gf") == pytest.approx(high, rel=0.1)


def test_the_fastest_gf_is_near_the_fastest_board(rng: np.random.Generator) -> None:
    X = G0 * rng.uniform(0.2, 1.0, (6, 4))
    over = np.geomspace(1e-2 * G0, 1e2 * G0, 801)
    rates = [np.linalg.eigvals(pseudo_matrix(X, gf)).real.max() for gf in over.tolist()]
    circuit = board(X / G0, np.ones(6), "pinv", opamp=ONE_POLE)
    best = law(circuit, "fastest_gf")
    there = float(np.linalg.eigvals(pseudo_matrix(X, best)).real.max())
    assert there < 0.5 * min(rates)  # at least half as fast as the fastest board
    assert min(rates) < 10.0 * rates[0]  # far from it a board is at least ten times slower


def test_ridge_counts_its_own_rows(rng: np.random.Generator) -> None:
    """Two rows beside T: with them sigma_min is at least sqrt(lambda) G0."""
    T = np.array([[1.0, 1.0], [1.0, 1.0], [1.0, 1.0 + 1e-9]])
    circuits = (board(T, np.ones(3), name, opamp=ONE_POLE) for name in ("pinv", "ridge"))
    pair = [law(circuit, "fastest_gf") for circuit in circuits]
    assert pair[0] < 1e-6 * pair[1]


@pytest.mark.parametrize("topology", ["pinv", "ridge"])
def test_the_loads_are_a_lyapunov_matrix(topology: str, rng: np.random.Generator) -> None:
    """Without gf the two arrays cancel, so what is left is the least load over A0."""
    T = signed(rng, 6, 4)
    circuit = board(T, np.ones(6), topology, "differential", opamp=ONE_POLE)
    own = math.sqrt(LAM) if topology == "ridge" else 0.0
    sides = [np.maximum(sign * T, 0.0) for sign in (1.0, -1.0)]
    rows = np.maximum(*(side.sum(axis=1) for side in sides))
    columns = np.maximum(
        *(side.sum(axis=0) + own * k for k, side in zip((1, 0), sides, strict=True))
    )
    least = G0 * min([*rows, *columns, *([own] if own else [])])
    assert law(circuit, "stored_energy") == pytest.approx(-least / A0, rel=1e-6)


def test_inverters_in_the_loop_leave_the_loads_without_a_proof(rng: np.random.Generator) -> None:
    circuit = board(signed(rng, 6, 4), np.ones(6), "pinv", "inverters", opamp=ONE_POLE)
    assert law(circuit, "stored_energy") > 0.0


def test_op_amps_without_a_pole_have_no_laws() -> None:
    circuit = board(np.eye(2), np.ones(2), "inv", opamp={"base": "ideal"})
    assert TOPOLOGIES["inv"].laws(circuit) == ()


def test_topologies_with_capacitors_have_none() -> None:
    one = scene("integrator", **{"lambda": 0.1})
    assert TOPOLOGIES["integrator"].laws(synthesise(one)) == ()


def test_a_key_without_effect_is_a_question() -> None:
    text = " ".join(questions(scene("inv", gain="1kohm")))
    assert "design.gain has no effect with topology = 'inv'" in text
    text = " ".join(questions(scene("integrator", **{"lambda": 0.1})))
    assert "design.feedback_conductance has no effect" in text


def test_scalings_of_a_board_without_a_gain_are_refused() -> None:
    from taction.verification.design.scaling import scale

    with pytest.raises(InputError, match="tune --over feedback_conductance"):
        scale(scene("pinv"))
