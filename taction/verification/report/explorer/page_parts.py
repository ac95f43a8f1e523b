"""What the page of the explorer receives: charts, numbers and texts, ready to be drawn."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from taction.netlist_gen.scene.open_tables import OPAMPS
from taction.system import charts
from taction.system.errors import EngineError
from taction.system.quantities import quantity, readable
from taction.verification.design.exploration import (
    STEPS,
    BoardView,
    Control,
    ExplorerCurves,
    Judgement,
    Settings,
)
from taction.verification.engines.statespace.transients.exact import is_exact
from taction.verification.report.blocks import Bars
from taction.verification.report.renderers.plotly import plotly_spec
from taction.verification.report.texts import figure
from taction.verification.report.views import answer_view as answers
from taction.verification.report.views import waveforms_view as waveforms
from taction.verification.report.views.stability_view import pole_map, ranges_text
from taction.verification.stability.edges import Edges
from taction.verification.verdict.checks import band_text
from taction.verification.verdict.record import ERROR

POINTS = 500  # of a curve
ALL_POINTS = 12_000  # of all curves
CELLS = 9  # of the strip below a slider: one verdict in the middle of each
STATES = {True: "stable", False: "unstable", None: "undecided"}
Part = dict[str, Any]


def chart_part(chart: charts.Chart) -> Part:
    """Return a chart as the page draws it, with its caption."""
    return {**plotly_spec(chart), "note": chart.summary}


def start_part(settings: Settings) -> Part:
    """Return what the page shows before any value moves, and what its template asks for."""
    finite = [name for name, opamp in OPAMPS.items() if math.isfinite(opamp.gbw)]
    return {"settings": settings, "steps": STEPS, "opamps": finite, "place": place_part,
            "typed": typed_value}  # fmt: skip


def place_part(control: Control, value: float) -> Part:
    """Return the text and the place of a value, and whether it is the scene's."""
    place = round(STEPS * control.place(value))
    return {"text": typed_value(value, control.unit), "place": place, "own": value == control.own}


def typed_value(value: float, unit: str, digits: int = 6) -> str:
    """Return a value as a user may type it, too: ``"12 pF"``, ``"0.003"``."""
    return quantity(value, unit, digits) if unit else f"{value:.{digits}g}"


def settings_part(settings: Settings) -> Part:
    """Return the values that the page shows, and the command line that has them."""
    values = {
        control.path: place_part(control, settings.values.get(control.path, control.own))
        for control in settings.controls
    }
    return {"values": values, "opamp": settings.opamp, "command": settings.command()}


class Spot(NamedTuple):
    """A place of a slider at which the checks are judged: its values, and how far it is away."""

    slider: int
    value: str
    settings: Settings
    key: str  # the same of the same values
    far: float


def spots(settings: Settings) -> list[Spot]:
    """Return the places of all sliders, the others of which stay."""
    found = []
    for n, control in enumerate(settings.controls):
        here = control.place(settings.values.get(control.path, control.own))
        for place in (np.arange(CELLS) + 0.5) / CELLS:
            value = control.chosen(float(place))
            moved = settings.moved({**settings.values, control.path: value}, settings.opamp)
            text = typed_value(value, control.unit, 3)
            found.append(Spot(n, text, moved, moved.command(), abs(float(place) - here)))
    return found


def along_part(every: Iterable[Spot], known: Mapping[str, tuple[str, str]]) -> Part:
    """Return the outcome and the text of each place of each slider, as far as they are known."""
    found: Part = {}
    for spot in every:
        outcome, why = known.get(spot.key, ("unknown", "not known yet"))
        found.setdefault(f"along_{spot.slider}", []).append((outcome, f"{spot.value}: {why}"))
    return found


def rest_part(view: BoardView) -> Part:
    """Return the recovered stress beside its solution and the truth, and the board's numbers."""
    unit, stated = view.board.circuit.value("U0"), view.board.circuit.facts
    targets, rest = view.answer.target / unit, view.rest / unit
    note = f"Board less answer: at most {float(np.abs(rest - targets).max(initial=0.0)):.3g}."
    if view.problem.stress is not None:
        note += f" {answers.true_error_text(view.answer)}"
    stress = waveforms.recovered_stress(view.problem, view.scene, targets, rest)
    names = {"R": "R", "λ": "lambda", "G0": "G0", "C on the board": "C"}
    facts = {name: stated[key].text for name, key in names.items() if key in stated}
    return {"stress": chart_part(replace(stress, summary=note)), "facts": facts}


def poles_part(view: BoardView) -> Part:
    """Return the poles in the upper half plane, and what they say."""
    lead, state = view.poles.rightmost, STATES[view.poles.stable]
    ringing = "no pole rings"
    if view.poles.frequency:
        whose = "its" if lead.imag else "the rightmost ringing pole's"
        ringing = (
            f"{whose} frequency is {quantity(view.poles.frequency, 'Hz')},"
            f" the damping ratio {view.poles.damping_ratio:.3g}"
        )
    note = (
        f"The board is {state}: the rightmost pole has the real part"
        f" {figure(lead.real, '1/s')}; {ringing}."
    )
    chart = replace(pole_map(view.poles.poles), summary=note, legend=False)
    return {"doubts": [*map(readable, view.doubts)], "poles": chart_part(chart)}


def boundary_part(found: Edges | EngineError, control: Control) -> Part:
    """Return the stable values of a knob as parts of its slider, and in words."""
    strip, text = list[tuple[float, float]](), f"not known: {readable(str(found))}"
    if known := not isinstance(found, EngineError):
        strip = [(control.place(low), control.place(high)) for low, high in found.stable_ranges]
        text = ranges_text(found, control.low, control.high, control.unit)
    return {
        "stable": {"strip": strip, "known": known},
        "stable_text": f"stable values of {control.symbol}: {text}",
    }


def verdict_part(found: Judgement) -> Part:
    """Return the checks of a verdict, and its numbers."""
    record, warnings = found.record, found.warnings
    text, value = answers.decisive_text(record.checks, record.outcome), record.value
    if found.answer is not None:
        text = f"{text} {answers.answer_text(found.answer)}".rstrip()
    band = next(filter(None, map(band_text, record.checks)), "")
    readings = {
        f"settling time {band}".rstrip(): quantity(value("settling_time"), "s"),
        "rise time": quantity(value("rise_time"), "s"),
        "overshoot": figure(value("overshoot") if record.stable else None, "step"),
    }
    if record.outcome == ERROR:
        text, warnings, readings = "there is no verdict on these values", (record.reason,), {}
    return {
        "outcome": record.outcome,
        "verdict_text": text,
        "checks": Bars("", tuple(map(answers.check_bar, record.checks))),
        "readings": readings,
        "warnings": [*map(readable, warnings)],
    }


def outputs_chart(curves: ExplorerCurves, view: BoardView, window: str) -> charts.Chart:
    """Return the outputs in a window, ``"rise"`` or ``"whole"``, with targets and bands."""
    end = curves.windows[window]
    shown, supply = curves.time <= end * (1.0 + 1e-9), view.board.circuit.supply
    time, outputs = curves.time[shown], curves.outputs[shown]
    with np.errstate(invalid="ignore"):
        beyond = bool((~(np.abs(outputs) <= supply)).any())
    outputs = np.nan_to_num(outputs, nan=supply, posinf=supply, neginf=-supply)
    outputs = np.clip(outputs, -supply, supply)
    targets, count = view.answer.target, outputs.shape[1]
    low = min(float(outputs.min()), float(targets.min()))
    limits = waveforms.with_room(low, max(float(outputs.max()), float(targets.max())))
    marks, few = list[charts.Mark](), count <= waveforms.LABELLED
    if few:
        step = float(np.abs(targets - outputs[0]).max(initial=0.0))
        band = view.scene.checks.settling_time.band * step
        pairs = zip(targets.tolist(), charts.spread_colours(count), strict=True)
        marks += (charts.Band(y - band, y + band, "y", "", look) for y, look in pairs)
    points = min(POINTS * count, ALL_POINTS)
    looks: Any = {"width": 1.8, "points": points}
    marks += waveforms.output_marks(time, outputs, targets.tolist(), limits, **looks)
    note = f"Dotted: targets{'; shaded: the settling band' * few}.{waveforms.looks_text(count)}"
    if beyond:
        note += f" The chart ends at the supply of {quantity(supply, 'V')}: beyond it the linear"
        note += " board is not the board."
    axes = charts.Axis("time", "s", limits=(0.0, end)), charts.Axis("", "V", limits=limits)
    return charts.Chart("Outputs", *axes, tuple(marks), summary=note.strip(), legend=False)


@dataclass(slots=True, eq=False)
class SliderLook:
    """Everything that is known so far of one set of values; what finds more returns its part."""

    settings: Settings
    view: BoardView
    limits: tuple[str, ...] = ()  # what the op-amps cannot do
    verdict: Judgement | None = None

    def find_poles(self, window: str) -> Part:
        """Find the poles and, of a small linear board, the curves."""
        return poles_part(self.view) | self.outputs_part(window)

    def find_limits(self) -> Part:
        """Find what the op-amps cannot do."""
        self.limits = self.view.limits()
        return {"limits": [*map(readable, self.limits)]}

    @property
    def is_exact(self) -> bool:
        """Whether the closed form of a linear board has the curves."""
        return is_exact(self.view.board) and not self.limits

    def outputs_part(self, window: str) -> Part:
        """Return the outputs as far as they are known: of the verdict, where none are exact."""
        curves = None if self.verdict is None else self.verdict.curves
        if is_exact(self.view.board) and (self.is_exact or curves is None):
            curves = self.view.curves(window)
        if curves is None:
            return {}
        return {"outputs": chart_part(outputs_chart(curves, self.view, window))}


def look_at(settings: Settings, window: str) -> tuple[SliderLook, Part]:
    """Return what is fast: the board at rest and, of a small one, poles and curves."""
    look = SliderLook(settings, BoardView(settings.scene()))
    # The poles of a large board take longer than a movement of the hand.
    large = look.view.board.descriptor.is_large
    return look, rest_part(look.view) | ({} if large else look.find_poles(window))
