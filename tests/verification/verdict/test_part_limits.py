"""Loads of the parts whose error has no bound."""

from __future__ import annotations

import math

import pytest

from taction.verification.verdict.headroom import Load, PartLoads


@pytest.mark.parametrize(("error", "volts"), [(0.0, 4.5), (math.inf, None)])
def test_no_unit_voltage_is_promised_for_a_load_without_a_bound(
    error: float, volts: float | None
) -> None:
    """A peak of twice the limit at 10 V: 90 % of the limit is reached at 4.5 V."""
    loads = PartLoads((Load("v_1", "voltage", 20.0, 10.0, 1e-6, 5.0, error),), "", 10.0)
    assert loads.largest_unit_voltage == (None if volts is None else pytest.approx(volts))
    assert ("unit_voltage" in loads.remedy) == (volts is not None)
