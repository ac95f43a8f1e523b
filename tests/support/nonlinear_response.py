"""Boards with behavioural sources: equilibrium and poles in Arb, transients by collocation.

The equations are those of the deck's text (`deck_equations`), and the functions of its B cards are
evaluated as they are printed there.

Over a step the states are polynomials that satisfy ``x' = A x + B s`` at the points of Radau, with
the sources s where they read ``C x + D s`` at the same instant. All that is linear is solved once
for a length of step, so that Newton's method has the voltages that the sources read as its only
unknowns. A step is halved until the last coefficients of its polynomials are below the tolerance;
so it becomes short where a source has a break. Nothing here is the engine's.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import Any

import numpy as np
import scipy.linalg
from flint import acb, arb, arb_mat
from numpy.polynomial import legendre

from tests.support.deck_equations import StateEquations
from tests.support.exact_readings import eigen
from tests.support.readings import Samples

PER_STEP = 8  # points in each step of the integrator, where crossings are searched
NEWTON, HALVINGS = 200, 30
STRAIN_STEPS = 64
TINY = 1e-40  # of the inputs: the last step of Newton's method
Floats = np.ndarray
Number = Any  # float or arb
FUNCTIONS = ("exp", "ln", "sinh", "tanh", "abs", "min", "max")
SLOW = 0.2  # of the step before: Newton's method takes new slopes
ITERATIONS = 16  # steps of Newton's method before a step in time is halved
LEAST = 1e-9  # V: the least scale of the outputs
ROUNDING = 1e-14  # of the terms of a voltage
CLOSE = 1e-13  # of the largest voltage that a source reads: the last step of Newton's method
AT_REST = 1e-7  # of the largest voltages: distance from rest at which a run ends
AWAY = 1e9  # times the voltages at rest: the board runs away
MOST_STEPS = 60_000
CALM = 4  # steps of one length, after which twice the length is tried
INSIDE = np.arange(4) / 4  # of a step: where parts of it begin, as the readings see them


@dataclass(frozen=True)
class Dual:
    """A number and its derivative by the voltage that a source reads."""

    value: Number
    slope: Number

    def __add__(self, other: Dual) -> Dual:
        return Dual(self.value + other.value, self.slope + other.slope)

    def __sub__(self, other: Dual) -> Dual:
        return Dual(self.value - other.value, self.slope - other.slope)

    def __mul__(self, other: Dual) -> Dual:
        product = self.slope * other.value + self.value * other.slope
        return Dual(self.value * other.value, product)

    def __neg__(self) -> Dual:
        return Dual(-self.value, -self.slope)


def _call(name: str, x: Dual, *others: Dual) -> Dual:
    """Return a function of ngspice with its derivative."""
    if name in ("min", "max"):
        (other,) = others
        return _either(x.value < other.value if name == "min" else x.value > other.value, x, other)
    if name == "abs":
        return _either(x.value < 0, -x, x)
    value = _function("log" if name == "ln" else name, x.value)
    slopes: dict[str, Callable[[], Number]] = {
        "exp": lambda: value,
        "ln": lambda: 1 / x.value,
        "sinh": lambda: _function("cosh", x.value),
        "tanh": lambda: 1 - value * value,
    }
    return Dual(value, slopes[name]() * x.slope)


def _either(first: Any, x: Dual, other: Dual) -> Dual:
    """Return x where `first` is true, else `other`."""
    if isinstance(first, np.ndarray):
        return Dual(
            *(np.where(first, getattr(x, n), getattr(other, n)) for n in ("value", "slope"))
        )
    return x if first else other


def _function(name: str, x: Number) -> Number:
    return getattr(x, name)() if isinstance(x, arb) else getattr(np, name)(x)


class _Reads(ast.NodeTransformer):
    """Write what the source reads as x, and every number as a call."""

    def visit_Call(self, node: ast.Call) -> ast.expr:
        self.generic_visit(node)
        reads = isinstance(node.func, ast.Name) and node.func.id == "V"
        return ast.Name("x", ast.Load()) if reads else node

    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        return ast.Call(ast.Name("number", ast.Load()), [node], [])


@lru_cache
def _dual_of(expression: str) -> Callable[[Dual], Dual]:
    body = _Reads().visit(ast.parse(f"lambda x: {expression}", mode="eval"))
    code = compile(ast.fix_missing_locations(body), "<B card>", "eval")
    functions = {name: partial(_call, name) for name in FUNCTIONS}
    number = {"number": lambda value: Dual(value, 0.0)}
    found: Callable[[Dual], Dual] = eval(code, {**functions, **number, "__builtins__": {}})  # noqa: S307
    return found


def source_value(expression: str, volts: Number) -> Dual:
    """Return a B card's voltage and its derivative where the source reads `volts`."""
    return _dual_of(expression)(Dual(volts, volts * 0 + 1))


def read_from(expressions: list[str]) -> Callable[[Floats], tuple[Floats, Floats]]:
    """Return values and slopes of B cards as a function of the voltages (P, m) that they read."""
    groups: dict[str, list[int]] = {}
    for k, text in enumerate(expressions):
        groups.setdefault(re.sub(r"V\([\w.]+\)", "V(x)", text), []).append(k)

    def read(w: Floats) -> tuple[Floats, Floats]:
        value, slope = np.empty_like(w), np.empty_like(w)
        for text, columns in groups.items():
            with np.errstate(over="ignore"):
                dual = source_value(text, w[:, columns])
            value[:, columns], slope[:, columns] = dual.value, dual.slope
        return value, slope

    return read


class DivergenceError(Exception):
    """The transient leaves every bound."""


@dataclass(frozen=True, eq=False)
class Board:
    """One connected board with m behavioural sources."""

    equations: StateEquations

    @cached_property
    def doubles(self) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """A, B, C, D in double precision for balanced states x, and z / x (n,)."""
        e = self.equations
        A, B, C, D = (array_of(matrix) for matrix in (e.A, e.B, e.C, e.D))
        balanced, scale = scipy.linalg.matrix_balance(A, permute=False, separate=True)
        return balanced, B / scale[0][:, None], C * scale[0], D, scale[0]

    @property
    def outputs(self) -> int:
        return len(self.equations.outputs)

    def equilibrium_by_steps(self) -> tuple[arb_mat, arb_mat, list[arb]]:
        """Return the same as `equilibrium`, with the strain brought in by `STRAIN_STEPS` steps.

        Newton's method then starts close to where op-amps have reached their limits.
        """
        inputs = [0.0] * len(self.equations.sources)
        for step in range(STRAIN_STEPS + 1):
            found = self.equilibrium(step / STRAIN_STEPS, inputs)
            inputs = [float(found[1][self.outputs + i, 0]) for i in range(len(inputs))]
        return found

    def equilibrium(self, strain: float, inputs: list[float]) -> tuple[arb_mat, arb_mat, list[arb]]:
        """Return state, outputs, and slopes of the sources at rest: Newton's method from `inputs`.

        A step that makes the residual larger is halved.
        """
        e, m = self.equations, len(self.equations.sources)
        static = e.D - e.C * e.A.solve(e.B)  # from signals to outputs and inputs, at rest
        x, found, off = [arb(v) for v in inputs], [], arb_mat(m, 1)

        def residual(x: list[arb]) -> tuple[list[Dual], arb_mat, arb_mat]:
            found = self.values(x)
            signals = arb_mat([[1], [strain], *([dual.value] for dual in found)])
            ends = static * signals
            return found, signals, arb_mat([[x[i] - ends[self.outputs + i, 0]] for i in range(m)])

        found, signals, off = residual(x)
        for _ in range(NEWTON):
            slopes = arb_mat(m, m)
            for i in range(m):
                for j in range(m):
                    slopes[i, j] = -static[self.outputs + i, 2 + j] * found[j].slope
                slopes[i, i] += 1
            step = slopes.solve(off).mid()
            for _ in range(HALVINGS):
                tried = [(x[i] - step[i, 0]).mid() for i in range(m)]
                found, signals, after = residual(tried)
                if _size(after) < _size(off) or _size(step) <= TINY * _size(tried):
                    break
                step = step * arb(0.5)
            x, off = tried, after
            if _size(step) <= TINY * _size(x):
                rest = e.A.solve(-(e.B * signals))
                return rest, e.C * rest + e.D * signals, [dual.slope for dual in found]
        raise AssertionError("Newton's method finds no equilibrium")

    def values(self, inputs: Iterable[Number]) -> list[Dual]:
        """Return the voltages of the sources where they read `inputs`."""
        sources = self.equations.sources
        return [source_value(str(p.value), x) for p, x in zip(sources, inputs, strict=True)]

    def poles(self, slopes: list[arb]) -> list[acb]:
        """Return the poles where the sources have these slopes."""
        e, k = self.equations, self.outputs
        A = arb_mat(e.A.tolist())
        for i in range(A.nrows()):
            for j in range(A.nrows()):
                terms = (e.B[i, 2 + p] * slope * e.C[k + p, j] for p, slope in enumerate(slopes))
                A[i, j] += sum(terms, arb(0))
        return eigen(A)[0]


@dataclass(frozen=True, eq=False)
class Transient:
    """Integrated outputs: the instants of the steps, s, and a function from (P,) to (P, k), V."""

    steps: Floats
    outputs: Callable[[Floats], Floats]

    def samples(self, ends: list[tuple[float, float]]) -> list[Samples]:
        """Return the samples of channels with these targets and errors at the equilibrium."""
        steps, targets = self.steps, [target for target, _ in ends]
        inner = np.linspace(0.0, 1.0, PER_STEP + 1)[:-1]
        time = (steps[:-1, None] + np.diff(steps)[:, None] * inner).ravel()
        time = np.append(time, steps[-1])
        errors = self.outputs(time) - np.array(targets)

        def function(n: int) -> Callable[[float], float]:
            return lambda t: float(self.outputs(np.array([t]))[0, n] - targets[n])

        return [Samples(time, errors[:, n], function(n), end) for n, (_, end) in enumerate(ends)]


def array_of(matrix: arb_mat) -> Floats:
    return np.array([[float(x) for x in row] for row in matrix.tolist()]).reshape(
        matrix.nrows(), matrix.ncols()
    )


def _size(values: arb_mat | list[arb]) -> float:
    entries = values.entries() if isinstance(values, arb_mat) else values
    return max((float(abs(x.mid())) for x in entries), default=0.0)


class UnsettledError(ArithmeticError):
    """The board neither comes to rest nor oscillates evenly in `MOST_STEPS` steps."""


@dataclass(frozen=True, eq=False)
class Radau:
    """The points of a step of length 1, with its start, and what follows from them."""

    order: int

    @cached_property
    def points(self) -> Floats:
        """Return 0 and the roots of ``P_s - P_(s-1)``, from -1..1 to 0..1, (s + 1,)."""
        ends = np.zeros(self.order + 1)
        ends[-2:] = -1.0, 1.0
        return np.concatenate([[0.0], (np.sort(legendre.legroots(ends)) + 1.0) / 2.0])

    @cached_property
    def integral(self) -> Floats:
        """Return the integrals from 0 to each point of the rates at the points, (s, s)."""
        at = 2.0 * self.points[1:] - 1.0
        basis = [legendre.legint(row, lbnd=-1) for row in np.eye(self.order)]
        sums = np.array([legendre.legval(at, row) for row in basis]).T / 2.0
        return np.asarray(sums @ np.linalg.inv(legendre.legvander(at, self.order - 1)))

    @cached_property
    def coefficients(self) -> Floats:
        """Return the Legendre coefficients of what has given values at the points."""
        return np.linalg.inv(legendre.legvander(2.0 * self.points - 1.0, self.order))

    def between(self, share: Floats) -> Floats:
        """Return the values at shares (P,) of the step, of values at the points, (P, s + 1)."""
        return np.asarray(legendre.legvander(2.0 * share - 1.0, self.order) @ self.coefficients)


class Collocation:
    """The equations of a board with ``n`` states and m sources, in double precision."""

    def __init__(self, board: Board, order: int) -> None:
        self.A, self.B, self.C, self.D, self.scale = board.doubles
        self.outputs, self.radau, self.board = board.outputs, Radau(order), board
        self.n, self.m = len(self.A), self.B.shape[1] - 2
        self.drive, self.level = self.B[:, :2].sum(axis=1), self.D[:, :2].sum(axis=1)
        self.read = read_from([str(part.value) for part in board.equations.sources])
        self._inverse = np.zeros(0), np.zeros(0)
        self._of_length: dict[float, tuple[Floats, ...]] = {}

    def of_length(self, h: float) -> tuple[Floats, ...]:
        """Return what is linear of a step: states by the first ones, alone, and by the sources."""
        if h not in self._of_length:
            s, Q = self.radau.order, h * self.radau.integral
            left = np.eye(s * self.n) - np.kron(Q, self.A)
            first = np.kron(np.ones((s, 1)), np.eye(self.n))
            alone = np.kron(Q.sum(axis=1), self.drive)[:, None]
            solved = np.linalg.solve(left, np.hstack([first, alone, np.kron(Q, self.B[:, 2:])]))
            by_first, alone, by_source = np.split(solved, [self.n, self.n + 1], axis=1)
            C, D = self.C[self.outputs :], self.D[self.outputs :, 2:]
            reads = np.kron(np.eye(s), C) @ by_source + np.kron(np.eye(s), D)
            self._of_length[h] = by_first, alone[:, 0], by_source, reads
        return self._of_length[h]

    def first_inputs(self, x: Floats) -> Floats:
        """Return what the sources read at states x, V, (m,)."""
        k = self.outputs
        free, D = self.C[k:] @ x + self.level[k:], self.D[k:, 2:]
        found = self._inputs(free, D, free, 200)
        if found is None:
            raise UnsettledError("no voltages of the sources at the start")
        return found

    def _inputs(self, free: Floats, by: Floats, w: Floats, most: int) -> Floats | None:
        """Solve ``w = free + by g(w)`` from w by Newton's method; None if it does not end.

        The last inverse serves as long as each step is much smaller than the one before.
        """
        before, fits = np.inf, self._inverse[0] is by
        for _ in range(most):
            value, slope = self.read(w.reshape(-1, self.m))
            if not fits:
                try:
                    self._inverse = by, np.linalg.inv(np.eye(len(w)) - by * slope.ravel())
                except np.linalg.LinAlgError:
                    return None
            step = self._inverse[1] @ (w - free - by @ value.ravel())
            w, size = w - step, float(np.abs(step).max(initial=0.0))
            if not np.isfinite(size):
                return None
            if size <= CLOSE * np.abs(w).max(initial=1e-30):
                return w
            before, fits = size, size <= SLOW * before
        return None

    def step(self, x: Floats, w: Floats, h: float) -> tuple[Floats, Floats] | None:
        """Return states (s + 1, n) and inputs (s + 1, m) at the points of a step of length h."""
        by_first, alone, by_source, reads = self.of_length(h)
        s, k = self.radau.order, self.outputs
        X = by_first @ x + alone
        free = (X.reshape(s, -1) @ self.C[k:].T + self.level[k:]).ravel()
        W = self._inputs(free, reads, np.tile(w, s), ITERATIONS)
        if W is None:
            return None
        X = (X + by_source @ self.read(W.reshape(s, -1))[0].ravel()).reshape(s, -1)
        return np.vstack([x, X]), np.vstack([w, W.reshape(s, -1)])

    def seen(self, x: Floats, w: Floats) -> tuple[Floats, Floats]:
        """Return outputs and inputs at states (P, n) and inputs (P, m), V, and their terms."""
        k, value, D = self.outputs, self.read(w)[0], self.D[:, 2:]
        y = x @ self.C[:k].T + self.level[:k] + value @ D[:k].T
        terms = np.abs(x).max(axis=0) @ np.abs(self.C).T + np.abs(value).max(axis=0) @ np.abs(D).T
        return np.hstack([y, w]), terms


def integrate(
    board: Board, start: arb_mat, rest: arb_mat, stop: float, order: int, tolerance: float
) -> Transient:
    """Integrate from `start` until the board rests at `rest`, at the earliest at `stop`.

    Raises
    ------
    DivergenceError
        The board runs away, or oscillates for ever.
    UnsettledError
        It does not come to rest in `MOST_STEPS` steps.
    """
    c = Collocation(board, order)
    k, radau = c.outputs, c.radau
    x, last = (array_of(each)[:, 0] / c.scale for each in (start, rest))
    w, w_last = c.first_inputs(x), c.first_inputs(last)
    ends = c.seen(last[None], w_last[None])[0][0]
    largest = np.concatenate([np.full(k, np.abs(ends[:k]).max(initial=LEAST)), 0.0 * w_last])
    t, calm, exponent = 0.0, 1, int(np.floor(-np.log2(np.abs(c.A).max() + 1.0 / stop)))
    begins, kept, away = list[float](), list[tuple[Floats, Floats]](), list[float]()
    while len(begins) < MOST_STEPS:
        found = c.step(x, w, 2.0**exponent)
        if found is not None:
            seen, terms = c.seen(*found)
            now = np.maximum(largest, np.abs(seen).max(axis=0))
            tail = np.abs(radau.coefficients[-2:] @ seen).max(axis=0)
            terms[k:] = np.maximum(terms[k:], 10.0 * np.abs(seen).max())  # differences of them
            room = now + ROUNDING / tolerance * terms
            worst = float((tail / np.maximum(room, 1e-300)).max())
        if found is None or worst > tolerance:
            exponent, calm = exponent - 1, 1
            continue
        begins.append(t)
        kept.append(found)
        x, w, largest, t = found[0][-1], found[1][-1], now, t + 2.0**exponent
        far = np.abs(seen - ends).max(axis=0)
        away.append(float(far[:k].max()))
        wide = np.concatenate([largest[:k], np.abs(w_last) + AT_REST * largest[k:]])
        if t >= stop and (far <= AT_REST * np.maximum(wide, 1e-9 * largest.max())).all():
            return _transient(c, begins, kept, t)
        if np.abs(seen).max() > AWAY * max(np.abs(ends).max(), 1.0):
            raise DivergenceError("the board runs away")
        calm = 0 if calm == CALM or worst < tolerance / 2.0 ** (order - 1) else calm + 1
        exponent += calm == 0
    quarter = np.searchsorted(begins, [0.25 * t, 0.5 * t, 0.75 * t]).tolist()
    if max(away[quarter[2] :]) >= 0.99 * max(away[quarter[0] : quarter[1]]):
        raise DivergenceError("the board oscillates")
    raise UnsettledError(f"not at rest after {MOST_STEPS} steps")


def _transient(
    c: Collocation, begins: list[float], kept: list[tuple[Floats, Floats]], end: float
) -> Transient:
    """Return the outputs as a function of time."""
    edges = np.array([*begins, end])
    states, inputs = (np.array(each) for each in zip(*kept, strict=True))

    def outputs(t: Floats) -> Floats:
        at = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, len(begins) - 1)
        rows = c.radau.between((t - edges[at]) / (edges[at + 1] - edges[at]))
        x, w = (np.einsum("ps,psn->pn", rows, each[at]) for each in (states, inputs))
        return c.seen(x, w)[0][:, : c.outputs]

    parts = (edges[:-1, None] + np.diff(edges)[:, None] * INSIDE).ravel()
    return Transient(np.append(parts, end), outputs)
