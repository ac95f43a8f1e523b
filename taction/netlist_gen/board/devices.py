"""Conductance devices of arrays as data: window, levels, drift ``g (t/t0)^-nu``, noise."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from taction.system.array_types import Floats

MICRO = 1e-6
KINDS = ("programming", "drift", "read_noise")
"""Why a device differs from what it is aimed at, as a standard deviation; in `Device.spreads`."""
LOGARITHMIC = {"drift_exponent", "drift_spread"}  # figures of a device
REPEATS = 60  # of the iteration for what has drifted
FLOOR = 1e-6  # of the largest conductance: what a device without a window keeps


@dataclass(frozen=True, slots=True)
class Logarithmic:
    """A number that falls with the logarithm of x, between two limits; a constant by default."""

    offset: float = 0.0
    slope: float = 0.0
    low: float = -math.inf
    high: float = math.inf

    def at(self, x: Floats) -> Floats:
        """Return it at positive x."""
        return np.clip(self.offset + self.slope * np.log(x), self.low, self.high)


@dataclass(frozen=True, slots=True)
class Device:
    """A device that is programmed to a conductance; its figures have the names of ``[devices]``."""

    least_conductance: float = 0.0  # window of conductances, S
    most_conductance: float = math.inf
    cell_levels: int = 0  # evenly spaced conductances over the window; 0: any
    # coefficients of the polynomial in S, lowest power first, that gives the standard deviation
    # after programming, S
    programming_error: tuple[float, ...] = ()
    read_noise: float = 0.0  # standard deviation from solve to solve, a fraction of the conductance
    # mean of nu, over the conductance in the largest one, or in S
    drift_exponent: Logarithmic = Logarithmic()
    drift_spread: Logarithmic = Logarithmic()  # its standard deviation
    drift_start: float = 1.0  # t0 since its programming, s: no drift up to t0
    age: float = 0.0  # t since its programming, s
    stuck_at_least: float = 0.0  # fractions of the cells that are stuck at the ends of the window
    stuck_at_most: float = 0.0
    source: str = ""  # where the figures were read

    @classmethod
    def in_microsiemens(cls, table: dict[str, Any]) -> Device:
        """Return the device of a table of ``devices.toml``."""
        own = dict(table)
        for name in ("least_conductance", "most_conductance"):
            own[name] *= MICRO
        terms = enumerate(own["programming_error"])
        own["programming_error"] = tuple(MICRO * each / MICRO**power for power, each in terms)
        for name in LOGARITHMIC & own.keys():
            own[name] = Logarithmic(*own[name])
        return cls(**own)

    def settable(self, siemens: Floats) -> Floats:
        """Return the conductances that are aimed at for those that are wanted; zeros stay."""
        low, high = self.least_conductance, self.most_conductance
        aimed = np.clip(siemens, low, high)
        if self.cell_levels:
            step = (high - low) / (self.cell_levels - 1)
            aimed = low + step * np.round((aimed - low) / step)
        return np.where(siemens > 0.0, aimed, 0.0)

    @property
    def stuck(self) -> float:
        """Fraction of the cells that are stuck."""
        return self.stuck_at_least + self.stuck_at_most

    @property
    def decades(self) -> float:
        """``ln(t/t0)``; 0 without drift."""
        return max(math.log(self.age / self.drift_start), 0.0) if self.age else 0.0

    def drifted(self, siemens: Floats) -> Floats:
        """Return what devices have now that had `siemens` when they were programmed; zeros stay."""
        return siemens * self._kept(siemens) if self.decades else siemens

    def programmed_for(self, siemens: Floats) -> Floats:
        """Return what devices had when they were programmed that have `siemens` now."""
        before = siemens
        for _ in range(REPEATS if self.decades else 0):
            before = siemens / self._kept(before)
        return before

    def _kept(self, siemens: Floats) -> Floats:
        """Return the share of programmed conductances that is left."""
        return np.exp(-self.decades * self.drift_exponent.at(self._share(siemens)))

    def _share(self, siemens: Floats) -> Floats:
        unit = self.most_conductance if math.isfinite(self.most_conductance) else 1.0
        return np.where(siemens > 0.0, siemens, unit) / unit

    def spreads(self, siemens: Floats) -> dict[str, Floats]:
        """Return the standard deviations of devices with `siemens` on average, S, by `KINDS`."""
        before, found = self.programmed_for(siemens), dict[str, Floats]()
        if self.programming_error:
            terms = [each * before**power for power, each in enumerate(self.programming_error)]
            kept = np.divide(siemens, before, out=np.zeros_like(siemens), where=before > 0.0)
            found["programming"] = np.maximum(np.sum(terms, axis=0), 0.0) * kept
        if self.decades and self.drift_spread != Logarithmic():
            nu = np.maximum(self.drift_spread.at(self._share(before)), 0.0)
            found["drift"] = siemens * self.decades * nu
        if self.read_noise:
            found["read_noise"] = siemens * self.read_noise
        return found

    def spread(self, siemens: Floats) -> Floats:
        """Return the standard deviation of devices for all reasons together, S."""
        parts = [each**2 for each in self.spreads(siemens).values()]
        return np.sqrt(np.sum(parts, axis=0)) if parts else np.zeros_like(siemens)

    def programmed(self, siemens: Floats, deviations: Floats) -> Floats:
        """Return what devices have that have `siemens` on average, for standard normal deviations.

        The tails of the deviations are the cells that are stuck.
        """
        at_least = at_most = np.zeros(siemens.shape, dtype=np.bool_)
        if self.stuck:
            from scipy.special import ndtr, ndtri

            place = ndtr(deviations)
            at_least, at_most = place < self.stuck_at_least, place > 1.0 - self.stuck_at_most
            inner = (place - self.stuck_at_least) / (1.0 - self.stuck)
            deviations = ndtri(np.where(at_least | at_most, 0.5, inner))
        low, high = self.least_conductance, self.most_conductance
        floor = FLOOR * float(siemens.max(initial=0.0))
        least = np.minimum(siemens, max(float(self.drifted(np.array([low]))[0]), floor))
        found = siemens + deviations * self.spread(siemens)
        found = np.clip(found, least, np.maximum(siemens, high))
        return np.where(at_least, max(low, floor), np.where(at_most, high, found))


@cache
def load_devices() -> dict[str, Device]:
    """Return the devices by name."""
    from importlib.resources import files

    text = files("taction.spice_models").joinpath("devices.toml").read_text("utf-8")
    return {name: Device.in_microsiemens(table) for name, table in tomllib.loads(text).items()}
