"""The line before a sweep: its points, its estimated time, and an engine that takes less."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from taction.system.array_types import Bools
from taction.verification.studies.running.worker import Workers
from taction.verification.studies.sweep.cost_forecast import CostForecast
from taction.verification.studies.sweep.plan import Plan

LONG = 10.0  # s: another engine is proposed for a longer sweep
FASTER = 20.0  # times as fast: the state-space engine is proposed
SLOW = 300.0  # s for ngspice at every point: the hybrid engine is proposed
HYBRID = "--engine hybrid, ngspice only at the decisive points"


def announcement(
    plan: Plan, forecast: CostForecast, left: Mapping[str, Bools], stored: int, workers: Workers
) -> str:
    """Return the line before a sweep.

    Parameters
    ----------
    left : mapping of str to ndarray (P,)
        The points to compute, by engine; of a hybrid sweep the expected points of ngspice.
    stored : int
        Number of points that need no computation.
    """
    text = "1 point" if plan.total == 1 else f"{plan.total} points"
    if plan.hybrid:
        text += f" and ngspice at about {int(left['ngspice'].sum())} of them"
    if stored:
        text += f", {stored} results are stored"
    processes = workers.processes()
    where = "1 process" if processes == 1 else f"{processes} processes"
    seconds = wall_time(forecast, left, workers)
    text += f": about {duration(seconds)} in {where}"
    if "ngspice" not in plan.engines:
        return text
    every = np.ones(plan.points, dtype=np.bool_)
    exact = wall_time(forecast, {"statespace": every}, workers)
    if seconds >= max(LONG, FASTER * exact):
        text += f"; --engine statespace: about {duration(exact)}"
    if not plan.hybrid and wall_time(forecast, {"ngspice": left["ngspice"]}, workers) > SLOW:
        both = {"statespace": every, "ngspice": forecast.confirmed(plan)}
        text += f"; {HYBRID}: about {duration(wall_time(forecast, both, workers))}"
    return text


def wall_time(forecast: CostForecast, places: Mapping[str, Bools], workers: Workers) -> float:
    """Return the estimated wall time of the points `places` by engine, s.

    One point is computed by one process, so the time is at least that of the dearest point.
    """
    costs = [forecast.seconds[engine][marked] for engine, marked in places.items()]
    total = sum(float(cost.sum()) for cost in costs)
    longest = max(float(cost.max(initial=0.0)) for cost in costs)
    processes = max(workers.processes(), 1)
    return forecast.slowness * (workers.start_up + max(total / processes, longest))


def duration(seconds: float) -> str:
    """Return a duration for people, about two digits.

    Examples
    --------
    >>> [duration(seconds) for seconds in (0.3, 42.4, 700.0, 9000.0)]
    ['1 s', '42 s', '12 min', '2.5 h']
    """
    if seconds < 100.0:
        return f"{max(round(seconds), 1)} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 6000.0 else f"{seconds / 3600.0:.1f} h"
