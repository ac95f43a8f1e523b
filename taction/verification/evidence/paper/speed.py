"""Section 6: convergence time against the number of channels, and the digital comparison."""

from __future__ import annotations

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
from taction.verification.evidence.paper.findings import Chapter, Finding, finding, weigh
from taction.verification.evidence.paper.pictures import Picture, panel, picture
from taction.verification.evidence.paper.tactile import Geometry, entropy, unit_network
from taction.verification.reference.dynamics import ideal_linear
from taction.verification.reference.problem import Problem
from taction.verification.reference.solve import solve

SIZES = (7, 25, 51, 101, 201, 401)
QUICK = (7, 201, 401)
SPAN = 6.0  # depths
AXIS = (0.02, 8.0)  # R C, of both panels
MU = 10.0  # 1 / (s R)
SENSORS, RATE = 25, 1e5  # the paper's comparison: sensors, solutions a second
BUDGET = 1.0 / RATE  # s
LARGE, QUICK_LARGE = (16_403, 147_623), (5_468, 49_208)
"""Sizes of the Toeplitz solves: 2 N - 1 has the factors 3 and 5 alone, so its FFT is fast."""
TRIES = 5
RESIDUAL = 1e-6  # relative, of the normal equations

Times = tuple[list[float], list[float]]  # rise time of the centre, 1 % settling time; R C


def speed(quick: bool) -> Chapter:
    """Judge the comparison of analog and digital."""
    sizes = QUICK if quick else SIZES
    plain, weighted = _times(sizes, weighted=False), _times(sizes, weighted=True)
    findings = (_decreases(sizes, plain, weighted), _arithmetic(), _impossible(), _quadratic(quick))
    return Chapter(findings, (_picture(sizes, plain, weighted),))


def _times(sizes: tuple[int, ...], *, weighted: bool) -> Times:
    """Return rise time of the centre and 1 % settling time for each size, in R C."""
    rise, settling = [], []
    for N in sizes:
        geometry = Geometry(N, SPAN)
        T = geometry.matrix * (geometry.spacing if weighted else 1.0)
        network = unit_network(T, T @ geometry.stress, MU, "linear")
        response = ideal_linear(network, np.zeros(N))
        rise.append(response.rise_time(N // 2))
        settling.append(response.settling_time())
    return rise, settling


def _decreases(sizes: tuple[int, ...], plain: Times, weighted: Times) -> Finding:
    falling = [bool(np.all(np.diff(times) < 0.0)) for times in (*plain, *weighted)]
    return finding(
        "time-over-channels",
        {
            f"{name}_{place}": times[k]
            for name, times in zip(("rise", "settling"), plain, strict=True)
            for place, k in (("first", 0), ("last", -1))
        },
        weigh(all(falling), falling[0]),
        mu=MU,
        sizes=sizes,
        plain=plain,
        weighted=weighted,
    )


def _arithmetic() -> Finding:
    operations = SENSORS**2 * RATE
    values = {"operations_per_second": operations}
    return finding("operations", values, weigh(operations == 62.5e6), millions=operations / 1e6)


def _impossible() -> Finding:
    geometry = Geometry(SENSORS, SPAN)
    T, strain = geometry.matrix, geometry.strain(1)
    inverse = np.linalg.solve(T.T @ T + np.eye(SENSORS), T.T)
    values = {
        "product": _best(lambda: inverse @ strain, repeats=1000),
        "linear_solve": _best(lambda: solve(Problem(T, strain, 1.0))),
        "entropy_solve": _best(lambda: entropy(T, strain, 1.0)),
    }
    outcome = weigh(values["product"] > BUDGET)
    return finding("digital-impossible", values, outcome, sensors=SENSORS, tries=TRIES)


def _quadratic(quick: bool) -> Finding:
    times, sizes = [], QUICK_LARGE if quick else LARGE
    for N in sizes:
        column = kernel(0.2 * np.arange(N, dtype=np.float64), depth=1.0, modulus=1.0, poisson=0.5)
        strain = np.random.default_rng(1).normal(size=N)
        times.append(_best(partial(tikhonov, column, strain, 1.0), tries=3))
    exponent = float(np.log(times[1] / times[0]) / np.log(sizes[1] / sizes[0]))
    values = {"exponent": exponent, "seconds": times[1]}
    return finding("digital-quadratic", values, weigh(exponent > 1.8), sizes=sizes, times=times)


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


def _picture(sizes: tuple[int, ...], plain: Times, weighted: Times) -> Picture:
    axes = Axis("channels N", scale="log"), Axis("time (RC)", scale="log", limits=AXIS)
    charts = tuple(
        panel(
            title,
            *axes,
            Curve(sizes, rise, "rise of the centre", mark="circle"),
            Curve(sizes, settling, "1 % settling", SERIES[1], mark="square"),
        )
        for title, (rise, settling) in (
            ("T as printed, without weights", plain),
            ("T times the spacing", weighted),
        )
    )
    fastest = sizes[int(np.argmin(plain[1]))]
    text = (
        "More channels on the same range: without weights the rise time falls, and the settling"
        f" time up to N = {fastest}; with weights neither does."
    )
    return picture(text, *charts)
