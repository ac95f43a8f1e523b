"""A work-precision study of a small board, its norms and its fitted orders."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from taction.system.array_types import Floats
from taction.system.documents import plain
from taction.system.errors import EngineError, SimulatorNotFound
from taction.verification.report.renderers.page import write_page
from taction.verification.report.renderers.picture import draw_page
from taction.verification.report.views.accuracy import view
from taction.verification.studies.running.worker import Worker
from taction.verification.studies.work_precision import ladders
from taction.verification.studies.work_precision import study as study_module
from taction.verification.studies.work_precision.errors import (
    NORMS,
    ErrorScale,
    make_scale,
    measure_errors,
)
from taction.verification.studies.work_precision.methods import (
    METHODS,
    Method,
    MethodRun,
    MethodTask,
)
from taction.verification.studies.work_precision.study import (
    WorkPrecisionStudy,
    fit_order,
    run_study,
)
from tests.support.making import ringing_scene

BUDGET = 120.0  # s: far more than it takes, also on a machine that is busy


def named(name: str, **changes: Any) -> Method:
    return replace(next(m for m in METHODS if m.name == name), **changes)


LADDER = (16.0, 32.0, 64.0, 125.0)
FEW = (
    named("ngspice trapezoidal", ladder=LADDER),
    named("ngspice Gear", ladder=LADDER),
    named("state space, exact"),
    named("state space, implicit", ladder=(1e-3, 1e-5, 1e-8)),
    named("ideal network, Radau", ladder=(1e-5, 1e-6, 1e-7, 1e-8)),
    named("ideal network, LSODA", ladder=(1e-4, 1e-7)),
)


@pytest.fixture(scope="module")
def found(ngspice: str) -> WorkPrecisionStudy:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ladders, "REPEATS", 2)
        return run_study(ringing_scene(), budget=BUDGET, methods=FEW)


def test_every_setting_is_a_point_with_errors_and_a_spread(found: WorkPrecisionStudy) -> None:
    assert len(found.points) == sum(len(method.ladder) for method in FEW)
    for point in found.points:
        assert point.status == "done"
        assert point.repeats == 2
        assert point.slowest is not None
        assert 0.0 < point.fastest <= point.seconds <= point.slowest
        for norm in ("final", "maximum", "settling_time"):
            assert point.errors[norm] is not None
        rings = point.method.problem == "board"
        assert (point.errors["frequency"] is not None) == rings
        assert (point.errors["growth_rate"] is not None) == rings


def test_ngspice_tells_its_steps_and_factorisations(found: WorkPrecisionStudy) -> None:
    for point in found.of(FEW[0]):
        assert point.factorisations >= 2 * point.steps  # an iteration and its confirmation
        periods = found.extent.transient.stop / found.extent.period
        assert point.steps >= 0.99 * periods * point.setting


def test_each_reference_is_by_another_solver(found: WorkPrecisionStudy) -> None:
    by = {
        "state space, exact": "modes",
        "state space, implicit at 1e-12": "Radau IIA, 9 stages",
        "exact modes": "modes",
    }
    for point in found.points:
        assert by[point.reference] != point.method.solver
    for judgement in found.problems.values():
        floor = judgement.floor["maximum"]
        assert len(judgement.references) == 2
        assert floor < 1e-10


def test_errors_fall_along_every_ladder(found: WorkPrecisionStudy) -> None:
    for method in FEW:
        errors = [point.errors["maximum"] for point in found.of(method)]
        assert errors == sorted(errors, key=lambda e: e or 0.0, reverse=True)
    exact = found.of(FEW[2])[0].errors["maximum"]
    assert exact < 1e-10


def test_the_fitted_orders_are_the_theoretical_ones(found: WorkPrecisionStudy) -> None:
    for name in ("ngspice trapezoidal", "ngspice Gear"):
        order = found.orders[name]
        assert order.points == (0, 1, 2, 3)
        assert order.value == pytest.approx(2.0, abs=0.15)
    radau = found.orders["ideal network, Radau"].value
    assert radau == pytest.approx(5.0, abs=0.5)
    assert found.orders["state space, exact"].value is None


def test_the_phase_error_of_the_trapezoidal_rule_is_the_closed_form(
    found: WorkPrecisionStudy,
) -> None:
    """Its frequency is ``(2/h) atan(omega h / 2)``: too low by ``(omega h)^2 / 12``."""
    pole = found.extent.pole
    for point in found.of(FEW[0]):
        h = found.extent.period / point.setting
        assert point.errors["frequency"] == pytest.approx(abs(pole * h) ** 2 / 12, rel=0.15)


def test_the_cheapest_setting_reaches_the_error_and_is_the_cheapest(
    found: WorkPrecisionStudy,
) -> None:
    for engines in (None, ["ngspice"]):
        point = found.cheapest(1e-3, engines=engines)
        error = point.errors["maximum"]
        assert error <= 1e-3
        for other in found.points:
            ours = other.method.problem == "board"
            if ours and (engines is None or other.method.engine in engines):
                good = other.errors["maximum"]
                if good is not None and good <= 1e-3:
                    assert (point.seconds or 0.0) <= (other.seconds or math.inf)
    assert found.cheapest(1e-20) is None
    assert found.cheapest(1e-8, engines=["ngspice"]) is None
    ideal = tuple(point for point in found.points if point.method.problem == "ideal")
    assert (found.outcome, replace(found, points=ideal).outcome) == ("pass", "inconclusive")


def test_document_and_picture(found: WorkPrecisionStudy, tmp_path: Path) -> None:
    document = plain(found)
    assert [m["name"] for m in document["methods"]] == [m.name for m in FEW]
    assert document["norms"] == list(NORMS)
    assert document["machine"]["ngspice"] is not None
    assert document["stretch"].startswith("the whole transient")
    first = document["methods"][0]
    assert first["order_theory"] == 2.0
    assert first["order_points"] == list(LADDER)
    late = replace(found.points[0], status="timeout", errors=dict.fromkeys(NORMS))
    page = view(replace(found, points=(late, *found.points[1:])))
    draw_page(page, tmp_path / "a.svg")
    picture = (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert "timed out" in picture
    write_page(page, str(tmp_path / "a.html"))
    assert "timed out at 16 points per period" in (tmp_path / "a.html").read_text("utf-8")
    assert picture.count("</svg>") == 1


def sleeps(task: MethodTask, setting: float) -> MethodRun:
    import time

    time.sleep(60.0)
    raise AssertionError


def refuses(task: MethodTask, setting: float) -> MethodRun:
    raise EngineError("no answer")


def ladder_of(run: Callable[..., MethodRun]) -> Method:
    return named("state space, implicit", run=run, ladder=(1e-3, 1e-5))


def test_a_time_out_is_a_point_and_a_failure_has_its_reason() -> None:
    with Worker() as worker:
        task: Any = None
        worker.call(60.0, abs, -1)
        late, left = ladders.run_ladders(task, [ladder_of(sleeps)], 0.5, worker, print)
        failed, none = ladders.run_ladders(task, [ladder_of(refuses)], 60.0, worker, print)
    assert [entry.status for entry in late] == ["timeout"]
    assert late[0].seconds[0] == pytest.approx(0.25, abs=0.05)  # half of what was left
    assert left == ["state space, implicit, tolerance 1e-05: not run, the setting before timed out"]
    assert [entry.status for entry in failed] == ["failed", "failed"]
    assert failed[0].note == "EngineError: no answer"
    assert none == []


def test_without_ngspice_and_without_linearity_it_says_what_it_left_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def nowhere() -> None:
        raise SimulatorNotFound("no executable 'ngspice'")

    monkeypatch.setattr(study_module, "find_simulator", nowhere)
    monkeypatch.setattr(ladders, "REPEATS", 1)
    bent = {"amplifier": "exponential", "exponential_slope": 0.1}
    scene = ringing_scene(bent | {"resistance": 1.9e6, "capacitance": 5e-11}, stop=6e-5)
    methods = [m for m in FEW if m.problem == "board"]
    found = run_study(scene, budget=BUDGET, methods=methods)
    assert found.omissions == (
        *study_module.NEVER_RUN,
        "ngspice trapezoidal: not run, no executable 'ngspice'",
        "ngspice Gear: not run, no executable 'ngspice'",
        "state space, exact: not run, the board is not linear",
    )
    assert {point.reference for point in found.points} == {"LSODA at 1e-12 on the state space"}
    errors = [point.errors["maximum"] for point in found.points]
    assert errors == sorted(errors, key=lambda e: e or 0.0, reverse=True)
    assert errors[-1] < 1e-8


def test_a_machine_that_uses_the_budget_before_the_ladders_gives_fewer_rows(
    ngspice: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A start that takes longer than the budget leaves a quarter of it to the ladders."""
    offsets = itertools.chain([0.0], itertools.repeat(1e4))  # s, at the start and later
    late = SimpleNamespace(perf_counter=lambda: time.perf_counter() + next(offsets))
    monkeypatch.setattr(study_module, "clock", late)
    monkeypatch.setattr(ladders, "REPEATS", 1)
    study = run_study(ringing_scene(), budget=BUDGET, methods=FEW[:3])
    assert study.conclusive
    assert study.of(FEW[0])
    assert study.cheapest(1.0) is not None


def test_the_coarsest_setting_of_every_method_runs_first() -> None:
    found = list(ladders._schedule(FEW))
    assert [method.name for method, _ in found[: len(FEW)]] == [method.name for method in FEW]
    assert sorted((m.name, s) for m, s in found) == sorted(
        (m.name, s) for m in FEW for s in m.ladder
    )


STEPS = [2.0**-k for k in range(8)]
NAMES = [str(k) for k in range(8)]


def test_a_clean_ladder_gives_its_order_and_constant() -> None:
    found = fit_order(STEPS, [0.05 * h**3 for h in STEPS], 0.0, NAMES)
    assert found.value == pytest.approx(3.0, abs=1e-12)
    assert found.constant == pytest.approx(0.05, rel=1e-12)
    assert found.points == tuple(range(8))
    assert found.reason == ""


def test_what_is_not_asymptotic_and_what_is_at_the_floor_is_left_out() -> None:
    """Saturation above, the reference's error of 1e-6 below: the three between remain."""
    errors = [min(8.0 * h**2, 0.9) + 1e-6 * (k > 6) for k, h in enumerate(STEPS)]
    found = fit_order(STEPS, errors, 1e-4, NAMES)
    assert found.points == (4, 5, 6)
    assert found.value == pytest.approx(2.0, abs=1e-12)
    assert "3 is not asymptotic" in found.reason
    assert "7 is at the reference's own error" in found.reason


def test_a_time_out_is_no_error_and_breaks_nothing() -> None:
    errors = [0.05 * h for h in STEPS[:-1]]
    found = fit_order([*STEPS[:-1], None], [*errors, None], 0.0, NAMES)
    assert found.value == pytest.approx(1.0)
    assert found.reason == "7 has no error"


def test_an_outlier_is_named() -> None:
    errors = [0.05 * h**2 for h in STEPS]
    errors[0] = 1e-5
    found = fit_order(STEPS, errors, 0.0, NAMES)
    assert found.points == tuple(range(1, 8))
    assert found.reason == "0 is off the line"


def test_scatter_and_two_points_show_no_order(rng: np.random.Generator) -> None:
    noise = fit_order(STEPS, (10.0 ** rng.uniform(-6, -2, 8)).tolist(), 0.0, NAMES)
    assert noise.value is None or len(noise.points) < 5
    assert fit_order(STEPS[:2], [1e-2, 1e-3], 0.0, NAMES[:2]).value is None
    assert fit_order([1.0, 1.0, 1.0], [1e-2, 1e-3, 1e-4], 0.0, NAMES[:3]).value is None


def test_the_uncertainty_is_that_of_a_straight_line(rng: np.random.Generator) -> None:
    """Against numpy's own least squares with its covariance."""
    errors = [0.05 * h**2 * float(np.exp(0.05 * rng.standard_normal())) for h in STEPS]
    found = fit_order(STEPS, errors, 0.0, NAMES)
    line, covariance = np.polyfit(np.log(STEPS), np.log(errors), 1, cov=True)
    assert found.value == pytest.approx(line[0], rel=1e-12)
    assert found.sigma == pytest.approx(np.sqrt(covariance[0, 0]), rel=1e-9)


DECAY, OMEGA = 1e3, 2e5
TARGET = np.array([2.0, -1.0])
TIME = np.linspace(0.0, 4e-3, 16001)


def ringing(time: Floats, decay: float = DECAY, omega: float = OMEGA) -> Floats:
    """Two channels that ring around their targets, from 0; step amplitude 2."""
    wave = 1.0 - np.exp(-decay * time) * np.cos(omega * time)
    return np.outer(wave, TARGET)


def scale(band: float = 0.05) -> ErrorScale:
    return make_scale(TIME, ringing(TIME), np.zeros(2), TARGET, band, complex(-DECAY, OMEGA))


def errors_of(u: Floats) -> dict[str, float | None]:
    return measure_errors(MethodRun(TIME, u, 1.0, 1, None), ringing(TIME), scale())


def test_the_scale_is_that_of_the_reference() -> None:
    found = scale()
    assert found.amplitude == 2.0
    assert found.band == 0.05
    # exp(-t) = 0.05 at the last peak before it, so within half a ringing period of 1/decay ln 20
    assert found.settling_time == pytest.approx(np.log(20.0) / DECAY, abs=np.pi / OMEGA)
    assert found.ringing == pytest.approx(complex(-DECAY, OMEGA), rel=1e-6)


def test_a_band_that_the_record_does_not_reach_is_widened() -> None:
    found = scale(band=0.01)
    # what is left at 80 % of the record, times 1.25, to two digits
    assert found.band == pytest.approx(1.25 * np.exp(-3.2), rel=0.03)
    assert found.settling_time is not None


def test_amplitude_errors_are_fractions_of_the_step() -> None:
    errors = errors_of(ringing(TIME) + 1e-3 * np.outer(TIME / TIME[-1], [1.0, 0.5]))
    assert errors["final"] == pytest.approx(5e-4)
    assert errors["maximum"] == pytest.approx(5e-4)


def test_the_pole_of_a_wrong_record_is_found_wrong_by_as_much() -> None:
    errors = errors_of(ringing(TIME, decay=1.1 * DECAY, omega=1.001 * OMEGA))
    assert errors["frequency"] == pytest.approx(1e-3, rel=1e-3)
    assert errors["growth_rate"] == pytest.approx(0.1 * DECAY / OMEGA, rel=1e-2)
    settling = errors["settling_time"]
    assert settling == pytest.approx(0.1 / 1.1, abs=np.pi / OMEGA / 3e-3)


def test_no_error_is_no_error_in_any_norm() -> None:
    assert set(errors_of(ringing(TIME)).values()) == {0.0}


def test_a_record_that_does_not_ring_has_no_ringing_error() -> None:
    errors = errors_of(np.outer(1.0 - np.exp(-DECAY * TIME), TARGET))
    assert errors["frequency"] is None
    assert errors["growth_rate"] is None
    assert errors["final"] is not None
