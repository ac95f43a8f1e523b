"""Wired arrays against the nodal equations of the whole grid, badcrossbar and closed forms."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import mpmath
import numpy as np
import pytest

import taction
from taction.netlist_gen.board.arrays import CORNERS, Wires, compensated
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.parts import ResistorMatrix, at_ports, entry_voltages, wire_branches
from taction.netlist_gen.deck.deck import matrix_lines
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats

BADCROSSBAR = Path(__file__).parents[2] / "data" / "badcrossbar.json"
SHAPES = [(1, 1), (4, 3)]


def array(shape: tuple[int, int], wires: Wires, by_column: bool, seed: int = 1) -> ResistorMatrix:
    """Return a wired matrix with both signs and places without an entry."""
    rng = np.random.default_rng(seed)
    ohms = 1.0 / rng.uniform(0.5e-6, 35e-6, shape)
    ohms[rng.random(shape) < 0.2] = np.inf
    ohms[0, 0] = 5e4
    negative = (rng.random(shape) < 0.4) & np.isfinite(ohms)
    drives, sinks = (shape[1], shape[0]) if by_column else shape
    plus, minus = (tuple(f"{letter}_{k}" for k in range(drives)) for letter in "pm")
    ends = tuple(f"s_{k}" for k in range(sinks))
    return ResistorMatrix("Rf", ohms, negative, by_column, plus, minus, ends, wires=wires)


def admittance(branches: list[tuple[str, str, float]], ports: list[str]) -> mpmath.matrix:
    """Return the currents into `ports` over their voltages, by 50 digits of Gauss."""
    nodes = list(ports)
    nodes += [n for n in dict.fromkeys(n for a, b, _ in branches for n in (a, b)) if n not in ports]
    place = {node: k for k, node in enumerate(nodes)}
    with mpmath.workdps(50):
        Y = mpmath.zeros(len(nodes))
        for a, b, ohms in branches:
            for p, q in ((place[a], place[b]), (place[b], place[a])):
                Y[p, p] += 1 / mpmath.mpf(ohms)
                Y[p, q] -= 1 / mpmath.mpf(ohms)
        P, size = len(ports), len(nodes)
        if size == P:
            return Y
        inner = Y[P:size, P:size] ** -1 * Y[P:size, :P]
        return Y[:P, :P] - Y[:P, P:size] * inner


def by_ports(matrix: ResistorMatrix, ports: list[str]) -> Floats:
    """Return the same from the resistors between ports."""
    branches = [e[2:] for part in at_ports(matrix) for e in part.elements()]
    place = {node: k for k, node in enumerate(ports)}
    Y = np.zeros((len(ports), len(ports)))
    for a, b, ohms in branches:
        Y[place[a], place[b]] -= 1.0 / ohms
        Y[place[b], place[a]] -= 1.0 / ohms
    return Y - np.diag(Y.sum(axis=1))


def ports_of(matrix: ResistorMatrix) -> list[str]:
    return sorted({n for _, _, a, b, _ in matrix.elements() for n in (a, b)})


@pytest.mark.parametrize("by_column", [True, False])
@pytest.mark.parametrize("corner", CORNERS)
@pytest.mark.parametrize("shape", SHAPES)
def test_the_ports_see_the_wires_of_the_deck(
    shape: tuple[int, int], corner: str, by_column: bool
) -> None:
    """Small and large resistances, and none; the grid is that of the deck's own lines."""
    for ohms in ((1.73, 0.6, 0.0, 2.0), (900.0, 4e3, 50.0, 0.0), (0.0, 7.0, 3.0, 0.0)):
        matrix = array(shape, Wires(*ohms, corner=corner), by_column)
        lines = [line.split() for line in matrix_lines([matrix])]
        branches = [(a, b, float(value)) for _, a, b, value in lines]
        ports = ports_of(matrix)
        wanted = admittance(branches, ports)
        scale = max(abs(complex(y)) for y in wanted)
        found = by_ports(matrix, ports)
        for i, k in itertools.product(range(len(ports)), repeat=2):
            error = abs(found[i, k] - float(wanted[i, k]))
            assert error <= 1e-14 * scale, (ohms, ports[i], ports[k])


def test_nothing_is_lost_in_good_wires() -> None:
    """Every conductance between two lines keeps its digits, though wires have 10⁹ times more."""
    matrix = array((4, 3), Wires(1e-4, 1e-4), by_column=True)
    ports = ports_of(matrix)
    wanted = admittance([branch[1:] for branch in wire_branches(matrix)], ports)
    found = by_ports(matrix, ports)
    for part in at_ports(matrix):
        if not part.is_mesh:
            for _, _, a, b, _ in part.elements():
                i, k = ports.index(a), ports.index(b)
                if abs(wanted[i, k]) > 1e-7:  # an entry, no detour through other lines
                    assert found[i, k] == pytest.approx(float(wanted[i, k]), rel=4e-15)


@pytest.mark.parametrize("case", range(3))
def test_currents_of_badcrossbar(case: int) -> None:
    """Rows are driven from the left, columns end at ground at the bottom."""
    given = json.loads(BADCROSSBAR.read_text("utf-8"))["cases"][case]
    wires = Wires(given["word_line"], given["bit_line"], corner="bottom-left")
    ports = wires.at_ports(1.0 / np.array(given["ohms"]), by_column=False)
    volts = np.array([*given["volts"], *np.zeros(len(given["amps"]))])
    amps = -(ports.admittance() @ volts)[len(given["volts"]) :]
    wanted = np.array(given["amps"])
    assert np.abs(amps - wanted).max() <= 1e-9 * np.abs(wanted).max()


@pytest.mark.parametrize("by_column", [True, False])
def test_voltages_of_entries_are_those_of_the_grid(by_column: bool) -> None:
    wires = Wires(700.0, 300.0, 40.0, 90.0, "top-right")
    matrix, rng = array((3, 4), wires, by_column), np.random.default_rng(5)
    ports = ports_of(matrix)
    volts = {node: rng.uniform(-1.0, 1.0, 2) for node in ports}
    found = entry_voltages(matrix, volts)
    branches = [branch[1:] for branch in wire_branches(matrix)]
    inner = [n for n in dict.fromkeys(n for a, b, _ in branches for n in (a, b)) if n not in ports]
    place = {node: k for k, node in enumerate(inner)}
    Y, right = np.zeros((len(inner), len(inner))), np.zeros((len(inner), 2))
    for a, b, ohms in branches:
        for p, q in ((a, b), (b, a)):
            if p in place:
                Y[place[p], place[p]] += 1.0 / ohms
                if q in place:
                    Y[place[p], place[q]] -= 1.0 / ohms
                else:
                    right[place[p]] += volts[q] / ohms
    solved = dict(zip(inner, np.linalg.solve(Y, right), strict=True)) | volts
    ends = {name: (a, b) for name, a, b, _ in wire_branches(matrix)}
    for k, n, *_ in matrix.elements():
        drive, sink = ends[f"Rf_{k + 1}_{n + 1}"]
        assert found[k, n] == pytest.approx(solved[drive] - solved[sink], abs=1e-12)


def test_compensation_gives_back_the_matrix() -> None:
    rng = np.random.default_rng(3)
    G = rng.uniform(5e-6, 35e-6, (8, 8))
    wires = Wires(20.0, 10.0, 5.0, 30.0)
    programmed = compensated(G, wires, by_column=True)
    across = wires.at_ports(programmed, by_column=True).across
    assert np.linalg.norm(across - G) <= 1e-12 * np.linalg.norm(G)
    assert np.all(programmed > G)


def test_compensation_keeps_what_comes_closest() -> None:
    """A line whose wires alone conduct less than its entries should have has no exact answer."""
    G, wires = np.full((2, 2), 1e-3), Wires(600.0, 600.0)
    programmed = compensated(G, wires, by_column=True)
    errors = [
        np.linalg.norm(wires.at_ports(each, by_column=True).across - G) for each in (G, programmed)
    ]
    assert np.all(np.isfinite(programmed))
    assert 0.0 < errors[1] < errors[0]


def wired(**keys: object) -> Scene:
    rows = [[1.0, 0.5, -0.2], [0.5, 1.0, 0.3], [-0.2, 0.3, 1.0]]
    options = {"topology": "inv", "unit_conductance": "100uS", "opamp": "opa189"}
    return taction.Scene.from_arrays(rows, [0.3, 0.1, 0.2], **(options | keys))


def test_the_resistors_of_a_series_are_of_it_after_compensation() -> None:
    scene = wired(word_line=100.0, bit_line=100.0, compensate=True, resistor_series="E96")
    plain = taction.synthesise(wired(word_line=100.0, bit_line=100.0))
    circuit = taction.synthesise(scene)
    assert all(near_e96(matrix.ohms) for matrix in circuit.matrices)
    assert error_at_ports(circuit) < 0.02 < 0.05 < error_at_ports(plain)


def near_e96(ohms: Floats) -> bool:
    values = ohms[np.isfinite(ohms)]
    mantissas = values / 10.0 ** np.floor(np.log10(values))
    wanted = np.round(10.0 ** (np.arange(97) / 96.0), 2)
    return bool(np.all(np.abs(mantissas[:, None] - wanted).min(axis=1) < 1e-9))


def error_at_ports(circuit: Circuit) -> float:
    (matrix,) = circuit.matrices
    scale = 1.0 if matrix.wires is None or matrix.wires.scale is None else matrix.wires.scale
    wanted = np.where(np.isfinite(matrix.ohms), 1.0 / (matrix.ohms / scale), 0.0)
    parts = [each for each in at_ports(matrix) if not each.is_mesh]
    found = sum(np.where(np.isfinite(each.ohms), 1.0 / each.ohms, 0.0) for each in parts)
    return float(np.abs(found - wanted).max() / wanted.max())
