"""Poles and time scales, against closed forms and the calibration of the paper's board."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest

from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import EPS
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.time_scales import time_scales
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.stability.poles import brief_poles, count_unstable, poles
from tests.support.boards import lags, paper_board, single_mode
from tests.support.poles import rounded_poles
from tests.support.readings import Samples, rise_time

TAU = 0.455e-6


@pytest.mark.parametrize("ratio", [0.015, 0.5, 20.0, 60.0])
def test_the_single_mode_has_the_roots_of_its_cubic(ratio: float) -> None:
    found = poles(single_mode(ratio * TAU))
    cubic = np.polymul([ratio, 1.0], [1.0, 2.0, 1.0])
    cubic[-1] += 100.0
    assert np.sort_complex(found.poles * TAU) == pytest.approx(
        np.sort_complex(np.roots(cubic)), rel=1e-6
    )
    assert found.complete


@pytest.mark.parametrize(("C", "stable"), [(10e-12, True), (9e-12, True), (8.2e-12, False)])
def test_the_papers_board_is_stable_where_the_paper_says(C: float, stable: bool) -> None:
    assert poles(paper_board(C)).stable is stable


def test_the_papers_board_rises_in_ten_microseconds_and_rings_for_half_a_millisecond() -> None:
    scales = time_scales(paper_board(), error=1e-4, points=125.0)
    time = np.linspace(0.0, 20e-6, 2001)
    solution = exact_solution(paper_board())
    final = float(solution.final[3])
    rise = rise_time(Samples.of_record(time, solution.at(time)[:, 3], final), final)
    assert rise == pytest.approx(9.5e-6, rel=0.02)
    assert scales.ringing[0].decay == pytest.approx(0.5e-3, rel=0.15)
    assert scales.max_step == pytest.approx(scales.ringing[0].period / 125.0)
    assert scales.growth_time == np.inf
    left = scales.amplitudes @ np.exp(scales.poles.real * scales.stop)
    assert left == pytest.approx(1e-4, rel=1e-3)
    assert scales.stop_for(1e-2) < scales.stop < scales.stop_for(1e-6)


def test_an_unstable_board_is_given_time_to_show_it() -> None:
    scales = time_scales(paper_board(5e-12))
    assert scales.ringing[0].decay < 0.0
    assert 0.0 < scales.growth_time <= scales.stop < np.inf


def test_a_board_without_oscillating_poles_has_no_frequency() -> None:
    found = rounded_poles(np.array([-3.0, -1.0], dtype=np.complex128))
    assert (found.rightmost, found.stable) == (-1.0, True)
    assert (found.damping_ratio, found.frequency) == (1.0, 0.0)
    nothing = rounded_poles(np.zeros(0, dtype=np.complex128))
    assert nothing.stable


@pytest.mark.parametrize(("opamp", "gain", "unstable"), [("ua741", 1e3, 0), ("tl084", 3e5, 10)])
def test_the_winding_counts_nearly_defective_cells(opamp: str, gain: float, unstable: int) -> None:
    """The counts are those of the poles with 80 digits: -25189 +- 73794j is the rightmost."""
    T = np.eye(5, k=1)
    scene = Scene.from_arrays(
        T, T @ np.ones(5), capacitance=1e-14, gain=gain, opamp=opamp, lam=0.1,
        unit_conductance="10uS",
    )  # fmt: skip
    circuit = synthesise(scene)
    assert count_unstable(circuit) == unstable
    assert poles(circuit).unstable_count == unstable


@pytest.mark.parametrize(
    ("opamp", "gain", "C"),
    [
        ("tl084", 1e4, 1.2658030773648652e-12),
        ("ua741", 1e4, 1.0466766142971814e-11),
        ("op27", 1e5, 2.870828828623284e-11),
    ],
)
def test_poles_that_nearly_meet_are_within_their_errors(opamp: str, gain: float, C: float) -> None:
    """Two real poles become a pair at C; against those of the stamped equations with 60 digits."""
    scene = Scene.from_arrays(
        np.eye(1), np.ones(1), capacitance=C, gain=gain, opamp=opamp, lam=0.1,
        unit_conductance="10uS",
    )  # fmt: skip
    board = LinearBoard(synthesise(scene))
    found = poles(board)
    dense = board.descriptor.dense
    with mp.workdps(60):
        mass, stiffness = mp.matrix(dense.mass.tolist()), mp.matrix(dense.stiffness.tolist())
        beside = mp.mpf(3e6)  # where no pole is
        listed, _ = mp.eig(mp.inverse(beside * mass - stiffness) * mass)
        true = [beside - 1 / value for value in listed if abs(value) > mp.mpf(10) ** -25]
        off = np.array([min(float(abs(mp.mpc(p) - t)) for t in true) for p in found.poles])
    assert len(true) == len(found.poles)
    assert off.max() > 64.0 * EPS * np.abs(found.poles).max()
    assert np.all(off <= found.errors)
    assert np.all(found.errors <= 1e-3 * np.abs(found.poles))


def test_poles_without_modes_are_those_of_the_modes() -> None:
    """A defective and a large board have what their modes, or Arnoldi's method, tell."""
    counts = []
    for value in np.geomspace(8e-12, 11e-12, 10).tolist():
        brief, full = brief_poles(paper_board(value)), poles(paper_board(value))
        assert brief.complete
        assert brief.certain
        assert abs(brief.rightmost - full.rightmost) <= brief.resolution + full.resolution
        assert brief.resolution == pytest.approx(full.resolution, rel=0.1)
        assert brief.unstable_count == full.unstable_count
        counts.append(brief.unstable_count)
    assert counts == sorted(counts, reverse=True)
    assert (counts[0], counts[-1]) == (4, 0)
    large = synthesise(Scene.from_arrays(
        np.eye(90) + 0.1, np.ones(90), capacitance="1nF", gain="100kohm", lam=0.5, opamp="tl084"
    ))  # fmt: skip
    assert LinearBoard(large).descriptor.is_large
    for circuit in (lags(5, 1e-6), large):
        brief, full = brief_poles(circuit), poles(circuit)
        assert brief.poles.tobytes() == full.poles.tobytes()
        assert brief.errors.tobytes() == full.errors.tobytes()
