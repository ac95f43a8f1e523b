"""A crossing on trial: transients on both sides of it, started along the mode in question.

A symmetric load never drives an antisymmetric mode, so the transient does not start from zero but
from the equilibrium plus the real part of the mode's eigenvector, every node and every op-amp
state of it. ngspice integrates, a fit reads growth rate and frequency off its waveforms, and both
are compared with the pole.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np

from netlist_gen.analysis import Transient
from netlist_gen.board.circuit import Circuit
from netlist_gen.deck.deck import write_deck
from spice_models.array_types import Complexes
from spice_models.errors import EngineError, InputError, SimulationError
from verification.engines.ngspice.executable import Simulator
from verification.engines.ngspice.process import Run, start
from verification.engines.statespace.linearised.board import LinearBoard
from verification.engines.statespace.linearised.state_space import StateSpace
from verification.measures.mode_fit import Mode, fit_modes
from verification.pipeline.transient_plan import truncation_for
from verification.small_signal.poles import poles
from verification.studies.onset.scan_result import AxisCrossing
from verification.waveforms import Waveforms

ASIDE = 0.03  # distance of a transient from the crossing, relative
NEAREST = 1e-4  # the same, where the pole moves or turns fast
STEEP = 0.02  # largest growth rate over the mode's frequency (rad/s) for which a fit is easy
POINTS = 100  # time points a period: the trapezoidal rule then errs by 1e-3 of the growth rate
FEWEST, MOST = 12.0, 200.0  # periods
FOLDS = 1.5  # e-foldings that a record should show
RUNAWAY = 12.0  # e-foldings that a faster mode may have over the one in question
SMALL = 0.02  # largest swing at an amplifier's input, in its v_scale: there it is linear
GROWTH, FREQUENCY = 0.05, 0.01  # relative differences that still agree
FAINT = 0.01  # of the strongest mode: below, a mode is not the one that the record shows
RELATIVE = 1e-8  # ngspice's reltol
_TURN = 2.0 * math.pi

Build = Callable[[float], Circuit]


@dataclass(frozen=True, slots=True)
class Side:
    """What a transient on one side of a crossing shows, beside what the pole predicts.

    Attributes
    ----------
    value : float
        Where the transient was run.
    predicted : complex
        The pole there, 1/s.
    growth_rate, growth_sigma : float or None
        Fitted, 1/s, with its standard uncertainty; None where there is no fit.
    frequency : float or None
        Fitted, Hz.
    agrees : bool or None
        Whether they agree; None where that could not be decided.
    reason : str
        Why they do not, or why not.
    """

    value: float
    predicted: complex
    growth_rate: float | None = None
    growth_sigma: float | None = None
    frequency: float | None = None
    agrees: bool | None = None
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Confirmation:
    """Both sides of a crossing; `confirmed` is None where transients could not decide."""

    confirmed: bool | None
    reason: str
    below: Side | None = None
    above: Side | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _Trial:
    """A board on one side, its pole, and the transient along the mode."""

    value: float
    pole: complex
    fastest: float  # growth rate of the board's fastest other instability, 1/s; 0 for none
    circuit: Circuit
    transient: Transient


def confirm(
    build: Build, crossing: AxisCrossing, simulator: Simulator, *, logarithmic: bool, timeout: float
) -> Confirmation:
    """Run transients on both sides of `crossing` at the same time and compare with the poles.

    Parameters
    ----------
    build : callable
        The board at a value.
    crossing : AxisCrossing
        What is to be confirmed.
    simulator : Simulator
        An ngspice.
    logarithmic : bool
        Whether "a few per cent away" means by a factor, or by a part of the value.
    timeout : float
        Wall time allowed for each run, s.
    """
    try:
        trials = [_prepare(build, crossing, side, logarithmic) for side in (-1, 1)]
    except (EngineError, InputError) as error:
        return Confirmation(None, f"the board beside the crossing could not be prepared: {error}")
    with ExitStack() as cleanup:  # what goes wrong with one run ends the other
        try:
            runs = [cleanup.enter_context(_start(t, simulator, timeout)) for t in trials]
        except SimulationError as error:
            return Confirmation(None, f"ngspice did not start: {error}")
        below, above = (_finish(t, run) for t, run in zip(trials, runs, strict=True))
    reasons = "; ".join(f"at {s.value!r}: {s.reason}" for s in (below, above) if s.reason)
    verdicts = (below.agrees, above.agrees)
    confirmed = False if False in verdicts else None if None in verdicts else True
    return Confirmation(confirmed, reasons, below, above)


def _prepare(build: Build, crossing: AxisCrossing, side: int, logarithmic: bool) -> _Trial:
    """Go to one side of the crossing, near enough that the pole has the sign it should have."""
    unstable = crossing.unstable_above == (side > 0)
    aside = ASIDE
    while True:
        down = 1.0 / (1.0 + aside) if logarithmic else 1.0 - aside
        value = crossing.value * (1.0 + aside if side > 0 else down)
        board, pole, others = _follow(build, crossing, value)
        limit = STEEP * abs(pole.imag) if crossing.frequency else math.inf
        if (pole.real > 0.0) == unstable and abs(pole.real) <= limit:
            break
        if aside <= NEAREST:
            raise EngineError(f"the pole on the axis could not be followed to {value!r}")
        aside *= 0.5
    rivals = [p.real for p in others if p not in (pole, pole.conjugate())]
    fastest = max([0.0, *rivals])
    return _Trial(value, pole, fastest, board.circuit, along(board, pole, fastest))


def _follow(
    build: Build, crossing: AxisCrossing, value: float
) -> tuple[LinearBoard, complex, list[complex]]:
    """Follow the pole from the axis to `value`, each time to the nearest.

    Return the board at `value`, the pole, and all its poles.
    """
    pole = crossing.pole
    for share in (0.5, 1.0):
        near = crossing.value + share * (value - crossing.value)
        board = LinearBoard(build(near))
        found: list[complex] = poles(board).poles.tolist()
        eligible = [p for p in found if crossing.frequency or p.imag == 0.0]
        if not eligible:
            raise EngineError("the real pole on the axis becomes a pair beside it")
        pole = min(eligible, key=lambda each: abs(each - pole))
    return board, pole, found


def along(board: LinearBoard, pole: complex, fastest: float = 0.0) -> Transient:
    """Plan a transient that starts from the equilibrium plus the mode of `pole`.

    Parameters
    ----------
    board : LinearBoard
        It.
    pole : complex
        One of its poles, 1/s.
    fastest : float
        Growth rate of its fastest other instability, 1/s: the record ends before that takes over.

    Returns
    -------
    Transient
        `FOLDS` e-foldings long where that is between `FEWEST` and `MOST` periods.

    Raises
    ------
    EngineError
        No state space, or no equilibrium.
    """
    space = board.state_space
    length, step = _span(pole, fastest)
    shape = space.C @ _mode(space, pole)
    nodes = shape[: space.descriptor.node_count]
    scale = board.circuit.scalings.unit_voltage / float(np.abs(nodes).max())
    devices = space.descriptor.devices
    if devices.count:
        swing = float(np.max(np.abs(shape[devices.input]) / devices.v_scale))
        scale = min(scale, SMALL / (swing * math.exp(max(pole.real, 0.0) * length)))
    start_at = board.equilibrium.values + scale * shape.real
    return Transient(
        stop=length,
        max_step=step,
        truncation=truncation_for(POINTS),
        voltages=dict(zip(space.nodes, start_at.tolist(), strict=True)),
    )


def _span(pole: complex, fastest: float) -> tuple[float, float]:
    """Length and maximum step of a record of the mode of `pole`, s."""
    length = FOLDS / abs(pole.real)
    if pole.imag:
        period = _TURN / abs(pole.imag)
        length = min(max(length, FEWEST * period), MOST * period)
        step = period / POINTS
    else:
        length *= 2.0
        step = length / (4 * POINTS)
    if fastest > max(pole.real, 0.0):
        length = min(length, RUNAWAY / fastest)
    return length, step


def _mode(space: StateSpace, pole: complex) -> Complexes:
    """Eigenvector of `pole` by inverse iteration, shape (n,)."""
    x: Complexes = np.cos(np.arange(1.0, space.n + 1)).astype(np.complex128)  # no symmetry
    shifted = space.A - pole * (1.0 + 1e-9) * np.eye(space.n)  # exactly the pole is singular
    for _ in range(3):
        x = np.asarray(np.linalg.solve(shifted, x), dtype=np.complex128)
        x /= np.abs(x).max()
    return x


def _start(trial: _Trial, simulator: Simulator, timeout: float) -> Run:
    c = trial.circuit
    saved = dict.fromkeys([*(o.node for o in c.outputs), *c.signal_nodes, *c.constraint_nodes])
    deck = write_deck(
        c, trial.transient, solver=simulator.solver_option, relative=RELATIVE, saved=saved
    )
    return start(deck, simulator, timeout=timeout)


def _finish(trial: _Trial, run: Run) -> Side:
    try:
        waveforms = run.result()
    except SimulationError as error:
        return Side(trial.value, trial.pole, reason=f"no evidence from ngspice: {error}")
    return _compare(trial, waveforms)


def _compare(trial: _Trial, waveforms: Waveforms) -> Side:
    """Compare the pole with the nearest of the strong modes in the waveforms."""
    found = fit_modes(waveforms.time, waveforms.values)
    if not found:
        return Side(
            trial.value, trial.pole, reason="the transient shows no mode that can be fitted"
        )
    strong = [mode for mode in found if mode.amplitude >= FAINT * found[0].amplitude]
    mode = min(strong, key=lambda m: abs(complex(m.growth_rate, _TURN * m.frequency) - trial.pole))
    difference = _difference(mode, trial.pole)
    agrees: bool | None = not difference
    reason = difference
    if not (mode.grows or mode.decays):
        agrees, reason = None, f"the fit is not sure of itself: {mode.doubt}"
    elif difference and abs(mode.growth_rate - trial.pole.real) < 3.0 * mode.growth_sigma:
        agrees, reason = None, f"{difference}, but the fit is only sure to {mode.growth_sigma:.2g}"
    elif difference and trial.fastest > max(trial.pole.real, 0.0):
        agrees = None
        reason = f"an instability of {trial.fastest:.4g} /s hides the mode ({difference})"
    return Side(
        value=trial.value,
        predicted=trial.pole,
        growth_rate=mode.growth_rate,
        growth_sigma=mode.growth_sigma,
        frequency=mode.frequency,
        agrees=agrees,
        reason=reason,
    )


def _difference(mode: Mode, pole: complex) -> str:
    """Say how a fitted mode and a pole differ, or nothing."""
    off = abs(mode.growth_rate - pole.real) > GROWTH * abs(pole.real)
    if off or (mode.growth_rate > 0.0) != (pole.real > 0.0):
        return f"the transient grows with {mode.growth_rate:.5g} /s, the pole with {pole.real:.5g}"
    frequency = abs(pole.imag) / (_TURN)
    if abs(mode.frequency - frequency) > FREQUENCY * frequency:
        return f"the transient rings at {mode.frequency:.6g} Hz, the pole at {frequency:.6g}"
    return ""
