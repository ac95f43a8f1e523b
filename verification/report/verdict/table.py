"""A verdict as tables for people."""

from __future__ import annotations

import io
import math

from rich.box import SIMPLE_HEAD
from rich.console import Console, Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from netlist_gen.quantities import show
from verification.measures.measurements import Measurements
from verification.measures.readings import Reading
from verification.pipeline.attained_accuracy import Accuracy
from verification.pipeline.checks import Check, Outcome
from verification.verify import Verdict

COLOUR = {Outcome.PASS: "green", Outcome.FAIL: "red", Outcome.INCONCLUSIVE: "yellow"}


def print_verdict(verdict: Verdict, console: Console) -> None:
    """Print the checks, the channels, the error budget and what it all cost."""
    console.print(_head(verdict))
    console.print(_checks(verdict))
    console.print(channel_table(verdict.measurements))
    console.print(_budget(verdict))
    for warning in verdict.warnings:
        console.print(f"[yellow]warning[/yellow] {escape(warning)}")
    console.print(_foot(verdict))


def verdict_text(verdict: Verdict) -> str:
    """Return what `print_verdict` prints, without colours."""
    text = io.StringIO()
    print_verdict(verdict, Console(file=text, highlight=False, color_system=None))
    return text.getvalue().removesuffix("\n")


def _head(verdict: Verdict) -> RenderableType:
    s, c = verdict.circuit.scalings, verdict.circuit
    rows, columns = c.matrices[0].ohms.shape
    board = (
        f"{columns} channels, {rows} sensors, {c.amplifier} amplifiers, {c.topology};"
        f" C = {show(s.capacitance, 'F')}, R = {show(s.resistance, 'ohm')},"
        f" s = {show(s.gain, 'ohm')}, G0 = {show(s.unit_conductance, 'S')}, lambda = {s.lam:.4g}"
    )
    if verdict.scene.lambda_rule:
        board += f" (chosen by {verdict.scene.lambda_rule})"
    return Group(Text(verdict.scene.name, style="bold"), Text(board))


def _checks(verdict: Verdict) -> Table:
    table = Table("check", "outcome", "value", "±", "limit", "why", box=SIMPLE_HEAD, pad_edge=False)
    for check in verdict.checks:
        table.add_row(
            check.name.replace("_", " "),
            Text(check.outcome.value, style=COLOUR[check.outcome]),
            amount(check.value, check.unit),
            amount(check.uncertainty, check.unit),
            _limit(check),
            escape(check.reason),
        )
    return table


def _limit(check: Check) -> str:
    limit = check.tolerance if check.tolerance is not None else check.expected
    return amount(limit, check.unit)


def amount(value: float | None, unit: str) -> str:
    """Return a check's value for people; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return "-"
    if unit == "s":
        return show(value, "s")
    if unit == "1/s":
        return f"{value:.4g} /s"
    return f"{value:.3g}" if unit == "ratio" else f"{100 * value:.3g} %"


def channel_table(measurements: Measurements) -> Table:
    """Return the table of channels, numbered from 1."""
    titles = ("u", "reference", "final", "rise time", "settling time", "overshoot", "state")
    table = Table(*titles, box=SIMPLE_HEAD, pad_edge=False)
    for channel in measurements.channels:
        table.add_row(
            str(channel.index + 1),
            show(channel.target, "V", 5),
            show(channel.final, "V", 5),
            _reading(channel.rise_time),
            _reading(channel.settling_time),
            "-" if channel.overshoot is None else f"{100 * channel.overshoot:.3g} %",
            str(channel.state.value),
        )
    return table


def _reading(reading: Reading | None) -> str:
    if reading is None:
        return "-"
    text = show(reading.value, "s")
    if reading.fragile and reading.alternative is not None:
        text += f" (fragile: or {show(reading.alternative, 's')})"
    return text


def _budget(verdict: Verdict) -> Table:
    titles = ("error", "largest", "of the step", "how it was found")
    table = Table(*titles, box=SIMPLE_HEAD, pad_edge=False)
    amplitude = verdict.measurements.amplitude
    for part in verdict.budget:
        if part.value is None:
            table.add_row(part.name.replace("_", " "), "unknown", "", part.how)
            continue
        share = f"{100 * part.value / amplitude:.2g} %" if amplitude else "-"
        table.add_row(part.name.replace("_", " "), show(part.value, "V", 3), share, part.how)
    return table


def _accuracy(accuracy: Accuracy) -> str:
    achieved = "unknown" if accuracy.achieved is None else f"{accuracy.achieved:.2g}"
    verb = "reached" if accuracy.reached else "NOT reached"
    tries = ", at the second try" if accuracy.tries > 1 else ""
    return (
        f"error {accuracy.wanted:g} of the step asked for, {achieved} {verb}{tries}, in"
        f" {show(accuracy.seconds, 's', 3)}: {accuracy.method} ({accuracy.how})"
    )


def _foot(verdict: Verdict) -> Group:
    cost, timing = verdict.waveforms.cost, verdict.timing
    ideal = verdict.ideal
    stages = ", ".join(f"{name} {seconds:.2f} s" for name, seconds in timing.items())
    lines = [
        f"{verdict.waveforms.engine}: {cost.points} points to {show(verdict.transient.stop, 's')},"
        f" step {show(verdict.transient.max_step, 's')} at the most",
        f"reference: {ideal.solution.certificate_kind} {ideal.solution.certificate:.2g}"
        f" (bound {ideal.solution.bound:.2g}); the ideal network settles in"
        f" {show(ideal.pace.settling_time, 's')}",
        f"time: {stages}",
    ]
    if verdict.accuracy is not None:
        lines.insert(1, _accuracy(verdict.accuracy))
    if verdict.energy is not None:
        lines.insert(
            2,
            f"energy: rises by {100 * verdict.energy.rise:.2g} % of its fall, at"
            f" {show(verdict.energy.time, 's')}; an ideal network's never does (identity to"
            f" {ideal.pace.energy_residual:.1g})",
        )
    plane = verdict.constraint
    if plane is not None:
        lines.insert(
            2,
            f"constraint plane: amplifier alone rises in {show(plane.amplifier_rise_time, 's')},"
            f" its stage with capacitance in {show(plane.stage_rise_time, 's')} with"
            f" {100 * plane.stage_overshoot:.0f} % overshoot",
        )
    colour = COLOUR[verdict.outcome]
    return Group(
        *(Text(line, style="dim") for line in lines),
        Text(verdict.outcome.value.upper(), style=f"bold {colour}"),
    )
