"""What stretch of a transient a work-precision study can afford."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from netlist_gen.analysis import Transient
from netlist_gen.board.circuit import Circuit
from netlist_gen.scene.scene import Scene
from spice_models.errors import EngineError
from verification.pipeline.transient_plan import (
    AFTER_SETTLING,
    FEWEST_PERIODS,
    REMAINDER,
    even_transient,
)
from verification.reference import IdealNetwork
from verification.small_signal.time_scales import TimeScales, time_scales
from verification.studies.work_precision.method_runs import BASE_POINTS, Task, trapezoidal
from verification.studies.work_precision.methods import Method

REPEATED = 2.0  # runs of each setting that the stretch leaves time for
NGSPICE_SHARE = 0.6  # of the time for the ladders
MOST_PERIODS = 100.0  # of ringing: more say nothing new of a method
UNTIMED_PERIODS = 30.0  # where there is no ngspice to take the time of


@dataclass(frozen=True, slots=True, eq=False)
class Extent:
    """The stretch that is studied.

    Attributes
    ----------
    transient : Transient
        With `BASE_POINTS` points on a period of the fastest ringing.
    whole : float
        Stop time that `verify` would choose, s.
    period : float
        Of the fastest ringing (or ``2 pi / |p|`` of the fastest mode), s.
    pole : complex or None
        Slowest decaying, or fastest growing, oscillating mode that shows, 1/s.
    """

    transient: Transient
    whole: float
    period: float
    pole: complex | None

    @property
    def text(self) -> str:
        """The stretch in words."""
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
    """Choose the stretch that all ladders of `methods` can run in about `seconds`.

    A short ngspice run tells what a point costs.

    Raises
    ------
    InputError, NoVerdictError
        The board has no time scales, or ngspice does not run it.
    """
    scales = time_scales(circuit, initial=scene.analysis.initial)
    period = BASE_POINTS * scales.max_step_for(BASE_POINTS)
    whole = _whole(scene, scales, period)
    if not math.isfinite(whole):
        raise EngineError("no mode of this board shows at its outputs: there is nothing to study")
    points = sum(sum(method.ladder) for method in methods if method.engine == "ngspice")
    periods = UNTIMED_PERIODS
    if points:
        probe = _transient(scene, scales, min(whole, FEWEST_PERIODS * period))
        cost = trapezoidal(Task(circuit, probe, network, np.zeros(0)), BASE_POINTS, seconds)
        per_point = cost.seconds / max(cost.steps, 1)
        periods = NGSPICE_SHARE * seconds / (REPEATED * points * per_point)
    periods = min(max(periods, FEWEST_PERIODS), MOST_PERIODS)
    stop = whole if whole < 1.1 * periods * period else float(f"{periods * period:.3g}")
    return Extent(_transient(scene, scales, stop), whole, period, _pole(scales))


def _transient(scene: Scene, scales: TimeScales, stop: float) -> Transient:
    return even_transient(scene, scales, BASE_POINTS, stop)


def _whole(scene: Scene, scales: TimeScales, period: float) -> float:
    """Stop time that `verify` would choose, s, also where that is too long for it."""
    if scene.analysis.stop != "auto":
        return scene.analysis.stop
    rest = REMAINDER * scene.checks.steady_state.tolerance
    settled = AFTER_SETTLING * scales.stop_for(rest)
    growth = scales.growth_time
    return max(growth if math.isfinite(growth) else settled, FEWEST_PERIODS * period)


def _pole(scales: TimeScales) -> complex | None:
    """Rightmost of the oscillating modes that the step shows."""
    poles = [complex(-1.0 / r.decay, 2.0 * math.pi * r.frequency) for r in scales.ringing]
    return max(poles, key=lambda pole: pole.real, default=None)
