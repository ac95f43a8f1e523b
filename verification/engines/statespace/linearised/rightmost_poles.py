"""Rightmost poles of a large board, without factorising all of it at once.

Arnoldi's method on ``(sigma M - K)^-1 M`` finds the poles nearest to a shift; one iteration costs
one structured solve (see `structured_solve`). A coarse board (see `coarse_board`) tells where to
look.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from spice_models.array_types import Complexes
from spice_models.errors import EngineError
from verification.engines.statespace.equations.structured_solve import Structure
from verification.engines.statespace.linearised.board import LinearBoard

NEAREST = 4  # poles wanted at a shift
ASIDE = 0.01  # how far right of a coarse pole the first shift is, of the pole's magnitude
CLOSE = 0.002  # and of a pole that was found, the next one: the closer, the faster
ROUNDS = 4  # shifts at one place
PLACES = 3  # places to look at
AFAR = 10.0  # a place so many times further left than what was found is not looked at
ROUGH, FINE = 1e-4, 1e-8  # of the distance to the first and to the following shifts
RESTARTS = 20


def rightmost_poles(board: LinearBoard) -> Complexes:
    """Find the rightmost poles of a board.

    Returns
    -------
    ndarray (k,)
        Poles, 1/s, rightmost first; those near the shifts only. `count_right` proves
        that none is missing right of a line.

    Raises
    ------
    EngineError
        The board's summing nodes cannot be cut out, or it has no equilibrium.

    Notes
    -----
    Costs two to four structured factorisations a place, some 30 structured solves each, and one
    dense eigenproblem of the coarse board (some 180 states).
    """
    found = np.zeros(0, dtype=np.complex128)
    guide = _merge(found, board.coarse.state_space.modes.poles)
    for place in _distinct(guide)[:PLACES]:
        if len(found) and place.real < found[0].real - AFAR * abs(found[0].real):
            continue
        found = _merge(found, _climb(board.structure, place))
    return found


def _climb(structure: Structure, place: complex) -> Complexes:
    """Poles around a place, shifting until the rightmost one stays the same."""
    lead = place
    found = nearest_poles(structure, place + ASIDE * abs(place), NEAREST, ROUGH)
    if not len(found):
        message = f"no pole near {place!r} converged in {RESTARTS} restarts of {NEAREST}"
        raise EngineError(message)
    for _ in range(ROUNDS - 1):
        before, lead = lead, complex(found[0])
        if abs(lead - before) <= 1e-8 * abs(lead):
            break
        finer = nearest_poles(structure, lead + CLOSE * abs(lead), NEAREST, FINE)
        if not len(finer):  # a cluster so tight that any of its poles will do
            break
        found = finer
    return found


def nearest_poles(structure: Structure, shift: complex, count: int, tolerance: float) -> Complexes:
    """Find about `count` poles nearest to a shift (and their conjugates), rightmost first.

    `tolerance` is relative to the distance from the shift. In a tight cluster the iteration may
    end with fewer, even without any.
    """
    from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigs

    size = structure.descriptor.size
    solve, mass = structure.factor(shift).solve, structure.mass
    # A real shift has a real operator: complex vectors would cost three times as much.
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
    """Union of two sets of poles, equal ones once, rightmost first."""
    merged: list[complex] = []
    for pole in [*first.tolist(), *second.tolist()]:
        if all(abs(pole - other) > 1e-8 * abs(pole) for other in merged):
            merged.append(pole)
    values = np.array(merged, dtype=np.complex128)
    return values[np.lexsort((-values.imag, -values.real))]


def _distinct(poles: Complexes) -> list[complex]:
    """Upper poles, rightmost first, without those within 30 % of one before them."""
    kept: list[complex] = []
    for pole in poles[poles.imag >= 0.0].tolist():
        if all(abs(pole - other) > 0.3 * abs(pole) for other in kept):
            kept.append(pole)
    return kept
