"""How long a deck takes to write, beside joining the lines of its resistors by hand.

The baseline is a plain loop over the same arrays that formats the line of every resistor and joins
the lines. It omits the header, the amplifiers, the options and every check.
"""

from __future__ import annotations

import math
import statistics
from functools import partial

from benchmarks.measuring import Extent, Figure, Result, Table, in_turns, python, ratios, wall
from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.scene import parse_scene

SIZES = {Extent.TINY: (2,), Extent.QUICK: (7, 64, 256), Extent.FULL: (7, 16, 32, 64, 128, 256)}
ROUNDS = {Extent.TINY: 1, Extent.QUICK: 7, Extent.FULL: 20}
TRANSIENT = Transient(stop=1e-3, max_step=1e-7)


def board(channels: int) -> Circuit:
    """Return the board of a tactile array with as many sensors as channels."""
    problem = {"kind": "tactile", "channels": channels, "span": 6.0, "depth": 1.0}
    design = {"gain": "6.252Mohm", "unit_conductance": "0.3313uS", "resistance": "1.9Mohm"}
    return synthesise(
        parse_scene({"name": "emission", "problem": problem, "design": design}, "emission")
    )


def joined(circuit: Circuit) -> str:
    """Format the line of every resistor of the matrices of `circuit`, and join the lines."""
    lines = []
    for matrix in circuit.matrices:
        negative = matrix.negative.tolist()
        for k, row in enumerate(matrix.ohms.tolist()):
            for n, ohms in enumerate(row):
                if ohms == math.inf:
                    continue
                drive, sink = (n, k) if matrix.by_column else (k, n)
                source = matrix.minus[drive] if negative[k][n] else matrix.plus[drive]
                ends = f"{source} {matrix.sinks[sink]}"
                lines.append(f"{matrix.name}_{k + 1}_{n + 1} {ends} {ohms!r}")
    return "\n".join(lines)


def write(channels: int) -> None:
    """Design a board and write its deck."""
    write_deck(board(channels), TRANSIENT)


def measure(extent: Extent) -> Result:
    """Measure boards of several sizes."""
    rows = []
    for channels in SIZES[extent]:
        circuit = board(channels)
        text = write_deck(circuit, TRANSIENT).text
        assert joined(circuit) in text
        jobs = {
            "deck": wall(partial(write_deck, circuit, TRANSIENT)),
            "lines": wall(partial(joined, circuit)),
        }
        found = in_turns(jobs, ROUNDS[extent])
        times = [1e3 * statistics.median(found[job]) for job in jobs]
        memory = python(f"from benchmarks.deck import write; write({channels})").memory
        rows.append((f"{channels}", f"{text.count(chr(10) + 'R')}", *(f"{t:.2f}" for t in times)))
    what, base = f"deck of {channels} channels", "joining the same lines"
    nothing = python("").memory
    figures = [
        Figure(what, base, ratios(found["deck"], found["lines"]), 1.3),
        Figure(f"{what}, memory", "memory of Python", [memory / nothing], 150.0, memory, "MB"),
    ]
    columns = ("channels", "resistors", "deck, ms", "joining, ms")
    return Result(figures, [Table("Writing a deck", columns, rows)])
