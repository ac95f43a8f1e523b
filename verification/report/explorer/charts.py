"""The charts of the explorer: outputs, recovered stress, poles, as the page is told of them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from taction.system.array_types import Floats
from taction.verification.design.board_view import Curves, PoleView, RestView, true_outputs
from taction.verification.report.charts import (
    Axis,
    Band,
    Chart,
    Curve,
    Limit,
    Line,
    Mark,
    Text,
    spread_colours,
    thinned,
)
from taction.verification.report.renderers.plotly import plotly_spec
from taction.verification.report.texts import figure, quantity
from taction.verification.stability.poles import Poles

POINTS = 500  # of a curve
ALL_POINTS = 12_000  # of all curves
KEPT = 500  # of a record that another process makes, before it is thinned to `POINTS`
NAMED = 12  # channels above which curves have no names, targets and bands
SEPARATE = 0.06  # of the height: closer names become one
ROOM = 0.06  # of the height of the chart, above and below the curves
POLES = 400  # rightmost poles that are drawn
STEPS_OF_TEN = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0)  # ends of the chart of the poles
Part = dict[str, Any]


def chart_part(chart: Chart) -> Part:
    """Return a chart as the page draws it, with its caption."""
    return {**plotly_spec(chart), "note": chart.summary}


def outputs_chart(curves: Curves, other: Curves | None, view: RestView, window: str) -> Chart:
    """Return the outputs of all channels in a window, with their targets and bands.

    Parameters
    ----------
    other : Curves or None
        The record of ngspice.
    window : str
        ``"rise"`` or ``"whole"``.
    """
    end = curves.rise if window == "rise" else curves.stop
    time, outputs, beyond = _shown(curves, end, view)
    targets, count = view.targets, outputs.shape[1]
    colours, supply = spread_colours(count), quantity(view.board.circuit.supply, "V")
    low = min(float(outputs.min()), float(targets.min()))
    high = max(float(outputs.max()), float(targets.max()))
    room = ROOM * ((high - low) or max(abs(high), 1e-12))
    limits = (low - room, high + room)
    named = count <= NAMED
    marks: list[Mark] = []
    if named:
        step = float(np.abs(targets - outputs[0]).max(initial=0.0))
        band = view.scene.checks.settling_time.band * step
        for y, colour in zip(targets.tolist(), colours, strict=True):
            marks += [Band(y - band, y + band, "y", "", colour), Limit(y, "y", "", colour, "dot")]
    for n, (column, colour) in enumerate(zip(outputs.T, colours, strict=True), 1):
        dash: Line = "dash" if n > (count + 1) // 2 and count > 1 else "solid"
        curve = thinned(time, column, min(POINTS, ALL_POINTS // count))
        marks.append(Curve(*curve, f"u{n}", colour, dash, width=1.8, label=""))
    if named:
        marks += _end_names(outputs[-1], limits)
    if other is not None:
        time, theirs, _ = _shown(other, end, view)
        marks += [
            Curve(*thinned(time, column, POINTS), "ngspice", "ink", "dot", width=2.4, label="")
            for column in theirs.T
        ]
    notes = ["Dotted: targets; shaded: the settling band."]
    if not named:
        notes = [f"{count} channels, the first to the last from blue to orange."]
    if count > 1:
        notes.append("Dashed curves: the second half of the channels.")
    if beyond:
        text = f"The chart ends at the supply of {supply}: beyond it the linear board is not"
        notes.append(f"{text} the board.")
    if other is not None:
        notes.append("Dots on the curves: ngspice.")
    time_axis, volts = Axis("time", "s", limits=(0.0, end)), Axis("", "V", limits=limits)
    return Chart("Outputs", time_axis, volts, tuple(marks), summary=" ".join(notes), legend="")


def _shown(curves: Curves, end: float, view: RestView) -> tuple[Floats, Floats, bool]:
    """Return a window of the curves within the supply, and whether they go beyond it."""
    shown = curves.time <= end * (1.0 + 1e-9)
    outputs, limit = curves.outputs[shown], view.board.circuit.supply
    with np.errstate(invalid="ignore"):
        beyond = bool((~(np.abs(outputs) <= limit)).any())
    outputs = np.nan_to_num(outputs, nan=limit, posinf=limit, neginf=-limit)
    return curves.time[shown], np.clip(outputs, -limit, limit), beyond


def _end_names(ends: Floats, limits: tuple[float, float]) -> list[Text]:
    """Return the names of the curves at their ends; names that would overlap become one."""
    near = SEPARATE * (limits[1] - limits[0])
    groups: list[list[int]] = []
    for n in np.argsort(ends, kind="stable").tolist():
        if groups and ends[n] - ends[groups[-1][-1]] < near:
            groups[-1].append(n)
        else:
            groups.append([n])
    return [
        Text(
            " ".join(f"u{n + 1}" for n in sorted(group)), None,
            float(ends[group[len(group) // 2]]), ("right", "middle"), "ink",
        )
        for group in groups
    ]  # fmt: skip


def stress_chart(view: RestView) -> Chart:
    """Return the recovered stress: the truth, the numerical solution, and the board at rest."""
    places, truth, targets = view.problem.positions, true_outputs(view), view.targets
    x = np.arange(1.0, len(view.rest) + 1.0) if places is None else places
    marks: list[Mark] = []
    if truth is not None:
        marks.append(Curve(x, truth, "truth", "true", mark="circle", size=3.0, width=5.0))
    marks.append(Curve(x, targets, "numerical solution", "pass", "dash", width=2.0))
    marks.append(Curve(x, view.rest, "board at rest", "fail", "", "circle-open", size=7.0))
    note = f"Board less solution: at most {_largest(view.rest - targets)}."
    if truth is not None and (size := float(np.linalg.norm(truth))):
        share = 100.0 * float(np.linalg.norm(targets - truth)) / size
        note += f" Solution less truth: {share:.3g} % of the truth."
    along = Axis("channel", whole=True) if places is None else Axis("place y")
    return Chart("Recovered stress", along, Axis("", "V"), tuple(marks), summary=note)


def _largest(differences: Floats) -> str:
    return quantity(float(np.abs(differences).max(initial=0.0)), "V", 3)


def poles_chart(view: PoleView) -> Chart:
    """Return the poles in the upper half plane, and what they say."""
    poles = view.poles
    upper, (left, right, top) = poles.poles[poles.poles.imag >= 0.0][:POLES], _window(poles)
    grows = upper.real >= 0.0
    groups = (
        (upper[~grows], "decays", "pass", "circle-open", 6.5),
        (upper[grows], "grows", "fail", "x", 7.5),
    )
    marks: tuple[Mark, ...] = (
        Band(0.0, right, "x", "", "fail", hatched=True),
        Limit(0.0, "x", "", "ink", "solid", 1.5),
        Text("grows", None, None, ("left", "below"), "fail"),
        *(
            Curve(each.real, each.imag / math.tau, name, outcome, "", mark, size=size, label="")
            for each, name, outcome, mark, size in groups
        ),
    )
    lead = poles.rightmost
    text = figure(lead.real, "1/s")
    if lead.imag:
        text += f" at {quantity(abs(lead.imag) / math.tau, 'Hz')}"
    damping = f"{poles.damping_ratio:.3g}" if poles.frequency else "does not ring"
    return Chart(
        "Poles",
        Axis("real part", "1/s", limits=(left, right)),
        Axis("", "Hz", limits=(0.0, top)),
        marks,
        summary=f"The board is {view.state}. Rightmost pole: {text}; damping ratio {damping}.",
        legend="",
    )


def _window(poles: Poles) -> tuple[float, float, float]:
    """Return left, right and top of the chart: the slow and ringing poles, in round numbers."""
    values = poles.poles
    ringing = values[(values.imag > 0.0) & (-values.real < 0.5 * np.abs(values))]
    shown = ringing if len(ringing) else values
    left = float(min(shown.real.min(initial=0.0), -1e-3 * np.abs(shown).max(initial=1.0)))
    right = max(float(values.real.max(initial=0.0)), 0.0)
    top = float(shown.imag.max(initial=0.0)) / math.tau
    return -_rounded(-1.1 * left), _rounded(max(1.2 * right, -0.25 * left)), _rounded(1.15 * top)


def _rounded(value: float) -> float:
    """Return the next of 1, 1.5, 2, 3, 5, 7 times a power of ten, so that a chart rarely jumps.

    Examples
    --------
    >>> _rounded(1.2e4), _rounded(0.61), _rounded(0.0)
    (15000.0, 0.7, 0.0)
    """
    if not value > 0.0 or not math.isfinite(value):
        return 0.0
    power = 10.0 ** math.floor(math.log10(value))
    reached = (step for step in STEPS_OF_TEN if step * power >= value * (1.0 - 1e-9))
    return float(f"{next(reached) * power:.2g}")
