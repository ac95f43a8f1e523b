"""Rules for lambda: their derivatives, how near they come to the best, and a scene's own rule."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import parse_scene
from taction.system.errors import InputError
from taction.verification.reference.lambda_choice import (
    RULES,
    LambdaChoice,
    LambdaTrial,
    choose,
)
from taction.verification.reference.lambda_rule import resolve_lambda
from taction.verification.reference.problem import Problem
from taction.verification.reference.solve import solve
from tests.support.oracle import kernel

SIGMA = 0.1


def noisy(seed: int, regulariser: str = "linear") -> tuple[Problem, np.ndarray]:
    y = np.linspace(-3.0, 3.0, 25)
    truth = 2.0 * np.sqrt(np.maximum(1.0 - y * y, 0.0))
    T = kernel(y, y, 1.0)
    eps = T @ truth + SIGMA * np.random.default_rng(seed).standard_normal(25)
    bias = regulariser == "exponential"
    return Problem(T, eps, 1.0, regulariser, bias), truth


@pytest.mark.parametrize("regulariser", ["linear", "exponential", "tanh"])
def test_sensitivity_is_the_derivative(regulariser: str) -> None:
    problem, _ = noisy(0, regulariser)
    lam, step = 0.03, 1e-5
    trial = LambdaTrial.of(replace(problem, lam=lam))
    above, below = (
        LambdaTrial.of(replace(problem, lam=lam * float(np.exp(side * step)))) for side in (1, -1)
    )
    slope = (above.solution.u - below.solution.u) / (2.0 * step)
    assert trial.sensitivity == pytest.approx(slope, rel=1e-7, abs=1e-9)
    # Along the path, d residual = -lam d penalty.
    assert trial.penalty_sensitivity == pytest.approx(
        (above.penalty - below.penalty) / 2 / step, 1e-7
    )
    assert -lam * trial.penalty_sensitivity == pytest.approx(
        (above.residual - below.residual) / 2 / step, rel=1e-7
    )


def test_freedom_is_the_trace_of_the_influence() -> None:
    problem, _ = noisy(0, "exponential")
    trial = LambdaTrial.of(replace(problem, lam=0.3))
    trace, step = 0.0, 1e-5
    for k in range(len(problem.eps)):
        fits = []
        for side in (step, -step):
            eps = problem.eps.copy()
            eps[k] += side
            fits.append((problem.T @ solve(replace(problem, lam=0.3, eps=eps)).u)[k])
        trace += (fits[0] - fits[1]) / (2.0 * step)
    assert trial.fitted == pytest.approx(trace, rel=1e-7)


def test_curvature_of_the_l_curve() -> None:
    problem, truth = noisy(0)
    lam, step = 0.05, 1e-3
    trials = [
        LambdaTrial.of(replace(problem, lam=lam * float(np.exp(k * step)))) for k in (-1, 0, 1)
    ]
    x = np.log([t.residual for t in trials])
    y = np.log([t.penalty for t in trials])
    dx, dy = (x[2] - x[0]) / 2 / step, (y[2] - y[0]) / 2 / step
    ddx, ddy = (x[0] - 2 * x[1] + x[2]) / step**2, (y[0] - 2 * y[1] + y[2]) / step**2
    curvature = (dx * ddy - dy * ddx) / (dx * dx + dy * dy) ** 1.5
    assert -RULES["l-curve"](trials[1], 0.0, truth) == pytest.approx(curvature, rel=1e-4)


def test_discrepancy_principle_is_met() -> None:
    problem, _ = noisy(3, "exponential")
    choice = choose(problem, "discrepancy", variance=SIGMA**2)
    miss = problem.T @ choice.solution.u - problem.eps
    assert miss @ miss == pytest.approx(1.3 * 25 * SIGMA**2, rel=1e-3)
    assert not choice.at_edge


def squared_error(choice: LambdaChoice, truth: np.ndarray) -> float:
    return float(np.sum((choice.solution.u - truth) ** 2))


@pytest.mark.parametrize(
    ("rule", "factor"),
    [("discrepancy", 2.5), ("gcv", 7.0), ("l-curve", 7.0), ("quasi-optimality", 2.5)],
)
def test_rules_come_near_the_best(rule: str, factor: float) -> None:
    ratios = []
    for seed in range(3):
        problem, truth = noisy(seed)
        best = squared_error(choose(problem, "mse", truth=truth), truth)
        found = choose(problem, rule, variance=SIGMA**2)
        ratios.append(squared_error(found, truth) / best)
    assert min(ratios) >= 1.0 - 1e-9
    assert np.median(ratios) <= factor


def test_noise_above_the_signal_leaves_no_lam() -> None:
    problem, _ = noisy(0)
    assert choose(problem, "discrepancy", variance=1e3).at_edge


@pytest.mark.parametrize(
    ("rule", "message"),
    [
        ("discrepancy", r"noise\.variance"),
        ("mse", "true stress"),
        ("gvc", "one of discrepancy, gcv"),
    ],
)
def test_what_a_rule_needs(rule: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        choose(noisy(0)[0], rule)


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


def test_discrepancy_meets_the_noise():
    chosen = resolve_lambda(scene("discrepancy"))
    inverse = make_problem(chosen)
    residual = inverse.matrix @ tikhonov(inverse, chosen.design.lam) - inverse.strain
    assert float(residual @ residual) == pytest.approx(1.3 * 9 * 1e-3, rel=1e-4)
    assert chosen.lambda_rule == "discrepancy"
