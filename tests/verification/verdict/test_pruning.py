"""The effect of pruning in a verdict, against a dense solution of 30 digits."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest

import taction
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.verification.report.verdict.json_document import verdict_document
from taction.verification.verdict.error_chain import ErrorPart
from tests.support.making import make_scene

PRUNE = 0.03  # the two corners of the kernel, 0.0256 of its largest entry


def scene(prune: float, amplifier: str = "linear") -> Scene:
    design = {"prune": prune, "amplifier": amplifier, "lambda": 0.8, "resistor_series": "E96"}
    return make_scene(design=design, analysis={"engine": "statespace"})


def tikhonov(T: Floats, eps: Floats, lam: float) -> Floats:
    with mp.workdps(30):
        A = mp.matrix(T.tolist())
        u = mp.lu_solve(A.T * A + lam * mp.eye(A.cols), A.T * mp.matrix(eps.tolist()))
        return np.array([float(value) for value in u])


def test_the_change_is_measured_beside_its_bound() -> None:
    pruned_scene = scene(PRUNE)
    verdict, problem = taction.verify(pruned_scene), make_problem(pruned_scene)
    T, eps = problem.matrix, problem.strain
    kept = np.where(np.abs(T) < PRUNE * np.abs(T).max(), 0.0, T)
    assert np.count_nonzero(kept != T) == 2
    whole, after = tikhonov(T, eps, 0.8), tikhonov(kept, eps, 0.8)
    budget = {part.name: part for part in verdict.budget}
    part = budget["pruning"]
    change = float(np.abs(after - whole).max())
    assert part.value == pytest.approx(change, rel=1e-9)
    assert part.bound is not None
    assert change < part.bound < 50 * change
    assert part.how.startswith("optimum without 2 entries of T")
    # The reference keeps the whole T, and the other parts do not contain the pruning.
    assert np.array_equal(verdict.ideal.network.T, T)
    assert verdict.ideal.target == pytest.approx(whole, rel=1e-9)
    rounded = {p.name: p for p in taction.verify(scene(0.0)).budget}["resistors"].value
    assert rounded is not None
    assert budget["resistors"].value == pytest.approx(rounded, rel=0.1)
    record = verdict_document(verdict)["error_budget"]["pruning"]
    assert (record["value"], record["bound"]) == (part.value, part.bound)


@pytest.mark.parametrize("amplifier", ["exponential", "softplus"])
def test_other_amplifiers_have_a_proven_bound_too(amplifier: str) -> None:
    parts = {part.name: part for part in taction.verify(scene(PRUNE, amplifier)).budget}
    found = parts["pruning"]
    assert found.value is not None
    assert found.bound is not None
    assert 0.0 < found.value < found.bound < 100 * found.value


def test_a_board_that_leaves_nothing_out_has_no_such_part() -> None:
    names = [part.name for part in taction.verify(scene(1e-3)).budget]
    assert names == ["ill_posedness", "resistors", "opamps", "unsettled", "simulator"]
    assert ErrorPart("x", 1.0, "y").bound is None
