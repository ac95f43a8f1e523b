"""Poles of a board, and the values of C at which it is stable."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from netlist_gen.board.circuit import Circuit
from spice_models.array_types import Complexes
from spice_models.errors import EngineError
from verification.engines.statespace.linearised.board import LinearBoard
from verification.report.html.blocks import Facts, Picture, Section
from verification.report.html.pictures import area, axis, label, line, numbers
from verification.report.html.texts import figure, quantity
from verification.small_signal.capacitance_ranges import AROUND, capacitance_ranges
from verification.small_signal.poles import Poles

SHOWN = 2000  # poles
NEAR = 8  # ringing poles, nearest the axis, that set the first view
DAMPING = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 0.7)
LARGE = "not computed for a board of this size; `taction onset SCENE --over C` finds it"


def stability_section(circuit: Circuit, poles: Poles) -> Section:
    """Return the pole map, the numbers of the rightmost pole, and the stable values of C."""
    lead = poles.rightmost
    ranges = stable_capacitances(circuit, poles)
    rows = (
        ("rightmost pole, real part", figure(lead.real, "1/s")),
        ("its frequency", quantity(abs(lead.imag) / math.tau, "Hz")),
        ("damping ratio of the rightmost ringing pole", f"{poles.damping_ratio:.4g}"),
        ("poles", str(len(poles.poles)) if poles.complete else f"rightmost {len(poles.poles)}"),
        ("C of this board", quantity(circuit.scalings.capacitance, "F")),
        ("stable values of C", ranges),
    )
    word = "stable" if poles.stable else "not stable"
    text = f"The board is {word} at C = {quantity(circuit.scalings.capacitance, 'F')}."
    return Section("Stability", (_map(poles, ranges), Facts("", rows)), text)


def stable_capacitances(circuit: Circuit, poles: Poles) -> str:
    """Return the stable values of C in words, or why they are not known."""
    board = LinearBoard(circuit)
    if board.descriptor.is_large:
        return LARGE
    try:
        found = capacitance_ranges(board, found=poles)
    except EngineError as error:
        return f"not known: {error}"
    parts = [_range(low, high, found.low, found.high) for low, high in found.stable]
    text = "; ".join(parts) or "none"
    if found.near:
        text += f"; rounding decides near {', '.join(quantity(c, 'F') for c in found.near)}"
    return f"{text} (from C/{AROUND:g} to {AROUND:g} C)"


def _range(low: float, high: float, least: float, most: float) -> str:
    if low <= least and high >= most:
        return "every value"
    if high >= most:
        return f"above {quantity(low, 'F')}"
    if low <= least:
        return f"below {quantity(high, 'F')}"
    return f"{quantity(low, 'F')} to {quantity(high, 'F')}"


def _map(poles: Poles, ranges: str) -> Picture:
    values = poles.poles[:SHOWN]
    data = [
        _dots(values[values.real < 0.0], "decays", "--pass", "circle"),
        _dots(values[values.real >= 0.0], "grows", "--fail", "x"),
    ]
    left, right, top = _window(values)
    rays = [
        {"type": "line", "x0": 0, "y0": 0, "x1": x, "y1": top / math.tau * 4, "layer": "below",
         "line": {"color": "--band", "width": 1, "dash": "dash"}}
        for x in (-zeta / math.sqrt(1 - zeta**2) * top * 4 for zeta in DAMPING)
    ]  # fmt: skip
    half = area(0.0, 4.0 * max(right, -left), across="x", colour="--fail-soft")
    layout = {
        "xaxis": axis("real part", "/s", range=[left, right]),
        "yaxis": axis("frequency", "Hz", range=[0.0, top / math.tau]),
        "shapes": [half, line(0.0, None), *rays],
        "annotations": [
            label("grows →", right, 1, yref="paper", xanchor="right", yanchor="top"),
            label(f"stable C: {ranges}", 0, 1.0, xref="paper", yref="paper",
                  xanchor="left", yanchor="bottom", font={"size": 12, "color": "--ink"}),
        ],
        "showlegend": False,
        "margin": {"l": 60, "r": 14, "t": 30, "b": 44},
    }  # fmt: skip
    summary = (
        "Poles of the linearised board in the upper half plane. Circles decay, orange crosses in"
        " the shaded half grow. On a dashed line the damping ratio is"
        f" {', '.join(f'{zeta:g}' for zeta in DAMPING)}, from the axis to the left. Stable values"
        f" of C: {ranges}."
    )
    return Picture("Pole map", {"data": data, "layout": layout}, summary, 380)


def _dots(poles: Complexes, name: str, colour: str, symbol: str) -> dict[str, Any]:
    upper = poles[poles.imag >= 0.0]
    return {
        "type": "scatter",
        "mode": "markers",
        "name": name,
        "x": numbers(upper.real),
        "y": numbers(upper.imag / math.tau),
        "marker": {"color": colour, "symbol": symbol, "size": 9},
        "hovertemplate": f"{name}: %{{x:.5s}}/s at %{{y:.5s}}Hz<extra></extra>",
    }


def _window(values: Complexes) -> tuple[float, float, float]:
    """Return the left, right and upper limit of the first view, 1/s."""
    ringing = values[values.imag > 0.0][:NEAR]
    if not len(ringing):
        real = values.real[:NEAR] if len(values) else np.array([-1.0])
        reach = float(np.abs(real).max()) or 1.0
        return -1.2 * reach, 0.3 * reach if real.max() < 0 else 1.3 * reach, math.tau * reach
    top = 1.25 * float(ringing.imag.max())
    left, right = float(ringing.real.min()), float(ringing.real.max())
    width = max(right - left, abs(left), abs(right), 1e-3 * top)
    return min(left, 0.0) - 0.15 * width, max(right, 0.0) + 0.3 * width, top
