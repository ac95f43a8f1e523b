"""Check any linear board, with or without a scene: what `taction check` says.

Poles, stability, readings and noise are those of the state-space engine, by the functions that
verify a scene; what is missing is a reference solution, so the outputs are compared with their own
equilibrium, and with expected values where these are given. ngspice's own transient is the other
witness.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.deck.deck import Deck
from taction.netlist_gen.scene.axes import range_values
from taction.netlist_gen.scene.checks import AGREE, LOWEST
from taction.netlist_gen.scene.keys import Key as SceneKey
from taction.system.array_types import EPS, Floats
from taction.system.documents import Hertz, Number, Rate, Seconds, Steps, Volts
from taction.system.errors import Complaint, EngineError, InputError, SimulationError, StepTooSmall
from taction.system.quantities import UNITS
from taction.system.results import Result
from taction.system.waveforms import Waveforms
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.engines.ngspice.process import PHYSICAL_BOUND, simulate
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.output_noise import output_noise
from taction.verification.engines.statespace.linearised.time_scales import TimeScales, time_scales
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.readings.exact_measures import ExactResponse, measure_responses
from taction.verification.readings.measurements import Measurements, channel_measure, summary
from taction.verification.readings.readings import Reading, unread
from taction.verification.readings.settling import ChannelState, Settlement
from taction.verification.stability.edges import Edge, Edges
from taction.verification.stability.families import Family
from taction.verification.stability.poles import Poles, poles
from taction.verification.studies.part_influence import PartRow, influences
from taction.verification.studies.wanted_checks import Wanted
from taction.verification.verdict.checks import Check, Evidence, Outcome, at_most, overall
from taction.verification.verdict.companion import (
    Agreement,
    compare_engines,
    state_space_companion,
    step_error,
)
from taction.verification.verdict.output_noise import OutputNoise
from taction.verification.verdict.planned_board import SteadyState
from taction.verification.verdict.run_checks import run_checks
from taction.verification.verdict.step_forecast import StepModel

MOST_STEPS = 200_000.0  # of ngspice: a longer record is cut, and says so
WANTED = 1e-4  # error of ngspice's transient, in step amplitudes
SPARSE = "noopiter"  # the matrix solver that every ngspice has
TIMEOUT = 300.0  # of ngspice, s
SAMPLED = 5000  # instants at which the largest excursion is looked for
NO_RISE = "the output returns to where it was: it has no step"
UNSTABLE = "the board is not stable"
AROUND = 30.0  # range of a value without one
Progress = Callable[[str], None]
Start = Literal["zero", "rest"]
Witness = Callable[[Transient, str], Deck]


@dataclass(frozen=True, slots=True)
class PoleRow:
    """A pole with its bound."""

    real: Rate
    frequency: Hertz
    damping: Number
    bound: Rate


@dataclass(frozen=True, slots=True)
class OutputRow:
    """An output: rest before and after the step, readings with bounds, and noise."""

    name: str
    before: Volts
    rest: Volts
    rest_bound: Volts
    settling_time: Seconds
    settling_bound: Seconds
    rise_time: Seconds
    rise_bound: Seconds
    overshoot: Steps
    undershoot: Steps
    noise: Volts
    noise_bound: Volts
    state: str


@dataclass(frozen=True, slots=True)
class PointRow:
    """A value of a sweep: the rightmost pole, and readings of all outputs."""

    value: Number
    real: Rate
    frequency: Hertz
    stable: bool | None
    settling_time: Seconds = None
    rise_time: Seconds = None
    overshoot: Steps = None
    undershoot: Steps = None
    failure: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """A board over one value: every crossing of the imaginary axis, and readings at the values."""

    DOCUMENT = (
        *("name", "unit", "own", "crossings", "stable_ranges = edges.stable_ranges"),
        "points",
    )

    name: str
    unit: str
    own: Number
    edges: Edges
    points: tuple[PointRow, ...]

    @property
    def crossings(self) -> tuple[Edge, ...]:
        """Values at which a pole crosses the imaginary axis."""
        return self.edges.edges


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BoardCheck(Result):
    """All that `taction check` says of a board; `outcome` is that of its checks."""

    VIEW = "taction.verification.report.views.board_check:view"
    DOCUMENT = (
        *("name", "outcome", "initial", "notes", "stable = poles.stable"),
        *("poles = pole_rows", "parts", "band = measurements.band", "amplitude [V]", "outputs"),
        *("noise_unknown", "agreement", "checks", "sweeps"),
    )

    name: str
    circuit: Circuit
    initial: Start
    notes: tuple[str, ...]
    poles: Poles
    scales: TimeScales
    measurements: Measurements
    parts: tuple[PartRow, ...]
    outputs: tuple[OutputRow, ...]
    noise_unknown: str
    record: Agreement | None
    unwitnessed: str
    checks: tuple[Check, ...]
    sweeps: tuple[Sweep, ...]
    asked: bool
    seconds: Mapping[str, float]

    @property
    def outcome(self) -> Outcome:
        """Of the checks; a report without checks passes unless the engines disagree."""
        return overall(self.checks) if self.checks else Outcome.PASS

    @property
    def amplitude(self) -> float:
        """Largest step of an output, V."""
        return self.measurements.amplitude

    @property
    def pole_rows(self) -> tuple[PoleRow, ...]:
        """Poles with Im >= 0, rightmost first."""
        pairs = zip(self.poles.poles.tolist(), self.poles.errors.tolist(), strict=True)
        return tuple(
            PoleRow(p.real, p.imag / math.tau, -p.real / abs(p) if p else 0.0, bound)
            for p, bound in pairs
            if p.imag >= 0.0
        )

    @property
    def agreement(self) -> Steps:
        """Largest difference of the two engines over the record, in step amplitudes."""
        if self.record is None or not self.amplitude:
            return None
        return self.record.difference / self.amplitude

    def __repr__(self) -> str:
        word = "stable" if self.poles.stable else "not stable"
        return f"BoardCheck({self.name!r}, {self.outcome.value}; {word}, {len(self.parts)} parts)"


def check_board(
    circuit: Circuit,
    asked: Wanted,
    *,
    initial: Start = "rest",
    witness: Witness | None = None,
    build: Callable[[str, Sequence[float]], Callable[[float], Circuit]] | None = None,
    notes: tuple[str, ...] = (),
    progress: Progress = lambda stage: None,
) -> BoardCheck:
    """Check a linear board.

    Parameters
    ----------
    circuit : Circuit
        The board; its knobs are the parts that are listed.
    asked : Wanted
        Limits, expected values and sweeps.
    initial : str
        Whether the step begins at rest, or with no charge.
    witness : callable, optional
        Returns ngspice's deck of a transient for a solver; without it there is one witness.
    build : callable, optional
        Takes a name that is no knob, and values; returns the board as a function of the value.
    notes : tuple of str
        What is to be said with the result.
    progress : callable, optional
        Receives the name of each stage.

    Raises
    ------
    InputError
        A name that the board does not have.
    EngineError
        No equilibrium, or no state-space form.
    """
    clock = time.process_time
    began = clock()
    board = LinearBoard(circuit)
    progress("poles")
    found = poles(board)
    scales = time_scales(board, initial=initial)
    measured = measure(board, found, asked.limits.settling_time.band, initial)
    progress("parts")
    margin, rows = influences(board, found, "stability" in asked.names)
    lowest = None if asked.limits.noise is None else asked.limits.noise.lowest
    noise = _noise(board, found, lowest)
    middle = clock()
    progress("ngspice")
    agreement, why = None, "without ngspice"
    if witness is not None:
        agreement, why = _agreement(board, found, scales, initial, witness, asked, measured)
    evidence = Evidence(
        checks=asked.limits,
        measurements=measured,
        error=step_error(measured, 0.0),
        steady=SteadyState.of(board, scales),
        end=math.inf,
        forever=True,
        wanted=WANTED,
        agreement=agreement,
        poles=found,
        margin=margin if asked.limits.stability.margin > 1.0 else None,
        reference_error=0.0,
        reference_problem="",
        noise=noise,
    )
    names = {*asked.names, "engines_agree"}
    checks = tuple(check for check in run_checks(evidence) if check.name in names)
    if not asked.names and not asked.expected and measured.amplitude == 0.0:
        checks = ()  # nothing moves: there is no step to agree on
    checks = (*(_judge(board, found, each) for each in asked.expected), *checks)
    progress("sweeps")
    sweeps = tuple(_sweep(board, text, initial, asked, build) for text in asked.over)
    return BoardCheck(
        circuit.name,
        circuit,
        initial,
        (*notes, *([why] if why else ())),
        found,
        scales,
        measured,
        rows,
        _outputs(board, found, measured, noise, initial),
        noise.unknown,
        agreement,
        why,
        checks,
        sweeps,
        bool(asked.names or asked.expected),
        {"statespace": middle - began},
    )


def measure(board: LinearBoard, found: Poles, band: float, initial: Start) -> Measurements:
    """Measure the step of the outputs against their own equilibrium."""
    response, returns = step_response(board, initial, band)
    if found.known_stable:
        (measured,) = measure_responses([response])
        return _settling_alone(measured) if returns else measured
    step, nothing = response.step, unread(len(response.target))
    state = ChannelState.OSCILLATING if found.known_unstable else ChannelState.UNDECIDED
    still = Settlement(state, None, UNSTABLE)
    channels = [
        channel_measure(n, end, step, nothing, still, None, UNSTABLE)
        for n, end in enumerate(response.target.tolist())
    ]
    return summary(step.amplitude, band, (), channels)


def step_response(board: LinearBoard, initial: Start, band: float) -> tuple[ExactResponse, bool]:
    """Return the step of the outputs, to be measured, and whether they return to their start."""
    before, rest, error = ends(board, initial)
    start = _pulses(board, before, rest, error, initial)
    return ExactResponse(board, rest, start, initial, band, error), start is not before


def _pulses(
    board: LinearBoard, before: Floats, rest: Floats, error: float, initial: Start
) -> Floats:
    """Return where the outputs start; if all return to there, their largest excursion instead.

    Then an output behind a capacitor settles in shares of this excursion.
    """
    if float(np.abs(rest - before).max(initial=0.0)) > error:
        return before
    stop = time_scales(board, initial=initial).stop
    solution = exact_solution(board, initial=initial)
    instants = np.concatenate(
        [np.linspace(0.0, stop, SAMPLED), np.geomspace(1e-6, 1.0, SAMPLED) * stop]
    )
    signs = np.array([out.sign for out in board.circuit.outputs])
    moved = solution.at(instants) * signs - rest
    peaks = moved[np.abs(moved).argmax(axis=0), np.arange(moved.shape[1])]
    return rest + peaks if float(np.abs(peaks).max(initial=0.0)) > error else before


def _settling_alone(measured: Measurements) -> Measurements:
    """Return the measurements of outputs without a step, which only settle."""
    alone = {"rise_time": None, "overshoot": None, "undershoot": None}
    channels = [
        replace(channel, readings={**channel.readings, **alone}, rise_reason=NO_RISE)
        for channel in measured.channels
    ]
    readings = {**measured.readings, **alone}
    return replace(measured, channels=tuple(channels), readings=readings)


def ends(board: LinearBoard, initial: Start) -> tuple[Floats, Floats, float]:
    """Return the outputs before the step and at rest, V, and the error of the latter."""
    places = [board.descriptor.place(out.node) for out in board.circuit.outputs]
    signs = np.array([out.sign for out in board.circuit.outputs])
    rest = board.equilibrium.values[places] * signs
    before = board.rest.values[places] * signs if initial == "rest" else np.zeros(len(places))
    return before, rest, float(board.rounding[places].max(initial=0.0))


def _noise(board: LinearBoard, found: Poles, lowest: float | None) -> OutputNoise:
    if not found.known_stable:
        return OutputNoise(unknown="a board that is not stable has no noise at rest")
    flickering = any(model.flicker_noise > 0.0 for model in board.circuit.models.values())
    low = lowest or (LOWEST if flickering else 0.0)
    try:
        rms, error = output_noise(board, low)
    except EngineError as problem:
        return OutputNoise(unknown=str(problem))
    return OutputNoise(tuple(rms.tolist()), tuple(error.tolist()), lowest=low)


def _agreement(
    board: LinearBoard,
    found: Poles,
    scales: TimeScales,
    initial: Start,
    witness: Witness,
    asked: Wanted,
    measured: Measurements,
) -> tuple[Agreement | None, str]:
    """Compare ngspice's own transient with the exact one; or why it was not compared."""
    if measured.amplitude == 0.0:
        return None, "no output moves, so ngspice's transient was not compared"
    stop, cut = scales.stop, ""
    if found.known_unstable:
        stop = min(stop, scales.growth_time) if math.isfinite(scales.growth_time) else stop
    if not stop > 0.0:
        return None, "no mode shows at an output, so ngspice's transient was not compared"
    try:
        model = StepModel.of(board, stop, initial, stable=found.known_stable)
        forecast = model.cheapest(WANTED)
        if forecast.steps > MOST_STEPS:
            stop = model.reached(forecast, MOST_STEPS)
            cut = f"ngspice's transient was compared up to {stop:.4g} s only"
            forecast = StepModel.of(board, stop, initial, stable=found.known_stable).cheapest(
                WANTED
            )
        plan = Transient(
            stop=stop,
            max_step=forecast.max_step,
            truncation=forecast.truncation,
            charge=forecast.charge,
            first_step=forecast.first_step,
            initial=initial,
        )
        bound = PHYSICAL_BOUND * max(1.0, measured.amplitude)
        record = _after(_simulated(witness, plan, bound), plan.begin)
        companion = state_space_companion(board, plan, record, WANTED)
    except (EngineError, SimulationError) as error:
        return None, f"ngspice's transient was not compared: {str(error).splitlines()[0]}"
    limit = asked.limits.engines_agree.tolerance or AGREE
    steps = forecast.error * measured.amplitude
    return compare_engines(companion, steps, limit, 1.0), cut


def _simulated(witness: Witness, plan: Transient, bound: float) -> Waveforms:
    """Run ngspice, again with its other matrix solver where the first one does not converge."""
    simulator = find_simulator()
    try:
        deck = witness(plan, simulator.solver_option)
        return simulate(deck, simulator, timeout=TIMEOUT, bound=bound)
    except StepTooSmall:
        return simulate(witness(plan, SPARSE), simulator, timeout=TIMEOUT, bound=bound)


def _after(record: Waveforms, instant: float) -> Waveforms:
    """Return a record from after the edge of the step: before it the outputs have not jumped."""
    first = int(np.searchsorted(record.time, instant, side="right"))
    return replace(record, time=record.time[first:], values=record.values[first:])


def _judge(board: LinearBoard, found: Poles, each: tuple[str, float, float]) -> Check:
    """Compare the equilibrium of a node with an expected value."""
    node, volts, tolerance = each
    name = f"v({node})"
    if node not in board.descriptor.places or "(" in node:
        listed = ", ".join(board.descriptor.names[: board.descriptor.node_count][:20])
        raise InputError("--expect", Complaint(name, "", f"the board has the nodes {listed}"))
    place = board.descriptor.place(node)
    value, error = float(board.equilibrium.values[place]), float(board.rounding[place])
    error = max(error, EPS * abs(value))
    if not found.known_stable:
        reason = "the board is not stable: it does not come to rest there"
        outcome = Outcome.FAIL if found.known_unstable else Outcome.INCONCLUSIVE
        return Check(name, outcome, value, error, volts, tolerance, "V", reason)
    outcome = at_most(abs(value - volts), error, tolerance)
    return Check(name, outcome, value, error, volts, tolerance, "V", "equilibrium")


def _outputs(
    board: LinearBoard, found: Poles, measured: Measurements, noise: OutputNoise, initial: Start
) -> tuple[OutputRow, ...]:
    before, rest, error = ends(board, initial)
    rows = []
    for n, (out, channel) in enumerate(zip(board.circuit.outputs, measured.channels, strict=True)):
        settling, rise = channel.settling_time, channel.rise_time
        stable = found.known_stable
        rows.append(
            OutputRow(
                name=out.node,
                before=float(before[n]),
                rest=float(rest[n]),
                rest_bound=error,
                settling_time=_value(settling),
                settling_bound=None if settling is None else settling.uncertainty,
                rise_time=_value(rise),
                rise_bound=None if rise is None else rise.uncertainty,
                overshoot=_value(channel.readings["overshoot"]) if stable else None,
                undershoot=_value(channel.readings["undershoot"]) if stable else None,
                noise=noise.rms[n] if noise.rms else None,
                noise_bound=noise.error[n] if noise.error else None,
                state=channel.state.value,
            )
        )
    return tuple(rows)


def _sweep(
    board: LinearBoard,
    text: str,
    initial: Start,
    asked: Wanted,
    build: Callable[[str, Sequence[float]], Callable[[float], Circuit]] | None,
) -> Sweep:
    """Find every crossing over one value, and the readings at each of the values."""
    name, equals, body = (part.strip() for part in text.partition("="))
    c = board.circuit
    folded = {knob.name.lower(): knob for knob in c.knobs if knob.role}
    knob = folded.get(name.lower())
    own = c.value(knob.name) if knob else None
    unit = c.facts[knob.name].unit if knob else ""
    if not equals or not body:
        if own is None or not own > 0.0:
            raise InputError("--over", Complaint(name, "", f"expected {name}=LOW:HIGH:POINTS"))
        values = np.geomspace(own / AROUND, own * AROUND, 61).tolist()
        logarithmic = True
    else:
        key = SceneKey(name, "real", unit if unit in UNITS else "ohm")
        found, scale = range_values(key, text, body, 61)
        values = [float(value) for value in found]
        logarithmic = scale != "lin" and min(values) > 0.0
    if knob is not None:
        family = Family.of(board, knob)
    else:
        if build is None:
            known = ", ".join(each.name for each in folded.values())
            raise InputError("--over", Complaint("name", repr(name), f"expected one of {known}"))
        family = Family.over(build(name.lower(), values))
    if family.ports is not None and logarithmic:
        edges = family.edges(min(values), max(values))
    else:
        edges = family.scan(values, logarithmic=logarithmic)
    band = asked.limits.settling_time.band
    return Sweep(
        knob.name if knob else name, unit, own, edges, _points(family, values, initial, band)
    )


def _points(
    family: Family, values: Sequence[float], initial: Start, band: float
) -> tuple[PointRow, ...]:
    """Return poles and readings at each value; those of all stable boards are measured at once."""
    rows, responses = list[PointRow](), dict[int, tuple[ExactResponse, bool]]()
    for k, value in enumerate(values):
        try:
            board = LinearBoard.of(family.board(value))
            found = poles(board)
            lead = found.rightmost
            rows.append(PointRow(value, lead.real, lead.imag / math.tau, found.stable))
            if found.known_stable:
                responses[k] = step_response(board, initial, band)
        except (EngineError, InputError) as error:
            rows[k:] = [PointRow(value, None, None, None, failure=str(error))]
    try:
        measured = measure_responses([response for response, _ in responses.values()])
    except EngineError as error:
        return tuple(replace(row, failure=str(error)) for row in rows)
    for (k, (_, returns)), each in zip(responses.items(), measured, strict=True):
        rows[k] = replace(rows[k], **_values(_settling_alone(each) if returns else each))
    return tuple(rows)


def _values(measured: Measurements) -> dict[str, Any]:
    found = measured.readings.items()
    return {name: _value(reading) for name, reading in found}


def _value(reading: Reading | None) -> float | None:
    return None if reading is None else reading.value
