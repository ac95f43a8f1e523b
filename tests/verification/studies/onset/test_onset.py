"""Onset of oscillation: closed forms and the calibrated board, put on trial by a real ngspice."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

import taction
from taction.netlist_gen.board.circuit import Circuit, Output
from taction.netlist_gen.board.parts import (
    Capacitor,
    CurrentSource,
    OpAmpCell,
    Resistor,
    ResistorMatrix,
)
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.scene import load_scene
from taction.spice_models.opamp import OpAmp
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.stability.families import Family
from taction.verification.stability.poles import poles
from taction.verification.studies import onset as onset_module
from taction.verification.studies.onset import CheckedEdge, along, board_over, confirmations, onset
from tests.support.boards import bare, single_mode, window
from tests.support.paths import SCENES

TUNED = SCENES / "tuned-breadboard.toml"
EXPONENTIAL = SCENES / "paper-exponential.toml"
TAU, R = 0.455e-6, 10e3


def feedback(source: str, ohms: float) -> tuple[ResistorMatrix]:
    """One resistor from `source` to node x, as the 1 x 1 matrix that a deck has."""
    one = np.array([[ohms]])
    return (ResistorMatrix("Rb", one, one < 0, False, (source,), ("",), ("x",)),)


def lagging(farads: float) -> Circuit:
    """K = 100 and two equal lags: ``(1 + pRC)(1 + p tau)^2 + 100 = 0``."""
    made = single_mode(farads * R, TAU)
    kept = tuple(r for r in made.resistors if r.name != "Rk")
    return replace(made, resistors=kept, matrices=feedback("b2", R / 100.0))


def latch(farads: float, ohms: float) -> Circuit:
    """Positive feedback: ``p = (10 kohm / ohms - 1) / RC``, a real pole."""
    inverter = (Resistor("Ri", "v", "j", R), Resistor("Rj", "j", "a", R))
    return bare(
        models={"ideal": OpAmp("ideal", 1e8)},
        opamps=(OpAmpCell("v", "ideal", "0", "x", "v"), OpAmpCell("a", "ideal", "0", "j", "a")),
        resistors=(Resistor("R", "x", "v", R), *inverter),
        matrices=feedback("a", ohms),
        capacitors=(Capacitor("C", "x", "v", farads),),
        currents=(CurrentSource("I", "x", -1e-7),),
        constraint_nodes=("a",),
        outputs=(Output("v", 1.0),),
    )


def check_sides(trial: CheckedEdge, share: float = 0.03) -> None:
    """Both sides within `share` of the pole, and with opposite signs."""
    assert trial.confirmed is True, trial.reason
    for side in (trial.below, trial.above):
        assert side.measured.growth_rate == pytest.approx(side.predicted.real, rel=share)
        ringing = abs(side.predicted.imag)
        assert math.tau * side.measured.frequency == pytest.approx(ringing, rel=0.003)
    assert trial.below.predicted.real * trial.above.predicted.real < 0.0


def test_both_ends_of_the_window_of_the_single_mode(ngspice: str) -> None:
    boards = Family.over(lagging)
    found = boards.scan(np.geomspace(1e-13, 1e-8, 61).tolist())
    ends = [TAU * ratio / R for ratio in window(100.0)]
    assert [c.value for c in found.edges] == pytest.approx(ends, rel=1e-6)
    for each in confirmations(boards, found, timeout=600.0):
        check_sides(each)


@pytest.mark.parametrize("farads", [1e-10, 1e-4])  # RC of 1 us and of 1 s
def test_a_real_pole_that_crosses_at_zero_is_confirmed_too(farads: float, ngspice: str) -> None:
    boards = Family.over(partial(latch, farads))
    found = boards.scan(np.geomspace(1e3, 1e5, 21).tolist())
    (crossing,) = found.edges
    assert crossing.value == pytest.approx(R, rel=1e-6)
    assert (crossing.frequency, crossing.unstable_above) == (0.0, False)
    (finding,) = confirmations(boards, found, timeout=600.0)
    check_sides(finding)
    assert finding.above.predicted.real == pytest.approx((1 / 1.03 - 1) / (R * farads), rel=1e-4)


def test_an_antisymmetric_mode_that_the_load_never_excites_is_confirmed(ngspice: str) -> None:
    scene = load_scene(TUNED)
    found = onset(scene, over="C=3pF:30pF:21")
    (low, _), (high, edge) = ((f, f.crossing) for f in found.findings)
    assert edge.value == pytest.approx(4.134e-12, rel=1e-4)
    assert (edge.below, edge.above, edge.changes_stability) == (2, 0, True)
    assert low.crossing.changes_stability is False
    assert [(own, loci) for _, own, loci in found.scan.counts] == [(4, 4), (2, 2), (0, 0)]
    check_sides(high)
    (stable,) = found.scan.stable_ranges
    assert stable == (edge.value, 3e-11)
    # At 3.8 pF the pole stands at +2.7e4 /s, and its mode is antisymmetric.
    board = LinearBoard(board_over(scene, found.axis)(3.8e-12))
    pole = poles(board).rightmost
    assert pole.real == pytest.approx(2.7e4, rel=0.02)
    start = along(board, pole).voltages
    rest = board.equilibrium
    v = np.array([start[node] - rest[node] for node in board.circuit.signal_nodes])
    assert v == pytest.approx(-v[::-1], abs=1e-6 * np.abs(v).max())


def test_an_exponential_board_is_taken_at_the_equilibrium_of_each_value(ngspice: str) -> None:
    scene = load_scene(EXPONENTIAL)
    found = onset(scene, over="gain=2M:10M:15")
    (finding,) = found.findings
    assert finding.crossing.unstable_above
    assert finding.crossing.value == pytest.approx(6.829e6, rel=1e-3)
    check_sides(finding)
    assert found.outcome == "pass"


def test_a_mode_hidden_by_a_faster_instability_is_left_undecided(ngspice: str) -> None:
    scene = load_scene(EXPONENTIAL)
    found = onset(scene, over="gain=10M:20M:7")
    (finding,) = found.findings
    assert finding.crossing.below == 2
    assert finding.confirmed is None
    assert "the fit is uncertain" in finding.reason


def test_an_integration_that_damps_is_reported_as_a_disagreement(
    monkeypatch: pytest.MonkeyPatch, ngspice: str
) -> None:
    """Confirmations use Gear's method and steps that damp a growing mode."""

    def damped(circuit: Circuit, analysis: Any, **options: Any) -> Any:
        coarse = replace(analysis, method="gear", max_step=8.0 * analysis.max_step, truncation=1e3)
        return write_deck(circuit, coarse, **options)

    monkeypatch.setattr(onset_module, "write_deck", damped)
    found = taction.onset(TUNED, over="C=4pF:5pF:3")
    (trial,) = found.findings
    assert (found.outcome, trial.confirmed) == ("inconclusive", False)
    assert "the transient grows with -" in trial.reason
    assert trial.below.predicted.real > 0.0 > trial.below.measured.growth_rate


def test_without_ngspice_crossings_stay_undecided(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TACTION_NGSPICE", "/nonexistent/ngspice")
    boards = Family.over(lagging)
    found = boards.scan(np.geomspace(1e-10, 1e-8, 21).tolist())
    (finding,) = confirmations(boards, found, timeout=600.0)
    assert finding.confirmed is None
    assert "ngspice is needed" in finding.reason
