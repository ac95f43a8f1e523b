"""Matrices and strains of the stress cases."""

from __future__ import annotations

import random

import numpy as np
import pytest

from taction.verification.evidence.stress.matrices import make_array


def made(make: str, **arguments: object) -> np.ndarray:
    return np.array(make_array({"make": make, **arguments}))


def test_numbers_are_those_of_pythons_generator() -> None:
    draw = random.Random(5).uniform  # noqa: S311
    expected = [round(draw(-1.0, 1.0), 12) for _ in range(3)]
    assert made("drawn", size=3, seed=5).tolist() == pytest.approx(expected, abs=1e-12)


def test_the_same_seed_gives_the_same_numbers() -> None:
    one, other, third = (made("uniform", rows=2, columns=3, seed=k) for k in (1, 1, 2))
    assert (one == other).all()
    assert not (one == third).any()


def test_singular_values_are_those_asked_for() -> None:
    values = [1.0, 1e-2, 1e-5]
    found = np.linalg.svd(made("singular", values=values, seed=38), compute_uv=False)
    assert found == pytest.approx(values, rel=1e-5)


def test_a_skew_matrix_of_odd_size_is_singular() -> None:
    T = made("skew", size=5, seed=32)
    assert (T == -T.T).all()
    assert abs(np.linalg.det(T)) < 1e-12


def test_blocks_do_not_touch() -> None:
    T = made("blocks", size=6, block=2, seed=20)
    assert np.count_nonzero(T) == 12
    assert not T[:2, 2:].any()


def test_every_row_and_column_of_a_sparse_matrix_has_an_entry() -> None:
    T = made("sparse", rows=10, columns=10, seed=34, share=0.05)
    assert T.any(axis=0).all()
    assert T.any(axis=1).all()
    assert np.count_nonzero(T) < 25


def test_graded_entries_span_the_decades() -> None:
    sizes = np.abs(made("graded", rows=20, columns=20, seed=36, decades=15.0))
    assert 1e-15 <= sizes.min() < 1e-13
    assert 1e-2 < sizes.max() <= 1.0


def test_closed_forms() -> None:
    assert made("outer", column=[1.0, 2.0], row=[3.0, 4.0]).tolist() == [[3.0, 4.0], [6.0, 8.0]]
    assert made("hilbert", rows=2, columns=2)[1, 1] == pytest.approx(1 / 3)
    assert made("spike", size=3, place=2, value=7.0).tolist() == [0.0, 7.0, 0.0]
    assert made("constant", size=2, value=3.0).tolist() == [3.0, 3.0]
    assert (made("identity", rows=3, scale=-1.0) == -np.eye(3)).all()


def test_lists_are_taken_as_they_are() -> None:
    assert make_array([[1.0, 2.0]]) == [[1.0, 2.0]]


def test_an_unknown_generator_is_an_error() -> None:
    with pytest.raises(ValueError, match="expected one of 'identity'"):
        make_array({"make": "nonsense"})
