"""Modes of a matrix before its elements were rounded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from taction.system.array_types import Bools, Floats
from taction.verification.engines.statespace.linearised.accurate_products import accurate_sum
from taction.verification.engines.statespace.linearised.exactness import Exactness
from taction.verification.engines.statespace.linearised.mode_groups import mode_groups, turns
from taction.verification.engines.statespace.linearised.real_columns import (
    both,
    column_sizes,
    complex_columns,
    complex_rows,
    row_sizes,
    times_poles,
    unmodal,
)
from taction.verification.engines.statespace.linearised.real_modes import (
    EPS,
    Block,
    separated,
)

SPARE = 4.0  # times eps: rounding of a residual that was computed to twice the precision
ROUNDS = 3  # largest number of steps


def polished(A: Floats, block: Block, exactness: Exactness) -> Block:
    """Return the modes of the matrix before rounding, by Newton steps with accurate residuals.

    What remains is the rounding of the elements from which A was computed, and of the result.
    Modes that a step cannot separate are separated by an eigenproblem of their own first. The block
    is returned as it is where its rows are too far from the inverse of its columns for a step, as
    for defective modes: a step would lead away from the modes.
    """
    refined = block
    for _ in range(ROUNDS):
        if not block.is_refinable:
            return refined
        refined, inner, close = _step(A, block, exactness)
        if not close.any() or not (groups := mode_groups(close, block.real)):
            return refined
        block = separated(block, inner, groups)
    return refined


def _step(A: Floats, block: Block, exactness: Exactness) -> tuple[Block, Floats, Bools]:
    """Return the modes after a step, ``left A right``, and which modes are too close for a step."""
    R, L, real, count = block.right, block.left, block.real, len(block.kept)
    one = np.eye(len(A))
    diagonal = times_poles(one, block.kept, real)
    residual = accurate_sum([exactness.tail @ R], [(A, R), (-R, diagonal)])
    rest = accurate_sum([one], [(-L, R)])
    error = L @ residual
    error += rest @ error
    reduced = complex_columns(complex_rows(error, real, count), real)
    kept = block.kept + reduced.diagonal()
    np.fill_diagonal(reduced, 0.0)
    turn, close = turns(reduced, kept, real)
    coupled = np.where(close, np.abs(reduced), 0.0)
    turning = unmodal(turn, real, count)
    R, L = R + R @ turning, L + (rest - turning) @ L
    L = L + accurate_sum([one], [(-L, R)]) @ L
    overlap = both(complex_rows(accurate_sum([one], [(-L, R)]), real, count), real)
    refined = Block(kept, real, R, L, coupled.sum(axis=1), block.size)
    noise = _dependence(refined, exactness)
    noise += SPARE * EPS * (row_sizes(L, real) @ column_sizes(np.abs(residual), real))
    refined = replace(refined, noise=noise, overlap=np.abs(complex_columns(overlap, real)))
    return refined, diagonal + error, coupled > 0.0


def _dependence(block: Block, exactness: Exactness) -> Floats:
    """Return what the rounding of the board's elements adds to ``left A right``, (n, n), 1/s."""
    left, right = row_sizes(block.left @ exactness.left, block.real), exactness.right @ block.right
    moved = left**2 @ (exactness.stiffness**2 @ column_sizes(right, block.real) ** 2)
    speed = (column_sizes(block.right, block.real) * np.abs(block.poles)) ** 2
    moved += left[:, : len(speed)] ** 2 @ (exactness.mass**2 @ speed)
    return np.asarray(EPS * np.sqrt(moved))
