"""The limits of a fresh scene, against boards that are drawn and solved by numpy alone."""

from __future__ import annotations

import numpy as np
import pytest

from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.scene import Scene
from taction.verification.design.fresh_scene import (
    BAND,
    GRADES,
    exceeded,
    rounded_up,
    with_limits,
)
from taction.verification.studies.tolerance.varied_board import prepare

T = np.array([[1.0, 0.5, 0.2], [0.5, 1.0, 0.5], [0.2, 0.5, 1.0], [0.1, 0.2, 0.5]])
EPS = np.array([1.0, 0.8, 0.3, 0.2])
LAMBDA = 0.1


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene.from_arrays(T, EPS, lam=LAMBDA, base="ideal", engine="statespace")


def errors(grade: float, count: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the largest error of boards with ideal op-amps, in steps, by Kirchhoff's laws.

    T has no negative entry: an inverter (two resistors) drives each column of the forward matrix.
    """
    rng, (M, N) = np.random.default_rng(5), T.shape
    exact = np.linalg.solve(T.T @ T + LAMBDA * np.eye(N), T.T @ EPS)

    def off(*shape: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        return np.asarray(1.0 / (1.0 + grade / 3.0 * rng.standard_normal(shape)))

    found = []
    for _ in range(count):
        forward = T * off(M, N) * (off(N) / off(N))[None, :]
        backward, gain, leak = T * off(M, N), 1.0 / off(M), LAMBDA * off(N)
        system = backward.T @ (gain[:, None] * forward) + np.diag(leak)
        u = np.linalg.solve(system, backward.T @ (gain * EPS))
        found.append(np.abs(u - exact).max() / np.abs(exact).max())
    return np.array(found)


def test_two_percent_of_the_boards_exceed_the_predicted_error(scene: Scene) -> None:
    board = prepare(with_values(scene, {"tolerances.resistor": 0.01, "tolerances.opamp_gbw": 0.0}))
    predicted = exceeded(board, 0.02)
    drawn = float(np.quantile(errors(0.01, 4000), 0.98))
    assert 0.95 * drawn < predicted < 1.25 * drawn  # channels are not independent: a bound


def test_the_limits_are_those_that_most_boards_keep(scene: Scene) -> None:
    limited, note = with_limits(scene)
    grade, limit = limited.tolerances.resistor, limited.checks.steady_state.tolerance
    assert grade in GRADES
    assert np.mean(errors(grade, 2000) <= limit) > 0.95
    assert limited.checks.settling_time.band == BAND * limit
    assert f"the limit is {100 * limit:g} %" in note


def test_rounding_goes_up() -> None:
    values = [0.0101, 0.02, 0.021, 0.051, 9e-4, 0.0]
    assert [rounded_up(v) for v in values] == [0.02, 0.02, 0.05, 0.1, 1e-3, 0.0]
