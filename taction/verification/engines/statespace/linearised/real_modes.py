"""The block diagonal form of one matrix, in real arithmetic: pairs stay exact conjugates.

A mode with a direction of its own is a block of one. Modes that have (nearly) the same direction
are one block: a basis of their common space, well conditioned, and the small matrix that acts in
it (`Joined`). So defective and nearly defective matrices are ordinary ones.

A real mode stays real, and no rounding separates a pair. Real columns ``a, b`` represent the
vectors ``a - ib, a + ib`` of a conjugate pair, and real rows ``p, q`` their duals ``(p + iq) / 2,
(p - iq) / 2``. The real modes come first, then the first of every pair, then the second of every
pair, so that slices select them.

Functions of matrices take stacks of them, too: leading axes, of matrices with as many real modes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taction.system.array_types import EPS, Bools, Complexes, Floats, Ints


def both(kept: NDArray[Any], real: int, axis: int = -1) -> NDArray[Any]:
    """Append the conjugates of the pairs, along an axis, -1 or -2."""
    pairs = kept[..., real:] if axis == -1 else kept[..., real:, :]
    return np.concatenate([kept, pairs.conj()], axis=axis)


def complex_columns(X: NDArray[Any], real: int) -> Complexes:
    """Return complex columns for real ones."""
    V, count = X.astype(np.complex128), (X.shape[-1] + real) // 2
    turned = 1j * X[..., count:]
    V[..., count:] = V[..., real:count] + turned
    V[..., real:count] -= turned
    return V


def column_sizes(X: Floats, real: int) -> Floats:
    """Return the magnitudes of the complex columns for real ones."""
    with np.errstate(over="ignore"):
        squares, count = X**2, (X.shape[-1] + real) // 2
    squares[..., real:count] += squares[..., count:]
    squares[..., count:] = squares[..., real:count]
    sizes = np.asarray(np.sqrt(squares))
    finite = np.isfinite(sizes).all(axis=(-2, -1), keepdims=True)
    if not np.all(finite):  # the square of a vector of any size may be too large
        others = np.abs(X)
        pairs = np.hypot(X[..., real:count], X[..., count:])
        others[..., real:count] = others[..., count:] = pairs
        sizes = np.where(finite, sizes, others)
    return sizes


def row_sizes(X: Floats, real: int) -> Floats:
    """Return the magnitudes of the complex rows for real ones."""
    sizes = column_sizes(X.swapaxes(-1, -2), real).swapaxes(-1, -2)
    sizes[..., real:, :] *= 0.5
    return sizes


def complex_rows(X: Floats, real: int, count: int) -> Complexes:
    """Return complex rows for real ones, without their conjugates."""
    V = X[..., :count, :].astype(np.complex128)
    V.imag[..., real:, :] = X[..., count:, :]
    V[..., real:, :] *= 0.5
    return V


def unmodal(V: Complexes, real: int, count: int) -> Floats:
    """Invert `complex_columns` and `complex_rows`."""
    first, second = V[..., real:count], V[..., count:]
    parts = [V[..., :real], 0.5 * (first + second), 0.5j * (first - second)]
    Z = np.concatenate(parts, axis=-1)
    X = np.concatenate([Z.real, Z.imag[..., real:, :]], axis=-2)
    X[..., real:, :] *= 2.0
    return np.asarray(X)


SEPARABLE = 1e-2  # a step separates modes whose coupling is below this part of their distance
SWEEPS = 60  # largest number of sweeps over the couplings within blocks
FINER = 1e-3  # of the largest turn: a smaller change ends the sweeps


@dataclass(frozen=True, eq=False)
class Joined:
    """Modes of one block: ``exp(A t)`` acts in their space as ``exp(centre t) exp(inner t)``.

    Attributes
    ----------
    members : ndarray of int (m,)
        Their places among the kept modes; all are real ones, or all are of pairs.
    inner : ndarray (m, m)
        What acts beside the common centre, 1/s.
    """

    members: Ints
    inner: Complexes

    @property
    def places(self) -> tuple[Ints, ...]:
        """Index of the block within a matrix of all modes."""
        return np.ix_(self.members, self.members)

    def scale(self, centre: complex) -> float:
        """Return the rate, 1/s, to which powers of the time are relative."""
        return 0.5 * abs(centre.real)

    def growth(self, centre: complex) -> Floats:
        """Return G with ``|exp(inner t)| <= G exp(scale t)`` for t >= 0, by element."""
        scale, powers = self.scale(centre), [np.eye(len(self.members), dtype=np.complex128)]
        for k in range(1, POWERS):
            powers.append(powers[-1] @ self.inner / (scale * k))
            if np.abs(powers[-1]).max() * (k / math.e) ** k < EPS:
                break
        x = np.append(0.0, np.geomspace(*SAMPLED))
        weight = x[:, None] ** np.arange(len(powers)) * np.exp(-x)[:, None]
        return np.asarray(SPARE * np.abs(np.tensordot(weight, np.array(powers), 1)).max(axis=0))


POWERS = 100  # largest number of powers of the time in a block
SAMPLED = (1e-2, 1e2, 120)  # first and last instant in units of the scale, and number
SPARE = 1.05  # for what lies between the instants


def turns(
    reduced: Complexes, kept: Complexes, real: int, joined: Sequence[Joined] = ()
) -> tuple[Complexes, Bools]:
    """Return the turns (..., k, n) of a Newton step, and which modes are too close for a step.

    Where modes are joined, the turn Z solves ``Z (gap) = reduced + inner Z - Z inner``, by sweeps.
    """
    gap = both(kept, real)[..., None, :] - kept[..., None]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        turn = reduced / gap
        close = ~(turn.real**2 + turn.imag**2 < SEPARABLE**2)  # and each to itself
    turn[close] = 0.0
    if not joined:
        return turn, close
    gap[close] = np.inf
    change = turn
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for _ in range(SWEEPS):
            change = _coupled(change, joined, real) / gap
            turn = turn + change
            if not np.abs(change).max(initial=0.0) > FINER * np.abs(turn).max(initial=0.0):
                break
    far = ~(np.abs(turn) < SEPARABLE)
    turn[far] = 0.0
    return turn, close | far


def _coupled(Z: Complexes, joined: Sequence[Joined], real: int) -> Complexes:
    """Return ``inner Z - Z inner`` of the turns (k, n)."""
    moved, shift = np.zeros_like(Z), (Z.shape[-1] + real) // 2 - real
    for block in joined:
        at, inner = block.members, block.inner
        moved[..., at, :] += inner @ Z[..., at, :]
        moved[..., at] -= Z[..., at] @ inner
        if at[0] >= real:
            moved[..., at + shift] -= Z[..., at + shift] @ inner.conj()
    return moved


def mode_groups(linked: Bools, real: int) -> list[Ints]:
    """Return the connected groups of more than one mode, by links to all modes, (k, n)."""
    if not linked.any():
        return []
    count = len(linked)
    reach = linked[:, :count] | np.eye(count, dtype=np.bool_)
    reach[:, real:] |= linked[:, count:]
    reach |= reach.T
    while not np.array_equal(wider := reach @ reach, reach):
        reach = wider
    rows = np.unique(reach, axis=0)
    return [np.flatnonzero(row) for row in rows if row.sum() > 1]
