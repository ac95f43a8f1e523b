"""Boards that are their own mirror image: found by value, split exactly, the same modes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from taction.netlist_gen.board.circuit import Circuit
from taction.system.array_types import Floats, Ints
from taction.verification.engines.statespace.equations.mirror_symmetry import (
    DenseMatrix,
)
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.transients.exact import ModalFlow, exact_solution
from taction.verification.stability.poles import poles
from tests.support.boards import board, decompose, kernel, strain, two_pole

ODD, EVEN = np.array([4, 3, 2, 1, 0]), np.array([5, 4, 3, 2, 1, 0])


def symmetric(image: Ints) -> Floats:
    A = np.random.default_rng(len(image)).standard_normal((len(image), len(image)))
    both: Floats = A + A[np.ix_(image, image)]
    return both


def small_board(channels: int) -> Circuit:
    """With a symmetric matrix to the bit, which numbers by `linspace` need not give."""
    T = kernel(channels, 3.0)
    eps = np.maximum(strain(channels, 3.0), 0.05)
    T, eps = 0.5 * (T + T[::-1, ::-1]), 0.5 * (eps + eps[::-1])
    return board(T, eps, two_pole(790e3, 12e-12))


def with_one_resistor_off(circuit: Circuit, by: float) -> Circuit:
    forward = circuit.forward
    ohms = forward.ohms.copy()
    ohms[2, 0] *= 1.0 + by
    return replace(circuit, matrices=(replace(forward, ohms=ohms), *circuit.matrices[1:]))


@pytest.mark.parametrize("image", [ODD, EVEN, np.array([0, 2, 1, 3])])
def test_what_commutes_with_the_exchange_splits_exactly(image: Ints) -> None:
    A = symmetric(image)
    determined = np.zeros(len(image), dtype=np.bool_)
    even, odd = blocks = DenseMatrix.of(np.eye(len(image)), A, determined, image).blocks
    assert len(even.places) + len(odd.places) == len(image)
    x = np.random.default_rng(2).standard_normal(len(image))
    for block, part in ((even, x + x[image]), (odd, x - x[image])):
        assert block.basis @ (block.left @ part) == pytest.approx(part, rel=1e-14)
        assert block.left @ block.basis == pytest.approx(np.eye(len(block.places)), abs=1e-15)
        found = block.basis @ (block.stiffness @ (block.left @ part))
        assert found == pytest.approx(A @ part, rel=1e-13)
    modes = decompose(*[block.stiffness for block in blocks])
    wanted = np.sort_complex(np.linalg.eigvals(A))
    assert np.sort_complex(modes.poles) == pytest.approx(wanted, abs=1e-13)
    basis, left = np.hstack([even.basis, odd.basis]), np.vstack([even.left, odd.left])
    right, dual = basis @ modes.right, modes.left @ left
    assert (right * modes.poles) @ dual == pytest.approx(A, abs=1e-13)
    assert dual @ right == pytest.approx(np.eye(len(image)), abs=1e-13)
    assert np.all(np.diff(modes.poles.real) <= 1e-13)
    # The bounds of the blocks are those of the whole matrix.
    rows, start = np.eye(len(image)), np.ones(len(image))
    found = np.sum(modes.shares(rows @ basis, left @ start).errors)
    whole = np.sum(decompose(A).shares(rows, start).errors)
    assert 0.3 * whole < found < 3.0 * whole


def test_real_arithmetic_keeps_pairs_and_their_order_of_accuracy() -> None:
    # Poles over nine decades, the slow ones wanted to their own size.
    wanted = np.array([-1.0, -2.0 + 30.0j, -2.0 - 30.0j, -5e3, -1e5 + 4e6j, -1e5 - 4e6j, -3e9])
    blocks = np.zeros((7, 7))
    blocks[np.arange(7), np.arange(7)] = wanted.real
    for k in (1, 4):
        blocks[k, k + 1], blocks[k + 1, k] = wanted[k].imag, -wanted[k].imag
    turn = np.eye(7) + np.triu(np.random.default_rng(5).integers(-2, 3, (7, 7)), 1)
    scale = 10.0 ** np.arange(7)
    A = np.linalg.inv(turn) @ blocks @ turn * scale / scale[:, None]
    modes = decompose(A)
    assert modes.poles == pytest.approx(np.sort_complex(wanted)[::-1], rel=1e-5)
    assert modes.defect < 1e-12
    pairs = np.flatnonzero(modes.poles.imag > 0.0)
    assert np.array_equal(modes.right[:, pairs], modes.right[:, pairs + 1].conj())
    assert np.array_equal(modes.left[pairs], modes.left[pairs + 1].conj())


@pytest.mark.parametrize("channels", [2, 3, 8])
def test_the_halves_of_a_board_have_its_poles(channels: int) -> None:
    space = LinearBoard(small_board(channels)).state_space
    assert len(space.blocks) == 2
    found, wanted = space.modes.poles, np.linalg.eigvals(space.A)
    for few, others in ((found, wanted), (wanted, found)):
        distance = np.abs(few[:, None] - others[None, :]).min(axis=1)
        assert np.all(distance <= 1e-9 * np.abs(few) + 1e-14 * np.abs(wanted).max())


def test_a_board_reduced_by_halves_is_the_board_reduced_whole() -> None:
    circuit = small_board(5)
    found = LinearBoard(circuit).state_space
    assert len(found.blocks) == 2
    wanted = LinearBoard(circuit, replace(found.descriptor, mirror=None)).state_space
    assert len(wanted.blocks) == 1
    # The states of the whole board are voltages of nodes.
    turn = found.C[[wanted.nodes.index(state) for state in wanted.states]]
    assert pytest.approx(wanted.A @ turn, rel=1e-12, abs=2e-15 * np.abs(wanted.A).max()) == (
        turn @ found.A
    )
    z = np.random.default_rng(3).standard_normal(len(found.nodes))
    pairs = [
        (turn @ found.B, wanted.B),
        (found.C, wanted.C @ turn),
        (found.D, wanted.D),
        (turn @ found.state_of(z), wanted.state_of(z)),
        (found.rows(found.nodes[::-1])[0], wanted.rows(wanted.nodes[::-1])[0] @ turn),
    ]
    for one, other in pairs:
        assert pytest.approx(other, rel=1e-12, abs=1e-13 * np.abs(other).max()) == one


@pytest.mark.parametrize("by", [2.3e-16, 1e-15, 1e-12, 1e-6])
def test_a_board_that_is_not_quite_its_own_image_is_taken_whole(by: float) -> None:
    circuit = small_board(7)
    off = with_one_resistor_off(circuit, by)
    assert LinearBoard(circuit).state_space.blocks[1:]
    assert not LinearBoard(off).state_space.blocks[1:]
    assert poles(off).rightmost == pytest.approx(poles(circuit).rightmost, rel=1e-9 + 10.0 * by)
    t = np.linspace(0.0, 1e-4, 101)
    one, other = exact_solution(circuit).at(t), exact_solution(off).at(t)
    assert np.abs(one - other).max() <= (1e-11 + 10.0 * by) * np.abs(one).max()


def test_a_growing_mode_is_never_left_out() -> None:
    circuit = small_board(7)
    wild = replace(circuit, capacitors=tuple(replace(c, farads=4e-12) for c in circuit.capacitors))
    growing = poles(wild).poles
    growing = growing[(growing.real > 0.0) & (growing.imag > 0.0)]
    flow = exact_solution(wild).flow
    assert isinstance(flow, ModalFlow)
    assert len(growing) > 2
    assert np.sum(flow.poles.real > 0.0) == len(growing)
