"""Fitted orders: from the asymptotic part alone, and none where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from taction.verification.studies.work_precision.convergence_order import fit_order

STEPS = [2.0**-k for k in range(8)]
NAMES = [str(k) for k in range(8)]


def test_a_clean_ladder_gives_its_order_and_constant() -> None:
    found = fit_order(STEPS, [0.05 * h**3 for h in STEPS], 0.0, NAMES)
    assert found.value == pytest.approx(3.0, abs=1e-12)
    assert found.constant == pytest.approx(0.05, rel=1e-12)
    assert found.points == tuple(range(8))
    assert found.reason == ""


def test_what_is_not_asymptotic_and_what_is_at_the_floor_is_left_out() -> None:
    """Saturation above, the reference's error of 1e-6 below: the three between remain."""
    errors = [min(8.0 * h**2, 0.9) + 1e-6 * (k > 6) for k, h in enumerate(STEPS)]
    found = fit_order(STEPS, errors, 1e-4, NAMES)
    assert found.points == (4, 5, 6)
    assert found.value == pytest.approx(2.0, abs=1e-12)
    assert "3 is not asymptotic" in found.reason
    assert "7 is at the reference's own error" in found.reason


def test_a_time_out_is_no_error_and_breaks_nothing() -> None:
    errors = [0.05 * h for h in STEPS[:-1]]
    found = fit_order([*STEPS[:-1], None], [*errors, None], 0.0, NAMES)
    assert found.value == pytest.approx(1.0)
    assert found.reason == "7 has no error"


def test_an_outlier_is_named() -> None:
    errors = [0.05 * h**2 for h in STEPS]
    errors[0] = 1e-5
    found = fit_order(STEPS, errors, 0.0, NAMES)
    assert found.points == tuple(range(1, 8))
    assert found.reason == "0 is off the line"


def test_scatter_and_two_points_show_no_order(rng: np.random.Generator) -> None:
    noise = fit_order(STEPS, (10.0 ** rng.uniform(-6, -2, 8)).tolist(), 0.0, NAMES)
    assert noise.value is None or len(noise.points) < 5
    assert fit_order(STEPS[:2], [1e-2, 1e-3], 0.0, NAMES[:2]).value is None
    assert fit_order([1.0, 1.0, 1.0], [1e-2, 1e-3, 1e-4], 0.0, NAMES[:3]).value is None


def test_the_uncertainty_is_that_of_a_straight_line(rng: np.random.Generator) -> None:
    """Against numpy's own least squares with its covariance."""
    errors = [0.05 * h**2 * float(np.exp(0.05 * rng.standard_normal())) for h in STEPS]
    found = fit_order(STEPS, errors, 0.0, NAMES)
    line, covariance = np.polyfit(np.log(STEPS), np.log(errors), 1, cov=True)
    assert found.value == pytest.approx(line[0], rel=1e-12)
    assert found.sigma == pytest.approx(np.sqrt(covariance[0, 0]), rel=1e-9)
