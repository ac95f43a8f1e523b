"""An op-amp's figures as its data sheet has them, with their sources, and its open loop."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from taction.spice_models.opamp import OpAmp, unity_gain_bandwidth
from taction.spice_models.presets import Origin, figure_origins
from taction.system.array_types import Complexes, Floats
from taction.system.results import Result

POINTS = 500  # of a Bode plot
BELOW, ABOVE = 0.01, 100.0  # its ends: of the first pole, and of the unity-gain bandwidth
RAMP = (0.2, 0.5)  # of a large step: where its slope is measured


@dataclass(frozen=True, slots=True)
class OpAmpFigures(Result):
    """An op-amp with its figures, and where they come from; empty of another package."""

    VIEW = "taction.verification.report.views.opamp_view:view"
    DOCUMENT = "taction.verification.report.documents.plain:ShowDocument.of"

    opamp: OpAmp = field(repr=False)
    origins: Mapping[str, Origin] = field(repr=False)

    @classmethod
    def of(cls, opamp: OpAmp) -> OpAmpFigures:
        """Return an op-amp with the sources of its figures."""
        return cls(opamp, figure_origins(opamp.name))


@dataclass(frozen=True, slots=True, eq=False)
class Bode:
    """The open-loop gain ``response`` (P,) at `frequency` (P,), Hz."""

    frequency: Floats
    response: Complexes

    def crossing(self) -> tuple[float, float]:
        """Return the frequency of unity gain, Hz, and the phase margin, degrees.

        Gain and phase are cubic splines over the logarithm of the frequency; of several crossings
        the first counts.
        """
        from scipy.interpolate import CubicSpline
        from scipy.optimize import brentq

        place, size = np.log(self.frequency), np.log(np.abs(self.response))
        k = int(np.flatnonzero(size < 0.0)[0])
        gain = CubicSpline(place, size)
        root = float(brentq(lambda x: float(gain(x)), place[k - 1], place[k], xtol=1e-12))
        phase = CubicSpline(place, np.unwrap(np.angle(self.response)))
        return math.exp(root), 180.0 + math.degrees(float(phase(root)))


def open_loop(opamp: OpAmp) -> Bode:
    """Return the open-loop gain as stated, from below the first pole to above unity gain."""
    finite = math.isfinite(opamp.gbw)
    low, high = (opamp.first_pole, unity_gain_bandwidth(opamp)) if finite else (1.0, 1e6)
    frequency = np.geomspace(BELOW * low, ABOVE * high, POINTS)
    response = np.full(POINTS, complex(opamp.dc_gain))
    for pole in (opamp.first_pole, opamp.second_pole):
        response = response / (1.0 + 1j * frequency / pole)
    return Bode(frequency, response)


def slope(time: Floats, volts: Floats, low: float, high: float) -> float:
    """Return the mean slope of a rising voltage between two levels, V/s, each reached for good."""
    ends = [1 + int(np.flatnonzero(volts < level)[-1]) for level in (low, high)]
    begin, end = (
        float(np.interp(level, volts[k - 1 : k + 1], time[k - 1 : k + 1]))
        for level, k in zip((low, high), ends, strict=True)
    )
    return (high - low) / (end - begin)
