"""The exact transient of a linear board, evaluated at any instant without time steps.

``C exp(A t) d`` by the modes of the board, with a bound on the error: modes that are alone give
exponentials, those of a group exponentials times powers of the time.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.system.array_types import EPS, Bools, Complexes, Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.linearised.linear_board import (
    Initial,
    LinearBoard,
    initial_unknowns,
)
from taction.verification.engines.statespace.linearised.modes import Group, Modes

BLOCK = 512  # instants evaluated at a time
FADED = -90.0  # exponent below which a mode is left out: 1e-39 of its first amplitude
NEGLIGIBLE = 1e-18  # share of a mode, relative to the largest, below the rounding of any sum
NOISE = 8 * EPS  # share of a mode, relative to the sum of its terms, that is only rounding
POWERS = 100  # largest number of powers of the time


class ModalFlow:
    """``Re sum_i share_i (s_i t)^k_i / k_i! exp(p_i t)``: the modes of a board at some outputs.

    For output rows C (K, n) and the deviation (size,) of all unknowns; `doubt` (K, n) is what the
    rows may miss of each mode. Modes are left out whose shares are negligible or within their
    rounding, and at each instant those that have decayed. Of the terms (m,), of which a pair has
    one, `poles` are p, `powers` k, `scales` s (0 without powers), `rates` and `speeds` bound growth
    and relative change, 1/s, the largest rate first, and `share` (m, K) is that in each output. A
    term with a power follows that with the power below. `errors` (K,) are the largest `bounds`.
    """

    def __init__(
        self, modes: Modes, C: Floats, deviation: Floats, doubt: Floats | None = None
    ) -> None:
        with np.errstate(invalid="ignore", over="ignore"):
            shares = modes.shares(C, deviation, doubt)
            share, terms, (lag, vague) = shares.amplitudes, shares.terms, shares.errors
            # Rounding excites every growing mode, as noise does in a circuit.
            faint = (modes.poles.real > 0.0) & (np.abs(share) < EPS * terms)
            share = np.where(faint, EPS * terms, share)
        size, alone = np.abs(share), modes.alone
        # One of each conjugate pair is enough.
        upper = alone & (modes.poles.imag >= 0.0)
        large = size.max(axis=0, initial=0.0)
        kept = upper & (large > NEGLIGIBLE * large.max(initial=0.0))
        noise = alone & (modes.poles.real < 0.0) & np.all(size <= NOISE * terms, axis=0)
        kept &= ~noise
        pair = np.where(modes.poles[kept].imag > 0.0, 2.0, 1.0)
        none = np.zeros(len(pair))
        parts: list[tuple[Any, ...]] = [(modes.poles[kept], none, none, (share[:, kept] * pair).T)]
        for group in modes.groups:
            series = _series(group, shares.seen[:, group.members], shares.dual[group.members])
            one, powers = np.ones(len(series)), np.arange(len(series))
            parts.append((group.centre * one, powers, group.scale * one, series))
        poles, powers, scales, share = (np.concatenate(part) for part in zip(*parts, strict=True))
        order = np.argsort(-(poles.real + scales), kind="stable")
        self.poles, self.powers = poles[order], powers[order].astype(np.int64)
        self.scales: Floats = scales[order]
        self.rates: Floats = self.poles.real + self.scales
        self.speeds: Floats = np.abs(self.poles) + self.scales
        self.share = share[order]
        # Rounding of A and of the vectors, also where the share that is left out is only rounding.
        bounded = upper | ~alone
        twice = np.where(modes.alone[bounded] & (modes.poles[bounded].imag > 0.0), 2.0, 1.0)
        rates, omitted = modes.rates[bounded], size[:, noise].sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            lag = (lag[:, bounded] * twice).T
            vague = ((vague + terms * EPS)[:, bounded] * twice).T
            peak = lag / (math.e * np.abs(rates))[:, None]
        peak = np.where(lag == 0.0, 0.0, peak)
        most = (peak + vague).sum(axis=0) + omitted
        # Rates r (m,), lags l and errors v (m, K), and o (K,): ``sum (l t + v) exp(r t) + o``.
        self.bound_terms = rates, lag, vague, omitted
        self.errors: Floats = np.nan_to_num(most, nan=math.inf)
        self.error = float(self.errors.max(initial=0.0))

    def basis(self, times: Floats, live: Bools | slice) -> Complexes:
        """Return `live` terms with shares of 1 at `times`, whose shape comes first."""
        return self._with_powers(self._exponentials(times, live), times, live)

    def on_grids(self, begin: Floats, step: Floats, count: int, live: Bools | slice) -> Complexes:
        """Return `live` terms with shares of 1 at ``begin + step [0, 1, ...]``, (P, count, m).

        Exponentials at the begins (P,) and on one grid for each of the steps (P,) give all others.
        """
        steps, which = np.unique(step, return_inverse=True)
        grid = np.multiply.outer(steps, np.arange(count))
        values = self._exponentials(begin, live)[:, None] * self._exponentials(grid, live)[which]
        return self._with_powers(values, begin[:, None] + grid[which], live)

    def _with_powers(self, values: Complexes, times: Floats, live: Bools | slice) -> Complexes:
        """Multiply exponentials by the powers of the time, in place."""
        powers, scales = self.powers[live], self.scales[live]
        with np.errstate(over="ignore", invalid="ignore"):
            for k in range(1, int(powers.max(initial=0)) + 1):
                higher = np.flatnonzero(powers >= k)
                values[..., higher] *= np.multiply.outer(times, scales[higher] / k)
        return values

    def _exponentials(self, times: Floats, live: Bools | slice) -> Complexes:
        """Return ``exp(p t)`` of `live` terms at `times`, whose shape comes first."""
        poles = self.poles[live]
        ring = np.flatnonzero(poles.imag)
        with np.errstate(over="ignore", invalid="ignore"):  # an unstable board overflows
            values: Complexes = np.exp(np.multiply.outer(times, poles.real)).astype(np.complex128)
            angle = np.multiply.outer(times, poles.imag[ring])  # quicker than complex exponentials
            values.imag[..., ring] = values.real[..., ring] * np.sin(angle)
            values.real[..., ring] *= np.cos(angle)
        return values

    def slowest(self, time: float) -> slice:
        """Return the terms that still matter from an instant on, s."""
        return slice(int(np.count_nonzero(self.rates * time > FADED)))

    def derived(self) -> Complexes:
        """Return the shares of the time derivative, (m, K)."""
        after, lower = np.zeros_like(self.share), np.flatnonzero(self.powers[1:])
        after[lower] = self.share[lower + 1]
        return np.asarray(self.share * self.poles[:, None] + self.scales[:, None] * after)

    def at(self, times: Floats) -> Floats:
        """Return values at `times` (P,), s; shape (P, K)."""
        return self._sums(times, self.share)

    def pair(self, times: Floats) -> tuple[Floats, Floats]:
        """Return values and their time derivatives, shape (P, K) each."""
        both = self._sums(times, np.hstack([self.share, self.derived()]))
        return both[:, : self.share.shape[1]], both[:, self.share.shape[1] :]

    def _sums(self, times: Floats, weight: Complexes) -> Floats:
        """Return ``Re sum_i weight_i basis_i``, shape (P, columns of `weight`)."""
        values = np.empty((len(times), weight.shape[1]))
        for first in range(0, len(times), BLOCK):
            part = slice(first, first + BLOCK)
            live = self.slowest(float(times[part].min()))
            basis = self.basis(times[part], live)
            with np.errstate(over="ignore", invalid="ignore"):
                values[part] = real_sums(basis, weight[live].T)
        return values


def real_sums(basis: Complexes, share: Complexes) -> Floats:
    """Return ``Re basis share^T``, (..., P, K), of arrays (..., P, m), contiguous, and (..., K, m).

    It is one real product.
    """
    weight = np.ascontiguousarray(share.conj()).view(np.float64)
    return np.asarray(basis.view(np.float64) @ weight.swapaxes(-1, -2))


def _series(group: Group, seen: Complexes, dual: Complexes) -> Complexes:
    """Return the shares of the powers of the time in ``seen exp(inner t) dual``, (powers, K)."""
    terms, largest = [seen @ dual], float(np.abs(dual).sum())
    for _ in range(1, POWERS):
        dual = group.inner @ dual / group.scale
        if not float(np.abs(dual).sum()) > NEGLIGIBLE * largest:
            break
        terms.append(seen @ dual)
    return np.array(terms)


def is_exact(board: LinearBoard) -> bool:
    """Whether the state-space engine has the exact solution of `board`, for all time."""
    return board.circuit.is_linear and not board.descriptor.is_large


@dataclass(frozen=True, slots=True, eq=False)
class Exact:
    """Node voltages of a linear board as functions of time, t >= 0."""

    nodes: tuple[str, ...]
    start: Floats  # just after the strain step, V, (K,)
    final: Floats  # at the equilibrium, reached or not, V, (K,)
    poles: Complexes  # 1/s, rightmost first, (n,)
    rest_error: Floats  # bound on the rounding error of `final`, V, (K,)
    flow: ModalFlow

    @property
    def error(self) -> float:
        """Bound on the rounding error of any node at any time, V, to first order."""
        return self.flow.error + float(self.rest_error.max(initial=0.0))

    def at(self, times: Floats) -> Floats:
        """Return voltages at `times` (P,), s; shape (P, K)."""
        return self.final + self.flow.at(times)


def exact_solution(
    circuit: Circuit | LinearBoard,
    *,
    initial: Initial = "zero",
    voltages: Mapping[str, float] | None = None,
    nodes: Iterable[str] | None = None,
) -> Exact:
    """Solve a linear board exactly.

    `circuit`: the board, without behavioural amplifiers.
    `initial`, `voltages`: see `taction.netlist_gen.analysis.Transient`.
    `nodes`: by default the outputs' nodes.
    EngineError: the board is not linear, or has no equilibrium or no state space, or rounding hides
      the solution.
    """
    board = LinearBoard.of(circuit)
    if not board.circuit.is_linear:
        name, kind = board.circuit.name, board.circuit.amplifier
        nonlinear = board.circuit.has_nonlinear_amplifiers
        what = f"{kind} amplifiers" if nonlinear else "op-amps with limits"
        raise EngineError(f"board {name!r} has {what}: the board is not linear")
    reported = board.reported(nodes)
    if voltages or nodes is not None:
        return combinations(board, reported, initial=initial, voltages=voltages)
    if initial not in board.integrations:  # one verification uses it several times
        board.integrations[initial] = combinations(board, reported, initial=initial)
    found: Exact = board.integrations[initial]
    return found


def combinations(
    board: LinearBoard,
    nodes: tuple[str, ...],
    volts: Floats | None = None,
    rates: Floats | None = None,
    *,
    initial: Initial = "zero",
    voltages: Mapping[str, float] | None = None,
) -> Exact:
    """Solve for ``volts @ V + rates @ dV/dt`` of a linear board, V the voltages of `nodes`.

    `nodes`: nodes, or states of op-amps by their names in the descriptor.
    `volts`, `rates` (K, n): weights of the voltages (1/V) and of their time derivatives (s/V). The
      start is just after the strain step, so jumps at that instant have no derivative. Without them
      the solution is V itself; with them its "nodes" are the combinations' numbers.
    `initial`, `voltages`, EngineError: as `exact_solution`.
    """
    space, rest = board.state_space, board.equilibrium.values
    C, D = space.rows(nodes)
    begin = initial_unknowns(board, initial, voltages)
    x0 = space.state_of(begin)
    start = C @ x0 + D.sum(axis=1)
    unseen, (final, off) = space.modes.unseen, np.zeros((2, len(nodes)))
    doubt = np.zeros((len(nodes), unseen.shape[1]))
    live = [k for k, node in enumerate(nodes) if node != "0"]
    at = [board.descriptor.place(nodes[k]) for k in live]
    final[live], doubt[live] = rest[at], unseen[at]
    off[live] = board.rounding[at] + EPS * np.abs(rest[at])
    if volts is not None and rates is not None:
        moving = rates @ C @ space.A
        start = volts @ start + moving @ (x0 - space.state_of(rest))
        final, off, C = volts @ final, np.abs(volts) @ off, volts @ C + moving
        speed, nodes = np.abs(space.modes.centres), tuple(map(str, range(len(volts))))
        doubt = np.abs(volts) @ doubt + (np.abs(rates) @ doubt) * speed
    flow = ModalFlow(space.modes, C, begin - rest, doubt)
    if not flow.error < math.inf:
        raise EngineError("rounding hides the solution")
    return Exact(nodes, start, final, space.modes.poles, off, flow)


def record_times(analysis: Transient, end: float, times: Floats | None = None) -> Floats:
    """Return the instants `times` (P,) up to `end`, s; by default a step of at most `max_step`."""
    if times is None:
        count = math.ceil(analysis.stop / analysis.max_step * (1.0 - 1e-12)) + 1
        times = np.linspace(0.0, analysis.stop, count)
    if end >= times[-1] * (1.0 - 1e-9):
        return times
    return np.append(times[times < end], end)
