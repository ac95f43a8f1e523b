"""The network of the paper: what its size changes, its trajectories, its energy (theorem 3.1)."""

from __future__ import annotations

import math
import time
import timeit
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Literal

import numpy as np
from scipy.linalg import matmul_toeplitz
from scipy.sparse.linalg import LinearOperator, cg

from taction.netlist_gen.scene.inverse_problem import kernel
from taction.system.array_types import Floats
from taction.system.errors import SolverError
from taction.system.reading_definitions import RISE_LEVELS
from taction.verification.evidence.paper.findings import Chapter, Finding, finding, weigh
from taction.verification.evidence.paper.ideal_flow import (
    TOLERANCE,
    ScaledNetwork,
    linear_outputs,
    settling_time,
)
from taction.verification.evidence.paper.sensing import Geometry, difference, entropy, unit_network
from taction.verification.reference.ideal_answer import IdealNetwork
from taction.verification.reference.problem import Problem
from taction.verification.reference.regularisers import REGULARISERS
from taction.verification.reference.solve import solve

SIZES = (7, 25, 51, 101, 201, 401)
SPAN = 6.0  # depths
MU = 10.0  # 1 / (s R)
SENSORS, RATE = 25, 1e5  # the paper's comparison: sensors, solutions a second
LARGE = (16_403, 147_623)
"""Sizes of the Toeplitz solves: 2 N - 1 has the factors 3 and 5 alone, so its FFT is fast."""
TRIES = 5
RESIDUAL = 1e-6  # relative, of the normal equations
RATIOS = (2.0, 4.0, 8.0, 10.0)  # depth / spacing; at the last cond(T) is 3e11
BEYOND = 20.0  # a ratio whose condition number double precision, up to some 1e16, cannot hold
WIDE, NARROW = 20.0, 6.0  # depths; the ends of a wide range matter little

Times = tuple[list[float], list[float]]  # rise time of the centre, 1 % settling time; R C


def speed() -> Chapter:
    """Judge the comparison of analog and digital."""
    rise, settling = plain = _times(weighted=False)
    weighted = _times(weighted=True)
    falling = [bool(np.all(np.diff(times) < 0.0)) for times in (*plain, *weighted)]
    decreases = finding(
        "time-over-channels",
        weigh(all(falling), falling[0]),
        rise_first=rise[0],
        rise_last=rise[-1],
        settling_first=settling[0],
        settling_last=settling[-1],
        mu=MU,
        sizes=SIZES,
        plain=plain,
        weighted=weighted,
    )
    rate = SENSORS**2 * RATE
    operations = finding(
        "operations", weigh(rate == 62.5e6), operations_per_second=rate, millions=rate / 1e6
    )
    return Chapter((decreases, operations, _impossible(), _quadratic()))


def _times(*, weighted: bool) -> Times:
    """Return rise time of the centre and 1 % settling time for each size, in R C."""
    rise, settling = [], []
    for N in SIZES:
        geometry = Geometry(N, SPAN)
        T = geometry.matrix * (geometry.spacing if weighted else 1.0)
        network = unit_network(T, T @ geometry.stress, MU, "linear")
        instants, u = linear_outputs(network)
        shares = u[:, N // 2] / u[-1, N // 2]
        reached = np.interp(RISE_LEVELS, np.maximum.accumulate(shares), instants)
        rise.append(float(np.diff(reached)[0]))
        settling.append(settling_time(instants, u))
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


def _quadratic() -> Finding:
    times = []
    for N in LARGE:
        column = kernel(0.2 * np.arange(N, dtype=np.float64), depth=1.0, modulus=1.0, poisson=0.5)
        strain = np.random.default_rng(1).normal(size=N)
        times.append(_best(partial(tikhonov, column, strain, 1.0), tries=3))
    exponent = math.log(times[1] / times[0]) / math.log(LARGE[1] / LARGE[0])
    found = {"exponent": exponent, "seconds": times[1], "sizes": LARGE, "times": times}
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


def conditioning() -> Chapter:
    """Judge how the condition number grows with the number of channels (appendix A)."""
    wide, narrow = ([condition_number(r, span) for r in RATIOS] for span in (WIDE, NARROW))
    off = max(abs(a / asymptotic(ratio) - 1.0) for a, ratio in zip(wide, RATIOS, strict=True))
    grows = bool(np.all(np.diff([wide, narrow]) > 0.0))
    result = finding(
        "ill-conditioned",
        weigh(grows and off <= 0.1),
        **{f"cond_{ratio:g}": value for ratio, value in zip(RATIOS, wide, strict=True)},
        ratios=RATIOS,
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


STIFF, SMALL = Geometry(21, 6.0), Geometry(15, 6.0)  # of the chapters simnon and energy
STIFF_MU, SMALL_MU = 5e-4, 0.05
Method = Literal["RK45", "Radau", "LSODA"]
EXPLICIT: Method = "RK45"  # of Dormand and Prince
REAL_AXIS = 3.307  # it is stable for steps up to this over the fastest rate
FIXED = 1e9  # a tolerance that never shortens a step
QUARTER = 0.25
RUNAWAY = 10.0  # above every output of this network
MAX_ERROR = 1e-3  # of the largest output
END = 5.0  # R C
AGREEMENT = 1e-6  # largest difference of two methods over the largest output
INSTANTS = np.linspace(0.0, END, 51)[1:]
SHARE = 0.7  # of the largest step that is stable at rest, with which the start is stable, too
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5)
STARTS = 4
FINE_POINTS = 4001  # of a trajectory
LEAST_SLOPE = 1e-9  # of an amplifier in the curvature: where its slope is 0 the energy is steeper
STATES = 200  # random states for each regulariser

Solved = tuple[Floats, int]  # outputs (P, N), evaluations of the slope


def simnon() -> Chapter:
    """Judge section 4.2's remarks on simulation with the exponential network."""
    network = unit_network(STIFF.matrix, STIFF.strain(1, 0.01), STIFF_MU)
    scaled = ScaledNetwork(network)
    fastest = float(np.max(-np.linalg.eigvals(scaled.jacobian(0.0, scaled.rest)).real))
    exact = scaled.trajectory(np.zeros(STIFF.channels))
    truth, instants = np.exp(exact(INSTANTS).T), np.linspace(0.0, exact.t_max, FINE_POINTS)
    settling = settling_time(instants, np.exp(exact(instants).T))
    explicit = partial(_integrated, scaled, EXPLICIT, FIXED, SHARE * REAL_AXIS / fastest)
    implicit = [partial(_integrated, scaled, "Radau", tolerance) for tolerance in TOLERANCES]
    second = difference(_integrated(scaled, "LSODA", TOLERANCE)[0], truth)
    accuracy = finding(
        "simnon-accuracy",
        weigh(not second <= AGREEMENT),
        settling_time_rc=settling,
        second_opinion=second,
    )
    costs = [_cheapest(truth, [explicit]), _cheapest(truth, implicit)]
    ratio = costs[0][0] / costs[1][0]
    cost = finding(
        "simnon-cost",
        weigh(False, ratio > 10.0),
        explicit=costs[0][1],
        implicit=costs[1][1],
        evaluations_ratio=ratio,
        end=END,
        error=MAX_ERROR,
        evaluations=[evaluations for evaluations, _ in costs],
        stiffness=scaled.stiffness(scaled.rest),
    )
    return Chapter((_unstable(scaled, fastest), cost, accuracy))


def _integrated(
    scaled: ScaledNetwork, method: Method, tolerance: float, step: float = np.inf, end: float = END
) -> Solved:
    """Solve from zero by a method of SciPy with steps of at most `step`; NaN where it fails."""
    from scipy.integrate import solve_ivp

    instants = INSTANTS * (end / END)
    options: dict[str, Any] = {} if method == EXPLICIT else {"jac": scaled.jacobian}
    with np.errstate(all="ignore"):
        run = solve_ivp(
            scaled.slope, (0.0, end), np.zeros(STIFF.channels), method, t_eval=instants,
            rtol=tolerance, atol=tolerance, max_step=step, **options,
        )  # fmt: skip
        u = np.exp(run.y.T) if run.success else np.full((len(instants), STIFF.channels), np.nan)
    return u, int(run.nfev)


def _cheapest(truth: Floats, runs: Sequence[Callable[[], Solved]]) -> tuple[int, float]:
    """Return the fewest evaluations of an accurate run, and its wall time, s."""
    accurate = []
    for run in runs:
        start = time.perf_counter()
        u, evaluations = run()
        if difference(u, truth) <= MAX_ERROR:
            accurate.append((evaluations, time.perf_counter() - start))
    return min(accurate, default=(0, np.nan))


def _unstable(scaled: ScaledNetwork, fastest: float) -> Finding:
    """Keep the step, a quarter of the largest stable one at first, and shrink C by bisection."""
    step = QUARTER * REAL_AXIS / fastest
    stable, unstable = 1.0, 0.05  # C over its first value
    while stable > 1.02 * unstable:
        middle = float(np.sqrt(stable * unstable))
        u, _ = _integrated(scaled, EXPLICIT, FIXED, step / middle, 0.2)
        bounded = float(np.max(np.abs(u))) < RUNAWAY  # false of NaN, too
        stable, unstable = (middle, unstable) if bounded else (stable, middle)
    return finding(
        "simnon-unstable",
        weigh(0.6 * QUARTER < unstable < 1.7 * QUARTER),
        capacitance_ratio=unstable,
        fastest_rate_rc=fastest,
        step=step,
        channels=STIFF.channels,
        limit=REAL_AXIS,
        quarter=QUARTER,
    )


def energy() -> Chapter:
    """Judge the Lyapunov property on the exponential network and the convexity of eq (17)."""
    network = unit_network(SMALL.matrix, SMALL.strain(1, 0.01), SMALL_MU)
    scaled = ScaledNetwork(network)
    x = np.random.default_rng(4).normal(0.0, 1.0, SMALL.channels)
    by_v = scaled.jacobian(0.0, x)
    in_v, in_u = (
        float(np.linalg.norm(J - J.T) / np.linalg.norm(J)) for J in (by_v, by_v / np.exp(x))
    )
    rng = np.random.default_rng(3)
    ends = [_final(network, rng.normal(0.0, 2.0, SMALL.channels)) for _ in range(STARTS)]
    off = float(np.max([difference(u, network.rest.u) for u in ends]))
    attraction = finding("asymptotically-stable", weigh(off <= 1e-6), difference=off, starts=STARTS)
    symmetry = finding("hypothesis-2", weigh(in_v <= 1e-12), in_v=in_v, in_u=in_u)
    findings = (_descent(scaled), _gradient(scaled), attraction, symmetry, _minima())
    return Chapter(findings)


def _descent(scaled: ScaledNetwork) -> Finding:
    """Compare the energy that is lost with the integral of the power ``sum C g' v'^2``."""
    from scipy.integrate import solve_ivp

    def slopes(_: float, state: Floats) -> Floats:
        slope = scaled.slope(0.0, state[:-1])
        return np.append(slope, np.sum(scaled.g.slope(state[:-1]) * slope**2))

    x0 = np.zeros(SMALL.channels)
    run = scaled.trajectory(x0)
    levels = np.array([scaled.energy(x) for x in run(np.linspace(0.0, run.t_max, FINE_POINTS)).T])
    lost = float(levels[0] - levels[-1])
    rising = float(np.max(np.diff(levels), initial=0.0)) / lost
    span, start = (0.0, float(run.t_max)), np.append(x0, 0.0)
    second = solve_ivp(slopes, span, start, "Radau", rtol=TOLERANCE, atol=TOLERANCE)
    residual = abs(float(second.y[-1, -1]) / lost - 1.0) if second.success else np.nan
    return finding(
        "lyapunov",
        weigh(residual <= AGREEMENT and rising <= 1e-9),
        residual=residual,
        largest_rise=rising,
        channels=SMALL.channels,
        stiffness=scaled.stiffness(scaled.rest),
    )


def _gradient(scaled: ScaledNetwork) -> Finding:
    """Compare ``du/dt`` with ``-G C⁻¹ dP/du``, the gradient by central differences in u."""
    x = np.random.default_rng(2).normal(0.0, 1.0, SMALL.channels)
    u, steps = np.exp(x), 1e-5 * np.diag(np.exp(x))
    rises = [scaled.energy(np.log(u + step)) - scaled.energy(np.log(u - step)) for step in steps]
    off = difference(-np.array(rises) / 2e-5, u * scaled.slope(0.0, x))
    return finding("gradient-system", weigh(off <= 1e-6), difference=off)


def _final(network: IdealNetwork, start: Floats) -> Floats:
    """Return the outputs (N,) at the end of a transient."""
    scaled = ScaledNetwork(network)
    run = scaled.trajectory(start)
    return scaled.g.g(run(run.t_max))


def _minima() -> Finding:
    """Search for a direction in which an energy of the class (17) curves down."""
    rng, T = np.random.default_rng(5), SMALL.matrix
    least, apart = np.inf, 0.0
    kinds = [name for name in REGULARISERS if name != "linear"]
    for name in kinds:
        network = unit_network(T, SMALL.strain(1, 0.01), SMALL_MU, name)
        for _ in range(STATES):
            v = rng.normal(0.0, 2.0, SMALL.channels)
            slope = np.maximum(REGULARISERS[name].slope(v), LEAST_SLOPE)
            hessian = T.T @ T / SMALL_MU + np.diag(1.0 / slope)
            least = min(least, float(np.linalg.eigvalsh(hessian)[0]))
        first, second = (_final(network, rng.normal(0.0, 1.5, SMALL.channels)) for _ in range(2))
        apart = float(np.maximum(apart, np.max(np.abs(first - second))))
    return finding(
        "multiple-minima",
        weigh(not (least > 0.0 and apart <= 1e-5)),
        least_eigenvalue=least,
        apart=apart,
        drawn=STATES,
        kinds=", ".join(kinds),
    )
