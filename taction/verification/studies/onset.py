"""Onset of oscillation: the values of one key at which a board becomes stable or unstable.

Poles locate each crossing of the imaginary axis. A symmetric load never drives an antisymmetric
mode, so ngspice integrates transients on both sides that start from the equilibrium plus the real
part of the crossing mode's eigenvector. A fit to the waveforms gives growth rate and frequency;
both are compared with the pole. A disagreement is reported, not corrected.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.parts import CurrentSource
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import Deck, write_deck
from taction.netlist_gen.scene.axes import Over, SweepAxis, parse_axes, with_values
from taction.netlist_gen.scene.keys import own_value
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import (
    Complaint,
    EngineError,
    InputError,
    SimulationError,
    SimulatorNotFound,
    SimulatorTooOld,
)
from taction.system.progress import Progress
from taction.system.quantities import show, show_rate
from taction.system.results import Result
from taction.verification.engines.ngspice.process import Simulator, find_simulator, simulate
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.readings.ringing import Mode, find_growth, find_ringing
from taction.verification.reference.lambda_rule import read_scene
from taction.verification.stability.edges import Edge, Sample, Scan
from taction.verification.stability.families import Family, pole_vectors, unrounded
from taction.verification.stability.poles import poles
from taction.verification.verdict.transient_plan import truncation_for

NOT_ASKED = "transients were not requested"
AROUND = 30.0  # the default range is from the scene's value / 30 to its value * 30
POINTS = 61  # of the first grid of a scan: 20 per decade in the default range

DISTANCE = 0.03  # distance of a transient from the crossing, relative
LEAST_DISTANCE = 1e-4  # the same where the pole moves fast
LARGEST_GROWTH = 0.02  # growth rate over the mode's frequency (rad/s) for an accurate fit
PERIOD_POINTS = 100  # time points a period: the trapezoidal rule errs by 1e-3 of the growth rate
FEWEST_PERIODS, MOST_PERIODS = 12.0, 200.0
FOLDS = 1.5  # e-foldings in a record
RIVAL_FOLDS = 12.0  # most e-foldings of a faster mode in a record
STRAINED = 0.1  # of U0: the step at a constraint node of a strain that only excites a mode
SMALL_SIGNAL = 0.02  # largest swing at an amplifier's input, in its v_scale: there it is linear
GROWTH_TOLERANCE, FREQUENCY_TOLERANCE = 0.05, 0.01  # relative
RELTOL = 1e-8  # ngspice's reltol


@dataclass(frozen=True, slots=True)
class Side:
    """The pole and the fitted transient on one side of a crossing."""

    DOCUMENT = (
        *("value", "predicted.growth_rate [1/s] = rate", "predicted.frequency [Hz] = ringing"),
        *("measured.growth_rate [1/s]", "measured.frequency [Hz]"),
        *("measured.growth_rate_uncertainty? [1/s] = measured.growth_sigma", "agrees", "reason"),
    )

    value: float  # of the key
    predicted: complex  # the pole, 1/s
    measured: Mode | None = None  # fitted to the transient
    agrees: bool | None = None  # None if undecided
    reason: str = ""  # why pole and transient disagree, or why that is undecided

    @property
    def rate(self) -> float:
        """Growth rate of the pole, 1/s."""
        return self.predicted.real

    @property
    def ringing(self) -> float:
        """Frequency of the pole, Hz."""
        return abs(self.predicted.imag) / (2.0 * math.pi)


@dataclass(frozen=True, slots=True)
class UnstablePoles:
    """Poles right of the imaginary axis on both sides of a crossing."""

    below: int
    above: int


@dataclass(frozen=True, slots=True)
class CheckedEdge:
    """A crossing of the imaginary axis, and the result of the transients on both sides."""

    DOCUMENT = (
        *("value = crossing.value", "frequency [Hz] = crossing.frequency", "direction"),
        *("changes_stability = crossing.changes_stability", "unstable_poles"),
        *("confirmed", "reason", "below", "above"),
    )

    crossing: Edge
    confirmed: bool | None  # None if the transients are inconclusive
    reason: str
    below: Side | None = None
    above: Side | None = None
    unstable_poles: UnstablePoles | None = None  # where their numbers are known

    @property
    def direction(self) -> str:
        """The side of the crossing on which the mode grows."""
        return "unstable above" if self.crossing.unstable_above else "unstable below"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Onset(Result):
    """Every crossing of a scene over one axis; `plot` draws the pole map and the root locus."""

    VIEW = "taction.verification.report.views.stability_view:onset_view"
    DOCUMENT = (
        *("scene = scene.name", "file = scene.file", "over = axis.key.path"),
        *("unit = axis.key.unit", "own_value", "scanned.from = scan.low", "scanned.to = scan.high"),
        *("scanned.points = scan.points", "scanned.scale = scan.scale"),
        *("scanned.default = axis.default", "complete = scan.complete"),
        *("crossings = findings", "stable_ranges = scan.stable_ranges"),
        *("unresolved = scan.unresolved", "failures"),
    )

    scene: Scene
    axis: SweepAxis
    scan: Scan
    findings: tuple[CheckedEdge, ...]
    own_value: float | None  # the scene's value of the key

    @property
    def failures(self) -> tuple[Sample, ...]:
        """The values whose poles could not be computed."""
        return tuple(sample for sample in self.scan.samples if sample.failure)

    @property
    def outcome(self) -> str:
        """``pass``, or ``inconclusive`` if a transient contradicts a crossing."""
        contradicted = any(each.confirmed is False for each in self.findings)
        return "inconclusive" if contradicted else "pass"


def parse_onset_axis(scene: Scene, over: Over) -> SweepAxis:
    """Read ``--over`` of an onset: a key alone means the scene's value / 30 to its value * 30."""
    groups = parse_axes(scene, over, points=POINTS, around=AROUND)
    if [len(group) for group in groups] != [1]:
        raise InputError("--over", Complaint("key", repr(over), "onset needs exactly one key"))
    axis = groups[0][0]
    if axis.key.kind != "real":
        accepted = "onset needs a key that varies continuously, such as C or gain"
        raise InputError("--over", Complaint("key", repr(axis.name), accepted))
    if len(set(axis.values)) < 2:
        accepted = f"onset needs a range, such as {axis.name}=LOW:HIGH, or two values"
        raise InputError("--over", Complaint("values", repr(over), accepted))
    return axis


def board_over(scene: Scene, axis: SweepAxis) -> Callable[[float], Circuit]:
    """Return the board of `scene` as a function of the value on `axis`.

    No series rounds a knob: a rounded C would cross only between preferred values.
    """
    path, exact = axis.key.path, unrounded(scene, axis.key.path)
    return lambda value: synthesise(with_values(scene, {**exact, path: value}))


def onset(
    scene: str | Path | Scene,
    *,
    over: Over,
    transients: bool = True,
    progress: Progress = lambda stage: None,
) -> Onset:
    """Find every value of a key at which the board of SCENE begins or ceases to oscillate.

    Parameters
    ----------
    scene : path or Scene
        The board.
    over : mapping, str or iterable of str
        Key to change: C, gain, stray_capacitance or any other number of the scene. Without a range:
        from 1/30 to 30 times the scene's own value.

        ``{"C": ("2pF", "20pF", 13)}`` (lowest, highest, number of points), as on the command line
        (``"C=2pF:20pF:13"``), or a key alone.
    transients : bool
        Run ngspice on both sides of each crossing.
    progress : callable, optional
        Receives the name of each stage.

    Returns
    -------
    Onset
        `findings` holds the crossings of the poles, each with its frequency and its confirmation;
        `plot` draws the poles.

    Raises
    ------
    InputError
        The scene or the axis cannot be used.
    NoVerdictError
        No value on the axis gives a board whose poles can be computed.

    Examples
    --------
    >>> import taction
    >>> onset = taction.onset(
    ...     "scenes/paper-breadboard.toml", over={"C": ("5pF", "20pF", 13)}, transients=False
    ... )
    >>> print(f"stable from {onset.findings[-1].crossing.value:.3g} F")
    stable from 9.02e-12 F
    """
    scene = read_scene(scene)
    axis = parse_onset_axis(scene, over)
    values = [float(value) for value in axis.values]
    logarithmic = axis.scale != "lin" and min(values) > 0.0
    middle = math.sqrt(min(values) * max(values)) if logarithmic else None
    boards = Family.over(board_over(scene, axis), axis.key.path, middle)
    progress(f"poles at {len(values)} values and more")
    scanned = boards.scan(values, logarithmic=logarithmic)
    timeout = scene.analysis.timeout if transients else None
    findings = confirmations(boards, scanned, timeout=timeout, progress=progress)
    return Onset(scene, axis, scanned, findings, own_value(scene, axis.key))


def confirmations(
    boards: Family, scanned: Scan, *, timeout: float | None, progress: Progress = lambda stage: None
) -> tuple[CheckedEdge, ...]:
    """Check every crossing by transients of `timeout`, s; without ngspice they stay unconfirmed."""
    reason = NOT_ASKED
    if timeout is not None and scanned.edges:
        try:
            simulator = find_simulator()
        except (SimulatorNotFound, SimulatorTooOld) as error:
            reason, timeout = f"ngspice is needed to confirm a crossing: {error}", None
    findings = []
    for number, edge in enumerate(scanned.edges, start=1):
        progress(f"transients beside crossing {number} of {len(scanned.edges)}")
        unstable = UnstablePoles(edge.below, edge.above) if scanned.complete else None
        found = CheckedEdge(edge, None, reason, unstable_poles=unstable)
        if timeout is not None:
            found = _confirmed(found, boards, simulator, scanned.logarithmic, timeout)
        findings.append(found)
    return tuple(findings)


def _confirmed(
    found: CheckedEdge, boards: Family, simulator: Simulator, logarithmic: bool, timeout: float
) -> CheckedEdge:
    """Run transients of `timeout`, s, on both sides of a crossing; compare with the poles."""
    solver = simulator.solver_option
    try:
        trials = [_prepare(boards, found.crossing, up, logarithmic, solver) for up in (False, True)]
    except (EngineError, InputError) as error:
        reason = f"the board beside the crossing could not be prepared: {error}"
        return replace(found, reason=reason)
    below, above = (_compare(*trial, simulator, timeout) for trial in trials)
    reasons = "; ".join(f"at {s.value!r}: {s.reason}" for s in (below, above) if s.reason)
    verdicts = (below.agrees, above.agrees)
    confirmed = False if False in verdicts else None if None in verdicts else True
    return replace(found, confirmed=confirmed, reason=reasons, below=below, above=above)


def _prepare(
    boards: Family, crossing: Edge, up: bool, logarithmic: bool, solver: str
) -> tuple[Side, float, Deck]:
    """Return the pole on one side of the crossing, at a value where it has the expected sign.

    Also the growth rate of the board's fastest other instability, 1/s, or 0, and the deck.
    """
    distance = DISTANCE
    while True:
        down = 1.0 / (1.0 + distance) if logarithmic else 1.0 - distance
        value = crossing.value * (1.0 + distance if up else down)
        board, pole, board_poles = _follow(boards, crossing, value)
        limit = LARGEST_GROWTH * abs(pole.imag) if crossing.frequency else math.inf
        if (pole.real > 0.0) == (crossing.unstable_above == up) and abs(pole.real) <= limit:
            break
        if distance <= LEAST_DISTANCE:
            raise EngineError(f"the pole on the axis could not be followed to {value!r}")
        distance *= 0.5
    rivals = [p.real for p in board_poles if p not in (pole, pole.conjugate())]
    fastest = max([0.0, *rivals])
    c = strained_along(board, pole) if board.circuit.has_imported else board.circuit
    saved = dict.fromkeys([*(o.node for o in c.outputs), *c.signal_nodes, *c.constraint_nodes])
    transient = along(board, pole, fastest)
    deck = write_deck(c, transient, solver=solver, relative=RELTOL, saved=saved)
    return Side(value, pole), fastest, deck


def _follow(boards: Family, edge: Edge, value: float) -> tuple[LinearBoard, complex, list[complex]]:
    """Follow the pole from the axis to `value`; return the board, the pole and all poles there."""
    pole = edge.pole
    for share in (0.5, 1.0):
        board = boards.board(edge.value + share * (value - edge.value))
        board_poles: list[complex] = poles(board).poles.tolist()
        eligible = [p for p in board_poles if edge.frequency or p.imag == 0.0]
        if not eligible:
            raise EngineError("the real pole on the axis becomes a complex pair beside the axis")
        pole = min(eligible, key=lambda each: abs(each - pole))
    return board, pole, board_poles


def along(board: LinearBoard, pole: complex, fastest: float = 0.0) -> Transient:
    """Plan a transient from the equilibrium plus the mode of `pole`, `FOLDS` e-foldings long.

    It ends before an instability that grows with `fastest`, 1/s, dominates. With imported op-amps
    it starts at rest instead, with the strain of `strained_along`.
    """
    length, step = _span(pole, fastest)
    if board.circuit.has_imported:  # the states inside a vendor's netlist cannot be set
        return Transient(length, step, truncation_for(PERIOD_POINTS), initial="rest")
    shape, _ = pole_vectors(board, pole)
    devices = board.descriptor.devices
    largest = np.abs(shape[: board.descriptor.node_count]).max()
    scale = board.circuit.value("U0") / float(largest)
    if devices.count:
        swing = float(np.max(np.abs(shape[devices.input]) / devices.v_scale))
        scale = min(scale, SMALL_SIGNAL / (swing * math.exp(max(pole.real, 0.0) * length)))
    start_at = board.equilibrium.values + scale * shape.real
    return Transient(
        stop=length,
        max_step=step,
        truncation=truncation_for(PERIOD_POINTS),
        voltages=dict(zip(board.descriptor.names, start_at.tolist(), strict=True)),
    )


def strained_along(board: LinearBoard, pole: complex) -> Circuit:
    """Return the board with a small strain in the shape of a mode, which excites the mode."""
    circuit, descriptor = board.circuit, board.descriptor
    shape, _ = pole_vectors(board, pole)
    present = [node for node in circuit.constraint_nodes if node in descriptor.places]
    pattern = shape.real[[descriptor.place(node) for node in present]]
    ohms = circuit.number("gain") or 1.0 / circuit.value("G0")
    largest = STRAINED * circuit.value("U0") / ohms
    amps = largest * pattern / np.abs(pattern).max()
    summing = {cell.output: cell.inverting for cell in circuit.opamps}
    currents = [
        CurrentSource(f"eps_{summing[node]}", summing[node], value)
        for node, value in zip(present, amps.tolist(), strict=True)
        if value
    ]
    return replace(circuit.without_strain, currents=tuple(currents))


def _span(pole: complex, fastest: float) -> tuple[float, float]:
    """Return length and maximum step of a record of the mode of `pole`, s."""
    length = FOLDS / abs(pole.real)
    if pole.imag:
        period = math.tau / abs(pole.imag)
        length = min(max(length, FEWEST_PERIODS * period), MOST_PERIODS * period)
        step = period / PERIOD_POINTS
    else:
        length *= 2.0
        step = length / (4 * PERIOD_POINTS)
    if fastest > max(pole.real, 0.0):
        length = min(length, RIVAL_FOLDS / fastest)
    return length, step


def _compare(side: Side, fastest: float, deck: Deck, simulator: Simulator, timeout: float) -> Side:
    """Run a deck; compare the pole with the ringing, or the growth, in its waveforms."""
    try:
        waves = simulate(deck, simulator, timeout=timeout)
    except SimulationError as error:
        return replace(side, reason=f"no evidence from ngspice: {error}")
    pole = side.predicted
    if pole.imag:
        mode = find_ringing(waves.time, waves.values).mode
    else:
        mode = find_growth(waves.time, waves.values)
    if mode is None:
        return replace(side, reason="no mode could be fitted to the transient")
    reason = difference = _difference(mode, pole)
    if not (mode.grows or mode.decays):
        reason = f"the fit is uncertain: {mode.doubt}"
    elif difference and abs(mode.growth_rate - pole.real) < 3.0 * mode.growth_sigma:
        reason = f"{difference}, with an uncertainty of {show(mode.growth_sigma, '1/s', 2)}"
    elif difference and fastest > max(pole.real, 0.0):
        reason = f"an instability of {show_rate(fastest)} hides the mode ({difference})"
    agrees = None if reason != difference else not difference
    return replace(side, measured=mode, agrees=agrees, reason=reason)


def _difference(mode: Mode, pole: complex) -> str:
    """Return how a fitted mode and a pole differ; empty if they agree."""
    differs = abs(mode.growth_rate - pole.real) > GROWTH_TOLERANCE * abs(pole.real)
    if differs or (mode.growth_rate > 0.0) != (pole.real > 0.0):
        return f"the transient grows with {mode.growth_rate:.5g} /s, the pole with {pole.real:.5g}"
    frequency = abs(pole.imag) / math.tau
    if abs(mode.frequency - frequency) > FREQUENCY_TOLERANCE * frequency:
        return f"the transient rings at {mode.frequency:.6g} Hz, the pole at {frequency:.6g}"
    return ""
