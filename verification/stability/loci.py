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
crosses the real axis once.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np

from taction.netlist_gen.board.circuit import GROUND, Capacitor, Resistor
from taction.system.array_types import Bools, Complexes, Floats, Ints
from taction.system.errors import EngineError
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.state_space import driven
from taction.verification.stability.edges import Edges

WELL_CONDITIONED = 1e-8  # largest defect of the modes that are used for the response
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
PRECISE, ITERATIONS = 1e-14, 60  # of the search of a crossing's frequency
ON_AXIS = 1e-3  # of the height of a step: largest height of a locus at its crossing

Crossing = tuple[
    float, float, int
]  # share, frequency (Hz), change of the unstable count as it grows


@dataclass(frozen=True, slots=True, eq=False)
class _States:
    """What K loci do over P steps, (P, K) each; all other loci avoid the interval."""

    near: Bools  # come near the real axis without crossing
    crosses: Bools  # cross the real axis once
    undecided: Bools  # need shorter steps


@dataclass(frozen=True, eq=False)
class PortResponse:
    """Admittance of some parts times the impedance at their terminals.

    Attributes
    ----------
    board : LinearBoard
        The board with the parts.
    parts : tuple of Capacitor, or of Resistor
        K parts of one kind.
    """

    board: LinearBoard
    parts: tuple[Capacitor | Resistor, ...]

    @property
    def reactive(self) -> bool:
        """Whether the parts are capacitors."""
        return isinstance(self.parts[0], Capacitor)

    @property
    def proportional(self) -> bool:
        """Whether the matrices grow with the value: not with a resistance."""
        return self.reactive

    @property
    def poles(self) -> Complexes:
        """Poles of the board; of a large board those of its coarse board; 1/s."""
        board = self.board.coarse if self.board.descriptor.is_large else self.board
        return board.state_space.modes.poles

    def at(self, omega: Floats) -> Complexes:
        """Return the matrices at angular frequencies (P,), 1/s; shape (P, K, K)."""
        large = self.board.descriptor.is_large
        modal = not large and self._modes_suffice
        impedance = self._from_modes(omega) if modal else self._from_solves(omega)
        weighted = self._roots[:, None] * impedance * self._roots
        return 1j * omega[:, None, None] * weighted if self.reactive else weighted

    @cached_property
    def _modes_suffice(self) -> bool:
        modes = self.board.state_space.modes
        return bool(modes.alone.all()) and modes.defect < WELL_CONDITIONED

    @cached_property
    def _roots(self) -> Floats | Complexes:
        """Square roots of the capacitances or conductances, (K,); imaginary of negative ones."""
        values = [p.farads if isinstance(p, Capacitor) else 1.0 / p.ohms for p in self.parts]
        roots = np.emath.sqrt(np.array(values))
        return np.asarray(roots)

    @cached_property
    def _columns(self) -> Floats:
        """Voltage of each part as a combination of the unknowns, shape (size, K)."""
        columns = np.zeros((self.board.descriptor.size, len(self.parts)))
        for k, part in enumerate(self.parts):
            for node, sign in ((part.a, 1.0), (part.b, -1.0)):
                if node != GROUND:
                    columns[self.board.descriptor.place(node), k] = sign
        return columns

    @cached_property
    def _rows(self) -> Floats:
        """Currents of each part into the rows that take them up."""
        descriptor = self.board.descriptor
        rows = np.zeros((descriptor.size + 1, len(self.parts)))
        np.add.at(rows, descriptor.balance_rows[:-1], self._columns)
        return rows[:-1]

    def rate(self, left: Complexes, right: Complexes, s: complex) -> complex:
        """Return ``left d(K - s M) right`` for a relative change of the value, to first order."""
        weights = self._roots**2 * (-s if self.reactive else 1.0)
        return complex((left @ self._rows * weights) @ (self._columns.T @ right))

    @cached_property
    def _modal(self) -> tuple[Complexes, Floats, Floats]:
        """Poles (m,), one of each pair; their shares, real and imaginary; and the direct part."""
        B, C, D = self._driven
        modes, columns = self.board.state_space.modes, self._columns.T
        upper = np.flatnonzero(modes.poles.imag >= 0.0)
        right, left = columns @ C @ modes.right[:, upper], modes.left[upper] @ B
        shares = (right.T[:, :, None] * left[:, None, :]).reshape(len(upper), -1)
        shares[modes.poles[upper].imag == 0.0] *= 0.5
        return modes.poles[upper], np.concatenate([shares.real, -shares.imag]), columns @ D

    @cached_property
    def _driven(self) -> tuple[Floats, Floats, Floats]:
        """Currents into the states, all unknowns as combinations of these, and the direct part."""
        return _driven_by(self.board, self._rows)

    def _from_modes(self, omega: Floats) -> Complexes:
        poles, shares, direct = self._modal
        own, other = (1.0 / (1j * omega[:, None] - p) for p in (poles, poles.conj()))
        # ``R / (s - p) + R* / (s - p*)`` of a pair in real matrices.
        gain = np.concatenate([own + other, -1j * (own - other)], axis=1)
        found = gain.real @ shares + 1j * (gain.imag @ shares)
        return np.asarray(found.reshape(-1, *direct.shape) + direct)

    def _from_solves(self, omega: Floats) -> Complexes:
        structure, rows = self.board.structure, self._rows.astype(np.complex128)
        solved = [structure.factor(1j * each).solve(rows) for each in omega.tolist()]
        return np.asarray(self._columns.T @ np.stack(solved))


@dataclass(frozen=True, eq=False)
class LawResponse(PortResponse):
    """The same for one part that stands in the matrices as ``value u v^T``: a gain, or a coil.

    `knob` is its name; `parts` is empty.
    """

    knob: str = ""

    @classmethod
    def of(cls, board: LinearBoard, knob: str) -> LawResponse | None:
        """Return the response of a knob; None if its change of the matrices has not the rank 1."""
        response = cls(board, (), knob)
        u = response._change[1]
        return response if len(u) else None

    @property
    def reactive(self) -> bool:
        """Whether the value stands in M."""
        return self._change[0]

    @property
    def proportional(self) -> bool:
        """Whether the matrices grow with the value."""
        return True

    @cached_property
    def _change(self) -> tuple[bool, Floats, Floats]:
        circuit, own = self.board.circuit, self.board.descriptor.dense
        moved = LinearBoard(circuit.turned(self.knob, 2.0 * circuit.value(self.knob)))
        there = moved.descriptor.dense
        in_mass = not np.array_equal(there.mass, own.mass)
        change = there.mass - own.mass if in_mass else own.stiffness - there.stiffness
        i, j = np.unravel_index(int(np.abs(change).argmax()), change.shape)
        if change[i, j] == 0.0:
            return in_mass, np.zeros(0), np.zeros(0)
        u, v = change[:, j], change[i] / change[i, j]
        if not np.allclose(np.outer(u, v), change, rtol=1e-12, atol=0.0):
            return in_mass, np.zeros(0), np.zeros(0)
        return in_mass, u, v

    def rate(self, left: Complexes, right: Complexes, s: complex) -> complex:
        """Return ``left d(K - s M) right`` for a relative change of the value."""
        reactive, u, v = self._change
        return complex((left @ u) * (v @ right) * (-s if reactive else -1.0))

    @cached_property
    def _modes_suffice(self) -> bool:
        """Not so where a capacitor is at the output of the source: its current is a derivative."""
        try:
            return bool(self._driven) and super()._modes_suffice
        except EngineError:
            return False

    @cached_property
    def _roots(self) -> Floats | Complexes:
        return np.ones(1)

    @cached_property
    def _columns(self) -> Floats:
        return self._change[2][:, None]

    @cached_property
    def _rows(self) -> Floats:
        return self._change[1][:, None]

    def _from_solves(self, omega: Floats) -> Complexes:
        _, u, v = self._change
        dense = self.board.descriptor.dense
        X = 1j * omega[:, None, None] * dense.mass - dense.stiffness
        scale = np.abs(X).max(axis=2, keepdims=True)
        scale[scale == 0.0] = 1.0
        try:
            solved = np.linalg.solve(X / scale, u[:, None] / scale)
        except np.linalg.LinAlgError:
            raise EngineError("a pole of the board is on the imaginary axis") from None
        return np.asarray((v @ solved)[:, None, :])


def share_modes(responses: Iterable[PortResponse]) -> None:
    """Eliminate the unknowns without charge once for all R and C of one linear board.

    Each part would do it by itself, at many times the cost of one more column.
    """
    every = [each for each in responses if each.parts]
    if not every or every[0].board.descriptor.is_large:
        return
    board = every[0].board
    rows = [each._rows for each in every]
    B, C, D = _driven_by(board, np.concatenate(rows, axis=1))
    first = 0
    for each, own in zip(every, rows, strict=True):
        taken = slice(first, first + own.shape[1])
        each.__dict__["_driven"] = B[:, taken], C, D[:, taken]
        first += own.shape[1]


def _driven_by(board: LinearBoard, rows: Floats) -> tuple[Floats, Floats, Floats]:
    """Return B, C and D for inputs into rows, (size, k).

    Raises
    ------
    EngineError
        The time derivative of an input would be needed: a capacitor at the output of a source. (Of
        the first two inputs it does not count, as these are steps; so two without effect go first.)
    """
    steps = np.zeros((len(rows), 2))
    space = driven(board.descriptor, board.operating_point, np.hstack([steps, rows]))
    return space.B[:, 2:], space.C, space.D[:, 2:]


def trace_loci(ports: PortResponse, low: float, high: float = 1.0, unstable: int = 0) -> Edges:
    """Find every share from `low` (above 0) to `high` at which the board has a pole on the axis.

    The board of `ports` itself, with the share 1, has none, and `unstable` poles right of it; its
    linearisation does not depend on the shares. At the shares `Edges.near` a locus comes close to
    the axis without crossing: their poles must tell.

    Raises
    ------
    EngineError
        No equilibrium, no state-space form, or a pole of the board is on the axis.

    Notes
    -----
    Costs one dense eigenproblem, of the size of the number of parts, at some 100 frequencies (seven
    channels: 5 ms); for a large board, one structured factorisation at each of them.
    """
    trace = _Trace(ports, math.log(low), math.log(high))
    trace.run(_frequencies(ports.poles.tobytes(), low, high))
    return Edges.counted((low, high), trace.crossings, trace.nearest(), (1.0, unstable))


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


@dataclass(slots=True)
class _Trace:
    """The loci over angular frequency: logarithms of the shares, so that widths are relative."""

    ports: PortResponse
    low: float  # logarithms of the ends of the interval
    high: float
    crossings: list[Crossing] = field(default_factory=list)
    near: list[complex] = field(default_factory=list)  # logarithms of shares

    def loci(self, omega: Floats) -> Complexes:
        """Return the logarithms of the shares at frequencies (P,), shape (P, K)."""
        response = self.ports.at(omega)
        if not np.all(np.isfinite(response)):
            raise EngineError("a pole of the board is on the imaginary axis")
        w = np.linalg.eigvals(response)
        shares = 1.0 - 1.0 / np.where(np.abs(w) < SMALLEST, SMALLEST, w)
        return np.log(np.where(np.abs(shares) < SMALLEST, SMALLEST, shares))

    def run(self, omega: Floats) -> None:
        """Follow all loci from the lowest to the highest frequency."""
        z = self.loci(omega)
        if not self.ports.reactive:
            self._real_poles(z[0])
            self._poles_at_infinity(z[-1], float(omega[-1]))
        a, b, za, zb = omega[:-1], omega[1:], z[:-1], _follow(z[:-1], z[1:])
        chord = np.abs(zb - za)
        kept = ~self._avoids(np.stack([za, zb]), chord, chord).all(axis=1)
        steps, taken = (a[kept], b[kept], za[kept], zb[kept]), len(omega)
        while len(steps[0]):
            a, b, za, zb = steps
            m, taken = 0.5 * (a + b), taken + len(a)
            zm = self.loci(m)
            z = np.stack([_follow(zm, za), zm, _follow(zm, zb)])
            states = self._judge(z)
            self._cross_all(a, b, z, states)
            again = states.undecided.any(axis=1)
            again &= (b - a > NARROW * b) & (taken <= LARGEST)
            close = (states.near | states.undecided) & ~again[:, None]
            self.near += z[:, close].ravel().tolist()
            halves = ((a, m), (m, b), (z[0], zm), (zm, z[2]))
            a, b, za, zb = (np.concatenate([x[again], y[again]]) for x, y in halves)
            steps = a, b, za, zb

    def _judge(self, z: Complexes) -> _States:
        """Judge the loci at the ends and in the middle of steps, (3, P, K)."""
        bend = z[0] - 2.0 * z[1] + z[2]
        avoids = self._avoids(z, np.abs(bend.real), np.maximum(np.abs(bend.imag), NEAR))
        height, one_side = np.abs(bend.imag), _one_side(z)
        first, last = (4.0 * z[1] - 3.0 * z[0] - z[2]).imag, (3.0 * z[2] + z[0] - 4.0 * z[1]).imag
        turns = first * last <= 0.0  # the slopes at the ends
        near = ~avoids & one_side & (height < np.where(turns, FLAT, NEAR))
        crosses = ~avoids & ~one_side & (height < ONCE * np.abs(z[2].imag - z[0].imag))
        return _States(near, crosses, ~(avoids | near | crosses))

    def _avoids(self, z: Complexes, width: Floats, height: Floats) -> Bools:
        """Tell which loci, (J, P, K) at points of steps, avoid the interval by their bends."""
        above = z.real.min(axis=0) > self.high + width
        below = z.real.max(axis=0) < self.low - width
        away = _one_side(z) & (np.abs(z.imag).min(axis=0) > height)
        return np.asarray(above | below | away)

    def nearest(self) -> tuple[float, ...]:
        """Return the shares where the loci come near the axis, the nearest of each cluster."""
        kept: list[complex] = []
        for z in sorted(self.near, key=lambda z: abs(z.imag)):
            if all(abs(z.real - other.real) > CLUSTER for other in kept):
                kept.append(z)
        inside = [min(max(z.real, self.low), self.high) for z in kept]
        return tuple(sorted(map(math.exp, inside), reverse=True))

    def _cross_all(self, a: Floats, b: Floats, z: Complexes, states: _States) -> None:
        """Find the crossings of the steps in which every locus is decided.

        What seems to cross may also be two loci that were taken for one: such a step is undecided.
        """
        complete = np.asarray(states.crosses.any(axis=1) & ~states.undecided.any(axis=1))
        step, locus = np.nonzero(states.crosses & complete[:, None])
        if not step.size:
            return
        found, frequency, known = self._cross(a[step], b[step], z[:, step], locus)
        states.undecided[step[~known], locus[~known]] = True
        q = np.arange(len(step))
        falls = z[2, step, locus].imag < z[0, step, locus].imag
        for i in q[~states.undecided[step].any(axis=1)].tolist():
            share, change = math.exp(found[i].real), -2 if falls[i] else 2
            self._keep([(share, float(frequency[i]) / (2.0 * math.pi), change)])

    def _cross(
        self, a: Floats, b: Floats, z: Complexes, k: Ints
    ) -> tuple[Complexes, Floats, Bools]:
        """Find where loci k (Q,) cross the real axis between two frequencies (Illinois method).

        `z` (3, Q, K) are all loci at both ends and in the middle. Returns the loci at the crossing,
        its angular frequency, and whether the locus is there.
        """
        start, end, kept, every = a, b, np.zeros(len(a)), np.arange(len(a))
        a, b, (low, high) = a.copy(), b.copy(), z[[0, 2]][:, every, k].imag
        rise, bend = z[2] - z[0], z[0] - 2.0 * z[1] + z[2]
        height = np.abs(high - low)
        m, found, active = _first_guess(a, b, z[:, every, k].imag), z[0, every, k], every
        for _ in range(ITERATIONS):
            t = ((m - start) / (end - start))[active, None]
            expected = z[0, active] + t * rise[active] - 2.0 * t * (1.0 - t) * bend[active]
            here = _follow(expected, self.loci(m[active]))[np.arange(len(active)), k[active]]
            found[active] = here
            above, y = (here.imag > 0.0) == (high[active] > 0.0), here.imag
            up, down = active[above], active[~above]
            b[up], high[up], a[down], low[down] = m[up], y[above], m[down], y[~above]
            low[up] *= np.where(kept[up] > 0, 0.5, 1.0)
            high[down] *= np.where(kept[down] < 0, 0.5, 1.0)
            kept[up], kept[down] = 1, -1
            following = (a * high - b * low) / (high - low)
            moved = np.abs(following - m) > PRECISE * b
            active = active[(y != 0.0) & moved[active]]
            if not active.size:
                break
            m[active] = following[active]
        return found, m, np.abs(found.imag) <= ON_AXIS * height

    def _real_poles(self, ahead: Complexes) -> None:
        """Find the shares with a pole at zero; `ahead` are the loci at the lowest frequency."""
        for share in self._shares(0.0):
            following = ahead[np.argmin(np.abs(ahead - math.log(share)))]
            self._keep([(share, 0.0, -1 if following.imag < 0.0 else 1)])

    def _poles_at_infinity(self, behind: Complexes, omega: float) -> None:
        """Find the shares at which a real pole passes from one side to the other through infinity.

        `behind` are the loci at the highest frequency `omega`.
        """
        for share in self._shares(FAR * omega):
            before = behind[np.argmin(np.abs(behind - math.log(share)))]
            self._keep([(share, 0.0, 1 if before.imag < 0.0 else -1)])

    def _shares(self, omega: float) -> list[float]:
        """Return the shares of the real loci at a frequency, where the response is real."""
        response = self.ports.at(np.full(1, omega))[0].real
        if not np.all(np.isfinite(response)):
            raise EngineError("a pole of the board is on the imaginary axis")
        w = np.linalg.eigvals(response)
        real = (w.imag == 0.0) & ((w.real > 1.0) | (w.real < -SMALLEST))
        found: list[float] = (1.0 - 1.0 / w[real].real).tolist()
        return found

    def _keep(self, found: Iterable[Crossing | None]) -> None:
        """Keep the crossings in the interval."""
        for each in found:
            if each is not None and self.low <= math.log(each[0]) <= self.high:
                self.crossings.append(each)


def _one_side(z: Complexes) -> Bools:
    """Tell which loci, (J, P, K), are on one side of the real axis at all points."""
    return np.asarray(np.abs(np.sign(z.imag).sum(axis=0)) == len(z))


def _first_guess(a: Floats, b: Floats, y: Floats) -> Floats:
    """Return where parabolas through y (3, Q) at both ends and in the middle are zero."""
    c, d = -3.0 * y[0] + 4.0 * y[1] - y[2], 2.0 * (y[0] - 2.0 * y[1] + y[2])
    root = np.sqrt(np.maximum(c**2 - 4.0 * d * y[0], 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        t = -2.0 * y[0] / (c + np.copysign(root, c))
    inside = (t > 0.0) & (t < 1.0)
    return np.asarray(a + (b - a) * np.where(inside, t, y[0] / (y[0] - y[2])))


def _follow(z: Complexes, others: Complexes) -> Complexes:
    """Sort the loci `others` (P, K) as `z`: the closest two belong together, and so on."""
    apart = others[:, None, :] - z[:, :, None]
    apart.imag -= 2.0 * math.pi * np.round(apart.imag / (2.0 * math.pi))
    distance, count = np.abs(apart), z.shape[1]
    nearest = distance.argmin(axis=2)
    doubtful = np.flatnonzero((np.sort(nearest, axis=1) != np.arange(count)).any(axis=1))
    for step in doubtful.tolist():  # two loci have the same nearest one
        left = distance[step]
        for _ in range(count):
            i, j = divmod(int(left.argmin()), count)
            nearest[step, i] = j
            left[i], left[:, j] = np.inf, np.inf
    return np.asarray(z + np.take_along_axis(apart, nearest[:, :, None], axis=2)[:, :, 0])
