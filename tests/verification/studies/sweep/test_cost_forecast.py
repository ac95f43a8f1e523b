"""The forecast of a sweep's cost, against the plans of all of its points."""

from __future__ import annotations

import math

import numpy as np
import pytest

from taction.netlist_gen.scene.axes import parse_axes, with_values
from taction.studies import plan_sweep
from taction.system.errors import NoVerdictError
from taction.verification.studies.sweep import cost_forecast as module
from taction.verification.studies.sweep.cost_forecast import CostForecast, forecast_costs
from taction.verification.studies.sweep.hybrid import sample
from taction.verification.studies.sweep.plan import ENGINE, Plan
from taction.verification.verdict.design import design_board
from taction.verification.verdict.progress import Clock
from tests.support.making import make_scene
from tests.support.paths import SCENES
from tests.support.sweeping import grid_plan

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
    assert len(calls) == 5


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
