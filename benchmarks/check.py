"""`taction check` of a designer's deck, beside the ngspice runs that would answer it.

A bare run is ngspice on the flat cards of the deck, with the steps that were planned for an error
of 1e-4 of the step. A check, in one process and without imports, finds poles, margins, noise and
readings with bounds besides. A sweep is compared with as many bare runs as it has values.
Processor time, with that of ngspice.
"""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import taction
from benchmarks.measuring import Figure, in_turns, processor, ratios
from taction.verification.engines.ngspice.process import find_simulator
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.studies.decks.foreign_board import read_board
from taction.verification.studies.decks.measured_board import measure_board
from taction.verification.verdict.transient_plan import StepModel
from tests.support.designer_decks import DECKS

SWEPT = {"sallen-key-fast": "C1", "wien": "C1", "ring": "R1"}
"""Decks, and the part of each that is swept."""
AROUND = 3.0
RELATIVE, ERROR = 1e-6, 1e-4  # of ngspice: reltol, and the error of a transient
SINGLE, SWEEP = 3.0, 10.0  # wanted: a check over a bare run; bare runs over a sweep


def bare(file: Path) -> Callable[[], object]:
    """Return a function that runs ngspice once on a deck, as planned for an error of 1e-4."""
    board = read_board(file)
    found = measure_board(LinearBoard(board.circuit), board.initial, 0.01)
    stop, simulator = found.scales.stop, find_simulator()
    stable = found.poles.known_stable
    model = StepModel.of(found.board, stop, found.initial, stable=stable)
    plan, _, _ = model.cheapest(ERROR)
    cards = (
        f".options {simulator.solver_option} reltol={RELATIVE} trtol={plan.truncation / RELATIVE}",
        f".tran {plan.max_step} {stop} 0 {plan.max_step}",
    )
    place = file.with_suffix(".bare")
    place.write_text("\n".join(("* flat cards", *board.point.cards, *cards, ".end\n")))
    words = [simulator.executable, "-b", "-n", "-r", str(place.with_suffix(".raw")), str(place)]
    return lambda: subprocess.run(words, capture_output=True, check=True)


def measure(tiny: bool) -> list[Figure]:
    """Time a check and a sweep of each deck."""
    rounds, points = (1, 4) if tiny else (5, 100)
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
                "sweep": partial(taction.check, file, over=over, ngspice=False),
            }
            times = in_turns({key: processor(job) for key, job in jobs.items()}, rounds)
            single, runs = ratios(times["check"], times["bare"]), f"{points} bare runs of {name}"
            sweep = ratios([points * time for time in times["bare"]], times["sweep"])
            figures += [
                Figure(f"check of {name}", "bare ngspice", single, SINGLE),
                Figure(runs, f"check --over {part}", sweep, SWEEP, least=True),
            ]
    return figures
