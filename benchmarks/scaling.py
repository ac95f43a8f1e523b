"""How times and memory grow with the number of channels.

``python benchmarks/scaling.py CHANNELS`` does a transient and a pole search once and tells wall and
processor time and peak memory as JSON; `in_own_process` starts that.
"""

from __future__ import annotations

import gc
import json
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from boards import Board, Setting, exponent, run_ngspice, run_statespace, wide
from timing import gathered, print_table

from verification.engines.statespace.transients import exact
from verification.small_signal.poles import poles

SIZES = (7, 16, 32, 64, 128, 256, 500)
LARGEST_NGSPICE = 128
SETTING = Setting("free", 2e-5, "klu")  # errs by 1e-4 of the step amplitude or less
POINTS = 2000  # of the state-space engine's record


def in_own_process(channels: int) -> dict[str, Any]:
    """Run `probe` in a process of its own, so that the peak memory is its own."""
    command = [sys.executable, __file__, str(channels)]
    answer = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    told: dict[str, Any] = json.loads(answer)
    return told


def probe(channels: int) -> None:
    """Do what `largest` measures, and tell."""
    clocks = [(time.perf_counter(), time.process_time())]

    def stage() -> tuple[float, float]:
        clocks.append((time.perf_counter(), time.process_time()))
        return clocks[-1][0] - clocks[-2][0], clocks[-1][1] - clocks[-2][1]

    board = wide(channels)
    stages = {"board and plan": stage()}
    exact.simulate(board.circuit, board.transient)
    stages["transient"] = stage()
    found = poles(board.circuit)
    stages["rightmost poles"] = stage()
    stages["all"] = clocks[-1][0] - clocks[0][0], clocks[-1][1] - clocks[0][1]
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    peak = next(line for line in status.splitlines() if line.startswith("VmHWM"))
    told = {"stages": stages, "memory": 1024 * int(peak.split()[1]), "pole": str(found.rightmost)}
    print(json.dumps(told))


def growth(rounds: int, quick: bool) -> None:
    """Print how times grow with N, and the fitted exponents."""
    sizes = [n for n in SIZES if n <= 128 or not quick]
    times: dict[str, list[list[float]]] = {"transient": [], "poles": [], "ngspice": []}
    for n in sizes:
        board = wide(n)
        jobs = {
            "transient": lambda b=board: run_statespace(b, POINTS),
            "poles": lambda b=board: time_poles(b),
        }
        if n <= LARGEST_NGSPICE:
            jobs["ngspice"] = lambda b=board: run_ngspice(b, SETTING, 300.0).cost.seconds
        found = gathered(jobs, rounds if n < 100 else min(rounds, 2))
        for name, kept in times.items():
            kept.append(found.get(name, []))
        gc.collect()
    rows = [
        (f"{n}", *(f"{1e3 * statistics.median(t[k]):.1f}" if t[k] else "" for t in times.values()))
        for k, n in enumerate(sizes)
    ]
    for least in (7, 32, 64):
        fits = (f"{exponent(sizes, t, least):.2f}" for t in times.values())
        rows.append((f"exponent from {least}", *fits))
    title = f"Growth with N; ms; ngspice: {SETTING.text}, up to {LARGEST_NGSPICE} channels"
    print_table(title, ("channels", "transient", "poles", "ngspice"), rows)


def time_poles(board: Board) -> float:
    """Time one search for the rightmost poles, s."""
    circuit = board.circuit
    began = time.perf_counter()
    poles(circuit)
    return time.perf_counter() - began


if __name__ == "__main__":
    probe(int(sys.argv[1]))
