"""The second set of planted faults: in the judging, on scenes that must not pass.

A fault of the judging cannot show on a scene that passes. Each entry has a scene whose right result
is known and is no pass, and a fault with which the result is another one.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.file import load_scene
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.verification.verdict.agreement import compare_engines
from taction.verification.verdict.bounded_measures import measure_with_bounds
from taction.verification.verdict.checks import Outcome, at_most, overall
from taction.verification.verdict.error_budget import error_budget
from taction.verification.verdict.verify import Verdict, verify
from tests.mutation import faults, planting
from tests.mutation.mutation import AGREE, MATRIX, NGSPICE, SETTLES
from tests.mutation.planting import Plant
from tests.support.paths import SCENES

Change = Callable[[Any], Any]
VERDICT, BUDGET = "outcome", "error budget"
FAR = 0.01  # of the true total: a budget that is further off is wrong


@dataclass(frozen=True)
class Misjudgement:
    """A fault of the judging, and a board that must not pass.

    Attributes
    ----------
    fault, where : str
        What is wrong, and in which function.
    board : str
        The scene that must not pass, in words.
    scene : callable
        Makes the scene.
    plant : Plant
        Verifies the scene; with a fault of its own where the board itself is wrong.
    function : callable
        The function of the judging that gets the fault.
    change : callable
        Makes the faulty function from it.
    caught_by : str
        The check, `VERDICT` or `BUDGET` whose result the fault changes.
    right : str
        The right result.
    """

    fault: str
    where: str
    board: str
    scene: Callable[[], Scene]
    plant: Plant
    function: Callable[..., Any]
    change: Change
    caught_by: str
    right: str

    def found(self, *, faulty: bool) -> str:
        """Return the result of `caught_by`, with or without the fault."""
        scene = self.scene()
        with pytest.MonkeyPatch.context() as patch:
            if faulty:
                everywhere(self.function, self.change(self.function), patch)
            return result(self.plant(scene, patch), self.caught_by)


def everywhere(old: Any, new: Any, patch: pytest.MonkeyPatch) -> None:
    """Replace a function in every module of taction that has it."""
    places = [
        (module, name)
        for path, module in list(sys.modules.items())
        if path.partition(".")[0] == "taction"
        for name, value in list(vars(module).items())
        if value is old
    ]
    assert places
    for module, name in places:
        patch.setattr(module, name, new)


def result(verdict: Verdict, name: str) -> str:
    """Return what a verdict says: its outcome, that of a check, or whether its budget is right."""
    if name == VERDICT:
        return verdict.outcome.value
    if name == BUDGET:
        return "right" if abs(stated(verdict) / true_total(verdict) - 1.0) <= FAR else "wrong"
    return next(check.outcome.value for check in verdict.checks if check.name == name)


def stated(verdict: Verdict) -> float:
    """Return the total of the error budget, V."""
    assert verdict.budget.total is not None
    assert verdict.budget.total.value is not None
    return verdict.budget.total.value


def true_total(verdict: Verdict) -> float:
    """Return the largest distance of the regularised optimum from the true stress, V.

    Of these boards all other parts of the budget are below 1e-3 of it.
    """
    problem, unit = make_problem(verdict.scene), verdict.scene.design.unit_voltage
    assert problem.stress is not None
    T, lam = problem.matrix, verdict.scene.design.lam
    assert lam is not None
    optimum = np.linalg.solve(T.T @ T + lam * np.eye(T.shape[1]), T.T @ problem.strain)
    return float(np.abs(optimum - problem.stress).max()) * unit


def shipped() -> Scene:
    """Return a linear scene, by ngspice: its readings have uncertainties far above rounding."""
    return load_scene(SCENES / f"{MATRIX}.toml").with_engine(NGSPICE)


def limited(share: float) -> Callable[[], Scene]:
    """Return a scene whose limit is above the settling time by `share` of its uncertainty."""

    def make() -> Scene:
        scene = shipped()
        check = next(each for each in verify(scene).checks if each.name == SETTLES)
        assert check.value is not None
        assert check.uncertainty is not None
        limit = check.value + share * check.uncertainty
        return with_values(scene, {"checks.settling_time.max": limit})

    return make


def too_strict() -> Scene:
    """Return a scene whose limit for the steady state no board of these op-amps keeps."""
    return with_values(shipped(), {"checks.steady_state.tolerance": 1e-7})


def optimistic(function: Any) -> Any:
    """Take the uncertainty off the value in the place of adding it."""
    return lambda value, uncertainty, limit: function(value, -uncertainty, limit)


def only_failures(function: Any) -> Any:
    """Let an inconclusive check pass."""
    return lambda checks: function([c for c in checks if c.outcome is not Outcome.INCONCLUSIVE])


def at_the_end(function: Any) -> Any:
    """Compare the engines at the last instant only."""

    def compare(companion: Any, *given: Any, **options: Any) -> Any:
        last = {name: getattr(companion, name)[-1:] for name in ("instants", "u", "other")}
        return function(replace(companion, **last), *given, **options)

    return compare


def at_the_start(function: Any) -> Any:
    """Take the record's start for its end."""

    def budget(design: Any, ideal: Any, recording: Any, *given: Any, **options: Any) -> Any:
        return function(design, ideal, replace(recording, u=recording.u[:1]), *given, **options)

    return budget


def halved(function: Any) -> Any:
    """Halve the uncertainty of every time."""
    change = faults.with_uncertainties(0.5)
    return lambda *given, **options: change(function(*given, **options))


CLOSE, NEAR = limited(0.3), limited(0.75)
MISJUDGEMENTS = (
    Misjudgement(
        "value minus uncertainty in the place of value plus uncertainty",
        "comparison with a limit",
        "the limit of the settling time is above it by 0.3 of its uncertainty",
        CLOSE, planting.nothing, at_most, optimistic, SETTLES, "inconclusive",
    ),
    Misjudgement(
        "an inconclusive check does not block a pass",
        "outcome of all checks",
        "the limit of the settling time is above it by 0.3 of its uncertainty",
        CLOSE, planting.nothing, overall, only_failures, VERDICT, "inconclusive",
    ),
    Misjudgement(
        "an uncertainty is halved",
        "readings",
        "the limit of the settling time is above it by 0.75 of its uncertainty",
        NEAR, planting.nothing, measure_with_bounds, halved, SETTLES, "inconclusive",
    ),
    Misjudgement(
        "the engines are compared at one instant, the last one",
        "comparison of the engines",
        "ngspice gets a deck whose C is off by 1 %",
        shipped, planting.in_the_deck(faults.scaled("capacitors", "c_", farads=1.01)),
        compare_engines, at_the_end, AGREE, "fail",
    ),
    Misjudgement(
        "the budget is made at the record's start",
        "error budget",
        "the limit of the steady state is 1e-7",
        too_strict, planting.nothing, error_budget, at_the_start, BUDGET, "right",
    ),
)  # fmt: skip
