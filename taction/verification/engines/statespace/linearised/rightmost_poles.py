"""Poles without modes: the rightmost ones of large boards, and the number of any.

Arnoldi's method on ``(sigma M - K)^-1 M`` finds the poles nearest to a shift; one iteration costs
one structured solve (see `structured_solve`). A shift at the origin finds the slowest poles; the
rightmost poles of the coarse board and the ringing ones select the others. From each, further
shifts follow until no pole is farther right. The residual of a vector gives its pole's error.

A winding number (`count_right`) proves that none is missing, for 50 to 100 factorisations with an
eigenproblem of the size of the summing nodes each: more than the whole verdict costs. The number of
poles right of a vertical line is the winding of the determinant: ``det(s M - K)`` is
a polynomial of degree n whose roots are the poles. Along a vertical line from the real axis upwards
its argument turns by ``pi/2 (left - right)``. The determinant is the product of two: that of the
cells, whose poles are known one by one, and that of the Schur complement S on the summing nodes
(see `structured_solve`), which is followed from point to point. There the change of the argument is
the sum over the eigenvalues of ``S(s1)^-1 S(s2)``. Each of these starts at 1 and moves little in a
short step, so none is lost, even if many modes have one frequency. The count is independent of any
search for poles.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from taction.system.array_types import EPS, Complexes, Floats
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
    solve, mass = structure.factor(shift).solve, structure.mass
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


TOP = 1e5  # of the line, in units of the board's fastest rate
FREQUENCY_RATIO = 4.0  # largest ratio of neighbouring frequencies
INFINITE = 1e-13  # fastest rate over a pole: a smaller ratio is a pole at infinity
LARGEST_TURN = 1.0  # of one eigenvalue in a step, rad
ROUNDING = 16.0 * EPS
"""Distance of a pole from the line, in units of the fastest rate, at which rounding may decide its
side. The steps beside a pole are about as long as its distance. Measured on boards of 7 to 20
channels: with lines up to a quarter of this distance from a pole, some counts are wrong."""


def count_right(structure: Structure, abscissa: float = 0.0) -> int:
    """Count the poles with a real part above `abscissa`, 1/s.

    The vertical line must not pass through a pole.

    EngineError: a pole lies on the line to within rounding, or the count is not a whole number.
    """
    rates, cells = cell_poles(structure)
    fastest = float(rates.max(initial=1.0))
    top = TOP * fastest
    sizes = [_schur(structure, abscissa + 1j * turns * top)[2] for turns in (1.0, 2.0)]
    degree = (sizes[1] - sizes[0]) / math.log(2.0)
    turn = _schur_turn(structure, abscissa, fastest, top)
    offset = abscissa - cells.real
    if np.any(np.abs(offset) <= ROUNDING * fastest):
        raise EngineError(f"a pole of a single cell lies on the line at {abscissa!r} /s")
    upper, lower = (np.arctan((omega - cells.imag) / np.abs(offset)) for omega in (top, 0.0))
    turn += float(np.sum(np.sign(offset) * (upper - lower)))
    right = float(0.5 * (len(cells) + degree - turn / (0.5 * math.pi)))
    if abs(right - round(right)) > 0.05:
        raise EngineError(f"the winding number gives {right!r} poles, which is not a whole number")
    return round(right)


def _schur(structure: Structure, s: complex) -> tuple[complex, Complexes, float]:
    """Return s, the Schur complement there, and the logarithm of its determinant's size."""
    schur = structure.factor(s, solver=False).schur
    sign, log_size = np.linalg.slogdet(schur)
    if sign == 0.0:
        raise EngineError(f"a pole lies at {s!r} /s")
    return s, schur, float(log_size)


def _schur_turn(structure: Structure, abscissa: float, fastest: float, top: float) -> float:
    """Return the total turn of the Schur complement's determinant along the line, rad."""
    start = 1e-6 * fastest
    count = max(math.ceil(math.log(top / start) / math.log(FREQUENCY_RATIO)), 1)
    total, (s, schur, _) = 0.0, _schur(structure, complex(abscissa))
    for omega in np.geomspace(start, top, count + 1).tolist():
        ahead = [_schur(structure, abscissa + 1j * omega)]
        while ahead:
            turns = np.angle(np.linalg.eigvals(np.linalg.solve(schur, ahead[-1][1])))
            if np.abs(turns).max(initial=0.0) <= LARGEST_TURN:
                total += float(turns.sum())
                s, schur, _ = ahead.pop()
                continue
            if abs(ahead[-1][0] - s) <= ROUNDING * fastest:
                raise EngineError(f"a pole lies on the line near {s!r} /s")
            ahead.append(_schur(structure, 0.5 * (s + ahead[-1][0])))
    return total


def cell_poles(structure: Structure) -> tuple[Floats, Complexes]:
    """Return the board's rates (1/s), and the poles of each separate cell."""
    poles, rates = [], []
    for group in structure.groups:
        M, K = group.mass, group.stiffness
        weight = np.abs(M).max(axis=2)
        rate = np.abs(K).max(axis=2)[weight > 0.0] / weight[weight > 0.0]
        if not len(rate):
            continue
        rates.append(rate)
        poles += [_finite_poles(*cell, float(rate.max())) for cell in zip(M, K, strict=True)]
    if len(structure.outer):
        M, K = (abs(part).max(axis=1).toarray().ravel() for part in structure.parts["oo"])
        rates.append(K[M > 0.0] / M[M > 0.0])
    all_poles = np.concatenate([*poles, np.zeros(0)]).astype(np.complex128)
    return np.concatenate([*rates, np.zeros(0)]), all_poles


def _finite_poles(M: Floats, K: Floats, fastest: float) -> Complexes:
    """Return the finite s with ``det(s M - K) = 0``, 1/s, slow ones as accurately as fast ones.

    The QZ method needs no inverse; a shift to the fastest rate would round the slow poles to
    ``eps fastest``, and even their sign where a cell is nearly defective.
    """
    from scipy.linalg import eig

    rows = np.abs(K).max(axis=1, keepdims=True)
    alpha, beta = eig(K / rows, fastest * M / rows, right=False, homogeneous_eigvals=True)
    finite = np.abs(beta) > INFINITE * np.abs(alpha)
    return np.asarray(fastest * alpha[finite] / beta[finite], dtype=np.complex128)
