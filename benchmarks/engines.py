"""The state-space engine beside ngspice at its best setting: ratios, with what is required of them.

Run from the checkout: ``python benchmarks/engines.py [ROUNDS] [--quick]``. The baseline is ngspice
at the cheapest setting that reaches the same error, found by a ladder in the same run (see
`boards`); both then take turns. ``--quick`` takes a coarser map and no board over 128 channels.
Ends with status 1 if a requirement was missed.
"""

from __future__ import annotations

import argparse
import statistics
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from boards import (
    Board,
    Ladder,
    Reference,
    run_ngspice,
    run_statespace,
    shipped,
    wide,
)
from polemap import FREQUENCY, GROWTH, PLANNED, time_map
from scaling import growth, in_own_process
from timing import gathered, print_machine, print_table, ratio

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT)]

from spice_models.array_types import Floats  # noqa: E402
from tests.support.precise import precise_step  # noqa: E402 - after the path
from verification.engines.statespace.equations.stamps import stamp  # noqa: E402
from verification.engines.statespace.transients import exact, structured_radau  # noqa: E402

ERROR = 1e-4  # of the step amplitude
TIGHT = 1e-10  # of the structured engine where it is a reference


@dataclass(frozen=True)
class Claim:
    """One figure beside what is required of it."""

    what: str
    found: str
    required: str
    holds: bool

    @staticmethod
    def ratio(what: str, found: float, required: float, note: str = "") -> Claim:
        """Return a ratio that must not be less than `required`."""
        return Claim(what, f"{found:.3g}{note}", f"at least {required:g}", found >= required)


def seven_channels(name: str, rounds: int) -> list[Claim]:
    """One transient of a seven-channel board, at equal error and at each engine's own."""
    board = shipped(name)
    solution = exact.exact_solution(board.circuit, stop=board.transient.stop)
    ladder = Ladder(board, solution.at, ERROR, timeout=120.0)
    for kind in ("free", "even"):
        ladder.climb(kind)
        ladder.attempt(replace(ladder.trials[-1].setting, solver="noopiter"))
    best = ladder.best
    own = precise_error(board, solution)
    found = race(board, ladder, rounds)
    print(f"error of the state-space engine against 50 digits: {own:.1e} of the step amplitude\n")
    faster = 1.0 / statistics.median(paired(found))
    return [
        Claim.ratio(f"{name}: times faster than ngspice at {ERROR:g}", faster, 10.0),
        Claim.ratio("  and its error so many times smaller", best.error / own, 1e4),
    ]


def precise_error(board: Board, solution: exact.Exact) -> float:
    """Largest error at the signal nodes in step amplitudes, at 22 instants, against 50 digits."""
    descriptor = stamp(board.circuit)
    times, precise = precise_step(descriptor, board.transient.stop, 22)
    charged = np.flatnonzero(descriptor.dense.mass.any(axis=1))
    names = [descriptor.names[place] for place in charged]
    columns = [names.index(node) for node in solution.nodes]
    off = np.abs(solution.at(np.array(times)) - precise[:, columns].astype(np.float64)).max()
    return float(off / np.abs(solution.final - solution.start).max())


def race(board: Board, ladder: Ladder, rounds: int) -> dict[str, list[float]]:
    """Time both engines in turns, print the ladder and the times."""
    best = ladder.best

    def baseline() -> float:
        return run_ngspice(board, best.setting, ladder.timeout).cost.seconds

    run_statespace(board, best.points)  # what is imported on first use
    jobs = {"ngspice": baseline, "statespace": lambda: run_statespace(board, best.points)}
    found = gathered(jobs, rounds)
    columns = ("ngspice's ladder", "points", "error", "ms")
    print_table(f"{board.scene.name}: {board.transient.stop:.4g} s", columns, ladder.rows())
    rows = [
        (who, f"{1e3 * statistics.median(s):.2f}", f"{1e3 * min(s):.2f}", f"{1e3 * max(s):.2f}")
        for who, s in found.items()
    ]
    title = f"at {best.setting.text}; {best.points} points each, {rounds} rounds"
    print_table(title, ("", "median, ms", "least", "greatest"), rows)
    print(f"statespace over ngspice: {ratio(found['statespace'], found['ngspice'])}")
    return found


def paired(found: dict[str, list[float]]) -> list[float]:
    """Return the rounds' ratios of state space to ngspice."""
    return [a / b for a, b in zip(found["statespace"], found["ngspice"], strict=True)]


def many_channels(rounds: int, quick: bool) -> list[Claim]:
    """One transient of 128 channels at equal error; the reference is dense modes (or tight)."""
    board = wide(128)
    reference = tight(board) if quick else modes(board)
    ladder = Ladder(board, reference, ERROR, timeout=180.0)
    for kind in ("free", "even"):
        ladder.climb(kind)
    times = np.linspace(0.0, board.transient.stop, ladder.best.points)
    own = exact.simulate(board.circuit, board.transient, times=times).values
    error = float(np.abs(own - reference(times)).max()) / ladder.amplitude
    found = race(board, ladder, rounds)
    print(f"error of the state-space engine: {error:.1e} of the step amplitude\n")
    faster = 1.0 / statistics.median(paired(found))
    return [
        Claim.ratio(f"128 channels: times faster than ngspice, KLU, at {ERROR:g}", faster, 100.0),
        Claim("  and its error", f"{error:.1e}", f"at most {ERROR:g}", error <= ERROR),
    ]


def modes(board: Board) -> Reference:
    """Exact solution by one dense eigenproblem of all states, however long that takes."""
    return exact.exact_solution(board.circuit, stop=board.transient.stop).at


def tight(board: Board) -> Reference:
    """Return the structured engine at a tolerance of 1e-10."""

    def at(times: Floats) -> Floats:
        found = structured_radau.simulate(
            board.circuit, board.transient, times=times, tolerance=TIGHT
        )
        return found.values

    return at


def largest(channels: int) -> list[Claim]:
    """Measure a transient and the rightmost poles in a process of its own."""
    told = in_own_process(channels)
    rows = [(stage, f"{wall:.2f}", f"{cpu:.2f}") for stage, (wall, cpu) in told["stages"].items()]
    title = f"{channels} channels in a process of its own, rightmost pole {told['pole']} /s"
    print_table(title, ("", "wall, s", "processor, s"), rows)
    wall, cpu = told["stages"]["all"]
    memory = told["memory"] / 1e9
    shown = f"{wall:.1f} ({cpu:.1f} of a processor)"
    return [
        Claim(f"{channels} channels: transient and poles, s", shown, "at most 15", wall <= 15.0),
        Claim("  and their memory, GB", f"{memory:.2f}", "at most 1", memory <= 1.0),
    ]


def pole_map(quick: bool) -> list[Claim]:
    """Measure the map of rightmost poles; ngspice is extrapolated from a sample of its points."""
    side, samples = (16, 8) if quick else (64, 24)
    found = time_map(side, samples)
    mean, planned = statistics.mean(found.sample), statistics.mean(found.planned)
    each = found.seconds / found.points
    print(
        f"map of {side} x {side} points: {found.seconds:.1f} s, {1.0 / each:.0f} points/s; ngspice,"
        f" extrapolated from {samples} points at {found.setting.text}: {mean:.3g} s a point (median"
        f" {statistics.median(found.sample):.3g}); {found.right} of {samples} records show the"
        f" rightmost pole (growth rate within {GROWTH:.0%}, frequency within {FREQUENCY:.0%})\n"
    )
    what = f"map of {side} x {side}: times faster than by ngspice transients"
    note = f" ({planned / each:.3g} at {PLANNED:g} points a period)"
    return [
        Claim.ratio(what, mean / each, 50.0, note),
        Claim("  points per second", f"{1.0 / each:.0f}", "stated", True),
    ]


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("rounds", nargs="?", type=int, default=5)
    parser.add_argument("--quick", action="store_true")
    asked = parser.parse_args()
    print_machine()
    claims = [
        *seven_channels("paper-breadboard", asked.rounds),
        *seven_channels("tuned-breadboard", asked.rounds),
        *many_channels(min(asked.rounds, 3), asked.quick),
        *largest(128 if asked.quick else 500),
        *pole_map(asked.quick),
    ]
    growth(min(asked.rounds, 3), asked.quick)
    rows = [(c.what, c.found, c.required, "yes" if c.holds else "NO") for c in claims]
    print_table("Required", ("", "found", "required", "holds"), rows)
    return 0 if all(claim.holds for claim in claims) else 1


if __name__ == "__main__":
    sys.exit(main())
