"""One Radau IIA step of a board: its linear part solved in advance, for dense and large boards.

The board is ``M x' = K x + b + F a(v)`` with inputs ``v = G x + H a(v)`` of m amplifiers. From the
start of a step on, K contains the amplifiers' `slopes`, and only what an amplifier does beyond its
slope is nonlinear: the remainder n. In the eigenbasis of the method's matrix the changes w of the s
stages since the start are separate systems

    (theta_k M / h - K) w_k = sigma_k r + F nu_k,

half of them by symmetry, where r is the rate at the start and nu are the remainders n of the stages
in this basis. So a step of a linear board needs no iteration, and the stages of any other board are
found by iterating on the m inputs alone. A length of step is prepared once, from
`factorise(shift) -> solve`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from taction.system.array_types import Complexes, Floats, Ints
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.amplifier_gains import gain_of
from taction.verification.engines.statespace.equations.descriptor import Devices
from taction.verification.engines.statespace.equations.structured_solve import Structure
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.equilibrium import solve_loop
from taction.verification.engines.statespace.linearised.state_space import StateSpace
from taction.verification.engines.statespace.transients.radau import tableau

STAGES = 9
TABLE = tableau(STAGES)
SIGMA = TABLE.left.sum(axis=1)

Solve = Callable[[Any], Any]  # of a right-hand side, or of the columns of an array
Function = Callable[[Floats], Floats]
BEYOND = "an amplifier is beyond the range of floats in the initial state"
INSTANT = 1e-9  # of the fastest time constant: a step without charge
SETTLING_STEPS = 50
SETTLED = 1e-12  # of the largest unknown: a correction that ends the search for the start
STALLED = 1e-9  # the same of a correction that does not shrink, which is rounding
KEPT = 12  # binary orders of length beside the present one: steps that stay prepared
OFTEN = 4  # steps of one length after which matrices take the place of solves


class Amplifiers:
    """The amplifiers of boards of one kind, as functions of their inputs (R, m, s), V.

    Where there is one board, R may be any number.
    """

    def __init__(self, devices: Devices) -> None:
        self.kinds, self.gain, self.count = devices.kinds, gain_of(devices.kinds), devices.count
        self.u_scale = devices.u_scale[None, :, None]
        self.v_scale = devices.v_scale[None, :, None]

    @classmethod
    def joined(cls, several: Sequence[Amplifiers]) -> Amplifiers:
        """Return those of several boards together."""
        found = copy(several[0])
        found.u_scale = np.concatenate([each.u_scale for each in several])
        found.v_scale = np.concatenate([each.v_scale for each in several])
        return found

    def part(self, rows: Ints) -> Amplifiers:
        """Return those of some boards."""
        found = copy(self)
        found.u_scale, found.v_scale = self.u_scale[rows], self.v_scale[rows]
        return found

    def outputs(self, inputs: Floats) -> Floats:
        """Return the outputs, V; not finite beyond the range of floats."""
        return np.asarray(-self.u_scale * self._by_row(self.gain.outputs, inputs / self.v_scale))

    def slopes(self, inputs: Floats) -> Floats:
        """Return the slopes, V/V; not finite beyond the range of floats."""
        with np.errstate(over="ignore"):
            slope = self._by_row(self.gain.slope, inputs / self.v_scale)
            return np.asarray(-self.u_scale / self.v_scale * slope)

    @staticmethod
    def _by_row(function: Function, y: Floats) -> Floats:
        """Apply a function whose first axis is that of the amplifiers."""
        return function(y.transpose(1, 0, 2)).transpose(1, 0, 2)


class Step(Protocol):
    """Steps of one length, linearised at the amplifiers' `slopes`, V/V."""

    @property
    def slopes(self) -> Floats:
        """The slopes."""
        ...

    def free(self, rate: Floats) -> tuple[Floats, Any]:
        """Return the inputs' changes without remainders (m, s), and what `end` needs."""
        ...

    def response(self, remainder: Floats, parts: Any) -> Floats:
        """Return what remainders (m, s) add to the inputs, (m, s)."""
        ...

    def end(self, remainder: Floats, inputs: Floats, parts: Any) -> tuple[Floats, Floats]:
        """Return the changes of the state, and of inputs and watched nodes (m + K, s)."""
        ...


class Board(Protocol):
    """A board whose steps are prepared for themselves."""

    count: int  # of amplifiers

    def state(self, unknowns: Floats, /) -> Floats:
        """Return the state of all unknowns, (size,)."""
        ...

    def start(self, state: Floats, amplifiers: Amplifiers) -> Floats:
        """Return inputs and watched nodes just after the strain step, V, (m + K,).

        Raises
        ------
        EngineError
            An amplifier is beyond the range of floats.
        """
        ...

    def rate(self, state: Floats, outputs: Floats) -> Floats:
        """Return the right-hand side of the equations for outputs (m,) of the amplifiers."""
        ...

    def step(self, length: float, slopes: Floats) -> Step:
        """Prepare the steps of one length, s."""
        ...


class Steps(Protocol):
    """One step of each of several boards: as `Step`, with the boards on the first axis."""

    def free(self, rate: Any) -> tuple[Floats, Any]:
        """See `Step`."""
        ...

    def response(self, remainder: Floats, parts: Any) -> Floats:
        """See `Step`."""
        ...

    def end(self, remainder: Floats, inputs: Floats, parts: Any) -> tuple[Any, Floats]:
        """See `Step`."""
        ...

    def part(self, rows: Ints) -> Steps:
        """Return the steps of some boards."""
        ...


class Boards(Protocol):
    """What the integrator needs of its boards; arrays have the boards on the first axis."""

    factorisations: int  # so far, of each board

    def rate(self, state: Any, inputs: Floats, outputs: Floats) -> Any:
        """Return the right-hand sides for inputs and outputs (R, m) of the amplifiers."""
        ...

    def size(self, state: Any) -> Floats:
        """Return the largest voltage of each state, V, (R,)."""
        ...

    def step(self, length: Floats, slopes: Floats) -> Steps:
        """Prepare a step of each board, of lengths (R,), s, at slopes (R, m)."""
        ...

    def part(self, rows: Ints) -> Boards:
        """Return some of the boards."""
        ...


class Alone:
    """One board as `Boards`; its prepared steps are kept while the slopes stay."""

    def __init__(self, board: Board) -> None:
        self.board, self.slopes, self.prepared = board, np.zeros(0), dict[float, Step]()
        self.factorisations = 0

    def part(self, rows: Ints) -> Alone:
        """See `Boards`."""
        return self

    def rate(self, state: Floats, inputs: Floats, outputs: Floats) -> Floats:
        """See `Boards`."""
        return self.board.rate(state[0], outputs[0])[None]

    def size(self, state: Floats) -> Floats:
        """See `Boards`."""
        return np.asarray(np.abs(state).max(axis=1, initial=0.0))

    def step(self, length: Floats, slopes: Floats) -> AloneStep:
        """See `Boards`."""
        (wanted,) = length.tolist()
        if not np.array_equal(slopes[0], self.slopes):
            self.slopes, self.prepared = slopes[0], {}
        if wanted not in self.prepared:
            near = 2.0**KEPT
            self.prepared = {
                h: s for h, s in self.prepared.items() if h / near <= wanted <= h * near
            }
            self.prepared[wanted] = self.board.step(wanted, self.slopes)
            self.factorisations += len(TABLE.shifts)
        return AloneStep(self.prepared[wanted])


@dataclass(frozen=True, slots=True, eq=False)
class AloneStep:
    """A step of one board as `Steps`."""

    step: Step

    def part(self, rows: Ints) -> AloneStep:
        """See `Steps`."""
        return self

    def free(self, rate: Floats) -> tuple[Floats, Any]:
        """See `Steps`."""
        inputs, parts = self.step.free(rate[0])
        return inputs[None], parts

    def response(self, remainder: Floats, parts: Any) -> Floats:
        """See `Steps`."""
        return self.step.response(remainder[0], parts)[None]

    def end(self, remainder: Floats, inputs: Floats, parts: Any) -> tuple[Floats, Floats]:
        """See `Steps`."""
        change, watched = self.step.end(remainder[0], inputs[0], parts)
        return change[None], watched[None]


@dataclass(eq=False)
class StagesOfRate:
    """What the rate alone makes of a step: solves for the first few, then one product.

    The result has the changes of the (n,) states, then those of inputs and watched nodes of all
    stages.
    """

    rows: Floats
    solvers: list[Solve]
    used: int = 0

    def __call__(self, rate: Floats) -> Floats:
        """Return the result, n + s (m + K) values."""
        self.used += 1
        return self.matrix @ rate if self.used > OFTEN else self._solved(rate[:, None])[:, 0]

    @cached_property
    def matrix(self) -> Floats:
        """The results for unit rates."""
        return self._solved(np.eye(self.rows.shape[1]))

    def _solved(self, rates: Floats) -> Floats:
        pairs = zip(SIGMA.tolist(), self.solvers, strict=True)
        x = np.stack([solve(sigma * rates) for sigma, solve in pairs])
        stages = np.tensordot(TABLE.right, self.rows @ x, 1).real.reshape(-1, rates.shape[1])
        return np.concatenate([np.tensordot(TABLE.right[-1], x, 1).real, stages])


@dataclass(frozen=True, eq=False)
class DenseStep:
    """Steps of a small board, for which all that is linear is prepared as matrices.

    `core` is linearised at the board's own slopes; other slopes differ from it by `change`, which
    the inverses of size m of ``1 - core change`` take into account (Woodbury's formula).
    """

    slopes: Floats
    change: Floats  # slopes minus those of the core, (m,)
    stages: StagesOfRate
    last: Complexes  # (n, k m): changes of the states by nu
    core: Complexes  # (k, m, m): inputs of nu
    nodes: Complexes  # (k, K, m): watched nodes of nu
    inverse: Complexes | None = None  # (k, m, m)

    @cached_property
    def transfer(self) -> Complexes:
        """The inputs of nu, at the slopes, (k, m, m)."""
        return self.core if self.inverse is None else self.inverse @ self.core

    def free(self, rate: Floats) -> tuple[Floats, Any]:
        """See `Step`."""
        found = self.stages(rate)
        stages = found[len(rate) :].reshape(STAGES, -1)
        inputs = stages[:, : len(self.slopes)]
        if self.inverse is not None:
            spectral = (TABLE.left @ inputs)[:, :, None]
            inputs = (TABLE.right @ (self.inverse @ spectral)[:, :, 0]).real
        return inputs.T, (found[: len(rate)], stages)

    def response(self, remainder: Floats, parts: Any) -> Floats:
        """See `Step`."""
        spectral = (TABLE.left @ remainder.T)[:, :, None]
        return np.asarray((TABLE.right @ (self.transfer @ spectral)[:, :, 0]).real.T)

    def end(self, remainder: Floats, inputs: Floats, parts: Any) -> tuple[Floats, Floats]:
        """See `Step`."""
        end, stages = parts
        nu = TABLE.left @ (remainder + self.change[:, None] * inputs).T
        end = end + (self.last @ nu.ravel()).real
        if not self.nodes.shape[1]:
            return end, inputs
        watched = (TABLE.right @ (self.nodes @ nu[:, :, None])[:, :, 0]).real
        return end, np.concatenate([inputs, (stages[:, len(self.slopes) :] + watched).T])

    def at(self, slopes: Floats) -> DenseStep:
        """Return the same steps, linearised at other slopes."""
        change = slopes - self.slopes
        inverse = np.linalg.inv(np.eye(len(slopes)) - self.core * change).astype(np.complex128)
        return replace(self, slopes=slopes, change=change, inverse=inverse)


class DenseBoard:
    """A board by its states: ``x' = A x + B + E a``, ``y = C x + D + H a``.

    y are the inputs of the amplifiers, then other watched nodes. `slopes` are those at which steps
    are prepared: they should not exceed what an amplifier reaches, in which case its feedback would
    have to be subtracted.
    """

    def __init__(self, space: StateSpace, nodes: tuple[str, ...], slopes: Floats) -> None:
        places = space.descriptor.devices.input
        self.space, self.slopes, self.count = space, slopes, len(slopes)
        watched, direct = space.rows(nodes)
        self.A, self.B, self.E = space.A, space.B[:, :2].sum(axis=1), space.B[:, 2:]
        self.C = np.concatenate([space.C[places], watched])
        D = np.concatenate([space.D[places], direct])
        self.D, self.H = D[:, :2].sum(axis=1), D[:, 2:]
        loop = np.linalg.inv(np.eye(self.count) - self.H[: self.count] * slopes)
        closed = loop @ self.C[: self.count]
        beyond = np.eye(self.count) + slopes[:, None] * (loop @ self.H[: self.count])
        self.core = (
            self.A + (self.E * slopes) @ closed,
            self.E @ beyond,
            self.C + (self.H * slopes) @ closed,
            self.H @ beyond,
        )
        self.constant = self.B + (self.E * slopes) @ (loop @ self.D[: self.count])
        self.steps: dict[float, DenseStep] = {}

    def state(self, unknowns: Floats, /) -> Floats:
        """See `Board`."""
        return self.space.state_of(unknowns)

    def start(self, state: Floats, amplifiers: Amplifiers) -> Floats:
        """See `Board`."""
        m, watched = self.count, self.C @ state + self.D
        inputs, H = watched[:m], self.H[:m]
        if H.any():
            scale = amplifiers.v_scale[0, :, 0]
            loop = H * amplifiers.u_scale[0, :, 0] / scale[:, None]
            inputs = scale * solve_loop(loop, inputs / scale, amplifiers.gain)[0]
        outputs = amplifiers.outputs(inputs[None, :, None])[0, :, 0]
        if not np.all(np.isfinite(outputs)):
            raise EngineError(BEYOND)
        return np.append(inputs, (watched + self.H @ outputs)[m:])

    def rate(self, state: Floats, outputs: Floats) -> Floats:
        """See `Board`."""
        return np.asarray(self.A @ state + self.B + self.E @ outputs)

    def equations(self, amplifiers: Amplifiers) -> tuple[Function, Function, Function]:
        """Return rate, Jacobian and watched voltages of states, for other integrators.

        The voltages (P, m + K) are those of states (n, P).

        Raises
        ------
        EngineError
            The output of an amplifier acts on its own input without delay.
        """
        m = self.count
        if self.H[:m].any():
            raise EngineError("an amplifier feeds back on itself without delay")
        C, D = self.C[:m], self.D[:, None]

        def rate(x: Floats) -> Floats:
            inputs = (C @ x + self.D[:m])[None, :, None]
            return self.rate(x, amplifiers.outputs(inputs)[0, :, 0])

        def jacobian(x: Floats) -> Floats:
            slopes = amplifiers.slopes((C @ x + self.D[:m])[None, :, None])[0, :, 0]
            return np.asarray(self.A + (self.E * slopes) @ C)

        def watch(x: Floats) -> Floats:
            found = self.C @ x + D
            return np.asarray((found + self.H @ amplifiers.outputs(found[None, :m])[0]).T)

        return rate, jacobian, watch

    def step(self, length: float, slopes: Floats) -> DenseStep:
        """See `Board`."""
        if length not in self.steps:
            self.steps[length] = self._prepared(length)
        found = self.steps[length]
        return found if np.array_equal(slopes, self.slopes) else found.at(slopes)

    def factorise(self, shift: complex) -> Solve:
        """Return ``r -> x`` with ``(shift - A) x = r``, A with the slopes."""
        from scipy.linalg import get_lapack_funcs

        matrix = np.array(-self.core[0], np.complex128, order="F")
        matrix[np.diag_indices(len(matrix))] += shift
        routines: Any = get_lapack_funcs(("getrf", "getrs"), (matrix,))
        lu, pivots, singular = routines[0](matrix, overwrite_a=True)
        if singular:
            raise EngineError("the shift is an eigenvalue of the board")
        return lambda r: routines[1](lu, pivots, r)[0]

    def _prepared(self, length: float) -> DenseStep:
        m, (_, E, C, H) = self.count, self.core
        solvers = [self.factorise(shift / length) for shift in TABLE.shifts.tolist()]
        x = np.stack([solve(E) for solve in solvers])
        out = C @ x + H
        last = np.concatenate(list(TABLE.right[-1][:, None, None] * x), axis=1)
        stages = StagesOfRate(C, solvers)
        return DenseStep(self.slopes, np.zeros(m), stages, last, out[:, :m], out[:, m:])


@dataclass(eq=False)
class SolvedStep:
    """Steps of a large board: structured solves with the amplifiers' slopes in the cells."""

    board: LargeBoard
    slopes: Floats
    solvers: list[Solve]

    def _stages(self, rhs: Complexes) -> tuple[Floats, Complexes]:
        """Solve for right-hand sides (k, size); return inputs and watched nodes, and solutions."""
        x = [self.solvers[0](np.ascontiguousarray(rhs[0].real))]
        x += [solve(r) for solve, r in zip(self.solvers[1:], rhs[1:], strict=True)]
        solution = np.stack(x)
        return (TABLE.right @ solution[:, self.board.places]).real.T, solution

    def free(self, rate: Floats) -> tuple[Floats, Any]:
        """See `Step`."""
        stages, x = self._stages(SIGMA[:, None] * rate)
        return stages[: len(self.slopes)], [(stages, x)]

    def response(self, remainder: Floats, parts: Any) -> Floats:
        """See `Step`."""
        rhs = np.zeros((len(self.solvers), self.board.size), np.complex128)
        rhs[:, self.board.outputs] = TABLE.left @ remainder.T
        parts[1:] = [self._stages(rhs)]
        return np.asarray(parts[1][0][: len(self.slopes)])

    def end(self, remainder: Floats, inputs: Floats, parts: Any) -> tuple[Floats, Floats]:
        """See `Step`."""
        stages, x = parts[0]
        for more, y in parts[1:]:
            stages, x = stages + more, x + y
        return (TABLE.right[-1] @ x).real, stages


class LargeBoard:
    """A board by all its unknowns, which its structure solves for; see `DenseBoard`."""

    def __init__(self, board: LinearBoard, nodes: tuple[str, ...]) -> None:
        self.descriptor, devices = board.descriptor, board.descriptor.devices
        self.count, self.size = devices.count, board.descriptor.size
        self.structure, self.bare = board.structure, Structure(self.descriptor)
        self.drive, self.outputs = self.descriptor.drive(sources_on=True), devices.output
        watched = np.array([self.descriptor.place(name) for name in nodes], dtype=np.int64)
        self.places: Ints = np.concatenate([devices.input, watched])

    def state(self, unknowns: Floats, /) -> Floats:
        """See `Board`."""
        return unknowns

    def rate(self, state: Floats, outputs: Floats) -> Floats:
        """See `Board`."""
        rate = self.bare.stiffness_times(state) + self.drive
        rate[self.outputs] += outputs
        return rate

    def start(self, state: Floats, amplifiers: Amplifiers) -> Floats:
        """See `Board`; by Newton's method on a step in which no charge moves."""
        weight, m = self.structure.capacitance, self.count
        pull = abs(self.structure.local).max(axis=1).toarray().ravel()
        fastest = float((pull[weight > 0.0] / weight[weight > 0.0]).max(initial=1.0))
        now, before = state.copy(), math.inf
        for _ in range(SETTLING_STEPS):
            inputs = now[None, self.places[:m], None]
            slopes = amplifiers.slopes(inputs)[0, :, 0]
            outputs = amplifiers.outputs(inputs)[0, :, 0]
            if not (np.all(np.isfinite(slopes)) and np.all(np.isfinite(outputs))):
                break
            shift = fastest / INSTANT
            moved = shift * (self.structure.mass @ (now - state))
            structure = Structure(self.descriptor, slopes) if m else self.structure
            change = structure.factor(shift).solve(self.rate(now, outputs) - moved)
            now = now + change
            size = float(np.abs(change).max()) / max(float(np.abs(now).max()), 1e-300)
            # Below a correction that no longer shrinks there is only rounding.
            if size <= SETTLED or STALLED >= size >= 0.5 * before:
                return np.asarray(now[self.places])
            before = size
        raise EngineError(BEYOND)

    def step(self, length: float, slopes: Floats) -> SolvedStep:
        """See `Board`."""
        structure = Structure(self.descriptor, slopes) if self.count else self.structure
        solvers = [structure.solver(shift / length) for shift in TABLE.shifts.tolist()]
        return SolvedStep(self, slopes, solvers)
