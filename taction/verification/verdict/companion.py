"""A second solution beside a record, from which its error follows, and how well both agree.

The state-space engine gives the second solution with a bound of its own error. Where it has none,
ngspice runs again at larger steps, and the whole difference of both runs counts.

The uncertainties of the readings of a record are bounds on their errors. A record with a bound on
its error has readings between those of the shifted levels. A record of ngspice is measured beside
the state-space solution: the error of a reading is at most its difference to the reading of that
solution, and the uncertainty of that one. The exact solution of a linear board is measured for all
time, so that no reading depends on the end of a record.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.system.array_types import Floats
from taction.system.documents import Inline
from taction.system.errors import EngineError
from taction.system.reading_definitions import READINGS
from taction.system.waveforms import PHYSICAL_BOUND, Waveforms
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.transients.exact import is_exact
from taction.verification.readings.exact_measures import ExactResponse
from taction.verification.readings.measurements import Measurements, measure, summary
from taction.verification.readings.record import CUBIC, Curve, Rest, lagrange
from taction.verification.reference.ideal_answer import IdealAnswer
from taction.verification.verdict.headroom import watched_nodes
from taction.verification.verdict.planned_board import PlannedBoard, SteadyState
from taction.verification.verdict.simulation import (
    StateSpaceError,
    begin,
    on_curve,
    state_space_error,
)
from taction.verification.verdict.transient_plan import coarser

MAX_INSTANTS = 20_000
COARSER = 2.0  # times the step: the step of a second run of ngspice


@dataclass(frozen=True, slots=True, eq=False)
class Companion:
    """A second solution for a record: from the state-space engine, or at larger steps."""

    # (Q,): instants at which the record and the second solution are compared, s: points of the
    # record, and those of a solution by steps, at which the record is interpolated.
    instants: Floats
    # `u`, `other`: (Q, N): outputs of the record and of the second solution, V.
    u: Floats
    other: Floats
    solution: Waveforms  # the second solution at instants that resolve it
    # The error of the second solution; None for a second run of ngspice at larger steps, whose
    # error is larger than that of the record, so that the difference is a bound.
    error: StateSpaceError | None
    how: str  # source of the second solution
    reason: str = ""  # why the state-space engine has no solution, or empty

    @property
    def exact(self) -> bool:
        """Whether the second solution is from the state-space engine, with a bound of its error."""
        return not self.reason

    @property
    def doubt(self) -> float:
        """Bound of the error of the second solution where it counts, V."""
        return 0.0 if self.error is None else self.error.volts

    @property
    def difference(self) -> float:
        """Largest difference of any output at any instant, V."""
        return float(np.abs(self.u - self.other).max(initial=0.0))

    @property
    def end_error(self) -> float:
        """Bound of the error of the record's end, V."""
        return float(np.abs(self.u[-1] - self.other[-1]).max(initial=0.0)) + self.doubt


def find_companion(design: PlannedBoard, record: Waveforms) -> Companion:
    """Return a second solution for ngspice's record of a stable board.

    SimulationError: the state-space engine has no solution, and the second run of ngspice failed.
    """
    board, tolerance = design.board, design.plan.tolerance
    by_patterns = board.circuit.is_linear and not is_exact(board)
    dense = design.plan.instants(board) if by_patterns else None
    try:
        return state_space_companion(
            board, design.transient, record, tolerance, dense, design.wanted
        )
    except EngineError as error:
        reason = f"no state-space solution: {error}"
    plan = replace(design.plan, transient=coarser(design.transient, COARSER))
    second = begin(replace(design, plan=plan)).result()
    inside = (second.time >= record.time[0]) & (second.time <= record.time[-1])
    instants = np.array(second.time[inside])
    u = lagrange(record.time, outputs(design.circuit, record), instants, CUBIC)
    other, how = (
        outputs(design.circuit, second)[inside],
        "whole difference to a run at twice the step",
    )
    return Companion(instants, u, other, second, None, how, reason)


def state_space_companion(
    board: LinearBoard,
    transient: Transient,
    record: Waveforms,
    tolerance: float,
    dense: Floats | None = None,
    wanted: float = math.inf,
) -> Companion:
    """Return the state-space solution for the `record` of ngspice.

    `tolerance`: relative tolerance of the steps, if the state-space engine needs steps.
    `dense`: instants, beside those of the record, that resolve the solution, s.
    `wanted`: error of the solution that suffices, V.
    EngineError: the state-space engine has no solution for the whole record, or none with a known
      error.
    """
    from taction.verification.engines.statespace.transients.simulate import simulate

    last = len(record.time) - 1  # a record without its end would prove no settling time
    shown = np.append(np.arange(0, last, max(last // MAX_INSTANTS, 1)), last)
    instants, u = np.array(record.time[shown]), outputs(board.circuit, record)[shown]
    times = instants
    if dense is not None:
        times = np.union1d(instants, dense[dense < instants[-1]])
    stepped = not board.circuit.is_linear
    solution = simulate(
        board, transient, times=times, tolerance=tolerance, beside=watched_nodes(board.circuit),
        resolved=stepped,
    )  # fmt: skip
    if solution.time[-1] < times[-1] * (1.0 - 1e-9):
        raise EngineError("its record ends before the record of ngspice")
    error = state_space_error(board, solution, wanted)
    if not math.isfinite(error.volts):
        raise EngineError(error.how)
    how = "difference to the state-space engine, and the error of that engine"
    at = error.record
    if stepped:
        # What the record does not show between its points counts as a difference, too.
        own = at.time[:: len(at.time) // MAX_INSTANTS + 1]
        instants = np.union1d(instants, own[own < instants[-1]])
        u = lagrange(record.time, outputs(board.circuit, record), instants, CUBIC)
        at = replace(at, time=instants, values=on_curve(at, instants))
    other = outputs(board.circuit, at)[np.searchsorted(at.time, instants)]
    return Companion(instants, u, other, error.record, error, how)


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """Differences of the outputs of two engines."""

    # Largest difference of any output at any instant, V; NaN without a second solution.
    difference: float
    doubt: float  # bound of the error of the state-space engine, V
    step_error: float  # expected error of the time steps of ngspice, V
    # Largest accepted difference, fraction of the step amplitude; without a step, of `unit`.
    limit: float
    unit: float  # unit voltage U0, V
    time: float  # instant of the largest difference, s
    channel: int  # channel of the largest difference, from 0
    # `instants`, `differences`: (Q,) and (Q, N): the differences over time, s and V.
    instants: Floats
    differences: Floats
    reason: str  # why there is no second solution, or empty


def compare_engines(
    companion: Companion, step_error: float, limit: float, unit: float
) -> Agreement:
    """Compare the outputs of ngspice with those of the state-space engine.

    `step_error`: expected error of the time steps of ngspice, V.
    `limit`, `unit`: see `Agreement`.
    """
    difference = companion.u - companion.other
    place, channel = np.unravel_index(int(np.argmax(np.abs(difference))), difference.shape)
    known = not companion.reason
    return Agreement(
        difference=float(abs(difference[place, channel])) if known else np.nan,
        doubt=companion.doubt,
        step_error=step_error,
        limit=limit,
        unit=unit,
        time=float(companion.instants[place]),
        channel=int(channel),
        instants=companion.instants,
        differences=difference if known else np.full_like(difference, np.nan),
        reason=companion.reason,
    )


@dataclass(frozen=True, slots=True)
class StepError:
    """Bounds on the errors of the readings of a simulation.

    All are infinite if nothing is known.
    """

    steady_state: float  # of the record's end, fraction of the step amplitude
    # Of the readings of the network, in their units; 0 for a time that no channel has. Of the rise
    # times, the largest error of any channel counts.
    readings: Annotated[
        Mapping[str, float], Inline({name: kind.unit for name, kind in READINGS.items()})
    ]


def bounded(measured: Measurements, other: Measurements | None) -> Measurements:
    """Return `measured` with uncertainties that hold for the true solution.

    The error of a reading is at most its difference to the reading of the better solution `other`,
    and the uncertainty of that one. A reading that only one solution has is infinitely uncertain,
    and all readings are without another solution. A settling time jumps by half a ringing period
    when a peak moves through the edge of the band, and this difference counts, too.
    """
    channels = []
    for n, channel in enumerate(measured.channels):
        better = {} if other is None else other.channels[n].readings
        known = dict(channel.readings)
        for name, reading in channel.readings.items():
            if reading is not None:
                there, error = better.get(name), math.inf
                if there is not None:
                    error = abs(reading.value - there.value) + there.uncertainty
                known[name] = replace(reading, uncertainty=error)
        channels.append(replace(channel, readings=known))
    return summary(measured.amplitude, measured.band, measured.modes, channels)


def step_error(measured: Measurements, end_error: float) -> StepError:
    """Return the errors of measurements whose uncertainties are bounds.

    `end_error`: bound of the error of the record's end, V.
    """
    known = {name: found.uncertainty if found else 0.0 for name, found in measured.readings.items()}
    rises = (channel.rise_time for channel in measured.channels)
    known["rise_time"] = max((rise.uncertainty for rise in rises if rise is not None), default=0.0)
    return StepError(end_error / (measured.amplitude or 1.0), known)


LATE = 0.9  # of a record: after it the largest distance from the equilibrium will not be exceeded


def measure_with_bounds(
    design: PlannedBoard,
    ideal: IdealAnswer,
    wave: Waveforms,
    own: StateSpaceError | None,
    companion: Companion | None,
    *,
    known: Measurements | None = None,
    finest: bool = False,
) -> tuple[Measurements, bool]:
    """Measure a record; the uncertainties of the readings are bounds.

    `own`: the error of a record of the state-space engine.
    `companion`: a second solution beside a record of ngspice.
    `known`: those of `exact_response`, of a record with steps those of `beside_steps`, if they have
      been measured.
    `finest`: whether excursions of an exact solution have no error but that of rounding.

    Returns
    -------
    Measurements, bool
        And whether they are those of the exact solution, which has no end.
    """
    solution = known
    if solution is None and (companion or own):
        solution = _on_the_solution(design, ideal, finest=finest or companion is not None)
    if companion is not None:
        if companion.error is None:
            return measure_outputs(design, ideal, wave, error=companion.difference), False
        other = solution or _own_measures(design, ideal, companion.solution, companion.error)
        return bounded(measure_outputs(design, ideal, wave), other), False
    if solution is None:
        return _own_measures(design, ideal, wave.filled, own), False
    # As for every engine, `final` is the end of the record.
    ends = zip(solution.channels, outputs(design.circuit, wave)[-1].tolist(), strict=True)
    channels = tuple(replace(channel, final=end) for channel, end in ends)
    return replace(solution, channels=channels), True


def _own_measures(
    design: PlannedBoard, ideal: IdealAnswer, wave: Waveforms, own: StateSpaceError | None
) -> Measurements:
    """Measure a record by its own error; its readings have no bound where that is unknown."""
    if own is None or not math.isfinite(own.volts):
        return bounded(measure_outputs(design, ideal, wave, error=wave.rounding), None)
    return measure_outputs(design, ideal, wave, error=own.volts)


def _target_error(ideal: IdealAnswer) -> float:
    """Return the bound of the error of an output's distance from the reference, V.

    The error of the reference moves the distance, and as step amplitude the band.
    """
    return 2.0 * ideal.solution.error_bound * ideal.network.U0


def exact_response(design: PlannedBoard, ideal: IdealAnswer) -> ExactResponse | None:
    """Return what is measured of a linear board instead of a record; None of any other board."""
    if not (design.poles.known_stable and is_exact(design.board)):
        return None
    return ExactResponse(
        design.board,
        ideal.target,
        ideal.start,
        initial=design.transient.initial,
        band=design.scene.checks.settling_time.band,
        target_error=_target_error(ideal),
    )


def beside_steps(response: ExactResponse) -> ExactResponse:
    """Return the response whose readings show the error of the steps of a record."""
    return replace(response, level=0.0)


def _on_the_solution(
    design: PlannedBoard, ideal: IdealAnswer, *, finest: bool
) -> Measurements | None:
    """Measure the exact solution of a linear board; None if its modes are not all stable."""
    response = exact_response(design, ideal)
    try:
        if response is None:
            return None
        return (beside_steps(response) if finest else response).measured()
    except EngineError:
        return None


def outputs(circuit: Circuit, waveforms: Waveforms) -> Floats:
    """Return u of every channel, shape (P, N), V; each channel is contiguous in memory.

    Callers must not change the array: it may share memory with `waveforms`.
    """
    nodes = tuple(out.node for out in circuit.outputs)
    if nodes == waveforms.nodes and all(out.sign == 1.0 for out in circuit.outputs):
        return np.ascontiguousarray(waveforms.values.T).T
    rows = np.empty((len(circuit.outputs), len(waveforms.time)))
    for row, out in zip(rows, circuit.outputs, strict=True):
        np.multiply(waveforms[out.node], out.sign, out=row)
    return rows.T


def measure_outputs(
    design: PlannedBoard, ideal: IdealAnswer, waveforms: Waveforms, *, error: float = 0.0
) -> Measurements:
    """Measure `waveforms`, whose error, V, `error` bounds, against the reference."""
    u, time = outputs(design.circuit, waveforms), waveforms.time
    return measure(
        time,
        u,
        ideal.target,
        ideal.start,
        band=design.scene.checks.settling_time.band,
        bound=PHYSICAL_BOUND * design.circuit.value("U0"),
        expected_stop=design.transient.stop,
        error=error + _target_error(ideal),
        rest=_rest(design, time, u),
        curve=_curve(design, waveforms),
    )


def _curve(design: PlannedBoard, waveforms: Waveforms) -> Curve | None:
    """Return the outputs between the points of a record, by channel, if they are known."""
    between, found = waveforms.curve, design.circuit.outputs
    if between is None:
        return None
    columns = np.array([waveforms.nodes.index(output.node) for output in found])
    signs = np.array([output.sign for output in found])
    return lambda times, channels: signs[channels] * between(times, columns[channels])


def _rest(design: PlannedBoard, time: Floats, u: Floats) -> Rest | None:
    """Return where the outputs of a stable board come to rest after a record."""
    if not design.poles.known_stable:
        return None
    steady = SteadyState.of(design.board, design.scales)
    late = u[int(np.searchsorted(time, LATE * time[-1])) :]
    moving = float(np.abs(late - steady.values).max(initial=0.0))
    return Rest(steady.values, max(steady.left(float(time[-1])), moving))
