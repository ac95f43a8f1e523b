"""Simulating a transient: what is kept of a run that ends early, and the error of a run."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.system.array_types import Floats
from taction.system.errors import DivergesError, EngineError
from taction.system.waveforms import Cost, Waveforms
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.transients import simulate, stepped
from taction.verification.engines.statespace.transients.exact import exact_solution
from taction.verification.verdict.board import Board
from taction.verification.verdict.build import build
from taction.verification.verdict.simulation import (
    StateSpaceError,
    begin,
    on_curve,
    state_space_error,
)
from tests.support.boards import board, kernel, lone_amplifier, strain, two_pole
from tests.support.making import make_scene

RECORD = Waveforms(
    np.array([0.0, 1e-6]), ("v_1",), np.array([[0.0], [1e9]]), "statespace", Cost(0.0, 2, 1)
)


def design() -> Board:
    return build(make_scene())


@pytest.mark.parametrize("partial", [RECORD, None])
def test_the_record_of_a_diverging_transient_is_kept(
    monkeypatch: pytest.MonkeyPatch, partial: Waveforms | None
) -> None:
    def diverging(*_: object, **__: object) -> None:
        raise DivergesError("the board diverges", partial)

    made = replace(design(), engine="statespace")
    monkeypatch.setattr(simulate, "simulate", diverging)
    if partial is None:
        with pytest.raises(DivergesError):
            begin(made)
    else:
        wait = begin(made)
        assert wait() is RECORD


LOOSE = 1.5  # times the error of the first run: largest stated error
TIMES = np.concatenate([[0.0], np.geomspace(1e-9, 2e-4, 400)])
BETWEEN = TIMES[:-1] + 0.37 * np.diff(TIMES)


def run(circuit: Circuit, tolerance: float) -> tuple[Waveforms, StateSpaceError]:
    made, analysis = LinearBoard(circuit), Transient(TIMES[-1], 1e-6)
    record = simulate.simulate(made, analysis, times=TIMES, tolerance=tolerance)
    return record, state_space_error(made, record)


def of_an_amplifier(t: Floats) -> Floats:
    v = solve_ivp(
        lambda _, x: -(x + 2.0 * np.exp(x / 0.5)) / 1e-5 - x / 1e6,
        (0.0, 2e-4),
        [0.0],
        method="LSODA",
        rtol=1e-12,
        atol=1e-14,
        t_eval=t,
    ).y[0]
    return np.asarray(-2.0 * np.exp(v / 0.5))[:, None]


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5, 1e-7])
@pytest.mark.parametrize("large", [True, False])
def test_a_record_errs_by_less_than_stated(large: bool, tolerance: float) -> None:
    """Also between its points; and the first run errs by about the stated error."""
    T, eps = kernel(40, 3.0), strain(40, 3.0)
    circuit, truth = lone_amplifier(), of_an_amplifier
    if large:
        circuit = board(T, eps, two_pole(790e3, 12e-12), G0=0.3313e-6 * 7 / 40)
        truth = exact_solution(circuit).at
    record, stated = run(circuit, tolerance)
    assert np.abs(on_curve(stated.record, TIMES) - truth(TIMES)).max() <= stated.volts
    assert stated.volts <= LOOSE * np.abs(record.values - truth(TIMES)).max()
    assert stated.record.curve is not None
    between = truth(BETWEEN)
    for column in range(between.shape[1]):
        found = stated.record.curve(BETWEEN, np.full(len(BETWEEN), column))
        assert np.abs(found - between[:, column]).max() <= stated.volts


def test_an_exact_solution_errs_by_its_rounding() -> None:
    T, eps = kernel(7, 3.0), strain(7, 3.0)
    record, stated = run(board(T, eps, two_pole(790e3, 12e-12)), 1e-5)
    assert stated.record is record
    assert 0.0 < stated.volts == record.rounding < 1e-9
    with pytest.raises(EngineError, match="not one of the integrator"):
        stepped.halved(record)
