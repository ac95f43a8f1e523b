"""Characterise an op-amp: the figures of its macromodel on test benches.

Of a vendor's netlist the same benches give the figures and a linear model, all by simulation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.analysis import Band
from taction.spice_models.foreign_devices import RefusedError
from taction.spice_models.foreign_netlist import read_subcircuit
from taction.spice_models.imported import Figures, ImportedOpAmp, LinearModel, check_pins
from taction.spice_models.opamp import OpAmp, phase_margin, unity_gain_bandwidth
from taction.system.array_types import Complexes, Floats
from taction.system.errors import Complaint, InputError
from taction.system.foreign_files import MEGABYTE, UnusableFileError, read_bounded
from taction.verification.characterise.bench import Bench, VendorBench
from taction.verification.characterise.rational_fit import fit_together, has_aaa
from taction.verification.characterise.witnesses import Responses, Simulation, Witness, frequencies
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
BELOW, ABOVE = (
    0.01,
    100.0,
)  # of the first pole, and of the unity-gain bandwidth: the ends of a Bode plot
NOISE = Band(990.0, 1, 115)  # 990 to 1010 Hz
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
    band = Band(BELOW * low, math.ceil(decades * DENSITY), DENSITY)
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
        quiet = replace(_linear(opamp), current_noise=0.0)
        density = witness.noise(Bench(quiet), NOISE)
        found["voltage_noise"] = (density, opamp.voltage_noise)
    return tuple(Measured(name, UNITS[name], *found[name]) for name in UNITS if name in found)


def _limits(opamp: OpAmp, witness: Witness) -> dict[str, tuple[float, float]]:
    """Measure slew rate, swing and largest output current; pairs of measured and stated."""
    supply = supply_of(opamp)
    limited, swing = replace(_linear(opamp), large_signal=True), opamp.swing(supply)
    rise, step = _rise(opamp), STEP * swing
    time, volts = large_step(opamp, witness)
    begin, end = (_reached(time, volts, share * step) for share in RAMP)
    found = {"slew_rate": ((RAMP[1] - RAMP[0]) * step / (end - begin), opamp.slew_rate)}
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


GOOD = 1e-3  # largest relative error of a linear model that serves as a witness
REACH = 30.0  # the highest fitted frequency, in unity-gain bandwidths
LARGEST = 4 * MEGABYTE
# What a pin and its trace add anyway: an input admittance is compared with itself and these.
PIN_FARADS, PIN_SIEMENS = 1e-12, 1e-9


def import_opamp(file: str, subcircuit: str, pins: tuple[str, ...], supply: float) -> ImportedOpAmp:
    """Read, check and characterise the subcircuit of a netlist.

    Parameters
    ----------
    file : str
        The vendor's netlist.
    subcircuit : str
        Its name in the file.
    pins : tuple of str
        The role of each port, see `taction.spice_models.imported.ROLES`.
    supply : float
        Of each supply voltage, V.

    Raises
    ------
    InputError
        The file cannot be read, a card is not accepted (with its line), or the pins do not fit.
    SimulationError
        ngspice is missing, or does not simulate the model.
    """
    try:
        checked = read_subcircuit(read_bounded(file, LARGEST), subcircuit, "m")
    except (UnusableFileError, RefusedError) as error:
        raise InputError(file, Complaint("netlist", "", str(error))) from None
    try:
        check_pins(pins, checked.ports)
    except ValueError as error:
        raise InputError(file, Complaint("--pins", ",".join(pins), str(error))) from None
    measured = Simulation(find_simulator()).responses(VendorBench(checked, pins, supply))
    figures = _figures(file, measured)
    linear, missing = _linear_model(measured, figures)
    return ImportedOpAmp(checked, pins, supply, figures, linear, missing)


def _figures(file: str, measured: Responses) -> Figures:
    """Read the figures of a data sheet from the response."""
    f, size = measured.frequencies, np.abs(measured.gain)
    below = np.flatnonzero(size < 1.0)
    if measured.gain[0].real < 0.0:
        text = "the gain is negative: exchange the roles inp and inn"
        raise InputError(file, Complaint("--pins", "", text))
    if size[0] <= 1.0 or not below.size:
        text = f"the gain is {size[0]:.4g} at {f[0]:g} Hz and never crosses 1: are the pins right?"
        raise InputError(file, Complaint("--pins", "", text))
    unity, margin = Bode(f, measured.gain).crossing()
    return Figures(
        dc_gain=float(size[0]),
        unity_gain_bandwidth=unity,
        phase_margin=margin,
        output_resistance=float(np.abs(measured.impedance[below[0]])),
        supply_current=max(measured.supply_current, 0.0),
    )


def _linear_model(measured: Responses, figures: Figures) -> tuple[LinearModel | None, str]:
    """Return the linear model, or None and the reason."""
    if not has_aaa():
        return None, "no linear model: this SciPy has no AAA; 1.15 or newer has it"
    f = measured.frequencies
    used = f <= REACH * figures.unity_gain_bandwidth
    responses = measured.gain[used], measured.impedance[used]
    (gain, impedance), (gain_error, impedance_error) = fit_together(f[used], responses)
    conductance, capacitance, input_error = _input(f[used], measured.admittance[used])
    errors = {"gain": gain_error, "output impedance": impedance_error, "input": input_error}
    worst = max(errors, key=errors.__getitem__)
    if errors[worst] > GOOD:
        return None, (
            f"no stable linear model: its {worst} is {100.0 * errors[worst]:.2g} % from the"
            f" simulated one, more than {100.0 * GOOD:g} %"
        )
    if not impedance.constant > 0.0:
        return None, "no linear model: the output has no resistance at high frequencies"
    return LinearModel(
        gain=gain,
        impedance=impedance,
        conductance=conductance,
        capacitance=capacitance,
        offset=-measured.inverting,
        rest=measured.output,
        bias_current=measured.bias_current,
        error=errors[worst],
        band=(float(f[0]), float(f[used][-1])),
    ), ""


def _input(f: Floats, admittance: Complexes) -> tuple[float, float, float]:
    """Return conductance, capacitance and the relative error of the two for an admittance."""
    s = 2j * np.pi * f
    size = np.abs(admittance) + PIN_SIEMENS + np.abs(s) * PIN_FARADS
    matrix = np.stack([np.ones_like(s), s], axis=1) / size[:, None]
    wanted = admittance / size
    scale = np.abs(matrix).max(axis=0)
    stacked = np.concatenate([(matrix / scale).real, (matrix / scale).imag])
    found = np.linalg.lstsq(stacked, np.concatenate([wanted.real, wanted.imag]), rcond=None)[0]
    conductance, capacitance = np.maximum(found / scale, 0.0).tolist()
    model = conductance + s * capacitance
    return conductance, capacitance, float(np.max(np.abs(model - admittance) / size))
