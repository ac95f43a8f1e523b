"""The reference answer for a scene: steady state and transient of the ideal network."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.scene.fields import LARGE, SMALL
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import DEFAULT_RESISTANCE, Scene
from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError
from taction.verification.reference import (
    IdealNetwork,
    Problem,
    Solution,
    ideal_linear,
    ideal_transient,
    lambda_times_resistance,
    solve,
)
from taction.verification.reference.dynamics import ScaledNetwork, Trust
from taction.verification.reference.regularisers import REGULARISERS
from taction.verification.reference.step_response import Response

ENERGY_STRIDE = 20  # every 20th instant of the response, whose instants are 1 % apart
CACHED_SOLUTIONS = 8  # the points of a sweep over C share one solution


@dataclass(frozen=True, slots=True, eq=False)
class TransientFigures:
    """Figures of the ideal transient."""

    settling_time: float  # to the scene's band, s; NaN if the transient cannot be trusted
    energy_residual: float  # see `taction.verification.reference.dynamics.ScaledNetwork`


@dataclass(frozen=True, eq=False)
class IdealAnswer:
    """Steady state and transient of the ideal network.

    Attributes
    ----------
    band : float
        Half-width of the settling band, a fraction of the step amplitude.
    solution : Solution
        The reference steady state, dimensionless, with its certificate.
    start, target : ndarray (N,)
        u at t = 0 and at rest, V.
    error : float
        Bound on the error of `target`, as a fraction of the step amplitude.
    problem : str
        Why the answer cannot be trusted; empty for a trusted answer.
    integrated : TransientFigures or None
        From numerical integration; None for linear amplifiers, whose modes are exact.
    """

    network: IdealNetwork
    band: float
    solution: Solution
    start: Floats
    target: Floats
    error: float
    problem: str
    integrated: TransientFigures | None

    @functools.cached_property
    def transient(self) -> TransientFigures:
        """Figures of the transient; no check needs them, so modes are evaluated on demand."""
        if self.integrated is not None:
            return self.integrated
        response = ideal_linear(self.network, self.start, self.solution)
        residual = _linear_residual(self.network, response)
        return TransientFigures(response.settling_time(self.band), residual)


def ideal_network(problem: InverseProblem, scene: Scene) -> IdealNetwork:
    """Return the ideal network of `problem`, with lambda and the units that `scene` asks for.

    It reads the scene alone, no number of the synthesis. Where the scene gives R, lambda follows
    from the reference's own formula.

    Raises
    ------
    InputError
        Lambda is no number, or out of range.
    """
    design = scene.design
    kind, slope = design.amplifier, design.exponential_slope or 1.0
    product = lambda_times_resistance(
        kind, s=design.gain, G0=design.unit_conductance, U0=design.unit_voltage, Ve=slope
    )
    lam = design.lam
    if lam is None:
        lam = product / (design.resistance or DEFAULT_RESISTANCE)
    if isinstance(lam, str) or not SMALL <= lam <= LARGE:
        text = f"the problem needs a number between {SMALL:g} and {LARGE:g} for lambda"
        raise InputError(scene.file, Complaint("design.lambda", repr(lam), text))
    return IdealNetwork(
        T=problem.matrix,
        eps=problem.strain,
        lam=lam,
        RC=product / lam * design.capacitance,
        U0=design.unit_voltage,
        amplifier=kind,
        Ve=slope,
        bias=is_biased(scene),
    )


def is_biased(scene: Scene) -> bool:
    """Whether Omega has the term of the bias current, by the scene or by the paper's Omega."""
    bias = scene.design.bias
    return REGULARISERS[scene.design.amplifier].biased if bias is None else bias


def initial_voltages(scene: Scene, network: IdealNetwork) -> Floats:
    """Return v of every signal node when the strain steps on, shape (N,), V.

    Raises
    ------
    SolverError
        The scene starts from rest, and the network without strain has no solution.
    """
    if scene.analysis.initial == "zero" or network.amplifier == "linear":
        return np.zeros(network.T.shape[1])
    rest = solve(replace(network, eps=np.zeros_like(network.eps)).problem)
    return network.unit * (rest.v if rest.v is not None else rest.u)


def ideal_answer(network: IdealNetwork, scene: Scene) -> IdealAnswer:
    """Solve for the steady state, and for the transient from the scene's initial state.

    Raises
    ------
    SolverError
        The solver can return no answer.
    """
    initial = initial_voltages(scene, network)
    band = scene.checks.settling_time.band
    figures, doubt = None, ""
    if network.amplifier == "linear":
        solution, start = _solve_cached(network.problem), initial
    else:
        transient = ideal_transient(network, initial)
        solution, response = transient.rest, transient.response
        start = np.full(len(solution.u), np.nan) if response is None else response.start
        if response is None or transient.outcome is not Trust.TRUSTED:
            settling_time, doubt = np.nan, transient.outcome.value
        else:
            settling_time = response.settling_time(band)
        figures = TransientFigures(settling_time, transient.energy_residual)
    target = solution.u * network.U0
    amplitude = float(np.abs(target - start).max()) or 1.0
    return IdealAnswer(
        network=network,
        band=band,
        solution=solution,
        start=start,
        target=target,
        error=np.inf if doubt else solution.error_bound * network.U0 / amplitude,
        problem=solution.reason or doubt,
        integrated=figures,
    )


def _solve_cached(problem: Problem) -> Solution:
    T, eps = problem.T, problem.eps
    content = (T.shape, T.tobytes(), eps.tobytes())
    return _solve_content(*content, problem.lam, problem.regulariser, problem.bias)


@functools.lru_cache(maxsize=CACHED_SOLUTIONS)
def _solve_content(
    shape: tuple[int, ...], T: bytes, eps: bytes, lam: float, regulariser: str, bias: bool
) -> Solution:
    matrix = np.frombuffer(T).reshape(shape)
    return solve(Problem(matrix, np.frombuffer(eps), lam, regulariser, bias))


def _linear_residual(network: IdealNetwork, response: Response) -> float:
    unit = network.RC

    def dense(t: Floats) -> Floats:
        return response.outputs(t * unit).T / network.U0

    steps = response.time[::ENERGY_STRIDE] / unit
    return ScaledNetwork(network).energy_residual(steps, dense)
