"""What `docs/closed-loop.md` states of closed-loop boards, with the poles of the engine."""

from __future__ import annotations

import math

import numpy as np
import pytest

from taction.netlist_gen.scene.questions import questions
from taction.system.errors import InputError
from tests.netlist_gen.topologies.test_loops import G0, pseudo_matrix, scene, signed, stacked


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
    from taction.verification.design.scaling import find_scaling

    with pytest.raises(InputError, match="tune --over feedback_conductance"):
        find_scaling(scene("pinv"))
