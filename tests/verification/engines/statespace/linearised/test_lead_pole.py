"""The rightmost pole and its bound, against eigenvalues with 50 digits and against the modes."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest

from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Complexes
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.rightmost_poles import LeadPole, lead_pole
from taction.verification.engines.statespace.linearised.state_space import StateSpace
from tests.support.boards import lags, paper_board, single_mode
from tests.support.paths import SCENES


def found(space: StateSpace) -> LeadPole:
    lead = lead_pole(space)
    assert lead is not None
    return lead


def exact(space: StateSpace) -> Complexes:
    """Return the poles of the stamped equations: by ``(M - K)^-1 M``, with 50 digits."""
    dense = space.descriptor.dense
    with mp.workdps(50):
        M, K = mp.matrix(dense.mass.tolist()), mp.matrix(dense.stiffness.tolist())
        listed, _ = mp.eig(mp.inverse(M - K) * M)
        finite = [value for value in listed if abs(value) > mp.mpf(10) ** -30]
        assert len(finite) == space.n
        return np.array([complex(1 - 1 / value) for value in finite])


@pytest.mark.parametrize("name", ["inverse", "known-readings"])
def test_poles_are_within_their_bounds(name: str) -> None:
    space = LinearBoard(synthesise(load_scene(SCENES / f"{name}.toml"))).state_space
    lead, true = found(space), exact(space)
    off = np.abs(lead.poles[:, None] - true).min(axis=1)
    assert np.all(off <= lead.errors)
    assert len(set(np.abs(lead.poles[:, None] - true).argmin(axis=1).tolist())) == len(true)
    assert lead.poles[0].real == pytest.approx(true.real.max(), abs=lead.errors[0])
    assert lead.errors[0] < 1e-3 * lead.errors[-1]


@pytest.mark.parametrize("ratio", [0.5, 20.0, 60.0])
def test_a_bound_holds_beside_the_axis(ratio: float) -> None:
    space = LinearBoard(single_mode(ratio * 0.455e-6)).state_space
    lead, true = found(space), exact(space)
    assert np.abs(lead.poles[0] - true).min() <= lead.errors[0] <= 1e-11 * abs(lead.poles[0])


@pytest.mark.parametrize("C", [8e-12, 10e-12, 100e-12])
def test_the_bound_is_that_of_the_mode(C: float) -> None:
    space = LinearBoard(paper_board(C)).state_space
    lead, modes = found(space), space.modes
    assert abs(lead.poles[0] - modes.poles[0]) <= lead.errors[0] + modes.pole_errors[0]
    assert 0.9 * modes.pole_errors[0] < lead.errors[0] < 1e-11 * abs(lead.poles[0])
    if lead.poles[0].imag:
        assert lead.poles[1] == lead.poles[0].conjugate()


def test_poles_that_cannot_be_told_apart_are_left_to_the_modes() -> None:
    """Equal lags in a row are one defective pole; equal channels have equal poles."""
    channels = Scene.from_arrays(np.eye(2), np.ones(2), lam=0.1, capacitance="10pF")
    spaces = [LinearBoard(board).state_space for board in (lags(5, 1e-6), synthesise(channels))]
    assert [lead_pole(space) for space in spaces] == [None, None]
