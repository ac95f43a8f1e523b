"""Yields and corners as tables for people."""

from __future__ import annotations

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from netlist_gen.quantities import show
from verification.studies.corners import Corner
from verification.studies.montecarlo import Sample, YieldReport

TOP = 10


def print_yield(found: YieldReport, seed: int) -> None:
    """Print the yield with its interval, what failed, and the strongest sensitivities."""
    console = Console(highlight=False)
    console.print(
        f"yield {100 * found.fraction:.2f} % ({found.passed} of {found.samples}), 95 % interval"
        f" {100 * found.low:.2f} to {100 * found.high:.2f} %; seed {seed}"
    )
    if found.without_verdict:
        console.print(f"{found.without_verdict} samples without verdict count as not passed")
    for name, count in found.failures.items():
        console.print(f"  {name}: {count} samples do not pass")
    if not found.sensitivities:
        return
    table = Table("quantity", "component", "correlation", "of the variance", box=SIMPLE_HEAD)
    for item in found.sensitivities[:TOP]:
        table.add_row(
            item.quantity.replace("_", " "),
            f"{item.parameter} ({item.kind})",
            f"{item.correlation:+.2f} ± {item.standard_error:.2f}",
            f"{100 * item.correlation**2:.0f} %",
        )
    console.print(table)


def print_corners(found: tuple[Corner, ...]) -> None:
    """Print every corner with its outcome and what decides it."""
    titles = ("corner", "outcome", "settling", "overshoot", "steady state", "pole", "decided by")
    table = Table(*titles, box=SIMPLE_HEAD, pad_edge=False)
    for corner in found:
        table.add_row(
            corner.name, corner.result.outcome, *_figures(corner.result), " ".join(corner.largest)
        )
    Console(highlight=False).print(table)


def _figures(result: Sample) -> tuple[str, str, str, str]:
    def percent(value: float | None) -> str:
        return "-" if value is None else f"{100 * value:.3g} %"

    settling = "-" if result.settling_time is None else show(result.settling_time, "s")
    pole = "-" if result.growth_rate is None else f"{result.growth_rate:.4g} /s"
    return settling, percent(result.overshoot), percent(result.steady_state), pole
