"""A work-precision study of a small board, its references and its fitted orders."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from taction.system.array_types import Waveforms
from taction.system.errors import EngineError
from taction.verification.studies import work_precision as study_module
from taction.verification.studies.work_precision import (
    METHODS,
    Method,
    WorkPrecisionStudy,
    accuracy,
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
)


@pytest.fixture(scope="module")
def found(ngspice: str) -> WorkPrecisionStudy:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study_module, "REPEATS", 2)
        patch.setattr(study_module, "METHODS", FEW)
        return accuracy(ringing_scene(), budget=BUDGET)


def test_every_setting_is_a_point_and_errors_fall_along_ladders(found: WorkPrecisionStudy) -> None:
    assert len(found.points) == sum(len(method.ladder) for method in FEW)
    for point in found.points:
        assert point.status == "done"
        assert point.seconds > 0.0
    for point in found.of(FEW[0]):  # the steps of ngspice are the points of its record
        periods = found.transient.stop / found.period
        assert point.steps >= 0.99 * periods * point.setting
    for method in FEW:
        errors = [point.error for point in found.of(method)]
        assert None not in errors
        assert errors == sorted(errors, reverse=True)
    exact = found.of(FEW[2])[0].error
    assert exact < 1e-9  # the rounding of the two references: 0.9e-10 to 1.5e-10, by BLAS kernel


def test_the_cheapest_setting_that_reaches_the_error(found: WorkPrecisionStudy) -> None:
    for engines in (("ngspice", "statespace"), ("ngspice",)):
        points = [p for p in found.points if p.method.engine in engines and p.error <= 1e-3]
        assert found.cheapest(1e-3, engines).seconds == min(p.seconds for p in points)
    assert found.cheapest(1e-20) is None
    assert found.cheapest(1e-8, ["ngspice"]) is None
    assert (found.outcome, replace(found, points=()).outcome) == ("pass", "inconclusive")


def sleeps(*task: object) -> Waveforms:
    time.sleep(60.0)
    raise AssertionError


def refuses(*task: object) -> Waveforms:
    raise EngineError("no answer")


def ladder_of(run: Callable[..., Waveforms]) -> Method:
    return named("state space, implicit", run=run, ladder=(1e-3, 1e-5))


def test_a_time_out_and_a_failure_are_points_with_reasons(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study_module, "LEAST_TIME", 0.6)
    monkeypatch.setattr(study_module, "METHODS", [ladder_of(sleeps)])
    found = accuracy(ringing_scene(), budget=1e-9)
    (late,) = found.points
    assert (late.status, late.error, late.seconds) == ("timeout", None, 0.6)
    monkeypatch.setattr(study_module, "LEAST_TIME", 60.0)
    monkeypatch.setattr(study_module, "METHODS", [ladder_of(refuses)])
    found = accuracy(ringing_scene(), budget=1e-9)
    assert (found.points[0].status, found.outcome) == ("failed", "inconclusive")
    assert found.points[0].note == "EngineError: no answer"
