"""Boards of one loop: parts, answers and poles, against formulas that share no code with them.

The state matrices are written by hand from Kirchhoff's laws: an op-amp has
``v' = wt (v+ - v-) - wp v``, and the voltage at an input is the mean of all that ends there,
weighted with the conductances. A second pole is a lag behind it. The last tests are the laws of
`docs/closed-loop.md`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.design import DevicesTable
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import InputError
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from tests.support.boards import outputs_at_rest
from tests.support.making import NEAR_IDEAL, make_scene, matrix_problem

Matrix = NDArray[np.float64]
WAYS = ("inverters", "differential", "offset")
G0, GF, GI, GBW, A0 = 1e-5, 2e-5, 1e-4, 1e7, 1e5
WT = math.tau * GBW
ONE_POLE = {"base": "ideal", "dc_gain": A0, "gbw": GBW, "output_resistance": 0.0}
LAM = 0.3


def scene(topology: str, way: str = "inverters", **design: Any) -> Scene:
    lam = {"lambda": LAM} if topology == "ridge" else {}
    table = {
        "topology": topology, "negative_entries": way, "unit_conductance": G0,
        "stray_capacitance": 0, "inverter_resistance": 1 / GI, **lam,
        **({} if topology == "inv" else {"feedback_conductance": GF}), **design,
    }  # fmt: skip
    return make_scene(design=table)


def board(T: Matrix, eps: Matrix, *about: Any, **design: Any) -> Circuit:
    return synthesise(scene(*about, **design), matrix_problem(T, eps))


def signed(rng: np.random.Generator, M: int, N: int) -> Matrix:
    return np.asarray(np.eye(M, N) + 0.25 * rng.standard_normal((M, N)))


def stacked(T: Matrix) -> Matrix:
    return np.vstack([T, math.sqrt(LAM) * np.eye(T.shape[1])])


@pytest.mark.parametrize("topology", ["inv", "pinv", "ridge"])
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("strain_input", ["current", "voltage"])
def test_all_ways_rest_at_the_answer(
    topology: str, way: str, strain_input: str, rng: np.random.Generator
) -> None:
    M, N = (4, 4) if topology == "inv" else (6, 4)
    T, eps = signed(rng, M, N), rng.standard_normal(M)
    circuit = board(T, eps, topology, way, opamp=NEAR_IDEAL, strain_input=strain_input)
    A, b = (stacked(T), np.append(eps, np.zeros(N))) if topology == "ridge" else (T, eps)
    assert outputs_at_rest(circuit) == pytest.approx(np.linalg.lstsq(A, b, rcond=None)[0], abs=1e-9)
    assert circuit.realised == pytest.approx(T, abs=1e-14)


@pytest.mark.parametrize("topology", ["inv", "pinv"])
def test_inputs_are_loaded_alike_by_devices_with_levels(
    topology: str, rng: np.random.Generator
) -> None:
    """At rest both inputs have one voltage: only if they are loaded alike, it does not count."""
    T, eps = signed(rng, 4, 4), rng.standard_normal(4)
    asked = scene(topology, "differential", opamp=NEAR_IDEAL)
    devices = {"least_conductance": 1e-7, "most_conductance": 3e-5, "cell_levels": 16}
    asked = asked.model_copy(update={"devices": DevicesTable.model_validate(devices)})
    circuit = synthesise(asked, matrix_problem(T, eps))
    plus, minus = (1.0 / matrix.ohms for matrix in circuit.matrices[:2])
    set_to = (plus - minus) / G0
    assert np.abs(set_to - T).max() > 0.02
    assert outputs_at_rest(circuit) == pytest.approx(np.linalg.solve(set_to, eps), abs=1e-8)


@pytest.mark.parametrize(
    ("topology", "way", "opamps", "resistors"),
    [
        # 16 resistors of the matrix; what is besides: inverters, loads to ground, column and sum
        ("inv", "inverters", 4 + 3, 2 * 3),
        ("inv", "differential", 4, 3),
        ("inv", "offset", 4 + 1, 4 + 5),
        ("pinv", "inverters", 8 + 3 + 3, 4 + 2 * 6),
        ("pinv", "differential", 8, 4 + 3 + 3 + 3),
        ("pinv", "offset", 8 + 2, 4 + 2 * 4 + 2 * 5),
        ("ridge", "inverters", 12 + 3 + 3, 4 + 2 * 6 + 3 * 4),
        ("ridge", "differential", 12, 4 + 3 + 3 + 3 + 3 * 4),
        ("ridge", "offset", 12 + 2, 4 + 2 * 4 + 2 * 5 + 3 * 4),
    ],
)
def test_price_of_negative_entries(topology: str, way: str, opamps: int, resistors: int) -> None:
    """Row 4 and column 4 have no negative entry: they need no inverter and no load."""
    T = np.array([[2, -1, 0, 1], [-1, 3, -1, 1], [0, -1, 2, 1], [1, 1, 1, 3.0]])
    circuit = board(T, np.ones(4), topology, way)
    assert len(circuit.opamps) == opamps
    assert len(circuit.resistors) == resistors
    assert circuit.capacitors == ()


def loads(G: Matrix, axis: int, more: float = 0.0) -> Matrix:
    return np.asarray(np.diag(1.0 / (np.abs(G).sum(axis=axis) + more)))


def poles_of(A: Matrix) -> Matrix:
    return np.asarray(np.sort_complex(np.linalg.eigvals(WT * A - WT / A0 * np.eye(len(A)))))


def found_poles(circuit: Circuit) -> Matrix:
    return np.asarray(np.sort_complex(LinearBoard(circuit).state_space.modes.poles))


def inverse_matrix(G: Matrix, way: str, gin: float) -> Matrix:
    """The state matrix of INV over wt: of V, then of the inverters, or of that of the sum."""
    N = len(G)
    plus, minus = np.maximum(G, 0.0), np.maximum(-G, 0.0)
    if way == "inverters":
        D, used = loads(G, 1, gin), minus.any(axis=0)
        half = np.eye(N)[used] / 2.0
        return -np.block([[D @ plus, D @ minus[:, used]], [half, half[:, used]]])
    if way == "differential":
        heavier = np.maximum(plus.sum(axis=1) + gin, minus.sum(axis=1))
        return -np.diag(1.0 / heavier) @ G
    b, one = minus.max(), np.ones((N, 1))
    D = np.diag(1.0 / ((G + b).sum(axis=1) + b + gin))
    last = np.hstack([one.T, [[1.0]]]) / (N + 1)
    return -np.block([[np.hstack([D @ (G + b), b * D @ one])], [last]])


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("strain_input", ["current", "voltage"])
def test_the_poles_of_inv(way: str, strain_input: str, rng: np.random.Generator) -> None:
    T = signed(rng, 5, 5)
    circuit = board(T, np.ones(5), "inv", way, opamp=ONE_POLE, strain_input=strain_input)
    gin = G0 if strain_input == "voltage" else 0.0
    expected = poles_of(inverse_matrix(G0 * T, way, gin))
    assert found_poles(circuit) == pytest.approx(expected, rel=1e-9)


def pseudo_matrix(X: Matrix, gf: float) -> Matrix:
    """The state matrix of PINV over wt, of w and V; negative entries at the other inputs."""
    M, N = X.shape
    plus, minus = np.maximum(X, 0.0), np.maximum(-X, 0.0)
    rows = np.maximum(plus.sum(axis=1), minus.sum(axis=1)) + gf
    columns = np.maximum(plus.sum(axis=0), minus.sum(axis=0))
    bracket = np.block([[-gf * np.eye(M), -X], [X.T, np.zeros((N, N))]])
    return np.asarray(np.diag(1.0 / np.append(rows, columns)) @ bracket)


@pytest.mark.parametrize("topology", ["pinv", "ridge"])
def test_the_poles_of_pinv_and_ridge(topology: str, rng: np.random.Generator) -> None:
    T = signed(rng, 5, 3)
    circuit = board(T, np.ones(5), topology, "differential", opamp=ONE_POLE)
    X = G0 * (stacked(T) if topology == "ridge" else T)
    assert found_poles(circuit) == pytest.approx(poles_of(pseudo_matrix(X, GF)), rel=1e-9)


def lagged(A: Matrix, t2: float) -> float:
    """Return the rightmost pole of ``q' = wt A o - wp q``, ``t2 o' = q - o``."""
    n = len(A)
    E = np.eye(n)
    whole = np.block([[-WT / A0 * E, WT * A], [E / t2, -E / t2]])
    return float(np.linalg.eigvals(whole).real.max())


def two_poles(t2: float) -> dict[str, Any]:
    return {**ONE_POLE, "second_pole": 1.0 / (math.tau * t2)}


def test_inv_is_stable_while_each_mode_outruns_the_second_pole() -> None:
    """A mode ``a + j b`` of the loaded matrix is stable if and only if a > wt t2 b²."""
    T = 0.6 * np.eye(4) + 0.5 * np.roll(np.eye(4), 1, axis=1) + 0.001
    modes = np.linalg.eigvals(loads(T, 1) @ T)
    limit = min(mu.real / (WT * mu.imag**2) for mu in modes if abs(mu.imag) > 1e-12)
    for factor in (0.99, 1.01):
        opamp = {**two_poles(factor * limit), "dc_gain": 1e12}
        rightmost = found_poles(board(T, np.ones(4), "inv", opamp=opamp)).real.max()
        assert bool(rightmost > 0.0) is (factor > 1.0)


def test_pinv_with_one_pole_is_never_unstable(rng: np.random.Generator) -> None:
    """A Lyapunov matrix proves it for every T of full column rank and every gf."""
    for _ in range(40):
        N = int(rng.integers(1, 5))
        M = int(rng.integers(N, 8))
        T = rng.standard_normal((M, N)) * 10 ** rng.uniform(-1, 1, (M, 1))
        gf = G0 * 10 ** rng.uniform(-2, 2)
        circuit = board(
            T, np.ones(M), "pinv", "differential", opamp=ONE_POLE, feedback_conductance=gf
        )
        assert found_poles(circuit).real.max() < 0.0


def test_the_onset_of_pinv_is_that_of_the_state_matrix(rng: np.random.Generator) -> None:
    from taction.verification.stability.margin import stable_values

    X, t2 = G0 * rng.uniform(0.2, 1.0, (6, 4)), 8e-9
    low, high = 1e-3 * G0, 1e3 * G0
    assert lagged(pseudo_matrix(X, low), t2) > 0.0 > lagged(pseudo_matrix(X, high), t2)
    while high / low > 1.0 + 1e-12:
        middle = math.sqrt(low * high)
        unstable = lagged(pseudo_matrix(X, middle), t2) > 0.0
        low, high = (middle, high) if unstable else (low, middle)
    circuit = board(
        X / G0, np.ones(6), "pinv", opamp=two_poles(t2), feedback_conductance=3.0 * high
    )
    found = stable_values(circuit, "gf")
    assert max(edge.value for edge in found.edges) == pytest.approx(high, rel=1e-6)


@pytest.mark.parametrize(
    ("topology", "T", "design", "text"),
    [
        ("inv", np.ones((3, 2)), {}, "needs as many rows as columns"),
        ("inv", np.diag([1.0, 0.0]), {}, "row 2 of T is all zeros"),
        ("pinv", np.ones((2, 3)), {}, "or topology 'ridge'"),
        ("pinv", np.array([[1.0, 0.0], [2.0, 0.0]]), {}, "column 2 of T is all zeros"),
        ("pinv", np.eye(2), {"lambda": 0.1}, r"design\.lambda = 0\.1: .*no regularisation"),
        ("inv", np.eye(2), {"lambda": 0.1}, "expected no lambda"),
        ("ridge", np.eye(2), {"lambda": None}, "a number above zero, or the name of a rule"),
        ("inv", np.eye(2), {"amplifier": "exponential"}, "expected 'linear'"),
    ],
)
def test_what_cannot_be_built_is_refused(
    topology: str, T: Matrix, design: dict[str, Any], text: str
) -> None:
    with pytest.raises(InputError, match=text):
        board(T, np.ones(len(T)), topology, **design)


def test_a_row_without_entries_and_pruned_entries_leave_parts_out() -> None:
    T = np.array([[1.0, 0.004], [0.0, 0.0], [0.2, 1.0]])
    circuit = board(T, np.ones(3), "pinv", prune=0.01)
    assert {cell.name for cell in circuit.opamps} == {"c_1", "c_3", "v_1", "v_2"}
    left = {each.what for each in circuit.omissions}
    assert {"2 pruned matrix resistors", "1 constraint nodes"} <= left
    assert circuit.realised == pytest.approx(np.where(np.abs(T) < 0.01, 0.0, T))
