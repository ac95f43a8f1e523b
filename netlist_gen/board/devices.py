"""Conductance devices of arrays as data: window, levels and programming error; and the presets."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np

from taction.system.array_types import Floats

MICRO = 1e-6
FLOOR = 1e-6  # of the largest conductance: what a device without a window keeps


@dataclass(frozen=True, slots=True)
class Device:
    """A device that is programmed to a conductance.

    Attributes
    ----------
    least, most : float
        Window of conductances, S.
    levels : int
        Evenly spaced conductances from `least` to `most`; 0: any.
    programming_error : tuple of float
        Coefficients of the polynomial in S, lowest power first, that gives the standard deviation
        after programming, S.
    source : str
        Where the figures were read.
    """

    least: float = 0.0
    most: float = math.inf
    levels: int = 0
    programming_error: tuple[float, ...] = ()
    source: str = ""

    @classmethod
    def in_microsiemens(cls, table: dict[str, object]) -> Device:
        """Return the device of a table of ``devices.toml``."""
        least, most = (MICRO * float(str(table[name])) for name in ("least", "most"))
        given: object = table["programming_error"]
        assert isinstance(given, list)  # noqa: S101 - a file of this package
        error = tuple(MICRO * float(each) / MICRO**power for power, each in enumerate(given))
        return cls(least, most, int(str(table.get("levels", 0))), error, str(table["source"]))

    def settable(self, siemens: Floats) -> Floats:
        """Return the conductances that are aimed at for those that are wanted; zeros stay.

        Examples
        --------
        >>> Device(1e-6, 9e-6, levels=5).settable(np.array([0.0, 0.4e-6, 5.9e-6, 1e-3])).round(9)
        array([0.e+00, 1.e-06, 5.e-06, 9.e-06])
        """
        aimed = np.clip(siemens, self.least, self.most)
        if self.levels:
            step = (self.most - self.least) / (self.levels - 1)
            aimed = self.least + step * np.round((aimed - self.least) / step)
        return np.where(siemens > 0.0, aimed, 0.0)

    def spread(self, siemens: Floats) -> Floats:
        """Return the standard deviation of programmed conductances, S.

        Examples
        --------
        >>> load_devices()["rram-milo"].spread(np.array([100e-6])).round(12)
        array([3.8713e-06])
        """
        powers = [each * siemens**power for power, each in enumerate(self.programming_error)]
        return np.maximum(np.sum(powers, axis=0) if powers else np.zeros_like(siemens), 0.0)

    def programmed(self, siemens: Floats, deviations: Floats) -> Floats:
        """Return what devices have that were aimed at `siemens`, for standard normal deviations."""
        most = np.maximum(siemens, self.most)
        least = np.minimum(siemens, max(self.least, FLOOR * float(siemens.max(initial=0.0))))
        return np.clip(siemens + deviations * self.spread(siemens), least, most)


@cache
def load_devices() -> dict[str, Device]:
    """Return the devices by name."""
    text = files("taction.spice_models").joinpath("devices.toml").read_text("utf-8")
    return {name: Device.in_microsiemens(table) for name, table in tomllib.loads(text).items()}
