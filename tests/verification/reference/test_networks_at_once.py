"""Networks without capacitors: their solvers against exact arithmetic, and what they refuse."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import InputError, SolverError
from taction.verification.reference.ideal_answer import (
    energy_rise,
    ideal_answer,
    ideal_network,
)
from taction.verification.reference.networks import solve_square
from taction.verification.reference.problem import Problem
from tests.support.making import make_scene, matrix_problem


def exact(T: NDArray[np.float64], eps: NDArray[np.float64]) -> list[Fraction]:
    """Gauss's elimination in rational numbers: no rounding at all."""
    pairs = zip(T.tolist(), eps.tolist(), strict=True)
    rows = [[Fraction(value) for value in (*row, load)] for row, load in pairs]
    N = len(rows)
    for k in range(N):
        pivot = next(i for i in range(k, N) if rows[i][k])
        rows[k], rows[pivot] = rows[pivot], rows[k]
        rows[k] = [v / rows[k][k] for v in rows[k]]
        for i in range(N):
            if i != k:
                rows[i] = [a - rows[i][k] * b for a, b in zip(rows[i], rows[k], strict=True)]
    return [row[-1] for row in rows]


def hilbert(N: int) -> NDArray[np.float64]:
    n = np.arange(1.0, N + 1)
    return 1.0 / (n[:, None] + n[None, :] - 1.0)


@pytest.mark.parametrize("N", [1, 3, 6, 8])
def test_lu_with_refinement_has_the_exact_solution(N: int) -> None:
    """At N = 8 the condition number is 1.5e10."""
    T, eps = hilbert(N), np.linspace(1.0, -2.0, N)
    found, wanted = solve_square(Problem(T, eps, 0.0)), exact(T, eps)
    off = max(abs(Fraction(u) - w) for u, w in zip(found.u.tolist(), wanted, strict=True))
    assert float(off) <= found.error_bound
    assert found.trusted
    assert found.error_bound <= 1e-12 * float(max(map(abs, wanted)))
    assert found.certificate <= found.bound


@pytest.mark.parametrize("T", [np.ones((2, 2)), hilbert(14)])
def test_a_singular_matrix_is_not_trusted(T: NDArray[np.float64]) -> None:
    found = solve_square(Problem(T, np.ones(len(T)), 0.0))
    assert not found.trusted
    assert "singular to double precision" in found.reason


def test_the_size_of_the_numbers_does_not_matter() -> None:
    T, eps = hilbert(4), np.array([1.0, 2.0, 0.0, -1.0])
    for scale in (1e-14, 1e14):
        found = solve_square(Problem(scale * T, eps, 0.0))
        assert found.trusted
        assert found.u * scale == pytest.approx([float(v) for v in exact(T, eps)], rel=1e-9)


def test_inv_needs_a_square_matrix() -> None:
    with pytest.raises(SolverError, match="square"):
        solve_square(Problem(np.ones((3, 2)), np.ones(3), 0.0))


def scene(topology: str, **design: Any) -> Scene:
    return make_scene(design={"topology": topology, "unit_voltage": 2.0, **design})


@pytest.mark.parametrize("topology", ["inv", "pinv", "ridge"])
def test_the_network_of_a_topology_is_at_rest_at_once(topology: str) -> None:
    T, eps = np.array([[2.0, 1.0], [0.5, 1.0]]), np.array([1.0, -1.0])
    lam = 0.4 if topology == "ridge" else 0.0
    one = scene(topology, **({"lambda": lam} if lam else {}))
    network = ideal_network(matrix_problem(T, eps), one)
    assert (network.lam, network.RC, network.flows) == (lam, 0.0, False)
    answer = ideal_answer(network, one)
    wanted = 2.0 * np.linalg.solve(T.T @ T + lam * np.eye(2), T.T @ eps)
    assert answer.target == pytest.approx(wanted, rel=1e-12)
    assert (answer.settling_time, answer.problem) == (0.0, "")
    assert energy_rise(network, np.array([0.0, 1.0]), np.zeros((2, 2))) is None


def test_ridge_needs_a_number_for_lambda() -> None:
    with pytest.raises(InputError, match=r"design\.lambda"):
        ideal_network(matrix_problem(np.eye(2), np.ones(2)), scene("ridge"))
