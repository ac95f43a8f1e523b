"""A board is built and simulated: the engines, and the error of the state-space engine.

`build` gives a scene its board, with poles, time scales, engine, level and plan. Where an op-amp of
the small-signal board would exceed `FULL` of a limit on the way, the board is built again with
op-amps that have their limits. A board that would rest beyond a limit stays as it is: no level of
the model mends it.

`ENGINES` is the table of engines, to which installed packages add theirs. The exact solution of a
small linear board bounds its own rounding. Every other solution of the state-space engine is
computed a second time, with smaller steps or more patterns: the second one is the record, and its
error follows from the difference of the two.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import PHYSICAL_BOUND, Floats, Waveforms
from taction.system.errors import (
    BadEvidence,
    DivergesError,
    EngineError,
    NoVerdictError,
    StepTooSmall,
    TimedOut,
)
from taction.system.plugins import OpenTable
from taction.system.progress import Clock
from taction.system.reading_definitions import FOUND
from taction.verification.engines.ngspice.process import (
    Simulation,
    find_simulator,
    missing_simulator,
)
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.time_scales import time_scales
from taction.verification.engines.statespace.transients import reduced_transient, stepped
from taction.verification.engines.statespace.transients.exact import is_exact
from taction.verification.reference.ideal_answer import IdealAnswer, ideal_network
from taction.verification.reference.lambda_rule import resolve_lambda
from taction.verification.stability.poles import poles
from taction.verification.verdict.board import Board
from taction.verification.verdict.headroom import PartLoads, watched_nodes
from taction.verification.verdict.transient_plan import plan_transient

PATTERNED = 1.0  # of the difference to a model of fewer patterns, which may err hardly more
FALL = 64.0  # most that a bound falls by halved steps, of 512: a difference may be small by chance
ALIKE = 4.0  # times their difference: what two runs may err alike by rounding (seen: 1.75)
DIGITS = 2e-10  # of the largest voltage: least bound, as two runs may err alike (seen: 1.2e-10)
HALVED = 1.25  # of the difference to twice the steps by other roundings of the coefficients
HALVINGS = 3  # most, where the error of a record is above what is wanted


@dataclass(frozen=True, slots=True)
class StateSpaceError:
    """The error of a record of the state-space engine."""

    volts: float  # bound for any output at any time, V; NaN if the second solution failed
    how: str  # the source of the bound
    record: Waveforms  # that errs by no more: the given one if it is exact, else a better one


def state_space_error(
    board: LinearBoard, record: Waveforms, wanted: float = math.inf
) -> StateSpaceError:
    """Bound the error of a `record` of the state-space engine, or of a better one in its place.

    Steps are halved again until the bound is at most `wanted`, V. The errors of half a step fall by
    512, and a difference that falls by more than `FALL` is small by chance. One that falls by
    little is of rounding, and two draws of rounding may err alike.
    """
    found = _bounded(board, record)
    for _ in range(1, HALVINGS):
        if not (found.volts > wanted and found.record is not record):
            break
        record, before, better = found.record, found.volts, _bounded(board, found.record)
        if not better.volts < before:
            break
        found = replace(better, volts=max(ALIKE * better.volts, before / FALL))
    return found


def _bounded(board: LinearBoard, record: Waveforms) -> StateSpaceError:
    """Bound the error of a record, or of the next better one."""
    if is_exact(board):
        how = "bound on the rounding of the exact solution"
        return StateSpaceError(record.rounding, how, record)
    try:
        if record.method == stepped.METHOD:
            better, share, other = stepped.halved(record, resolved=True), HALVED, "twice the steps"
            times = np.union1d(better.time, record.time)
            times = times[times <= min(better.time[-1], record.time[-1])]
            off = on_curve(better, times) - on_curve(record, times)
        else:
            better, share, other = reduced_transient.refined(record), PATTERNED, "fewer patterns"
            off = better.values - record.values
    except EngineError as error:
        return StateSpaceError(math.nan, f"the second run failed: {error}", record)
    how = f"difference to a run with {other}, and what rounding leaves"
    least = DIGITS * float(np.abs(better.values).max(initial=0.0))
    volts = max(share * float(np.abs(off).max(initial=0.0)) + better.rounding, least)
    return StateSpaceError(volts, how, better)


def on_curve(record: Waveforms, times: Floats) -> Floats:
    """Return the voltages of a record with a curve at `times` (P,), V, (P, K)."""
    if record.curve is None:
        raise EngineError("the record is not known between its points")
    nodes = np.arange(len(record.nodes))
    values = record.curve(np.repeat(times, nodes.size), np.tile(nodes, times.size))
    return values.reshape(times.size, nodes.size)


# With KLU the tiny steps after a start from zero have more rounding than with the older solver;
# a few boards with nonlinear amplifiers fail there with KLU but not with the older solver.
SPARSE = "noopiter"
SECOND_SOLVER = (
    "the KLU solver failed at the start; this result is from the older solver of ngspice"
)
GROWING = 5_000  # least number of points in the record of an unstable board
SLOWER = 5.0  # times the timeout: a run with a longer estimated time does not start


Waiting = Callable[[], Waveforms]
"""Waits for the end of a simulation whose process may still run, and returns the waveforms."""


@dataclass(frozen=True, slots=True)
class Engine:
    """One engine."""

    # Begins the simulation of a board; returns what waits for its end and returns the waveforms.
    # Both may raise a `NoVerdictError`.
    begin: Callable[[Board], Waiting]
    # Bounds the error of waveforms of this engine. None for an engine that takes the steps of the
    # plan: the state-space engine then simulates beside it, and `engines_agree` compares them.
    error: Callable[[Board, Waveforms], StateSpaceError] | None = None
    title: str = ""  # name for people; by default that of the entry


def choose_engine(scene: Scene) -> str:
    """Return the engine: ``auto`` is ngspice, but for a stated error without a comparison."""
    if scene.analysis.engine != "auto":
        return scene.analysis.engine
    compared = scene.checks.engines_agree.tolerance is not None
    if scene.analysis.error != "auto" and not compared:
        return "statespace"
    return "statespace" if missing_simulator() else "ngspice"


def begin(board: Board) -> Waiting:
    """Start the simulation of a board; its process runs while the caller does other work.

    The record of a board that is known to be unstable may be partial; without any, it is a short
    one by the state-space engine. NoVerdictError: from this function or from what it returns.
    """
    engine = ENGINES[board.engine]
    return partial(_growing, board, engine) if board.plan.growing else engine.begin(board)


def _growing(board: Board, engine: Engine) -> Waveforms:
    """Simulate an unstable board, as far as its engine comes."""
    try:
        return engine.begin(board)()
    except NoVerdictError as error:
        reason = str(error).splitlines()[0]
        found = error.partial if isinstance(error, StepTooSmall | BadEvidence) else None
        if isinstance(found, Waveforms) and len(found.time) > 1:
            return replace(found, flags=(f"the record ends early: {reason}",))
        grown = min(board.scales.growth_time, board.transient.stop)
        analysis = Transient(grown, grown / GROWING, initial=board.transient.initial)
        waveforms = stepped.simulate(board.linear, analysis)
        note = f"this record is from the state-space engine: {reason}"
        return replace(waveforms, flags=(note, *waveforms.flags))


def _ngspice(board: Board) -> Waiting:
    """Start ngspice; where its fastest solver fails at the start, its older one runs, too."""
    analysis, plan, timeout = board.transient, board.plan, board.scene.analysis.timeout
    if plan.seconds > SLOWER * timeout:
        raise TimedOut(
            f"ngspice would need about {plan.seconds:.2g} s for {plan.steps:.2g} steps;"
            f" analysis.timeout is {timeout:g} s. Use the state-space engine, a larger"
            " analysis.error, a shorter analysis.stop or a longer analysis.timeout"
        )
    simulator = find_simulator()
    bound = PHYSICAL_BOUND * board.circuit.value("U0")

    def run(solver: str) -> Simulation:
        deck = write_deck(board.circuit, analysis, solver=solver)
        return Simulation(deck, simulator, timeout=timeout, bound=bound)

    first = run(simulator.solver_option)

    def wait() -> Waveforms:
        try:
            return first.result()
        except StepTooSmall as error:
            part = error.partial  # rounding can stop a run in its first 0.1 %
            early = not isinstance(part, Waveforms) or part.time[-1] < 1e-3 * analysis.stop
            if simulator.solver_option == SPARSE or not early:
                raise
            if error.folder is not None:  # the second run replaces this reproducer
                shutil.rmtree(error.folder, ignore_errors=True)
        waveforms = run(SPARSE).result()
        return replace(waveforms, flags=(*waveforms.flags, SECOND_SOLVER))

    return wait


def _statespace(board: Board) -> Waiting:
    """Simulate by the state-space engine; the points of an exact solution are found when asked."""
    linear, plan, analysis = board.linear, board.plan, board.transient
    ends = np.array([0.0, analysis.stop])

    def fill() -> Waveforms:
        nodes, steps = watched_nodes(board.circuit), not (board.circuit.is_linear or plan.growing)
        times = ends if steps else plan.instants(linear)
        return stepped.simulate(
            linear, analysis, times=times, tolerance=plan.tolerance, beside=nodes, resolved=steps
        )

    if plan.growing:
        analysis = replace(analysis, max_step=min(analysis.max_step, analysis.stop / GROWING))
    try:
        if is_exact(linear) and not plan.growing:  # measured on the solution, not on its points
            waveforms = replace(stepped.simulate(linear, analysis, times=ends), fill=fill)
        else:
            waveforms = fill()
    except DivergesError as error:
        if not isinstance(error.partial, Waveforms):
            raise
        waveforms = error.partial  # beside a stable equilibrium: its record ends early
    return lambda: waveforms


def _statespace_error(board: Board, waveforms: Waveforms) -> StateSpaceError:
    """Bound the error of a record, which is halved until it is what checks and readings want."""
    allowed = board.plan.wanted
    wanted = board.volts(allowed if board.circuit.is_linear else min(allowed, FOUND))
    if waveforms.time[-1] < board.transient.stop * (1.0 - 1e-9):
        wanted = math.inf  # it diverges, and so do two runs of it
    return state_space_error(board.linear, waveforms, wanted)


OWN = {
    "ngspice": Engine(_ngspice),
    "statespace": Engine(_statespace, _statespace_error, "state space"),
}
ENGINES = OpenTable("taction.engines", OWN, Engine)


def build(
    scene: Scene,
    clock: Clock | None = None,
    *,
    problem: InverseProblem | None = None,
    circuit: Circuit | LinearBoard | None = None,
    ideal: IdealAnswer | None = None,
    full_margin: bool = True,
) -> Board:
    """Synthesise the board of `scene` at its level, and plan its transient; errors as `verify`."""
    clock = clock or Clock(lambda stage: None)
    clock.begin("synthesis")
    scene = resolve_lambda(scene)
    problem = make_problem(scene) if problem is None else problem
    linear = LinearBoard.of(synthesise(scene, problem) if circuit is None else circuit)
    network = ideal_network(problem, scene)
    clock.begin("poles")

    def planned(linear: LinearBoard) -> Board:
        found = poles(linear)
        scales = time_scales(linear, initial=scene.analysis.initial).with_slower(found.rightmost)
        engine = choose_engine(scene)
        plan = plan_transient(
            scene,
            linear,
            scales,
            steps=ENGINES[engine].error is None,
            growing=found.known_unstable,
            resolution=found.resolution,
        )
        return Board(
            scene, problem, network, linear, scales, found, engine, plan, ideal, full_margin
        )

    level, able = scene.design.opamp.level, has_large_signal(linear)
    if level == "large-signal" and able:
        return planned(LinearBoard(large_signal(linear.circuit)))
    board = planned(linear)
    if not (board.poles.known_stable and board.circuit.is_small_signal):
        return board
    small = PartLoads.of(linear, board.transient, board.plan.tolerance)
    above = {load.quantity for load in small.loads if load.is_above}
    if level == "auto" and above and able and not small.impossible:
        limited = large_signal(linear.circuit, current="current" in above)
        board = planned(LinearBoard(limited))
    return replace(board, small=small)


def large_signal(circuit: Circuit, *, current: bool = True) -> Circuit:
    """Return the circuit with the limits of its op-amps; that of the `current` is an extra part."""
    models = {
        name: replace(m, large_signal=True, limits_current=current and m.has_largest_current)
        for name, m in circuit.models.items()
    }
    return replace(circuit, models=models)


def has_large_signal(board: LinearBoard) -> bool:
    """Whether both engines have the large-signal level of a board."""
    return all(
        math.isfinite(model.input_range) and model.imported is None
        for model in board.circuit.models.values()
    )
