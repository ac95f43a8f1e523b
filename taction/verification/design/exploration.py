"""What the explorer shows of a board: rest, poles with curves, limits, stable values, verdict.

Each step is a function of the results of the step before it. For a linear board of ten channels all
steps but the verdict (`judge`) take about ten milliseconds together. The verdict takes longer than
a movement of the hand and runs in a process of its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.errors import EngineError, TactionError
from taction.system.quantities import show, show_rate, spaced
from taction.verification.design.explorer_settings import Control, Settings, Start
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.time_scales import TimeScales, time_scales
from taction.verification.engines.statespace.transients.exact import Exact, exact_solution
from taction.verification.reference.ideal_answer import ideal_network
from taction.verification.reference.solve import solve
from taction.verification.stability.edges import Edges
from taction.verification.stability.margin import stable_values
from taction.verification.stability.poles import Poles, poles
from taction.verification.verdict.answer_error import AnswerError
from taction.verification.verdict.headroom import PartLoads, describe
from taction.verification.verdict.record import ERROR, Record
from taction.verification.verdict.transient_plan import settled_after
from taction.verification.verdict.verify import Verdict, verify

POINTS = 500  # of a curve without fast ringing
PER_PERIOD = 20.0  # points of a curve with ringing, before it is thinned
MOST = 20_000  # points of a curve
WINDOW = 10.0  # times the longest rise time of a verdict: the window of the first rise
RISEN, TIMES_RISE = 0.9, 6.0  # of a channel's step; the window of the rise in times of it
SEARCHED = 400  # instants at which the rise is looked for
EARLIEST = 1e-5  # of the record: the first of them

CELLS = 9  # of a slider: one verdict in the middle of each
ON_THE_AXIS = "a pole is so close to the axis that rounding decides whether the board is stable"
GROWS = "the board is unstable: the smallest disturbance {how}, until the op-amps limit it"
LIMITED = (
    "the curves show the linear board, and its op-amps cannot follow: {load}. The verdict is of"
    " op-amps with their limits, where the model has them"
)


@dataclass(frozen=True, slots=True, eq=False)
class ExplorerCurves:
    """Outputs of every channel: `time` (P,), s, and `outputs` (P, N), V.

    `rise` and `stop` are the ends of the window of the first rise and of the whole record, s.
    """

    time: Floats
    outputs: Floats
    rise: float
    stop: float


@dataclass(frozen=True, slots=True, eq=False)
class LinearResponse:
    """The step response of a linear board of some channels, at any instant."""

    solution: Exact
    signs: Floats
    scales: TimeScales
    rise: float  # s, as in `ExplorerCurves`
    stop: float

    def curves(self, end: float) -> ExplorerCurves:
        """Return the outputs from 0 to `end`, s, with `PER_PERIOD` points a period of ringing."""
        period = min((r.period for r in self.scales.ringing), default=math.inf)
        wanted = PER_PERIOD * end / period if period > 0.0 else 0.0
        count = int(min(max(wanted, POINTS), MOST))
        time = np.linspace(0.0, end, count)
        with np.errstate(over="ignore", invalid="ignore"):
            values = self.solution.at(time) * self.signs
        return ExplorerCurves(time, values, self.rise, self.stop)


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
    """The board at rest, beside the solution of the problem, and how far it is from the truth."""

    scene: Scene
    problem: InverseProblem
    board: LinearBoard
    scales: TimeScales
    answer: AnswerError
    rest: Floats  # (N,), V: equilibrium of the board

    @property
    def targets(self) -> Floats:
        """The reference solution (N,), V."""
        return self.answer.target

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
    """Poles of the board, and its response if it has a closed form."""

    poles: Poles
    response: LinearResponse | None

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why the response of the linear board is not that of the board."""
        lead = self.poles.rightmost
        if self.poles.known_unstable:
            how = f"grows with {show_rate(lead.real)}"
            if lead.imag:
                how += f" and oscillates at {show(abs(lead.imag) / math.tau, 'Hz')}"
            return (GROWS.format(how=how),)
        return () if self.poles.known_stable else (ON_THE_AXIS,)

    @property
    def state(self) -> str:
        """``"stable"``, ``"unstable"`` or ``"undecided"``."""
        if self.poles.known_stable:
            return "stable"
        return "unstable" if self.poles.known_unstable else "undecided"


def view_rest(scene: Scene, problem: InverseProblem) -> RestView:
    """Build the board and find where it rests.

    InputError: the board cannot be built.
    NoVerdictError: the board has no equilibrium, or the problem no solution.
    """
    board = LinearBoard(synthesise(scene, problem))
    scales = time_scales(board, initial=scene.analysis.initial)
    network = ideal_network(problem, scene)
    rest = np.array(
        [output.sign * board.equilibrium[output.node] for output in board.circuit.outputs]
    )
    answer = AnswerError.of(network, solve(network.problem), problem.stress)
    return RestView(scene, problem, board, scales, answer, rest)


def view_poles(view: RestView) -> PoleView:
    """Return the poles of a board, and the response of a small linear one.

    EngineError: the board has no state-space form.
    """
    found, scales, analysis = poles(view.board), view.scales, view.scene.analysis
    if not view.has_curves:
        return PoleView(found, None)
    if analysis.stop != "auto":
        stop = analysis.stop
    elif found.known_unstable:
        stop = scales.growth_time
    else:
        stop = settled_after(view.scene.checks, scales, found.resolution)
    solution = exact_solution(view.board, initial=analysis.initial)
    signs = np.array([output.sign for output in view.board.circuit.outputs])
    return PoleView(found, LinearResponse(solution, signs, scales, _rise(solution, stop), stop))


def view_limits(view: RestView, poles: PoleView) -> tuple[str, ...]:
    """Return what the op-amps of a stable linear board cannot do, the worst first.

    Costs some milliseconds, more where the board rings for long.
    """
    if poles.response is None or not poles.poles.known_stable:
        return ()
    loads = PartLoads.of(view.board, initial=view.scene.analysis.initial)
    if loads.unknown:
        return (loads.unknown,)
    above = [load for load in loads.loads if load.is_above]
    return tuple(LIMITED.format(load=describe(load)) for load in above[:1])


def view_boundary(view: RestView, poles: PoleView, name: str, low: float, high: float) -> Edges:
    """Find the edges of stability of a knob from `low` to `high`, or beyond.

    They are solved as `onset` solves them: by the loci of the parts, not by samples.

    EngineError: they are not known, with the reason.
    """
    if view.is_large:
        raise EngineError(f"a board of this size: `taction onset SCENE --over {name}` finds it")
    own = view.board.circuit.value(name)
    found = stable_values(view.board, name, max(high / own, own / low), poles.poles)
    if not poles.poles.certain:
        raise EngineError("a pole of the board is on the imaginary axis")
    return found


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """A verdict without what the page does not show."""

    record: Record  # of the verdict, or why there is none
    warnings: tuple[str, ...] = ()
    engine: str = ""  # the simulator
    curves: ExplorerCurves | None = None
    difference: float | None = None  # of the two engines, fraction of the step
    answer: AnswerError | None = None

    @classmethod
    def without_verdict(cls, error: Exception) -> Judgement:
        """Return why there is no verdict."""
        return cls(Record.without_verdict(type(error).__name__, str(error), ""))


def judge(scene: Scene, engine: str) -> Judgement:
    """Verify a scene with an engine."""
    try:
        verdict = verify(scene.with_engine(engine))
    except TactionError as error:
        return Judgement.without_verdict(error)
    amplitude, difference = verdict.measurements.amplitude, None
    agreement = verdict.agreement
    if agreement is not None and not agreement.reason and amplitude > 0.0:
        difference = agreement.difference / amplitude
    record = Record.of(verdict, channels=False)
    engine, curves = verdict.waveforms.simulator, _curves(verdict)
    return Judgement(record, verdict.warnings, engine, curves, difference, verdict.drawn_answer)


def _curves(verdict: Verdict) -> ExplorerCurves:
    """Return the record, with the window of its first rise."""
    time, outputs = verdict.waveforms.time, verdict.u
    stop = float(time[-1])
    rises = [c.rise_time.value for c in verdict.measurements.channels if c.rise_time is not None]
    return ExplorerCurves(time, outputs, min(WINDOW * max(rises, default=stop), stop), stop)


@dataclass(frozen=True, slots=True)
class Spot:
    """A value of one slider; all others are as they stand."""

    control: Control
    cell: int
    settings: Settings


def others(control: Control, settings: Settings) -> Settings:
    """Return what the outcomes along a slider depend on: all values but its own."""
    values = {path: v for path, v in settings.values.items() if path != control.path}
    return replace(settings, values=values)


def spots(start: Start, settings: Settings) -> list[Spot]:
    """Return the middles of the cells of all sliders, those nearest to the present values first."""
    found = []
    for control in start.controls:
        here = control.place(settings.values.get(control.path, control.own))
        for cell in range(CELLS):
            place = (cell + 0.5) / CELLS
            values = {**settings.values, control.path: control.chosen(place)}
            spot = Spot(control, cell, Settings.of(start, values, settings.opamp))
            found.append((round(CELLS * abs(place - here)), spot))
    return [spot for _, spot in sorted(found, key=lambda each: each[0])]


def outcome_of(scene: Scene) -> tuple[str, str]:
    """Return the outcome of a verdict by the state-space engine, and why it is no pass."""
    try:
        verdict = verify(scene.with_engine("statespace"), full_margin=False)
    except TactionError as error:
        return ERROR, str(error).partition("\n")[0]
    outcome = verdict.outcome
    names = [spaced(check.name) for check in verdict.checks if check.outcome is outcome]
    return outcome.value, "" if outcome.value == "pass" else ", ".join(names)
