"""The network's equations as printed, eqs (8) to (16) and (21), each against a check."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from taction.system.array_types import Floats
from taction.verification.evidence.paper.findings import Chapter, Finding, finding, weigh
from taction.verification.evidence.paper.tactile import Geometry, largest_difference, unit_network
from taction.verification.reference.dynamics import ideal_linear
from taction.verification.reference.problem import Problem
from taction.verification.reference.solve import solve

GEOMETRY = Geometry(9, 4.0)
R, S = 0.25, 3.0  # neither is 1, so that a missing factor shows
SAME = 1e-9


def equations(quick: bool) -> Chapter:
    """Judge what the printed equations say of the network's rest."""
    T, strain = GEOMETRY.matrix, GEOMETRY.strain(1, 0.01)
    return Chapter((_current(T, strain), _path(T, strain), _entropy(T, strain), _rest(T, strain)))


def _gradient(lam: float, T: Floats, strain: Floats, *, bias: bool = True) -> float:
    """Return ``‖∂P/∂u‖`` of eq (16) over its largest term at the minimum of eq (8) with `lam`."""
    u = solve(Problem(T, strain, lam, "exponential", bias)).u
    terms = (np.log(u) + 1.0) / R
    return float(np.max(np.abs(S * T.T @ (T @ u - strain) + terms)) / np.max(np.abs(terms)))


def _current(T: Floats, strain: Floats) -> Finding:
    """Compare eq (9) as printed, without R and bias current, with the corrected equation."""
    printed = _gradient(2.0 / S, T, strain, bias=False)
    corrected = _gradient(2.0 / (S * R), T, strain)
    values = {"printed": printed, "corrected": corrected}
    return finding("eq-9", values, weigh(printed <= SAME), R=R, s=S)


def _path(T: Floats, strain: Floats) -> Finding:
    """Integrate the currents round a closed rectangle, over v and over u = exp(v)."""
    points, weights = np.polynomial.legendre.leggauss(20)
    corners = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0], [0.0, 0.0]])
    over_v = over_u = size = 0.0
    for a, b in pairwise(corners):
        for point, weight in zip(points.tolist(), weights.tolist(), strict=True):
            v, along = np.zeros((2, GEOMETRY.channels))
            v[:2] = a + 0.5 * (1.0 + point) * (b - a)
            along[:2] = 0.5 * weight * (b - a)
            current = -(v + 1.0) / R - S * T.T @ (T @ np.exp(v) - strain)
            over_v += float(current @ along)
            over_u += float(current @ (np.exp(v) * along))
            size += abs(float(current @ along))
    values = {"over_v": abs(over_v) / size, "over_u": abs(over_u) / size}
    return finding("eq-10", values, weigh(values["over_v"] <= SAME))


def _entropy(T: Floats, strain: Floats) -> Finding:
    """Find the lambda of a board, which the paper does not state, from eqs (16) and (8)."""
    off = [_gradient(factor / (S * R), T, strain) for factor in (1.0, 2.0, 4.0)]
    values = {f"at_{factor}": each for factor, each in zip((1, 2, 4), off, strict=True)}
    return finding("eq-16", values, weigh(off[1] <= SAME and min(off[0], off[2]) > 0.01), off=off)


def _rest(T: Floats, strain: Floats) -> Finding:
    """Compare the rest of the linear network with both readings of eq (21)."""
    network = unit_network(T, strain, 1.0 / (S * R), "linear")
    response = ideal_linear(network, np.zeros(GEOMETRY.channels))
    rest = response.outputs(response.time[-1:])[0]
    values = {}
    for name, factor in (("printed", 2.0), ("corrected", 1.0)):
        matrix = T.T @ T + factor / (S * R) * np.eye(len(rest))
        u = np.asarray(np.linalg.solve(matrix, T.T @ strain), dtype=np.float64)
        values[name] = largest_difference(u, rest)
    return finding("eq-21", values, weigh(values["printed"] <= SAME))
