"""What a planned transient costs beside the cheapest bare ngspice, over C and gain.

Run from the checkout: ``python benchmarks/transient_cost.py [ROWS COLUMNS]``. The boards are the
paper's breadboard with ROWS values of C from 5 pF to 1 nF and COLUMNS of gain from 100 kohm to
20 Mohm. The baseline is a bare ``ngspice -b`` on the same deck with ngspice's own tolerances: the
cheapest of a ladder of ``reltol`` and longest steps whose outputs are within the same error of the
exact solution, over all time. What is compared is the number of accepted time points, which does
not depend on how busy the machine is.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT)]

from netlist_gen.board.synthesis import synthesise  # noqa: E402 - after the path
from netlist_gen.deck.deck import write_deck  # noqa: E402
from netlist_gen.overrides.axes import with_values  # noqa: E402
from netlist_gen.scene.file import load_scene  # noqa: E402
from spice_models.errors import SimulationError  # noqa: E402
from verification.engines.ngspice.executable import find_simulator  # noqa: E402
from verification.engines.ngspice.process import start  # noqa: E402
from verification.engines.statespace.linearised.board import LinearBoard  # noqa: E402
from verification.engines.statespace.transients.exact import exact_solution  # noqa: E402
from verification.pipeline.transient_plan import Plan, plan_transient  # noqa: E402
from verification.small_signal.time_scales import time_scales  # noqa: E402

ERROR = 1e-4  # of the step amplitude
RELTOL = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
PARTS = (50, 200, 1000, 5000)  # of the record: the longest step
TIMEOUT = 60.0  # s


def points_and_error(board: LinearBoard, text: str, plan: Plan) -> tuple[int, float]:
    """Return the time points of a run of the deck `text`, and its error in step amplitudes."""
    simulator = find_simulator()
    deck = write_deck(board.circuit, plan.transient, solver=simulator.solver_option)
    run = start(replace(deck, text=text), simulator, timeout=TIMEOUT, bound=1e6)
    try:
        record = run.result()
    except SimulationError:
        return 0, np.inf
    exact = exact_solution(board)
    off = np.abs(np.asarray(record.values) - exact.at(np.asarray(record.time))).max()
    return len(record.time), float(off / np.abs(exact.final - exact.start).max())


def bare(text: str, reltol: float, max_step: float, stop: float) -> str:
    """Return the deck with ngspice's own tolerances but for `reltol` and the longest step."""
    kept = [
        line
        for line in text.splitlines()
        if not line.startswith((".options reltol", ".options method", ".options chgtol", ".tran"))
    ]
    cards = [
        f".options reltol={reltol!r}",
        f".tran {1e-3 * max_step!r} {stop!r} 0 {max_step!r} uic",
    ]
    return "\n".join([*kept[: kept.index(".end")], *cards, ".end", ""])


def main(rows: int = 8, columns: int = 6) -> None:
    """Print a line a board, then the geometric mean and the largest ratio."""
    scene, ratios = load_scene(ROOT / "scenes" / "paper-breadboard.toml"), []
    for C in np.geomspace(5e-12, 1e-9, rows).tolist():
        for gain in np.geomspace(1e5, 2e7, columns).tolist():
            values = {"design.capacitance": C, "design.gain": gain, "analysis.error": ERROR}
            board = LinearBoard(synthesise(with_values(scene, values)))
            scales = time_scales(board)
            if scales.poles.real.max() > 0.0:
                continue
            plan = plan_transient(with_values(scene, values), board, scales)
            stop, simulator = plan.transient.stop, find_simulator()
            text = write_deck(board.circuit, plan.transient, solver=simulator.solver_option).text
            own, off = points_and_error(board, text, plan)
            cheapest = min(
                (
                    points
                    for parts in PARTS
                    for reltol in RELTOL
                    for points, error in [
                        points_and_error(board, bare(text, reltol, stop / parts, stop), plan)
                    ]
                    if error <= ERROR
                ),
                default=0,
            )
            ratio = own / cheapest if cheapest else np.nan
            ratios.append(ratio)
            print(
                f"C = {C:8.3g} F, gain = {gain:8.3g} ohm: {own:7} points, error {off:.2g} of"
                f" {ERROR:g}; forecast {plan.forecast.steps:7.0f}, {plan.forecast.error:.2g};"
                f" cheapest bare run {cheapest or 'none'}: ratio {ratio:.2f}",
                flush=True,
            )
    known = np.array(ratios)[np.isfinite(ratios)]
    mean = float(np.exp(np.log(known).mean()))
    print(f"{len(ratios)} boards; ratio: geometric mean {mean:.2f}, largest {known.max():.2f}")
    print(f"no bare run of the ladder reaches the error on {len(ratios) - len(known)} boards")


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:]))
