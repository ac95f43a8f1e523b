"""Eigenvalues and eigenvectors at high precision, and responses as sums of modes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse.csgraph
from flint import acb, acb_mat, arb, arb_mat, ctx

from tests.support.deck_equations import StateEquations

REFINEMENTS = 12
SMALL = 12  # states: the QR method at high precision costs no more than the corrections
CLUSTER = 1e-2  # coupling over distance: from here two eigenvalues are separated together


@dataclass(frozen=True, eq=False)
class Modes:
    """Outputs ``u(t) = final + sum_k share_k exp(pole_k t)``; every list is over the outputs."""

    poles: tuple[acb, ...]  # of the whole board
    final: tuple[arb, ...]  # V
    terms: tuple[tuple[tuple[acb, acb], ...], ...]  # pairs of pole and share, V

    def at(self, channel: int, t: arb, order: int = 0) -> arb:
        """Return one output, or a derivative of it, at one instant."""
        value = acb(0) if order else acb(self.final[channel])
        for pole, share in self.terms[channel]:
            value += share * pole**order * (pole * t).exp()
        return value.real


def exact_modes(parts: list[StateEquations], outputs: int) -> Modes:
    """Return the response of a linear board to the strain step from the discharged state."""
    poles: list[acb] = []
    final = [arb(0)] * outputs
    terms: list[tuple[tuple[acb, acb], ...]] = [()] * outputs
    on = arb_mat(2, 1, [1, 1])
    for part in parts:
        assert not part.sources, "the board is not linear"
        n = part.A.nrows()
        ends = part.D * on
        if n:
            rest = part.A.solve(-(part.B * on))
            ends += part.C * rest
            values, V = eigen(part.A)
            start, C = V.solve(acb_mat(-rest)), acb_mat(part.C) * V
            poles += values
        for row, k in enumerate(part.outputs):
            final[k] = ends[row, 0]
            if n:
                shares = (C[row, j] * start[j, 0] for j in range(n))
                terms[k] = tuple(
                    (p, c) for p, c in zip(values, shares, strict=True) if not c.contains(0)
                )
    return Modes(tuple(poles), tuple(final), tuple(terms))


def eigen(A: arb_mat) -> tuple[list[acb], acb_mat]:
    """Return eigenvalues and eigenvectors of A (n, n) to a third of Arb's digits or better.

    A basis V is corrected until ``V^-1 A V`` is diagonal. The first basis is that of double
    precision, and where this does not converge (bad scaling) that of the QR method in Arb.
    """
    exact = acb_mat(A)
    for first in (_double_basis, _qr_basis)[A.nrows() <= SMALL :]:
        found = _refine(exact, first(A))
        if found is not None:
            return found
    raise AssertionError("no eigenbasis: the matrix is nearly defective")


def _qr_basis(A: arb_mat) -> acb_mat:
    return acb_mat(A.mid()).eig(right=True, algorithm="approx")[1]


def _double_basis(A: arb_mat) -> acb_mat:
    """Return eigenvectors of the balanced matrix in double precision."""
    n = A.nrows()
    values = np.array([[float(x) for x in row] for row in A.tolist()])
    balanced, scale = scipy.linalg.matrix_balance(values, permute=False)
    _, V = np.linalg.eig(balanced)
    V = scale @ V
    return acb_mat(n, n, (V / np.abs(V).max(axis=0)).ravel().tolist())


def _refine(A: acb_mat, V: acb_mat) -> tuple[list[acb], acb_mat] | None:
    """Correct the basis V until ``V^-1 A V`` is diagonal; None if it does not become so."""
    n = A.nrows()
    target = 2.0 ** (-ctx.prec // 3)
    for _ in range(REFINEMENTS):
        V = V.mid()
        try:
            image = V.solve(A * V)
        except ZeroDivisionError:
            return None
        size = np.array([[_size(x) for x in row] for row in image.tolist()])
        values = [image[i, i] for i in range(n)]
        gap = np.array([[_size(a - b) for b in values] for a in values])
        magnitude = np.diag(size).copy()
        np.fill_diagonal(size, 0.0)
        least = np.minimum(magnitude[:, None], magnitude)
        if np.all(size <= target * np.maximum(gap, least)):
            return values, V
        V = V * _correction(image, size > CLUSTER * gap)
    return None


def _size(x: acb) -> float:
    return float(abs(x.mid()))


def _correction(image: acb_mat, close: np.ndarray) -> acb_mat:
    """Return the factor that makes `image` more diagonal; `close` pairs are rotated together."""
    n = image.nrows()
    factor = acb_mat(n, n, [int(i == j) for i in range(n) for j in range(n)])
    labels = scipy.sparse.csgraph.connected_components(close)[1]
    for i in range(n):
        for j in range(n):
            if labels[i] != labels[j]:
                factor[i, j] = image[i, j] / (image[j, j] - image[i, i])
    factor = factor.mid()
    for label in np.unique(labels):
        group = np.flatnonzero(labels == label).tolist()
        if len(group) > 1:
            block = acb_mat([[image[i, j] for j in group] for i in group]).mid()
            rotation = block.eig(right=True, algorithm="approx")[1]
            columns = acb_mat([[factor[i, j] for j in group] for i in range(n)]) * rotation
            for i in range(n):
                for k, j in enumerate(group):
                    factor[i, j] = columns[i, k]
    return factor
