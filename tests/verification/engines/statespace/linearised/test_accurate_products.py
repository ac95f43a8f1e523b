"""Accurate sums of products against rational arithmetic."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from taction.verification.engines.statespace.linearised.exactness import accurate_sum


@pytest.mark.parametrize("spread", [0.0, 3.0, 8.0])
def test_a_residual_is_right_to_its_last_digits(spread: float) -> None:
    rng = np.random.default_rng(5)
    P = rng.standard_normal((6, 30)) * 10.0 ** rng.uniform(-spread, spread, (6, 1))
    Q = rng.standard_normal((30, 4)) * 10.0 ** rng.uniform(-spread, spread, (1, 4))
    inner = 10.0 ** rng.uniform(-spread, spread, 30)
    P, Q = P / inner, Q * inner[:, None]
    near = P @ Q
    found = accurate_sum([near], [(-P, Q)])
    for i, j in np.ndindex(*near.shape):
        terms = (Fraction(p) * Fraction(q) for p, q in zip(P[i], Q[:, j], strict=True))
        wanted = float(Fraction(near[i, j]) - sum(terms))
        scale = float(np.abs(P[i]) @ np.abs(Q[:, j]))
        assert found[i, j] == pytest.approx(wanted, rel=1e-9, abs=1e-26 * scale)


def test_nothing_is_no_sum() -> None:
    with pytest.raises(ValueError, match="nothing to add"):
        accurate_sum([], [])
