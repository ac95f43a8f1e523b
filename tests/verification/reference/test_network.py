"""Lambda from the components of a board: the physical network's rest state is the optimum."""

from __future__ import annotations

from collections.abc import Callable
from math import exp, isclose, log, log1p, sinh, tanh

import numpy as np
import pytest
from scipy.optimize import brentq

from taction.verification.reference.dynamics import IdealNetwork, lambda_times_resistance
from taction.verification.reference.solve import solve

G: dict[str, Callable[[float], float]] = {
    "linear": lambda x: x,
    "exponential": exp,
    "sinh": sinh,
    "softplus": lambda x: log1p(exp(x)),
    "tanh": tanh,
}
# Components of one channel with two sensors, SI units, all of them unlike 1.
R, S, G0, U0, VE = 1.7e6, 2.9e6, 0.43e-6, 0.6, 0.15
T, EPS = np.array([[1.3], [-0.4]]), np.array([0.9, 0.25])


def current(v: float, kind: str, biased: bool) -> float:
    """Current into the capacitor of the node, A: eq (9) as corrected, in SI units."""
    u = v if kind == "linear" else U0 * G[kind](v / VE)
    w = [S * G0 * (t * u - e * U0) for t, e in zip(T[:, 0].tolist(), EPS.tolist(), strict=True)]
    feedback = sum(t * G0 * volts for t, volts in zip(T[:, 0].tolist(), w, strict=True))
    return -v / R - biased * VE / R - feedback


@pytest.mark.parametrize(
    ("kind", "biased"), [("linear", False), *((k, b) for k in list(G)[1:] for b in (False, True))]
)
def test_the_rest_state_of_the_components_solves_the_problem(kind: str, biased: bool) -> None:
    v = brentq(current, -3.0, 3.0, args=(kind, biased), xtol=1e-15)
    product = lambda_times_resistance(kind, s=S, G0=G0, U0=U0, Ve=VE)
    network = IdealNetwork(T, EPS, product / R, R * 1e-11, U0, kind, VE, biased)
    u = U0 * solve(network.problem).u[0]
    assert u == pytest.approx(v if kind == "linear" else U0 * G[kind](v / VE), rel=1e-12)


def test_the_papers_lambda() -> None:
    """Eqs (16) and (8): ``sum u log u`` has 2/(sR) in the paper's units; eq (21): 1/(sR)."""
    assert isclose(lambda_times_resistance("exponential", s=4.0, G0=1.0), 2.0 / 4.0)
    assert isclose(lambda_times_resistance("linear", s=4.0, G0=1.0), 1.0 / 4.0)


def test_the_entropy_with_bias_in_closed_form() -> None:
    """T = 1, eps = 1, lambda = 2: ``2 (u - 1) + 2 (log u + 1) = 0``, so ``u + log u = 0``."""
    network = IdealNetwork(np.eye(1), np.ones(1), 2.0, 1.0, amplifier="exponential", bias=True)
    u = float(solve(network.problem).u[0])
    assert abs(u + log(u)) < 1e-15
