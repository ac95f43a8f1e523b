"""What pruning saves, against parts counted by hand and a run with and without ngspice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import taction
from taction.netlist_gen.scene.scene import Scene
from taction.verification.verdict.pruning_saving import pruning_of
from tests.support.making import write_matrix_scene
from tests.support.running import document
from tests.support.running import taction as command

T = [[2.0, -0.01, 0.0], [0.5, 1.0, 0.019], [0.002, 0.0, -0.015]]


def scene(prune: float, **design: Any) -> Scene:
    values = {"gain": "1Mohm", "unit_conductance": "10uS", "lam": 0.5, "prune": prune} | design
    return taction.Scene.from_arrays(T, [1.0, 2.0, 0.1], **values)


def test_parts_and_volts_without_ngspice(monkeypatch: pytest.MonkeyPatch) -> None:
    """Four entries, and with them the third row: eight resistors of T, s_3, three inverters.

    The inverters of w_1 and w_3 and that of u_3 have no use any more.
    """
    monkeypatch.setenv("TACTION_NGSPICE", "/nowhere/ngspice")
    found = pruning_of(scene(0.01, unit_voltage=2.0))
    assert found is not None
    assert (found.resistors, found.opamps) == (8 + 1 + 6, 4)
    assert (found.seconds, found.whole_seconds) == (None, None)
    assert found.effect.entries == 4
    assert 0.0 < found.effect.change < found.effect.bound
    once = pruning_of(scene(0.01))
    assert once is not None
    assert found.effect.change == pytest.approx(2.0 * once.effect.change, rel=1e-9)
    assert "saves 15 resistors and 4 op-amps" in found.text
    assert "steps of ngspice" not in found.text


def test_nothing_pruned_is_nothing_to_compare() -> None:
    assert pruning_of(scene(0.0)) is None
    assert pruning_of(scene(1e-4)) is None


def test_a_board_that_only_pruning_makes_possible() -> None:
    """1/R is 25.01 uS; T loads the first channel with 25.02 uS, and with 25 uS when pruned."""
    found = pruning_of(scene(0.01, topology="passive", lam=0.2501))
    assert found is not None
    assert found.resistors is None
    assert found.text.endswith("with the whole T the board cannot be built")


@pytest.mark.usefixtures("ngspice")
def test_the_command_prints_the_measured_times(tmp_path: Path) -> None:
    file = write_matrix_scene(tmp_path, T, [1.0, 2.0, 0.1], "[design]\nprune = 0.01")
    result = command("netlist", str(file), "--explain", "--json")
    assert result.exit_code == 0
    found = document(result)["pruning"]
    assert found["seconds"] > 0.0 < found["whole_seconds"]
    assert found["change"] < found["bound"]
    assert "pruning: moves the steady state by" in result.stderr
    assert "100 steps of ngspice take" in result.stderr
    plain = command("netlist", str(file), "--json")
    assert document(plain)["pruning"] is None  # no solve and no run without --explain
