"""Measurements of a record whose uncertainties are bounds on the errors of the readings.

A record with a bound on its error has readings between those of the shifted levels. A record of
ngspice is measured beside the state-space solution: the error of a reading is at most its
difference to the reading of that solution, and the uncertainty of that one. The exact solution of a
linear board is measured for all time, so that no reading depends on the end of a record.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.system.waveforms import Waveforms
from taction.verification.engines.ngspice.process import PHYSICAL_BOUND
from taction.verification.readings.measure import measure
from taction.verification.readings.measurements import Measurements, summary
from taction.verification.readings.readings import Reading
from taction.verification.readings.signals import Curve, Rest
from taction.verification.reference.ideal_answer import IdealAnswer
from taction.verification.verdict.companion import Companion
from taction.verification.verdict.planned_board import PlannedBoard, SteadyState
from taction.verification.verdict.simulation import StateSpaceError, is_exact, outputs


@dataclass(frozen=True, slots=True)
class StepError:
    """Bounds on the errors of the readings of a simulation.

    All are infinite if nothing is known.

    Attributes
    ----------
    steady_state : float
        Of the record's end, fraction of the step amplitude.
    readings : mapping of str to float
        Of the readings of the network, in their units; 0 for a time that no channel has. Of the
        rise times, the largest error of any channel counts.
    """

    steady_state: float
    readings: Mapping[str, float]


def bounded(
    measured: Measurements, other: Measurements | None, safety: float = 1.0
) -> Measurements:
    """Return `measured` with uncertainties that hold for the true solution.

    The error of a reading is at most its difference to the reading of the better solution `other`,
    and the uncertainty of that one. A reading that only one solution has is infinitely uncertain,
    and all readings are without another solution. A settling time jumps by half a ringing period
    when a peak moves through the edge of the band, and this difference counts, too. The differences
    count `safety` times.
    """
    channels = []
    for n, channel in enumerate(measured.channels):
        better = {} if other is None else other.channels[n].readings
        known = {
            name: _bounded(reading, better.get(name), safety)
            for name, reading in channel.readings.items()
        }
        channels.append(replace(channel, readings=known))
    return summary(measured.amplitude, measured.band, measured.modes, channels)


def _bounded(reading: Reading | None, other: Reading | None, safety: float) -> Reading | None:
    if reading is None:
        return None
    if other is None:
        return replace(reading, uncertainty=math.inf)
    apart = safety * abs(reading.value - other.value)
    return replace(reading, uncertainty=apart + other.uncertainty)


def step_error(measured: Measurements, end_error: float) -> StepError:
    """Return the errors of measurements whose uncertainties are bounds.

    Parameters
    ----------
    end_error : float
        Bound of the error of the record's end, V.
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
) -> tuple[Measurements, bool]:
    """Measure a record; the uncertainties of the readings are bounds.

    Parameters
    ----------
    own : StateSpaceError or None
        The error of a record of the state-space engine.
    companion : Companion or None
        A second solution beside a record of ngspice.

    Returns
    -------
    Measurements, bool
        And whether they are those of the exact solution, which has no end.
    """
    solution = None
    if design.poles.known_stable and is_exact(design.board) and (companion or own):
        solution = _on_the_solution(design, ideal)
    if companion is not None:
        if companion.error is None:
            return measure_outputs(design, ideal, wave, error=companion.difference), False
        other = solution or _own_measures(design, ideal, companion.solution, companion.error)
        return bounded(measure_outputs(design, ideal, wave), other), False
    if solution is None:
        return _own_measures(design, ideal, wave, own), False
    # As for every engine, `final` is the end of the record.
    ends = zip(solution.channels, outputs(design.circuit, wave)[-1].tolist(), strict=True)
    channels = tuple(replace(channel, final=end) for channel, end in ends)
    return replace(solution, channels=channels), True


def _own_measures(
    design: PlannedBoard, ideal: IdealAnswer, wave: Waveforms, own: StateSpaceError | None
) -> Measurements:
    """Measure a record by its own error, or beside the second run that errs less."""
    error = own.rounding if own is not None and math.isfinite(own.rounding) else 0.0
    measured = measure_outputs(design, ideal, wave, error=error)
    if own is None or not math.isfinite(own.volts):
        return bounded(measured, None)
    if own.second is None:
        return measured
    second = measure_outputs(design, ideal, own.second, error=own.second_error)
    return bounded(measured, second)


def _target_error(ideal: IdealAnswer) -> float:
    """Return the bound of the error of an output's distance from the reference, V.

    The error of the reference moves the distance, and as step amplitude the band.
    """
    return 2.0 * ideal.solution.error_bound * ideal.network.U0


def _on_the_solution(design: PlannedBoard, ideal: IdealAnswer) -> Measurements | None:
    """Measure the exact solution of a linear board; None if its modes are not all stable."""
    from taction.verification.readings.exact_measures import measure_exact

    try:
        return measure_exact(
            design.board,
            ideal.target,
            ideal.start,
            initial=design.transient.initial,
            stop=design.transient.stop,
            band=design.scene.checks.settling_time.band,
            target_error=_target_error(ideal),
        )
    except EngineError:
        return None


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
