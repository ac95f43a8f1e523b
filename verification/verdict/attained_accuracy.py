"""The requested error of a transient, its attained error, and its cost."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from taction.verification.readings.measurements import Measurements
from taction.verification.reference.ideal_answer import IdealAnswer
from taction.verification.verdict.companion import Companion
from taction.verification.verdict.planned_board import PlannedBoard
from taction.verification.verdict.simulation import ENGINES, engine_of
from taction.verification.verdict.state_space_error import StateSpaceError
from taction.verification.verdict.transient_plan import (
    AFTER_SETTLING,
    AIM,
    LEAST_ERROR,
    TransientPlan,
    plan_transient,
)
from taction.verification.waveforms import Waveforms

INSIDE = 0.5  # of the band minus the static error: remaining ringing at the end of a longer record
LONGER = 2.0  # times the length of a record that was too short: least length of the next record
FEWER = 1.05  # times as many steps: a finer plan has at least so many


@dataclass(frozen=True, slots=True)
class Accuracy:
    """The error of a transient, largest over all outputs and times.

    Attributes
    ----------
    wanted : float
        Error that the checks allow, fraction of the step amplitude (`wanted_error`).
    achieved : float or None
        Bound of the error, measured after the run; None if it cannot be measured.
    seconds : float
        Wall time of the run (of all tries), s.
    points : int
        Time points or steps of the run.
    points_per_period : float
        Points on the period of the fastest ringing, averaged over the record.
    engine, method : str
        Engine and integration method.
    how : str
        How `achieved` was measured.
    tries : int
        Number of runs; 2 or more if the first run did not suffice.
    """

    wanted: float
    achieved: float | None
    seconds: float
    points: int
    points_per_period: float
    engine: str
    method: str
    how: str
    tries: int = 1

    @property
    def reached(self) -> bool:
        """Whether the achieved error is known and does not exceed the wanted error."""
        return self.achieved is not None and self.achieved <= self.wanted

    def after(self, earlier: Accuracy) -> Accuracy:
        """Return this accuracy with the cost of an `earlier` run added."""
        return replace(
            self, seconds=self.seconds + earlier.seconds, tries=self.tries + earlier.tries
        )


def attained(
    design: PlannedBoard,
    waveforms: Waveforms,
    own: StateSpaceError | None,
    companion: Companion | None,
    amplitude: float,
) -> Accuracy:
    """Return the bound of the error that a transient attained.

    Parameters
    ----------
    own : StateSpaceError or None
        Of a record of the state-space engine.
    companion : Companion or None
        Second solution for the record of ngspice; None for an unstable board.
    amplitude : float
        Step amplitude, V.
    """
    transient = design.transient
    method, volts = str(transient.method), math.nan
    how = "the board is unstable: the error grows with the voltages"
    if own is not None:
        method, volts, how = own.method, own.volts, own.how
    elif companion is not None:
        volts, how = companion.difference + companion.doubt, companion.how
    step = transient.stop / max(waveforms.cost.points, 1)
    return Accuracy(
        wanted=design.plan.wanted,
        achieved=volts / (amplitude or 1.0) if math.isfinite(volts) else None,
        seconds=waveforms.cost.seconds,
        points=waveforms.cost.points,
        points_per_period=design.scales.max_step_for(1.0) / step,
        engine=waveforms.engine,
        method=method,
        how=how,
    )


def better_plan(
    design: PlannedBoard, ideal: IdealAnswer, measured: Measurements, accuracy: Accuracy
) -> TransientPlan | None:
    """Return a plan for a better run; None if the run suffices or no plan would be better."""
    return _longer(design, ideal, measured) or _finer(design, accuracy)


def _longer(
    design: PlannedBoard, ideal: IdealAnswer, measured: Measurements
) -> TransientPlan | None:
    """Plan a longer record if a channel settles only after the end of the record."""
    scene = design.scene
    automatic = scene.analysis.stop == "auto" and design.poles.known_stable
    if not automatic or measured.settling_time is not None or not measured.amplitude:
        return None
    equilibrium = design.board.equilibrium.values
    places = design.board.descriptor.places
    final = np.array([out.sign * equilibrium[places[out.node]] for out in design.circuit.outputs])
    static = float(np.abs(final - ideal.target).max()) / measured.amplitude
    room = INSIDE * (scene.checks.settling_time.band - static)
    if room <= 0.0:
        return None
    stop = max(AFTER_SETTLING * design.scales.stop_for(room), LONGER * design.transient.stop)
    analysis = scene.analysis.model_copy(update={"stop": float(f"{stop:.6g}")})
    longer = scene.model_copy(update={"analysis": analysis})
    steps = ENGINES[design.engine].error is None
    return plan_transient(longer, design.board, design.scales, steps=steps, stable=True)


def _finer(design: PlannedBoard, accuracy: Accuracy) -> TransientPlan | None:
    """Plan smaller steps if a run with the steps of the plan missed the wanted error."""
    even = design.scene.analysis.points_per_period is not None
    bounded = engine_of(accuracy.engine).error is not None
    if accuracy.reached or accuracy.achieved is None or even or bounded:
        return None
    forecast = design.plan.forecast
    aim = AIM * accuracy.wanted * min(forecast.error / accuracy.achieved, 1.0)
    if aim < LEAST_ERROR:
        return None
    analysis = design.scene.analysis.model_copy(update={"stop": design.transient.stop})
    scene = design.scene.model_copy(update={"analysis": analysis})
    plan = plan_transient(scene, design.board, design.scales, stable=True, aim=aim)
    return plan if plan.forecast.steps > FEWER * forecast.steps else None
