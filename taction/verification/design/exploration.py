"""The back end of the explorer: settings, and rest, poles, curves, limits, verdict of a board.

What the page shows is found in steps, each a function of the results before it; the verdict
(`judge`) runs in a process of its own.
"""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import OPAMP, mistakes_of, with_values
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.keys import Value, find_key, own_value, read_value
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.topology import topology_of
from taction.system.array_types import Floats
from taction.system.errors import Complaint, EngineError, InputError, TactionError
from taction.system.quantities import show, show_rate, spaced
from taction.verification.design.trials import LAMBDA, with_lambda_held
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.time_scales import time_scales
from taction.verification.engines.statespace.transients.exact import Exact, exact_solution, is_exact
from taction.verification.reference.ideal_answer import ideal_network
from taction.verification.reference.lambda_rule import resolve_lambda
from taction.verification.reference.solve import solve
from taction.verification.stability.edges import Edges
from taction.verification.stability.margin import stable_values
from taction.verification.stability.poles import Poles, poles
from taction.verification.verdict.answer_error import AnswerError
from taction.verification.verdict.headroom import PartLoads, describe
from taction.verification.verdict.input_spread import outputs_at_rest
from taction.verification.verdict.record import ERROR, Record
from taction.verification.verdict.transient_plan import record_length
from taction.verification.verdict.verify import verify

STRAY, VARIANCE = "design.stray_capacitance", "problem.noise.variance"
AROUND, AROUND_LAMBDA = 30.0, 1000.0  # times and divided by the scene's value
LEAST_STRAY, MOST_STRAY = 1e-14, 1e-10  # F
LEAST_NOISE, MOST_NOISE = 1e-8, 1.0  # variance, of the mean square of the strain
STEPS, DIGITS = 1000, 4  # places of a slider, and digits of their values
ZERO_PART = 0.04  # of a slider whose value may be zero: its lower end


@dataclass(frozen=True, slots=True)
class Control:
    """A key with a logarithmic slider; all values are in `unit`."""

    path: str
    unit: str
    symbol: str  # on the page, as the name
    name: str
    low: float  # ends of the slider
    high: float
    own: float  # the scene's value
    has_zero: bool = False  # the lower end of the slider is zero

    def chosen(self, place: float) -> float:
        """Return the value that a hand means at a place."""
        if abs(place - self.place(self.own)) < 0.5 / STEPS:
            return self.own
        return float(f"{self.value(place):.{DIGITS}g}")

    def value(self, place: float) -> float:
        """Return the value at a place of the slider from 0 to 1."""
        start = ZERO_PART if self.has_zero else 0.0
        if self.has_zero and place < start:
            return 0.0
        share = min((place - start) / (1.0 - start), 1.0)
        return self.high if share == 1.0 else self.low * (self.high / self.low) ** share

    def place(self, value: float) -> float:
        """Return the place of a value on the slider, from 0 to 1; the nearest end outside of it."""
        if value <= 0.0:
            return 0.0
        start = ZERO_PART if self.has_zero else 0.0
        share = math.log(value / self.low) / math.log(self.high / self.low)
        return round(start + (1.0 - start) * min(max(share, 0.0), 1.0), 12)


def controls(scene: Scene) -> tuple[Control, ...]:
    """Return the controls of a scene whose lambda is a number."""
    topology, found = topology_of(scene), list[Control]()
    facts = topology.facts(scene)
    for knob in (knob for knob in topology.knobs(scene) if knob.margin):
        name = knob.key.rpartition(".")[2].replace("_", " ")
        found.append(_control(scene, knob.key, facts[knob.name].symbol, name, AROUND))
    if facts["lambda"].value > 0.0:
        found.append(_control(scene, LAMBDA, "λ", "regularisation", AROUND_LAMBDA))
    strain = float(np.mean(make_problem(scene).strain ** 2)) or 1.0
    for path, symbol, name, low, high in (
        (STRAY, "stray", "capacitance", LEAST_STRAY, MOST_STRAY),
        (VARIANCE, "σ²", "strain noise variance", LEAST_NOISE * strain, MOST_NOISE * strain),
    ):
        control = _control(scene, path, symbol, name, 10.0)
        if control.own > 0.0:
            low, high = min(low, control.low), max(high, control.high)
        found.append(replace(control, low=low, high=high, has_zero=True))
    return tuple(found)


def _control(scene: Scene, path: str, symbol: str, name: str, around: float) -> Control:
    key = find_key(scene, path)
    own = float(own_value(scene, key) or 0.0)
    return Control(path, key.unit, symbol, name, own / around, own * around, own)


@dataclass(frozen=True, slots=True)
class Settings:
    """Values of controls that differ from those of the scene, by their paths, and a preset."""

    original: Scene = field(compare=False)  # lambda is a number
    controls: tuple[Control, ...] = field(compare=False)
    values: Mapping[str, float] = field(default_factory=dict)
    opamp: str = ""  # empty: the scene's op-amp

    @classmethod
    def of(cls, scene: Scene) -> Settings:
        """Begin with a scene."""
        scene = resolve_lambda(scene)
        return cls(scene, controls(scene))

    def control(self, path: str) -> Control:
        """Return the control of a key; raises `InputError` for a key without one."""
        known = {control.path: control for control in self.controls}
        if path not in known:
            text = f"expected one of {', '.join(known)}"
            raise InputError("explore", Complaint("key", repr(path), text))
        return known[path]

    def typed(self, path: str, text: str) -> float:
        """Return the value that a user typed for a control, as a scene file has it."""
        with mistakes_of("explore"):
            return float(read_value(find_key(self.original, self.control(path).path), text.strip()))

    def moved(self, values: Mapping[str, float], opamp: str = "") -> Settings:
        """Return other settings: of `values` those that differ from the scene's."""
        own = {control.path: control.own for control in self.controls}
        changed = {path: float(v) for path, v in values.items() if float(v) != own[path]}
        return replace(self, values=changed, opamp=opamp)

    def changes(self) -> dict[str, Value]:
        """Return what to change in the scene; no rule chooses another lambda."""
        scene, changed = self.original, dict[str, Value](self.values)
        if self.opamp:
            changed[OPAMP] = self.opamp
        lam = float(own_value(scene, find_key(scene, LAMBDA)) or 0.0)
        if changed and scene.lambda_rule:
            return {LAMBDA: lam, **changed}
        return with_lambda_held(scene, changed, lam)

    def scene(self) -> Scene:
        """Return the scene with these values; raises `InputError` for one that its key refuses."""
        changed = self.changes()
        return with_values(self.original, changed) if changed else self.original

    def command(self) -> str:
        """Return the command line that verifies these values."""
        words = ["taction", "verify", str(self.original.file)]
        for path, value in self.changes().items():
            words += ["--set", f"{path}={value if isinstance(value, str) else repr(value)}"]
        return shlex.join(words)


POINTS = 500  # of a curve without fast ringing
PER_PERIOD = 20.0  # points of a curve with ringing, before it is thinned
MOST = 20_000  # points of a curve
WINDOW = 10.0  # times the longest rise time of a verdict: the window of the first rise
RISEN, TIMES_RISE = 0.9, 6.0  # of a channel's step; the window of the rise in times of it
SEARCHED = 400  # instants at which the rise is looked for
EARLIEST = 1e-5  # of the record: the first of them
ON_THE_AXIS = "a pole is so close to the axis that rounding decides whether the board is stable"
GROWS = "the board is unstable: the smallest disturbance {how}, until the op-amps limit it"
LIMITED = (
    "the curves show the linear board, and its op-amps cannot follow: {load}. The verdict is of"
    " op-amps with their limits, where the model has them"
)


@dataclass(frozen=True, slots=True, eq=False)
class ExplorerCurves:
    """Outputs of every channel over time."""

    time: Floats  # (P,), s
    outputs: Floats  # (P, N), V
    windows: dict[str, float]  # ends of "rise", the first rise of every channel, and of "whole", s


class BoardView:
    """A board that was linearised at rest; what takes longer is found at its first use.

    InputError, or NoVerdictError if it has no equilibrium.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene, self.problem = scene, make_problem(scene)
        self.board = LinearBoard(synthesise(scene, self.problem))
        self.scales = time_scales(self.board, initial=scene.analysis.initial)
        network = ideal_network(self.problem, scene)
        self.answer = AnswerError.of(network, solve(network.problem), self.problem.stress)
        self.rest = outputs_at_rest(self.board)  # (N,), V

    @cached_property
    def poles(self) -> Poles:
        """The poles of the board."""
        return poles(self.board)

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

    @cached_property
    def _solution(self) -> Exact:
        return exact_solution(self.board, initial=self.scene.analysis.initial)

    @cached_property
    def windows(self) -> dict[str, float]:
        """The ends of the first rise of all channels and of the record."""
        solution, unstable = self._solution, self.poles.known_unstable
        stop = record_length(self.scene, self.scales, self.poles.resolution, growing=unstable)
        times = np.geomspace(EARLIEST * stop, stop, SEARCHED)
        with np.errstate(over="ignore", invalid="ignore"):
            moved = np.abs(solution.at(times) - solution.start)
        steps = np.abs(solution.final - solution.start)
        large = steps > 0.05 * steps.max(initial=0.0)
        reached = moved[:, large] >= RISEN * steps[large]
        first = times[np.where(reached.any(axis=0), reached.argmax(axis=0), SEARCHED - 1)]
        rise = TIMES_RISE * float(first.max()) if large.any() else stop
        return {"rise": min(rise, stop), "whole": stop}

    def curves(self, window: str) -> ExplorerCurves:
        """Return the outputs in a window, with `PER_PERIOD` points a period of ringing."""
        end = self.windows[window]
        period = min((math.tau / p.imag for p in self.scales.ringing), default=math.inf)
        wanted = PER_PERIOD * end / period if period > 0.0 else 0.0
        time = np.linspace(0.0, end, int(min(max(wanted, POINTS), MOST)))
        signs = np.array([output.sign for output in self.board.circuit.outputs])
        with np.errstate(over="ignore", invalid="ignore"):
            return ExplorerCurves(time, self._solution.at(time) * signs, self.windows)

    def limits(self) -> tuple[str, ...]:
        """Return what the op-amps of a stable linear board cannot do, the worst first."""
        if not (is_exact(self.board) and self.poles.known_stable):
            return ()
        endless = Transient(math.inf, math.inf, initial=self.scene.analysis.initial)
        loads = PartLoads.of(self.board, endless)
        if loads.unknown:
            return (loads.unknown,)
        above = [load for load in loads.loads if load.is_above]
        return tuple(LIMITED.format(load=describe(load)) for load in above[:1])

    def boundary(self, name: str, low: float, high: float) -> Edges:
        """Find the edges of stability of a knob from `low` to `high`, or beyond, by the loci."""
        if self.board.descriptor.is_large:  # its poles take longer than a movement of the hand
            raise EngineError(f"a board of this size: `taction onset SCENE --over {name}` finds it")
        own = self.board.circuit.value(name)
        found = stable_values(self.board, name, max(high / own, own / low), self.poles)
        if self.poles.stable is None:
            raise EngineError("a pole of the board is on the imaginary axis")
        return found


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """A verdict without what the page does not show."""

    record: Record  # of the verdict, or why there is none
    warnings: tuple[str, ...] = ()
    curves: ExplorerCurves | None = None
    answer: AnswerError | None = None


def outcome_of(scene: Scene) -> tuple[str, str]:
    """Return the outcome of a scene by the state-space engine, and which checks do not pass."""
    try:
        record = Record.of(verify(scene.with_engine("statespace"), full_margin=False))
    except TactionError as error:
        return ERROR, str(error).partition("\n")[0]
    return record.outcome, ", ".join(map(spaced, record.failed)) or "all checks pass"


def judge(scene: Scene, engine: str = "statespace") -> Judgement:
    """Verify a scene with an engine."""
    try:
        verdict = verify(scene.with_engine(engine))
    except TactionError as error:
        return Judgement(Record.without_verdict(error, ""))
    time, stop = verdict.waveforms.time, float(verdict.waveforms.time[-1])
    rises = [c.rise_time.value for c in verdict.measurements.channels if c.rise_time is not None]
    windows = {"rise": min(WINDOW * max(rises, default=stop), stop), "whole": stop}
    return Judgement(
        Record.of(verdict, channels=False),
        verdict.warnings,
        ExplorerCurves(time, verdict.u, windows),
        verdict.drawn_answer,
    )
