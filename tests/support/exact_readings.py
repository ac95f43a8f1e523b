"""Modes and readings of linear boards in Arb: every crossing and supremum by interval bounds."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
import scipy.sparse.csgraph
from flint import acb, acb_mat, arb, arb_mat, ctx

from tests.support.deck_equations import StateEquations

REFINEMENTS = 12
SMALL = 12  # states: the QR method at high precision costs no more than the corrections
CLUSTER = 1e-2  # coupling over distance: from here two eigenvalues are separated together
PIECES = 4
NARROW = 1e-3  # of the time constant of the fastest mode that is alive: the last width
ALIVE = 1e-6  # of the envelope
ROUNDING = 1e-14  # of the sum of all amplitudes: error of double precision
SOON = 1e-18  # s: no mode moves in this time
TOLERANCE = 1e-14  # of the step amplitude: of a supremum
MOST = 2_000_000  # intervals at once


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


class UnreadableError(Exception):
    """A reading takes more than `MOST` intervals: the board rings for too many periods."""


@dataclass(frozen=True, eq=False)
class Signal:
    """The error of one channel, ``e(t) = u(t) - target``, V."""

    modes: Modes
    channel: int
    target: arb
    scale: arb  # the step amplitude, V

    @cached_property
    def offset(self) -> float:
        """The error at the end of time."""
        return float(self.end)

    @cached_property
    def poles(self) -> np.ndarray:
        return np.array([complex(p) for p, _ in self.modes.terms[self.channel]], dtype=complex)

    @cached_property
    def shares(self) -> np.ndarray:
        return np.array([complex(c) for _, c in self.modes.terms[self.channel]], dtype=complex)

    @property
    def end(self) -> arb:
        return self.modes.final[self.channel] - self.target

    def error(self, t: arb) -> arb:
        return self.modes.at(self.channel, t) - self.target

    def slope(self, t: arb, order: int) -> arb:
        return self.modes.at(self.channel, t, order)

    def highest(self, sign: int) -> arb:
        """Return the supremum of ``sign * e`` for t >= 0, too small by `TOLERANCE` at most."""
        return _highest(self, sign)

    def last_outside(self, level: arb) -> arb | None:
        """Return the last instant with ``|e| > level``: 0 if it never is, None if it stays so."""
        if bool(abs(self.end) > level):
            return None
        stop = self.quiet_after(float(level - abs(self.end)))
        found = [_edge(self, sign, level, stop, last=True) for sign in (1, -1)]
        return max((t for t in found if t is not None), key=float, default=arb(0))

    def first_above(self, sign: int, level: arb) -> arb | None:
        """Return the first instant with ``sign * e > level``, or None."""
        if bool(sign * self.error(arb(0)) > level):
            return arb(0)
        stop = self.quiet_after(TOLERANCE * float(self.scale))
        return _edge(self, sign, level, stop, last=False)

    def envelope(self, t: float) -> float:
        """Return a bound on ``|e - offset|`` from t on."""
        return float(np.abs(self.shares) @ np.exp(self.poles.real * t))

    def quiet_after(self, level: float) -> float:
        """Return an instant after which ``|e - offset|`` stays below `level` > 0."""
        assert self.poles.real.max(initial=-1.0) < 0
        low, high = 0.0, SOON
        while self.envelope(high) > level:
            low, high = high, 2 * high
        while low and high - low > 1e-3 * high:
            middle = (low + high) / 2
            low, high = (middle, high) if self.envelope(middle) > level else (low, middle)
        return high

    def intervals(self, stop: float) -> tuple[np.ndarray, np.ndarray]:
        """Return intervals from 0 to `stop` whose widths grow with the time."""
        first = min(1.0 / float(np.abs(self.poles).max(initial=1.0 / stop)), stop)
        edges = np.geomspace(first, stop, 2 + int(4 * np.log2(stop / first)))
        edges = np.concatenate([[0.0], edges])
        return edges[:-1], edges[1:]

    def bounds(self, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return e in the middle of intervals (P,), the centre of its bound, and its half width.

        The half width holds the rounding of double precision, of the phases, too.
        """
        p, c = self.poles, self.shares
        middle, half = ((a + b) / 2)[:, None], ((b - a) / 2)[:, None]
        begin, at = np.abs(c) * np.exp(p.real * a[:, None]), c * np.exp(p * middle)
        slow = np.abs(p) * half < 1.0
        still = self.offset + np.where(slow, at.real, 0.0).sum(axis=1)
        slope = np.abs(np.where(slow, (p * at).real, 0.0).sum(axis=1)) * half[:, 0]
        bend = np.where(slow, (np.abs(p) * half) ** 2 * begin / 2, begin).sum(axis=1)
        scale = abs(self.offset) + np.abs(c).sum()
        phase = (np.abs(p) * b[:, None] * begin).sum(axis=1)
        doubt = ROUNDING * (scale + phase)
        return self.offset + at.real.sum(axis=1), still, slope + bend + doubt

    def shortest(self, t: np.ndarray) -> np.ndarray:
        """Return the widths of intervals at t (P,) in which no mode that counts moves."""
        left = np.abs(self.shares) * np.exp(self.poles.real * t[:, None])
        alive = left > ALIVE * left.sum(axis=1, keepdims=True)
        return NARROW / np.where(alive, np.abs(self.poles), 0.0).max(axis=1, initial=1e-300)


def _cut(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    if len(a) > MOST:
        raise UnreadableError
    edges = a[:, None] + (b - a)[:, None] * np.linspace(0.0, 1.0, PIECES + 1)
    return edges[:, :-1].ravel(), edges[:, 1:].ravel()


def _highest(signal: Signal, sign: int) -> arb:
    start, end = sign * signal.error(arb(0)), sign * signal.end
    tolerance = TOLERANCE * float(signal.scale)
    best, place = max((float(start), 0.0), (float(end), np.inf))
    a, b = signal.intervals(signal.quiet_after(tolerance / 4))
    while len(a):
        value, centre, width = signal.bounds(a, b)
        top = int(np.argmax(sign * value))
        if sign * value[top] > best:
            best, place = float(sign * value[top]), float((a[top] + b[top]) / 2)
        unclear = (sign * centre + width > best + tolerance) & (b - a > signal.shortest(a))
        a, b = _cut(a[unclear], b[unclear])
    if place in (0.0, np.inf):
        return start if place == 0.0 else end
    return sign * signal.error(_newton(signal, arb(place), arb(0), 1))


def _edge(signal: Signal, sign: int, level: arb, stop: float, *, last: bool) -> arb | None:
    """Return the last, or the first, instant of ``sign * e > level``; None if there is none."""
    limit, above = float(level), -np.inf if last else np.inf
    narrow: list[tuple[float, float]] = []
    a, b = signal.intervals(stop)
    while len(a):
        value, centre, width = signal.bounds(a, b)
        out = ((a + b) / 2)[sign * value > limit]
        if out.size:
            above = max(above, out.max()) if last else min(above, out.min())
        unclear = sign * centre + width > limit
        unclear &= (b > above) if last else (a < above)
        short = b - a <= signal.shortest(a)
        narrow += zip(a[unclear & short].tolist(), b[unclear & short].tolist(), strict=True)
        a, b = _cut(a[unclear & ~short], b[unclear & ~short])
    narrow.sort(reverse=last)
    for begin, end in narrow:
        inside, outside = (arb(end), arb(begin)) if last else (arb(begin), arb(end))
        points = [outside, (inside + outside) / 2]
        top = _newton(signal, points[1], arb(0), 1)
        points += [top] if begin < float(top) < end else []
        points = [t for t in points if bool(sign * signal.error(t) > level)]
        if points:
            outside = max(points, key=float) if last else min(points, key=float)
            return _crossing(signal, inside, outside, sign, level)
    return None


def _crossing(signal: Signal, inside: arb, outside: arb, sign: int, level: arb) -> arb:
    """Return where ``sign * e`` crosses `level` between two instants."""
    for _ in range(20):
        middle = ((inside + outside) / 2).mid()
        if bool(sign * signal.error(middle) > level):
            outside = middle
        else:
            inside = middle
    return _newton(signal, inside, sign * level, 0)


def _newton(signal: Signal, t: arb, level: arb, order: int) -> arb:
    """Solve ``e = level`` (order 0) or ``e' = 0`` (order 1) from a near instant t."""
    for _ in range(8):
        value = signal.error(t) - level if order == 0 else signal.slope(t, 1)
        slope = signal.slope(t, order + 1)
        if slope.contains(0):
            break
        step = (value / slope).mid()
        t = (t - step).mid()
        if abs(step) < arb(2) ** (-ctx.prec // 3) * abs(t):
            break
    return t
