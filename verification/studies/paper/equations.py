"""The network's equations as printed, eqs (8) to (16) and (21), each against a check."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from spice_models.array_types import Floats
from verification.reference import Problem, ideal_linear, solve
from verification.studies.paper.findings import Chapter, Finding, listed, weigh
from verification.studies.paper.tactile import Geometry
from verification.studies.paper.unit_network import unit_network

GEOMETRY = Geometry("", 9, 4.0)
R, S = 0.25, 3.0  # neither 1, so that a factor that is missing shows
SAME = 1e-9


def equations(quick: bool) -> Chapter:
    """Judge what the printed equations say of the network's rest."""
    T, strain = GEOMETRY.matrix, GEOMETRY.strain(1, 0.01)
    return Chapter(
        (_current(T, strain), _path(T, strain), _entropy(T, strain), _quadratic(T, strain))
    )


def _gradient(u: Floats, T: Floats, strain: Floats) -> float:
    """Return ``‖∂P/∂u‖`` of eq (16) over the size of its terms."""
    data = S * T.T @ (T @ u - strain)
    own = (np.log(u) + 1.0) / R
    return float(np.max(np.abs(data + own)) / np.max(np.abs(own)))


def _current(T: Floats, strain: Floats) -> Finding:
    """Rest of eq (9): as printed R drops out and no bias current flows."""
    printed = solve(Problem(T, strain, 2.0 / S, "exponential", False)).u
    right = solve(Problem(T, strain, 2.0 / (S * R), "exponential", True)).u
    wrong, good = _gradient(printed, T, strain), _gradient(right, T, strain)
    return Finding(
        "eq-9",
        f"gradient of eq (16) where eq (9) rests, R = {R:g}, s = {S:g}",
        f"{wrong:.2g} of its terms at the rest of eq (9) as printed (there R drops out); {good:.0e}"
        " with -v/R - I_b - Σ, where I_b is a bias current",
        weigh(wrong <= SAME),
        {"printed": wrong, "corrected": good},
    )


def _path(T: Floats, strain: Floats) -> Finding:
    """Integrate the currents round a closed rectangle, over v and over u = exp(v)."""
    points, weights = np.polynomial.legendre.leggauss(20)
    corners = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0], [0.0, 0.0]])
    over_v = over_u = size = 0.0
    for a, b in pairwise(corners):
        for point, weight in zip(points.tolist(), weights.tolist(), strict=True):
            v = np.zeros(GEOMETRY.channels)
            v[:2] = a + 0.5 * (1.0 + point) * (b - a)
            along = np.zeros(GEOMETRY.channels)
            along[:2] = 0.5 * weight * (b - a)
            current = -(v + 1.0) / R - S * T.T @ (T @ np.exp(v) - strain)
            over_v += float(current @ along)
            over_u += float(current @ (np.exp(v) * along))
            size += abs(float(current @ along))
    return Finding(
        "eq-10",
        "Σ ∮ i dv and Σ ∮ i du round a closed rectangle in two of the channels",
        f"{abs(over_v) / size:.2g} and {abs(over_u) / size:.0e} of the way's length: only the"
        " integral over u is a function of the state",
        weigh(abs(over_v) <= SAME * size),
        {"over_v": abs(over_v) / size, "over_u": abs(over_u) / size},
    )


def _entropy(T: Floats, strain: Floats) -> Finding:
    """Find the lambda that a board has, which the paper never says, from eqs (16) and (8)."""
    factors = (1.0, 2.0, 4.0)
    off = [
        _gradient(solve(Problem(T, strain, f / (S * R), "exponential", True)).u, T, strain)
        for f in factors
    ]
    return Finding(
        "eq-16",
        "gradient of eq (16) at the minimum of eq (8) with lambda = 1, 2 and 4 / (sR)",
        f"{listed(off, 2)} of its terms: they agree at lambda = 2/(sR)",
        weigh(off[1] <= SAME and min(off[0], off[2]) > 0.01),
        {"at_1": off[0], "at_2": off[1], "at_4": off[2]},
    )


def _quadratic(T: Floats, strain: Floats) -> Finding:
    """Rest of the linear network against both readings of eq (21)."""
    network = unit_network(T, strain, 1.0 / (S * R), "linear")
    response = ideal_linear(network, np.zeros(GEOMETRY.channels))
    rest = response.outputs(response.time[-1:])[0]
    off = []
    for factor in (2.0, 1.0):
        matrix = T.T @ T + factor / (S * R) * np.eye(len(rest))
        u = np.linalg.solve(matrix, T.T @ strain)
        off.append(float(np.max(np.abs(u - rest)) / np.max(np.abs(rest))))
    return Finding(
        "eq-21",
        "rest of the linear network against the minimum with energy (1/R) Σ v² and (1/2R) Σ v²",
        f"off by {100 * off[0]:.2g} % and {off[1]:.0e}: lambda = 1/(sR)",
        weigh(off[0] <= SAME),
        {"printed": off[0], "corrected": off[1]},
    )
