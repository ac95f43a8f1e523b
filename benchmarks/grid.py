"""What the simulations of `verify` cost beside the cheapest bare ngspice, over C and gain.

`verify` runs with ``analysis.error = 1e-4``. Every deck that it gives to ngspice is recorded and
run again, in turns with the cheapest bare run that has the same error. Compared are the processor
times of the ngspice processes and, independent of the machine, the accepted time points.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any
from unittest import mock

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.bare import Truth, cheapest, error_of, processor_seconds, true_solution
from benchmarks.engines import Board
from benchmarks.measuring import SCENES, Extent, Figure, Result, Table, in_turns, ratios
from taction.netlist_gen.deck.deck import Deck
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene
from taction.verification.engines.ngspice import process
from taction.verification.engines.ngspice.process import start
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.transients.small_steps import StateBoard
from taction.verification.engines.statespace.transients.stepped import SteppedRun, Task
from taction.verification.verdict.recording import Accuracy
from taction.verification.verdict.verify import verify

ERROR = 1e-4  # of the step amplitude
MEAN, LARGEST = 2.0, 4.0  # wanted: times the processor time of the cheapest bare run
C, GAIN = (5e-12, 1e-9), (1e5, 2e7)  # F, ohm
SIZES = {Extent.TINY: (1, 1), Extent.QUICK: (4, 3), Extent.FULL: (8, 6)}
BOARDS = {"linear": "paper-breadboard", "exponential": "paper-exponential"}
INSTANTS = 300  # at which two integrators are compared
PATIENCE = 2.0  # times the time of `verify`: what takes longer is no cheaper bare run
LEAST_SECONDS, ROUNDS = 1.0, 5  # a board's runs are repeated until one of the two is reached


@dataclass(frozen=True)
class Point:
    """One stable board of the grid.

    Attributes
    ----------
    scene : Scene
        With C and gain of the board.
    error : float
        True error of the record of `verify`, in step amplitudes.
    accuracy : Accuracy
        What `verify` says of its record.
    points : tuple of int
        Accepted time points of `verify` (of its last run), and of the cheapest bare run.
    seconds : list of float
        Ratios of processor times, one for each pair; empty if no bare run reaches the error.
    """

    scene: Scene
    error: float
    accuracy: Accuracy
    points: tuple[int, int]
    seconds: list[float]

    @property
    def place(self) -> tuple[float, float]:
        """C in F and gain in ohm."""
        return self.scene.design.capacitance, self.scene.design.gain

    @property
    def ratio(self) -> float:
        """Median ratio of the processor times; NaN without a bare run."""
        return statistics.median(self.seconds) if self.seconds else float("nan")


def grid(scene: Scene, rows: int, columns: int) -> Iterator[Scene]:
    """Yield the scenes of the grid, C and gain in geometric progression."""
    for capacitance in np.geomspace(*C, rows + 2 if rows == 1 else rows).tolist()[-rows:]:
        for gain in np.geomspace(*GAIN, columns).tolist():
            values = {"design.capacitance": capacitance, "design.gain": gain}
            yield with_values(scene, values | {"analysis.error": ERROR})


def measure_point(scene: Scene) -> Point | None:
    """Measure one board; None if it is unstable."""
    decks: list[Deck] = []

    def recorded(deck: Deck, *given: Any, **named: Any) -> Any:
        decks.append(deck)
        return start(deck, *given, **named)

    with mock.patch.object(process, "start", recorded):
        verdict = verify(scene.with_engine("ngspice"))
    if not verdict.poles.stable:
        return None
    board, transient = LinearBoard.of(verdict.circuit), verdict.transient
    truth: Truth = true_solution(board, transient)
    timeout = PATIENCE * verdict.accuracy.seconds + 5.0
    best = cheapest(board, transient, truth, ERROR, timeout)
    pairs: list[float] = []
    if best is not None:
        bare = best.deck
        jobs = {
            "verify": lambda: sum(processor_seconds(deck) for deck in decks),
            "bare": lambda: processor_seconds(bare),
        }
        rounds = min(ROUNDS, 1 + int(LEAST_SECONDS / verdict.accuracy.seconds))
        found = in_turns(jobs, rounds)
        pairs = ratios(found["verify"], found["bare"])
    return Point(
        scene=scene,
        error=error_of(verdict.waveforms, truth, transient.stop),
        accuracy=verdict.accuracy,
        points=(verdict.accuracy.points, best.points if best else 0),
        seconds=pairs,
    )


def measure(extent: Extent) -> Result:
    """Measure both boards over the grid."""
    figures: list[Figure] = []
    tables: list[Table] = []
    found = {}
    for kind, name in BOARDS.items():
        scenes = grid(load_scene(SCENES / f"{name}.toml"), *SIZES[extent])
        found[kind] = [point for point in map(measure_point, scenes) if point is not None]
        figures += summary(kind, found[kind])
        tables.append(details(f"Costs over C and gain, {name}", found[kind]))
    if extent is Extent.FULL:
        stable = [point.scene for point in found["exponential"]]
        few = [by_scipy(scene) for scene in (stable[0], stable[len(stable) // 2], stable[-1])]
        what = "true solution of exponential boards, beside SciPy's Radau"
        figures.append(Figure(what, "wanted error", few, 0.01, max(few)))
    return Result(figures, tables, {"grid.png": partial(draw, found=found)})


def summary(kind: str, points: list[Point]) -> list[Figure]:
    """Return the figures of one board's grid."""
    costs = [point.ratio for point in points if point.seconds]
    steps = [point.points[0] / point.points[1] for point in points if point.seconds]
    errors = [point.error / point.accuracy.wanted for point in points]
    bare, mean = "cheapest bare ngspice of the same error", statistics.geometric_mean
    time = f"grid, {kind}: processor time of the simulations"
    return [
        Figure(f"{time}, geometric mean", bare, costs, MEAN, mean(costs)),
        Figure(f"{time}, largest", bare, costs, LARGEST, max(costs)),
        Figure(f"grid, {kind}: time points, geometric mean", bare, steps, None, mean(steps)),
        Figure(f"grid, {kind}: true error, largest", "wanted error", errors, 1.0, max(errors)),
    ]


def details(title: str, points: list[Point]) -> Table:
    """Return a row for each board."""
    columns = ("C, F", "gain, ohm", "tries", "points", "bare", "true error", "stated", "ratio")
    rows = [
        (
            *(f"{value:.3g}" for value in point.place),
            f"{point.accuracy.tries}",
            *(f"{count}" if count else "none" for count in point.points),
            f"{point.error:.2g}",
            f"{point.accuracy.achieved:.2g}",
            f"{point.ratio:.2f}" if point.seconds else "",
        )
        for point in points
    ]
    return Table(title, columns, rows)


def by_scipy(scene: Scene) -> float:
    """Return the error of `true_solution` beside SciPy's Radau method, in `ERROR` volts."""
    board = Board.of(scene)
    transient, nodes = board.plan.transient, board.linear.reported(None)
    run = SteppedRun.of(Task(board.linear, transient, nodes))
    assert isinstance(run.board, StateBoard)
    rate, jacobian, watch = run.board.equations(run.reported.amplifiers)
    times = np.linspace(0.0, transient.stop, INSTANTS)
    found = solve_ivp(
        lambda _, e: rate(e),
        (0.0, transient.stop),
        run.state,
        method="Radau",
        jac=lambda _, e: jacobian(e),
        t_eval=times,
        rtol=1e-8,
        atol=1e-11,
    )
    off = run.reported.voltages(watch(found.y)) - true_solution(board.linear, transient)(times)
    return float(np.abs(off).max()) / ERROR


def draw(figure: Any, found: dict[str, list[Point]]) -> None:
    """Draw the ratio of processor times over C and gain; empty: unstable, "-": no bare run."""
    from matplotlib.colors import LogNorm

    norm = LogNorm(1.0 / LARGEST, LARGEST)
    for axes, (kind, points) in zip(figure.subplots(1, len(found)), found.items(), strict=True):
        x, y = zip(*(point.place for point in points), strict=True)
        colours = {"c": [point.ratio for point in points], "norm": norm, "cmap": "RdYlGn_r"}
        marks = axes.scatter(x, y, 700, marker="s", plotnonfinite=True, **colours)
        for point in points:
            text = f"{point.ratio:.2g}" if point.seconds else "-"
            axes.annotate(text, point.place, ha="center", va="center")
        axes.set(xscale="log", yscale="log", xlabel="C, F", ylabel="gain, ohm", title=kind)
        axes.set(xlim=(C[0] / 1.6, C[1] * 1.6), ylim=(GAIN[0] / 2.0, GAIN[1] * 2.0))
        axes.grid(visible=False)
        ticks = (0.25, 0.5, 1.0, 2.0, 4.0)
        figure.colorbar(marks, ax=axes, ticks=ticks, format="%g").ax.minorticks_off()
    figure.suptitle("processor time of the simulations over the cheapest bare ngspice")
