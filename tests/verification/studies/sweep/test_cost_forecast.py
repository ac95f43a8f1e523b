"""The forecast of a sweep's cost, the line before a sweep, and its remaining time."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from taction.netlist_gen.scene.axes import ENGINE, parse_axes, with_values
from taction.system.array_types import Floats
from taction.system.errors import NoVerdictError
from taction.system.progress import Clock
from taction.verification.studies.running.worker import Workers
from taction.verification.studies.sweep import forecast as module
from taction.verification.studies.sweep.forecast import (
    CostForecast,
    RemainingTime,
    announcement,
    duration,
    forecast_costs,
    wall_time,
)
from taction.verification.studies.sweep.hybrid import sample
from taction.verification.studies.sweep.plan import Plan, plan_sweep
from taction.verification.verdict.design import design_board
from tests.support.making import make_scene
from tests.support.paths import SCENES
from tests.support.sweeping import BOTH, grid_plan

PAPER = SCENES / "paper-breadboard.toml"


def ngspice_plan(*over: str) -> Plan:
    return plan_sweep(PAPER, over, "ngspice", fix="lambda=0.7", keep_waveforms=False)


def planned(plan: Plan) -> tuple[np.ndarray, np.ndarray]:
    """Time of the steps of ngspice at every point, s, and whether the board is stable."""
    seconds, stable = [], []
    for place in range(plan.points):
        scene = with_values(plan.scene, plan.values_at(place) | {ENGINE: "ngspice"})
        design = design_board(scene, Clock(lambda stage: None))
        seconds.append(design.plan.seconds)
        stable.append(design.poles.stable)
    return np.array(seconds), np.array(stable)


def test_the_forecast_of_a_grid_with_a_stability_boundary() -> None:
    plan = ngspice_plan("C=4pF:200pF:13", "gain=1M:10M:9")
    exact, stable = planned(plan)
    found = forecast_costs(plan)
    steps = found.seconds["ngspice"] - np.median(found.seconds["ngspice"] - exact)
    # The boundary spreads the costs over decades; their sums are right within 20 %.
    assert exact.max() > 30.0 * np.median(exact)
    assert steps.sum() == pytest.approx(exact.sum(), rel=0.2)
    half = plan.points // 2
    assert steps[half:].sum() == pytest.approx(exact[half:].sum(), rel=0.2, abs=0.02 * exact.sum())
    assert np.mean(found.stable == stable) > 0.95
    assert found.slowness >= 1.0


def test_few_points_are_planned(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = list[object]()

    def counted(*arguments: object) -> object:
        calls.append(arguments)
        return design_board(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(module, "design_board", counted)
    forecast_costs(ngspice_plan("C=10pF:1nF:20", "gain=100k:1M:20"))
    assert len(calls) <= 1 + 0.06 * 400  # no point of this grid is dear
    calls.clear()
    forecast_costs(ngspice_plan("C=1pF:1nF:31", "gain=1M:20M:21"))
    assert len(calls) <= 1 + 39 + 60
    calls.clear()
    forecast_costs(grid_plan("C=10pF:1nF:100", "gain=100k:1M:100", engines=("statespace",)))
    assert len(calls) == 13  # 12 of 10,000, and one that loads modules


def test_all_points_of_a_small_grid_are_planned_once() -> None:
    plan = grid_plan("C=50p,100p,150p")
    found = forecast_costs(plan)
    assert found.seconds["ngspice"].shape == found.seconds["statespace"].shape == (3,)
    assert np.all(found.seconds["ngspice"] > 0.0)
    assert np.all(found.stable)


def test_words_are_forecast_by_themselves() -> None:
    """The passive topology of this scene cannot be built; its points cost nothing."""
    asked = make_scene({"channels": 2, "span": 1.2}, design={"resistance": "100Mohm"})
    axes = parse_axes(asked, ["topology=integrator,passive", "C=50p:500p:30"])
    found = forecast_costs(Plan(asked, axes, ("statespace",)))
    costs = found.seconds["statespace"].reshape(2, 30)
    assert np.all(costs[0] > 0.0)
    assert np.count_nonzero(costs[1] == 0.0) >= 2  # those that were planned


def test_a_grid_without_a_plan_costs_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*arguments: object) -> None:
        raise NoVerdictError("no plan")

    monkeypatch.setattr(module, "design_board", fail)
    found = forecast_costs(grid_plan("C=50p:100p:4"))
    assert not any(seconds.any() for seconds in found.seconds.values())


@pytest.mark.parametrize(("timeout", "most"), [(1e9, math.inf), (2.0, 2.0), (1e-3, 0.0)])
def test_a_run_takes_at_most_the_timeout_and_is_refused_beyond(timeout: float, most: float) -> None:
    plan = ngspice_plan("C=10pF,1nF")
    limited = with_values(plan.scene, {"analysis.timeout": timeout, "design.gain": 4e6})
    exact = planned(Plan(limited, plan.groups, plan.engines))[0].max()
    found = forecast_costs(Plan(limited, plan.groups, plan.engines)).seconds["ngspice"]
    quick = forecast_costs(Plan(limited, parse_axes(limited, "C=1nF"), plan.engines))
    rest = float(quick.seconds["ngspice"][0])
    assert found.max() <= min(exact, most) + 20.0 * rest


def test_the_points_of_a_hybrid_sweep_are_forecast() -> None:
    plan = grid_plan("C=1p:1n:6", "gain=1k:1M:5", hybrid=True)
    stable = np.arange(30).reshape(6, 5) // 5 < 3
    forecast = CostForecast({}, stable.ravel(), 1.0)
    expected = np.zeros((6, 5), dtype=bool)
    expected[2:4] = True
    expected.flat[sample(30)] = True
    assert np.array_equal(forecast.confirmed(plan), expected.ravel())


EVERY = np.ones(100, dtype=np.bool_)


def workers(processes: int = 2, start_up: float = 0.0) -> Workers:
    return Workers(ThreadPoolExecutor(1), lambda: 2, (), (), lambda: processes, start_up)


def costs(ngspice: float, statespace: float, slowness: float = 1.0) -> CostForecast:
    seconds = {"ngspice": np.full(100, ngspice), "statespace": np.full(100, statespace)}
    return CostForecast(seconds, EVERY, slowness)


def line(ngspice: float, statespace: float, engine: str = "ngspice") -> str:
    hybrid = engine == "hybrid"
    engines = BOTH if engine in ("both", "hybrid") else (engine,)
    plan = grid_plan("C=1p:1n:10", "gain=1k:1M:10", engines=engines, hybrid=hybrid)
    forecast = costs(ngspice, statespace)
    left = dict.fromkeys(engines, EVERY)
    if hybrid:
        left["ngspice"] = forecast.confirmed(plan)
    return announcement(plan, forecast, left, 0, workers())


def test_points_and_time() -> None:
    assert line(0.4, 0.1) == "100 points: about 20 s in 2 processes"
    assert line(0.4, 0.1, "statespace") == "100 points: about 5 s in 2 processes"
    assert line(0.4, 0.1, "both") == "200 points: about 25 s in 2 processes"


def test_the_state_space_engine_is_proposed_where_it_is_20_times_as_fast() -> None:
    assert "statespace" not in line(1.9, 0.1)
    assert line(2.1, 0.1).endswith("; --engine statespace: about 5 s")
    assert "statespace" not in line(0.1, 0.001)  # 5 s do not matter
    assert "statespace" not in line(2.1, 0.1, "statespace")


def test_the_hybrid_engine_is_proposed_above_five_minutes_of_ngspice() -> None:
    assert "hybrid" not in line(5.9, 1.0)
    expected = (len(sample(100)) * 6.1 + 100 * 1.0) / 2
    assert line(6.1, 1.0).endswith(
        f"; --engine hybrid, ngspice only at the decisive points: about {duration(expected)}"
    )
    assert "--engine hybrid" in line(6.1, 1.0, "both")
    assert "--engine hybrid" not in line(1e4, 1.0, "hybrid")


def test_a_hybrid_sweep_names_the_points_of_ngspice() -> None:
    assert line(2.0, 0.1, "hybrid") == (
        "100 points and ngspice at about 5 of them: about 10 s in 2 processes"
    )


def test_stored_points_are_named() -> None:
    plan = grid_plan("C=1p:1n:10", "gain=1k:1M:10", engines=("ngspice",))
    left = {"ngspice": np.arange(100) < 25}
    found = announcement(plan, costs(2.0, 1.0), left, 75, workers(1))
    assert found == "100 points, 75 results are stored: about 50 s in 1 process"


@pytest.mark.parametrize(("processes", "seconds"), [(1, 200.0), (4, 50.0), (0, 200.0)])
def test_the_time_is_divided_by_the_processes(processes: int, seconds: float) -> None:
    assert wall_time(costs(2.0, 1.0), {"ngspice": EVERY}, workers(processes)) == seconds


def test_the_time_has_the_start_the_other_work_and_the_dearest_point() -> None:
    forecast = costs(2.0, 1.0, slowness=3.0)
    assert wall_time(forecast, {"ngspice": EVERY}, workers(2, 5.0)) == 3.0 * (100.0 + 5.0)
    forecast.seconds["ngspice"][0] = 500.0
    assert wall_time(forecast, {"ngspice": EVERY}, workers(2)) == 3.0 * 500.0


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
