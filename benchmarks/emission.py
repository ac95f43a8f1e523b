"""How long a deck takes to write, against joining the same lines by hand.

Run from the checkout: ``python benchmarks/emission.py [ROUNDS [CHANNELS ...]]``. The baseline is a
plain loop over the same arrays that formats every resistor's line and joins them; it leaves out
all that a deck has beside (header, amplifiers, options) and every check.
"""

from __future__ import annotations

import functools
import math
import subprocess
import sys
import tracemalloc
from collections.abc import Callable
from pathlib import Path

from timing import interleaved, milliseconds, print_machine, print_table, ratio

from netlist_gen.analysis import Transient
from netlist_gen.board.circuit import Circuit
from netlist_gen.board.synthesis import synthesise
from netlist_gen.deck.deck import write_deck
from netlist_gen.problem.inverse_problem import make_problem
from netlist_gen.scene.scene import parse_scene

SIZES = (7, 16, 32, 64, 128, 256)
TRANSIENT = Transient(stop=1e-3, max_step=1e-7)


def board(channels: int) -> Circuit:
    """Return the board of a tactile array with as many sensors as channels."""
    problem = {"kind": "tactile", "channels": channels, "span": 6.0, "depth": 1.0}
    design = {"gain": "6.252Mohm", "unit_conductance": "0.3313uS", "resistance": "1.9Mohm"}
    scene = parse_scene({"name": "emission", "problem": problem, "design": design}, "emission")
    return synthesise(scene, make_problem(scene))


def joined(circuit: Circuit) -> str:
    """Format the line of every resistor of `circuit`'s matrices, and join them."""
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


def peak_memory(channels: int, *, traced: bool) -> float:
    """Return the peak of a process that designs a board and writes its deck, MB.

    Resident memory of the whole process; or, `traced`, what Python allocates in `write_deck`.
    """
    words = [sys.executable, __file__, "--memory", str(channels), str(int(traced))]
    return float(subprocess.run(words, check=True, capture_output=True, text=True).stdout)


def _print_memory(channels: int, traced: bool) -> None:
    circuit = board(channels)
    if traced:
        tracemalloc.start()
    write_deck(circuit, TRANSIENT)
    # VmHWM, since ru_maxrss of a child counts what its parent had when it forked.
    status = Path("/proc/self/status").read_text(encoding="ascii")
    (peak,) = (line.split()[1] for line in status.splitlines() if line.startswith("VmHWM:"))
    print(tracemalloc.get_traced_memory()[1] / 1e6 if traced else int(peak) * 1024 / 1e6)


def main(rounds: int = 20, *sizes: int) -> None:
    """Measure and print."""
    print_machine()
    rows = []
    for channels in sizes or SIZES:
        circuit = board(channels)
        text = write_deck(circuit, TRANSIENT).text
        assert joined(circuit) in text
        jobs: dict[str, Callable[[], object]] = {
            "deck": functools.partial(write_deck, circuit, TRANSIENT),
            "joining": functools.partial(joined, circuit),
        }
        times = interleaved(jobs, rounds)
        rows.append(
            (
                str(channels),
                str(text.count("\nR")),
                *milliseconds(times["deck"]),
                milliseconds(times["joining"])[0],
                ratio(times["deck"], times["joining"]),
                f"{peak_memory(channels, traced=False):.0f}",
                f"{peak_memory(channels, traced=True):.1f}",
            )
        )
    columns = ["N", "resistors", "deck, ms", "least", "greatest", "joining, ms"]
    columns += ["ratio (quartiles)", "process, MB", "deck, MB"]
    print_table(f"write_deck against joining the lines, {rounds} rounds", columns, rows)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--memory"]:
        _print_memory(int(sys.argv[2]), bool(int(sys.argv[3])))
    else:
        main(*(int(argument) for argument in sys.argv[1:]))
