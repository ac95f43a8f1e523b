"""How long a deck takes to write, beside joining the lines of its resistors by hand.

The baseline is a plain loop over the same arrays that formats the line of every resistor and joins
the lines. It omits the header, the amplifiers, the options and every check.
"""

from __future__ import annotations

import math
from functools import partial

from benchmarks.measuring import Figure, in_turns, processor, ratios
from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.scene import parse_scene

TRANSIENT = Transient(stop=1e-3, max_step=1e-7)


def board(channels: int) -> Circuit:
    """Return the board of a tactile array with as many sensors as channels."""
    problem = {"kind": "tactile", "channels": channels, "span": 6.0, "depth": 1.0}
    design = {"gain": "6.252Mohm", "unit_conductance": "0.3313uS", "resistance": "1.9Mohm"}
    scene = {"name": "emission", "problem": problem, "design": design}
    return synthesise(parse_scene(scene, "emission"))


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


def measure(tiny: bool) -> list[Figure]:
    """Compare the deck of a large board with its lines."""
    channels = 12 if tiny else 256
    circuit = board(channels)
    assert joined(circuit) in write_deck(circuit, TRANSIENT).text
    jobs = {
        "deck": processor(partial(write_deck, circuit, TRANSIENT)),
        "lines": processor(partial(joined, circuit)),
    }
    found = in_turns(jobs, 1 if tiny else 7)
    times = ratios(found["deck"], found["lines"])
    return [Figure(f"deck of {channels} channels", "joining the same lines", times, 1.3)]
