"""Characterise a vendor's netlist: the figures of a data sheet, and a linear model.

The bench holds the operating point of a follower with an open loop: the voltage of the inverting
input is that of a node which follows the output with a time constant of 1e15 s.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from taction.netlist_gen.analysis import SimulatedDeck, Transient
from taction.netlist_gen.deck.flat_cards import CardError, circuit_of
from taction.netlist_gen.deck.foreign_deck import flat_subcircuit, vendor_subcircuit
from taction.spice_models.branches import Branch
from taction.spice_models.imported import (
    COMPENSATION,
    DEVICE,
    Figures,
    ImportedOpAmp,
    LinearModel,
    Subcircuit,
    check_pins,
    instance,
    port_nodes,
)
from taction.system.array_types import Complexes, Floats
from taction.system.errors import (
    Complaint,
    DidNotLoad,
    EngineError,
    InputError,
    SimulationError,
    one_line,
)
from taction.system.quantities import show_rate
from taction.system.results import Result
from taction.verification.characterise.operating_point import DeckPoint, find_point, linear_flat
from taction.verification.engines.ngspice.process import find_simulator, simulate
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.stability.poles import poles
from taction.verification.studies.decks.witnesses import LIMIT, compare_ac

OUT = "out"
DRIVEN = ("vdrive", "vinp", "iload")  # inverting input, other input, output
PORTS = (OUT, "inn", "of_inn", "of_inp")
"""What is read: V, and A into the inputs."""
SWITCHED = ".options reltol=1e-3 method=gear gmin=1e-9 abstol=1e-9 vntol=1e-4"  # for large steps
CLAMPED = 100.0  # ohm, between the source of a large step and diodes at the input
LOAD = 10e3  # ohm, at the largest output
EDGE = 1e-3  # of the period of large steps: a jump in no time stops many a vendor's model
POINTS = 2000  # of a transient
TIMEOUT = 30.0  # s, of one run of ngspice
SWEEP = f"ac dec 40 1e-3 {1e10 * (1.0 + 1e-9)!r}"  # rounding could leave out the last frequency


@dataclass(frozen=True, slots=True)
class VendorBench:
    """A vendor's subcircuit on its bench."""

    subcircuit: Subcircuit
    pins: tuple[str, ...]  # the role of each port
    supply: float  # of each supply voltage, V
    compensation: float = 0.0  # capacitor between the ports `comp`, F

    def lines(self, step: str = "") -> list[str]:
        """Return the cards; with a `step` of the non-inverting input the output has a load."""
        return [
            *self.subcircuit.lines,
            f"Vcc vcc 0 dc {self.supply!r}",
            f"Vee vee 0 dc {-self.supply!r}",
            f"Vinp {'far' if step else 'inp'} 0 dc 0.0 ac 0.0 {step}".rstrip(),
            instance(self.subcircuit, self.pins, self.compensation),
            *("Gslow 0 slow out 0 1e-6", "Rslow slow 0 1e6", "Cslow slow 0 1e9"),
            "Eservo inn drive slow 0 1.0",
            "Vdrive drive 0 dc 0.0 ac 0.0",
            "Iload 0 out dc 0.0 ac 0.0",
            *([f"Rload out 0 {LOAD!r}", f"Rstep far inp {CLAMPED!r}"] if step else []),
            *("Hof_inn of_inn 0 Vdrive -1.0", "Hof_inp of_inp 0 Vinp -1.0"),
            "Hof_vcc of_vcc 0 Vcc -1",
        ]

    def switched(self, volts: float, period: float) -> tuple[Floats, Floats]:
        """Return instants, s, and the output, V, for +, -, + `volts`, each for a `period`, s."""
        levels = itertools.pairwise((0.0, volts, -volts, volts))
        points = (
            f"{k * period!r} {before!r} {(k + EDGE) * period!r} {after!r}"
            for k, (before, after) in enumerate(levels)
        )
        plan = Transient(3.0 * period, period / POINTS, initial="rest")
        run = f".tran {plan.max_step!r} {plan.stop!r} 0.0 {plan.max_step!r}"
        cards = ["* bench of an imported op-amp", *self.lines(f"pwl({' '.join(points)})")]
        text = "\n".join([*cards, SWITCHED, f".save v({OUT})", run, ".end", ""])
        wave = simulate(SimulatedDeck(text, (OUT,), plan), find_simulator(), timeout=TIMEOUT)
        return wave.time, wave[OUT]


@dataclass(frozen=True, slots=True, eq=False)
class Responses:
    """What a vendor's subcircuit shows on its bench."""

    frequencies: Floats  # (P,), Hz
    every: Complexes  # (3, 4, P): `PORTS` for 1 V or 1 A of each of `DRIVEN`
    # At rest: output and inverting input, V, currents into the inverting input and the other one,
    # and that of the supply, A.
    rest: tuple[float, ...]

    @property
    def gain(self) -> Complexes:
        """Open-loop gain from the inverting input, (P,)."""
        return np.asarray(-self.every[0, 0] / self.every[0, 1])

    @property
    def admittances(self) -> tuple[Complexes, Complexes, Complexes]:
        """Of the inverting input, S, that of the other, and the other's current for 1 V here."""
        of_inn, of_inp = self.every[0, 2:] / self.every[0, 1]
        return of_inn, self.every[1, 3], of_inp


def respond(point: DeckPoint) -> Responses:
    """Return operating point and small signals of a bench at the `point` that was found of it."""
    each_driven = [{source: 1.0} for source in DRIVEN]
    driven, said = point.small_signals(each_driven, [SWEEP])
    if not driven:
        raise SimulationError(f"ngspice does not simulate the model: {said}")
    volts = [point.volts[node] for node in (*PORTS, "of_vcc")]
    every = np.array([[each[f"v({port})"] for port in PORTS] for each in driven])
    frequencies = driven[0]["frequency"].real  # as ngspice rounded them
    return Responses(frequencies, every, tuple(volts))


GOOD = 1e-4  # largest relative difference from ngspice of a linear model that serves as a witness
BENCH = (*DRIVEN, "gslow", "rslow", "cslow", "eservo", "hof_inn", "hof_inp", "hof_vcc")
JUMP = 2.0  # of the gain between two neighbouring frequencies, 6 % apart: no op-amp
CURRENT_FEEDBACK = (1e-4, 100.0)  # S of the inverting input, and ratio to the other one
AT_REST = 0.1  # V: output of a follower at 0 V
COMMON_MODE = 1e-7  # relative difference of both gains: less is rounding
DRIVE = 2.0  # V, at most half of the supply: input of an open loop that is driven to its ends
PERIODS, LONGER, ATTEMPTS = 300.0, 8.0, 4  # of the unity-gain bandwidth, in such a record
RAMP = (0.2, 0.5)  # of the supply: where the slope of an output without a limit is measured
MIDDLE = 0.4  # of the smaller end: between these levels of both signs the slope is measured
BEYOND = 1.01  # of the supply: an output above it has no limit
ENDED = 0.01  # of the supply: an output that changes by less in a tenth of the record has ended
SLEWS = 0.8  # of `DRIVE`: with a larger range of its input stage an op-amp does not slew
INPUT_HERTZ = 1e3  # where the capacitances of the inputs are read
LEAST_SIEMENS, LEAST_FARADS = 1e-16, 1e-16  # of an input: less is rounding


@dataclass(frozen=True, slots=True)
class ImportedModel(Result):
    """The results of `taction.import_model`: the file, and what it holds."""

    VIEW = "taction.verification.report.views.opamp_view:imported_view"
    DOCUMENT = "taction.verification.report.documents.plain:ImportDocument.of"

    file: str
    model: Mapping[str, Any] = field(repr=False)


def import_opamp(
    file: str, subcircuit: str, pins: tuple[str, ...], supply: float, compensation: float = 0.0
) -> ImportedOpAmp:
    """Read, check and characterise a subcircuit, as `taction.import_model` does."""
    found = vendor_subcircuit(file, subcircuit)
    try:
        check_pins(pins, found.ports)
    except ValueError as error:
        raise InputError(file, Complaint("--pins", ",".join(pins), str(error))) from None
    if (COMPENSATION in pins) != (compensation > 0.0):
        text = f"a capacitor and two ports {COMPENSATION!r} belong together"
        raise InputError(file, Complaint("--compensation", f"{compensation:g} F", text))
    bench = VendorBench(found, pins, supply, compensation)
    try:
        cards = find_point(bench.lines()).cards
        bench = replace(bench, subcircuit=flat_subcircuit(cards, port_nodes(pins), subcircuit))
        point = find_point(bench.lines(), modes=("",), volts=True)
    except (CardError, DidNotLoad) as error:
        raise InputError(file, Complaint("netlist", "", one_line(error))) from None
    seen = respond(point)
    if reason := _no_opamp(seen):
        raise InputError(file, Complaint("--pins", "", reason))
    figures, doubts = _figures(seen, bench)
    try:
        linear, missing = _linear_model(point, seen.frequencies), ""
    except (CardError, EngineError, SimulationError) as error:
        said = re.sub(rf"\b{DEVICE}\.\w\.(?={DEVICE}\.)", "", one_line(error))
        linear, missing = None, f"no linear model: {said}"
    of_circuit = (figures, linear, missing, compensation, tuple(doubts))
    return ImportedOpAmp(bench.subcircuit, pins, supply, *of_circuit)


def _no_opamp(measured: Responses) -> str:
    """Return why the responses cannot be those of an op-amp; empty if they can."""
    f, gain, size = measured.frequencies, measured.gain, np.abs(measured.gain)
    least, ratio = CURRENT_FEEDBACK
    one, other, _ = (abs(each[0]) for each in measured.admittances)
    if not (np.isfinite(gain).all() and np.isfinite(measured.every[2, 0]).all()):
        return "the response is not finite: are the pins right?"
    if one > max(least, ratio * other):
        return (
            f"this is a current-feedback amplifier: its inverting input has {1.0 / one:.3g} ohm,"
            f" the other one {1.0 / max(other, 1e-15):.3g} ohm. A board needs an op-amp"
        )
    if gain[0].real < 0.0:
        return "the gain is negative: exchange the roles inp and inn"
    if size[0] <= 1.0 or not np.any(size < 1.0):
        return (
            f"the gain is {size[0]:.4g} at {f[0]:g} Hz and never crosses 1 up to {f[-1]:.2g} Hz:"
            " are the pins right, or does it need a compensation capacitor?"
        )
    if abs(measured.rest[0]) > AT_REST:
        return f"as a follower at 0 V its output rests at {measured.rest[0]:.3g} V"
    steps = np.abs(np.diff(np.log(size[: int(np.argmax(size < 1.0)) + 1])))
    if steps.max() <= math.log(JUMP):
        return ""
    k = int(np.argmax(steps))
    sizes, ends = f"{size[k]:.3g} to {size[k + 1]:.3g}", f"{f[k]:.4g} and {f[k + 1]:.4g} Hz"
    return f"the gain jumps from {sizes} between {ends}"


def _figures(measured: Responses, bench: VendorBench) -> tuple[Figures, list[str]]:
    """Return the figures of a data sheet, and why one of them is missing.

    Both inputs are driven by sources, so the current into the one that is held goes between them.
    """
    f, size, opened = measured.frequencies, np.abs(measured.gain), measured.gain
    unity, margin = _crossing(f, opened)
    _, inverting, into_inn, into_inp, supplied = measured.rest
    common = abs(measured.every[1, 0, 0] / opened[0] - 1.0)
    slew_rate = swing = None
    doubts = list[str]()
    try:
        slew_rate, swing = _ends(bench, unity)
    except SimulationError as error:
        doubts.append(f"slew rate and swing are not known: {one_line(error)}")
    own, _, across = measured.admittances
    k, inputs = int(np.argmin(np.abs(f - INPUT_HERTZ))), dict[str, float | None]()
    for name, admittance in (("differential", -across), ("common", own + across)):
        siemens, farads = float(admittance[0].real), float(admittance[k].imag / (math.tau * f[k]))
        inputs[f"{name}_resistance"] = 1.0 / siemens if siemens > LEAST_SIEMENS else None
        inputs[f"{name}_capacitance"] = farads if farads > LEAST_FARADS else None
    return Figures(
        dc_gain=float(size[0]),
        unity_gain_bandwidth=unity,
        phase_margin=margin,
        output_resistance=float(abs(measured.every[2, 0, np.flatnonzero(size < 1.0)[0]])),
        supply_current=max(supplied, 0.0),
        offset_voltage=inverting,
        bias_current=0.5 * (into_inn + into_inp),
        offset_current=into_inp - into_inn,
        common_mode_rejection=-20.0 * math.log10(common) if common > COMMON_MODE else None,
        slew_rate=slew_rate,
        swing=swing,
        **inputs,
    ), doubts


def _crossing(frequency: Floats, response: Complexes) -> tuple[float, float]:
    """Return the frequency of unity gain, Hz, and the phase margin, degrees.

    Gain and phase are cubic splines over the logarithm of the frequency; of several crossings the
    first counts.
    """
    from scipy.interpolate import CubicSpline

    place = np.log(frequency)
    root = float(CubicSpline(place, np.log(np.abs(response))).roots(extrapolate=False)[0])
    phase = CubicSpline(place, np.unwrap(np.angle(response)))
    return math.exp(root), 180.0 + math.degrees(float(phase(root)))


def slope(time: Floats, volts: Floats, low: float, high: float) -> float:
    """Return the mean slope of a rising voltage between two levels, V/s, each reached for good."""
    ends = [1 + int(np.flatnonzero(volts < level)[-1]) for level in (low, high)]
    begin, end = (
        float(np.interp(level, volts[k - 1 : k + 1], time[k - 1 : k + 1]))
        for level, k in zip((low, high), ends, strict=True)
    )
    return (high - low) / (end - begin)


def _ends(bench: VendorBench, unity: float) -> tuple[float | None, float | None]:
    """Return slew rate, V/s, and swing, V, of an open loop that is driven to both ends.

    None: the netlist has no such limit.
    """
    supply, drive, period = bench.supply, min(DRIVE, 0.5 * bench.supply), PERIODS / unity
    for attempt in range(ATTEMPTS):
        time, output = bench.switched(drive, period * LONGER**attempt)
        share = 3.0 * time / time[-1]  # of the three levels
        before, ends = (np.interp((k, 1.0 + k, 2.0 + k), share, output) for k in (0.9, 1.0))
        beyond = bool(np.abs(output).max() > BEYOND * supply)
        if beyond or np.abs(ends - before).max() < ENDED * supply:
            break
    swing = float(min(ends[0], -ends[1]))
    if beyond:  # the netlist does not know its supplies
        rates = [slope(time, output, RAMP[0] * supply, RAMP[1] * supply)]
    elif swing > 0.0:
        parts = ((share >= 1.0) & (share <= 2.0), -1.0), (share >= 2.0, 1.0)  # it falls, and rises
        rates = [slope(time[part], sign * output[part], -MIDDLE * swing, MIDDLE * swing)
                 for part, sign in parts]  # fmt: skip
    else:
        raise SimulationError("the output does not change its sign")
    slews = min(rates) < SLEWS * math.tau * unity * drive
    return (min(rates) if slews else None), (None if beyond else swing)


def _linear_model(point: DeckPoint, f: Floats) -> LinearModel:
    """Return the cards of an op-amp, each measured where it rests; `CardError` without a model."""
    flat = linear_flat(point)
    if moving := [part.card for part in flat.sources if part.step]:
        raise CardError(f"{moving[0]} changes over time")
    held = [  # both inputs; 1 GF of the servo hides other poles
        replace(part, value=0.0) if part.card.lower() == "eservo" else part
        for part in flat.parts
        if part.card.lower() != "cslow"
    ]
    found = poles(LinearBoard(circuit_of(replace(flat, parts=held), "bench", (OUT,))))
    if found.known_unstable:
        raise CardError(f"the netlist itself has a pole at {show_rate(found.rightmost.real)}")
    bench = LinearBoard(circuit_of(flat, "bench", (OUT,)))
    check = compare_ac(point, bench, found.poles, flat.absent)
    if check.value is None or not check.value <= GOOD:
        raise CardError(f"it differs from the small signal of ngspice: {check.reason}")
    # the op-amp with its supplies: the bench without what drives it
    own = (part for part in flat.parts if part.card.lower() not in BENCH)
    parts = (Branch(p.letter, p.name, p.a, p.b, p.value, p.control) for p in own)
    return LinearModel(tuple(parts), max(check.value, LIMIT), (float(f[0]), float(f[-1])))
