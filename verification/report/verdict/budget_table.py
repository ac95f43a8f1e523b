"""The table of an error budget."""

from __future__ import annotations

import math

import numpy as np
from rich.table import Column

from taction.system.quantities import show
from taction.verification.report.fitted_table import FittedTable
from taction.verification.report.tables import make_table, spaced, whole
from taction.verification.verdict.error_budget import ErrorBudget, ErrorPart


def budget_table(budget: ErrorBudget, amplitude: float, rounding: float = 0.0) -> FittedTable:
    """Return the parts, largest and signed, their sum and the whole difference.

    The signed column is that of the channel with the largest whole difference, so that it adds up.

    Parameters
    ----------
    amplitude : float
        Step amplitude, V; 0 without a step.
    rounding : float
        Bound on the error of the optimum, V; a smaller part is below rounding.
    """
    total = budget.total
    worst = None if total is None else int(np.argmax(np.abs(total.channels)))
    rows = [_row(part, worst, amplitude, rounding) for part in budget]
    if total is not None and worst is not None:
        sums = budget.summed
        largest = max(map(abs, sums))
        rows.append(
            (
                "sum",
                *_sizes(largest, amplitude, rounding),
                show(sums[worst], "V", 3),
                "of the parts",
            )
        )
        rows.append(_row(total, worst, amplitude, rounding))
    signed: tuple[Column, ...] = () if worst is None else whole(f"channel {worst + 1}")
    cost = f"error budget: {budget.solves} solutions of its own"
    titles = (*whole("error", "largest", "of the step"), *signed, Column("how it was found"))
    return make_table(titles, rows, caption=cost, padding=(0, 1, 0, 0))


def _row(part: ErrorPart, worst: int | None, amplitude: float, rounding: float) -> tuple[str, ...]:
    signed = () if worst is None else ("",)
    if worst is not None and part.channels:
        signed = (show(part.channels[worst], "V", 3),)
    how = part.how
    if part.predicted:
        forecast = max(map(abs, part.predicted))
        how += f"; first order predicts {show(forecast, 'V', 3)}"
    return (spaced(part.name), *_sizes(part.value, amplitude, rounding), *signed, how)


def _sizes(volts: float | None, amplitude: float, rounding: float) -> tuple[str, str]:
    """Return a size in V and as a share of the step."""
    if volts is None or not math.isfinite(volts):
        return "unknown", ""
    if 0.0 < volts <= rounding:
        return "below rounding", ""
    return show(volts, "V", 3), f"{100 * volts / amplitude:.2g} %" if amplitude else "-"
