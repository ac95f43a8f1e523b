"""Transients of large boards by patterns, against the exact solution of all states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from taction.netlist_gen.analysis import Transient
from taction.system.errors import EngineError
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.reduced_board import ReducedBoard
from taction.verification.engines.statespace.transients import reduced_transient
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.engines.statespace.transients.simulate import simulate
from taction.verification.verdict.simulation import state_space_error
from tests.support.boards import paper_board
from tests.support.drawn_boards import drawn_board

STOP = 3e-3  # s


@pytest.mark.parametrize("seed", range(4))
def test_a_board_of_patterns_has_the_exact_transient(seed: int) -> None:
    board = LinearBoard(drawn_board(seed))
    times = np.concatenate([[0.0], np.geomspace(1e-9, STOP, 500)])
    exact = exact_solution(board).at(times)
    step = float(np.abs(exact[0] - exact[-1]).max())
    analysis = Transient(STOP, 1e-6)
    found = reduced_transient.simulate(board, analysis, times=times, tolerance=2e-5)
    assert found is not None
    finer = reduced_transient.refined(found)
    off, finer_off = (np.abs(wave.values - exact).max() for wave in (found, finer))
    assert off <= 4e-5 * step
    assert finer_off <= 0.5 * off or finer_off < 1e-8 * step
    assert found.curve is not None
    columns = np.arange(len(times)) % len(found.nodes)
    between = found.curve(times, columns)
    np.testing.assert_allclose(between, found.values[np.arange(len(times)), columns], atol=1e-12)
    assert isinstance(found.curve, reduced_transient.PatternCurve)
    assert found.curve.model.lift.shape[1] < board.state_space.n
    with pytest.raises(EngineError, match="not one by patterns"):
        reduced_transient.refined(replace(found, curve=None))


@pytest.mark.parametrize("seed", range(4))
def test_the_stated_error_of_a_large_board_holds(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    circuit, analysis = drawn_board(seed + 10), Transient(STOP, 1e-6)
    times = np.concatenate([[0.0], np.geomspace(1e-9, STOP, 500)])
    exact = exact_solution(circuit).at(times)
    monkeypatch.setattr("taction.verification.engines.statespace.equations.descriptor.LARGE", 0)
    board = LinearBoard(circuit)
    found = simulate(board, analysis, times=times, tolerance=1e-4)
    assert found.method == reduced_transient.METHOD
    stated = state_space_error(board, found)
    assert stated.how.startswith("difference to a run with fewer patterns")
    assert np.abs(stated.record.values - exact).max() <= stated.volts
    assert stated.volts <= 5e-4 * np.abs(exact[0] - exact[-1]).max()


def test_every_unknown_of_the_board_follows_the_patterns() -> None:
    board, analysis = LinearBoard(drawn_board(1)), Transient(STOP, 1e-6)
    names, times = board.descriptor.names, np.geomspace(1e-8, STOP, 50)
    found = reduced_transient.simulate(board, analysis, nodes=names, times=times, tolerance=1e-4)
    assert found is not None
    exact = exact_solution(board, nodes=names).at(times)
    np.testing.assert_allclose(found.values, exact, rtol=0.0, atol=1e-3 * np.abs(exact).max())


def test_a_board_that_grows_or_needs_too_many_states_is_left_to_steps(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    growing, analysis = LinearBoard(paper_board(8e-12)), Transient(1e-4, 1e-6)
    assert reduced_transient.simulate(growing, analysis, tolerance=1e-4) is None
    board = LinearBoard(drawn_board(2))
    charged = replace(analysis, voltages={board.circuit.outputs[0].node: 1.0})
    assert reduced_transient.simulate(board, charged, tolerance=1e-4) is None
    monkeypatch.setattr(reduced_transient, "STATES", 10)
    assert reduced_transient.simulate(board, analysis, tolerance=1e-4) is None
    monkeypatch.setattr("taction.verification.engines.statespace.equations.descriptor.LARGE", 0)
    large = LinearBoard(paper_board(8e-12))
    assert simulate(large, analysis).method != reduced_transient.METHOD


def test_patterns_that_miss_the_transient_show_in_the_residual() -> None:
    """The patterns of a slow rate alone: the residuals tell, without another solution."""
    board = LinearBoard(drawn_board(3))
    made = reduced_transient.Reduction(board, -board.equilibrium.values, STOP)
    places = np.array([board.descriptor.place(node) for node in board.reported(None)])
    step = float(np.abs(board.equilibrium.values[places]).max())
    full = made.model(1)
    few = reduced_transient.Patterns.of(
        ReducedBoard.of(board, np.stack(made.vectors[:2], axis=1), 1e-9), made.start
    )
    assert full is not None
    assert few is not None
    assert full.off(board, made.rates, places) < 1e-4 * step
    assert few.off(board, made.rates, places) > 1e-2 * step
