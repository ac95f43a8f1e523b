"""Poles of state spaces without their modes: eigenvalues, and the vectors of the rightmost one.

Where only poles are asked for, modes cost three times as much. The eigensolver's own error is
``eps |A|`` times the condition number of a pole, which only its vectors tell. So the poles have the
error `SEARCHED`, which is 100 times what rounding makes of well conditioned ones. The rightmost
one gets its two vectors, by inverse iteration: their quotient in the equations as they were stamped
is exact to second order, and has the bound that its mode would have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taction.system.array_types import EPS, Complexes, Floats
from taction.verification.engines.statespace.equations.alike import of_one_kind
from taction.verification.engines.statespace.linearised.reduction import ROUNDED, Reduced
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


def lead_poles(spaces: Sequence[StateSpace]) -> list[LeadPole | None]:
    """Find the poles of state spaces, and bound the error of the rightmost one by its vectors.

    None where only the modes tell: where poles that may be the rightmost are nearer than
    `SEARCHED`, where rounding may move poles farther, or where a matrix is not finite.

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
    values = _eigenvalues(spaces)
    return [_lead(s, values[k]) if k in values else None for k, s in enumerate(spaces)]


def _eigenvalues(spaces: Sequence[StateSpace]) -> dict[int, list[Complexes]]:
    """Return the eigenvalues of each block of the state spaces whose matrices are finite."""
    finite = {
        place: [block.A for block in space.blocks]
        for place, space in enumerate(spaces)
        if space.n and all(np.isfinite(block.A).all() for block in space.blocks)
    }
    parts = {(place, k): A for place, some in finite.items() for k, A in enumerate(some)}
    found = dict[tuple[int, int], Complexes]()
    for same in of_one_kind({key: len(A) for key, A in parts.items()}):
        values = np.linalg.eigvals(np.stack([parts[key] for key in same]))
        found.update(zip(same, values.astype(np.complex128), strict=True))
    return {place: [found[place, k] for k in range(len(some))] for place, some in finite.items()}


def _lead(space: StateSpace, values: Sequence[Complexes]) -> LeadPole | None:
    """Return all poles of a board with its rightmost one refined; None if it cannot be told."""
    every = np.concatenate(values)
    fastest = float(np.abs(every).max(initial=0.0))
    searched = SEARCHED * fastest
    first = int(np.lexsort((-every.imag, -every.real))[0])
    lead = complex(every[first])
    same = (every == lead) | (every == lead.conjugate())
    rivals = every.real[~same] >= lead.real - 2.0 * searched
    rivalled = bool(rivals.any()) or int(same.sum()) > 1 + (lead.imag > 0.0)
    near_axis = 0.0 < lead.imag <= 2.0 * searched  # and so near its conjugate
    if rivalled or near_axis or not all(map(_is_sharp, space.blocks)):
        return None
    block = space.blocks[0 if first < len(values[0]) else 1]
    aside = max(ASIDE * abs(lead), LEAST * fastest)
    pole, error = _quotient(block, lead, aside)
    if not (np.isfinite(error) and abs(pole - lead) <= searched):
        return None
    error += EPS**2 * fastest  # of a pole at zero: products of two
    known = [pole, pole.conjugate()] if pole.imag else [pole]
    errors = np.full(len(every), searched)
    errors[: len(known)] = error
    return LeadPole(np.concatenate([known, every[~same]]), errors)


def _is_sharp(block: Reduced) -> bool:
    """Tell whether rounding changes A so little that `SEARCHED` bounds its effect on poles."""
    pencil, rows = block.pencil, np.abs(block.A).sum(axis=1)
    seen = np.abs(block.seen)
    moved = pencil.mass @ (seen @ rows) + pencil.pull @ seen.sum(axis=1)
    return bool(np.all(ROOM * ROUNDED * (np.abs(block.left) @ moved) <= SEARCHED * rows))


def _quotient(block: Reduced, near: complex, aside: float) -> tuple[complex, float]:
    """Return a pole of a block, and a bound on its error.

    With the vectors w and v of the pencil, and S for the inverse beside this pole, a change E of
    ``s M - K`` moves the pole by ``w E v + w E S E v + ...`` over ``w M v``. E is at most the
    rounding of the terms and what the vectors miss. Infinite where this series may diverge.
    """
    pencil, A, left, one = block.pencil, block.A, np.abs(block.left), np.eye(len(block.A))
    shift = near + aside
    inverse = inverses((A - shift * one)[None])[0]
    squares = inverse.real**2 + inverse.imag**2
    x, y = inverse[:, squares.sum(axis=0).argmax()], inverse[squares.sum(axis=1).argmax()]
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        for _ in range(ITERATIONS):
            x, y = inverse @ x, y @ inverse
            x, y = x / np.abs(x).max(), y / np.abs(y).max()
        if near.imag == 0.0:
            x, y = x.real + 0j, y.real + 0j
        off = complex(y @ (A @ x - shift * x)) / complex(y @ x)  # of A's own pole from the shift
        beside, pole = np.abs(inverse - np.outer(x, y) / (complex(y @ x) * off)), shift + off
        v, w = block.seen @ x, block.lefts(np.array([[pole]]), y[None])[0]
        charged = pencil.M @ v
        size, speed = complex(w @ charged), abs(pole)
        missing = pole * charged - pencil.K @ v
        pole -= complex(w @ missing) / size

        def rounded(vector: Floats) -> Floats:
            return np.asarray(ROUNDED * (speed * (pencil.mass @ vector) + pencil.pull @ vector))

        first = rounded(np.abs(v)) + np.abs(missing)
        rates = left @ first
        spread = np.abs(block.seen) @ (beside @ rates)
        second = rounded(spread)
        behind = np.abs(pole * (w @ pencil.M) - w @ pencil.K) @ spread
        ratio = float((left @ second / rates).max())
        terms = (np.abs(w) @ second + behind) / (1.0 - ratio)
        bound = float(np.abs(w) @ rounded(np.abs(v)) + terms) / abs(size) + 2.0 * EPS * abs(pole)
    if near.imag == 0.0:
        pole = complex(pole.real)
    return pole, bound if ratio < DIVERGING else np.inf
