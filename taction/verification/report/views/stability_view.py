"""Poles of a board, and the values of C at which it is stable."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.system.array_types import Complexes, Floats
from taction.system.charts import Axis, Band, Chart, Curve, Limit, Mark, Text, View, segments
from taction.system.errors import EngineError
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.report.blocks import Block, Facts, Notes, Table
from taction.verification.report.texts import figure, quantity
from taction.verification.stability.edges import Edges, Range
from taction.verification.stability.margin import AROUND, first_knob, stable_values
from taction.verification.stability.poles import Poles
from taction.verification.verdict.verify import Verdict

SHOWN = 2000  # poles
MOST = 100  # channels up to which the stable values of C cost some seconds
SCANNED = 32  # the same where a scan has to find them: of a knob that scales an array
FAR = 30.0  # times the size of the smallest pair: pairs beyond it are not in the first view
DAMPING = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 0.7)
Window = tuple[float, float, float]

LARGE = "not computed for a board of this size; `taction onset SCENE --over {}` finds it"


def stability_blocks(circuit: Circuit, poles: Poles) -> tuple[Block, ...]:
    """Return the pole map, the numbers of the rightmost pole, and the stable values of a knob.

    The knob is the first one with a margin: C, say. A board may have none.
    """
    lead, name = poles.rightmost, first_knob(circuit)
    rows: tuple[tuple[str, str], ...] = (
        ("rightmost pole, real part", figure(lead.real, "1/s")),
        ("its frequency", quantity(abs(lead.imag) / math.tau, "Hz")),
        ("damping ratio of the rightmost ringing pole", f"{poles.damping_ratio:.4g}"),
        ("poles", str(len(poles.poles)) if poles.complete else f"rightmost {len(poles.poles)}"),
    )
    word = {True: "stable", False: "not stable", None: "stable or not, which rounding hides,"}
    if not name:
        return (
            Notes("", (f"The board is {word[poles.stable]}.".replace(",.", "."),)),
            pole_map(poles),
            Facts("", rows),
        )
    ranges, own = knob_ranges(circuit, poles), circuit.facts[name].text
    stated = f"Stable values of {name}: {ranges}."
    rows = (*rows, (f"{name} of this board", own), (f"stable values of {name}", ranges))
    text = f"The board is {word[poles.stable]} at {name} = {own}. {stated}"
    return Notes("", (text,)), pole_map(poles, stated), Facts("", rows)


def active_set_blocks(verdict: Verdict) -> tuple[Block, ...]:
    """Return the active sets that a board of piecewise linear amplifiers visits."""
    columns = {
        "pieces": lambda each: each.active,
        "from": lambda each: quantity(each.begin, "s"),
        "stays": lambda each: quantity(each.stay, "s"),
        "visits": lambda each: str(each.visits),
        "rightmost pole": lambda each: figure(each.rightmost, "1/s"),
        "stability": lambda each: each.words,
    }
    sets = verdict.active_sets
    note = "The straight piece of each channel's amplifier, counted from the left."
    return (Table.of("Active sets", sets, columns, note),) if sets else ()


def knob_ranges(circuit: Circuit, poles: Poles) -> str:
    """Return the stable values of the first knob with a margin, or why they are not known."""
    board, name = LinearBoard(circuit), first_knob(circuit)
    most = SCANNED if circuit.scales_arrays(circuit.knob(name)) else MOST
    if len(circuit.outputs) > most or not (poles.complete or poles.stable):
        return LARGE.format(name)
    try:
        found = stable_values(board, found=poles)
    except EngineError as error:
        return f"not known: {error}"
    words = ranges_text(found, found.low, found.high, circuit.facts[name].unit)
    return f"{words} (from {name}/{AROUND:g} to {AROUND:g} {name})"


def ranges_text(found: Edges, low: float, high: float, unit: str = "F") -> str:
    """Return the stable values between two ends in words."""
    near = ", ".join(quantity(value, unit) for value in found.near)
    text = ranges_words(found.stable_ranges, low, high, unit)
    return text + (f"; rounding decides near {near}" if near else "")


def ranges_words(ranges: Sequence[Range], low: float, high: float, unit: str) -> str:
    """Return ranges between two ends in words."""
    parts = []
    for first, last in ranges:
        ends = [quantity(end, unit) for end in (first, last)]
        if first <= low and last >= high:
            parts.append("every value")
        elif last >= high > first:
            parts.append(f"above {ends[0]}")
        elif first <= low < last:
            parts.append(f"below {ends[1]}")
        elif low < last and first < high:
            parts.append(" to ".join(ends))
    return "; ".join(parts) or "none"


def pole_map(poles: Poles, ranges: str = "") -> Chart:
    """Return the upper half plane with the poles and lines of equal damping.

    `ranges` is a sentence about the stable values.
    """
    values = poles.poles[poles.poles.imag >= 0.0][:SHOWN]
    views = _views(values)
    marks: list[Mark] = [*mode_marks(values.real, values.imag / math.tau, values.real)]
    low, _, up = views[0][1]
    if far := values[(values.real < low) | (values.imag > up)].tolist():
        size = figure(max(map(abs, far)), "1/s", 2)
        marks.append(Text(f"← {len(far)} farther, to {size}", None, None, ("right", "below")))
    summary = f"Poles of the linearised board. Circles decay, crosses grow. {ranges}".rstrip()
    return upper_half_plane(marks, views, _result(poles), summary)


def upper_half_plane(
    marks: Sequence[Mark], windows: Sequence[tuple[str, Window]], message: str, summary: str
) -> Chart:
    """Return `marks` of poles over the growing half and lines of equal damping, in `windows`."""
    sides = [[window[k] for _, window in windows] for k in range(3)]
    left, right, top = min(sides[0]), max(sides[1]), max(sides[2])
    reach = 1.5 * math.hypot(left, top)
    ends = [(-z * reach, math.sqrt(1.0 - z**2) * reach / math.tau) for z in DAMPING]
    lines = segments([((0.0, 0.0), end) for end in ends])
    ground = (
        Band(0.0, reach, "x", colour="fail"),
        Limit(0.0, "x", line="solid"),
        Curve(*lines, "equal damping", "band", width=1.0, label="", behind=True),
        Text("grows →", None, None, ("left", "above")),
    )
    ratios = ", ".join(f"{zeta:g}" for zeta in DAMPING)
    return Chart(
        "Pole map",
        Axis("real part", "1/s", limits=(left, right)),
        Axis("frequency", "Hz", limits=(0.0, top / math.tau)),
        (*ground, *marks),
        message,
        f"The upper half plane; in the shaded part a mode grows. {summary} On a thin line the"
        f" damping ratio is {ratios}, from the axis to the left.",
        tuple(View(name, (low, high), (0.0, up / math.tau)) for name, (low, high, up) in windows),
        legend="below",
    )


def mode_marks(
    x: Floats, y: Floats, real: Floats, texts: Sequence[str] = (), size: float = 6.0
) -> tuple[Curve, Curve]:
    """Return the modes (P,) that decay, as circles, and those that grow, as crosses.

    `real` are the real parts of the poles, 1/s, and `texts` are for the pointer, one for each.
    """

    def marks(name: str, outcome: str, mark: str, chosen: np.ndarray) -> Curve:
        hover = tuple(itertools.compress(texts, chosen))
        return Curve(x[chosen], y[chosen], name, outcome, "", mark, size=size, hover=hover)

    return marks("decays", "pass", "circle", real < 0.0), marks("grows", "fail", "x", real >= 0.0)


def _result(poles: Poles) -> str:
    """Return the rightmost pole in words."""
    lead = poles.rightmost
    word = {True: "decays", False: "grows", None: "may decay or grow,"}[poles.stable]
    ringing = f" at {quantity(abs(lead.imag) / math.tau, 'Hz')}" if lead.imag else ""
    return f"the rightmost mode {word} with {figure(abs(lead.real), '1/s')}{ringing}"


def _views(values: Complexes) -> list[tuple[str, Window]]:
    """Return the parts of the pole map: the pairs that are not far away, then all poles.

    Without pairs the first part has the real poles that are not far away.
    """
    views = [("all poles", _around(values, values.real.min(initial=0.0)))]
    pairs = values[values.imag > 0.0]
    shown = pairs if len(pairs) else values
    if len(shown):
        lead, sizes = shown[:1], np.abs(shown)
        near = shown[sizes <= FAR * max(sizes.min(), abs(lead[0]))]
        if len(pairs):
            views.insert(0, ("rightmost pair", _around(lead, -3.0 * abs(lead[0].real))))
        if len(pairs) or len(near) < len(values):
            name = "pairs" if len(pairs) else "slowest poles"
            views.insert(0, (name, _around(near, near.real.min())))
    return views


def _around(values: Complexes, left: float) -> Window:
    """Return the left, right and upper limit of a view, 1/s; the axis is always in it."""
    right = max(float(values.real.max(initial=0.0)), 0.0)
    width = (right - min(left, 0.0)) or 1.0
    top = float(values.imag.max(initial=0.0)) or math.tau * width
    return min(float(left), 0.0) - 0.1 * width, right + 0.3 * width, 1.25 * top
