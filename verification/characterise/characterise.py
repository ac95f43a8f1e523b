"""Characterise an op-amp: the figures of its macromodel on test benches.

Of a vendor's netlist the same benches give the figures and a linear model, all by simulation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from taction.netlist_gen.analysis import NoiseBand
from taction.spice_models.foreign_devices import RefusedError
from taction.spice_models.foreign_netlist import read_subcircuit
from taction.spice_models.imported import (
    COMPENSATION,
    Figures,
    ImportedOpAmp,
    LinearModel,
    Rational,
    check_pins,
)
from taction.spice_models.opamp import OpAmp, phase_margin, unity_gain_bandwidth
from taction.spice_models.presets import Origin, figure_origins
from taction.system.array_types import Complexes, Floats
from taction.system.errors import Complaint, InputError, SimulationError
from taction.system.foreign_files import MEGABYTE, UnusableFileError, read_bounded
from taction.system.progress import Notice, Progress
from taction.system.results import Result
from taction.verification.characterise.bench import Bench, VendorBench
from taction.verification.characterise.rational_fit import fit_rational, fit_together, has_aaa
from taction.verification.characterise.witnesses import (
    Equations,
    Responses,
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
BELOW, ABOVE = (
    0.01,
    100.0,
)  # of the first pole, and of the unity-gain bandwidth: the ends of a Bode plot
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


@dataclass(frozen=True, slots=True)
class ImportedModel(Result):
    """The results of `taction.import_model`: the file, and what it holds."""

    VIEW = "taction.verification.report.views.opamp:imported_view"
    DOCUMENT = "taction.verification.report.documents.plain:ImportDocument.of"

    file: str
    model: Mapping[str, Any] = field(repr=False)


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
    rate = _slope(time, volts, RAMP[0] * step, RAMP[1] * step)
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
LEAST_OHMS = 1e-3  # of an output: less is taken for this
# What a pin and its trace add anyway: an input admittance is compared with itself and these.
PIN_FARADS, PIN_SIEMENS = 1e-12, 1e-9


def import_opamp(
    file: str,
    subcircuit: str,
    pins: tuple[str, ...],
    supply: float,
    compensation: float = 0.0,
    middle: float = 0.0,
) -> ImportedOpAmp:
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
        Of each supply voltage, V; `middle` + and - `supply`.
    compensation : float
        Capacitor between the two ports with the role ``comp``, F.
    middle : float
        Of the supplies, V: where inputs and output are measured.

    Raises
    ------
    InputError
        The file cannot be read, a card is not accepted (with its line), the pins do not fit, or
        what is measured is no op-amp.
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
    if (COMPENSATION in pins) != (compensation > 0.0):
        text = f"a capacitor and two ports {COMPENSATION!r} belong together"
        raise InputError(file, Complaint("--compensation", f"{compensation:g} F", text))
    simulation = Simulation(find_simulator())
    measured = simulation.responses(VendorBench(checked, pins, supply, compensation, middle=middle))
    if reason := _no_opamp(measured):
        raise InputError(file, Complaint("--pins", "", reason))
    figures, doubts = _figures(measured, simulation)
    linear, missing = _linear_model(measured, figures)
    return ImportedOpAmp(
        checked,
        pins,
        supply,
        figures,
        linear,
        missing,
        compensation,
        (*doubts, *_doubts(figures)),
        middle,
    )


JUMP = 2.0  # of the gain between two neighbouring frequencies, 6 % apart: no op-amp
CURRENT_FEEDBACK = (1e-4, 100.0)  # S of the inverting input, and ratio to the other one
AT_REST = 0.1  # V: output of a follower at 0 V
COMMON_MODE = 1e-7  # relative difference of both gains: less is rounding
DRIVE = 2.0  # V, at most half of the supply: input of an open loop that is driven to its ends
PERIODS, LONGER, ATTEMPTS = 300.0, 8.0, 4  # of the unity-gain bandwidth, in such a record
MIDDLE = 0.4  # of the smaller end: between these levels of both signs the slope is measured
BEYOND = 1.01  # of the supply: an output above it has no limit
ENDED = 0.01  # of the supply: an output that changes by less in a tenth of the record has ended
SLEWS = 0.8  # of `DRIVE`: with a larger range of its input stage an op-amp does not slew
USUAL = {
    "dc_gain": (1e3, 1e10),
    "unity_gain_bandwidth": (1e3, 1e10),
    "phase_margin": (5.0, 100.0),
    "offset_voltage": (0.0, 0.02),
    "bias_current": (0.0, 1e-4),
    "supply_current": (0.0, 0.1),
}
"""Figures of op-amps that are sold; others may be right, and are said."""


def _no_opamp(measured: Responses) -> str:
    """Return why the responses cannot be those of an op-amp; empty if they can."""
    f, gain, size = measured.frequencies, measured.gain, np.abs(measured.gain)
    least, ratio = CURRENT_FEEDBACK
    one, other = abs(measured.admittance[0]), abs(measured.other_admittance[0])
    if not (np.isfinite(gain).all() and np.isfinite(measured.impedance).all()):
        return "the response is not finite: are the pins right?"
    if one > max(least, ratio * other):
        return (
            f"this is a current-feedback amplifier: its inverting input has {1.0 / one:.3g} ohm,"
            f" the other one {1.0 / max(other, 1e-15):.3g} ohm. A board needs an op-amp"
        )
    if gain[0].real < 0.0:
        return "the gain is negative: exchange the roles inp and inn"
    below = np.flatnonzero(size < 1.0)
    if size[0] <= 1.0 or not below.size:
        return (
            f"the gain is {size[0]:.4g} at {f[0]:g} Hz and never crosses 1 up to {f[-1]:.2g} Hz:"
            " are the pins right, or does it need a compensation capacitor?"
        )
    if abs(measured.output) > AT_REST:
        place = f"{measured.bench.middle:g} V"
        output = measured.bench.middle + measured.output
        return f"as a follower at {place} its output rests at {output:.3g} V"
    steps = np.abs(np.diff(np.log(size[: below[0] + 1])))
    if steps.max() > math.log(JUMP):
        k = int(np.argmax(steps))
        return (
            f"the gain jumps from {size[k]:.3g} to {size[k + 1]:.3g} between {f[k]:.4g} and"
            f" {f[k + 1]:.4g} Hz"
        )
    return ""


def _figures(measured: Responses, simulation: Simulation) -> tuple[Figures, list[str]]:
    """Return the figures of a data sheet, and why one of them is missing."""
    size, opened = np.abs(measured.gain), Bode(measured.frequencies, measured.gain)
    unity, margin = opened.crossing()
    common = abs(measured.other_gain[0] / measured.gain[0] - 1.0)
    doubts: list[str] = []
    try:
        slew_rate, swing = _ends(measured, simulation, unity)
    except SimulationError as error:
        slew_rate = swing = None
        doubts.append(f"slew rate and swing are not known: {str(error).splitlines()[0]}")
    return Figures(
        dc_gain=float(size[0]),
        unity_gain_bandwidth=unity,
        phase_margin=margin,
        output_resistance=float(np.abs(measured.impedance[np.flatnonzero(size < 1.0)[0]])),
        supply_current=max(measured.supply_current, 0.0),
        offset_voltage=measured.inverting,
        bias_current=0.5 * (measured.into_inverting + measured.into_other),
        offset_current=measured.into_other - measured.into_inverting,
        common_mode_rejection=-20.0 * math.log10(common) if common > COMMON_MODE else None,
        slew_rate=slew_rate,
        swing=swing,
    ), doubts


def _ends(
    measured: Responses, simulation: Simulation, unity: float
) -> tuple[float | None, float | None]:
    """Return slew rate, V/s, and swing, V, of an open loop that is driven to both ends.

    None: the netlist has no such limit.
    """
    supply = measured.bench.supply
    volts, period = min(DRIVE, 0.5 * supply), PERIODS / unity
    most = SLEWS * volts * 2.0 * math.pi * unity
    for _ in range(ATTEMPTS):
        time, output = simulation.switched(measured.bench, volts, period)
        if np.abs(output).max() > BEYOND * supply:  # the netlist does not know its supplies
            rate = _slope(time, output, RAMP[0] * supply, RAMP[1] * supply)
            return (rate if rate < most else None), None
        places = np.searchsorted(time, np.array([[0.9, 1.0], [1.9, 2.0], [2.9, 3.0]]) * period) - 1
        before, ends = output[places].T
        if np.abs(ends - before).max() < ENDED * supply:
            break
        period *= LONGER
    swing = float(min(ends[0], -ends[1]))
    if not swing > 0.0:
        raise SimulationError("the output does not change its sign")
    level = MIDDLE * swing
    parts = [(time >= k * period) & (time <= (k + 1.0) * period) for k in (1.0, 2.0)]
    fall, rise = (
        _slope(time[part], sign * output[part], -level, level)
        for part, sign in zip(parts, (-1.0, 1.0), strict=True)
    )
    return (min(fall, rise) if min(fall, rise) < most else None), swing


def _slope(time: Floats, volts: Floats, low: float, high: float) -> float:
    """Return the mean slope of a rising voltage between two levels, V/s."""
    return (high - low) / (_reached(time, volts, high) - _reached(time, volts, low))


def _doubts(figures: Figures) -> list[str]:
    """Return a sentence for every figure that no op-amp has that is sold."""
    found = []
    for name, (low, high) in USUAL.items():
        value, unit = getattr(figures, name), UNITS.get(name, "A")
        if not low <= abs(value) <= high or (name == "phase_margin" and value < low):
            title = name.replace("_", " ")
            between = f"{low:g} to {high:g} {unit}".rstrip()
            found.append(f"the {title} is {value:.4g} {unit}".rstrip() + f", usual is {between}")
    return found


def _linear_model(measured: Responses, figures: Figures) -> tuple[LinearModel | None, str]:
    """Return the linear model, or None and the reason."""
    if not has_aaa():
        return None, "no linear model: this SciPy has no AAA; 1.15 or newer has it"
    f = measured.frequencies
    used = f <= REACH * figures.unity_gain_bandwidth
    responses = measured.gain[used], measured.impedance[used]
    try:
        if np.abs(responses[1]).max() < LEAST_OHMS:
            gain, gain_error = fit_rational(f[used], responses[0])
            impedance, impedance_error = (
                Rational(LEAST_OHMS, gain.poles, (0j,) * len(gain.poles)),
                0.0,
            )
        else:
            (gain, impedance), (gain_error, impedance_error) = fit_together(f[used], responses)
    except np.linalg.LinAlgError:
        return None, "no linear model: its fit failed"
    loop = np.minimum(np.abs(responses[0]), 1.0)  # above unity gain no loop is left
    conductance, capacitance, input_error = _input(f[used], measured.admittance[used], loop)
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
        bias_current=measured.into_inverting,
        error=errors[worst],
        band=(float(f[0]), float(f[used][-1])),
    ), ""


def _input(f: Floats, admittance: Complexes, weight: Floats) -> tuple[float, float, float]:
    """Return conductance, capacitance and the weighted relative error of the two."""
    s = 2j * np.pi * f
    size = (np.abs(admittance) + PIN_SIEMENS + np.abs(s) * PIN_FARADS) / weight
    matrix = np.stack([np.ones_like(s), s], axis=1) / size[:, None]
    wanted = admittance / size
    scale = np.abs(matrix).max(axis=0)
    stacked = np.concatenate([(matrix / scale).real, (matrix / scale).imag])
    found = np.linalg.lstsq(stacked, np.concatenate([wanted.real, wanted.imag]), rcond=None)[0]
    conductance, capacitance = np.maximum(found / scale, 0.0).tolist()
    model = conductance + s * capacitance
    return conductance, capacitance, float(np.max(np.abs(model - admittance) / size))
