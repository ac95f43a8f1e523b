"""Boards with behavioural sources: equilibrium and poles in Arb; transients: `collocation`.

The equations are those of the deck's text (`deck_equations`), and the functions of its B cards are
evaluated as they are printed there.
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
