"""Poles of state spaces without their modes: eigenvalues, and the vectors of the rightmost one.

Where only poles are asked for, modes cost three times as much. The eigensolver's own error is
``eps |A|`` times the condition number of a pole, which only its vectors tell. So the poles have the
error `SEARCHED`, which is 100 times what rounding makes of well conditioned ones. The rightmost
one gets its two vectors, by inverse iteration: their quotient is exact to second order, and has the
bound that its mode would have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import EPS, Complexes, Floats
from taction.verification.engines.statespace.equations.alike import of_one_kind
from taction.verification.engines.statespace.linearised.block import UNITS
from taction.verification.engines.statespace.linearised.scaled_inverse import inverses
from taction.verification.engines.statespace.linearised.state_space import StateSpace

SEARCHED = 1e-9  # times the fastest pole: error of the poles that a search finds
ROOM = 30.0  # condition number of a pole that has this error if rounding does its worst
ASIDE, LEAST = 1e-6, 1e-12  # distance of the shift: of the pole, and at least of the fastest one
ITERATIONS = 4
DIVERGING = 0.25  # ratio of two terms of the series in the rounding, from which it may not end


@dataclass(frozen=True, slots=True, eq=False)
class LeadPole:
    """All poles of a board, 1/s, and bounds on their errors; (n,) each, the rightmost first."""

    poles: Complexes
    errors: Floats


@dataclass(frozen=True, slots=True, eq=False)
class _Lead:
    """The matrix, (n, n), and the sizes of its rounding, (2, n, n), that have the rightmost pole.

    `near` is its eigenvalue, `aside` the distance of a shift; `others` are the other eigenvalues of
    the board, but for the conjugate, and have the error `searched`.
    """

    A: Floats
    size: Floats
    near: complex
    aside: float
    others: Complexes
    searched: float

    @classmethod
    def of(cls, space: StateSpace, values: Sequence[Complexes]) -> _Lead | None:
        """Find the rightmost of the eigenvalues of each part; None if it cannot be told."""
        every = np.concatenate(values)
        fastest = float(np.abs(every).max(initial=0.0))
        searched = SEARCHED * fastest
        first = int(np.lexsort((-every.imag, -every.real))[0])
        lead = complex(every[first])
        same = (every == lead) | (every == lead.conjugate())
        sizes = space.parts.rounded
        rivals = every.real[~same] >= lead.real - 2.0 * searched
        rivalled = bool(rivals.any()) or int(same.sum()) > 1 + (lead.imag > 0.0)
        near_axis = 0.0 < lead.imag <= 2.0 * searched  # and so near its conjugate
        if rivalled or near_axis or not all(map(_is_sharp, space.parts.matrices, sizes)):
            return None
        part = 0 if first < len(values[0]) else 1
        aside = max(ASIDE * abs(lead), LEAST * fastest)
        A = space.blocks[part].A
        return cls(A, sizes[part], lead, aside, every[~same], searched)

    def joined(self, pole: complex, error: float) -> LeadPole:
        """Return all poles with the better value of the rightmost one, and its bound."""
        error += EPS**2 * self.searched / SEARCHED  # of a pole at zero: products of two
        lead = [pole, pole.conjugate()] if pole.imag else [pole]
        errors = np.full(len(lead) + len(self.others), self.searched)
        errors[: len(lead)] = error
        return LeadPole(np.concatenate([lead, self.others]), errors)


def _is_sharp(A: Floats, size: Floats) -> bool:
    """Tell whether rounding changes A so little that `SEARCHED` bounds its effect on poles."""
    rows = np.abs(A).sum(axis=-1)
    rounded = size[0].sum(axis=-1) + size[1] @ rows
    return bool(np.all(ROOM * UNITS * EPS * rounded <= SEARCHED * rows))


def lead_poles(spaces: Sequence[StateSpace]) -> list[LeadPole | None]:
    """Find the poles of state spaces, and bound the error of the rightmost one by its vectors.

    Boards of one size are computed as a stack; each has the digits that it has alone. None where
    only the modes tell: where poles that may be the rightmost are nearer than `SEARCHED`, where
    rounding may move poles farther, or where a matrix is not finite.

    Examples
    --------
    >>> import taction
    >>> from taction.netlist_gen.board.synthesis import synthesise
    >>> from taction.verification.engines.statespace.linearised.board import LinearBoard
    >>> circuit = synthesise(taction.load_scene("scenes/custom-matrix.toml"))
    >>> space = LinearBoard(circuit).state_space
    >>> (found,) = lead_poles([space])
    >>> off = abs(found.poles[0] - space.modes.poles[0])
    >>> bool(off < found.errors[0] < 1e-9 * abs(found.poles[0]))
    True
    """
    leads = dict[int, _Lead]()
    for place, values in _eigenvalues(spaces).items():
        lead = _Lead.of(spaces[place], values) if spaces[place].n else None
        if lead is not None:
            leads[place] = lead
    found = list[LeadPole | None]([None] * len(spaces))
    for places in of_one_kind({place: len(lead.A) for place, lead in leads.items()}):
        same = [leads[place] for place in places]
        poles, errors = _quotients(
            np.stack([lead.A for lead in same]),
            np.stack([lead.size for lead in same]),
            np.array([lead.near for lead in same]),
            np.array([lead.aside for lead in same]),
        )
        for place, lead, pole, error in zip(places, same, poles, errors, strict=True):
            if np.isfinite(error) and abs(pole - lead.near) <= lead.searched:
                found[place] = lead.joined(complex(pole), float(error))
    return found


def _eigenvalues(spaces: Sequence[StateSpace]) -> dict[int, list[Complexes]]:
    """Return the eigenvalues of each part of the state spaces whose matrices are finite."""
    finite = {
        place: [block.A for block in space.blocks]
        for place, space in enumerate(spaces)
        if all(np.isfinite(block.A).all() for block in space.blocks)
    }
    parts = {(place, k): A for place, some in finite.items() for k, A in enumerate(some)}
    found = dict[tuple[int, int], Complexes]()
    for same in of_one_kind({key: len(A) for key, A in parts.items()}):
        values = np.linalg.eigvals(np.stack([parts[key] for key in same]))
        found.update(zip(same, values.astype(np.complex128), strict=True))
    return {place: [found[place, k] for k in range(len(some))] for place, some in finite.items()}


def _quotients(A: Floats, size: Floats, near: Complexes, aside: Floats) -> tuple[Complexes, Floats]:
    """Return a pole of each matrix of a stack, (B,), and a bound on its error.

    With the vectors w and v, and S for the inverse beside this pole, a change E of the matrix moves
    the pole by ``w E v + w E S E v + ...`` over ``w v``. E is at most ``G = UNITS eps size``.
    Infinite where this series may diverge. The quotient itself is rounded relative to the distance
    of the shift, which is all there is of a pole at zero.
    """
    every, n = np.arange(len(A)), A.shape[-1]
    shifted, shift = A.astype(np.complex128), (near + aside)[:, None, None]
    shifted[:, np.arange(n), np.arange(n)] -= shift[:, 0]
    inverse = inverses(shifted)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        squares = inverse.real**2 + inverse.imag**2
        v = inverse[every, :, squares.sum(axis=1).argmax(axis=1)][:, :, None]
        w = inverse[every, squares.sum(axis=2).argmax(axis=1)][:, None, :]
        for _ in range(ITERATIONS):
            v, w = inverse @ v, w @ inverse
            v /= np.abs(v).max(axis=(1, 2), keepdims=True)
            w /= np.abs(w).max(axis=(1, 2), keepdims=True)
        moved, product = shifted @ v, w @ v
        off = w @ moved / product  # of the pole from the shift
        off.imag[near.imag == 0.0] = 0.0
        beside, pole = np.abs(inverse - v @ w / (product * off)), shift + off
        speed = np.abs(pole)

        def rounded(x: Floats) -> Floats:
            return np.asarray(UNITS * EPS * (size[:, 0] @ x + speed * (size[:, 1] @ x)))

        change, seen = rounded(np.abs(v)), np.abs(w)
        first = change + np.abs(moved - off * v)
        spread = beside @ first
        second = rounded(spread)
        ratio = (second / first).max(axis=1)[:, 0]
        missing = np.abs(w @ shifted - off * w)
        terms = (seen @ second + missing @ spread)[:, 0, 0] / (1.0 - ratio)
        shifting = UNITS * EPS * (np.abs(moved) + aside[:, None, None] * np.abs(v))
        bound = ((seen @ (change + shifting))[:, 0, 0] + terms) / np.abs(product[:, 0, 0])
    poles = pole[:, 0, 0]
    bound += 2.0 * EPS * np.abs(poles)
    return poles, np.where(ratio < DIVERGING, bound, np.inf)
