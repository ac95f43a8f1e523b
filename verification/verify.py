"""The pipeline: scene, circuit, deck, waveforms, measurements, verdict."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from netlist_gen.analysis import Transient
from netlist_gen.circuit import Circuit, Floats
from netlist_gen.problem import InverseProblem, make_problem
from netlist_gen.scalings import make_scalings
from netlist_gen.scene import Scene
from netlist_gen.synthesis import synthesise
from verification.agreement import Agreement, compare_engines, exact_record, other_engine
from verification.attained import Accuracy, attained, both_tries, finer
from verification.budget import ErrorPart, error_budget
from verification.constraint import ConstraintPlane, constraint_plane
from verification.engines.equilibrium import equilibrium
from verification.ideal import IdealAnswer, ideal_answer, ideal_network
from verification.lambda_rule import resolve_lambda
from verification.margin import REACH, Margin, capacitance_margin
from verification.measures import Measurements
from verification.plan import plan_transient
from verification.record import measure_outputs
from verification.simulate import begin, choose_engine
from verification.spread import simulation_error
from verification.stability import Poles, poles_behind
from verification.timescales import time_scales
from verification.verdict import Check, Evidence, Outcome, SimulationError, judge, overall
from verification.warnings import find_warnings
from verification.waveforms import Waveforms

Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """Everything that `verify` found; `outcome` sums it up."""

    scene: Scene
    problem: InverseProblem
    circuit: Circuit
    transient: Transient
    ideal: IdealAnswer
    poles: Poles
    margin: Margin | None
    constraint: ConstraintPlane | None
    waveforms: Waveforms
    u: Floats
    measurements: Measurements
    error: SimulationError
    accuracy: Accuracy | None
    agreement: Agreement | None
    budget: tuple[ErrorPart, ...]
    checks: tuple[Check, ...]
    warnings: tuple[str, ...]
    outcome: Outcome
    timing: dict[str, float]


def verify(
    scene: Scene,
    progress: Progress = lambda stage: None,
    *,
    problem: InverseProblem | None = None,
    circuit: Circuit | None = None,
    ideal: IdealAnswer | None = None,
    second_look: bool = True,
    details: bool = True,
    full_margin: bool = True,
) -> Verdict:
    """Verify a scene: simulate its board, solve its problem, compare.

    Parameters
    ----------
    scene : Scene
        What is asked for.
    progress : callable, optional
        Told the name of each stage as it begins.
    problem : InverseProblem, optional
        The scene's problem where it is at hand already; its files are not read then.
    circuit : Circuit, optional
        The board to verify in place of the one that the scene's synthesis would give.
    ideal : IdealAnswer, optional
        The problem's own answer where it is at hand already.
    second_look : bool
        False: a stepping engine runs once, and its error is measured against the state-space
        engine instead of a second run; the two are no longer judged against each other.
    details : bool
        False: without what no check needs, the constraint plane's figures and the error budget.
    full_margin : bool
        False: the stability margin is looked for only as far as the scene's check wants it.

    Raises
    ------
    InputError
        The scene's files or numbers cannot be used.
    NoVerdictError
        No engine, or no trustworthy answer.
    """
    clock = _Clock(progress)
    clock.begin("synthesis")
    scene = resolve_lambda(scene)
    problem = make_problem(scene) if problem is None else problem
    circuit = synthesise(scene, problem) if circuit is None else circuit
    network = ideal_network(problem, make_scalings(scene), scene)
    clock.begin("poles")
    scales = time_scales(circuit, initial=scene.analysis.initial)
    poles = poles_behind(circuit, scales)
    engine = choose_engine(scene)
    transient = plan_transient(scene, scales, engine)
    clock.begin("simulation")
    pending = begin(scene, circuit, transient, engine, second_look=second_look)
    clock.begin("reference", beside="simulation")
    ideal = ideal_answer(network, scene) if ideal is None else ideal
    rest = equilibrium(circuit) if details else None
    constraint = constraint_plane(circuit) if details else None
    margin = _margin(circuit, scene.checks.stability.margin, full_margin)
    clock.begin("simulation")
    second, share = pending.second_look(), pending.share
    clock.begin("second look", beside="simulation")
    if not second_look and share and poles.stable:
        second, share = exact_record(circuit, transient), 1.0
    coarse = other = None
    if second is not None:
        coarse, _ = measure_outputs(scene, circuit, ideal, second, transient)
    if second is not None and second_look and poles.stable:
        other = other_engine(circuit, transient, second)
    clock.begin("simulation")
    simulation = pending.result(running_away=not poles.stable)
    clock.begin("measures")
    fine, u = measure_outputs(scene, circuit, ideal, simulation.fine, transient)
    if math.isinf(simulation.share):  # the record ends early: nothing tells its error
        coarse, share = None, math.inf
    error = simulation_error(fine, coarse, share)
    accuracy = attained(scene, circuit, scales, transient, simulation, fine.amplitude)
    if accuracy is not None and (again := finer(scene, accuracy)) is not None:
        options: dict[str, Any] = {"second_look": second_look, "details": details}
        options |= {"full_margin": full_margin, "ideal": ideal}
        verdict = verify(again, progress, problem=problem, circuit=circuit, **options)
        return replace(verdict, scene=scene, accuracy=both_tries(accuracy, verdict.accuracy))
    agreement = compare_engines(circuit, simulation, other) if other is not None else None
    evidence = Evidence(
        scene.checks, fine, error, agreement, poles, margin, ideal.error, ideal.problem
    )
    checks = judge(evidence)
    simulator = error.steady_state * fine.amplitude
    budget: tuple[ErrorPart, ...] = ()
    if rest is not None:
        budget = error_budget(problem, network, circuit, ideal, rest, u[-1], simulator)
    clock.end()
    return Verdict(
        scene=scene,
        problem=problem,
        circuit=circuit,
        transient=transient,
        ideal=ideal,
        poles=poles,
        margin=margin,
        constraint=constraint,
        waveforms=simulation.fine,
        u=u,
        measurements=fine,
        error=error,
        accuracy=accuracy,
        agreement=agreement,
        budget=budget,
        checks=checks,
        warnings=find_warnings(evidence, simulation.notes),
        outcome=overall(checks),
        timing=clock.seconds,
    )


def _margin(circuit: Circuit, wanted: float, full: bool) -> Margin | None:
    if wanted <= 1.0:
        return None
    return capacitance_margin(circuit, max(wanted, REACH) if full else wanted)


class _Clock:
    """Wall time of each stage, s; `beside` a stage whose processes run meanwhile."""

    def __init__(self, progress: Progress) -> None:
        self.seconds: dict[str, float] = {}
        self._progress = progress
        self._start = self._last = time.perf_counter()
        self._stage = ""

    def begin(self, stage: str, beside: str = "") -> None:
        self._close()
        self._stage = stage
        self._progress(f"{stage} (while the {beside} runs)" if beside else stage)

    def end(self) -> None:
        self._close()
        self.seconds["total"] = time.perf_counter() - self._start

    def _close(self) -> None:
        now = time.perf_counter()
        if self._stage:
            self.seconds[self._stage] = self.seconds.get(self._stage, 0.0) + now - self._last
        self._last = now
