"""The paper's three numbers, from scenes/paper-breadboard.toml: measured with ngspice decks."""

from __future__ import annotations

import numpy as np
import pytest

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.loading import load_scene
from taction.verification.engines.ngspice.process import find_simulator, simulate
from tests.support.paths import SCENES
from tests.support.readings import Samples, rise_time

pytestmark = pytest.mark.usefixtures("ngspice")
SCENE = load_scene(SCENES / "paper-breadboard.toml")


def board(farads: float = 10e-12) -> Circuit:
    return synthesise(SCENE, make_problem(SCENE)).turned("C", farads)


def test_the_centre_output_rises_in_ten_microseconds() -> None:
    circuit = board()
    found = simulate(
        write_deck(circuit, Transient(60e-6, 0.1e-6), saved=["v_4"]),
        find_simulator(),
        timeout=60.0,
    )
    T, eps = make_problem(SCENE).matrix, make_problem(SCENE).strain
    lam = circuit.value("lambda")
    target = np.linalg.solve(T.T @ T + lam * np.eye(7), T.T @ eps)[3]
    samples = Samples.of_record(found.time, found["v_4"], float(target))
    assert rise_time(samples, float(target)) == pytest.approx(10e-6, rel=0.05)


@pytest.mark.parametrize(("farads", "stable"), [(10e-12, True), (8.2e-12, False), (6.8e-12, False)])
def test_it_is_stable_at_10_pf_and_oscillates_at_the_next_smaller_values(
    farads: float, stable: bool
) -> None:
    """The ringing's peak-to-peak height in three equal stretches, after the rise."""
    deck = write_deck(board(farads), Transient(1.5e-3, 0.2e-6), saved=["v_4"])
    found = simulate(deck, find_simulator(), timeout=60.0)
    heights = [
        float(np.ptp(found["v_4"][(found.time > start) & (found.time < start + 0.4e-3)]))
        for start in (0.3e-3, 0.7e-3, 1.1e-3)
    ]
    assert heights == sorted(heights, reverse=stable)
    assert (heights[-1] < 0.7 * heights[0]) is stable
    assert (heights[-1] > 1.3 * heights[0]) is not stable
