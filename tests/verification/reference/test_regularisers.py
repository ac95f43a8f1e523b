"""Every entry of the regularisers' table is consistent with itself."""

from __future__ import annotations

import numpy as np
import pytest

from taction.verification.reference.regularisers import REGULARISERS, Regulariser

ENTRIES = pytest.mark.parametrize("entry", REGULARISERS.values(), ids=REGULARISERS)
V = np.linspace(-6.0, 6.0, 49)


@ENTRIES
def test_slope_is_the_derivative(entry: Regulariser) -> None:
    step = 1e-5
    difference = (entry.g(V + step) - entry.g(V - step)) / 2 / step
    assert difference == pytest.approx(entry.slope(V), rel=1e-8, abs=1e-10)


@ENTRIES
def test_potential_is_the_integral(entry: Regulariser) -> None:
    step = 1e-5
    difference = (entry.potential(V + step) - entry.potential(V - step)) / 2 / step
    assert difference == pytest.approx(entry.g(V), abs=1e-7, rel=1e-8)


@ENTRIES
def test_energy_has_the_inverse_as_its_derivative(entry: Regulariser) -> None:
    u, step = entry.g(np.linspace(-2.0, 2.0, 21)), 1e-6
    energy = [entry.energy(entry.inverse(u + side * step)) for side in (1, -1)]
    assert (energy[0] - energy[1]) / 2 / step == pytest.approx(entry.inverse(u), abs=1e-7)


@ENTRIES
@pytest.mark.parametrize("mu", [1e6, 1.0, 1e-6, 1e-12, 1e-18])
def test_v_from_q_inverts_the_coordinate(entry: Regulariser, mu: float) -> None:
    h = np.full_like(V, 0.3)
    q = np.linspace(-3.0, 3.0, len(V))
    v = entry.v_from_q(q, mu, h)
    assert np.all(np.isfinite(v))
    assert mu * v + h * entry.g(v) == pytest.approx(q, rel=1e-9, abs=1e-12)


@ENTRIES
def test_bounds_on_the_slope(entry: Regulariser) -> None:
    for width in (0.0, 0.5, 3.0):
        near = V[:, None] + np.linspace(-width, width, 41)
        largest = entry.slope(near).max(axis=1)
        assert np.all(entry.largest_slope(V, np.full_like(V, width)) >= largest * (1 - 1e-12))
    for rise in (0.0, 1e-3, 0.5):
        u = entry.g(V)
        v = V + 1e-9
        reached = entry.g(v) + rise
        inside = reached < 1.0 if entry is REGULARISERS["tanh"] else np.ones_like(V, dtype=bool)
        slope = entry.slope(entry.inverse(reached[inside]))
        assert np.all(slope <= entry.slope_bound(u[inside]) * (1 + 1e-6) + rise + 1e-6)
