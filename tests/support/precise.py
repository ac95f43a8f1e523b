"""A transient to more than 50 digits, from the descriptor equations: mpmath and whole numbers."""

from __future__ import annotations

from typing import Any

import mpmath as mp
import numpy as np

from taction.verification.engines.statespace.equations.descriptor import Descriptor

BITS = 240  # after the point
DIGITS = 70


def precise_step(descriptor: Descriptor, stop: float, count: int) -> tuple[list[float], Any]:
    """Exact response from the discharged state at ``stop / 2^j``, j = 0 .. count - 1.

    Returns
    -------
    list of float, and ndarray (count, n) of mpf
        Instants, s, and the voltages of the nodes with capacitance, in order of their places.
    """
    with mp.workdps(DIGITS):
        A, b = _eliminate(descriptor)
        n = A.rows
        norm = max(sum(abs(A[i, j]) for j in range(n)) for i in range(n))
        squarings = max(int(mp.ceil(mp.log(norm * stop, 2))), 0) + 4
        h = mp.mpf(stop) / 2**squarings
        small = np.zeros((n + 1, n + 1), dtype=object)
        for i in range(n):
            small[i, :n] = [_fixed(A[i, j] * h) for j in range(n)]
            small[i, n] = _fixed(b[i] * h)
        power = np.array(np.eye(n + 1, dtype=int), dtype=object) << BITS
        term = power
        for k in range(1, 40):
            term = (term.dot(small) >> BITS) // k
            power = power + term
        found = []
        for _ in range(squarings):
            power = power.dot(power) >> BITS
            found.append([mp.ldexp(mp.mpf(int(v)), -BITS) for v in power[:n, n]])
        times = [stop / 2.0**j for j in range(count)]
        return times, np.array(found[::-1][:count], dtype=object)


def _fixed(value: Any) -> int:
    return int(mp.nint(mp.ldexp(value, BITS)))


def _eliminate(descriptor: Descriptor) -> tuple[Any, Any]:
    """Return A and b of ``x' = A x + b``; for boards without ideal voltage sources."""
    assert not descriptor.determined.any()
    M, K = descriptor.dense.mass, descriptor.dense.stiffness
    drive = descriptor.drive(sources_on=True)[:, None]
    d, a = np.flatnonzero(M.any(axis=1)), np.flatnonzero(~M.any(axis=1))

    def part(X: Any, rows: Any, columns: Any) -> Any:
        return mp.matrix(X[np.ix_(rows, columns)].tolist())

    inner = mp.inverse(part(K, a, a))
    link = part(K, d, a) * inner
    mass = mp.inverse(part(M, d, d))
    A = mass * (part(K, d, d) - link * part(K, a, d))
    b = mass * (part(drive, d, [0]) - link * part(drive, a, [0]))
    return A, b
