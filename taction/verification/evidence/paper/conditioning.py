"""Appendix A: how ill-conditioned the discretised problem is, also beyond double precision.

The transform of kernel (19), ``3/2 x |w| exp(-x |w|)``, is positive, so T is positive definite and
Toeplitz: Levinson's recursion solves with it in N² steps. In double-double arithmetic (106 bits)
condition numbers up to about 1e28 are answered; ``numpy.linalg.cond`` stops near 1e18.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import toeplitz

from taction.system.errors import SolverError
from taction.verification.evidence.paper.findings import Chapter, finding, weigh
from taction.verification.evidence.paper.pictures import Panel, Picture, curve
from taction.verification.evidence.paper.tactile import Geometry
from taction.verification.reference.doubledouble import ONE, DoubleDouble

RATIOS = (2.0, 4.0, 8.0, 10.0, 20.0)  # depth / spacing
QUICK = 2  # of `RATIOS` in a quick run
WIDE = 20.0  # depths: wide enough that the ends of the range matter little
NARROW = 6.0  # depths
CLOSE = 0.1
LARGEST = 1e28
STEPS = 60
CONVERGED = 1e-6


def conditioning(quick: bool) -> Chapter:
    """Judge how the condition number grows with the number of channels."""
    ratios = RATIOS[:QUICK] if quick else RATIOS
    wide, narrow = ([condition_number(r, span) for r in ratios] for span in (WIDE, NARROW))
    off = [abs(a / asymptotic(ratio) - 1.0) for a, ratio in zip(wide, ratios, strict=True)]
    in_double = [
        float(np.linalg.cond(Geometry(round(NARROW * ratio) + 1, NARROW).matrix))
        for ratio in RATIOS
    ]
    grows = bool(np.all(np.diff([wide, narrow]) > 0.0))
    result = finding(
        "ill-conditioned",
        {f"cond_{ratio:g}": value for ratio, value in zip(ratios, wide, strict=True)},
        weigh(grows and max(off) <= CLOSE),
        ratios=ratios,
        span=WIDE,
        conditions=wide,
        off=max(off),
        in_double=in_double[-1],
    )
    dense = np.linspace(2.0, 20.0, 50).tolist()
    lines = (
        curve(ratios, wide, f"range of {WIDE:g} depths", "C0o"),
        curve(ratios, narrow, f"range of {NARROW:g} depths", "C1s"),
        curve(RATIOS, in_double, f"{NARROW:g} depths, in double precision", "C3x"),
        curve(dense, [asymptotic(r) for r in dense], "exp(pi r) / (2 e pi r)", "k-"),
    )
    panel = Panel("condition number of T", "r = depth / spacing", "cond(T)", lines, logs="y")
    text = "A finer grid on the same range: the condition number grows exponentially."
    return Chapter((result,), (Picture("condition", text, (panel,)),))


def asymptotic(ratio: float) -> float:
    """Return the condition number for a wide range of y and `ratio` = depth over spacing.

    The largest value of the sampled kernel's spectrum is at ``w = 1/x``, the smallest at the
    Nyquist frequency ``pi/dy``, where two aliases meet.
    """
    return math.exp(math.pi * ratio) / (2.0 * math.e * math.pi * ratio)


def condition_number(ratio: float, span: float) -> float:
    """Return the condition number of T at `ratio` = depth over spacing, over `span` depths.

    Raises
    ------
    SolverError
        Above `LARGEST`, or the iteration does not converge.
    """
    N = round(span * ratio) + 1
    place = DoubleDouble.of(np.arange(N, dtype=np.float64)) / DoubleDouble.of(np.full(N, ratio))
    square = place * place
    below = ONE + square
    column = (ONE - square) / (below * below)
    largest = float(np.linalg.eigvalsh(toeplitz(column.hi))[-1])
    condition = largest / _smallest(column)
    if not 0.0 < condition <= LARGEST:
        raise SolverError(f"cond(T) is about {condition:.1g}, beyond double-double arithmetic")
    return condition


def _smallest(column: DoubleDouble) -> float:
    """Return the smallest eigenvalue by inverse iteration from its expected eigenvector."""
    N = len(column.hi)
    k = np.arange(N)
    x = np.where(k % 2 == 0, 1.0, -1.0) * np.sin(np.pi * (k + 1) / (N + 1))
    before = math.inf
    for _ in range(STEPS):
        x = x / np.linalg.norm(x)
        y = _levinson(column, DoubleDouble.of(x)).hi
        value = float(x @ y) / float(y @ y)
        if abs(value - before) <= CONVERGED * abs(value):
            return value
        before, x = value, y
    raise SolverError("inverse iteration did not converge")


def _levinson(column: DoubleDouble, b: DoubleDouble) -> DoubleDouble:
    """Solve the symmetric Toeplitz system of first column `column` (N,)."""
    scale = _part(column, slice(0, 1))
    forward = ONE / scale
    x = _part(b, slice(0, 1)) / scale
    for n in range(1, len(column.hi)):
        reverse = _part(column, slice(n, 0, -1))
        ahead = _dot(reverse, forward)
        weight = ONE / (ONE - ahead * ahead)
        longer = _padded(forward)
        forward = (longer - _mirrored(longer) * ahead) * weight
        miss = _part(b, slice(n, n + 1)) - _dot(reverse, x)
        x = _padded(x) + _mirrored(forward) * miss
    return x


def _part(a: DoubleDouble, which: slice) -> DoubleDouble:
    return DoubleDouble(a.hi[which], a.lo[which])


def _mirrored(a: DoubleDouble) -> DoubleDouble:
    return _part(a, slice(None, None, -1))


def _padded(a: DoubleDouble, zeros: int = 1) -> DoubleDouble:
    return DoubleDouble(np.pad(a.hi, (0, zeros)), np.pad(a.lo, (0, zeros)))


def _dot(a: DoubleDouble, b: DoubleDouble) -> DoubleDouble:
    """Return the scalar product, shape (1,), by adding the halves to each other."""
    total = a * b
    while len(total.hi) > 1:
        half = (len(total.hi) + 1) // 2
        first, rest = _part(total, slice(0, half)), _part(total, slice(half, None))
        total = first + _padded(rest, half - len(rest.hi))
    return total
