"""Wired boards: the reduced state space against that of the whole network, and against ngspice."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import taction
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.parts import Resistor, wire_branches
from taction.netlist_gen.board.variation import with_factors
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.verification.engines.statespace.equations.structured_solve import Structure
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.noise_covariance import noise_intensities
from taction.verification.engines.statespace.linearised.rest_sensitivity import RestSensitivity
from taction.verification.verdict.board_files import board_power
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.input_spread import outputs_at_rest

OPAMP = {"base": "opa189", "level": "small-signal"}
COMMON = {"unit_conductance": 35e-6, "stray_capacitance": "2pF", "opamp": OPAMP}
WIRES = {"word_line": 1.73, "bit_line": "2ohm", "driver": 1.0, "sense": 3.0}
TIMID = {"base": "ideal", "dc_gain": 1e5, "gbw": "5MHz", "second_pole": "15MHz",
         "output_resistance": "50ohm"}  # fmt: skip
BOARDS: dict[str, dict[str, Any]] = {
    "inv": {"topology": "inv"},
    "pinv": {"topology": "pinv", "feedback_conductance": "400uS"},
    "pinv, differential": {
        **{"topology": "pinv", "feedback_conductance": "400uS"},
        "negative_entries": "differential",
    },
    "ridge, offset": {
        **{"topology": "ridge", "feedback_conductance": "400uS", "lam": 0.5},
        "negative_entries": "offset",
    },
    "integrator": {"lam": 0.5, "gain": "100kohm", "capacitance": "100pF"},
    "passive": {"topology": "passive", "lam": 0.5, "gain": "300kohm", "capacitance": "10nF"},
    "driven through 50 ohm": {"topology": "inv", "opamp": TIMID},
}


def scene(N: int, keys: dict[str, Any], **wires: Any) -> Scene:
    """Return a scene with a dense matrix of both signs, whose parts differ all."""
    rng = np.random.default_rng(N)
    distance = np.abs(np.subtract.outer(np.arange(N), np.arange(N)))
    T = 0.5**distance * rng.uniform(0.5, 1.0, (N, N)) * np.where(distance % 3 == 2, -1.0, 1.0)
    T += np.eye(N)
    u = rng.uniform(-0.5, 0.5, N)
    return taction.Scene.from_arrays(T, T @ u, **(COMMON | keys | (wires or WIRES)))


def whole(circuit: Circuit) -> Circuit:
    """Return the board with every entry and every wire as a resistor of its own."""
    parts = [
        Resistor(name[1:], a, b, ohms)
        for matrix in circuit.matrices
        for name, a, b, ohms in wire_branches(matrix)
    ]
    return replace(circuit, matrices=(), resistors=(*circuit.resistors, *parts))


def apart(circuit: Circuit) -> tuple[float, float]:
    """Return how far A and B are from those of the whole network, relative to the largest."""
    few, many = LinearBoard(circuit).state_space, LinearBoard(whole(circuit)).state_space
    assert sorted(few.states) == sorted(many.states)
    order = [many.states.index(name) for name in few.states]
    A, B = many.A[np.ix_(order, order)], many.B[order]
    return (
        float(np.abs(few.A - A).max() / np.abs(A).max()),
        float(np.abs(few.B - B).max() / np.abs(B).max()),
    )


@pytest.mark.parametrize("board", BOARDS)
def test_state_matrices_are_those_of_the_whole_network(board: str) -> None:
    assert max(apart(taction.synthesise(scene(6, BOARDS[board])))) < 1e-12


@pytest.mark.parametrize("board", BOARDS)
def test_solves_of_large_boards_have_the_same_matrices(board: str) -> None:
    """The structured solve at a complex shift, and its transpose, against full matrices."""
    descriptor = LinearBoard(taction.synthesise(scene(6, BOARDS[board]))).descriptor
    rng, shift = np.random.default_rng(1), 3e6 + 2e6j
    right = rng.normal(size=descriptor.size)
    pencil = shift * descriptor.dense.mass - descriptor.dense.stiffness
    structure = Structure(descriptor)
    for one, matrix in ((structure, pencil), (structure.transposed, pencil.T)):
        wanted = np.linalg.solve(matrix, right)
        found = one.factor(shift)(right)
        assert np.abs(found - wanted).max() < 1e-9 * np.abs(wanted).max()
    z = rng.normal(size=descriptor.size)
    wanted = descriptor.dense.stiffness @ z
    off = descriptor.stiffness_times(z) - wanted
    assert np.abs(off).max() < 1e-12 * np.abs(wanted).max()


@pytest.mark.parametrize("board", BOARDS)
def test_three_witnesses(board: str, ngspice: Path) -> None:
    """ngspice has every wire as a resistor; the wires take some per cent of the answer."""
    wires = dict.fromkeys(("word_line", "bit_line"), 0.005 / COMMON["unit_conductance"])
    asked = scene(5, BOARDS[board], **wires, driver=30.0, sense=20.0, corner="bottom-left")
    verdict = taction.verify(asked.with_engine("ngspice"))
    checks = {check.name: check for check in verdict.checks}
    assert checks["engines_agree"].outcome is Outcome.PASS
    assert checks["steady_state"].value > 0.003


@pytest.mark.parametrize("board", BOARDS)
def test_sensitivities_behind_wires(board: str) -> None:
    """To some resistors of the matrices, against differences of boards that were solved anew."""
    circuit = taction.synthesise(scene(4, BOARDS[board], word_line=300.0, bit_line=200.0))
    found = RestSensitivity.of(LinearBoard(circuit)).resistors()
    names = [name for name in found if name.startswith(("Rf_", "Rb_", "Rfn_"))][::3]
    largest = max(float(np.abs(found[name]).max()) for name in names)
    for name in names:
        ends = [
            outputs_at_rest(LinearBoard(with_factors(circuit, {name: float(np.exp(step))})))
            for step in (1e-4, -1e-4)
        ]
        assert np.abs((ends[0] - ends[1]) / 2e-4 - found[name]).max() < 1e-6 * largest


def test_noise_and_power_count_the_wires() -> None:
    """Both are those of the whole network: a resistor network is as noisy as it looks."""
    circuit = taction.synthesise(scene(4, BOARDS["inv"], word_line=300.0, bit_line=200.0))
    few, many = LinearBoard(circuit), LinearBoard(whole(circuit))
    power, wanted = board_power(few), board_power(many)
    assert power.total == pytest.approx(wanted.total, rel=1e-9)
    assert power.supply_current == pytest.approx(wanted.supply_current, rel=1e-9)
    rows = [many.descriptor.place(name) for name in few.descriptor.names]
    assert spectrum(few, 1e5) == pytest.approx(spectrum(many, 1e5), rel=1e-9)
    assert len(rows) < many.descriptor.size


def spectrum(board: LinearBoard, hertz: float) -> Floats:
    """Return the noise density of every output, V²/Hz."""
    descriptor = board.descriptor
    M, K = descriptor.dense.mass, descriptor.dense.stiffness
    G = np.linalg.inv(2j * np.pi * hertz * M - K)
    S = 2.0 * noise_intensities(board.circuit, descriptor, board.equilibrium.values)[0]
    places = [descriptor.place(output.node) for output in board.circuit.outputs]
    return np.asarray(np.einsum("ij,jk,ik->i", G, S, G.conj()).real[places])


def test_the_budget_has_the_wires_and_their_compensation() -> None:
    def part(**more: Any) -> float:
        verdict = taction.verify(scene(4, BOARDS["inv"], word_line=200.0, bit_line=200.0, **more))
        parts = {each.name: each for each in verdict.budget}
        assert (parts["resistors"].value or 0.0) < 1e-9
        assert parts["wires"].value is not None
        return float(parts["wires"].value)

    assert part() > 1e-3
    assert part(compensate=True) < 1e-9
