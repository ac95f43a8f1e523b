"""Find the rightmost poles of a large board, without a factorisation of all unknowns.

Arnoldi's method on ``(sigma M - K)^-1 M`` finds the poles nearest to a shift; one iteration costs
one structured solve (see `structured_solve`). The poles of a coarse board (see `coarse_board`)
select the shifts. A shift at the origin finds the slowest poles, which a coarse board may lack.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from taction.system.array_types import Complexes
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.structured_solve import Structure
from taction.verification.engines.statespace.linearised.board import LinearBoard

NEAREST = 4  # number of poles requested at a shift
FIRST_OFFSET = 0.01  # of the first shift to the right of a coarse pole, over the pole's magnitude
NEXT_OFFSET = 0.002  # of the next shift, right of the pole found; closer shifts converge faster
ROUNDS = 4  # shifts at one coarse pole
PLACES = 3  # coarse poles used
ORIGIN = complex(0.0)
FAR_LEFT = 10.0  # a coarse pole more times further left than the rightmost pole is skipped
ROUGH, FINE = 1e-4, 1e-8  # tolerance over the distance, at the first and the following shifts
RESTARTS = 20


def rightmost_poles(board: LinearBoard) -> Complexes:
    """Find the rightmost poles of a board near a few shifts, 1/s, rightmost first; shape (k,).

    `count_right` proves that no pole is missing right of a line.

    Raises
    ------
    EngineError
        The board does not split into cells, or has no equilibrium.

    Notes
    -----
    Costs two to four structured factorisations a place, some 30 structured solves each, and one
    dense eigenproblem of the coarse board (some 180 states).
    """
    poles = np.zeros(0, dtype=np.complex128)
    coarse_poles = _merge(poles, board.coarse.state_space.modes.poles)
    for place in [*_distinct(coarse_poles)[:PLACES], ORIGIN]:
        if len(poles) and place.real < poles[0].real - FAR_LEFT * abs(poles[0].real):
            continue
        found = _poles_around(board.structure, place)
        if not len(found) and place != ORIGIN:  # no slow pole may be near the origin
            message = f"no pole near {place!r} converged in {RESTARTS} restarts of {NEAREST}"
            raise EngineError(message)
        poles = _merge(poles, found)
    return poles


def _poles_around(structure: Structure, place: complex) -> Complexes:
    """Find the poles around a place; repeat with new shifts until the rightmost pole converges.

    None where a cluster is too tight for any of its poles to converge.
    """
    lead = place
    poles = nearest_poles(structure, place + FIRST_OFFSET * abs(place), NEAREST, ROUGH)
    if not len(poles):
        return poles
    for _ in range(ROUNDS - 1):
        previous, lead = lead, complex(poles[0])
        if abs(lead - previous) <= 1e-8 * abs(lead):
            break
        finer = nearest_poles(structure, lead + NEXT_OFFSET * abs(lead), NEAREST, FINE)
        if not len(finer):  # a cluster so tight that any of its poles is accurate enough
            break
        poles = finer
    return poles


def nearest_poles(structure: Structure, shift: complex, count: int, tolerance: float) -> Complexes:
    """Find about `count` poles nearest to a shift (and their conjugates), rightmost first.

    `tolerance` is relative to the distance from the shift. In a tight cluster the iteration may
    find fewer poles, or none.
    """
    from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs

    size = structure.descriptor.size
    solve, mass = structure.factor(shift).solve, structure.mass
    # A real shift has a real operator; complex vectors cost three times as much.
    kind = np.float64 if complex(shift).imag == 0.0 else np.complex128

    def apply(x: Any) -> Any:
        return solve(np.ascontiguousarray((mass @ x.ravel()).astype(kind)))

    operator = LinearOperator((size, size), matvec=apply, dtype=kind)
    start = apply(np.random.default_rng(1).standard_normal(size))
    try:
        theta = eigs(
            operator,
            k=min(count, size - 2),
            ncv=min(size, 6 * count + 8),
            v0=start,
            tol=tolerance,
            maxiter=RESTARTS,
            return_eigenvectors=False,
        )
    except ArpackNoConvergence as error:
        theta = np.asarray(error.eigenvalues)
    poles = np.asarray(shift - 1.0 / theta, dtype=np.complex128)
    real = np.abs(poles.imag) < max(tolerance, 1e-9) * np.abs(poles)
    poles[real] = poles[real].real
    return _merge(np.zeros(0, dtype=np.complex128), np.concatenate([poles, poles.conj()]))


def _merge(first: Complexes, second: Complexes) -> Complexes:
    """Return the union of two sets of poles, without duplicates, rightmost first."""
    merged: list[complex] = []
    for pole in [*first.tolist(), *second.tolist()]:
        if all(abs(pole - other) > 1e-8 * abs(pole) for other in merged):
            merged.append(pole)
    values = np.array(merged, dtype=np.complex128)
    return values[np.lexsort((-values.imag, -values.real))]


def _distinct(poles: Complexes) -> list[complex]:
    """Return poles with Im >= 0, rightmost first, without those within 30 % of an earlier one."""
    kept: list[complex] = []
    for pole in poles[poles.imag >= 0.0].tolist():
        if all(abs(pole - other) > 0.3 * abs(pole) for other in kept):
            kept.append(pole)
    return kept
