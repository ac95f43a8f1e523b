"""What pruning changes, against a dense solution of 30 digits, and what it saves, by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import taction
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.verification.report.documents.verdict import verdict_document
from taction.verification.verdict.error_budget import ErrorPart
from taction.verification.verdict.pruning import pruning_of
from tests.support.making import make_scene, write_matrix_scene
from tests.support.oracle import optimum
from tests.support.running import document
from tests.support.running import taction as command

PRUNE = 0.03  # the two corners of the kernel, 0.0256 of its largest entry


def scene(prune: float, amplifier: str = "linear") -> Scene:
    design = {"prune": prune, "amplifier": amplifier, "lambda": 0.8, "resistor_series": "E96"}
    return make_scene(design=design, analysis={"engine": "statespace"})


def test_the_change_is_measured_beside_its_bound() -> None:
    pruned_scene = scene(PRUNE)
    verdict, problem = taction.verify(pruned_scene), make_problem(pruned_scene)
    T, eps = problem.matrix, problem.strain
    kept = np.where(np.abs(T) < PRUNE * np.abs(T).max(), 0.0, T)
    assert np.count_nonzero(kept != T) == 2
    whole, after = optimum(T, eps, 0.8), optimum(kept, eps, 0.8)
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


T = [[2.0, -0.01, 0.0], [0.5, 1.0, 0.019], [0.002, 0.0, -0.015]]


def small(prune: float, **design: Any) -> Scene:
    values = {"gain": "1Mohm", "unit_conductance": "10uS", "lam": 0.5, "prune": prune} | design
    return taction.Scene.from_arrays(T, [1.0, 2.0, 0.1], **values)


def test_parts_and_volts() -> None:
    """Four entries, and with them the third row: eight resistors of T, s_3, three inverters.

    The inverters of w_1 and w_3 and that of u_3 have no use any more.
    """
    found = pruning_of(small(0.01, unit_voltage=2.0))
    assert found is not None
    assert (found.resistors, found.opamps) == (8 + 1 + 6, 4)
    assert found.effect.entries == 4
    assert 0.0 < found.effect.change < found.effect.bound
    once = pruning_of(small(0.01))
    assert once is not None
    assert found.effect.change == pytest.approx(2.0 * once.effect.change, rel=1e-9)
    assert "saves 15 resistors and 4 op-amps" in found.text


def test_nothing_pruned_is_nothing_to_compare() -> None:
    assert pruning_of(small(0.0)) is None
    assert pruning_of(small(1e-4)) is None


def test_a_board_that_only_pruning_makes_possible() -> None:
    """1/R is 25.01 uS; T loads the first channel with 25.02 uS, and with 25 uS when pruned."""
    found = pruning_of(small(0.01, topology="passive", lam=0.2501))
    assert found is not None
    assert found.resistors is None
    assert found.text.endswith("with the whole T the board cannot be built")


def test_the_command_prints_change_and_saving(tmp_path: Path) -> None:
    file = write_matrix_scene(tmp_path, T, [1.0, 2.0, 0.1], "[design]\nprune = 0.01")
    result = command("netlist", str(file), "--explain", "--json")
    assert result.exit_code == 0
    found = document(result)["pruning"]
    assert found["change"] < found["bound"]
    assert "pruning: moves the steady state by" in result.stderr
    plain = command("netlist", str(file), "--json")
    assert document(plain)["pruning"] is None  # no solve without --explain
