"""The line before a sweep."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from taction.verification.studies.running.worker import Workers
from taction.verification.studies.sweep.announcement import announcement, duration, wall_time
from taction.verification.studies.sweep.cost_forecast import CostForecast
from taction.verification.studies.sweep.hybrid import sample
from tests.support.sweeping import BOTH, grid_plan

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
