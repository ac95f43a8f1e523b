"""Crossings by the loci of parts, against closed forms and against poles."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from taction.netlist_gen.board.circuit import Circuit, Role
from taction.netlist_gen.board.parts import Resistor
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.scene import Scene, load_scene
from taction.spice_models.opamp import OpAmp
from taction.verification.engines.statespace.equations import descriptor
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.stability.edges import Edges
from taction.verification.stability.loci import traced_edges
from taction.verification.stability.poles import poles
from taction.verification.stability.port_response import PortResponse
from tests.support.boards import lag_board, single_mode, window
from tests.support.paths import SCENES

TAU = 0.455e-6


def capacitor_loci(
    circuit: Circuit, low: float = 0.01, high: float = 1.0, unstable: int = 0
) -> Edges:
    return edges_of(capacitors(circuit), low, high, unstable)


def capacitors(circuit: Circuit) -> PortResponse:
    parts = circuit.parts_of(Role.SIGNAL_CAPACITOR)
    return PortResponse.of_parts(LinearBoard(circuit), parts)


def edges_of(ports: PortResponse, low: float, high: float = 1.0, unstable: int = 0) -> Edges:
    return traced_edges(ports, low, high, unstable)


def test_both_ends_of_the_window_of_a_loop_gain_of_100() -> None:
    low, high = window(100.0)
    assert (low, high) == pytest.approx((24.0 - math.sqrt(575.0), 24.0 + math.sqrt(575.0)))
    found = capacitor_loci(lag_board(100.0, 100.0), low=1e-4)
    assert [100.0 * c.value for c in found.edges] == pytest.approx([low, high], rel=1e-9)
    assert [(c.below, c.above) for c in found.edges] == [(0, 2), (2, 0)]
    assert [found.unstable_at(share) for share in (0.9, 0.1, 2e-4)] == [0, 2, 0]
    for crossing in found.edges:  # on the axis (w tau)² = 1 + 2 tau / RC
        omega = math.sqrt(1.0 + 2.0 / (100.0 * crossing.value)) / TAU
        assert crossing.frequency == pytest.approx(omega / (2.0 * math.pi), rel=1e-9)
    from_below = capacitor_loci(lag_board(0.01, 100.0), 1.0, 1e5)
    assert [0.01 * c.value for c in from_below.edges] == pytest.approx([low, high], rel=1e-9)
    assert [from_below.unstable_at(share) for share in (1.0, 1e3, 1e5)] == [0, 2, 0]


@pytest.mark.parametrize("width", [1e-1, 1e-2, 1e-3, 1e-4, 1e-5])
@pytest.mark.parametrize("start", [1.5, 30.0])
def test_a_narrow_window_is_found_from_any_distance(width: float, start: float) -> None:
    """Near K = 8 the window is ``4 sqrt(K/8 - 1)`` wide around RC = tau."""
    gain = 8.0 * (1.0 + (width / 4.0) ** 2)
    low, high = window(gain)
    assert (high - low) == pytest.approx(width, rel=0.01)
    found = capacitor_loci(lag_board(start, gain))
    ends = [start * edge.value for edge in found.edges]
    assert ends == pytest.approx([low, high], rel=1e-7)
    assert [(edge.below, edge.above) for edge in found.edges] == [(0, 2), (2, 0)]


@pytest.mark.parametrize("below", [1e-1, 1e-3, 1e-6, 1e-9])
def test_a_mode_that_comes_near_and_turns_back_does_not_cross(below: float) -> None:
    assert capacitor_loci(lag_board(1.5, 8.0 * (1.0 - below))).edges == ()


def test_a_mode_within_rounding_of_the_axis_is_named() -> None:
    found = capacitor_loci(lag_board(1.5, 8.0 * (1.0 - 1e-14)))
    assert any(1.5 * share == pytest.approx(1.0, rel=1e-6) for share in found.near)


def test_a_real_pole_crosses_as_a_conductance_falls() -> None:
    """Negative conductance -g by positive feedback: ``p = -(1/R - g) / C``, unstable below 1/R."""
    made = single_mode(1e-6)
    R, follow = 10e3, {"follow": OpAmp("follow", 1e12)}
    inverter = (Resistor("Ri", "v", "j", R), Resistor("Rj", "j", "b2", R))
    feedback = Resistor("Rf", "b2", "x", 25e3)
    opamps = (made.opamps[0], replace(made.opamps[2], noninverting="0", inverting="j"))
    circuit = replace(
        made,
        models=follow,
        opamps=opamps,
        resistors=(Resistor("R", "x", "v", R), *inverter, feedback),
        capacitors=made.capacitors[:1],
    )
    board = LinearBoard(circuit)
    assert poles(board).rightmost.real == pytest.approx(-0.6 / 1e-6, rel=1e-6)
    resistor = next(part for part in circuit.resistors if part.name == "R")
    (edge,) = edges_of(PortResponse.of_parts(board, (resistor,)), 0.1).edges
    assert (edge.value, edge.frequency) == (pytest.approx(0.4), 0.0)
    assert (edge.below, edge.above) == (1, 0)


@pytest.mark.parametrize("name", ["custom-matrix", "tuned-breadboard"])
def test_the_loci_count_what_poles_count(name: str) -> None:
    circuit = synthesise(load_scene(SCENES / f"{name}.toml"))
    found = capacitor_loci(circuit)
    ends = [0.01, *(edge.value for edge in found.edges), 1.0]
    for below, above in pairwise(ends):
        share = math.sqrt(above * below)
        board = LinearBoard(circuit.turned("C", share * circuit.value("C")))
        assert poles(board).unstable_count == found.unstable_at(share)


@pytest.mark.parametrize("name", ["tuned-breadboard", "eleven-channel"])
def test_loci_by_modes_are_those_of_solves_of_the_equations(name: str) -> None:
    ports = capacitors(synthesise(load_scene(SCENES / f"{name}.toml")))
    omega = np.geomspace(1e2, 1e9, 15)
    solved = np.stack([ports.exact(1j * each) for each in omega.tolist()])
    whole = np.linalg.eigvals(solved)
    modal = np.linalg.eigvals(ports.at(omega))
    apart = np.abs(whole[:, :, None] - modal[:, None])
    for nearest in (apart.min(axis=1), apart.min(axis=2)):
        assert np.all(nearest < 1e-9 * np.abs(whole).max(axis=1, keepdims=True))


@pytest.mark.nightly  # 10 s
def test_a_large_board_has_the_crossings_of_the_dense_one(monkeypatch: pytest.MonkeyPatch) -> None:
    circuit = synthesise(load_scene(SCENES / "tuned-breadboard.toml"))
    dense = capacitor_loci(circuit)
    monkeypatch.setattr(descriptor, "LARGE", 0)
    large = capacitor_loci(circuit)
    assert len(large.edges) == len(dense.edges) == 5
    for a, b in zip(large.edges, dense.edges, strict=True):
        assert (a.value, a.frequency) == pytest.approx((b.value, b.frequency), rel=1e-6)
        assert (a.below, a.above) == (b.below, b.above)


@pytest.mark.parametrize("seed", range(4))
def test_random_boards_cross_where_their_poles_do(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sensors, channels = rng.integers(1, 5, 2)
    T = rng.standard_normal((sensors, channels))
    figures = {"dc_gain": 1e5, "gbw": 10 ** rng.uniform(6, 7), "output_resistance": 100.0}
    scene = Scene.from_arrays(
        T,
        rng.standard_normal(sensors),
        capacitance=10 ** rng.uniform(-12, -10),
        lam=10 ** rng.uniform(-2, 0),
        gain=10 ** rng.uniform(5, 6),
        unit_conductance=10 ** rng.uniform(-6, -5),
        opamp={"base": "ideal", "second_pole": 3.0 * figures["gbw"], **figures},
        stray_capacitance=5e-12,
    )
    circuit = synthesise(scene)
    farads = circuit.value("C")
    found = capacitor_loci(circuit, unstable=poles(circuit).unstable_count)
    for share in np.geomspace(0.011, 0.99, 11).tolist():
        counted = poles(circuit.turned("C", share * farads)).unstable_count
        assert counted == found.unstable_at(share)
