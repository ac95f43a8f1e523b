"""Measurements of a record whose uncertainties are bounds on the errors of the readings.

A record with a bound on its error has readings between those of the shifted levels. A record of
ngspice is measured beside the state-space solution: the error of a reading is at most its
difference to the reading of that solution, and the uncertainty of that one. The exact solution of a
linear board is measured for all time, so that no reading depends on the end of a record.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TypedDict

from netlist_gen.analysis import Transient
from netlist_gen.board.circuit import Circuit
from netlist_gen.scene.scene import Scene
from spice_models.array_types import Floats
from spice_models.errors import EngineError
from verification.engines.ngspice.process import PHYSICAL_BOUND
from verification.ideal.ideal_answer import IdealAnswer
from verification.measures.measure import measure, read_record
from verification.measures.measurements import Measurements
from verification.measures.readings import Readings
from verification.pipeline.companion import Companion
from verification.pipeline.design import Design
from verification.pipeline.simulation import outputs
from verification.pipeline.state_space_error import StateSpaceError, is_exact
from verification.pipeline.step_error import bounded, undecided
from verification.small_signal.step_forecast import MOST_INSTANTS
from verification.waveforms import Waveforms


@dataclass(frozen=True, slots=True, eq=False)
class BoundedMeasures:
    """Measurements of a record.

    Attributes
    ----------
    measurements : Measurements
        Readings, whose uncertainties are bounds.
    u : ndarray (P, N)
        Outputs of the record, V.
    end_error : float
        Bound of the error of the record's end, V.
    forever : bool
        Whether the measurements are those of the exact solution, which has no end.
    """

    measurements: Measurements
    u: Floats
    end_error: float
    forever: bool


def measure_with_bounds(
    design: Design,
    ideal: IdealAnswer,
    wave: Waveforms,
    own: StateSpaceError | None,
    companion: Companion | None,
    *,
    details: bool,
) -> BoundedMeasures:
    """Measure a record.

    Parameters
    ----------
    own : StateSpaceError or None
        The error of a record of the state-space engine.
    companion : Companion or None
        A second solution beside a record of ngspice.
    details : bool
        Whether to read the exact solution in place of its record, and to fit modes to records that
        need no fit.
    """
    board, error = design.board, _record_error(own, companion)
    measured, u = measure_outputs(
        design.scene, design.circuit, ideal, wave, design.transient, error=error, details=details
    )
    asked = details or design.scene.analysis.stop != "auto" or len(u) >= MOST_INSTANTS
    solution = None
    if design.poles.stable and is_exact(board) and (companion.exact if companion else asked):
        solution = _on_the_solution(design, ideal)
    if companion is not None and companion.exact:
        if solution is None:
            other = _other_readings(design, ideal, measured, companion, details=details)
        else:
            other = solution.readings
        measured = bounded(measured, other)
    elif solution is not None:
        # As for every engine, `final` is the end of the record.
        ends = zip(solution.channels, u[-1].tolist(), strict=True)
        measured = replace(
            solution, channels=tuple(replace(channel, final=end) for channel, end in ends)
        )
    elif not math.isfinite(error):
        measured = bounded(measured, None)
    end_error = error if companion is None else companion.end_error
    forever = companion is None and solution is not None
    return BoundedMeasures(measured, u, end_error, forever)


def _record_error(own: StateSpaceError | None, companion: Companion | None) -> float:
    """Return the bound of a record's error by which its readings are bounded, V.

    0 for a record of ngspice whose readings are compared with those of a better solution; infinite
    if nothing is known.
    """
    if companion is not None:
        return 0.0 if companion.exact else companion.difference
    return own.volts if own is not None and math.isfinite(own.volts) else math.inf


def _other_readings(
    design: Design,
    ideal: IdealAnswer,
    measured: Measurements,
    companion: Companion,
    *,
    details: bool,
) -> Readings:
    """Return the readings of the state-space engine beside those of ngspice."""
    terms = _terms(design.scene, design.circuit, design.transient)
    time, u, error = companion.time, companion.values, companion.doubt + _target_error(ideal)
    readings = read_record(time, u, ideal.target, ideal.start, **terms, error=error)
    if not undecided(measured, readings):
        return readings
    second = measure(time, u, ideal.target, ideal.start, **terms, error=error, details=details)
    return second.readings


def _target_error(ideal: IdealAnswer) -> float:
    """Return the bound of the error of an output's distance from the reference, V.

    The error of the reference moves the distance, and as step amplitude the band.
    """
    return 2.0 * ideal.solution.error_bound * ideal.network.U0


def _on_the_solution(design: Design, ideal: IdealAnswer) -> Measurements | None:
    """Measure the exact solution of a linear board; None if its modes are not all stable."""
    from verification.small_signal.exact_measures import measure_exact

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
    scene: Scene,
    circuit: Circuit,
    ideal: IdealAnswer,
    waveforms: Waveforms,
    transient: Transient,
    *,
    error: float = 0.0,
    details: bool = True,
) -> tuple[Measurements, Floats]:
    """Measure `waveforms` against the reference; return the measurements and u (P, N), V.

    `error` bounds the error of the waveforms, V; the readings have no bound if it is infinite.
    """
    u, terms = outputs(circuit, waveforms), _terms(scene, circuit, transient)
    time, target, start = waveforms.time, ideal.target, ideal.start
    error = error + _target_error(ideal) if math.isfinite(error) else 0.0
    return measure(time, u, target, start, **terms, error=error, details=details), u


class _Terms(TypedDict):
    """Arguments of `measure` and `read_record` in addition to the record and its target."""

    band: float
    bound: float
    expected_stop: float


def _terms(scene: Scene, circuit: Circuit, transient: Transient) -> _Terms:
    return {
        "band": scene.checks.settling_time.band,
        "bound": PHYSICAL_BOUND * circuit.scalings.unit_voltage,
        "expected_stop": transient.stop,
    }
