"""Transients of boards with behavioural sources to eleven digits: Radau collocation of degree 9.

SciPy's integrators measure a step by the rounding of the stiff states and crawl below a tolerance
of 1e-9. Here every step is one polynomial of high degree, found by Newton's method on all stages at
once, and its length follows from the decay of the polynomial's coefficients in what is read.
"""

from __future__ import annotations

import numpy as np
from flint import arb_mat
from numpy.polynomial import legendre

from tests.support.nonlinear_response import Board, Transient

STAGES = 9
TAIL = 1e-12  # of the amplitude: last coefficients of an accepted step
NEWTON = 14
LONGER, SHORTER = 1.5, 0.4
Floats = np.ndarray


def _nodes() -> Floats:
    """Return 0 and the Radau points of (0, 1], the last of which is 1."""
    ends = [*[0.0] * (STAGES - 1), -1.0, 1.0]  # P_s - P_(s-1)
    inner = np.sort(legendre.legroots(ends).real)
    inner[-1] = 1.0
    return np.concatenate([[0.0], 0.5 * (inner + 1.0)])


NODES = _nodes()
VALUES = legendre.legvander(2.0 * NODES - 1.0, STAGES)  # of Legendre's polynomials at the nodes
COEFFICIENTS = np.linalg.inv(VALUES)
SLOPES = 2.0 * np.array(
    [legendre.legval(2.0 * NODES - 1.0, legendre.legder(row)) for row in np.eye(STAGES + 1)]
).T @ COEFFICIENTS  # values at the nodes to slopes at the nodes


def integrate(board: Board, start: arb_mat, rest: arb_mat, stop: float) -> Transient:
    """Integrate from the state `start` with the strain on to `stop`, s."""
    A, B, C, D, scale = board.doubles
    k, m = board.outputs, len(board.equations.sources)
    z, last = ((np.array(x.tolist(), dtype=float)[:, 0] / scale) for x in (start, rest))
    read, constant, drive = C[k:], D[k:, :2].sum(axis=1), B[:, :2].sum(axis=1)
    n, size = len(z), np.maximum(np.maximum(np.abs(last), np.abs(z)), 1e-30)

    def sources(z: Floats) -> tuple[Floats, Floats]:
        duals = board.values(read @ z + constant)
        return tuple(np.array([float(getattr(d, f)) for d in duals]) for f in ("value", "slope"))

    def watch(z: Floats) -> Floats:
        return C[:k] @ z + D[:k] @ np.array([1.0, 1.0, *sources(z)[0]])

    def solve(z: Floats, h: float, guess: Floats) -> Floats | None:
        Z, before = guess, np.inf
        for _ in range(NEWTON):
            every = np.vstack([z, Z])
            matrix = np.kron(SLOPES[1:, 1:], np.eye(n))
            F = (SLOPES @ every)[1:]
            for i, row in enumerate(Z):
                value, slope = sources(row)
                F[i] -= h * (A @ row + B[:, 2:] @ value + drive)
                place = slice(i * n, (i + 1) * n)
                matrix[place, place] -= h * (A + (B[:, 2:] * slope) @ read)
            step = np.linalg.solve(matrix, F.ravel()).reshape(Z.shape)
            Z = Z - step
            moved = float(np.abs(step / size).max())
            if not np.isfinite(moved) or moved > 1e6:
                return None
            if moved < 1e-13 or (moved < 1e-9 and moved > 0.3 * before):
                return Z
            before = moved
        return None

    outputs = np.array([watch(z), watch(last)])
    amplitude = max(float(np.abs(outputs[1] - outputs[0]).max()), 1e-9 * np.abs(outputs).max())
    h, t = 1e-3 / max(float(np.abs(A).max()), 1.0 / stop), 0.0
    ends, pieces, guess = [0.0], [], np.tile(z, (STAGES, 1))
    while t < stop:
        if len(ends)%20==0: print(len(ends),t/stop,h, flush=True)
        Z = solve(z, h, guess)
        seen = None if Z is None else COEFFICIENTS @ np.array([watch(x) for x in (z, *Z)])
        tail = np.inf if seen is None else float(np.abs(seen[-2:]).max()) / amplitude
        if Z is None or tail > TAIL:
            h *= SHORTER
            guess = np.tile(z, (STAGES, 1))
            assert h > 1e-16 * stop, "no step is short enough"
            continue
        pieces.append(seen)
        t += h
        ends.append(t)
        coefficients = COEFFICIENTS @ np.vstack([z, Z])
        longer = h * (LONGER if tail < 0.05 * TAIL else 1.0)
        z = Z[-1]
        theta = 1.0 + NODES[1:] * longer / h
        guess = legendre.legval(2.0 * np.minimum(theta, 1.3) - 1.0, coefficients).T
        h = longer
    steps, stack = np.array(ends), np.array(pieces)

    def at(times: Floats) -> Floats:
        place = np.clip(np.searchsorted(steps, times) - 1, 0, len(pieces) - 1)
        theta = (times - steps[place]) / (steps[place + 1] - steps[place])
        basis = legendre.legvander(2.0 * theta - 1.0, STAGES)
        return np.einsum("ps,psk->pk", basis, stack[place])

    assert m > 0
    return Transient(steps, at)
