"""A transient to more than 50 digits, from the descriptor equations, in Arb."""

from __future__ import annotations

import numpy as np
from flint import arb, arb_mat, ctx

from taction.system.array_types import Floats
from taction.verification.engines.statespace.equations.descriptor import Descriptor

BITS = 600


def precise_step(descriptor: Descriptor, stop: float, count: int) -> tuple[list[float], Floats]:
    """Exact response from the discharged state at ``stop / 2^j``, j = 0 .. count - 1.

    Returns
    -------
    list of float, and ndarray (count, n)
        Instants, s, and the voltages of the nodes with capacitance, in order of their places;
        rounded once, from intervals below 1e-50.
    """
    before, ctx.prec = ctx.prec, BITS
    try:
        A, b = _eliminate(descriptor)
        n, step = A.nrows(), arb(stop) / 2 ** (count - 1)
        rows = [[*(A[i, j] * step for j in range(n)), b[i, 0] * step] for i in range(n)]
        power = arb_mat([*rows, [arb(0)] * (n + 1)]).exp()
        found = []
        for _ in range(count):
            found.append([float(power[i, n]) for i in range(n)])
            assert max(float(power[i, n].rad()) for i in range(n)) < 1e-50
            power = power * power
    finally:
        ctx.prec = before
    return [stop / 2.0**j for j in range(count)], np.array(found[::-1])


def _eliminate(descriptor: Descriptor) -> tuple[arb_mat, arb_mat]:
    """Return A and b of ``x' = A x + b``; for boards without ideal voltage sources."""
    assert not descriptor.determined.any()
    M, K = descriptor.dense.mass, descriptor.dense.stiffness
    drive = descriptor.drive(sources_on=True)[:, None]
    d, a = np.flatnonzero(M.any(axis=1)), np.flatnonzero(~M.any(axis=1))

    def part(X: Floats, rows: np.ndarray, columns: np.ndarray) -> arb_mat:
        return arb_mat(X[np.ix_(rows, columns)].tolist())

    link = part(K, d, a) * part(K, a, a).inv()
    mass, only = part(M, d, d).inv(), np.array([0])
    A = mass * (part(K, d, d) - link * part(K, a, d))
    return A, mass * (part(drive, d, only) - link * part(drive, a, only))
