"""The waveforms of a verdict: outputs with targets, deviation with the band, both engines."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from taction.system.array_types import Floats
from taction.verification.report.html.blocks import Picture, Section, View
from taction.verification.report.html.pictures import (
    area,
    axis,
    channel_colours,
    label,
    line,
    packed,
    thinned,
)
from taction.verification.report.html.sections.channels import channel_names, channel_table
from taction.verification.report.html.texts import counted, figure, quantity
from taction.verification.verdict.verify import Verdict

POINTS = 60_000  # of all curves of a picture
EARLY_POINTS = 0.3  # of them in the first rise
LABELLED = 12  # channels above which curves have no names beside them
MARKED = 6  # channels with marks of the second engine, of those without names
SEPARATE = 0.045  # of the height: closer names become one
OVER = 1.35  # times the band and the targets: what is shown of a growing record


def waveforms_section(verdict: Verdict) -> Section:
    """Return the pictures of the outputs, and the table of the channels."""
    pictures = [_outputs(verdict), _deviation(verdict)]
    agreement = verdict.agreement
    if agreement is not None and not agreement.reason:
        pictures.append(_difference(verdict))
    return Section("Waveforms", (*pictures, channel_table(verdict)))


def _early(verdict: Verdict) -> float:
    """Return the end of the first rise, s: ten times the longest rise time."""
    rises = [c.rise_time.value for c in verdict.measurements.channels if c.rise_time is not None]
    end = float(verdict.waveforms.time[-1])
    return min(10.0 * max(rises, default=end), end)


def _curve(verdict: Verdict, time: Floats, values: Floats, count: int) -> tuple[Floats, Floats]:
    """Return a curve with fewer points, of which the first rise has its share."""
    first = time <= _early(verdict)
    budget = POINTS / count
    if first.all():
        return thinned(time, values, int(budget))
    early = thinned(time[first], values[first], int(EARLY_POINTS * budget))
    late = thinned(time[~first], values[~first], int((1.0 - EARLY_POINTS) * budget))
    return np.concatenate([early[0], late[0]]), np.concatenate([early[1], late[1]])


def _traces(
    verdict: Verdict, time: Floats, columns: Floats, **style: Any
) -> Iterator[dict[str, Any]]:
    count = columns.shape[1]
    for n, (column, colour) in enumerate(zip(columns.T, channel_colours(count), strict=True), 1):
        x, y = _curve(verdict, time, column, count)
        second = n > (count + 1) // 2 and count <= LABELLED  # dashes tell symmetric channels apart
        yield {
            "type": "scatter",
            "mode": "lines",
            "x": packed(x),
            "y": packed(y),
            "name": f"u{n}",
            "line": {"color": colour, "width": 1.6, "dash": "dash" if second else "solid"},
            "showlegend": False,
            "hovertemplate": f"u{n}: %{{y:.5s}}V at %{{x:.5s}}s<extra></extra>",
            **style,
        }


def _second(verdict: Verdict) -> tuple[Floats, Floats] | None:
    """Return instants and outputs of the state-space engine beside a record of ngspice."""
    agreement = verdict.agreement
    if agreement is None or agreement.reason:
        return None
    places = np.searchsorted(verdict.waveforms.time, agreement.instants)
    return agreement.instants, verdict.u[places] - agreement.differences


def _outputs(verdict: Verdict) -> Picture:
    channels, time = verdict.measurements.channels, verdict.waveforms.time
    count, end, early = len(channels), float(time[-1]), _early(verdict)
    targets = [channel.target for channel in channels]
    data = list(_traces(verdict, time, verdict.u))
    second = _second(verdict)
    if second is not None:
        data += list(_marks(verdict, *second))
    low, high, cut = _window(verdict)
    colours = channel_colours(count)
    shapes = [line(None, y, c, dash="dot", width=1) for y, c in zip(targets, colours, strict=True)]
    if verdict.measurements.settling_time is not None:
        shapes.append(line(verdict.measurements.settling_time.value, None, "--muted", dash="dash"))
    names = list(_names(targets, low, high)) if count <= LABELLED else []
    layout = {
        "xaxis": axis("time", "s", range=[0.0, early]),
        "yaxis": axis("output", "V", range=[low, high]),
        "shapes": shapes,
        "annotations": names,
        "hovermode": "closest",
        "margin": {
            "l": 56,
            "r": max([14, *(20 + 6 * len(each["text"]) for each in names)]),
            "t": 24,
            "b": 44,
        },
    }
    engines = verdict.waveforms.simulator.replace("statespace", "the state-space engine")
    if second is not None:
        engines += "; open circles: state-space engine"
        if count > LABELLED:
            engines += f", for {', '.join(f'u{n}' for n in _marked(count))}"
    looks = " Dashed curves: the second half of the channels." if count > 1 else ""
    if count > LABELLED:
        looks = f" The colour goes from blue (u1) over violet to orange (u{count})."
    summary = (
        f"Outputs of {counted(count, 'channel')} from 0 to"
        f" {quantity(end, 's')} by {engines}. Dotted: the target of each channel, from the"
        f" numerical solution.{looks}"
        f"{' The picture ends where the record grows beyond it.' * cut}"
    )
    views = (_time_view("first rise", early), _time_view("whole record", end))
    spec, result = {"data": data, "layout": layout}, _settled(verdict)
    return Picture("Outputs", spec, summary, 420, views, result=result)


def _settled(verdict: Verdict) -> str:
    """Return when the board settles, or that it does not."""
    settling = verdict.measurements.settling_time
    if settling is not None:
        return f"settled at {quantity(settling.value, 's')}"
    states = {channel.state.value for channel in verdict.measurements.channels} - {"settled"}
    return f"not settled ({', '.join(sorted(states))})" if states else "not settled"


def _time_view(name: str, end: float) -> View:
    return View(name, {"xaxis.range": [0.0, end]})


def _marks(verdict: Verdict, instants: Floats, other: Floats) -> Iterator[dict[str, Any]]:
    """Yield the second engine's outputs as circles, evenly in both views."""
    early, end, each = _early(verdict), float(instants[-1]), 18
    wanted = np.concatenate([np.linspace(0.0, early, each), np.linspace(early, end, each)])
    places = np.unique(np.minimum(np.searchsorted(instants, wanted), len(instants) - 1))
    count = other.shape[1]
    colours = channel_colours(count)
    for n in _marked(count):
        column, colour = other[:, n - 1], colours[n - 1]
        yield {
            "type": "scatter",
            "mode": "markers",
            "x": packed(instants[places]),
            "y": packed(column[places]),
            "name": "state-space engine",
            "legendgroup": "second",
            "showlegend": n == 1,
            "marker": {"symbol": "circle-open", "size": 6, "color": colour},
            "hovertemplate": f"u{n}, state-space: %{{y:.5s}}V at %{{x:.5s}}s<extra></extra>",
        }


def _marked(count: int) -> list[int]:
    """Return the channels, from 1, that have marks of the second engine."""
    places = np.linspace(1, count, min(count, LABELLED if count <= LABELLED else MARKED))
    return [int(place) for place in places.round()]


def _window(verdict: Verdict) -> tuple[float, float, bool]:
    """Return the shown range of the outputs, V, and whether a growing record is cut off."""
    targets = np.array([c.target for c in verdict.measurements.channels])
    start = verdict.u[0]
    low = float(min(targets.min(), start.min(), verdict.u.min()))
    high = float(max(targets.max(), start.max(), verdict.u.max()))
    supply = verdict.circuit.supply
    allowed = OVER * max(supply, float(np.abs(targets).max()))
    cut = max(-low, high) > allowed
    low, high = max(low, -allowed), min(high, allowed)
    room = 0.06 * ((high - low) or max(abs(high), 1e-12))
    return low - room, high + room, cut


def _names(targets: list[float], low: float, high: float) -> Iterator[dict[str, Any]]:
    """Yield the names of the channels at their targets; neighbours share a label."""
    groups: list[list[int]] = []
    for n in sorted(range(len(targets)), key=targets.__getitem__):
        near = groups and targets[n] - targets[groups[-1][0]] < SEPARATE * (high - low)
        if near:
            groups[-1].append(n)
        else:
            groups.append([n])
    for group in groups:
        text = channel_names(group)
        height = sum(targets[n] for n in group) / len(group)
        yield label(text, 1.005, height, xref="paper", xanchor="left")


def _deviation(verdict: Verdict) -> Picture:
    """Return the deviation from the targets in % of the step, with the settling band."""
    m, time = verdict.measurements, verdict.waveforms.time
    scale, end = 100.0 / (m.amplitude or 1.0), float(time[-1])
    targets = np.array([c.target for c in m.channels])
    off, band = scale * (verdict.u - targets), 100.0 * m.band
    hover = "%{fullData.name}: %{y:.4g} % at %{x:.5s}s<extra></extra>"
    data = list(_traces(verdict, time, off, hovertemplate=hover))
    shapes = [area(-band, band, across="y", colour="--band")]
    settled = "the board does not settle within the record"
    if m.settling_time is not None:
        settled = f"settled at {quantity(m.settling_time.value, 's')}"
        shapes.append(line(m.settling_time.value, None, "--ink", dash="dash"))
    reach = 6.0 * band if m.settling_time is not None else 130.0
    layout = {
        "xaxis": axis("time", "s", range=[0.0, end]),
        "yaxis": axis("deviation (% of the step)", range=[-reach, reach]),
        "shapes": shapes,
        "hovermode": "closest",
    }
    largest = float(np.abs(off).max(initial=0.0)) * 1.05 or 1.0
    views = (
        View("around the band", {"xaxis.range": [0, end], "yaxis.range": [-reach, reach]}),
        View("first rise", {"xaxis.range": [0, _early(verdict)], "yaxis.range": [-130, 130]}),
        View("everything", {"xaxis.range": [0, end], "yaxis.range": [-largest, largest]}),
    )
    summary = (
        f"Output minus target of every channel; shaded: the band of ±{band:g} % of the step of"
        f" {quantity(m.amplitude, 'V')}; {settled}."
    )
    inside = "every" if m.settling_time is not None else "not every"
    result = f"{inside} channel stays within ±{band:g} %"
    spec = {"data": data, "layout": layout}
    return Picture("Deviation from the targets", spec, summary, 360, views, result=result)


def _difference(verdict: Verdict) -> Picture:
    agreement = verdict.agreement
    if agreement is None:
        raise ValueError("one engine has no difference")
    scale = 100.0 / (verdict.measurements.amplitude or agreement.unit)
    hover = "%{fullData.name}: %{y:.3g} % at %{x:.5s}s<extra></extra>"
    data = list(
        _traces(verdict, agreement.instants, scale * agreement.differences, hovertemplate=hover)
    )
    layout = {"xaxis": axis("time", "s"), "yaxis": axis("difference (% of the step)")}
    largest = agreement.difference * scale
    summary = (
        f"ngspice minus the state-space engine. The largest difference is"
        f" {figure(largest / 100.0, 'step')} of the step, in u{agreement.channel + 1} at"
        f" {quantity(agreement.time, 's')}; accepted: {figure(agreement.limit, 'step')}."
    )
    result = f"apart by at most {figure(largest / 100.0, 'step')} of the step"
    return Picture("Both engines", {"data": data, "layout": layout}, summary, 300, result=result)
