"""Devices of arrays: the polynomials of their sources at some conductances, windows and levels."""

from __future__ import annotations

import numpy as np
import pytest

from taction.netlist_gen.board.devices import Device, load_devices
from taction.netlist_gen.scene.known_keys import table
from taction.netlist_gen.scene.scene import Scene

# By hand, from the formulas in the sources, in uS: conductance and standard deviation.
PRINTED = {
    "rram-wan": ((10.0, 1.053 + 2.374 - 1.167 + 0.1536), (30.0, 1.053 + 7.122 - 10.503 + 4.1472)),
    "rram-milo": ((50.0, 4.782 - 0.45535), (225.0, 4.782 - 2.049075)),
    "pcm-joshi": ((1.0, 0.2864 + 0.07586 - 0.001788), (20.0, 0.2864 + 1.5172 - 0.7152)),
}
WINDOWS = {"rram-wan": (1.0, 39.26), "rram-milo": (50.0, 225.0), "pcm-joshi": (0.25, 25.0)}


def test_every_device_has_its_window_its_error_and_its_source() -> None:
    devices = load_devices()
    assert devices.keys() == PRINTED.keys()
    assert table(Scene)["keys"]["devices"]["keys"]["cell"]["names"] == list(devices)
    for name, device in devices.items():
        assert (device.least, device.most) == pytest.approx([1e-6 * x for x in WINDOWS[name]])
        assert "CrossSim" in device.source
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


def test_a_device_without_a_window_keeps_a_positive_conductance() -> None:
    device = Device(programming_error=(1e-5,))
    assert np.all(device.programmed(np.array([1e-6, 2e-6]), np.array([-9.0, -9.0])) > 0.0)
