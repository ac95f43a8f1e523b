"""The designs of a choice as a table for people and as plain data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console

from taction.netlist_gen.scene.keys import Value
from taction.system.quantities import show
from taction.verification.design.choose_ranking import Confirmation, Design
from taction.verification.design.choose_request import CAPACITANCE, GAIN
from taction.verification.report.tables import make_table, whole

ROWS = 12  # op-amps that the table shows
NARROW = ("op-amp", "C", "gain", "outcome", "settling", "overshoot", "headroom", "worst", "ngspice")


def print_choice(
    designs: Sequence[Design],
    best: Sequence[Design],
    confirmations: Sequence[Confirmation],
    console: Console,
) -> None:
    """Print the best design of every op-amp, those that ngspice confirmed first."""
    said = {one.place: text_of(c) for one, c in zip(best, confirmations, strict=True)}
    shown = [*best, *(d for d in first_of_each(designs) if d.opamp not in {b.opamp for b in best})]
    rows = [_row(design, said.get(design.place, "")) for design in shown[:ROWS]]
    passing = sum(design.good for design in designs)
    caption = (
        f"{passing} of {len(designs)} designs pass with parts that can be bought; the best of each"
        " op-amp; worst: the largest value over its limit"
    )
    console.print(make_table(whole(*NARROW), rows, caption=caption, padding=0))
    for design in shown[:ROWS]:
        if not design.good:
            console.print(f"{design.opamp}: {design.reason or design.refused}", markup=False)
    for design, confirmation in zip(best, confirmations, strict=True):
        if confirmation.reason:
            console.print(f"ngspice, {design.opamp}: {confirmation.reason}", markup=False)


def first_of_each(designs: Sequence[Design]) -> list[Design]:
    """Return the best design of every op-amp, the best first; `designs` are in their order."""
    first: dict[str, Design] = {}
    for design in designs:
        first.setdefault(design.opamp, design)
    return list(first.values())


def proposed(confirmations: Sequence[Confirmation]) -> int:
    """Return the number of the first design that ngspice confirms; 0 if it confirms none."""
    passed = (k for k, said in enumerate(confirmations) if text_of(said) == "pass")
    return next(passed, 0)


def text_of(confirmation: Confirmation) -> str:
    """Return what ngspice says in a word."""
    return "not run" if confirmation.outcome is None else confirmation.outcome.value


def _row(design: Design, said: str) -> tuple[str, ...]:
    def known(value: float | None, unit: str) -> str:
        return "-" if value is None or not math.isfinite(value) else show(value, unit, 3)

    overshoot, headroom = design.overshoot, design.headroom
    return (
        design.opamp,
        show(number(design.values[CAPACITANCE]), "F", 3),
        show(number(design.values[GAIN]), "ohm", 3),
        "no parts" if design.refused else design.outcome,
        known(design.settling_time, "s"),
        "-" if not math.isfinite(overshoot) else f"{100 * overshoot:.3g} %",
        "-" if headroom is None else f"{100 * headroom:.3g} %",
        f"{design.worst:.3g}" if design.shares else "-",
        said,
    )


def number(value: Value) -> float:
    """Return a value of an axis as a number."""
    return float(value)


def choice_document(
    designs: Sequence[Design],
    best: Sequence[Design],
    confirmations: Sequence[Confirmation],
    files: Mapping[int, str],
) -> dict[str, Any]:
    """Return a choice as plain data: all designs in their order, and the best with ngspice's word.

    `files` are the scene files of the best by their place of the grid.
    """
    return {
        "designs": [design.plain() for design in designs],
        "best": [
            design.plain()
            | {
                "ngspice": confirmation.outcome and confirmation.outcome.value,
                "ngspice_settling_time": confirmation.settling_time,
                "ngspice_reason": confirmation.reason,
                "file": files.get(design.place),
            }
            for design, confirmation in zip(best, confirmations, strict=True)
        ],
    }
