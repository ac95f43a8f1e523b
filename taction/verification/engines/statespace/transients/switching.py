"""A board of piecewise linear amplifiers on one of its pieces, and where it leaves the piece.

Between two switches such a board is linear, so its modes give it exactly. An amplifier leaves its
straight piece where its input passes a break. The first such instant is found by division: in an
interval the input lies within the hull of a cubic and a bound of what the modes do beside it, and
an interval is divided until the hull excludes every break or is too short to matter. So no passage
is missed, also two in one step of a grid.

A break counts as passed a little behind it (`slack`, the rounding of the input). As g is
continuous, the board then errs by the slack times the change of slope, which `Piece.noise` bounds.
"""

from __future__ import annotations

import functools
from dataclasses import field, replace

import numpy as np

from taction.system.array_types import EPS, Bools, Complexes, Floats, Ints
from taction.system.errors import EngineError
from taction.system.frozen import frozen
from taction.verification.engines.statespace.equations.amplifier_gains import GAINS, Gain
from taction.verification.engines.statespace.equations.descriptor import Descriptor, Devices
from taction.verification.engines.statespace.linearised.equilibrium import (
    Equilibrium,
    moved_by_rounding,
)
from taction.verification.engines.statespace.linearised.state_space import StateSpace, driven
from taction.verification.engines.statespace.transients.matrix_exponential import ModalFlow

PER_OCTAVE = 6  # instants of the first grid
PARTS = 8  # of an interval that is divided
LEVELS = 24  # of divisions: 8^-24 of the record is below its rounding
SLACK = 256 * EPS  # of the size of an input: the rounding within which a break is passed
REFINED = 3  # corrections of a rest
SHORTEST = 4 * EPS  # of an instant: an interval that is not divided

Segments = tuple[int, ...]
"""The straight piece of each amplifier, counted from the left."""


def breaks_of(devices: Devices) -> list[Floats] | None:
    """Return the breaks of each amplifier's input, V; None if not all are piecewise linear."""
    found = [GAINS[kind].breaks if kind in GAINS else None for kind in devices.kinds]
    if not found or any(breaks is None for breaks in found):
        return None
    scales = zip(found, devices.v_scale.tolist(), strict=True)
    return [np.array(breaks) * scale for breaks, scale in scales]


@frozen(eq=False, slots=False)
class ActiveSet:
    """A board while every amplifier stays on one of its straight pieces: a linear board.

    Attributes
    ----------
    segments : tuple of int (m,)
        The straight pieces.
    space : StateSpace
        Its third and further inputs are disturbances of the amplifiers' outputs.
    low, high : ndarray (m,)
        Ends of the pieces at the inputs, V.
    slopes : ndarray (m,)
        ``d v_out / d v_in``, V/V.
    drive : ndarray (size,)
        All sources, with those that the straight pieces add.
    """

    segments: Segments
    space: StateSpace
    low: Floats
    high: Floats
    slopes: Floats
    drive: Floats

    @classmethod
    def of(cls, descriptor: Descriptor, breaks: list[Floats], segments: Segments) -> ActiveSet:
        """Linearise the board on the straight pieces `segments`.

        Raises
        ------
        EngineError
            The equations have no state-space form there, or amplifiers drive their own inputs
            without delay by a gain above 1.
        """
        devices = descriptor.devices
        ends = [np.concatenate([[-np.inf], each, [np.inf]]) for each in breaks]
        pairs = list(zip(ends, segments, strict=True))
        low, high = (np.array([each[k + side] for each, k in pairs]) for side in (0, 1))
        one_sided = np.where(np.isfinite(low), low + devices.v_scale, high - devices.v_scale)
        inside = np.where(np.isfinite(low) & np.isfinite(high), 0.5 * (low + high), one_sided)
        y, gains = inside / devices.v_scale, [GAINS[kind] for kind in devices.kinds]
        value, slope = (np.array([_one(g, name, x) for g, x in zip(gains, y, strict=True)])
                        for name in ("value", "slope"))  # fmt: skip
        slopes = -devices.u_scale / devices.v_scale * slope
        z = np.zeros(descriptor.size)
        z[devices.input] = inside
        b = np.zeros((descriptor.size, 2 + devices.count))
        b[:, 0], b[:, 1] = descriptor.switched, descriptor.constant
        b[devices.output, 1] += -devices.u_scale * value - slopes * inside
        b[devices.output, 2 + np.arange(devices.count)] = 1.0
        point = Equilibrium(descriptor, z, slopes, 0.0, 0)
        space = driven(descriptor, point, b)
        if not _one_solution(space, slopes):
            names = ", ".join(descriptor.names[k] for k in devices.output.tolist())
            raise EngineError(
                f"of the amplifiers {names} some drive their own inputs without delay, by a gain"
                " above 1: the board has several voltages for one state, and jumps."
                " Give the op-amps a bandwidth, or the signal nodes a capacitance"
            )
        return cls(segments, space, low, high, slopes, b[:, 0] + b[:, 1])

    @property
    def rightmost(self) -> complex:
        """The rightmost pole, 1/s."""
        return complex(self.space.modes.poles[0])

    @functools.cached_property
    def rest(self) -> tuple[Floats, Floats]:
        """States at which this linear board would rest, V, (n,), and bounds of their rounding."""
        descriptor = self.space.descriptor
        devices, b = descriptor.devices, self.drive
        K = descriptor.dense.stiffness.copy()
        K[devices.output, devices.input] += self.slopes
        scale = np.abs(K).max(axis=1)
        try:
            inverse = np.linalg.inv(K / scale[:, None])
        except np.linalg.LinAlgError as error:
            raise EngineError("an active set of the amplifiers has no equilibrium") from error
        z = np.zeros(descriptor.size)
        for _ in range(REFINED):
            z = z - inverse @ ((K @ z + b) / scale)
        terms = np.abs(K) @ np.abs(z) + np.abs(b)
        point = Equilibrium(descriptor, z, self.slopes, 0.0, 0)
        moved = moved_by_rounding(point, terms)
        return self.space.state_of(z), np.abs(self.charge) @ moved

    def unknowns(self, x: Floats) -> Floats:
        """Return all unknowns, (size,), at states x (n,) with the strain on."""
        return np.asarray(self.space.C @ x + self.space.D[:, :2].sum(axis=1))

    @functools.cached_property
    def charge(self) -> Floats:
        """States over unknowns, (n, size): the linear part of `StateSpace.state_of`."""
        space = self.space
        zero = space.state_of(np.zeros(space.descriptor.size))
        return np.stack([space.state_of(e) - zero for e in np.eye(space.descriptor.size)], axis=1)


def _one_solution(space: StateSpace, slopes: Floats) -> bool:
    """Whether the amplifiers' inputs follow from the states as if nothing came back at once.

    With the gains L of the way from the outputs to the inputs that needs no time, the inputs solve
    ``y = L g(y) + ...``: the sign of ``det(1 - S L)`` is then that of no way at all, 1. With one
    sign on all pieces, none turns back at a break.
    """
    G = space.D[space.descriptor.devices.input, 2:]  # L (1 - S L)^-1
    sign, _ = np.linalg.slogdet(np.eye(len(slopes)) + slopes[:, None] * G)
    return bool(sign > 0.0)


def _one(gain: Gain, name: str, y: float) -> float:
    return float(getattr(gain, name)(np.array([y]))[0])


@frozen(eq=False, slots=False)
class Piece:
    """A stretch of a transient on one active set.

    Attributes
    ----------
    begin : float
        s.
    x : ndarray (n,)
        States at `begin`, V.
    errors : ndarray (n, q)
        Columns whose sum, with any signs, bounds the error of x, V.
    rows : ndarray (m + K, n)
        The amplifiers' inputs (m), then the reported nodes (K), of the states, V/V.
    flow : ModalFlow
        The amplifiers' inputs (m), then the reported nodes (K), beside `level`, over the time since
        `begin`.
    level : ndarray (m + K,)
        V.
    before : ndarray (m,)
        Least slack, V.
    """

    active: ActiveSet
    begin: float
    x: Floats
    errors: Floats
    nodes: tuple[str, ...]
    rows: Floats = field(repr=False)
    flow: ModalFlow = field(repr=False)
    level: Floats = field(repr=False)
    before: Floats = field(repr=False)

    @classmethod
    def of(
        cls, active: ActiveSet, begin: float, x: Floats, errors: Floats, nodes: tuple[str, ...],
        before: Floats | float = 0.0,
    ) -> Piece:  # fmt: skip
        """Begin a stretch; `before` is the slack of the one before it, V, (m,)."""
        space, devices = active.space, active.space.descriptor.devices
        inputs = [space.nodes[k] for k in devices.input.tolist()]
        C, D = space.rows((*inputs, *nodes))
        rest, _ = active.rest
        flow = ModalFlow(space.modes, C, x - rest)
        level, m = C @ rest + D[:, :2].sum(axis=1), devices.count
        y = (level + flow.at(np.zeros(1))[0])[:m]
        beyond = np.maximum(np.maximum(y - active.high, active.low - y), 0.0)
        slack = np.maximum(before, 2.0 * beyond)  # rounding may place the start behind a break
        return cls(active, begin, x, errors, nodes, C, flow, level, slack)

    @property
    def count(self) -> int:
        """Number of amplifiers."""
        return len(self.active.low)

    @functools.cached_property
    def slack(self) -> Floats:
        """How far behind a break an input counts as beyond it, V, (m,)."""
        m = self.count
        size = np.abs(self.level[:m]) + np.abs(self.flow.share[:, :m]).sum(axis=0)
        edges = np.stack([self.active.low, self.active.high])
        size = np.maximum(size, np.abs(np.where(np.isfinite(edges), edges, 0.0)).max(axis=0))
        return np.asarray(np.maximum(SLACK * size, self.before))

    @functools.cached_property
    def _bounds(self) -> tuple[Floats, Complexes, Complexes]:
        """Return rates of the modes (n,), what each shows in every row, and its error, (n,)."""
        modes = self.active.space.modes
        return modes.rates, self.rows @ modes.right, np.abs(modes.left @ self.errors).sum(axis=1)

    @functools.cached_property
    def noise(self) -> Floats:
        """Largest disturbance of each amplifier's output within the slack, V, (m,)."""
        devices = self.active.space.descriptor.devices
        return np.asarray(2.0 * self.slack * devices.u_scale / devices.v_scale)

    def _driven(self, time: Floats) -> Floats:
        """Return how far disturbances of the outputs move each mode within `time` (P,), (P, n)."""
        modes, space = self.active.space.modes, self.active.space
        push = np.abs(modes.left @ space.B[:, 2:]) @ self.noise
        away = np.abs(modes.left) @ self.active.rest[1]
        rates, t = modes.rates, np.asarray(time)[:, None]
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            reach = np.where(rates == 0.0, t, np.expm1(np.minimum(rates * t, 700.0)) / rates)
            turned = np.minimum(
                np.abs(modes.centres) * t, 1.0 + np.exp(np.minimum(rates * t, 700.0))
            )
        return np.asarray(reach * push + turned * away)

    def bounds(self, time: Floats) -> Floats:
        """Bound the errors of inputs and nodes at instants since `begin` (P,), V, (P, m + K)."""
        rates, seen, before = self._bounds
        with np.errstate(over="ignore"):
            left = np.exp(np.minimum(np.outer(time, rates), 700.0)) * before
        size = np.abs(seen).T
        own = self.flow.bounds(time) + (left + self._driven(time)) @ size
        own[:, : self.count] += self.slack
        own[:, self.count :] += float(self.noise.max(initial=0.0))
        return np.asarray(own + 4 * EPS * np.abs(self.level))

    def at(self, time: Floats) -> Floats:
        """Return inputs and nodes at instants since `begin` (P,), V, (P, m + K)."""
        return np.asarray(self.level + self.flow.at(time))

    def outputs(self, time: Floats) -> Floats:
        """Return the nodes at instants since `begin` (P,), V, (P, K).

        An amplifier's output is g of its input: exactly 0 in a dead zone.
        """
        both, space = self.at(time), self.active.space
        devices, nodes = space.descriptor.devices, both[:, self.count :]
        places = devices.output.tolist()
        for column, name in enumerate(self.nodes):
            if space.descriptor.place(name) in places:
                k = places.index(space.descriptor.place(name))
                y = both[:, k] / devices.v_scale[k]
                nodes[:, column] = -devices.u_scale[k] * GAINS[devices.kinds[k]].value(y)
        return nodes

    def state_at(self, time: float) -> tuple[Floats, Floats]:
        """Return the states at an instant since `begin`, V, (n,), and their error's columns."""
        modes, (rest, _) = self.active.space.modes, self.active.rest
        n, now = len(rest), np.array([time])
        flow = ModalFlow(modes, np.eye(n), self.x - rest)
        x = rest + flow.at(now)[0]
        if not self.errors.size:  # nobody asks
            return x, self.errors
        own = flow.bounds(now)[0] + 4 * EPS * (np.abs(rest) + np.abs(x))
        own += np.abs(modes.right) @ self._driven(now)[0]
        return x, np.concatenate([self.transition(time) @ self.errors, np.diag(own)], axis=1)

    def transition(self, time: float) -> Floats:
        """Return ``exp(A time)``, (n, n)."""
        from scipy.linalg import expm

        modes = self.active.space.modes
        if not modes.alone.all():
            return np.asarray(expm(self.active.space.A * time))
        return np.asarray(((modes.right * np.exp(modes.poles * time)) @ modes.left).real)

    def ends(self, stop: float) -> float | None:
        """Return the first instant since `begin` at which an input is beyond a break; None if none.

        `stop` is the last instant, since `begin`, s.
        """
        fastest = float(self.flow.speeds.max(initial=0.0))
        first = min(0.01 / fastest, stop) if fastest > 0.0 else stop
        count = max(int(np.ceil(PER_OCTAVE * np.log2(stop / first))), 1)
        grid = np.concatenate([[0.0], np.geomspace(first, stop, count + 1)])
        grid[-1] = stop
        return self._first_passage(grid, LEVELS)

    def _first_passage(self, grid: Floats, levels: int) -> float | None:
        """Return the first passage in the intervals of a grid (P,)."""
        m, width = self.count, np.diff(grid)
        values, rates = self.flow.pair(grid)
        y, slope = self.level[:m] + values[:, :m], rates[:, :m]
        low, high = self.active.low - self.slack, self.active.high + self.slack
        outside: Bools = np.any((y < low) | (y > high), axis=1)
        if outside[0]:
            return float(grid[0])
        room = self._room(grid[:-1], width)
        third = width[:, None] / 3.0
        hull = np.stack([y[:-1], y[:-1] + third * slope[:-1], y[1:] - third * slope[1:], y[1:]])
        near = np.any((hull.min(axis=0) - room < low) | (hull.max(axis=0) + room > high), axis=1)
        for k in np.flatnonzero(near).tolist():
            a, b = float(grid[k]), float(grid[k + 1])
            small = width[k] <= SHORTEST * (self.begin + b) or levels == 0
            still = np.all(np.abs(hull[:, k] - y[k]).max(axis=0) + room[k] <= 0.25 * self.slack)
            if not (small or still):
                found = self._first_passage(np.linspace(a, b, PARTS + 1), levels - 1)
                if found is not None:
                    return found
            elif outside[k + 1]:
                return b
        return None

    def _room(self, begin: Floats, width: Floats) -> Floats:
        """Bound what lies between the inputs and cubics through values and slopes, V, (Q, m)."""
        flow = self.flow
        angle = flow.speeds * width[:, None]
        latest = np.where(flow.rates > 0.0, begin[:, None] + width[:, None], begin[:, None])
        with np.errstate(over="ignore"):
            size = np.exp(np.minimum(flow.rates * latest, 700.0))
        part = size * np.minimum(angle**4 / 384.0, 2.0 + 0.3 * angle)
        return np.asarray(part @ np.abs(flow.share[:, : self.count]))

    def passing(self, time: float) -> tuple[Ints, Ints]:
        """Return which amplifiers pass a break at an instant since `begin`, and the step of each.

        The step is 1 to the piece at the right, -1 to that at the left. Amplifiers within the slack
        of a break that move outwards pass it together.
        """
        m = self.count
        values, rates = self.flow.pair(np.array([time]))
        y, slope = self.level[:m] + values[0, :m], rates[0, :m]
        up = (y > self.active.high + self.slack) | (
            (y > self.active.high - self.slack) & (slope > 0.0)
        )
        down = (y < self.active.low - self.slack) | (
            (y < self.active.low + self.slack) & (slope < 0.0)
        )
        who = np.flatnonzero(up | down)
        return who, np.where(up[who], 1, -1)


def same_board(descriptor: Descriptor) -> Descriptor:
    """Return the equations without their mirror image: active sets need not be symmetric."""
    return replace(descriptor, mirror=None)
