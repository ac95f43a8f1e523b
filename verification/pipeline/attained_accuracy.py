"""What error a transient was asked for, what it attained, and what it cost.

`verification.pipeline.transient_plan` chooses the step for ``analysis.error`` beforehand; here a
second run says what came of it, and by how much the step must shrink if it missed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from netlist_gen.analysis import Transient
from netlist_gen.board.circuit import Circuit
from spice_models.errors import EngineError
from verification.engines.statespace.linearised.board import LinearBoard
from verification.engines.statespace.transients import (
    amplified,
    exact,
    reduced_order,
    structured_radau,
)
from verification.measures.resampling import CUBIC, lagrange
from verification.pipeline.design import Design
from verification.pipeline.simulation import Simulation, outputs, state_space_tolerance
from verification.pipeline.transient_plan import plan_transient
from verification.waveforms import Waveforms

INSTANTS = 2000  # at which two runs of an adaptive engine are compared
LOOSER = 10.0  # the second run's tolerance over the first's
RESERVE = 0.8  # of the wanted error: what the second try aims at


@dataclass(frozen=True, slots=True)
class Accuracy:
    """The error of a transient, largest over all outputs and times.

    Attributes
    ----------
    wanted : float
        ``analysis.error``, fraction of the step amplitude.
    achieved : float or None
        The same as found afterwards; None where nothing tells it.
    seconds : float
        Wall time of the run (of both tries where there were two), s.
    points : int
        Time points or steps of the run.
    points_per_period : float
        Points on the period of the fastest ringing.
    engine, method : str
        Who computed it, and how.
    how : str
        How `achieved` was found.
    tries : int
        2 where the first step missed.
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
        """Whether it is known to be as small as wanted."""
        return self.achieved is not None and self.achieved <= self.wanted


def attained(design: Design, simulation: Simulation, amplitude: float) -> Accuracy | None:
    """Find the error that a transient attained; None if the scene asks for none.

    Parameters
    ----------
    amplitude : float
        Step amplitude, V.
    """
    transient = design.transient
    wanted, fine = design.scene.analysis.error, simulation.fine
    if wanted is None:
        return None
    if fine.engine == exact.ENGINE:
        method, volts, how = _state_space(design.board, transient, fine, wanted)
    else:
        method, (volts, how) = transient.method, _two_runs(design.circuit, simulation)
    return Accuracy(
        wanted=wanted,
        achieved=volts / (amplitude or 1.0) if math.isfinite(volts) else None,
        seconds=fine.cost.seconds,
        points=fine.cost.points,
        points_per_period=design.scales.max_step_for(1.0) / transient.max_step,
        engine=fine.engine,
        method=method,
        how=how,
    )


def finer(design: Design, accuracy: Accuracy | None) -> Design | None:
    """Return the design with the step that should reach its error, after one that missed.

    None where there is no need for it, and where the engine has no step.
    """
    if accuracy is None or accuracy.reached or accuracy.achieved is None:
        return None
    if accuracy.engine == exact.ENGINE:
        return None
    ratio = math.sqrt(accuracy.achieved / (RESERVE * accuracy.wanted))  # of order 2
    points = ratio * accuracy.points_per_period
    transient = plan_transient(design.scene, design.scales, design.engine, points)
    return replace(design, transient=transient)


def both_tries(first: Accuracy, second: Accuracy | None) -> Accuracy | None:
    """Return the second try with the cost of both."""
    if second is None:
        return None
    return replace(second, seconds=first.seconds + second.seconds, tries=2)


def _two_runs(circuit: Circuit, simulation: Simulation) -> tuple[float, str]:
    """Return the stepping engine's error in V, extrapolated from its two runs."""
    fine, coarse = simulation.fine, simulation.coarse
    if coarse is None or len(fine.time) < CUBIC:
        return math.nan, "no second run"
    inside = (coarse.time >= fine.time[0]) & (coarse.time <= fine.time[-1])
    u = lagrange(fine.time, outputs(circuit, fine), np.asarray(coarse.time[inside]), CUBIC)
    apart = np.abs(u - outputs(circuit, coarse)[inside]).max()
    return simulation.share * float(apart), "difference to a run at twice the step, extrapolated"


def _state_space(
    board: LinearBoard, transient: Transient, fine: Waveforms, wanted: float
) -> tuple[str, float, str]:
    """Return the method, its error in V and how it was found."""
    amplifiers = board.circuit.amplifiers
    if not (amplifiers or board.descriptor.is_large):
        bound = exact.exact_solution(board, initial=transient.initial, stop=transient.stop).error
        return "exact", bound, "bound on the rounding of the exact solution"
    run = amplified.simulate if amplifiers else structured_radau.simulate
    stepped = any(flag.startswith(reduced_order.STEPPED) for flag in fine.flags)
    linear = "implicit, structured" if stepped else "Krylov space, structured"
    method = "implicit, adaptive" if amplifiers else linear
    tolerance = state_space_tolerance(wanted)
    times = fine.time[:: max(len(fine.time) // INSTANTS, 1)]
    try:
        other = run(board, transient, times=times, tolerance=LOOSER * tolerance)
    except EngineError as error:
        return method, math.nan, f"the second run failed: {error}"
    apart = np.abs(other.values - fine.values[np.searchsorted(fine.time, times)]).max()
    text = f"difference to a run at {LOOSER:g} times the tolerance {tolerance:g}, and rounding: \
an upper bound"
    return method, float(apart) + fine.rounding, text
