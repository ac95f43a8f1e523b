"""A work-precision study as JSON and as tables."""

from __future__ import annotations

from typing import Any

from taction.verification.studies.work_precision.methods import Method
from taction.verification.studies.work_precision.norms import NORMS
from taction.verification.studies.work_precision.run_errors import ProblemErrors
from taction.verification.studies.work_precision.study import (
    ERRORS,
    SettingResult,
    WorkPrecisionStudy,
)


def accuracy_document(study: WorkPrecisionStudy) -> dict[str, Any]:
    """Return `study` as plain data, SI base units; errors are fractions, None where unknown."""
    transient = study.extent.transient
    pole = study.extent.pole
    methods = list(dict.fromkeys(point.method for point in study.points))
    return {
        "scene": study.scene.name,
        "file": str(study.scene.file),
        "stop": transient.stop,
        "whole_stop": study.extent.whole,
        "stretch": study.extent.text,
        "period": study.extent.period,
        "pole": None if pole is None else [pole.real, pole.imag],
        "norms": list(NORMS),
        "problems": {name: _problem(errors) for name, errors in study.problems.items()},
        "methods": [_method(study, method) for method in methods],
        "cheapest": [_cheapest(study, error) for error in ERRORS],
        "omissions": list(study.omissions),
        "machine": study.machine,
        "seconds": study.seconds,
    }


def _problem(errors: ProblemErrors) -> dict[str, Any]:
    scale = errors.scale
    return {
        "references": list(errors.references),
        "reference_error": errors.floor,
        "step_amplitude": None if scale is None else scale.amplitude,
        "settling_band": None if scale is None else scale.band,
        "settling_time": None if scale is None else scale.settling_time,
        "ringing": None if scale is None else scale.ringing,
    }


def _method(study: WorkPrecisionStudy, method: Method) -> dict[str, Any]:
    order = study.orders[method.name]
    return {
        "name": method.name,
        "engine": method.engine,
        "problem": method.problem,
        "setting": method.setting,
        "order": order.value,
        "order_uncertainty": order.sigma,
        "order_theory": method.order,
        "order_theory_says": method.theory,
        "order_points": [study.of(method)[place].setting for place in order.points],
        "order_reason": order.reason,
        "points": [point_record(point) for point in study.of(method)],
    }


def point_record(point: SettingResult) -> dict[str, Any]:
    """Return the result of one setting as plain data."""
    return {
        "setting": point.setting if point.method.setting else None,
        "status": point.status,
        "seconds": point.seconds,
        "seconds_fastest": point.fastest,
        "seconds_slowest": point.slowest,
        "repeats": point.repeats,
        "steps": point.steps,
        "factorisations": point.factorisations,
        "mean_step": point.mean_step,
        "errors": dict(point.errors),
        "reference": point.reference,
        "note": point.note,
    }


def _cheapest(study: WorkPrecisionStudy, error: float) -> dict[str, Any]:
    document: dict[str, Any] = {"error": error, "any": None, "ngspice": None}
    for name, engines in (("any", None), ("ngspice", ["ngspice"])):
        if point := study.cheapest(error, engines=engines):
            document[name] = {
                "method": point.method.name,
                "setting": point.setting if point.method.setting else None,
                "seconds": point.seconds,
                "achieved": point.errors["maximum"],
            }
    return document
