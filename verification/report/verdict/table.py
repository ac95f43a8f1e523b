"""A verdict as tables for people."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Sequence

from rich.console import Console, Group, RenderableType
from rich.markup import escape
from rich.table import Column
from rich.text import Text

from taction.system.array_types import Floats
from taction.system.quantities import show
from taction.system.reading_definitions import EXCURSIONS, READINGS, TIMES
from taction.verification.readings.measurements import Measurements
from taction.verification.readings.readings import Reading
from taction.verification.report.fitted_table import FittedTable
from taction.verification.report.page import Page
from taction.verification.report.tables import make_table, rounded_up, spaced, value_text, whole
from taction.verification.report.verdict.budget_table import budget_table
from taction.verification.verdict.attained_accuracy import Accuracy
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.headroom import amount as amount_of
from taction.verification.verdict.verify import Verdict

MOST_LOADS = 8
COLOUR = {Outcome.PASS: "green", Outcome.FAIL: "red", Outcome.INCONCLUSIVE: "yellow"}


def print_verdict(verdict: Verdict, console: Console, *, verbose: bool = False) -> None:
    """Print the checks, the channels, the error budget and the cost, `verbose` in detail."""
    noise = () if verdict.noise is None else verdict.noise.rms
    console.print(_head(verdict))
    console.print(_checks(verdict))
    console.print(channel_table(verdict.measurements, verdict.steady.values, noise))
    amplitude, error = verdict.measurements.amplitude, verdict.ideal.error
    rounding = error * amplitude if math.isfinite(error) else 0.0
    console.print(budget_table(verdict.budget, amplitude, rounding))
    if verdict.parts.loads or verdict.parts.simulated:
        console.print(_headroom(verdict))
    for warning in verdict.warnings:
        console.print(f"[yellow]warning[/yellow] {escape(warning)}")
    console.print(_foot(verdict, verbose=verbose))


def verdict_text(verdict: Verdict) -> str:
    """Return the text of `print_verdict` without colours."""
    text = io.StringIO()
    print_verdict(verdict, Page(file=text))
    return text.getvalue().removesuffix("\n")


def _head(verdict: Verdict) -> RenderableType:
    c = verdict.circuit
    rows, columns = c.shape
    board = (
        f"{columns} channels, {rows} sensors, {c.amplifier} amplifiers, {c.topology};"
        f" {', '.join(f'{fact.symbol} = {fact.text}' for fact in c.facts.values())}"
    )
    if verdict.scene.lambda_rule:
        board += f" (chosen by {verdict.scene.lambda_rule})"
    return Group(Text(verdict.scene.name, style="bold"), Text(board))


def _checks(verdict: Verdict) -> Group:
    """Return the table of checks, and the reasons below: they are long."""
    rows = [
        (
            spaced(check.name),
            Text(check.outcome.value, style=COLOUR[check.outcome]),
            amount(check.value, check.unit),
            amount(check.uncertainty, check.unit),
            amount(limit(check), check.unit),
        )
        for check in verdict.checks
    ]
    titles = whole("check", "outcome", "value", "±", "limit")
    reasons = (Text(f" {spaced(check.name)}: {check.reason}") for check in verdict.checks)
    return Group(make_table(titles, rows), *reasons)


def limit(check: Check) -> float | None:
    """Return the limit of a check: its tolerance, or the expected value without a tolerance."""
    return check.tolerance if check.tolerance is not None else check.expected


def amount(value: float | None, unit: str) -> str:
    """Return the value of a check as text; a dash for a missing or an infinite value."""
    if value is None or not math.isfinite(value):
        return "-"
    return value_text(value, unit, 3 if unit == "ratio" else 4)


def channel_table(
    measurements: Measurements, equilibrium: Floats | None = None, noise: Sequence[float] = ()
) -> FittedTable:
    """Return the table of channels, numbered from 1.

    `equilibrium` (N,) and `noise` (N,), V, have a column where they are known.
    """
    known = () if equilibrium is None else ("at rest",)
    rms = ("noise",) if noise else ()
    times, shares = ([READINGS[name].short for name in names] for names in (TIMES, EXCURSIONS))
    titles: tuple[str | Column, ...] = (
        *whole("u", "reference", *known, "end"),
        *times,  # a fragile time is long, and wraps
        *whole(*shares, *rms, "state"),
    )
    rows = [
        (
            str(channel.index + 1),
            show(channel.target, "V"),
            *(() if equilibrium is None else (show(float(equilibrium[channel.index]), "V"),)),
            show(channel.final, "V"),
            *(_reading(channel.readings[name]) for name in TIMES),
            *(_percent(channel.readings[name]) for name in EXCURSIONS),
            *(show(volts, "V", 3) for volts in noise[channel.index : channel.index + 1]),
            channel.state.value,
        )
        for channel in measurements.channels
    ]
    caption = f"rise and settling time, {' and '.join(EXCURSIONS)}"
    return make_table(titles, rows, caption=caption, padding=0)


def _percent(reading: Reading | None) -> str:
    """Return a share of the step; below its own error only that error is known."""
    if reading is None:
        return "-"
    share, error = reading.value, reading.uncertainty
    if 0.0 < abs(share) <= error < 1.0:
        return f"<{100 * rounded_up(2.0 * error):.1g} %"
    return f"{100 * share:.3g} %"


def _reading(reading: Reading | None) -> str:
    if reading is None:
        return "-"
    text = show(reading.value, "s")
    if reading.fragile and reading.alternative is not None:
        text += f" (fragile: or {show(reading.alternative, 's')})"
    return text


def _headroom(verdict: Verdict) -> FittedTable:
    shown = (*verdict.parts.simulated, *verdict.parts.worst)
    rows = [
        (
            f"{load.quantity} of {load.part}",
            amount_of(load, load.peak),
            "at rest" if math.isinf(load.at) else show(load.at, "s", 3),
            amount_of(load, load.limit),
            f"{load.share:.3g}",
        )
        for load in shown[:MOST_LOADS]
    ]
    notes = [f"and {len(shown) - MOST_LOADS} more"] if len(shown) > MOST_LOADS else []
    if verdict.parts.simulated:
        notes.append("loads above 1 are those without limits; the simulated op-amps have limits")
    caption = "; ".join(notes) or None
    titles = ("op-amp output", "peak", "at", "limit", "of the limit")
    return make_table(titles, rows, caption=caption)


def _accuracy(accuracy: Accuracy) -> str:
    reached = "reached error unknown"
    if accuracy.achieved is not None:
        reached = f"{accuracy.achieved:.2g} {'reached' if accuracy.reached else 'NOT reached'}"
    tries = ", at the second try" if accuracy.tries > 1 else ""
    return (
        f"requested error {accuracy.wanted:g} of the step, {reached}{tries}, in"
        f" {show(accuracy.seconds, 's', 3)}: {accuracy.method} ({accuracy.how})"
    )


def _cost(verdict: Verdict) -> str:
    """Return the cost and the error of the simulation in one line."""
    accuracy = verdict.accuracy
    error = "error unknown" if accuracy.achieved is None else f"error {accuracy.achieved:.2g}"
    missed = "" if accuracy.reached else ", NOT reached"
    return (
        f"simulated by {verdict.waveforms.simulator}: {error} of the step, {accuracy.wanted:g}"
        f" allowed{missed}; {show(verdict.timing['total'], 's', 3)} in all"
    )


def _effort(verdict: Verdict) -> Iterator[str]:
    """Yield how the record and the reference were made, and what that took."""
    cost, ideal = verdict.waveforms.cost, verdict.ideal
    plane, energy = verdict.constraint, verdict.energy
    yield (
        f"{verdict.waveforms.simulator}: {cost.points} points to"
        f" {show(verdict.transient.stop, 's')},"
        f" at most {show(verdict.waveforms.spacing, 's')} apart"
    )
    yield _accuracy(verdict.accuracy)
    yield (
        f"reference: {ideal.solution.certificate_kind} {ideal.solution.certificate:.2g}"
        f" (bound {ideal.solution.bound:.2g}); the ideal network settles in"
        f" {show(ideal.transient.settling_time, 's')}"
    )
    if plane is not None:
        stage = "its stage with capacitance oscillates by itself"
        if plane.stage_rise_time is not None and plane.stage_overshoot is not None:
            stage = (
                f"its stage with capacitance in {show(plane.stage_rise_time, 's')} with"
                f" {100 * plane.stage_overshoot:.0f} % overshoot"
            )
        rise = show(plane.amplifier_rise_time, "s")
        yield f"constraint plane: amplifier alone rises in {rise}, {stage}"
    if energy is not None:
        yield (
            f"energy: rises by {100 * energy.rise:.2g} % of its fall, at {show(energy.time, 's')};"
            " the energy of an ideal network never rises (identity to"
            f" {ideal.transient.energy_residual:.1g})"
        )
    stages = ", ".join(f"{name} {seconds:.2f} s" for name, seconds in verdict.timing.items())
    yield f"time: {stages}"


def _foot(verdict: Verdict, *, verbose: bool) -> Group:
    lines = (_cost(verdict), *(_effort(verdict) if verbose else ()))
    return Group(
        *(Text(line, style="dim") for line in lines),
        Text(verdict.outcome.value.upper(), style=f"bold {COLOUR[verdict.outcome]}"),
    )
