"""One transient of a scene by one engine, with a second look at another step.

`ENGINES` is the table of engines; each takes a board and a transient, and gives `Simulation`.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import ExitStack
from dataclasses import dataclass, replace

import numpy as np

from netlist_gen.analysis import Transient
from netlist_gen.board.circuit import Circuit
from netlist_gen.deck.deck import write_decks
from netlist_gen.scene.scene import Scene
from spice_models.array_types import Floats
from spice_models.errors import (
    BadEvidence,
    SimulationError,
    SimulatorNotFound,
    SimulatorTooOld,
    StepTooSmall,
)
from verification.engines.ngspice import session
from verification.engines.ngspice.executable import find_simulator
from verification.engines.ngspice.process import PHYSICAL_BOUND, Run, start
from verification.engines.ngspice.session import Turn
from verification.engines.statespace.linearised.board import LinearBoard
from verification.pipeline.effort import FULL, Effort
from verification.pipeline.transient_plan import coarser
from verification.waveforms import Waveforms

# KLU pivots by its own rule and leaves more rounding in the tiny steps after a start from nothing;
# a few boards with nonlinear amplifiers do not get away from there. The older solver does.
SPARSE = "noopiter"
SECOND_SOLVER = "KLU did not get away from the start; ngspice's older solver gave this answer"
COARSER = 2.0  # the second run's step over the first's
ORDER = 2  # of the trapezoidal rule
STEP_SHARE = 0.05  # of a wanted error: the state-space engine's tolerance
LEAST_TOLERANCE, MOST_TOLERANCE = 1e-10, 1e-3  # rounding ends below, steps lose track above
SHARE = 1.0 / (COARSER**ORDER - 1.0)  # of the difference that is the finer run's own error


@dataclass(frozen=True, slots=True, eq=False)
class Simulation:
    """A transient and what tells its error.

    Attributes
    ----------
    fine : Waveforms
        The answer.
    coarse : Waveforms or None
        The same at twice the step; None from an engine that has no step.
    share : float
        What part of a difference between the two is the finer one's own error; infinite where
        there is no second run although one is needed.
    notes : tuple of str
        What the engine remarked.
    """

    fine: Waveforms
    coarse: Waveforms | None
    share: float
    notes: tuple[str, ...] = ()


class Pending:
    """A simulation under way; `result` waits for it.

    Parameters
    ----------
    fine, coarse : callable
        Wait for a run and return its waveforms; `coarse` only where there is a second run.
    share : float
        As `Simulation.share`.
    """

    def __init__(
        self,
        fine: Callable[[], Waveforms],
        coarse: Callable[[], Waveforms] | None = None,
        share: float = 0.0,
    ) -> None:
        self.share = share
        self._fine = fine
        self._coarse = coarse
        self._second: Future[Waveforms] | None = None

    def second_look(self) -> Waveforms | None:
        """Wait for the second run, which ends long before the first; None without a sound one.

        What went wrong with it is raised by `result`.
        """
        second = self._ask()
        return None if second is None or second.exception() else second.result()

    def result(self, *, running_away: bool = False) -> Simulation:
        """Wait and return the simulation, or raise what went wrong with it.

        Of a board that is known to be `running_away`, what was recorded before its voltages left
        every bound, or the step its limit, is a result.
        """
        try:
            fine, second = self._fine(), self._ask()
            coarse = None if second is None else second.result()
            return Simulation(fine, coarse, self.share, fine.flags)
        except (StepTooSmall, BadEvidence) as error:
            partial = error.partial
            if not (running_away and isinstance(partial, Waveforms) and len(partial.time) > 1):
                raise
            note = f"the record ends early: {str(error).splitlines()[0]}"
            return Simulation(partial, None, math.inf, (note,))

    def _ask(self) -> Future[Waveforms] | None:
        """Wait for the second run, once, and keep its waveforms or its error."""
        if self._coarse is not None and self._second is None:
            self._second = Future()
            try:
                self._second.set_result(self._coarse())
            except SimulationError as error:
                self._second.set_exception(error)
        return self._second


def choose_engine(scene: Scene) -> str:
    """Return the engine of `scene`; ``auto`` is ngspice where one that will do is found.

    A scene that asks for an error gets the cheapest engine for it, the state space, unless it
    also asks for a comparison of the two.
    """
    if scene.analysis.engine != "auto":
        return scene.analysis.engine
    compared = scene.checks.engines_agree.tolerance is not None
    if scene.analysis.error is not None and not compared:
        return "statespace"
    try:
        find_simulator()
    except (SimulatorNotFound, SimulatorTooOld):
        return "statespace"
    return "ngspice"


def state_space_tolerance(wanted: float) -> float:
    """Return the tolerance of the state-space engine's steps for an error of `wanted`.

    Errors of steps add up over a ringing, so it is well below.
    """
    return min(max(STEP_SHARE * wanted, LEAST_TOLERANCE), MOST_TOLERANCE)


def begin(
    scene: Scene, board: LinearBoard, analysis: Transient, engine: str, effort: Effort = FULL
) -> Pending:
    """Start a simulation; processes run while the caller does other work.

    With a second look an engine that has a step size runs twice, at two steps.

    Raises
    ------
    SimulationError
        From here or from `Pending.result`.
    """
    return ENGINES[engine](scene, board, analysis, effort)


def outputs(circuit: Circuit, waveforms: Waveforms) -> Floats:
    """Return u of every channel, shape (P, N), V; each channel's record is in one piece.

    It is not to be changed: where u is what the engine saved, it is that.
    """
    nodes = tuple(out.node for out in circuit.outputs)
    if nodes == waveforms.nodes and all(out.sign == 1.0 for out in circuit.outputs):
        return np.ascontiguousarray(waveforms.values.T).T
    rows = np.empty((len(circuit.outputs), len(waveforms.time)))
    for row, out in zip(rows, circuit.outputs, strict=True):
        np.multiply(waveforms[out.node], out.sign, out=row)
    return rows.T


def _ngspice(scene: Scene, board: LinearBoard, analysis: Transient, effort: Effort) -> Pending:
    circuit = board.circuit
    wanted = [analysis, coarser(analysis, COARSER)] if effort.second_look else [analysis]
    simulator = find_simulator()
    solver = simulator.solver_option
    timeout = scene.analysis.timeout
    bound = PHYSICAL_BOUND * circuit.scalings.unit_voltage
    decks = write_decks(circuit, wanted, solver=solver)
    begin_one = session.submit if effort.session else start
    with ExitStack() as cleanup:  # what goes wrong with one run ends the other
        runs: list[Run | Turn] = []
        for deck in decks:
            runs.append(begin_one(deck, simulator, timeout=timeout, bound=bound))
            cleanup.enter_context(runs[-1])
        under_way = cleanup.pop_all()

    def answer(run: Run | Turn, each: Transient) -> Waveforms:
        try:
            return run.result()
        except StepTooSmall as error:
            if solver == SPARSE or not _at_the_start(error, each):
                raise
            if error.folder is not None:  # a reproducer of nothing that is told
                shutil.rmtree(error.folder, ignore_errors=True)
        (deck,) = write_decks(circuit, [each], solver=SPARSE)
        waveforms = start(deck, simulator, timeout=timeout, bound=bound).result()
        return replace(waveforms, flags=(*waveforms.flags, SECOND_SOLVER))

    def finish() -> Waveforms:
        try:
            return answer(runs[0], analysis)
        except BaseException:  # also Ctrl-C: the other run ends with this one
            under_way.close()
            raise

    second = (lambda: answer(runs[1], wanted[1])) if effort.second_look else None
    return Pending(finish, second, SHARE)


def _at_the_start(error: StepTooSmall, analysis: Transient) -> bool:
    """Whether a run failed before it had come anywhere: rounding, not the board, stopped it."""
    partial = error.partial
    return not isinstance(partial, Waveforms) or partial.time[-1] < 1e-3 * analysis.stop


def _statespace(scene: Scene, board: LinearBoard, analysis: Transient, effort: Effort) -> Pending:
    from verification.engines.statespace.transients.exact import simulate

    wanted = scene.analysis.error
    tolerance = None if wanted is None else state_space_tolerance(wanted)
    waveforms = simulate(board, analysis, tolerance=tolerance)
    return Pending(lambda: waveforms)


ENGINES: dict[str, Callable[[Scene, LinearBoard, Transient, Effort], Pending]] = {
    "ngspice": _ngspice,
    "statespace": _statespace,
}
