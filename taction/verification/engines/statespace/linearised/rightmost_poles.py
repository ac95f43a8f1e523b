"""The rightmost poles of large boards.

Arnoldi's method on ``(sigma M - K)^-1 M`` finds the poles nearest to a shift; one iteration costs
one structured solve (see `structured_solve`). A shift at the origin finds the slowest poles; the
rightmost poles of the coarse board and the ringing ones select the others. From each, further
shifts follow until no pole is farther right. The residual of a vector gives its pole's error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from taction.system.array_types import Complexes, Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.structured_solve import Structure
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard

NEAREST = 4  # number of poles requested at a shift; each further shift asks for twice as many
FIRST_OFFSET = 0.01  # of the first shift to the right of a coarse pole, over the pole's magnitude
NEXT_OFFSET = 5e-4  # of the next shift, right of the pole found; closer shifts converge faster
ROUNDS = 5  # shifts at one place
PLACES = 3  # coarse poles used
ORIGIN = complex(0.0)
FAR_LEFT = 10.0  # a coarse pole more times further left than the rightmost pole is skipped
DAMPED = 0.05  # damping ratio of a coarse pole that is not followed: the coarse board errs by less
ROUGH, FINE = 1e-4, 1e-6  # tolerance over the distance, at the first and the following shifts
RESTARTS, LAST_RESTARTS = 6, 30  # for all poles requested; then, where none converged, for one
SLANT = 30.0  # times the residual of a vector: error of its pole, for directions that are oblique
RIGHTMOST_ROUNDED = 1e-10  # of a pole: least error
SAME = 1e-8  # of a pole: two poles that are nearer than this are one


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Poles, 1/s, rightmost first, and bounds on their errors, 1/s; (k,) each."""

    poles: Complexes
    errors: Floats

    def joined(self, other: Found) -> Found:
        """Return the poles of both; of two that are the same, that with the smaller error."""
        poles = np.concatenate([self.poles, other.poles])
        errors = np.concatenate([self.errors, other.errors])
        kept: list[int] = []
        for place in np.argsort(errors, kind="stable").tolist():
            pole = poles[place]
            if all(abs(pole - poles[k]) > SAME * abs(pole) for k in kept):
                kept.append(place)
        order = sorted(kept, key=lambda k: (-poles[k].real, -poles[k].imag))
        return Found(poles[order], errors[order])


NONE = Found(np.zeros(0, dtype=np.complex128), np.zeros(0))


def rightmost_poles(board: LinearBoard) -> Found:
    """Find the rightmost poles of a board near a few shifts.

    EngineError: the board does not split into cells, or has no equilibrium, or poles farther right
      appear at every further shift.
    """
    found = _poles_around(board.structure, ORIGIN)
    coarse = board.coarse.state_space.modes.poles
    ringing = coarse[(coarse.imag > 0.0) & (coarse.real > -DAMPED * np.abs(coarse))]
    for place in _distinct(ringing)[:PLACES]:
        around = _poles_around(board.structure, place)
        if not len(around.poles):
            message = f"no pole near {place!r} converged in {LAST_RESTARTS} restarts"
            raise EngineError(message)
        found = found.joined(around)
    for place in _distinct(coarse[np.lexsort((-coarse.imag, -coarse.real))])[:PLACES]:
        lead = float(found.poles[0].real) if len(found.poles) else -math.inf
        if place.real >= lead - FAR_LEFT * abs(lead):  # what is left of the lead changes nothing
            found = found.joined(_poles_around(board.structure, place, lead))
    if not len(found.poles):  # no ringing, and no slow pole near the origin
        raise EngineError(f"no pole near the origin converged in {LAST_RESTARTS} restarts")
    return found


def _poles_around(structure: Structure, place: complex, known: float = -math.inf) -> Found:
    """Find the poles around a place; repeat with new shifts until none is farther right.

    A search whose poles are not right of `known`, 1/s, ends.

    None where a cluster is too tight for any of its poles to converge.
    """
    found = nearest_poles(structure, place + FIRST_OFFSET * abs(place), NEAREST, ROUGH)
    for number in range(1, ROUNDS):
        if not len(found.poles):
            return found
        lead, error = complex(found.poles[0]), float(found.errors[0])
        if abs(lead - place) <= FIRST_OFFSET * abs(place) and error <= SAME * abs(lead):
            return found  # the shift was beside it
        if lead.real - error <= known:
            return found
        shift, count = lead + NEXT_OFFSET * abs(lead), NEAREST << (number - 1)
        cluster = len(found.poles) < NEAREST  # so tight that few of its poles converge
        finer = NONE if cluster else nearest_poles(structure, shift, count, FINE)
        if not len(finer.poles):
            return found
        right = complex(finer.poles[0])
        if right.real <= lead.real + error + ROUGH * abs(lead):
            return finer
        found = finer
    raise EngineError(
        f"poles farther right appear at each of {ROUNDS} shifts from {place!r}; the rightmost one"
        " is not known"
    )


def nearest_poles(structure: Structure, shift: complex, count: int, tolerance: float) -> Found:
    """Find about `count` poles nearest to a shift (and their conjugates).

    `tolerance` is relative to the distance from the shift. In a tight cluster the iteration may
    find fewer poles, or none.
    """
    from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs

    size = structure.descriptor.size
    solve, mass = structure.factor(shift), structure.mass
    # A real shift has a real operator; complex vectors cost three times as much.
    kind = np.float64 if complex(shift).imag == 0.0 else np.complex128

    def apply(x: Any) -> Any:
        return solve(np.ascontiguousarray((mass @ x).astype(kind, copy=False)))

    operator = LinearOperator((size, size), matvec=lambda x: apply(x.ravel()), dtype=kind)
    start = apply(np.random.default_rng(1).standard_normal(size))
    theta: Any = np.zeros(0)
    vectors: Any = None
    for number, restarts in ((count, RESTARTS), (1, LAST_RESTARTS)):
        if not len(theta):
            try:
                theta, vectors = eigs(
                    operator,
                    k=min(number, size - 2),
                    ncv=min(size, 6 * count + 8),
                    v0=start,
                    tol=tolerance,
                    maxiter=restarts,
                )
            except ArpackNoConvergence as error:
                theta, vectors = np.asarray(error.eigenvalues), np.asarray(error.eigenvectors)
    if not len(theta):
        return NONE
    poles = np.asarray(shift - 1.0 / theta, dtype=np.complex128)
    moved = apply(vectors.real) + 1j * apply(vectors.imag) if kind is np.float64 else apply(vectors)
    off = np.linalg.norm(moved - vectors * theta, axis=0) / np.linalg.norm(vectors, axis=0)
    errors = SLANT * off / np.abs(theta) ** 2 + RIGHTMOST_ROUNDED * np.abs(poles)
    real = np.abs(poles.imag) < np.maximum(errors, 1e-9 * np.abs(poles))
    poles[real] = poles[real].real
    once = Found(poles, errors)
    return NONE.joined(once).joined(Found(poles.conj(), errors))


def _distinct(poles: Complexes) -> list[complex]:
    """Return poles with Im >= 0, rightmost first, without those within 30 % of an earlier one."""
    kept: list[complex] = []
    for pole in poles[poles.imag >= 0.0].tolist():
        if all(abs(pole - other) > 0.3 * abs(pole) for other in kept):
            kept.append(pole)
    return kept
