"""Decks: golden files, determinism, and every card that is written, run through a real ngspice."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from taction.netlist_gen.analysis import (
    Analysis,
    NoiseAnalysis,
    NoiseBand,
    OperatingPoint,
    Transient,
)
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.parts import NoiseCurrent
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import Deck, write_deck
from taction.system.array_types import Waveforms
from taction.verification.engines.ngspice.process import find_simulator, simulate
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from tests.support.making import NEAR_IDEAL, make_scene, matrix_problem
from tests.support.paths import GOLDEN

T = [[1.0, -0.5], [0.0, 0.25]]
EPS = [1.0, -1 / 3]
LINEAR: dict[str, Any] = {
    "capacitance": "10pF",
    "gain": "1Mohm",
    "unit_conductance": "1uS",
    "lambda": 0.1,
    "opamp": {"base": "ideal", "dc_gain": 1e5},
    "stray_capacitance": 0,
}
EXPONENTIAL = {**LINEAR, "amplifier": "exponential", "exponential_slope": 0.1, "unit_voltage": 0.5}
CASES: dict[str, tuple[dict[str, Any], Analysis]] = {
    "linear": ({**LINEAR, "opamp": "tl084", "stray_capacitance": "5pF"}, Transient(1e-4, 1e-7)),
    "exponential": (EXPONENTIAL, Transient(1e-4, 1e-7, initial="rest")),
    "passive": (
        {**LINEAR, "topology": "passive", "lambda": 0.5, "gain": "10Mohm"},
        OperatingPoint(),
    ),
}
BANDS = NoiseAnalysis((NoiseBand(10.0, 40, 20), NoiseBand(1e3, 200, 40)))


def build(design: dict[str, Any], T: ArrayLike = T, eps: ArrayLike = EPS) -> Circuit:
    return synthesise(make_scene(design=design), matrix_problem(T, eps))


def run(deck: Deck) -> Waveforms:
    return simulate(deck, find_simulator(), timeout=60.0)


def rest_of(circuit: Circuit, nodes: tuple[str, ...], **options: Any) -> NDArray[np.float64]:
    return run(write_deck(circuit, OperatingPoint(), saved=nodes, **options)).values[0]


@pytest.mark.parametrize("name", CASES)
def test_golden_decks(name: str) -> None:
    """To accept a change, write ``deck.text`` to the file and read the difference."""
    design, analysis = CASES[name]
    deck = write_deck(build(design), analysis)
    assert deck.text == (GOLDEN / f"{name}.cir").read_text(encoding="utf-8")


def test_every_value_keeps_every_digit() -> None:
    circuit = build(LINEAR, [[1 / 3, -math.pi]], [1 / 7])
    text = write_deck(circuit, Transient(1e-4 / 3, 1e-7 / 3)).text
    cards = {line.split()[0]: line.split()[-1] for line in text.splitlines() if line}
    assert float(cards["Rf_1_1"]) == circuit.forward.ohms[0, 0]
    assert float(cards["Rf_1_2"]) == circuit.forward.ohms[0, 1]
    assert float(cards["Ieps_1"]) == circuit.currents[0].amps
    assert float(cards["Rr_1"]) == circuit.value("R")
    assert f".tran {10.0 * (1e-3 * (1e-7 / 3))!r} {1e-4 / 3!r} 0.0 {1e-7 / 3!r} uic" in text
    for line in text.splitlines():
        if not line.startswith(("*", ".")):
            assert not re.search(r" \d[\d.]*(meg|[fpnumkgt])\b", line, re.IGNORECASE), line


@pytest.mark.usefixtures("ngspice")
@pytest.mark.parametrize("design", [LINEAR, EXPONENTIAL, CASES["linear"][0], CASES["passive"][0]])
@pytest.mark.parametrize("solver", ["klu", "noopiter"])
def test_an_operating_point_of_every_kind_of_board(design: dict[str, Any], solver: str) -> None:
    """Cards R, C, I, V, X, B, E and .op: every node, against the state-space equations."""
    circuit = build(design)
    nodes = (*circuit.signal_nodes, *circuit.constraint_nodes, *(o.node for o in circuit.outputs))
    nodes = tuple(dict.fromkeys(nodes))
    wanted = LinearBoard(circuit).equilibrium
    found = rest_of(circuit, nodes, solver=solver, relative=1e-9)
    assert found == pytest.approx([wanted[node] for node in nodes], rel=1e-6, abs=1e-9)


@pytest.mark.usefixtures("ngspice")
def test_an_rc_step_has_its_time_constant() -> None:
    """Cards C, I (DC), .tran with uic: one ideal channel settles with RC / (1 + 1/lam)."""
    circuit = build({**LINEAR, "opamp": NEAR_IDEAL, "gain": "1Mohm"}, [[1.0]], [1.0])
    tau = circuit.value("R") * 1e-11 / (1 + 10.0)
    for method in ("trapezoidal", "gear"):
        analysis = Transient(5 * tau, tau / 400, method=method)  # type: ignore[arg-type]
        found = run(write_deck(circuit, analysis))
        wanted = (1 - np.exp(-found.time / tau)) / 1.1
        assert np.max(np.abs(found["v_1"] - wanted)) < 2e-5
        assert found.time[-1] == pytest.approx(5 * tau, rel=1e-9)


@pytest.mark.usefixtures("ngspice")
def test_initial_voltages_are_taken() -> None:
    """Card .ic: without strain the integrator decays from where it was put."""
    circuit = build({**LINEAR, "opamp": NEAR_IDEAL}, [[1.0]], [0.0])
    tau = circuit.value("R") * 1e-11 / 11.0
    start = {"v_1": 0.25, "a_1": -0.25}
    found = run(write_deck(circuit, Transient(3 * tau, tau / 400, voltages=start)))
    assert found["v_1"] == pytest.approx(0.25 * np.exp(-found.time / tau), abs=2e-5)


@pytest.mark.usefixtures("ngspice")
def test_a_board_may_start_from_rest() -> None:
    """Card I with PWL, and .tran without uic: the strain steps on an equilibrium."""
    circuit = build(EXPONENTIAL, [[0.5, -0.25]], [1.0])
    analysis = Transient(2e-3, 1e-6, initial="rest")
    deck = write_deck(circuit, analysis)
    assert "PWL(0 0 1" in deck.text
    assert " uic" not in deck.text
    found = run(deck)
    asleep, awake = LinearBoard(circuit).rest, LinearBoard(circuit).equilibrium
    for node in ("a_1", "a_2"):
        assert found[node][0] == pytest.approx(asleep[node], rel=1e-5)
        assert found[node][-1] == pytest.approx(awake[node], rel=1e-4)
    quiet = build(LINEAR)
    assert " uic" in write_deck(quiet, analysis).text  # a discharged linear board is at rest


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
