"""Characterise a vendor's netlist: what is measured of it on the test benches, all by ngspice.

The figures of a data sheet, and a linear model that the state-space engine uses.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from taction.netlist_gen.deck.elements import CardError
from taction.netlist_gen.deck.flat_cards import Flat, circuit_of
from taction.netlist_gen.deck.vendor_subcircuit import flat_subcircuit, vendor_subcircuit
from taction.spice_models.branches import Branch
from taction.spice_models.imported import (
    COMPENSATION,
    DEVICE,
    Figures,
    ImportedOpAmp,
    LinearModel,
    check_pins,
    port_nodes,
)
from taction.system.errors import Complaint, EngineError, InputError, SimulationError, one_line
from taction.system.quantities import show_rate
from taction.system.results import Result
from taction.verification.characterise.characterise import RAMP, Bode, slope
from taction.verification.characterise.element_bench import linear_flat
from taction.verification.characterise.operating_point import DeckPoint, find_point
from taction.verification.characterise.vendor_bench import (
    DRIVEN,
    OUT,
    PORTS,
    SERVO,
    Responses,
    VendorBench,
    respond,
)
from taction.verification.engines.ngspice.executable import Simulator, find_simulator
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.stability.poles import poles
from taction.verification.studies.witnesses import small_signals

GOOD = 1e-4  # largest relative difference from ngspice of a linear model that serves as a witness
EVERY = 4  # of the measured frequencies: 10 a decade are compared
BENCH = (*DRIVEN, "vinn", "vmid", "eservo", *SERVO, "hof_inn", "hof_inp", "hof_vcc")
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
INPUT_HERTZ = 1e3  # where the capacitances of the inputs are read
LEAST_SIEMENS, LEAST_FARADS = 1e-16, 1e-16  # of an input: less is rounding
USUAL = {
    "dc_gain": (1e3, 1e10, ""),
    "unity_gain_bandwidth": (1e3, 1e10, "Hz"),
    "phase_margin": (5.0, 100.0, "degrees"),
    "offset_voltage": (0.0, 0.02, "V"),
    "bias_current": (0.0, 1e-4, "A"),
    "supply_current": (0.0, 0.1, "A"),
}
"""Figures of op-amps that are sold; others may be right, and are said."""


@dataclass(frozen=True, slots=True)
class ImportedModel(Result):
    """The results of `taction.import_model`: the file, and what it holds."""

    VIEW = "taction.verification.report.views.opamp:imported_view"
    DOCUMENT = "taction.verification.report.documents.plain:ImportDocument.of"

    file: str
    model: Mapping[str, Any] = field(repr=False)


def import_opamp(
    file: str,
    subcircuit: str,
    pins: tuple[str, ...],
    supply: float,
    compensation: float = 0.0,
    middle: float = 0.0,
) -> ImportedOpAmp:
    """Read, check and characterise the subcircuit of a netlist, as `taction.import_model` does.

    `compensation` is in F, `supply` and `middle` in V: the supply voltages are `middle` + and -
    `supply`, and inputs and output are measured at `middle`.
    """
    found = vendor_subcircuit(file, subcircuit)
    try:
        check_pins(pins, found.ports)
    except ValueError as error:
        raise InputError(file, Complaint("--pins", ",".join(pins), str(error))) from None
    if (COMPENSATION in pins) != (compensation > 0.0):
        text = f"a capacitor and two ports {COMPENSATION!r} belong together"
        raise InputError(file, Complaint("--compensation", f"{compensation:g} F", text))
    simulator, bench = find_simulator(), VendorBench(found, pins, supply, compensation, middle)
    try:
        cards = find_point(bench.lines(), "", simulator).cards
        found = flat_subcircuit(cards, port_nodes(bench.wired), subcircuit)
        bench = replace(bench, subcircuit=found)
        point = find_point(bench.lines(), "", simulator, modes=("",))
    except CardError as error:
        raise InputError(file, Complaint("netlist", "", str(error))) from None
    seen = respond(bench, point, simulator)
    if reason := _no_opamp(seen, middle):
        raise InputError(file, Complaint("--pins", "", reason))
    figures, doubts = _figures(seen, bench, simulator)
    try:
        linear, missing = _linear_model(point, seen, simulator), ""
    except (CardError, EngineError, SimulationError) as error:
        said = re.sub(rf"\b{DEVICE}\.\w\.(?={DEVICE}\.)", "", one_line(error))
        linear, missing = None, f"no linear model: {said}"
    doubts += _doubts(figures)
    stored = ImportedOpAmp(found, pins, supply, figures, linear, missing, compensation)
    return replace(stored, doubts=tuple(doubts), middle=middle)


def _no_opamp(measured: Responses, middle: float) -> str:
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
    below = np.flatnonzero(size < 1.0)
    if size[0] <= 1.0 or not below.size:
        return (
            f"the gain is {size[0]:.4g} at {f[0]:g} Hz and never crosses 1 up to {f[-1]:.2g} Hz:"
            " are the pins right, or does it need a compensation capacitor?"
        )
    if abs(measured.output) > AT_REST:
        output = middle + measured.output
        return f"as a follower at {middle:g} V its output rests at {output:.3g} V"
    steps = np.abs(np.diff(np.log(size[: below[0] + 1])))
    if steps.max() > math.log(JUMP):
        k = int(np.argmax(steps))
        return (
            f"the gain jumps from {size[k]:.3g} to {size[k + 1]:.3g} between {f[k]:.4g} and"
            f" {f[k + 1]:.4g} Hz"
        )
    return ""


def _figures(
    measured: Responses, bench: VendorBench, simulator: Simulator
) -> tuple[Figures, list[str]]:
    """Return the figures of a data sheet, and why one of them is missing."""
    size, opened = np.abs(measured.gain), Bode(measured.frequencies, measured.gain)
    unity, margin = opened.crossing()
    common = abs(measured.every[1, 0, 0] / measured.gain[0] - 1.0)
    slew_rate = swing = None
    doubts: list[str] = []
    try:
        slew_rate, swing = _ends(bench, simulator, unity)
    except SimulationError as error:
        doubts.append(f"slew rate and swing are not known: {one_line(error)}")
    return Figures(
        dc_gain=float(size[0]),
        unity_gain_bandwidth=unity,
        phase_margin=margin,
        output_resistance=float(abs(measured.every[2, 0, np.flatnonzero(size < 1.0)[0]])),
        supply_current=max(measured.supply_current, 0.0),
        offset_voltage=measured.inverting,
        bias_current=0.5 * (measured.into_inverting + measured.into_other),
        offset_current=measured.into_other - measured.into_inverting,
        common_mode_rejection=-20.0 * math.log10(common) if common > COMMON_MODE else None,
        slew_rate=slew_rate,
        swing=swing,
        **_inputs(measured),
    ), doubts


def _inputs(measured: Responses) -> dict[str, float | None]:
    """Return resistances and capacitances between the inputs, and of the smaller one to ground.

    Both inputs are driven by sources, so the current into the one that is held goes between them.
    """
    own, _, across = measured.admittances
    mutual, common = -across, own + across
    k = int(np.argmin(np.abs(measured.frequencies - INPUT_HERTZ)))
    found: dict[str, float | None] = {}
    for name, admittance in (("differential", mutual), ("common", common)):
        siemens = float(admittance[0].real)
        farads = float(admittance[k].imag) / (2.0 * math.pi * float(measured.frequencies[k]))
        found[f"{name}_resistance"] = 1.0 / siemens if siemens > LEAST_SIEMENS else None
        found[f"{name}_capacitance"] = farads if farads > LEAST_FARADS else None
    return found


def _ends(
    bench: VendorBench, simulator: Simulator, unity: float
) -> tuple[float | None, float | None]:
    """Return slew rate, V/s, and swing, V, of an open loop that is driven to both ends.

    None: the netlist has no such limit.
    """
    supply = bench.supply
    volts, period = min(DRIVE, 0.5 * supply), PERIODS / unity
    most = SLEWS * volts * 2.0 * math.pi * unity
    for _ in range(ATTEMPTS):
        time, output = bench.switched(volts, period, simulator)
        if np.abs(output).max() > BEYOND * supply:  # the netlist does not know its supplies
            rate = slope(time, output, RAMP[0] * supply, RAMP[1] * supply)
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
        slope(time[part], sign * output[part], -level, level)
        for part, sign in zip(parts, (-1.0, 1.0), strict=True)
    )
    return (min(fall, rise) if min(fall, rise) < most else None), swing


def _linear_model(point: DeckPoint, seen: Responses, simulator: Simulator) -> LinearModel:
    """Return the linear circuit of an op-amp: its cards on the bench, each measured where it rests.

    ngspice's own small signal is the witness, at every port. Raises `CardError` where there is
    none: an element is not of the form ``G + s C``, the netlist is unstable with its inputs held,
    ngspice's small signal is another one.
    """
    flat = linear_flat(point.flat, point.volts, point.options, simulator)
    if moving := [card for card, found in flat.stimuli.items() if found.moves]:
        raise CardError(f"{moving[0]} changes over time")
    held = _with(flat, "eservo", value=0.0)  # both inputs; 1 GF of the servo hides other poles
    held.parts = [part for part in held.parts if part.card.lower() != "cslow"]
    found = poles(LinearBoard(circuit_of(held, "bench", (OUT,))))
    if found.known_unstable:
        raise CardError(f"the netlist itself has a pole at {show_rate(found.rightmost.real)}")
    hertz, wanted = seen.frequencies[::EVERY], seen.every[:, :, ::EVERY]
    ours, least = np.empty_like(wanted), np.array([*PORTS.values()])[:, None]
    for k, name in enumerate(DRIVEN):
        driven = _with(flat, name, value=1.0, before=0.0)
        board = LinearBoard(circuit_of(driven, "bench", (OUT,)))
        descriptor = board.descriptor
        places = [descriptor.place(port) for port in PORTS]
        b = descriptor.switched[:, None]
        ours[k] = small_signals(descriptor, b, hertz)[0][0][:, places].T
    off = np.abs(ours - wanted) / np.maximum(np.abs(wanted), least)
    if not (worst := float(off.max())) <= GOOD:
        _, port, at = np.unravel_index(int(off.argmax()), off.shape)
        raise CardError(
            f"it is {100.0 * worst:.2g} % from the small signal of ngspice, more than"
            f" {100.0 * GOOD:g} %, at {[*PORTS][int(port)]}, {hertz[int(at)]:.4g} Hz"
        )
    return LinearModel(tuple(_parts(flat)), worst, (float(hertz[0]), float(hertz[-1])))


def _with(flat: Flat, card: str, **values: Any) -> Flat:
    """Return flat cards with other values of one source."""
    parts = [replace(p, **values) if p.card.lower() == card else p for p in flat.parts]
    return replace(flat, parts=parts)


def _parts(flat: Flat) -> Iterator[Branch]:
    """Yield the parts of the op-amp with its supplies: the bench without what drives it."""

    def port(node: str) -> str:
        return "inn" if node == "pin" else node

    for part in flat.parts:
        if part.card.lower() not in BENCH:
            a, b, *control = map(port, (part.a, part.b, *part.control))
            yield Branch(part.letter, part.name, a, b, part.value, tuple(control))


def _doubts(figures: Figures) -> list[str]:
    """Return a sentence for every figure that no op-amp has that is sold."""
    found = []
    for name, (low, high, unit) in USUAL.items():
        value = getattr(figures, name)
        if not low <= abs(value) <= high or (name == "phase_margin" and value < low):
            title = name.replace("_", " ")
            between = f"{low:g} to {high:g} {unit}".rstrip()
            found.append(f"the {title} is {value:.4g} {unit}".rstrip() + f", usual is {between}")
    return found
