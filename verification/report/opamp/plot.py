"""Picture of an op-amp: Bode diagram of the open loop, and steps of a follower."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from taction.spice_models.opamp import OpAmp
from taction.system.array_types import Floats
from taction.system.quantities import readable, show
from taction.verification.characterise.characterise import (
    STEP,
    Bode,
    bode,
    large_step,
    step_response,
    supply_of,
)
from taction.verification.characterise.witnesses import Witness
from taction.verification.report.picture import BLUE, GREY, ORANGE, figure_file, time_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARKS = 25  # of the second witness on a curve
SHOWN_SMALL, SHOWN_LARGE = 0.5, 0.6  # of the records of the steps
SKIPPED = 1e-3  # of the shown record: the jump through the input's capacitance
OURS: dict[str, Any] = {"color": BLUE, "lw": 1.8, "zorder": 2}
THEIRS: dict[str, Any] = {
    "color": ORANGE, "lw": 0.0, "marker": "o", "ms": 4.5, "mfc": "none", "mew": 1.1, "zorder": 3,
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """What one witness measured: the open loop, and steps as pairs of instants and voltages."""

    bode: Bode
    small: tuple[Floats, Floats]
    large: tuple[Floats, Floats] | None


def measure_curves(opamp: OpAmp, witness: Witness) -> Curves:
    """Measure the curves of the picture."""
    large = large_step(opamp, witness) if math.isfinite(opamp.input_range) else None
    return Curves(bode(opamp, witness), step_response(opamp, witness), large)


def plot_opamp(opamp: OpAmp, curves: dict[str, Curves], path: str | Path | None = None) -> Figure:
    """Draw the Bode diagram and the steps; `curves` by the name of the witness, ours first.

    Raises
    ------
    InputError
        See `taction.verification.report.picture.figure_file`.
    """
    with figure_file(path, 11.5, 6.6, f"{opamp.name}: open loop and follower") as figure:
        halves: Any = figure.subfigures(1, 2, width_ratios=(1.25, 1))
        left, right = halves
        gain, phase = left.subplots(2, 1, sharex=True)
        _bode(gain, phase, curves)
        if next(iter(curves.values())).large is None:
            _small(right.subplots(), curves)
        else:
            small, large = right.subplots(2, 1)
            _small(small, curves)
            _large(large, opamp, curves)
    return figure


def _styles(curves: dict[str, Curves]) -> list[tuple[str, Curves, dict[str, Any]]]:
    pairs = zip(curves.items(), (OURS, THEIRS), strict=False)
    return [(name, found, style) for (name, found), style in pairs]


def _draw(
    axes: Axes,
    x: Floats,
    y: Floats,
    name: str,
    style: dict[str, Any],
    *,
    even: Floats | None = None,
) -> None:
    """Draw a curve; of the second witness only its values at the places `even` along x."""
    if style is THEIRS:
        places = x[:: max(len(x) // MARKS, 1)] if even is None else even
        x, y = places, np.interp(places, x, y)
    axes.plot(x, y, label=name, **style)


def _draw_step(
    axes: Axes, found: tuple[Floats, Floats], name: str, style: dict[str, Any], shown: float
) -> None:
    """Draw the first part of a step, the share `shown` of the record.

    The first point is left out: the ideal step passes the input's capacitance in no time.
    """
    time, volts = (values[1:] for values in found)
    stop = shown * float(time[-1])
    size, unit = time_unit(stop)
    live = (time <= stop) & (time > SKIPPED * stop)
    even = np.linspace(0.0, stop, MARKS + 1)[1:] / size
    _draw(axes, time[live] / size, volts[live], name, style, even=even)
    axes.set_xlabel(f"time ({unit})")


def _bode(gain: Axes, phase: Axes, curves: dict[str, Curves]) -> None:
    for name, found, style in _styles(curves):
        f, response = found.bode.frequency, found.bode.response
        _draw(gain, f, 20.0 * np.log10(np.abs(response)), name, style)
        _draw(phase, f, np.degrees(np.unwrap(np.angle(response))), name, style)
    first = next(iter(curves.values())).bode
    gain.set_xscale("log")
    gain.set_ylabel("gain (dB)")
    phase.set_ylabel("phase (degrees)")
    phase.set_xlabel("frequency (Hz)")
    phase.set_yticks(np.arange(-180, 1, 45))
    phase.set_ylim(-190, 10)
    gain.tick_params(labelbottom=False)
    gain.set_title("Bode diagram of the open loop")
    gain.legend(loc="upper right", frameon=False)
    if abs(first.response[-1]) >= 1.0:
        return
    crossing, margin = first.crossing()
    for axes, level in ((gain, 0.0), (phase, margin - 180.0)):
        axes.axvline(crossing, color=GREY, lw=0.9, ls="--", zorder=1)
        axes.plot(crossing, level, "s", color=GREY, ms=5, zorder=4)
    note: dict[str, Any] = {"textcoords": "offset points", "color": "#333333", "fontsize": "small"}
    text = f"unity gain at {show(crossing, 'Hz', 3)}"
    gain.annotate(text, (crossing, 0.0), (-8, -14), ha="right", **note)
    text = f"phase margin {margin:.3g} degrees"
    phase.annotate(text, (crossing, margin - 180.0), (-8, -14), ha="right", **note)


def _small(axes: Axes, curves: dict[str, Curves]) -> None:
    for name, found, style in _styles(curves):
        _draw_step(axes, found.small, name, style, SHOWN_SMALL)
    response = next(iter(curves.values())).small[1][1:]
    axes.axhline(1.0, color=GREY, lw=0.9, ls="--", zorder=1)
    over = float(response.max()) - 1.0
    axes.set_title(f"small step of a follower: {100.0 * max(over, 0.0):.2g} % overshoot")
    axes.set_ylabel("output over step")
    axes.set_ylim(bottom=min(0.0, float(response.min())) - 0.05)


def _large(axes: Axes, opamp: OpAmp, curves: dict[str, Curves]) -> None:
    for name, found, style in _styles(curves):
        if found.large is not None:
            _draw_step(axes, found.large, name, style, SHOWN_LARGE)
    swing = opamp.swing(supply_of(opamp))
    axes.axhline(STEP * swing, color=GREY, lw=0.9, ls="--", zorder=1)
    axes.set_title(f"large step: {readable(show(opamp.slew_rate, 'V/s', 3))} at most")
    axes.set_ylabel("output (V)")
