"""`taction check` of a designer's deck, beside the ngspice runs that would answer it.

A bare run is ngspice on the flat cards of the deck, with the steps that were planned for an error
of 1e-4 of the step. A check, in one process and without imports, finds poles, margins, noise and
readings with bounds besides; ngspice lists the deck for it, and runs as the other witness. A sweep
is compared with as many bare runs as it has values. Processor time, with that of ngspice.

What remains above the wanted figures: of a deck with few parts a bare run takes 8 ms, of which the
start of ngspice is 6. The one ngspice that lists the deck, waits and runs the transient takes 8 ms,
too, and 18 ms are some hundred small array operations in Python, a third of them for the table of
what each part does. A board of a sweep takes 0.9 ms: its solution is made by itself; equations,
states, modes, equilibrium and readings are those of all boards in common arrays. Whole commands
spend more on imports: a check takes 0.5 s, of which 0.1 s are the check.
"""

from __future__ import annotations

import resource
import subprocess
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import taction
from benchmarks.measuring import Extent, Figure, Result, children_seconds, in_turns, ratios
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.studies.board_witness import planned
from taction.verification.studies.foreign_board import read_board
from taction.verification.studies.measured_board import measure_board
from tests.support.designer_decks import DECKS

SWEPT = {"sallen-key-fast": "C1", "wien": "C1", "ring": "R1"}
"""Decks, and the part of each that is swept."""
AROUND = 3.0
SIZES = {Extent.TINY: (1, 4), Extent.QUICK: (5, 100), Extent.FULL: (15, 100)}  # rounds, values


def processor(job: Callable[[], object]) -> Callable[[], float]:
    """Return a function that runs `job` and returns the processor time, with children, s."""

    def timed() -> float:
        own = resource.getrusage(resource.RUSAGE_SELF)
        begun = own.ru_utime + own.ru_stime + children_seconds()
        job()
        own = resource.getrusage(resource.RUSAGE_SELF)
        return own.ru_utime + own.ru_stime + children_seconds() - begun

    return timed


def bare(file: Path) -> Callable[[], object]:
    """Return a function that runs ngspice once on a deck, as planned for an error of 1e-4."""
    board = read_board(file)
    found = measure_board(LinearBoard(board.circuit), board.initial, 0.01)
    plan, _, _ = planned(found, found.scales.stop)
    simulator = find_simulator()
    place = file.with_suffix(".bare")
    place.write_text(board.witness(plan, simulator.solver_option).text)
    words = [simulator.executable, "-b", "-n", "-r", str(place.with_suffix(".raw")), str(place)]
    return lambda: subprocess.run(words, capture_output=True, check=True)


def measure(extent: Extent) -> Result:
    """Time a check, a check without ngspice's transient, and a sweep of each deck."""
    rounds, points = SIZES[extent]
    figures = []
    with tempfile.TemporaryDirectory() as folder:
        for name, part in SWEPT.items():
            file = Path(folder, f"{name}.cir")
            file.write_text(DECKS[name])
            own = read_board(file).circuit.value(part)
            over = f"{part}={own / AROUND!r}:{own * AROUND!r}:{points}"
            jobs: dict[str, Callable[[], object]] = {
                "bare": bare(file),
                "check": partial(taction.check, file),
                "alone": partial(taction.check, file, ngspice=False),
                "sweep": partial(taction.check, file, over=over, ngspice=False),
            }
            times = in_turns({key: processor(job) for key, job in jobs.items()}, rounds)
            alone = f"check of {name} without ngspice's transient"
            runs = [points * time for time in times["bare"]]
            single, found = (ratios(times[key], times["bare"]) for key in ("check", "alone"))
            figures += [
                Figure(f"check of {name}", "bare ngspice", single, 1.5),
                Figure(alone, "bare ngspice", found),
                Figure(
                    f"{points} bare runs of ngspice of {name}",
                    f"check --over {part}",
                    ratios(runs, times["sweep"]),
                    10.0,
                    least=True,
                ),
            ]
    return Result(figures)
