"""What the explorer shows of a board, in four steps: rest, poles with curves, limits, stable C.

Each step is a function of the results of the step before it. For a linear board of ten channels all
steps together take about ten milliseconds. The verdict (`explorer_judgement.judge`) takes longer
and runs in a process of its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.system.quantities import show, show_rate
from taction.verification.engines.statespace.linearised.board import Initial, LinearBoard
from taction.verification.engines.statespace.linearised.time_scales import TimeScales, time_scales
from taction.verification.engines.statespace.transients.exact import Exact, exact_solution
from taction.verification.reference import Solution, solve
from taction.verification.reference.ideal_answer import ideal_network
from taction.verification.stability.margin import stable_values
from taction.verification.stability.poles import Poles, poles_behind
from taction.verification.verdict.headroom import PartLoads, describe
from taction.verification.verdict.transient_plan import settled_after

POINTS = 500  # of a curve without fast ringing
PER_PERIOD = 20.0  # points of a curve with ringing, before it is thinned
MOST = 20_000  # points of a curve
RISEN, TIMES_RISE = 0.9, 6.0  # of a channel's step; the window of the rise in times of it
SEARCHED = 400  # instants at which the rise is looked for
EARLIEST = 1e-5  # of the record: the first of them

GROWS = "the board is unstable: the smallest disturbance {how}, until the op-amps limit it"
LIMITED = (
    "the curves show the linear board, and its op-amps cannot follow: {load}. The verdict is of"
    " op-amps with their limits, where the model has them"
)


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """Outputs of every channel.

    Attributes
    ----------
    time, outputs : ndarray (P,) and (P, N)
        s and V.
    rise, stop : float
        Ends of the window of the first rise and of the whole record, s.
    """

    time: Floats
    outputs: Floats
    rise: float
    stop: float


@dataclass(frozen=True, slots=True, eq=False)
class LinearResponse:
    """The step response of a linear board of some channels, at any instant.

    Attributes
    ----------
    rise, stop : float
        As in `Curves`.
    """

    solution: Exact
    signs: Floats
    scales: TimeScales
    rise: float
    stop: float

    @classmethod
    def of(
        cls, board: LinearBoard, scales: TimeScales, stop: float, initial: Initial
    ) -> LinearResponse:
        """Solve a small linear board; raises `EngineError` as `exact_solution`."""
        solution = exact_solution(board, initial=initial, stop=stop)
        signs = np.array([output.sign for output in board.circuit.outputs])
        return cls(solution, signs, scales, _rise(solution, stop), stop)

    def curves(self, end: float) -> Curves:
        """Return the outputs from 0 to `end`, s, with `PER_PERIOD` points a period of ringing."""
        period = min((r.period for r in self.scales.ringing), default=math.inf)
        wanted = PER_PERIOD * end / period if period > 0.0 else 0.0
        count = int(min(max(wanted, POINTS), MOST))
        step = end / (count - 1)
        with np.errstate(over="ignore", invalid="ignore"):
            values = self.solution.uniform(step, count) * self.signs
        return Curves(np.linspace(0.0, end, count), values, self.rise, self.stop)


def _rise(solution: Exact, stop: float) -> float:
    """Return the end of a window that shows the first rise of every channel, s."""
    times = np.geomspace(EARLIEST * stop, stop, SEARCHED)
    with np.errstate(over="ignore", invalid="ignore"):
        moved = np.abs(solution.at(times) - solution.start)
    steps = np.abs(solution.final - solution.start)
    large = steps > 0.05 * steps.max(initial=0.0)
    if not large.any():
        return stop
    reached = moved[:, large] >= RISEN * steps[large]
    first = times[np.where(reached.any(axis=0), reached.argmax(axis=0), SEARCHED - 1)]
    return min(TIMES_RISE * float(first.max()), stop)


@dataclass(frozen=True, slots=True, eq=False)
class RestView:
    """The board at rest, beside the solution of the problem.

    Attributes
    ----------
    targets, rest : ndarray (N,)
        Reference solution and equilibrium of the board, V.
    solution : Solution
        The reference solution, with its certificate.
    """

    scene: Scene
    problem: InverseProblem
    board: LinearBoard
    scales: TimeScales
    solution: Solution
    targets: Floats
    rest: Floats

    @property
    def is_large(self) -> bool:
        """Whether the poles take longer than a movement of the hand."""
        return self.board.descriptor.is_large

    @property
    def has_curves(self) -> bool:
        """Whether the transient has a closed form that is known at once."""
        return self.board.circuit.is_linear and not self.is_large


@dataclass(frozen=True, slots=True, eq=False)
class PoleView:
    """Poles of the board, and its response if it has a closed form.

    Attributes
    ----------
    doubts : tuple of str
        Why the response of the linear board is not that of the board.
    """

    poles: Poles
    response: LinearResponse | None
    doubts: tuple[str, ...] = ()

    @property
    def state(self) -> str:
        """``"stable"``, ``"unstable"`` or ``"undecided"``."""
        if self.poles.known_stable:
            return "stable"
        return "unstable" if self.poles.known_unstable else "undecided"


@dataclass(frozen=True, slots=True)
class StableValues:
    """The values of C that are stable at the other values.

    Attributes
    ----------
    low, high : float
        The examined values, F.
    stable : tuple of pairs of float
        Stable ranges, F.
    near : tuple of float
        Values at which rounding decides, F.
    unknown : str
        Why the ranges are not known, or empty.
    """

    low: float = 0.0
    high: float = 0.0
    stable: tuple[tuple[float, float], ...] = field(default=())
    near: tuple[float, ...] = field(default=())
    unknown: str = ""


def view_rest(scene: Scene, problem: InverseProblem) -> RestView:
    """Build the board and find where it rests.

    Raises
    ------
    InputError
        The board cannot be built.
    NoVerdictError
        The board has no equilibrium, or the problem no solution.
    """
    board = LinearBoard(synthesise(scene, problem))
    scales = time_scales(board, initial=scene.analysis.initial)
    network = ideal_network(problem, scene)
    solution = solve(network.problem)
    rest = np.array(
        [output.sign * board.equilibrium[output.node] for output in board.circuit.outputs]
    )
    return RestView(scene, problem, board, scales, solution, solution.u * network.U0, rest)


def view_poles(view: RestView) -> PoleView:
    """Return the poles of a board, and the response of a small linear one.

    Raises
    ------
    EngineError
        The board has no state-space form.
    """
    found = poles_behind(view.board, view.scales)
    if not view.has_curves:
        return PoleView(found, None, _doubts(found))
    checks, scales = view.scene.checks, view.scales
    if found.known_unstable:
        stop = scales.growth_time
    else:
        stop = settled_after(checks, scales, found.resolution)
    if view.scene.analysis.stop != "auto":
        stop = view.scene.analysis.stop
    response = LinearResponse.of(view.board, scales, stop, view.scene.analysis.initial)
    return PoleView(found, response, _doubts(found))


def _doubts(poles: Poles) -> tuple[str, ...]:
    lead = poles.rightmost
    if poles.known_unstable:
        how = f"grows with {show_rate(lead.real)}"
        if lead.imag:
            how += f" and oscillates at {show(abs(lead.imag) / math.tau, 'Hz')}"
        return (GROWS.format(how=how),)
    if not poles.known_stable:
        return ("a pole is so close to the axis that rounding decides whether the board is stable",)
    return ()


def view_limits(view: RestView, poles: PoleView) -> tuple[str, ...]:
    """Return what the op-amps of a stable linear board cannot do, the worst first.

    Costs some milliseconds, more where the board rings for long.
    """
    if poles.response is None or not poles.poles.known_stable:
        return ()
    loads = PartLoads.of(view.board, initial=view.scene.analysis.initial)
    if loads.unknown:
        return (loads.unknown,)
    above = [load for load in loads.worst if load.is_above]
    return tuple(LIMITED.format(load=describe(load)) for load in above[:1])


def view_boundary(view: RestView, poles: PoleView, low: float, high: float) -> StableValues:
    """Find the values of C from `low` to `high`, F, that are stable.

    The edges are solved as `onset` solves them: by the loci of the capacitors, not by samples.
    """
    own = view.board.circuit.value("C")
    if view.board.descriptor.is_large:
        return StableValues(unknown="a board of this size: `taction onset SCENE --over C` finds it")
    try:
        around = max(high / own, own / low)
        found = stable_values(view.board, around=around, found=poles.poles)
    except EngineError as error:
        return StableValues(unknown=str(error))
    if not poles.poles.certain:
        return StableValues(unknown="a pole of the board is on the imaginary axis")
    stable = tuple(
        (max(first, low), min(last, high))
        for first, last in found.stable_ranges
        if first < high and last > low
    )
    return StableValues(low, high, stable, found.near)


def true_outputs(view: RestView) -> Floats | None:
    """Return the true stress as voltages of the outputs, V, (N,); None if it is not known."""
    if view.problem.stress is None:
        return None
    return np.asarray(view.problem.stress * view.board.circuit.value("U0"))
