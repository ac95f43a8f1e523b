"""From ``M z' = K z + b u`` to ``x' = A x + B u``: what carries no charge is eliminated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spice_models.array_types import Bools, Floats, Ints
from spice_models.errors import EngineError

SINGULAR = 1e13  # condition number of an equilibrated matrix above which it counts as singular


@dataclass(frozen=True, slots=True, eq=False)
class Reduced:
    """``x' = A x + B u``, ``z = C x + D u`` and ``x = charge z + offset``.

    Attributes
    ----------
    A, B, C, D : ndarray
        Of shapes (n, n), (n, inputs), (size, n) and (size, inputs).
    charge, offset : ndarray (n, size) and (n,)
        See `descriptor.StateSpace`.
    places : ndarray of int (n,), or None
        Which unknowns are the states; None where the states are combinations of them.
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    charge: Floats
    offset: Floats
    places: Ints | None


def reduce(M: Floats, K: Floats, b: Floats, determined: Bools, names: Sequence[str]) -> Reduced:
    """Eliminate voltages that ideal sources determine, then whatever carries no charge.

    Parameters
    ----------
    M, K : ndarray (size, size)
        Of the equations.
    b : ndarray (size, inputs)
        Of the strain currents, of what is on for all time, and of other inputs.
    determined : ndarray of bool (size,)
        Rows that state a voltage instead of a current balance.
    names : sequence of str
        Of the unknowns, for messages.

    Raises
    ------
    EngineError
        There is no such form (see `descriptor.linearise`).
    """
    f, o = np.flatnonzero(~determined), np.flatnonzero(determined)
    size, inputs = b.shape
    if o.size:
        sources, M, K, b, whole = _without_sources(M, K, b, f, o, names)
        names = [names[place] for place in f.tolist()]
    else:
        whole = np.concatenate([M, np.zeros((size, 1))], axis=1)
    d, a, basis, mass, K, b, whole = _separate(M, K, b, whole)
    n = len(d)
    columns = np.concatenate([d, np.arange(len(f), len(f) + inputs), a])
    rows = np.concatenate([d, a])
    K = np.concatenate([K, b], axis=1).take(rows, axis=0).take(columns, axis=1)
    # 0 = K_ad x + K_aa y + b_a
    loose = [names[k] for k in a] if basis is None else names
    passive = _Factor(K[n:, n + inputs :]).solve(
        K[n:, : n + inputs], loose, "nodes without capacitance stay undetermined"
    )
    rates = K[:n, : n + inputs] - K[:n, n + inputs :] @ passive
    charged = [names[k] for k in d] if basis is None else [f"charge{k + 1}" for k in range(n)]
    right = np.concatenate([rates, whole.take(d, axis=0)], axis=1)
    rates = mass.solve(right, charged, "the capacitances do not determine the states")
    inner = np.zeros((len(f), n + inputs))
    inner[d, np.arange(n)] = 1.0
    inner[a] = -passive
    outer = inner if basis is None else basis @ inner
    if o.size:
        inner, outer = outer, np.zeros((size, n + inputs))
        outer[f], outer[o] = inner, sources[:, : len(f)] @ inner
        outer[o, n:] += sources[:, len(f) :]
    return Reduced(
        A=np.ascontiguousarray(rates[:, :n]),
        B=rates[:, n : n + inputs],
        C=outer[:, :n],
        D=outer[:, n:],
        charge=rates[:, n + inputs : -1],
        offset=rates[:, -1],
        places=f[d] if basis is None else None,
    )


def _without_sources(
    M: Floats, K: Floats, b: Floats, f: Ints, o: Ints, names: Sequence[str]
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Eliminate the voltages z_o that ideal sources determine.

    Returns
    -------
    tuple
        ``[P, p]`` of ``z_o = P z_f + p u``; M, K and b of the others; and the charges of the
        others by all of z, and by 1.
    """
    listed = [names[place] for place in (*o, *f)]
    # 0 = K_oo z_o + K_of z_f + b_o
    right = np.hstack([K[np.ix_(o, f)], b[o]])
    what = "ideal sources form a loop without an answer"
    known = _Factor(-K[np.ix_(o, o)]).solve(right, listed, what)
    P, p = known[:, : len(f)], known[:, len(f) :]
    held = M[np.ix_(f, o)] @ p
    if np.any(held[:, 2:]):
        raise EngineError("a capacitor at the output of a behavioural amplifier: not supported")
    whole = np.hstack([M[f], -held[:, :2].sum(axis=1)[:, None]])
    b = b[f] + K[np.ix_(f, o)] @ p
    K = K[np.ix_(f, f)] + K[np.ix_(f, o)] @ P
    M = M[np.ix_(f, f)] + M[np.ix_(f, o)] @ P
    return known, M, K, b, whole


class _Factor:
    """``A X = B`` with scaled rows and one step of refinement; inverted once for all uses."""

    def __init__(self, A: Floats) -> None:
        filled = A != 0.0
        alone = filled.diagonal().copy()
        np.fill_diagonal(filled, False)
        alone &= ~(filled.any(axis=0) | filled.any(axis=1))
        self.tied = np.flatnonzero(~alone)
        self.diagonal = np.where(alone, A.diagonal(), 1.0)[:, None]
        scaled = A.take(self.tied, axis=0).take(self.tied, axis=1)
        scale = np.abs(scaled).max(axis=1, initial=0.0)
        scale[scale == 0.0] = 1.0
        self.scale = scale[:, None]
        self.scaled = scaled / self.scale
        try:
            self.inverse = np.linalg.inv(self.scaled)
        except np.linalg.LinAlgError:
            self.inverse = np.full_like(self.scaled, np.inf)
        self.largest = float(np.abs(self.inverse).max(initial=0.0))

    @property
    def condition(self) -> float:
        """Condition number in the largest-row-sum norm after the scaling; inf if singular."""
        norms = [np.abs(X).sum(axis=1).max(initial=1.0) for X in (self.scaled, self.inverse)]
        return float(norms[0] * norms[1])

    def solve(self, B: Floats, names: Sequence[str], what: str) -> Floats:
        """Return X, or name the culprits."""
        if not self.largest < SINGULAR:
            listed = ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")
            message = f"{what}: {listed}"
            raise EngineError(message)
        X = B / self.diagonal
        if self.tied.size:
            right = B.take(self.tied, axis=0) / self.scale
            Y = self.inverse @ right
            X[self.tied] = Y + self.inverse @ (right - self.scaled @ Y)
        return X


Split = tuple[Ints, Ints, Floats | None, _Factor, Floats, Floats, Floats]


def _separate(M: Floats, K: Floats, b: Floats, whole: Floats) -> Split:
    """Find which unknowns carry charge.

    As a rule they are the nodes with a capacitor. Where capacitors float, or an ideal amplifier
    ties both ends of one together, they are combinations of nodes, found by a singular value
    decomposition of the equilibrated M.

    Returns
    -------
    tuple
        Places d of what does, places a of the rest, the basis if it had to turn, M of d ready to
        be solved, and K, b and `whole` in that basis.
    """
    filled = M != 0.0
    rows, columns = filled.any(axis=1), filled.any(axis=0)
    d, a = np.flatnonzero(rows), np.flatnonzero(~rows)
    if np.array_equal(rows, columns):
        mass = _Factor(M.take(d, axis=0).take(d, axis=1))
        if mass.condition < SINGULAR:
            return d, a, None, mass, K, b, whole
    weight, pull = np.abs(M).max(axis=1), np.abs(K).max(axis=1)
    rate = np.median(pull[rows] / weight[rows])
    scale = np.where(rows, weight, np.maximum(pull, 1e-300) / rate)[:, None]
    U, S, Vt = np.linalg.svd(M / scale)
    rank = int(np.sum(S[0] / SINGULAR < S))
    places = np.arange(len(S))
    turned = U.T @ (K / scale) @ Vt.T
    d, a = places[:rank], places[rank:]
    mass = _Factor(np.diag(S[:rank]))
    return d, a, Vt.T, mass, turned, U.T @ (b / scale), U.T @ (whole / scale)
