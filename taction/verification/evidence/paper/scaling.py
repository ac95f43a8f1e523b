"""What the number of channels changes: the network's time, a computer's, and the condition of T."""

from __future__ import annotations

import math
import timeit
from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.linalg import matmul_toeplitz
from scipy.sparse.linalg import LinearOperator, cg

from taction.netlist_gen.scene.inverse_problem import kernel
from taction.system.array_types import Floats
from taction.system.charts import SERIES, Axis, Curve
from taction.system.errors import SolverError
from taction.system.reading_definitions import RISE_LEVELS
from taction.verification.evidence.paper.findings import Chapter, Finding, chart, finding, weigh
from taction.verification.evidence.paper.tactile import Geometry, entropy, unit_network
from taction.verification.reference.ideal_answer import ideal_linear
from taction.verification.reference.problem import Problem
from taction.verification.reference.solve import solve

SIZES, QUICK = (7, 25, 51, 101, 201, 401), (7, 201, 401)
SPAN = 6.0  # depths
MU = 10.0  # 1 / (s R)
SENSORS, RATE = 25, 1e5  # the paper's comparison: sensors, solutions a second
LARGE, QUICK_LARGE = (16_403, 147_623), (5_468, 49_208)
"""Sizes of the Toeplitz solves: 2 N - 1 has the factors 3 and 5 alone, so its FFT is fast."""
TRIES = 5
RESIDUAL = 1e-6  # relative, of the normal equations
RATIOS, QUICK_RATIOS = (2.0, 4.0, 8.0, 10.0), 2  # depth / spacing; at the last cond(T) is 3e11
BEYOND = 20.0  # a ratio whose condition number double precision, up to some 1e16, cannot hold
WIDE, NARROW = 20.0, 6.0  # depths; the ends of a wide range matter little

Times = tuple[list[float], list[float]]  # rise time of the centre, 1 % settling time; R C


def speed(quick: bool) -> Chapter:
    """Judge the comparison of analog and digital."""
    sizes = QUICK if quick else SIZES
    rise, settling = plain = _times(sizes, weighted=False)
    weighted = _times(sizes, weighted=True)
    falling = [bool(np.all(np.diff(times) < 0.0)) for times in (*plain, *weighted)]
    decreases = finding(
        "time-over-channels",
        weigh(all(falling), falling[0]),
        rise_first=rise[0],
        rise_last=rise[-1],
        settling_first=settling[0],
        settling_last=settling[-1],
        mu=MU,
        sizes=sizes,
        plain=plain,
        weighted=weighted,
    )
    rate = SENSORS**2 * RATE
    operations = finding(
        "operations", weigh(rate == 62.5e6), operations_per_second=rate, millions=rate / 1e6
    )
    text = (
        "More channels on the same range: without weights the rise time falls, and the settling"
        f" time up to N = {sizes[int(np.argmin(settling))]}; with weights neither does."
    )
    drawn = chart(
        "analog time over channels",
        text,
        Axis("channels N", scale="log"),
        Axis("time (RC)", scale="log"),
        Curve(sizes, rise, "rise of the centre", mark="circle"),
        Curve(sizes, settling, "1 % settling", SERIES[1], mark="square"),
        Curve(sizes, weighted[0], "rise, T times the spacing", line="dot", mark="circle"),
        Curve(sizes, weighted[1], "settling, T times the spacing", SERIES[1], "dot", "square"),
    )
    return Chapter((decreases, operations, _impossible(), _quadratic(quick)), (drawn,))


def _times(sizes: tuple[int, ...], *, weighted: bool) -> Times:
    """Return rise time of the centre and 1 % settling time for each size, in R C."""
    rise, settling = [], []
    for N in sizes:
        geometry = Geometry(N, SPAN)
        T = geometry.matrix * (geometry.spacing if weighted else 1.0)
        network = unit_network(T, T @ geometry.stress, MU, "linear")
        response = ideal_linear(network, np.zeros(N))
        shares = response.outputs(response.time)[:, N // 2] / response.target[N // 2]
        reached = np.interp(RISE_LEVELS, np.maximum.accumulate(shares), response.time)
        rise.append(float(np.diff(reached)[0]))
        settling.append(response.settling_time())
    return rise, settling


def _impossible() -> Finding:
    geometry = Geometry(SENSORS, SPAN)
    T, strain = geometry.matrix, geometry.strain(1)
    inverse = np.linalg.solve(T.T @ T + np.eye(SENSORS), T.T)
    product = _best(lambda: inverse @ strain, repeats=1000)
    return finding(
        "digital-impossible",
        weigh(product > 1.0 / RATE),
        product=product,
        linear_solve=_best(lambda: solve(Problem(T, strain, 1.0))),
        entropy_solve=_best(lambda: entropy(T, strain, 1.0)),
        sensors=SENSORS,
        tries=TRIES,
    )


def _quadratic(quick: bool) -> Finding:
    times, sizes = [], QUICK_LARGE if quick else LARGE
    for N in sizes:
        column = kernel(0.2 * np.arange(N, dtype=np.float64), depth=1.0, modulus=1.0, poisson=0.5)
        strain = np.random.default_rng(1).normal(size=N)
        times.append(_best(partial(tikhonov, column, strain, 1.0), tries=3))
    exponent = math.log(times[1] / times[0]) / math.log(sizes[1] / sizes[0])
    found = {"exponent": exponent, "seconds": times[1], "sizes": sizes, "times": times}
    return finding("digital-quadratic", weigh(exponent > 1.8), **found)


def tikhonov(column: Floats, strain: Floats, lam: float) -> Floats:
    """Solve ``(T^2 + lam) u = T eps`` for a symmetric Toeplitz T that is never formed, to 1e-6."""
    product = partial(matmul_toeplitz, column)  # of T with a vector, by fast Fourier transforms
    size = len(column)
    normal = LinearOperator((size, size), lambda u: product(product(u)) + lam * u, dtype=np.float64)
    u, status = cg(normal, product(strain), rtol=RESIDUAL)
    if status:
        raise SolverError(f"conjugate gradients did not converge for {size} channels")
    return np.asarray(u, dtype=np.float64)


def _best(run: Callable[[], object], *, repeats: int = 1, tries: int = TRIES) -> float:
    """Return the least time of one run, s."""
    return min(timeit.repeat(run, repeat=tries, number=repeats)) / repeats


def conditioning(quick: bool) -> Chapter:
    """Judge how the condition number grows with the number of channels (appendix A)."""
    ratios = RATIOS[:QUICK_RATIOS] if quick else RATIOS
    wide, narrow = ([condition_number(r, span) for r in ratios] for span in (WIDE, NARROW))
    off = max(abs(a / asymptotic(ratio) - 1.0) for a, ratio in zip(wide, ratios, strict=True))
    grows = bool(np.all(np.diff([wide, narrow]) > 0.0))
    result = finding(
        "ill-conditioned",
        weigh(grows and off <= 0.1),
        **{f"cond_{ratio:g}": value for ratio, value in zip(ratios, wide, strict=True)},
        ratios=ratios,
        span=WIDE,
        conditions=wide,
        off=off,
        beyond=asymptotic(BEYOND),
        in_double=condition_number(BEYOND, NARROW),
    )
    return Chapter((result,))


def asymptotic(ratio: float) -> float:
    """Return the condition number for a wide range of y and `ratio` = depth over spacing.

    The sampled kernel's spectrum is largest at ``w = 1/x``, least at ``pi/dy``, where aliases meet.
    """
    return math.exp(math.pi * ratio) / (2.0 * math.e * math.pi * ratio)


def condition_number(ratio: float, span: float) -> float:
    """Return the condition number of T at `ratio` = depth over spacing, over `span` depths."""
    return float(np.linalg.cond(Geometry(round(span * ratio) + 1, span).matrix))
