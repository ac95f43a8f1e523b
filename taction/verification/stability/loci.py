"""All values of some equal parts at which a board has a pole on the imaginary axis.

Let the parts (capacitors, or conductances) have the share c of their values. Then
``det(s M - K)`` is that of the given board times ``det(1 + (c - 1) W(s))``, where W is the parts'
admittance times the impedance at their terminals (`PortResponse`). So one board tells the poles
on the imaginary axis of the boards at all c: at the frequency omega, the shares are
``c = 1 - 1/w`` for the eigenvalues w of ``W(j omega)``. As omega runs, the shares follow the
characteristic loci of Nyquist's criterion (MacFarlane and Postlethwaite 1977), whose windings
around a real share count the unstable poles of its board. Between two crossings of the real axis
the count is the same: c is not sampled, so no interval is too narrow to be found.

The loci are smooth over the distance to the board's nearest pole, which sets the first steps of
omega. A step is halved until each locus avoids the interval of c by more than its own bend, or
crosses the real axis once, nearly straight.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from taction.system.array_types import Bools, Complexes, Floats, Ints
from taction.system.errors import EngineError
from taction.verification.stability.edges import Edges
from taction.verification.stability.port_response import PortResponse

SPACING = 0.5  # of the first frequencies: times the distance to the nearest pole
TINY = 1e-9  # relative distance of a pole from the axis below which steps get no shorter
BOTTOM, TOP = 1e-2, 10.0  # of the frequencies: times the slowest and the fastest pole
SMALLEST = 1e-12  # of w and of a share: a smaller one has a share far from the interval
NEAR = 1e-10  # height of a locus, relative to the share: below it rounding may count
FLAT = 1e-14  # largest bend of the step in which a locus turns back near the axis
CLUSTER = 1e-2  # relative width of a cluster of shares where a locus comes near
ONCE = 0.25  # of the change of its height: largest bend of a locus that crosses once
NARROW = 1e-12  # relative width of the narrowest step of omega
FAR = 1e8  # times the highest frequency: where only what has no charge counts
LARGEST = 5000  # frequencies; with more, the loci still undecided count as near
STRAIGHT = 1e-7  # largest error of a crossing's share without the bend of the locus
ITERATIONS = 5  # for the crossing of a parabola so flat

Crossing = tuple[float, float, int]
"""Share, frequency (Hz), and change of the unstable count as the share grows."""


@dataclass(frozen=True, slots=True, eq=False)
class LociSearch:
    """A search for every share from `low` (above 0) to `high` with a pole on the imaginary axis.

    The board of `ports` itself, with the share 1, has none, and `unstable` poles right of it; its
    linearisation does not depend on the shares.
    """

    ports: PortResponse
    low: float
    high: float = 1.0
    unstable: int = 0


def trace_together(searches: Sequence[LociSearch]) -> list[Edges | EngineError]:
    """Find every share at which a board has a pole on the axis, or tell why there are none.

    At the shares `Edges.near` a locus comes close to the axis without crossing: their poles must
    tell. There are none without an equilibrium or a state-space form, or if a pole of the board is
    on the axis.

    Boards with equally many loci are followed together: an operation on an array in the place of
    one for each board.

    Notes
    -----
    Costs one dense eigenproblem, of the size of the number of parts, at some 100 frequencies (seven
    channels: 5 ms); for a large board, one structured factorisation at each of them.
    """
    found: dict[int, Edges | EngineError] = {}
    grids: dict[tuple[int, ...], dict[int, Floats]] = {}
    for place, one in enumerate(searches):
        try:
            omega = _frequencies(one.ports.poles.tobytes(), one.low, one.high)
            grids.setdefault(one.ports.sizes, {})[place] = omega
        except EngineError as error:
            found[place] = error
    for group in grids.values():
        trace = _Trace([searches[place] for place in group])
        trace.run(list(group.values()))
        found |= zip(group, trace.results(), strict=True)
    return [found[place] for place in range(len(searches))]


@lru_cache(maxsize=4)
def _frequencies(content: bytes, low: float, high: float) -> Floats:
    """Return angular frequencies whose distances follow that to the nearest pole, 1/s.

    The poles of the boards at other shares are at most so much slower or faster as the shares. All
    parts of a board have the same `content`: its poles.
    """
    poles = np.frombuffer(content, dtype=np.complex128)
    upper = np.unique(poles[poles.imag >= 0.0])
    size = np.abs(upper)
    omega = [BOTTOM * float(max(size.min(), TINY * size.max())) / max(high, 1.0)]
    while omega[-1] < TOP * float(size.max()) / min(low, 1.0):
        nearest = float(np.abs(1j * omega[-1] - upper).min())
        omega.append(omega[-1] + SPACING * max(nearest, TINY * omega[-1]))
    return np.array(omega)


class _Trace:
    """The loci of boards over angular frequency: logarithms of the shares, so widths are relative.

    A board whose response has no value is in `failed`; its loci are then all alike.
    """

    def __init__(self, searches: Sequence[LociSearch]) -> None:
        self.searches = searches
        self.sizes = searches[0].ports.sizes
        self.low = np.array([math.log(one.low) for one in searches])  # ends of the intervals
        self.high = np.array([math.log(one.high) for one in searches])
        self.crossings: list[list[Crossing]] = [[] for _ in searches]
        self.near: list[list[complex]] = [[] for _ in searches]  # logarithms of shares
        self.failed: dict[int, EngineError] = {}

    def results(self) -> list[Edges | EngineError]:
        """Return the edges of each board."""
        return [
            self.failed.get(k)
            or Edges.counted(
                (one.low, one.high),
                self.crossings[k],
                self.nearest(k),
                (1.0, one.unstable),
                STRAIGHT,
            )
            for k, one in enumerate(self.searches)
        ]

    def loci(self, omega: Floats, board: Ints) -> Complexes:
        """Return the logarithms of the shares at frequencies (P,) of boards (P,), shape (P, K)."""
        responses = [np.zeros((len(omega), n, n), np.complex128) for n in self.sizes]
        for k, some in _each(board):
            try:
                found = self.searches[k].ports.at(omega[some])
                for W, own in zip(responses, found, strict=True):
                    W[some] = own
            except EngineError as error:
                self.failed[k] = error
        w = np.concatenate([np.linalg.eigvals(W) for W in responses], axis=1)
        shares = 1.0 - 1.0 / np.where(np.abs(w) < SMALLEST, SMALLEST, w)
        return np.log(np.where(np.abs(shares) < SMALLEST, SMALLEST, shares))

    def run(self, grids: Sequence[Floats]) -> None:
        """Follow all loci of each board from the lowest to the highest of its frequencies."""
        omega, taken = np.concatenate(grids), np.array([len(grid) for grid in grids])
        board = np.repeat(np.arange(len(grids)), taken)
        z = self.loci(omega, board)
        for k, some in _each(board):
            if k not in self.failed and not self.searches[k].ports.reactive:
                self._real_poles(k, 0.0, z[some[0]], 1)
                self._real_poles(k, FAR * float(omega[some[-1]]), z[some[-1]], -1)
        inside = np.flatnonzero(board[:-1] == board[1:])
        a, b, za, board = omega[inside], omega[inside + 1], z[inside], board[inside]
        zb = _follow(za, z[inside + 1])
        chord = np.abs(zb - za)
        kept = ~self._avoids(np.stack([za, zb]), chord, chord, board).all(axis=1)
        steps = a[kept], b[kept], za[kept], zb[kept], board[kept]
        while len(steps[0]):
            a, b, za, zb, board = steps
            m = 0.5 * (a + b)
            taken += np.bincount(board, minlength=len(taken))
            zm = self.loci(m, board)
            z = np.stack([_follow(zm, za), zm, _follow(zm, zb)])
            states = self._judge(z, board)
            again = states[2].any(axis=1)
            again &= (b - a > NARROW * b) & (taken <= LARGEST)[board]
            again &= ~np.isin(board, list(self.failed))
            self._end(a[~again], b[~again], z[:, ~again], board[~again], states[:, ~again])
            halves = ((a, m), (m, b), (z[0], zm), (zm, z[2]), (board, board))
            a, b, za, zb, board = (np.concatenate([x[again], y[again]]) for x, y in halves)
            steps = a, b, za, zb, board

    def _judge(self, z: Complexes, board: Ints) -> Bools:
        """Judge the loci at the ends and in the middle of steps (P,) of boards, (3, P, K).

        Returns which come near the real axis without crossing, which cross it once as far as is
        known, and which need shorter steps, (3, P, K); all others avoid the interval.
        """
        bend = z[0] - 2.0 * z[1] + z[2]
        height = np.maximum(np.abs(bend.imag), NEAR)
        avoids = self._avoids(z, np.abs(bend.real), height, board)
        height, one_side = np.abs(bend.imag), _one_side(z)
        first, last = (4.0 * z[1] - 3.0 * z[0] - z[2]).imag, (3.0 * z[2] + z[0] - 4.0 * z[1]).imag
        turns = first * last <= 0.0  # the slopes at the ends
        near = ~avoids & one_side & (height < np.where(turns, FLAT, NEAR))
        change = np.abs(z[2].imag - z[0].imag)
        crosses = ~avoids & ~one_side & (height < ONCE * change)
        off = height * np.abs(z[2] - z[0])
        straight = crosses & ((off <= STRAIGHT * change) | (height <= FLAT))
        return np.stack([near, crosses, ~(avoids | near | straight)])

    def _avoids(self, z: Complexes, width: Floats, height: Floats, board: Ints) -> Bools:
        """Tell which loci, (J, P, K) at points of steps, avoid the interval by their bends."""
        above = z.real.min(axis=0) > self.high[board, None] + width
        below = z.real.max(axis=0) < self.low[board, None] - width
        away = _one_side(z) & (np.abs(z.imag).min(axis=0) > height)
        return np.asarray(above | below | away)

    def nearest(self, k: int) -> tuple[float, ...]:
        """Return the shares where loci of a board come near the axis, the nearest of a cluster."""
        kept: list[complex] = []
        for z in sorted(self.near[k], key=lambda z: abs(z.imag)):
            if all(abs(z.real - other.real) > CLUSTER for other in kept):
                kept.append(z)
        low, high = float(self.low[k]), float(self.high[k])
        inside = [min(max(z.real, low), high) for z in kept]
        return tuple(sorted(map(math.exp, inside), reverse=True))

    def _end(self, a: Floats, b: Floats, z: Complexes, board: Ints, states: Bools) -> None:
        """Keep where loci cross the real axis, or come near, in steps that are not halved."""
        near, crosses, undecided = states
        for k, some in _each(board):
            close = (near | (undecided & ~crosses))[some]
            self.near[k] += z[:, some][:, close].ravel().tolist()
        step, locus = np.nonzero(crosses)
        first, middle, last = z[:, step, locus]
        rise, bend, t = last - first, first - 2.0 * middle + last, np.full(len(step), 0.5)
        for _ in range(ITERATIONS):
            t = (2.0 * t * (1.0 - t) * bend.imag - first.imag) / rise.imag
        shares = np.exp((first + t * rise - 2.0 * t * (1.0 - t) * bend).real)
        frequencies = (a[step] + t * (b - a)[step]) / math.tau
        changes = np.where(rise.imag > 0.0, 2, -2)
        found = (board[step], shares, frequencies, changes)
        for k, *crossing in zip(*(each.tolist() for each in found), strict=True):
            self._keep(k, *crossing)

    def _real_poles(self, k: int, omega: float, beside: Complexes, sign: int) -> None:
        """Find the shares at which a real pole is at zero, or passes through infinity.

        `omega` is zero, or far above all poles; `beside` are the loci at the nearest frequency, and
        `sign` is the change of the unstable count where these are above the axis.
        """
        try:
            found = self.searches[k].ports.at(np.full(1, omega))
            w = np.concatenate([np.linalg.eigvals(W[0].real) for W in found])
        except EngineError as error:
            self.failed[k] = error
            return
        real = (w.imag == 0.0) & ((w.real > 1.0) | (w.real < -SMALLEST))
        for share in (1.0 - 1.0 / w[real].real).tolist():
            nearest = beside[np.argmin(np.abs(beside - math.log(share)))]
            self._keep(k, share, 0.0, -sign if nearest.imag < 0.0 else sign)

    def _keep(self, k: int, share: float, frequency: float, change: int) -> None:
        """Keep a crossing of a board that lies in the interval."""
        if self.low[k] <= math.log(share) <= self.high[k]:
            self.crossings[k].append((share, frequency, change))


def _each(board: Ints) -> Iterator[tuple[int, Ints]]:
    """Yield the boards of a list, and where each stands in it."""
    for k in np.unique(board).tolist():
        yield k, np.flatnonzero(board == k)


def _one_side(z: Complexes) -> Bools:
    """Tell which loci, (J, P, K), are on one side of the real axis at all points."""
    return np.asarray(np.abs(np.sign(z.imag).sum(axis=0)) == len(z))


def _follow(z: Complexes, others: Complexes) -> Complexes:
    """Sort the loci `others` (P, K) as `z`: the closest two belong together, and so on."""
    apart = others[:, None, :] - z[:, :, None]
    apart.imag -= 2.0 * math.pi * np.round(apart.imag / (2.0 * math.pi))
    nearest = _paired(np.abs(apart))
    return np.asarray(z + np.take_along_axis(apart, nearest[:, :, None], axis=2)[:, :, 0])


def _paired(distance: Floats) -> Ints:
    """Return the column of each row of matrices (P, K, K): the smallest element first, and so on.

    Elements that are the smallest of their row and of their column are taken all at once.
    """
    count, left = len(distance[0]), distance.copy()
    column = np.zeros((len(distance), count), dtype=np.int64)
    free = np.ones((len(distance), count), dtype=np.bool_)
    for _ in range(count):
        here, own = left.argmin(axis=2), left.argmin(axis=1)
        mutual = free & (np.take_along_axis(own, here, axis=1) == np.arange(count))
        step, row = np.nonzero(mutual)
        column[step, row] = here[step, row]
        left[step, row], left[step, :, column[step, row]] = np.inf, np.inf
        free &= ~mutual
        if not free.any():
            break
    return column
