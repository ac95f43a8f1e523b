"""Transients of large linear boards by their patterns: the exact solution of a small board.

The cells stay as they are; only vectors over the channels (and over the sensors) become sums of a
few orthonormal patterns. All unknowns of one kind (the outputs of all integrators, say) share the
patterns of their side, so the result is again a board: its matrix is T between the patterns, and
its poles lie where those of a board with other singular values of T lie. (A projection without
this structure has growing modes that the board lacks.) The patterns are those of the transient
``(s M - K)^-1 M e`` at a few rates s, repeated: a rational Krylov space. With some 20 patterns of a
smooth kernel, or 40 of a random matrix, it holds the strain step to 1e-6.

Patterns are added until two boards of patterns in turn have the same outputs, and until the
residual of the board's own equations, solved at each rate, leaves the outputs in place. A board
with growing modes, or one that needs too many patterns, is integrated by steps (`stepped`).
"""

from __future__ import annotations

import math
import re
import time as clock
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.system.array_types import Cost, Floats, Indices, Ints, Waveforms
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.descriptor import Descriptor
from taction.verification.engines.statespace.equations.structured_solve import projected, units
from taction.verification.engines.statespace.linearised.linear_board import (
    LinearBoard,
    initial_unknowns,
)
from taction.verification.engines.statespace.transients.exact import ModalFlow, record_times


def _patterns(descriptor: Descriptor, vectors: Floats, least: float) -> Any:
    """Return the patterns of all sides, as a sparse matrix (size, reduced size)."""
    from scipy import sparse

    parts = list[Any]()
    for side in _sides(descriptor):
        shown = np.concatenate([_normalised(vectors[places]) for places in side], axis=1)
        U, sizes, _ = np.linalg.svd(shown, full_matrices=False)
        kept = U[:, sizes > least * sizes.max(initial=0.0)]
        count, shape = kept.shape[1], (descriptor.size, kept.shape[1])
        for places in side:
            where = np.repeat(places, count), np.tile(np.arange(count), len(places))
            parts.append(sparse.csr_array((kept.ravel(), where), shape=shape))
    return sparse.hstack(parts, format="csr")


def _normalised(vectors: Floats) -> Floats:
    """Return the columns that are not zero, with the length 1."""
    lengths = np.linalg.norm(vectors, axis=0)
    return np.asarray(vectors[:, lengths > 0.0] / lengths[lengths > 0.0])


def _sides(descriptor: Descriptor) -> Iterator[list[Ints]]:
    """Yield the places of the kinds of unknowns, (units,) each, of which there is one in each unit.

    Kinds that belong to the same channels (or sensors) are one side.
    """
    unit, sides = units(descriptor), dict[tuple[bytes, bool], list[Ints]]()
    for kind in _kinds(descriptor.names):
        for stated in (False, True):
            places = kind[descriptor.determined[kind] == stated]
            if len(places):
                sides.setdefault((unit[places].tobytes(), len(places) == 1), []).append(places)
    yield from sides.values()


_NUMBERED = re.compile(r"^([^\d\n]*)(\d*)(.*)$", re.MULTILINE)


def _kinds(names: tuple[str, ...]) -> list[Ints]:
    """Return the places of the unknowns of each kind, by number: ``v_1``, ``v_2``, for example."""
    kinds: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for place, (head, number, tail) in enumerate(_NUMBERED.findall("\n".join(names))):
        if number:
            kinds.setdefault((head, tail), []).append((int(number), place))
        else:
            kinds[head, tail] = [(0, place)]
    return [np.array([place for _, place in sorted(kind)]) for kind in kinds.values()]


METHOD = "exact, by patterns"
SHOWN = 1e-7  # step amplitudes: a mode of the coarse board that sets the fastest rate
SETTLED = 1e12  # times the fastest rate of the coarse board: a rate at which nothing has moved
PER_DECADE = 1.3  # rates
# Vectors at each rate, and the least share of a pattern.
LEVELS = ((2, 1e-7), (3, 1e-8), (4, 1e-9), (6, 1e-10), (8, 1e-11))
COMPARED = 300  # instants
# The cost of an eigenproblem grows with the cube of the states: above this number, steps by
# structured solves are quicker.
STATES = 900


@dataclass(frozen=True, slots=True, eq=False)
class Patterns:
    """The deviation from the equilibrium as ``lift x(t)``, x the states of a board of patterns."""

    flow: ModalFlow
    lift: Floats  # (size, n)

    @classmethod
    def of(cls, board: LinearBoard, vectors: Floats, least: float) -> Patterns | None:
        """Solve with the patterns in vectors (size, k) of a board, the first of which is the start.

        Patterns below the share `least` of the largest are left out. None if the board of patterns
        is too large, or grows, or has no state space.
        """
        descriptor, patterns = board.descriptor, _patterns(board.descriptor, vectors, least)
        try:
            names = tuple(f"pattern{k + 1}" for k in range(patterns.shape[1]))
            equations = projected(descriptor, patterns, names)
            space = LinearBoard(board.circuit, equations).state_space
        except EngineError:
            return None
        if space.n > STATES or np.any(space.modes.poles.real >= 0.0):
            return None
        flow = ModalFlow(space.modes, np.eye(space.n), patterns.T @ vectors[:, 0])
        return cls(flow, patterns @ space.C)

    def at(self, times: Floats, places: Ints) -> Floats:
        """Return the deviations of some unknowns at `times` (P,), s; shape (P, K), V."""
        return np.asarray(self.flow.at(times) @ self.lift[places].T)

    def rounding(self, places: Ints) -> float:
        """Return a bound on the rounding error of some unknowns, V."""
        return self.flow.error * float(np.abs(self.lift[places]).sum(axis=1).max(initial=0.0))

    def off(self, board: LinearBoard, rates: Floats, places: Ints) -> float:
        """Return how far the residuals of the board's equations move some unknowns, V.

        At each rate s, 1/s, the residual at the time 1/s is solved at s: a step of that length.
        """
        structure, moved = board.structure, 0.0
        x, slopes = self.flow.pair(1.0 / rates)
        for rate, there, slope in zip(rates.tolist(), x, slopes, strict=True):
            charge = structure.mass @ (self.lift @ slope)
            residual = charge - board.descriptor.stiffness_times(self.lift @ there)
            found = structure.solver(rate)(residual)[places]
            moved = max(moved, float(np.abs(found).max(initial=0.0)))
        return moved


class Reduction:
    """The transient of a large board by patterns, to as many vectors at each rate as asked for."""

    def __init__(self, board: LinearBoard, deviation: Floats, stop: float) -> None:
        self.board = board
        fastest, shown = _fastest(board, deviation)
        span = max(math.log10(shown * stop), 1.0)
        self.rates: Floats = np.geomspace(1.0 / stop, shown, math.ceil(PER_DECADE * span) + 1)
        rate, charge = SETTLED * fastest, board.structure.mass @ deviation
        start = rate * board.structure.factor(rate)(charge)
        self.ends, self.vectors = [start] * len(self.rates), [start]
        self.found: list[Patterns | None] = []

    def model(self, number: int) -> Patterns | None:
        """Return the model of a level; None if patterns do not suffice there."""
        while len(self.found) <= number:
            structure, (depth, least) = self.board.structure, LEVELS[len(self.found)]
            while len(self.vectors) <= depth * len(self.rates):
                for k, rate in enumerate(self.rates.tolist()):
                    end = structure.solver(rate)(structure.mass @ self.ends[k])
                    self.ends[k] = end / (float(np.linalg.norm(end)) or 1.0)
                    self.vectors.append(self.ends[k])
            self.found.append(Patterns.of(self.board, np.stack(self.vectors, axis=1), least))
        return self.found[number]

    def converged(
        self, times: Floats, places: Ints, tolerance: float
    ) -> tuple[Patterns, Patterns] | None:
        """Return the first model that `tolerance` allows, and the next one; None if none is.

        They agree at `times` (P,), s, and the residuals of the first move nothing more.
        """
        compared = times[:: max(len(times) // COMPARED, 1)]
        before, there = None, np.zeros(0)
        for number in range(len(LEVELS)):
            model = self.model(number)
            if model is None:
                return None
            values = model.at(compared, places)
            allowed = tolerance * float(np.abs(values).max(initial=0.0))
            if (
                before is not None
                and float(np.abs(values - there).max(initial=0.0)) <= allowed
                and before.off(self.board, self.rates, places) <= allowed
            ):
                return before, model
            before, there = model, values
        return None


def _fastest(board: LinearBoard, deviation: Floats) -> tuple[float, float]:
    """Return the fastest rate of the coarse board, and of the modes that its outputs show, 1/s."""
    coarse, space = board.coarse.descriptor, board.coarse.state_space
    start = deviation[_places(board, coarse.names)]
    C, _ = space.rows([node for node in board.reported(None) if node in coarse.places])
    heights = space.modes.shares(C, start).heights.max(axis=0, initial=0.0)
    sizes = np.abs(space.modes.poles)
    step = float(np.abs(C @ space.state_of(start)).max(initial=0.0))
    shown = heights >= SHOWN * max(step, 1e-300)
    return float(sizes.max()), float(sizes[shown].max(initial=sizes.min()))


@dataclass(frozen=True, slots=True, eq=False)
class PatternCurve:
    """Voltages of nodes (Q,) at instants (Q,), by a model; `finer` is the next one, if there is."""

    model: Patterns
    finer: Patterns | None
    places: Ints
    rest: Floats  # the equilibrium (K,), V

    def at(self, times: Floats) -> Floats:
        """Return the voltages of all nodes, (P, nodes)."""
        return self.rest + self.model.at(times, self.places)

    def __call__(self, times: Floats, columns: Indices) -> Floats:
        """Return voltages (Q,)."""
        instants, which = np.unique(times, return_inverse=True)
        return np.asarray(self.at(instants)[which, columns])


def simulate(
    board: LinearBoard,
    analysis: Transient,
    nodes: Iterable[str] | None = None,
    times: Floats | None = None,
    *,
    tolerance: float,
) -> Waveforms | None:
    """Simulate a large linear board as `stepped.simulate`; None where patterns do not suffice.

    EngineError: the board has no equilibrium.
    """
    began, reported = clock.perf_counter(), board.reported(nodes)
    if analysis.voltages:
        return None
    key = analysis.initial, analysis.stop
    if key not in board.integrations:  # one verification uses it several times
        deviation = initial_unknowns(board, analysis.initial) - board.equilibrium.values
        board.integrations[key] = Reduction(board, deviation, analysis.stop)
    found: Reduction = board.integrations[key]
    times = record_times(analysis, analysis.stop) if times is None else times
    outputs = _places(board, board.reported(None))
    models = found.converged(times, outputs, tolerance)
    if models is None:
        return None
    places = _places(board, reported)
    curve = PatternCurve(*models, places, board.equilibrium.values[places])
    cost = Cost(clock.perf_counter() - began, len(times), len(found.rates) + 1)
    left = curve.model.rounding(places) + float(board.rounding[places].max(initial=0.0))
    return Waveforms(
        times, reported, curve.at(times), "statespace", cost, (), left, curve=curve, method=METHOD
    )


def refined(first: Waveforms) -> Waveforms:
    """Repeat a run of `simulate` with more patterns, at the same instants.

    EngineError: the first run is not one of `simulate`.
    """
    began, curve = clock.perf_counter(), first.curve
    if not isinstance(curve, PatternCurve) or curve.finer is None:
        raise EngineError("the first run is not one by patterns that have more")
    finer = replace(curve, model=curve.finer, finer=None)
    values = finer.at(first.time)
    cost = replace(first.cost, seconds=clock.perf_counter() - began)
    return replace(first, values=values, cost=cost, curve=finer)


def _places(board: LinearBoard, nodes: Iterable[str]) -> Ints:
    return np.array([board.descriptor.place(node) for node in nodes], dtype=np.int64)
