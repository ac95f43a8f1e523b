"""Choose the part of the transient that a work-precision study can run in its budget."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import EngineError
from taction.verification.engines.statespace.linearised.time_scales import TimeScales, time_scales
from taction.verification.reference import IdealNetwork
from taction.verification.studies.work_precision.method_runs import BASE_POINTS, Task, ngspice
from taction.verification.studies.work_precision.methods import Method
from taction.verification.verdict.transient_plan import (
    AFTER_SETTLING,
    FEWEST_PERIODS,
    REMAINDER,
    even_transient,
)

RUNS = 2.0  # of each setting that fit in the budget
NGSPICE_SHARE = 0.6  # of the time for the ladders
MAX_PERIODS = 100.0  # of ringing; more periods show nothing new of a method
UNTIMED_PERIODS = 30.0  # without ngspice, whose time per point sets the number


@dataclass(frozen=True, slots=True, eq=False)
class Extent:
    """The part of the transient that is studied."""

    transient: Transient  # with `BASE_POINTS` points on a period of the fastest ringing
    whole: float  # stop time of `verify`, s
    period: float  # of the fastest ringing, or 2 pi / |p| of the fastest mode, s
    pole: complex | None  # rightmost oscillating mode that the step excites, 1/s

    @property
    def text(self) -> str:
        """The studied part in words."""
        stop, periods = self.transient.stop, self.transient.stop / self.period
        if stop >= self.whole:
            return f"the whole transient, {stop:.4g} s, {periods:.3g} periods"
        return (
            f"the first {stop:.4g} s of {self.whole:.4g} s ({periods:.3g} of"
            f" {self.whole / self.period:.4g} periods), all that the budget affords"
        )


def study_extent(
    scene: Scene,
    circuit: Circuit,
    network: IdealNetwork,
    methods: Iterable[Method],
    seconds: float,
) -> Extent:
    """Choose the part that all ladders of `methods` can run in about `seconds`.

    A short ngspice run measures the time per point.

    Raises
    ------
    InputError, NoVerdictError
        The board has no time scales, or ngspice fails.
    """
    scales = time_scales(circuit, initial=scene.analysis.initial)
    period = BASE_POINTS * scales.max_step_for(BASE_POINTS)
    whole = _whole(scene, scales, period)
    if not math.isfinite(whole):
        raise EngineError("the step excites no mode of this board at its outputs: nothing to study")
    points = sum(sum(method.ladder) for method in methods if method.engine == "ngspice")
    periods = UNTIMED_PERIODS
    if points:
        probe = _transient(scene, scales, min(whole, FEWEST_PERIODS * period))
        task = Task(circuit, probe, network, np.zeros(0))
        try:
            run = ngspice(task, BASE_POINTS, seconds, "trapezoidal")
        except TimeoutError:
            raise EngineError(
                f"the budget is too short for this board: ngspice needs more than {seconds:.3g} s"
                f" for {FEWEST_PERIODS:g} periods of the ringing; a larger --budget gives it more"
            ) from None
        periods = NGSPICE_SHARE * seconds / (RUNS * points * run.seconds / max(run.steps, 1))
    periods = min(max(periods, FEWEST_PERIODS), MAX_PERIODS)
    stop = whole if whole < 1.1 * periods * period else float(f"{periods * period:.3g}")
    return Extent(_transient(scene, scales, stop), whole, period, _pole(scales))


def _transient(scene: Scene, scales: TimeScales, stop: float) -> Transient:
    return even_transient(scene, scales, BASE_POINTS, stop)


def _whole(scene: Scene, scales: TimeScales, period: float) -> float:
    """Return the stop time of `verify`, s, without its upper limit."""
    if scene.analysis.stop != "auto":
        return scene.analysis.stop
    rest = REMAINDER * scene.checks.steady_state.tolerance
    settled = AFTER_SETTLING * scales.stop_for(rest)
    growth = scales.growth_time
    return max(growth if math.isfinite(growth) else settled, FEWEST_PERIODS * period)


def _pole(scales: TimeScales) -> complex | None:
    """Return the rightmost of the oscillating modes that the step excites."""
    poles = [complex(-1.0 / r.decay, 2.0 * math.pi * r.frequency) for r in scales.ringing]
    return max(poles, key=lambda pole: pole.real, default=None)
