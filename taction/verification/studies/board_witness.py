"""ngspice's own transient of a board without a scene, beside the exact solution."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.deck.deck import Deck
from taction.netlist_gen.scene.checks import AGREE
from taction.system.errors import EngineError, SimulationError, StepTooSmall, one_line
from taction.system.time_limit import time_left
from taction.system.waveforms import PHYSICAL_BOUND, Waveforms
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.engines.ngspice.process import simulate
from taction.verification.studies.foreign_board import RELATIVE
from taction.verification.studies.measured_board import WANTED, MeasuredBoard
from taction.verification.verdict.companion import Agreement, compare_engines, state_space_companion
from taction.verification.verdict.step_forecast import StepModel

MOST_STEPS = 200_000.0  # of ngspice: a longer record is cut, and says so
SHORTEST = 2e-11  # of ngspice's longest step: below half of it a step is too short for it
SPARSE = "noopiter"  # the matrix solver that every ngspice has
LEAST_SECONDS = 0.1  # of a run for which no time is left
TIMEOUT = 20.0  # of ngspice, s; what takes longer is not compared, and says so
Witness = Callable[[Transient, str], Deck]


def witnessed(
    found: MeasuredBoard, witness: Witness, limit: float | None
) -> tuple[Agreement | None, str]:
    """Compare ngspice's own transient with the exact one.

    Parameters
    ----------
    witness : callable
        Returns ngspice's deck of a transient for a matrix solver.
    limit : float or None
        Accepted difference, in step amplitudes; None for `AGREE`.

    Returns
    -------
    tuple
        The agreement, or None; and what is to be said: why it was not compared, or that the record
        was cut.
    """
    amplitude = found.measurements.amplitude
    if amplitude == 0.0:
        return None, "no output moves, so ngspice's transient was not compared"
    stop = found.scales.stop
    if found.poles.known_unstable and math.isfinite(found.scales.growth_time):
        stop = min(stop, found.scales.growth_time)
    if not stop > 0.0:
        return None, "no mode shows at an output, so ngspice's transient was not compared"
    try:
        plan, error, cut = planned(found, stop)
        bound = PHYSICAL_BOUND * max(1.0, amplitude)
        record = _after(_simulated(witness, plan, bound), plan.begin)
        companion = state_space_companion(found.board, plan, record, WANTED)
    except (EngineError, SimulationError) as problem:
        return None, f"ngspice's transient was not compared: {one_line(problem)}"
    return compare_engines(companion, error * amplitude, limit or AGREE, 1.0), cut


def planned(found: MeasuredBoard, stop: float) -> tuple[Transient, float, str]:
    """Return ngspice's transient of a board up to an instant, s, for an error of `WANTED`.

    With it the forecast error, in step amplitudes, and what is to be said where it was cut.

    Raises
    ------
    EngineError
        No transient reaches this error.
    """
    stable, cut = found.poles.known_stable, ""

    def model_to(stop: float) -> StepModel:
        model = StepModel.of(found.board, stop, found.initial, stable=stable)
        return model.above_rounding(RELATIVE)

    model = model_to(stop)
    forecast = model.cheapest(WANTED)
    if forecast.steps > MOST_STEPS:
        stop = model.reached(forecast, MOST_STEPS)
        cut = f"ngspice's transient was compared up to {stop:.4g} s only"
        model = model_to(stop)
        forecast = model.cheapest(WANTED)
    plan = Transient(
        stop=stop,
        max_step=forecast.max_step,
        truncation=forecast.truncation,
        charge=forecast.charge,
        current=RELATIVE * model.current,
        first_step=forecast.first_step,
        initial=found.initial,
    )
    longest = plan.begin / SHORTEST  # a longer one would make the first step too short
    if stop / longest <= MOST_STEPS:
        plan = replace(plan, max_step=min(plan.max_step, longest))
    return plan, forecast.error, cut


def _simulated(witness: Witness, plan: Transient, bound: float) -> Waveforms:
    """Run ngspice, again with its other matrix solver where the first one does not converge."""
    simulator, seconds = find_simulator(), max(time_left(TIMEOUT), LEAST_SECONDS)
    try:
        deck = witness(plan, simulator.solver_option)
        return simulate(deck, simulator, timeout=seconds, bound=bound)
    except StepTooSmall:
        return simulate(
            witness(plan, SPARSE),
            simulator,
            timeout=seconds,
            bound=bound,
        )


def _after(record: Waveforms, instant: float) -> Waveforms:
    """Return a record from after the edge of the step: before it the outputs have not jumped."""
    first = int(np.searchsorted(record.time, instant, side="right"))
    return replace(record, time=record.time[first:], values=record.values[first:])
