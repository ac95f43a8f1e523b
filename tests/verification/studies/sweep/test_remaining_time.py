"""The remaining time of a sweep, with a clock of the test."""

from __future__ import annotations

import numpy as np
import pytest

from taction.system.array_types import Floats
from taction.verification.studies.sweep.cost_forecast import CostForecast
from taction.verification.studies.sweep.remaining_time import RemainingTime


class Sweep:
    """Points of given true times, computed in order by `processes` processes."""

    def __init__(self, forecast: Floats, true: Floats, processes: int, start_up: float = 0.0):
        self.now, self.true, self.processes = 0.0, true, processes
        costs = CostForecast({"ngspice": forecast}, forecast > 0.0, 1.0)
        left = {"ngspice": np.ones(len(true), dtype=np.bool_)}
        self.time = RemainingTime(costs, left, lambda: processes, lambda: self.now)
        free = np.full(processes, start_up)
        self.ends = []
        for place, seconds in enumerate(true):
            worker = int(np.argmin(free))
            free[worker] += seconds
            self.ends.append((float(free[worker]), place))
        self.end = float(free.max())

    def run(self, until: float) -> float:
        """Go on until a part of the whole time; return the estimate."""
        submitted = 0
        for end, place in sorted(self.ends):
            while submitted < min(len(self.true), place + 2 * self.processes + 2):
                self.time.submit("ngspice", submitted)
                submitted += 1
            if end > until * self.end:
                break
            self.now = end
            self.time.finish("ngspice", place)
        self.now = until * self.end
        return self.time.seconds()


@pytest.mark.parametrize("processes", [1, 2, 7])
@pytest.mark.parametrize("until", [0.25, 0.5, 0.75])
@pytest.mark.parametrize("speed", [0.2, 1.0, 5.0])
def test_a_forecast_with_the_right_ratios_is_calibrated(
    processes: int, until: float, speed: float
) -> None:
    """The dear points come last: their mean over the points that are done is far off."""
    forecast = np.geomspace(0.01, 10.0, 200)
    sweep = Sweep(forecast, speed * forecast, processes, start_up=0.5)
    left = sweep.run(until)
    # At the end some processes have nothing to do, which the estimate does not know.
    assert left == pytest.approx((1.0 - until) * sweep.end, rel=0.25)


def test_before_the_first_point_the_forecast_counts() -> None:
    forecast = np.full(10, 2.0)
    assert Sweep(forecast, forecast, 2).time.seconds() == pytest.approx(10.0)


def test_the_dearest_point_is_the_least_time() -> None:
    forecast = np.array([100.0, *np.full(10, 1.0)])
    assert Sweep(forecast, forecast, 10).time.seconds() == pytest.approx(100.0)


def test_time_spent_on_a_running_point_is_not_left() -> None:
    sweep = Sweep(np.array([1.0, 100.0]), np.array([1.0, 100.0]), 1)
    assert sweep.run(51.0 / 101.0) == pytest.approx(50.0)


def test_engines_are_calibrated_by_their_own_points() -> None:
    now = 0.0
    every = np.ones(4, dtype=np.bool_)
    costs = CostForecast({"ngspice": np.ones(4), "statespace": np.ones(4)}, every, 1.0)
    left = {"ngspice": every, "statespace": every}
    time = RemainingTime(costs, left, lambda: 1, lambda: now)
    taken = {"ngspice": 3.0, "statespace": 0.5}
    for place in range(2):
        for engine, seconds in taken.items():
            time.submit(engine, place)
            now += seconds
            time.finish(engine, place)
    assert time.seconds() == pytest.approx(2 * 3.0 + 2 * 0.5)


def test_points_that_need_no_computation_count_as_done() -> None:
    sweep = Sweep(np.full(4, 2.0), np.full(4, 2.0), 1)
    sweep.time.submit("ngspice", 0)
    sweep.time.finish("ngspice", 2)
    sweep.time.submit("ngspice", 1)
    sweep.time.finish("ngspice", 1)  # before its turn
    assert sweep.time.seconds() == pytest.approx(4.0)


def test_points_of_a_second_stage_replace_those_expected() -> None:
    sweep = Sweep(np.full(4, 2.0), np.full(4, 2.0), 1)
    sweep.time.replace("ngspice", np.array([True, False, False, False]))
    assert sweep.time.seconds() == pytest.approx(2.0)


def test_the_estimate_is_not_computed_anew_at_every_point() -> None:
    sweep = Sweep(np.full(4, 2.0), np.full(4, 2.0), 1)
    assert sweep.time.seconds() == pytest.approx(8.0)
    sweep.time.finish("ngspice", 3)
    sweep.now = 0.1
    assert sweep.time.seconds() == pytest.approx(7.9)
    sweep.now = 0.3
    assert sweep.time.seconds() == pytest.approx(6.0)
