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
from functools import lru_cache

import numpy as np

from taction.system.array_types import Bools, Complexes, Floats, Ints
from taction.verification.stability.edges import Edge, Edges
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


def traced_edges(
    ports: PortResponse,
    low: float,
    high: float = 1.0,
    unstable: int = 0,
    own: float = 1.0,
    power: float = 1.0,
) -> Edges:
    """Find every value from `low` (above 0) to `high` with a pole on the imaginary axis.

    The board of `ports` itself, with the value `own` and the share 1, has none, and `unstable`
    poles right of it; its linearisation does not depend on the shares, which are proportional to
    the `power` of the value. At the values `Edges.near` a locus comes close to the axis without
    crossing: their poles must tell.

    EngineError: no equilibrium or no state-space form, or a pole of the board is on the axis.
    """
    first, last = sorted((end / own) ** power for end in (low, high))
    trace = _Trace(ports, math.log(first), math.log(last))
    trace.run(_frequencies(ports.poles.tobytes(), first, last))
    back, sign = 1.0 / power, 1 if power > 0.0 else -1
    changes = sorted((own * share**back, f, sign * by) for share, f, by in trace.crossings)
    lowest = count = unstable - sum(by for value, _, by in changes if value < own)
    edges = list[Edge]()
    for value, frequency, by in changes:
        edges.append(Edge(value, frequency, count, count + by, STRAIGHT * abs(back) * value))
        count += by
    near = (own * share**back for share in trace.nearest())
    return Edges(low, high, tuple(edges), tuple(near), lowest)


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
    """The loci over angular frequency: logarithms of the shares, so widths are relative."""

    def __init__(self, ports: PortResponse, low: float, high: float) -> None:
        self.ports, self.low, self.high = ports, low, high  # ends of the interval
        self.crossings = list[Crossing]()
        self.near = list[complex]()  # logarithms of shares

    def loci(self, omega: Floats) -> Complexes:
        """Return the logarithms of the shares at frequencies (P,), shape (P, K)."""
        w = np.linalg.eigvals(self.ports.at(omega))
        shares = 1.0 - 1.0 / np.where(np.abs(w) < SMALLEST, SMALLEST, w)
        return np.log(np.where(np.abs(shares) < SMALLEST, SMALLEST, shares))

    def run(self, omega: Floats) -> None:
        """Follow all loci from the lowest to the highest of the frequencies."""
        z, taken = self.loci(omega), len(omega)
        if not self.ports.reactive:
            self._real_poles(0.0, z[0], 1)
            self._real_poles(FAR * float(omega[-1]), z[-1], -1)
        a, b, za, zb = omega[:-1], omega[1:], z[:-1], _follow(z[:-1], z[1:])
        chord = np.abs(zb - za)
        kept = ~self._avoids(np.stack([za, zb]), chord, chord).all(axis=1)
        a, b, za, zb = a[kept], b[kept], za[kept], zb[kept]
        while len(a):
            m = 0.5 * (a + b)
            taken += len(m)
            zm = self.loci(m)
            z = np.stack([_follow(zm, za), zm, _follow(zm, zb)])
            states = self._judge(z)
            again = states[2].any(axis=1) & (b - a > NARROW * b) & (taken <= LARGEST)
            self._end(a[~again], b[~again], z[:, ~again], states[:, ~again])
            halves = ((a, m), (m, b), (z[0], zm), (zm, z[2]))
            a, b, za, zb = (np.concatenate([x[again], y[again]]) for x, y in halves)

    def _judge(self, z: Complexes) -> Bools:
        """Judge the loci at the ends and in the middle of steps (P,), (3, P, K).

        Returns which come near the real axis without crossing, which cross it once as far as is
        known, and which need shorter steps, (3, P, K); all others avoid the interval.
        """
        bend = z[0] - 2.0 * z[1] + z[2]
        height = np.maximum(np.abs(bend.imag), NEAR)
        avoids = self._avoids(z, np.abs(bend.real), height)
        height, one_side = np.abs(bend.imag), _one_side(z)
        first, last = (4.0 * z[1] - 3.0 * z[0] - z[2]).imag, (3.0 * z[2] + z[0] - 4.0 * z[1]).imag
        turns = first * last <= 0.0  # the slopes at the ends
        near = ~avoids & one_side & (height < np.where(turns, FLAT, NEAR))
        change = np.abs(z[2].imag - z[0].imag)
        crosses = ~avoids & ~one_side & (height < ONCE * change)
        off = height * np.abs(z[2] - z[0])
        straight = crosses & ((off <= STRAIGHT * change) | (height <= FLAT))
        return np.stack([near, crosses, ~(avoids | near | straight)])

    def _avoids(self, z: Complexes, width: Floats, height: Floats) -> Bools:
        """Tell which loci, (J, P, K) at points of steps, avoid the interval by their bends."""
        above = z.real.min(axis=0) > self.high + width
        below = z.real.max(axis=0) < self.low - width
        away = _one_side(z) & (np.abs(z.imag).min(axis=0) > height)
        return np.asarray(above | below | away)

    def nearest(self) -> tuple[float, ...]:
        """Return the shares where loci come near the axis, the nearest of a cluster."""
        kept: list[complex] = []
        for z in sorted(self.near, key=lambda z: abs(z.imag)):
            if all(abs(z.real - other.real) > CLUSTER for other in kept):
                kept.append(z)
        inside = [min(max(z.real, self.low), self.high) for z in kept]
        return tuple(sorted(map(math.exp, inside), reverse=True))

    def _end(self, a: Floats, b: Floats, z: Complexes, states: Bools) -> None:
        """Keep where loci cross the real axis, or come near, in steps that are not halved."""
        near, crosses, undecided = states
        self.near += z[:, near | (undecided & ~crosses)].ravel().tolist()
        step, locus = np.nonzero(crosses)
        first, middle, last = z[:, step, locus]
        rise, bend, t = last - first, first - 2.0 * middle + last, np.full(len(step), 0.5)
        for _ in range(ITERATIONS):
            t = (2.0 * t * (1.0 - t) * bend.imag - first.imag) / rise.imag
        shares = np.exp((first + t * rise - 2.0 * t * (1.0 - t) * bend).real)
        frequencies = (a[step] + t * (b - a)[step]) / math.tau
        changes = np.where(rise.imag > 0.0, 2, -2)
        found = (shares.tolist(), frequencies.tolist(), changes.tolist())
        for crossing in zip(*found, strict=True):
            self._keep(*crossing)

    def _real_poles(self, omega: float, beside: Complexes, sign: int) -> None:
        """Find the shares at which a real pole is at zero, or passes through infinity.

        `omega` is zero, or far above all poles; `beside` are the loci at the nearest frequency, and
        `sign` is the change of the unstable count where these are above the axis.
        """
        w = np.linalg.eigvals(self.ports.at(np.full(1, omega))[0].real)
        real = (w.imag == 0.0) & ((w.real > 1.0) | (w.real < -SMALLEST))
        for share in (1.0 - 1.0 / w[real].real).tolist():
            nearest = beside[np.argmin(np.abs(beside - math.log(share)))]
            self._keep(share, 0.0, -sign if nearest.imag < 0.0 else sign)

    def _keep(self, share: float, frequency: float, change: int) -> None:
        """Keep a crossing that lies in the interval."""
        if self.low <= math.log(share) <= self.high:
            self.crossings.append((share, frequency, change))


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
