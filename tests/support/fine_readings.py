"""Readings of boards with amplifiers by a run whose error is far below those that are studied.

SciPy's integrators are too slow for hundreds of boards, so the run is one of the state-space
engine; tests of that engine compare it with SciPy. The readings of the run are those of the oracle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.scene.scene import Scene
from taction.verification.engines.statespace.transients import stepped
from taction.verification.evidence.stress.judge import TrueValues
from taction.verification.reference.ideal_answer import ideal_answer
from taction.verification.verdict.board import SteadyState
from taction.verification.verdict.build import build
from taction.verification.verdict.transient_plan import StepModel, settled_after
from tests.support.readings import Samples, read

TOLERANCE, SPACING = 1e-11, 1e-10  # of the run; of interpolation between the points of its record
DOUBT, FACTOR = 1e-9, 10.0  # of its readings, fraction of the step or relative; times its rounding
Curve = Callable[[np.ndarray, np.ndarray], np.ndarray]
LONGER = 3.0  # times the record in which every check can be decided


def fine_readings(scene: Scene) -> TrueValues:
    """Return the readings of a board with amplifiers from a run of far smaller tolerance."""
    design = build(scene.with_engine("statespace"))
    ideal, board, lead = ideal_answer(design.network, scene), design.linear, design.poles.rightmost
    amplitude = float(np.abs(ideal.target - ideal.start).max())
    how = f"state-space engine, tolerance {TOLERANCE:g}"
    if not design.poles.stable:
        return TrueValues(amplitude, (lead.real, lead.imag), 0.0, (), DOUBT, how)
    stop = LONGER * settled_after(scene.checks, design.scales)
    transient = Transient(stop, stop, initial=scene.analysis.initial)
    design = replace(design, plan=replace(design.plan, transient=transient))
    times = StepModel.of(board, stop, transient.initial, stable=True).instants(SPACING)
    wave = stepped.simulate(board, transient, times=times, tolerance=TOLERANCE)
    assert wave.curve is not None
    finals = SteadyState.of(board, design.scales).values
    band = amplitude * scene.checks.settling_time.band
    channels = []
    for n, output in enumerate(board.circuit.outputs):
        target, column = float(ideal.target[n]), np.array([wave.nodes.index(output.node)])
        between = partial(_error, wave.curve, column, output.sign, target)
        error, end = output.sign * wave[output.node] - target, float(finals[n]) - target
        step = target - float(ideal.start[n])
        found = read(Samples(wave.time, error, between, end), step, amplitude, band)
        channels.append(found | {"final": float(finals[n])})
    static = float(np.abs(finals - ideal.target).max()) / amplitude
    doubt = DOUBT + FACTOR * wave.rounding / amplitude
    pole = (lead.real, lead.imag)
    return TrueValues(amplitude, pole, static, tuple(channels), doubt, how)


def _error(curve: Curve, column: np.ndarray, sign: float, target: float, t: float) -> float:
    return sign * float(curve(np.array([t]), column)[0]) - target
