"""The sweep that everybody runs in `sweep`, its decks, and a watch for what they cost."""

from __future__ import annotations

import os
import resource
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

from netlist_gen.board.synthesis import synthesise
from netlist_gen.deck.deck import write_deck
from netlist_gen.overrides.axes import parse_axes, with_value, with_values
from netlist_gen.overrides.axes import points as points_of
from netlist_gen.problem.inverse_problem import make_problem
from netlist_gen.scene.file import load_scene
from verification.engines.ngspice.executable import environment, find_simulator
from verification.engines.statespace.linearised.board import LinearBoard
from verification.pipeline.transient_plan import plan_transient
from verification.small_signal.time_scales import time_scales
from verification.studies.sweep.plan import Plan

ROOT = Path(__file__).parents[1]
JOBS = 2
POINTS = 30
OUTPUTS = tuple(f"v_{channel}" for channel in range(1, 8))  # nodes, as they are saved
OVER = f"C=10pF:30pF:{POINTS}"
CASES = {  # stop time of the scene: 700 points a deck, and as long as the board needs to settle
    "short decks": "0.1ms",
    "whole decks": "auto",
}


def make_plan(stop: str, engine: str) -> Plan:
    """Return the sweep over `POINTS` seven-channel boards."""
    scene = load_scene(ROOT / "scenes" / "paper-breadboard.toml")
    scene = with_value(scene, "analysis.stop", stop)
    return Plan(scene, parse_axes(scene, [OVER]), (engine,))


def decks(plan: Plan, folder: Path) -> list[Path]:
    """Write every deck that the sweep would run, each into a folder of its own."""
    solver = find_simulator().solver_option
    found = []
    for k, values in enumerate(points_of(plan.groups)):
        scene = with_values(plan.scene, values)
        circuit = synthesise(scene, make_problem(scene))
        board = LinearBoard(circuit)
        transient = plan_transient(scene, board, time_scales(board)).transient
        place = folder / str(k)
        place.mkdir()
        (place / "deck.cir").write_text(write_deck(circuit, transient, solver=solver).text)
        (place / "spinit").write_text("* none\n")
        found.append(place)
    return found


@dataclass(frozen=True, slots=True)
class Cost:
    """Wall and processor time of all processes together, s."""

    wall: float
    processor: float


class Stopwatch:
    """Times what happens between its making and `stop`.

    `pids` are workers that live on, and may have simulators that do.
    """

    def __init__(self, pids: list[int] | None = None) -> None:
        self._pids = pids or []
        self._wall, self._processor = time.perf_counter(), self._used()

    def stop(self) -> Cost:
        """Return the cost since the beginning."""
        return Cost(time.perf_counter() - self._wall, self._used() - self._processor)

    def _used(self) -> float:
        both = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)  # children that have ended
        own = sum(sum(resource.getrusage(who)[:2]) for who in both)
        return own + sum(map(_ticks, self._pids)) / os.sysconf("SC_CLK_TCK")


def _ticks(pid: int) -> int:
    """Return the processor time of a process, and of its children, dead and alive."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    threads = Path(f"/proc/{pid}/task").glob("*/children")
    children = [int(child) for thread in threads for child in thread.read_text().split()]
    return sum(map(int, fields[11:15])) + sum(map(_ticks, children))


def by_xargs(plan: Plan, folder: Path) -> Cost:
    """Cost of ``xargs -P 2 ngspice -b`` over the decks, results and all."""
    places = decks(plan, folder)
    run = f'cd "$0" && HOME=$0 SPICE_SCRIPTS=$0 {find_simulator().executable} -b -n -r out.raw'
    words = ["xargs", "-P", str(JOBS), "-n", "1", "sh", "-c", f"{run} deck.cir >log 2>&1"]
    text = "\n".join(map(str, places)) + "\n"
    watch = Stopwatch()
    subprocess.run(words, input=text, text=True, check=True, env=environment(folder))
    cost = watch.stop()
    assert all((place / "out.raw").stat().st_size > 10_000 for place in places)
    return cost
