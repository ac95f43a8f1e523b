"""A scene's lambda by a rule."""

from __future__ import annotations

import numpy as np
import pytest

from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import parse_scene
from taction.system.errors import InputError
from taction.verification.reference.ideal_answer import resolve_lambda


def scene(rule: object, variance: float = 1e-3, channels: int = 9):
    problem = {
        "kind": "tactile",
        "channels": channels,
        "span": 3.0,
        "noise": {"variance": variance, "seed": 3},
    }
    return parse_scene({"problem": problem, "design": {"lambda": rule}}, "made.toml")


def tikhonov(inverse, lam):
    """Return the minimiser by the normal equations, the textbook's way."""
    T = inverse.matrix
    return np.linalg.solve(T.T @ T + lam * np.eye(T.shape[1]), T.T @ inverse.strain)


def test_a_number_stays_as_it_is():
    given = scene(0.25)
    assert resolve_lambda(given) is given
    assert given.lambda_rule == ""


def test_discrepancy_meets_the_noise():
    chosen = resolve_lambda(scene("discrepancy"))
    inverse = make_problem(chosen)
    residual = inverse.matrix @ tikhonov(inverse, chosen.design.lam) - inverse.strain
    assert float(residual @ residual) == pytest.approx(1.3 * 9 * 1e-3, rel=1e-4)
    assert chosen.lambda_rule == "discrepancy"


def test_mse_is_the_least_of_a_scan():
    chosen = resolve_lambda(scene("mse"))
    inverse = make_problem(chosen)
    grid = np.geomspace(1e-6, 1e2, 4001)
    errors = [np.sum((tikhonov(inverse, lam) - inverse.stress) ** 2) for lam in grid]
    assert chosen.design.lam == pytest.approx(grid[int(np.argmin(errors))], rel=5e-3)


def test_discrepancy_without_noise_is_refused_by_name():
    with pytest.raises(InputError, match=r"design\.lambda = 'discrepancy'.*noise\.variance"):
        resolve_lambda(scene("discrepancy", variance=0.0))


def test_an_unknown_rule_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match=r"design\.lambda = 'guess'.*'gcv'"):
        scene("guess")
