"""Section 6: convergence time against the number of channels, and the digital comparison."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np

from netlist_gen.problem.inverse_problem import kernel
from netlist_gen.quantities import show
from verification.reference import Problem, ideal_linear, solve
from verification.reference.problem import ToeplitzProblem
from verification.reference.toeplitz import solve_toeplitz_problem
from verification.studies.paper.findings import (
    Chapter,
    Finding,
    Panel,
    Picture,
    curve,
    listed,
    weigh,
)
from verification.studies.paper.tactile import Geometry, entropy
from verification.studies.paper.unit_network import unit_network

SIZES = (7, 25, 51, 101, 201, 401)
QUICK = (7, 201, 401)
SPAN = 6.0
AXIS = (0.02, 8.0)  # R C, of both panels
MU = 10.0  # 1 / (s R)
SENSORS, RATE = 25, 1e5  # the paper's comparison
BUDGET = 1.0 / RATE
LARGE = (20_000, 160_000)
TRIES = 5


def speed(quick: bool) -> Chapter:
    """Judge the comparison of analog and digital."""
    sizes = QUICK if quick else SIZES
    plain, weighted = _times(sizes, weighted=False), _times(sizes, weighted=True)
    digital = (_arithmetic(), _impossible(), _quadratic())
    return Chapter(
        (_decreases(sizes, plain, weighted), *digital), (_picture(sizes, plain, weighted),)
    )


def _times(sizes: tuple[int, ...], *, weighted: bool) -> tuple[list[float], list[float]]:
    """Return rise time of the centre and 1 % settling time for each size, in R C."""
    rise, settling = [], []
    for N in sizes:
        geometry = Geometry("", N, SPAN)
        T = geometry.matrix * (geometry.spacing if weighted else 1.0)
        network = unit_network(T, T @ geometry.stress, MU, "linear")
        response = ideal_linear(network, np.zeros(N))
        rise.append(float(response.rise_times()[N // 2]))
        settling.append(response.settling_time())
    return rise, settling


def _decreases(
    sizes: tuple[int, ...],
    plain: tuple[list[float], list[float]],
    weighted: tuple[list[float], list[float]],
) -> Finding:
    falling = [bool(np.all(np.diff(times) < 0.0)) for times in (*plain, *weighted)]
    return Finding(
        "time-over-channels",
        f"ideal linear network, 1/(sR) = {MU:g}, range 6 depths, N = {listed(sizes)}",
        f"rise of the centre {listed(plain[0])} RC, 1 % settling {listed(plain[1])} RC; with the"
        f" spacing as a weight in T: {listed(weighted[0])} RC and {listed(weighted[1])} RC. The"
        " slowest rate is 1/(RC) for every N. Condition: rise time, T without weights",
        weigh(all(falling), falling[0]),
        {"rise_first": plain[0][0], "rise_last": plain[0][-1],
         "settling_first": plain[1][0], "settling_last": plain[1][-1]},
    )  # fmt: skip


def _arithmetic() -> Finding:
    operations = SENSORS**2 * RATE
    return Finding(
        "operations",
        "25² operations for each of 1e5 solutions a second",
        f"{operations / 1e6:g} million operations a second; with T fixed and a linear regulariser"
        " that is one product with a matrix made once",
        weigh(operations == 62.5e6),
        {"operations_per_second": operations},
    )


def _impossible() -> Finding:
    geometry = Geometry("", SENSORS, SPAN)
    T, strain = geometry.matrix, geometry.strain(1)
    inverse = np.linalg.solve(T.T @ T + np.eye(SENSORS), T.T)
    product = _best(lambda: inverse @ strain, repeats=1000)
    certified = _best(lambda: solve(Problem(T, strain, 1.0)))
    nonlinear = _best(lambda: entropy(T, strain, 1.0))
    return Finding(
        "digital-impossible",
        f"N = {SENSORS} on this machine, one core, best of {TRIES}",
        f"one product with a fixed matrix {show(product, 's', 3)}, less than 10 µs; a certified"
        f" linear solve {show(certified, 's', 3)}, the entropy solve {show(nonlinear, 's', 3)}",
        weigh(product > BUDGET),
        {"product": product, "linear_solve": certified, "entropy_solve": nonlinear},
    )


def _quadratic() -> Finding:
    seconds = []
    for N in LARGE:
        column = kernel(0.2 * np.arange(N, dtype=np.float64), depth=1.0, modulus=1.0, poisson=0.5)
        strain = np.random.default_rng(1).normal(size=N)
        problem = ToeplitzProblem(column, column, strain, 1.0)
        seconds.append(_best(partial(solve_toeplitz_problem, problem), tries=3))
    exponent = float(np.log(seconds[1] / seconds[0]) / np.log(LARGE[1] / LARGE[0]))
    return Finding(
        "digital-quadratic",
        f"Toeplitz solve by conjugate gradients with fast Fourier transforms, N = {LARGE[0]} and"
        f" {LARGE[1]}, lambda = 1",
        f"{show(seconds[0], 's', 3)} and {show(seconds[1], 's', 3)}: the time grows like"
        f" N^{exponent:.2f}, not N²",
        weigh(exponent > 1.8),
        {"exponent": exponent, "seconds": seconds[1]},
    )


def _best(run: Callable[[], object], *, repeats: int = 1, tries: int = TRIES) -> float:
    """Return the least time of one run, s."""
    least = float("inf")
    for _ in range(tries):
        start = time.perf_counter()
        for _ in range(repeats):
            run()
        least = min(least, (time.perf_counter() - start) / repeats)
    return least


def _picture(
    sizes: tuple[int, ...],
    plain: tuple[list[float], list[float]],
    weighted: tuple[list[float], list[float]],
) -> Picture:
    panels = tuple(
        Panel(
            title,
            "channels N",
            "time (RC)",
            (curve(sizes, rise, "rise of the centre", "C0o-"),
             curve(sizes, settling, "1 % settling", "C1s-")),
            logs="xy",
            limits=AXIS,
        )
        for title, (rise, settling) in (
            ("T as printed, without weights", plain),
            ("T times the spacing", weighted),
        )
    )  # fmt: skip
    text = "More channels on the same range: only the rise time falls, and only without weights."
    return Picture("time-over-channels", text, panels)
