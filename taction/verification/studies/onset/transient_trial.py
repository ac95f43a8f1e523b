"""Transients on both sides of a crossing, started along the crossing mode.

A symmetric load never drives an antisymmetric mode, so the transient starts from the equilibrium
plus the real part of the mode's eigenvector. ngspice integrates, a fit to the waveforms gives
growth rate and frequency, and both are compared with the pole.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.parts import CurrentSource
from taction.netlist_gen.deck.deck import Deck, write_deck
from taction.system.array_types import Waveforms
from taction.system.errors import EngineError, InputError, SimulationError
from taction.system.quantities import show, show_rate
from taction.verification.engines.ngspice.executable import Simulator
from taction.verification.engines.ngspice.process import simulate
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.readings.ringing import Mode, find_growth, find_ringing
from taction.verification.stability.edges import Edge
from taction.verification.stability.poles import poles
from taction.verification.studies.decks.part_influence import pole_vectors
from taction.verification.verdict.transient_plan import truncation_for

DISTANCE = 0.03  # distance of a transient from the crossing, relative
LEAST_DISTANCE = 1e-4  # the same where the pole moves fast
LARGEST_GROWTH = 0.02  # growth rate over the mode's frequency (rad/s) for an accurate fit
POINTS = 100  # time points a period: the error of the trapezoidal rule is 1e-3 of the growth rate
FEWEST_PERIODS, MOST_PERIODS = 12.0, 200.0
FOLDS = 1.5  # e-foldings in a record
RIVAL_FOLDS = 12.0  # most e-foldings of a faster mode in a record
STRAINED = 0.1  # of U0: the step at a constraint node of a strain that only excites a mode
SMALL_SIGNAL = 0.02  # largest swing at an amplifier's input, in its v_scale: there it is linear
GROWTH_TOLERANCE, FREQUENCY_TOLERANCE = 0.05, 0.01  # relative
RELTOL = 1e-8  # ngspice's reltol

Boards = Callable[[float], LinearBoard]


@dataclass(frozen=True, slots=True)
class Side:
    """The pole and the fitted transient on one side of a crossing."""

    DOCUMENT = (
        *("value", "predicted.growth_rate [1/s] = rate", "predicted.frequency [Hz] = ringing"),
        *("measured.growth_rate [1/s] = growth_rate", "measured.frequency [Hz] = frequency"),
        *("measured.growth_rate_uncertainty? [1/s] = growth_sigma", "agrees", "reason"),
    )

    value: float  # of the key
    predicted: complex  # the pole, 1/s
    growth_rate: float | None = None  # fitted, 1/s; None without a fit
    growth_sigma: float | None = None  # standard uncertainty of the growth rate, 1/s
    frequency: float | None = None  # fitted, Hz
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
    complete: bool = True  # whether the numbers of poles are known

    @property
    def direction(self) -> str:
        """The side of the crossing on which the mode grows."""
        return "unstable above" if self.crossing.unstable_above else "unstable below"

    @property
    def unstable_poles(self) -> UnstablePoles | None:
        """The numbers of unstable poles on both sides, where they are known."""
        edge = self.crossing
        return UnstablePoles(edge.below, edge.above) if self.complete else None


def confirm(
    boards: Boards, crossing: Edge, simulator: Simulator, *, logarithmic: bool, timeout: float
) -> CheckedEdge:
    """Run transients of `timeout`, s, on both sides of `crossing`; compare with the poles."""
    try:
        trials = [_prepare(boards, crossing, side, logarithmic, simulator) for side in (-1, 1)]
    except (EngineError, InputError) as error:
        reason = f"the board beside the crossing could not be prepared: {error}"
        return CheckedEdge(crossing, None, reason)
    runs = (partial(simulate, deck, simulator, timeout=timeout) for _, _, deck in trials)
    below, above = (_compare(*trial[:2], run) for trial, run in zip(trials, runs, strict=True))
    reasons = "; ".join(f"at {s.value!r}: {s.reason}" for s in (below, above) if s.reason)
    verdicts = (below.agrees, above.agrees)
    confirmed = False if False in verdicts else None if None in verdicts else True
    return CheckedEdge(crossing, confirmed, reasons, below, above)


def _prepare(
    boards: Boards, crossing: Edge, side: int, logarithmic: bool, simulator: Simulator
) -> tuple[Side, float, Deck]:
    """Return the pole on one side of the crossing, at a value where it has the expected sign.

    Also the growth rate of the board's fastest other instability, 1/s, or 0, and the deck.
    """
    unstable = crossing.unstable_above == (side > 0)
    distance = DISTANCE
    while True:
        down = 1.0 / (1.0 + distance) if logarithmic else 1.0 - distance
        value = crossing.value * (1.0 + distance if side > 0 else down)
        board, pole, board_poles = _follow(boards, crossing, value)
        limit = LARGEST_GROWTH * abs(pole.imag) if crossing.frequency else math.inf
        if (pole.real > 0.0) == unstable and abs(pole.real) <= limit:
            break
        if distance <= LEAST_DISTANCE:
            raise EngineError(f"the pole on the axis could not be followed to {value!r}")
        distance *= 0.5
    rivals = [p.real for p in board_poles if p not in (pole, pole.conjugate())]
    fastest = max([0.0, *rivals])
    c = strained_along(board, pole) if board.circuit.has_imported else board.circuit
    saved = dict.fromkeys([*(o.node for o in c.outputs), *c.signal_nodes, *c.constraint_nodes])
    transient, solver = along(board, pole, fastest), simulator.solver_option
    deck = write_deck(c, transient, solver=solver, relative=RELTOL, saved=saved)
    return Side(value, pole), fastest, deck


def _follow(
    boards: Boards, crossing: Edge, value: float
) -> tuple[LinearBoard, complex, list[complex]]:
    """Follow the pole from the axis to `value`; return the board, the pole and all poles there."""
    pole = crossing.pole
    for share in (0.5, 1.0):
        near = crossing.value + share * (value - crossing.value)
        board = boards(near)
        board_poles: list[complex] = poles(board).poles.tolist()
        eligible = [p for p in board_poles if crossing.frequency or p.imag == 0.0]
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
        return Transient(length, step, truncation_for(POINTS), initial="rest")
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
        truncation=truncation_for(POINTS),
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
        step = period / POINTS
    else:
        length *= 2.0
        step = length / (4 * POINTS)
    if fastest > max(pole.real, 0.0):
        length = min(length, RIVAL_FOLDS / fastest)
    return length, step


def _compare(side: Side, fastest: float, run: Callable[[], Waveforms]) -> Side:
    """Compare the pole with the ringing, or the growth, in the waveforms of a run."""
    try:
        waves = run()
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
    measured = mode.growth_rate, mode.growth_sigma, mode.frequency
    return Side(side.value, pole, *measured, agrees, reason)


def _difference(mode: Mode, pole: complex) -> str:
    """Return how a fitted mode and a pole differ; empty if they agree."""
    differs = abs(mode.growth_rate - pole.real) > GROWTH_TOLERANCE * abs(pole.real)
    if differs or (mode.growth_rate > 0.0) != (pole.real > 0.0):
        return f"the transient grows with {mode.growth_rate:.5g} /s, the pole with {pole.real:.5g}"
    frequency = abs(pole.imag) / math.tau
    if abs(mode.frequency - frequency) > FREQUENCY_TOLERANCE * frequency:
        return f"the transient rings at {mode.frequency:.6g} Hz, the pole at {frequency:.6g}"
    return ""
