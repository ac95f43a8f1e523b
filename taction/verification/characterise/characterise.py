"""Characterise an op-amp: the figures of its macromodel on test benches."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from taction.netlist_gen.analysis import NoiseBand
from taction.spice_models.opamp import OpAmp, phase_margin, unity_gain_bandwidth
from taction.spice_models.presets import Origin, figure_origins
from taction.system.array_types import Complexes, Floats
from taction.system.errors import SimulationError
from taction.system.progress import Notice, Progress
from taction.system.results import Result
from taction.verification.characterise.bench import Bench
from taction.verification.characterise.witnesses import (
    Equations,
    Simulation,
    Witness,
    frequencies,
)
from taction.verification.engines.ngspice.executable import find_simulator

UNITS = {
    "dc_gain": "",
    "unity_gain_bandwidth": "Hz",
    "phase_margin": "degrees",
    "slew_rate": "V/s",
    "swing": "V",
    "output_current": "A",
    "offset_voltage": "V",
    "voltage_noise": "V/rtHz",
}
"""The figures that are measured, and their units."""
DENSITY = 50  # frequencies per decade
# Ends of a Bode plot: of the first pole, and of the unity-gain bandwidth.
BELOW, ABOVE = 0.01, 100.0
NOISE = NoiseBand(990.0, 1, 115)  # 990 to 1010 Hz
STEP = 0.8  # of the swing: the step of a follower that slews
RAMP = (0.2, 0.5)  # of that step: where its slope is measured
SHORT = 1e-3  # ohm: the load that takes the largest current
OVERDRIVE = 20.0  # ranges of the input stage: the input of an open loop at its limits
SETTLED = 8.0  # periods of the unity-gain bandwidth: a follower's small step
SMALL = 1e-3  # V: that step


@dataclass(frozen=True, slots=True)
class Measured:
    """One figure.

    Attributes
    ----------
    name, unit : str
        A key of `UNITS`, and its unit.
    value : float
        As measured.
    stated : float
        What the model states.
    """

    name: str
    unit: str
    value: float
    stated: float


@dataclass(frozen=True, slots=True)
class OpAmpFigures(Result):
    """An op-amp, measured on test benches.

    Attributes
    ----------
    origins : mapping of str to Origin
        Where the stated figures come from; empty for an op-amp of another package.
    witnesses : mapping of str to Witness
        What solves the test benches.
    results : mapping of str to tuple of Measured
        Stated and measured figures of each of them.
    """

    VIEW = "taction.verification.report.views.opamp:view"
    DOCUMENT = "taction.verification.report.documents.plain:ShowDocument.of"

    opamp: OpAmp = field(repr=False)
    origins: Mapping[str, Origin] = field(repr=False)
    witnesses: Mapping[str, Witness] = field(repr=False)
    results: Mapping[str, tuple[Measured, ...]] = field(repr=False)


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

        place = np.log(self.frequency)
        gain = CubicSpline(place, np.log(np.abs(self.response)))
        phase = CubicSpline(place, np.unwrap(np.angle(self.response)))
        k = int(np.flatnonzero(np.abs(self.response) < 1.0)[0])
        root = float(brentq(lambda x: float(gain(x)), place[k - 1], place[k], xtol=1e-12))
        return math.exp(root), 180.0 + math.degrees(float(phase(root)))


def bode(opamp: OpAmp, witness: Witness) -> Bode:
    """Return the open-loop gain from far below the first pole to far above unity gain."""
    finite = math.isfinite(opamp.gbw)
    low, high = (opamp.first_pole, unity_gain_bandwidth(opamp)) if finite else (1.0, 1e6)
    decades = math.log10(ABOVE * high / (BELOW * low))
    band = NoiseBand(BELOW * low, math.ceil(decades * DENSITY), DENSITY)
    bench = Bench(_linear(opamp), follower=False)
    return Bode(frequencies(band), witness.response(bench, band))


def characterise(opamp: OpAmp, witness: Witness) -> tuple[Measured, ...]:
    """Measure the figures of an op-amp that its macromodel has.

    Small signals are measured on the open loop, the slew rate, the offset and the noise on a
    follower. The supply is the largest that the part allows, ±15 V at most.

    Raises
    ------
    SimulationError, EngineError
        A run gave no result.

    Examples
    --------
    >>> from taction.netlist_gen.scene.open_tables import OPAMPS
    >>> from taction.verification.characterise.witnesses import Equations
    >>> figures = characterise(OPAMPS["ua741"], Equations())
    >>> [round(f.value / f.stated, 4) for f in figures if f.name == "unity_gain_bandwidth"]
    [1.0]
    """
    opened = bode(opamp, witness)
    found = {"dc_gain": (float(abs(opened.response[0])), opamp.dc_gain)}
    if math.isfinite(opamp.gbw):
        crossing = opened.crossing()
        found["unity_gain_bandwidth"] = (crossing[0], unity_gain_bandwidth(opamp))
        found["phase_margin"] = (crossing[1], phase_margin(opamp))
    if math.isfinite(opamp.input_range):
        found |= _limits(opamp, witness)
    if opamp.offset_voltage:
        only = replace(_linear(opamp), input_errors=True, bias_current=0.0, offset_current=0.0)
        found["offset_voltage"] = (witness.rest(Bench(only)), opamp.offset_voltage)
    if opamp.voltage_noise:
        quiet = replace(_linear(opamp), current_noise=0.0, voltage_noise_corner=None)
        density = witness.noise(Bench(quiet), NOISE)
        found["voltage_noise"] = (density, opamp.voltage_noise)
    return tuple(Measured(name, UNITS[name], *found[name]) for name in UNITS if name in found)


def opamp_figures(opamp: OpAmp, progress: Progress) -> OpAmpFigures:
    """Measure an op-amp by our own equations and, where it is installed, by ngspice.

    `progress` receives the witness that measures, and a line if ngspice is missing.
    """
    witnesses: dict[str, Witness] = {"state space": Equations()}
    try:
        witnesses["ngspice"] = Simulation(find_simulator())
    except SimulationError as error:
        progress(Notice(f"without ngspice: {error}"))
    results = {}
    for number, (title, each) in enumerate(witnesses.items(), 1):
        progress(f"test benches by {title}, {number} of {len(witnesses)}")
        results[title] = characterise(opamp, each)
    return OpAmpFigures(opamp, figure_origins(opamp.name), witnesses, results)


def _limits(opamp: OpAmp, witness: Witness) -> dict[str, tuple[float, float]]:
    """Measure slew rate, swing and largest output current; pairs of measured and stated."""
    supply = supply_of(opamp)
    limited, swing = replace(_linear(opamp), large_signal=True), opamp.swing(supply)
    rise, step = _rise(opamp), STEP * swing
    time, volts = large_step(opamp, witness)
    rate = slope(time, volts, RAMP[0] * step, RAMP[1] * step)
    found = {"slew_rate": (rate, opamp.slew_rate)}
    driven = Bench(limited, supply, follower=False, step=OVERDRIVE * opamp.input_range)
    found["swing"] = (float(witness.transient(driven, 2.0 * rise)[1][-1]), swing)
    if opamp.has_largest_current:
        shorted = replace(driven, opamp=replace(limited, limits_current=True), load=SHORT)
        amps = float(witness.transient(shorted, 2.0 * rise)[1][-1]) / SHORT
        found["output_current"] = (amps, opamp.output_current)
    return found


def _reached(time: Floats, volts: Floats, level: float) -> float:
    """Return the instant at which a rising voltage reaches a level for good, s.

    At the start the input's capacitance may push the output beyond it.
    """
    k = 1 + int(np.flatnonzero(volts < level)[-1])
    return float(np.interp(level, volts[k - 1 : k + 1], time[k - 1 : k + 1]))


def slope(time: Floats, volts: Floats, low: float, high: float) -> float:
    """Return the mean slope of a rising voltage between two levels, V/s."""
    return (high - low) / (_reached(time, volts, high) - _reached(time, volts, low))


def large_step(opamp: OpAmp, witness: Witness) -> tuple[Floats, Floats]:
    """Return instants, s, and the output, V, of a follower with a step of `STEP` of the swing."""
    supply = supply_of(opamp)
    limited = replace(_linear(opamp), large_signal=True)
    return witness.transient(Bench(limited, supply, step=STEP * opamp.swing(supply)), _rise(opamp))


def _rise(opamp: OpAmp) -> float:
    """Return a time in which an output rises to its swing, s."""
    return 2.0 * opamp.swing(supply_of(opamp)) / opamp.slew_rate + SETTLED / opamp.gbw


def supply_of(opamp: OpAmp) -> float:
    """Return the supply of the test benches, ±V: 15 V, or the largest that the part allows."""
    return min(15.0, opamp.most_supply)


def step_response(opamp: OpAmp, witness: Witness) -> tuple[Floats, Floats]:
    """Return instants, s, and the response of a follower to a small step, as parts of the step."""
    stop = SETTLED / unity_gain_bandwidth(opamp) if math.isfinite(opamp.gbw) else 1e-6
    time, volts = witness.transient(Bench(_linear(opamp), step=SMALL), stop)
    return time, volts / SMALL


def _linear(opamp: OpAmp) -> OpAmp:
    return replace(opamp.small_signal, input_errors=False)
