"""Rational fits against functions whose poles and residues are known."""

from __future__ import annotations

import numpy as np
import pytest

from taction.verification.characterise.rational_fit import evaluate, fit_rational, fit_together

F = np.logspace(-2.0, 8.0, 401)
S = 2j * np.pi * F


def test_an_opamp_of_two_poles_is_found() -> None:
    p1, p2 = 2 * np.pi * 10.0, 2 * np.pi * 3e6
    found, error = fit_rational(F, 1e5 / ((1 + S / p1) * (1 + S / p2)))
    assert error < 1e-6
    assert sorted(pole.real for pole in found.poles) == pytest.approx([-p2, -p1], rel=1e-6)


def test_a_pair_of_complex_poles_is_found() -> None:
    pole, residue = complex(-2e5, 3e6), complex(1e6, -4e5)
    found, error = fit_rational(
        F, 2.0 + residue / (S - pole) + np.conj(residue) / (S - pole.conjugate())
    )
    assert error < 1e-9
    assert found.poles == pytest.approx((pole,), rel=1e-9)
    assert found.residues == pytest.approx((residue,), rel=1e-8)
    assert found.constant == pytest.approx(2.0, rel=1e-8)


def test_responses_of_one_circuit_share_their_poles() -> None:
    slow, fast = 300.0, 2e7
    gain, impedance = 1e5 / ((1 + S / slow) * (1 + S / fast)), 50.0 + 20.0 / (1 + S / slow)
    (first, second), errors = fit_together(F, [gain, impedance])
    assert first.poles == second.poles
    assert len(first.poles) == 2
    assert max(errors) < 1e-6
    np.testing.assert_allclose(evaluate(second, S), impedance, rtol=1e-6)


def test_an_unstable_response_has_no_good_stable_fit() -> None:
    error = fit_rational(F, 1.0 / (1.0 - S / 1e4))[1]
    assert error > 0.1
