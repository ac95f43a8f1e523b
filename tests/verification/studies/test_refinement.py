"""The refinement loop against closed forms: contraction of diagonal boards, converters."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import taction
from taction.system.errors import InputError
from taction.verification.studies.refinement import AnalogSolver, analog_solver, matrix_of
from tests.support.paths import ROOT

MANY = 52  # bits: converters that add nothing


def test_a_cycle_gains_what_the_error_of_the_gain_leaves() -> None:
    """B = (1 - d) / T has e_k = d^k: -log2 d bits a cycle."""
    T, d = np.diag([1.0, 0.5, 0.25]), 1.0 / 8.0
    solver = AnalogSolver(T, (1.0 - d) * np.linalg.inv(T), np.zeros(3))
    assert solver.predicted == pytest.approx(3.0, rel=1e-12)
    found = solver.errors(np.array([1.0, -0.5, 0.75]), MANY, 24)
    np.testing.assert_allclose(found, [d**k for k in range(1, 9)] + found[8:], rtol=1e-6)
    assert len(found) == 9  # 2^-24 is not below 2^-24


def test_the_slowest_mode_decides_and_a_radius_above_one_diverges() -> None:
    T = np.eye(2)
    slow = AnalogSolver(T, np.diag([0.999, 0.5]), np.zeros(2))
    assert slow.predicted == pytest.approx(1.0, rel=1e-12)
    ends = slow.errors(np.array([1.0, 1.0]), MANY, 20)
    assert len(ends) == 21
    away = AnalogSolver(T, np.diag([1.0, -0.5]), np.zeros(2))
    assert away.predicted == pytest.approx(-math.log2(1.5), rel=1e-12)
    track = away.errors(np.array([1.0, 1.0]), MANY, 20)
    np.testing.assert_allclose(track[:4], [1.5**k for k in range(1, 5)], rtol=1e-12)


def test_converters_of_b_bits_let_no_more_than_b_bits_through_a_cycle() -> None:
    """An exact board of T = 1: the largest entry of r is full scale, only the other one errs."""
    exact = AnalogSolver(np.eye(2), np.eye(2), np.zeros(2))
    (first, *_) = exact.errors(np.array([1.0, 0.4]), 8, 40)
    assert first == pytest.approx(abs(round(0.4 * 127) / 127 - 0.4), rel=1e-9)


def test_the_answer_of_a_board_is_the_inverse_of_its_levels() -> None:
    """G V = -I with every entry on one of eight levels, by numpy."""
    scene = taction.Scene.from_arrays(
        np.eye(3).tolist(), [1.0] * 3, topology="inv", unit_conductance=30e-6,
        negative_entries="inverters", stray_capacitance=0.0, engine="statespace",
        opamp={"base": "ideal", "dc_gain": 1e9, "gbw": 1e7, "output_resistance": 0.0},
        least_conductance=0.5e-6, most_conductance=35.5e-6, cell_levels=8,
    )  # fmt: skip
    T = matrix_of(4.0, 3, np.random.default_rng(3))
    assert np.linalg.cond(T) == pytest.approx(4.0, rel=1e-9)
    found = analog_solver(scene, T, np.random.default_rng(0))
    size = np.abs(T) * 30e-6
    G = np.sign(T) * (0.5e-6 + 5e-6 * np.round((np.clip(size, 0.5e-6, None) - 0.5e-6) / 5e-6))
    wanted = np.linalg.inv(G) * 30e-6
    np.testing.assert_allclose(found.B, wanted, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found.offset, 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("scene", "keys", "text"),
    [
        ("ridge", {}, "expected 'inv'"),
        ("inverse", {"conditions": "3,x"}, "by commas"),
        ("inverse", {"conditions": "0.5"}, "1 or more"),
    ],
)
def test_what_cannot_be_refined_is_refused(scene: str, keys: dict[str, Any], text: str) -> None:
    with pytest.raises(InputError, match=text):
        taction.refine(ROOT / "scenes" / f"{scene}.toml", samples=1, **keys)
