"""Decks of noise analyses: the same board with sources of noise; every card runs in ngspice."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from taction.netlist_gen.analysis import NoiseAnalysis, NoiseBand, OperatingPoint
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.parts import NoiseCurrent
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from taction.verification.engines.ngspice.process import find_simulator, start
from tests.support.making import make_scene, matrix_problem

BANDS = NoiseAnalysis((NoiseBand(10.0, 40, 20), NoiseBand(1e3, 200, 40)))


def board(**design: Any) -> Circuit:
    parts = {"gain": "1Mohm", "unit_conductance": "1uS", "lambda": 0.1, "opamp": "op27"}
    scene = make_scene(design=parts | design)
    return synthesise(scene, matrix_problem([[1.0, -0.5], [0.0, 0.25]], [1.0, -0.5]))


def test_a_noise_deck_is_the_board_and_its_noise() -> None:
    circuit = board(sensor_noise="1pA/rtHz")
    plain = write_deck(circuit, OperatingPoint(), solver="noopiter").text.splitlines()
    noisy = write_deck(circuit, BANDS, saved=["v_1"]).text.splitlines()
    added = [line for line in noisy if line not in plain]
    kinds = {line.split()[0].split("_")[0] for line in added}
    model = {"Rd", "Rnn", "Gnn", "Rne", "Ene", "G1", "R1", "R2", "Ro"}
    assert kinds == {*model, ".model", "Rnoise", "Gnoise", "Vnoise", ".save", ".noise"}
    assert [line for line in added if line.startswith(".noise")] == [
        ".noise v(v_1) Vnoise dec 20 10.0 1000.0",
        ".noise v(v_1) Vnoise dec 40 1000.0 100000000.0",
    ]
    silenced = {line.removesuffix(" noisy=0").replace("inpe", "inp") for line in noisy}
    assert set(plain) - silenced == {".save v(v_1) v(v_2)", ".op"}


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize("amplifier", ["linear", "exponential"])
def test_two_files_have_the_noise_of_one(amplifier: str) -> None:
    circuit = board(amplifier=amplifier, sensor_noise="1pA/rtHz")
    node = circuit.outputs[0].node
    found = []
    for matrix_file in (None, "noise_matrix.inc"):
        deck = write_deck(circuit, BANDS, saved=[node], matrix_file=matrix_file)
        with start(deck, find_simulator(), timeout=30.0) as run:
            found.append(run.noise())
    assert found[0] > 0.0
    assert found[1] == pytest.approx(found[0], rel=1e-9)


def test_a_noise_analysis_has_one_node() -> None:
    with pytest.raises(ValueError, match="one node"):
        write_deck(board(), BANDS)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (NoiseCurrent("eps\n.control", "c_1", 1e-12), "not a valid name"),
        (NoiseCurrent("eps", "c_1", float("inf")), "must be finite"),
    ],
)
def test_hostile_noise_is_refused(source: NoiseCurrent, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        write_deck(replace(board(), noises=(source,)), BANDS, saved=["v_1"])
