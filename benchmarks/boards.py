"""Boards that the engines are timed on, and ngspice at its best setting for a wanted error.

What an error is: the largest difference of any output at any recorded instant from the reference,
over the step amplitude. What a time is: of ngspice the wall time of its process alone, without
writing the deck or reading the result; of the state-space engine everything from the `Circuit` to
the `Waveforms`.
"""

from __future__ import annotations

import math
import re
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from netlist_gen.analysis import Transient
from netlist_gen.board.circuit import Circuit
from netlist_gen.board.synthesis import synthesise
from netlist_gen.deck.deck import write_deck
from netlist_gen.overrides.axes import with_values
from netlist_gen.overrides.keys import Value
from netlist_gen.problem.inverse_problem import make_problem
from netlist_gen.scene.file import load_scene
from netlist_gen.scene.scene import Scene
from spice_models.array_types import Floats
from spice_models.errors import SimulationError
from verification.engines.ngspice import process
from verification.engines.ngspice.executable import find_simulator
from verification.engines.statespace.transients import exact
from verification.pipeline.transient_plan import POINTS_PER_PERIOD, coarser, plan_transient
from verification.small_signal.time_scales import time_scales
from verification.waveforms import Waveforms

SCENES = Path(__file__).parents[1] / "scenes"
ROOMY: dict[str, Value] = {
    "problem.span": 6.0,
    "problem.quadrature": "rectangle",
    "design.lambda": 0.1,
}
FREE = 50.0  # steps that a record has at least where only the truncation error bounds them
FIRST = 1e-3  # of those steps: the print interval, a tenth of which is ngspice's first step
CLOSE = 0.8  # of the wanted error: near enough to it to stop looking for a cheaper setting
TRIALS = 6  # settings tried
Reference = Callable[[Floats], Floats]


@dataclass(frozen=True, eq=False)
class Board:
    """A board and its planned transient."""

    scene: Scene
    circuit: Circuit
    transient: Transient


def make_board(scene: Scene) -> Board:
    """Synthesise a scene and plan its transient."""
    circuit = synthesise(scene, make_problem(scene))
    return Board(scene, circuit, plan_transient(scene, time_scales(circuit)))


def shipped(name: str) -> Board:
    """Return a board of ``scenes/``."""
    return make_board(load_scene(SCENES / f"{name}.toml"))


def wide(channels: int) -> Board:
    """Return a stable board of any size: the tuned breadboard's parts, and a wider span.

    Quadrature weights keep |T| the same for every number of channels, lambda is 0.1.
    """
    base = load_scene(SCENES / "tuned-breadboard.toml")
    own: dict[str, Value] = {"name": f"wide-{channels}", "problem.channels": channels}
    return make_board(with_values(base, ROOMY | own))


@dataclass(frozen=True)
class Setting:
    """How ngspice (trapezoidal) is told to step.

    Attributes
    ----------
    kind : str
        ``"even"``: `value` points on the period of the fastest ringing, at most a step's length
        anywhere; ``"free"``: steps as long as a truncation error of `value` allows.
    value : float
        Points, or relative truncation error.
    solver : str
        ``"klu"``, or ``"noopiter"`` for the older sparse solver.
    """

    kind: str
    value: float
    solver: str

    @property
    def text(self) -> str:
        """In words."""
        what = "points a period" if self.kind == "even" else "truncation error"
        name = "KLU" if self.solver == "klu" else "Sparse"
        return f"{self.kind} steps, {self.value:.3g} {what}, {name}"


@dataclass(frozen=True)
class Trial:
    """One run of ngspice: its setting, wall time in s, points, and error in step amplitudes."""

    setting: Setting
    seconds: float
    points: int
    error: float


# Exponent with which the error follows the setting's value, and the first value to try: of the
# second order in the step, whose cube is the truncation error.
KINDS = {"even": (-2.0, 64.0), "free": (2.0 / 3.0, 2e-5)}


def run_ngspice(board: Board, setting: Setting, timeout: float) -> Waveforms:
    """Run one transient at `setting`."""
    planned = board.transient
    if setting.kind == "even":
        points = board.scene.analysis.points_per_period or POINTS_PER_PERIOD
        transient = coarser(planned, points / setting.value)
    else:
        transient = replace(planned, max_step=planned.stop / FREE, truncation=setting.value)
    relative = min(1e-6, transient.truncation)
    deck = write_deck(board.circuit, transient, solver=setting.solver, relative=relative)
    if setting.kind == "free":
        first = f".tran {FIRST * transient.max_step!r} "
        deck = replace(deck, text=re.sub(r"^\.tran \S+ ", first, deck.text, flags=re.MULTILINE))
    return process.simulate(deck, find_simulator(), timeout=timeout)


@dataclass
class Ladder:
    """Settings tried on a board, and the cheapest that reached the wanted error."""

    board: Board
    reference: Reference
    wanted: float
    timeout: float
    trials: list[Trial] = field(default_factory=list)

    def climb(self, kind: str) -> None:
        """Close in on the wanted error from the error's own dependence on the setting."""
        slope, value = KINDS[kind]
        for _ in range(TRIALS):
            trial = self.attempt(Setting(kind, value, "klu"))
            if CLOSE * self.wanted <= trial.error <= self.wanted or not math.isfinite(trial.error):
                return
            if trial.error > self.wanted and self.hopeless(trial):
                return
            last = self.trials[-2] if len(self.trials) > 1 else None
            if last is not None and last.setting.kind == kind:
                found = math.log(trial.error / last.error) / math.log(value / last.setting.value)
                slope = found if 0.3 < found / KINDS[kind][0] < 3.0 else KINDS[kind][0]
            value *= (0.9 * self.wanted / trial.error) ** (1.0 / slope)

    def hopeless(self, trial: Trial) -> bool:
        """Whether a finer setting of the same kind would cost more than what is found already."""
        good = [each.seconds for each in self.trials if each.error <= self.wanted]
        return trial.seconds > min(good, default=math.inf)

    def attempt(self, setting: Setting) -> Trial:
        """Run once and compare; a run that fails, or is too slow, has an infinite error."""
        began = time.perf_counter()
        try:
            found = run_ngspice(self.board, setting, self.timeout)
            off = float(np.abs(found.values - self.reference(np.array(found.time))).max())
            trial = Trial(setting, found.cost.seconds, len(found.time), off / self.amplitude)
        except SimulationError:
            trial = Trial(setting, time.perf_counter() - began, 0, math.inf)
        self.trials.append(trial)
        return trial

    @property
    def amplitude(self) -> float:
        """Step amplitude: what the outputs move between the first and the last instant, V."""
        return float(np.abs(np.diff(self.reference(self.ends), axis=0)).max())

    @property
    def ends(self) -> Floats:
        """First and last instant, s."""
        return np.array([0.0, self.board.transient.stop])

    @property
    def best(self) -> Trial:
        """The cheapest trial that reached the wanted error."""
        good = [trial for trial in self.trials if trial.error <= self.wanted]
        return min(good, key=lambda trial: trial.seconds)

    def rows(self) -> list[tuple[str, ...]]:
        """Return the trials as text."""
        return [
            (t.setting.text, f"{t.points}", f"{t.error:.2e}", f"{1e3 * t.seconds:.1f}")
            for t in self.trials
        ]


def run_statespace(board: Board, points: int) -> float:
    """Time one transient of the state-space engine with `points` points, s."""
    transient = replace(board.transient, max_step=board.transient.stop / points)
    circuit = board.circuit
    began = time.perf_counter()
    exact.simulate(circuit, transient)
    return time.perf_counter() - began


def exponent(sizes: list[int], seconds: list[list[float]], least: int = 0) -> float:
    """Fit ``seconds ~ size^p`` to the medians of sizes from `least` on, and return p."""
    pairs = zip(sizes, seconds, strict=True)
    kept = [(math.log(n), math.log(statistics.median(s))) for n, s in pairs if n >= least and s]
    x, y = np.array(kept).T
    return float(np.polyfit(x, y, 1)[0])
