"""Devices of arrays: the polynomials of their sources at some conductances, windows and levels."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from taction.netlist_gen.board.devices import Device, load_devices
from taction.netlist_gen.scene.design import DevicesTable

# By hand, from the formulas in the sources, in uS: conductance and standard deviation.
PRINTED = {
    "rram-wan": ((10.0, 1.053 + 2.374 - 1.167 + 0.1536), (30.0, 1.053 + 7.122 - 10.503 + 4.1472)),
    "rram-milo": ((50.0, 4.782 - 0.45535), (225.0, 4.782 - 2.049075)),
    "pcm-joshi": ((1.0, 0.2864 + 0.07586 - 0.001788), (20.0, 0.2864 + 1.5172 - 0.7152)),
    "pcm-aihwkit": (
        (10.0, 0.26348 + 1.9650 * 0.4 - 1.1731 * 0.16),
        (25.0, 0.26348 + 1.9650 - 1.1731),
    ),
}
WINDOWS = {
    "pcm-aihwkit": (0.25, 25.0),
    "rram-wan": (1.0, 39.26),
    "rram-milo": (50.0, 225.0),
    "pcm-joshi": (0.25, 25.0),
}


def test_every_device_has_its_window_its_error_and_its_source() -> None:
    devices = load_devices()
    assert devices.keys() == PRINTED.keys()
    (cells, _) = get_args(DevicesTable.model_fields["cell"].annotation)
    assert get_args(cells) == tuple(devices)
    for name, device in devices.items():
        assert (device.least, device.most) == pytest.approx([1e-6 * x for x in WINDOWS[name]])
        assert device.source.startswith(("CrossSim", "aihwkit"))
        for micro, wanted in PRINTED[name]:
            (found,) = device.spread(np.array([1e-6 * micro]))
            assert found == pytest.approx(1e-6 * wanted, rel=1e-9)
        inside = np.linspace(device.least, device.most, 200)
        assert np.all(device.spread(inside) > 0.0)


def test_levels_are_evenly_spaced_and_reached_from_halfway() -> None:
    device = Device(0.5e-6, 35.5e-6, levels=8)
    wanted = np.array([0.0, 1e-7, 3.1e-6, 2.9e-6, 40e-6])
    np.testing.assert_allclose(
        device.settable(wanted), [0.0, 0.5e-6, 5.5e-6, 0.5e-6, 35.5e-6], rtol=1e-12
    )


def test_programmed_conductances_stay_within_the_window() -> None:
    device = Device(1e-6, 9e-6, programming_error=(2e-6,))
    aimed = np.full(4, 5e-6)
    found = device.programmed(aimed, np.array([0.0, 1.0, 5.0, -5.0]))
    np.testing.assert_allclose(found, [5e-6, 7e-6, 9e-6, 1e-6], rtol=1e-12)


def test_drift_is_the_power_law_of_its_source_and_has_an_inverse() -> None:
    """aihwkit: nu = clip(-0.0155 ln x + 0.0244, 0.049, 0.1), sd clip(-0.0125 ln x - 0.0059, ..)."""
    day = replace(load_devices()["pcm-aihwkit"], age=86400.0)
    aimed, ratio = 25e-6 * np.array([1e-2, 1e-1, 1.0]), 86400.0 / 20.0
    nu = [0.0244 + 0.0155 * math.log(100.0), 0.0244 + 0.0155 * math.log(10.0), 0.049]
    now = day.drifted(aimed)
    np.testing.assert_allclose(now, aimed * ratio ** -np.array(nu), rtol=1e-12)
    np.testing.assert_allclose(day.programmed_for(now), aimed, rtol=1e-12)
    spread = np.array([0.045, 0.0125 * math.log(10.0) - 0.0059, 0.008])
    np.testing.assert_allclose(day.spreads(now)["drift"], now * math.log(ratio) * spread, rtol=1e-9)
    fresh = load_devices()["pcm-aihwkit"].spreads(aimed)["programming"]
    np.testing.assert_allclose(day.spreads(now)["programming"], fresh * now / aimed, rtol=1e-9)


def test_a_share_of_the_cells_is_stuck_and_the_others_are_as_before(
    rng: np.random.Generator,
) -> None:
    cell = Device(1e-6, 9e-6, programming_error=(1e-8,), stuck_at_least=0.1, stuck_at_most=0.02)
    found = cell.programmed(np.full(20_000, 5e-6), rng.standard_normal(20_000))
    for end, share in ((1e-6, 0.1), (9e-6, 0.02)):
        count = np.count_nonzero(found == end)
        assert count == pytest.approx(20_000 * share, abs=4.0 * math.sqrt(20_000 * share))
    others = found[(found > 1e-6) & (found < 9e-6)]
    assert np.std(others) == pytest.approx(1e-8, rel=4.0 / math.sqrt(2.0 * len(others)))
