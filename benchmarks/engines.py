"""The state-space engine beside ngspice at equal error, and how both grow with the board.

ngspice runs with the step control that `verify` plans for an error of 1e-4, of closed-loop boards
with wires 1e-6. The time of the
state-space engine is everything from the `Circuit` to as many points of the `Waveforms`.
"""

from __future__ import annotations

import gc
import statistics
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks.bare import process_seconds, solver
from benchmarks.measuring import SCENES, Extent, Figure, Result, Table, in_turns, ratios, wall
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.keys import Value
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.time_scales import time_scales
from taction.verification.engines.statespace.transients import exact, simulate
from taction.verification.stability.poles import poles
from taction.verification.verdict.transient_plan import TransientPlan, plan_transient
from tests.support.precise import precise_step

ERROR = 1e-4  # of the step amplitude
STEPS: dict[str, Value] = {"analysis.error": ERROR}
POINTS = 2000  # of a record of the state-space engine
SIZES = {
    Extent.TINY: (2, 3),
    Extent.QUICK: (7, 16, 32, 64),
    Extent.FULL: (7, 16, 32, 64, 128, 256, 500),
}
BOTH = ("paper-breadboard", "tuned-breadboard")
BOARDS = {Extent.TINY: BOTH[1:], Extent.QUICK: BOTH, Extent.FULL: BOTH}
ROUNDS = {Extent.TINY: 1, Extent.QUICK: 5, Extent.FULL: 9}
LARGEST_NGSPICE = 128  # channels
WIDE: dict[str, Value] = {
    "problem.span": 6.0,
    "problem.quadrature": "rectangle",
    "design.lambda": 0.1,
}


WIRED = {Extent.TINY: 3, Extent.FULL: 32}  # channels of boards with wires
CLOSE = {Extent.TINY: ERROR, Extent.FULL: 1e-6}  # error of their transients, of the step amplitude
FEEDBACK = {"inv": {}, "pinv": {"design.feedback_conductance": 1.04e-3}}  # 3 times the least one


@dataclass(frozen=True, eq=False)
class Board:
    """A board and its planned transient."""

    linear: LinearBoard
    plan: TransientPlan

    @classmethod
    def of(cls, scene: Scene, steps: dict[str, Value] = STEPS) -> Board:
        """Synthesise a scene and plan its transient, by default for `ERROR`."""
        scene = with_values(scene, steps)
        board = LinearBoard(synthesise(scene))
        scales = time_scales(board)
        return cls(board, plan_transient(scene, board, scales, stable=poles(board).stable))

    def statespace(self, points: int) -> None:
        """Simulate by the state-space engine, from the circuit on."""
        transient = self.plan.transient
        transient = replace(transient, max_step=transient.stop / points)
        simulate.simulate(self.linear.circuit, transient)

    def ngspice(self) -> float:
        """Return the wall time of the ngspice process, s."""
        return process_seconds(
            write_deck(self.linear.circuit, self.plan.transient, solver=solver())
        )


def wide(channels: int) -> Scene:
    """Return a stable board of any size: the parts of the tuned breadboard, and a wider span.

    Quadrature weights keep |T| the same for every number of channels; lambda is 0.1.
    """
    own: dict[str, Value] = {"name": f"wide-{channels}", "problem.channels": channels}
    return with_values(load_scene(SCENES / "tuned-breadboard.toml"), WIDE | own)


def wired(topology: str, channels: int) -> Scene:
    """Return a closed-loop board with wires, of conductances ``0.5^|i - j| G0``."""
    place = np.arange(channels)
    scene = Scene.from_arrays(
        0.5 ** np.abs(place[:, None] - place), np.where(place % 3 == 0, -0.05, 0.1),
        topology=topology, unit_conductance=1e-4, opamp="opa189",
    )  # fmt: skip
    lines = dict.fromkeys(("wires.word_line", "wires.bit_line"), 1.0)
    ends = dict.fromkeys(("wires.driver", "wires.sense"), 5.0)
    return with_values(scene, {**lines, **ends, "wires.compensate": True, **FEEDBACK[topology]})


def measure(extent: Extent) -> Result:
    """Measure two seven-channel boards, then boards of growing size."""
    rounds = ROUNDS[extent]
    figures: list[Figure] = []
    for name in BOARDS[extent]:
        board = Board.of(load_scene(SCENES / f"{name}.toml"))
        figures.append(beside_ngspice(name, board, rounds, 10.0))
        if extent is Extent.FULL:
            figures.append(precision(name, board))
    for topology in FEEDBACK if extent in WIRED else ():
        channels, error = WIRED[extent], CLOSE[extent]
        board = Board.of(wired(topology, channels), {"analysis.error": error})
        name = f"{topology} with wires, {channels} channels"
        figures.append(beside_ngspice(name, board, 1, 500.0, error))
    grown = growth(SIZES[extent], rounds)
    if extent is Extent.FULL:
        figures.append(beside_ngspice("128 channels", Board.of(wide(128)), 3, 100.0))
    return replace(grown, figures=figures + grown.figures)


def beside_ngspice(
    name: str, board: Board, rounds: int, wanted: float, error: float = ERROR
) -> Figure:
    """Time one transient by both engines, with as many points each."""
    points = int(board.plan.forecast.steps)
    jobs = {"ngspice": board.ngspice, "statespace": wall(partial(board.statespace, points))}
    found = in_turns(jobs, rounds)
    what, base = f"ngspice at an error of {error:g}, {name}", "state space, as many points"
    return Figure(what, base, ratios(found["ngspice"], found["statespace"]), wanted, least=True)


def precision(name: str, board: Board) -> Figure:
    """Compare the exact solution with 50 digits, at 22 instants."""
    descriptor, stop = board.linear.descriptor, board.plan.transient.stop
    times, precise = precise_step(descriptor, stop, 22)
    charged = np.flatnonzero(descriptor.dense.mass.any(axis=1))
    names = [descriptor.names[place] for place in charged]
    solution = exact.exact_solution(board.linear)
    columns = [names.index(node) for node in solution.nodes]
    off = np.abs(solution.at(np.array(times)) - precise[:, columns]).max()
    error = float(off / np.abs(solution.final - solution.start).max())
    what = f"error of the state space against 50 digits, {name}"
    return Figure(what, f"an error of {ERROR:g}", [error / ERROR], 1e-4)


def growth(sizes: tuple[int, ...], rounds: int) -> Result:
    """Time transient and rightmost poles of the state-space engine, and ngspice, over N."""
    times: dict[str, list[float]] = {"transient": [], "rightmost poles": [], "ngspice": []}
    for channels in sizes:
        board = Board.of(wide(channels))
        circuit = board.linear.circuit
        jobs: dict[str, Any] = {
            "transient": wall(partial(board.statespace, POINTS)),
            "rightmost poles": wall(partial(poles, circuit)),
        }
        if channels <= LARGEST_NGSPICE:
            jobs["ngspice"] = board.ngspice
        found = in_turns(jobs, rounds if channels < 64 else min(rounds, 2))
        for name, seconds in times.items():
            seconds.append(statistics.median(found[name]) if name in found else np.nan)
        gc.collect()
    shown = [times["transient"][0], times["transient"][-1]]
    pair = f"{sizes[0]} channels"
    rows = [
        (f"{channels}", *("" if np.isnan(t[k]) else f"{1e3 * t[k]:.1f}" for t in times.values()))
        for k, channels in enumerate(sizes)
    ]
    columns = ("channels", *(f"{name}, ms" for name in times))
    return Result(
        [Figure(f"state space, transient of {sizes[-1]} channels", pair, [shown[1] / shown[0]])],
        [Table("Growth with the number of channels", columns, rows)],
        {"growth.png": partial(draw, sizes=sizes, times=times)},
    )


def draw(figure: Any, sizes: tuple[int, ...], times: dict[str, list[float]]) -> None:
    """Draw the times over the number of channels, with the slopes 1 and 2 beside them."""
    axes = figure.subplots()
    for name, seconds in times.items():
        axes.loglog(sizes, seconds, "o-", label=name)
    x = np.array([sizes[0], sizes[-1]], dtype=float)
    for power in (1, 2):
        y = times["transient"][0] * (x / x[0]) ** power
        axes.loglog(x, y, "k:", linewidth=0.8)
        axes.annotate(f"slope {power}", (x[1], y[1]), ha="right")
    axes.set(xlabel="channels N", ylabel="s", title="time of one transient; of the rightmost poles")
    axes.legend()
