"""Charts of a verdict over time and by channel: outputs, deviation, both engines, stress."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from taction.netlist_gen.scene.inverse_problem import InverseProblem
from taction.netlist_gen.scene.scene import Scene
from taction.system import charts
from taction.system.array_types import Floats
from taction.system.quantities import banded, counted, quantity
from taction.verification.report.texts import figure
from taction.verification.verdict.verify import Verdict

POINTS = 60_000  # of all curves of a chart
EARLY = 10.0  # rise times, or periods of an oscillation, that a view of the first rise shows
LABELLED = 12  # channels above which curves have no names beside them
ROOM = 0.06  # of the height, above and below the curves
SEPARATE = 0.055  # of the height: closer names become one
OVER = 1.35  # times the supply and the targets: what is shown of a growing record
SEEN = 20.0  # times the optimum: a larger end of the record is off the chart


def channel_names(places: Iterable[int]) -> str:
    """Return the names of channels, of three and more in a row the first and the last.

    >>> channel_names([0, 6]), channel_names([4, 1, 2, 3])
    ('u1, u7', 'u2 to u5')
    """
    runs: list[list[int]] = []
    for n in sorted(places):
        if runs and n == runs[-1][-1] + 1:
            runs[-1].append(n)
        else:
            runs.append([n])
    return ", ".join(
        f"u{run[0] + 1} to u{run[-1] + 1}" if len(run) > 2 else ", ".join(f"u{n + 1}" for n in run)
        for run in runs
    )


def curves(
    time: Floats,
    values: Floats,
    names: Sequence[str] = (),
    *,
    line: charts.Line = "",
    width: float = 1.2,
    points: int = POINTS,
) -> Iterator[charts.Curve]:
    """Yield a thinned curve for each channel of `values` (P, N), without a name in the legend.

    Without a `line`, dashes tell symmetric channels apart.
    """
    count = values.shape[1]
    for n, (column, look) in enumerate(zip(values.T, charts.spread_colours(count), strict=True)):
        x, y = charts.thinned(time, column, points // count)
        dashed = n >= (count + 1) // 2 and count <= LABELLED
        drawn, name = line or ("dash" if dashed else "solid"), names[n] if names else f"u{n + 1}"
        yield charts.Curve(x, y, name, look, drawn, width=width, label="")


def looks_text(count: int) -> str:
    """Return how the curves of `count` channels are told apart."""
    if count > LABELLED:
        return f" The colour goes from blue (u1) over violet to orange (u{count})."
    return " Dashed curves: the second half of the channels." if count > 1 else ""


def with_room(low: float, high: float) -> charts.Limits:
    """Return the ends of an axis around values from `low` to `high`."""
    room = ROOM * ((high - low) or max(abs(high), 1e-12))
    return low - room, high + room


def output_marks(
    time: Floats, outputs: Floats, targets: Sequence[float], limits: charts.Limits, **more: Any
) -> Iterator[charts.Mark]:
    """Yield outputs with their targets, and the names of few channels beside them; see `curves`."""
    colours = charts.spread_colours(len(targets))
    yield from curves(time, outputs, **more)
    pairs = zip(targets, colours, strict=True)
    yield from (charts.Limit(y, "y", "", look, "dot") for y, look in pairs)
    if len(targets) <= LABELLED:
        yield from end_names(targets, *limits, colours)


def outputs_chart(verdict: Verdict) -> charts.Chart:
    """Return the first rise of the outputs, or their growth, with their targets."""
    found, end = verdict.measurements, float(verdict.waveforms.time[-1])
    targets = [channel.target for channel in found.channels]
    rises = [each.rise_time.value for each in found.channels if each.rise_time is not None]
    if not rises and verdict.poles.frequency > 0.0:
        rises = [1.0 / verdict.poles.frequency]
    shown = 0.0, min(EARLY * max(rises, default=math.inf), end)
    every = np.append(targets, np.where(np.isfinite(verdict.u), verdict.u, 0.0))
    allowed = OVER * max(verdict.circuit.supply, float(np.abs(targets).max()))
    cut = bool(np.abs(every).max() > allowed)  # a record that grows
    low, high = np.clip((every.min(), every.max()), -allowed, allowed).tolist()
    limits = with_room(low, high)
    if verdict.poles.known_unstable:  # the first periods are flat beside the growth
        shown = _up_to_supply(verdict, verdict.u / (found.amplitude or 1.0))[0]
    marks = [*output_marks(verdict.waveforms.time, verdict.u, targets, limits)]
    settled = "not settled"
    if found.settling_time is not None:
        marks.append(charts.Limit(found.settling_time.value, "x", "", "muted"))
        settled = settled_text(verdict)
    elif states := {channel.state.value for channel in found.channels} - {"settled"}:
        settled = f"not settled ({', '.join(sorted(states))})"
    engine = verdict.waveforms.simulator.replace("statespace", "the state-space engine")
    summary = (
        f"Outputs of {counted(len(targets), 'channel')} up to {quantity(shown[1], 's', 3)} of"
        f" {quantity(end, 's')} by {engine}."
        " Dotted: the target of each channel, from the numerical solution."
    ) + looks_text(len(targets))
    if cut:
        largest = quantity(float(np.abs(verdict.u).max()), "V", 2)
        supply = quantity(verdict.circuit.supply, "V", 3)
        summary += f" The chart ends where the record grows to {largest}; the supply is ±{supply}."
    axes = replace(charts.TIME, limits=shown), charts.Axis("output", "V", limits=limits)
    title = f"Outputs: {settled}"
    return charts.Chart(title, *axes, tuple(marks), summary, height=420)


def settled_text(verdict: Verdict) -> str:
    """Return when a network settles, to which band: ``"settled to ±1 % at 2.42 ms"``."""
    found = verdict.measurements
    at = None if found.settling_time is None else found.settling_time.value
    return f"{banded('settled', found.band)} at {quantity(at, 's')}"


def end_names(
    targets: Sequence[float],
    low: float,
    high: float,
    colours: Sequence[str],
    name: Callable[[Iterable[int]], str] = channel_names,
) -> Iterator[charts.Text]:
    """Yield the names of the channels at their targets; neighbours share a label, by `name`."""
    groups: list[list[int]] = []
    for n in sorted(range(len(targets)), key=targets.__getitem__):
        if groups and targets[n] - targets[groups[-1][-1]] < SEPARATE * (high - low):
            groups[-1].append(n)
        else:
            groups.append([n])
    for group in groups:
        height = sum(targets[n] for n in group) / len(group)
        look = colours[group[0]] if len(group) == 1 else "muted"
        yield charts.Text(name(group), None, height, ("right", "middle"), look)


def deviation_chart(verdict: Verdict) -> charts.Chart:
    """Return the deviation from the targets as part of the step, with the settling band."""
    m, end = verdict.measurements, float(verdict.waveforms.time[-1])
    band = m.band
    off = (verdict.u - np.array([c.target for c in m.channels])) / (m.amplitude or 1.0)
    drawn = curves(verdict.waveforms.time, off, width=0.8)
    marks: list[charts.Mark] = [charts.Band(-band, band, "y"), *drawn]
    if m.settling_time is None:
        settled = "the board does not settle within the record"
        shown, sizes = _up_to_supply(verdict, off / 1.05)
    else:
        settled = f"dashed: {settled_text(verdict)}"
        marks.append(charts.Limit(m.settling_time.value, "x"))
        shown, sizes = (0.0, end), (-6.0 * band, 6.0 * band)
    summary = (
        f"Output minus target of every channel; shaded: the band of ±{100 * band:g} % of the step"
        f" of {quantity(m.amplitude, 'V')}; {settled}."
    )
    axes = replace(charts.TIME, limits=shown), charts.Axis("deviation", "step", limits=sizes)
    return charts.Chart("Deviation from the targets", *axes, tuple(marks), summary)


def _up_to_supply(verdict: Verdict, off: Floats) -> tuple[charts.Limits, charts.Limits]:
    """Return the part of a record that does not settle up to where it exceeds the supply."""
    time, end = verdict.waveforms.time, float(verdict.waveforms.time[-1])
    reach = verdict.circuit.supply / (verdict.measurements.amplitude or 1.0)
    beyond = np.abs(off).max(axis=1) > reach
    if beyond.any():
        end = min(1.1 * float(time[int(beyond.argmax())]), end)
    largest = 1.1 * float(np.nanmax(np.abs(off), initial=0.0)) or 1.0
    return (0.0, end), (-min(reach, largest), min(reach, largest))


def difference_chart(verdict: Verdict) -> charts.Chart | None:
    """Return ngspice minus the state-space engine; None where only one engine ran."""
    agreement = verdict.agreement
    if agreement is None or agreement.reason:
        return None
    time, channel = agreement.largest
    scale = 1.0 / (verdict.measurements.amplitude or agreement.unit)
    largest = f"{figure(agreement.difference * scale, 'step')} of the step"
    return charts.Chart(
        "ngspice minus the state-space engine",
        replace(charts.TIME, limits=(0.0, float(verdict.waveforms.time[-1]))),
        charts.Axis("difference", "step"),
        tuple(curves(agreement.instants, scale * agreement.differences, width=0.8)),
        f"The largest difference is {largest}, in u{channel + 1} at"
        f" {quantity(time, 's')}; accepted: {figure(agreement.limit, 'step')}.",
    )


def stress_chart(verdict: Verdict) -> charts.Chart:
    """Return the recovered stress beside the regularised answer and the true stress."""
    unit, channels = verdict.circuit.value("U0"), verdict.measurements.channels
    optimum = np.array([c.target for c in channels]) / unit
    final = np.array([c.final for c in channels]) / unit
    far = np.abs(final).max() >= SEEN * (np.abs(optimum).max() + 1e-300)
    rest, shown = verdict.steady.values / unit, None if far else final
    chart = recovered_stress(verdict.problem, verdict.scene, optimum, rest, shown)
    text = " The end of the record is far off this chart." * bool(far)
    return replace(chart, summary=f"Stress by channel.{text}")


def recovered_stress(
    problem: InverseProblem,
    scene: Scene,
    optimum: Floats,
    rest: Floats,
    final: Floats | None = None,
) -> charts.Chart:
    """Return stresses (N,) by channel, without unit: of an answer, a board, and the truth."""
    if problem.positions is None:
        where, x = np.arange(1.0, len(rest) + 1), charts.Axis("channel", whole=True)
    else:
        where = problem.positions / getattr(scene.problem, "depth", 1.0)
        x = charts.Axis("place y (in depths)")
    curves = [
        charts.Curve(where, optimum, "regularised answer", "pass", "dash", "square-open"),
        charts.Curve(where, rest, "board at rest", "ink", "", "line-ns", size=8.0),
    ]
    if final is not None:
        curves.append(charts.Curve(where, final, "board, end of record", "fail", "", "x"))
    if problem.stress is not None:
        true = charts.Curve(where, problem.stress, "true stress", "true", "solid", "circle")
        curves.insert(0, true)
    return charts.Chart("Recovered stress", x, charts.Axis("stress"), tuple(curves))
