"""Norms of a work-precision study against a damped oscillation in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from taction.system.array_types import Floats
from taction.verification.studies.work_precision.method_runs import MethodRun
from taction.verification.studies.work_precision.norms import ErrorScale, make_scale, measure_errors

DECAY, OMEGA = 1e3, 2e5
TARGET = np.array([2.0, -1.0])
TIME = np.linspace(0.0, 4e-3, 16001)


def ringing(time: Floats, decay: float = DECAY, omega: float = OMEGA) -> Floats:
    """Two channels that ring around their targets, from 0; step amplitude 2."""
    wave = 1.0 - np.exp(-decay * time) * np.cos(omega * time)
    return np.outer(wave, TARGET)


def scale(band: float = 0.05) -> ErrorScale:
    return make_scale(TIME, ringing(TIME), np.zeros(2), TARGET, band, complex(-DECAY, OMEGA))


def errors_of(u: Floats) -> dict[str, float | None]:
    return measure_errors(MethodRun(TIME, u, 1.0, 1, None), ringing(TIME), scale())


def test_the_scale_is_that_of_the_reference() -> None:
    found = scale()
    assert found.amplitude == 2.0
    assert found.band == 0.05
    # exp(-t) = 0.05 at the last peak before it, so within half a ringing period of 1/decay ln 20
    assert found.settling_time == pytest.approx(np.log(20.0) / DECAY, abs=np.pi / OMEGA)
    assert found.ringing is not None
    assert found.ringing == pytest.approx(complex(-DECAY, OMEGA), rel=1e-6)


def test_a_band_that_the_record_does_not_reach_is_widened() -> None:
    found = scale(band=0.01)
    # what is left at 80 % of the record, times 1.25, to two digits
    assert found.band == pytest.approx(1.25 * np.exp(-3.2), rel=0.03)
    assert found.settling_time is not None


def test_amplitude_errors_are_fractions_of_the_step() -> None:
    errors = errors_of(ringing(TIME) + 1e-3 * np.outer(TIME / TIME[-1], [1.0, 0.5]))
    assert errors["final"] == pytest.approx(5e-4)
    assert errors["maximum"] == pytest.approx(5e-4)


def test_the_pole_of_a_wrong_record_is_found_wrong_by_as_much() -> None:
    errors = errors_of(ringing(TIME, decay=1.1 * DECAY, omega=1.001 * OMEGA))
    assert errors["frequency"] == pytest.approx(1e-3, rel=1e-3)
    assert errors["growth_rate"] == pytest.approx(0.1 * DECAY / OMEGA, rel=1e-2)
    settling = errors["settling_time"]
    assert settling == pytest.approx(0.1 / 1.1, abs=np.pi / OMEGA / 3e-3)


def test_no_error_is_no_error_in_any_norm() -> None:
    assert set(errors_of(ringing(TIME)).values()) == {0.0}


def test_a_record_that_does_not_ring_has_no_ringing_error() -> None:
    errors = errors_of(np.outer(1.0 - np.exp(-DECAY * TIME), TARGET))
    assert errors["frequency"] is None
    assert errors["growth_rate"] is None
    assert errors["final"] is not None
