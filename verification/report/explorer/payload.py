"""What the page of the explorer receives: numbers and texts, ready to be drawn."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import numpy as np

from taction.netlist_gen.scene.open_tables import OPAMPS
from taction.system.array_types import Floats
from taction.verification.design.board_view import (
    Boundary,
    PoleView,
    RestView,
    true_outputs,
)
from taction.verification.design.explorer_controls import STEPS, Control
from taction.verification.design.explorer_curves import Curves
from taction.verification.design.explorer_judgement import Judgement
from taction.verification.design.explorer_settings import Settings, Start
from taction.verification.report.html.pictures import channel_colours, numbers, packed, thinned
from taction.verification.report.html.sections.checks import check_bar
from taction.verification.report.html.texts import figure, quantity, readable
from taction.verification.report.tables import spaced
from taction.verification.stability.poles import Poles
from taction.verification.verdict.checks import Check

POINTS = 500  # of a curve
KEPT = 500  # of a record that another process makes, before it is thinned to `POINTS`
ROOM = 0.06  # of the height of the picture, above and below the curves
POLES = 400  # rightmost poles that are drawn
VALUE_DIGITS = 6
STEPS_OF_TEN = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0)  # ends of the picture of the poles
Part = dict[str, Any]


def start_part(start: Start) -> Part:
    """Return what the page shows before any value moves."""
    scene = start.scene
    finite = [name for name, opamp in OPAMPS.items() if math.isfinite(opamp.gbw)]
    return {
        "name": scene.name,
        "file": str(scene.file),
        "steps": STEPS,
        "controls": [_control(control) for control in start.controls],
        "opamps": finite,
        "own_opamp": scene.design.opamp.file or scene.design.opamp.base,
        "saved": f"{scene.file.stem}-explored.toml",
    }


def _control(control: Control) -> Part:
    return {
        "path": control.path,
        "symbol": control.symbol,
        "name": control.name,
        "low": "0" if control.has_zero else value_text(control.low, control.unit, 3),
        "high": value_text(control.high, control.unit, 3),
        **place_part(control, control.own),
    }


def place_part(control: Control, value: float) -> Part:
    """Return the text and the place of a value, and whether it is the scene's."""
    return {
        "text": value_text(value, control.unit),
        "place": round(STEPS * control.place(value)),
        "own": value == control.own,
    }


def value_text(value: float, unit: str, digits: int = VALUE_DIGITS) -> str:
    """Return a value as a user may type it, too: ``"12 pF"``, ``"0.003"``."""
    return quantity(value, unit, digits) if unit else f"{value:.{digits}g}"


def settings_part(start: Start, settings: Settings) -> Part:
    """Return the values that the page shows, and the command line that has them."""
    values = {
        control.path: place_part(control, settings.values.get(control.path, control.own))
        for control in start.controls
    }
    return {"values": values, "opamp": settings.opamp, "command": settings.command(start)}


def rest_part(view: RestView) -> Part:
    """Return the recovered stress, and the numbers of the board."""
    stated, problem = view.board.circuit.facts, view.problem
    places = problem.positions
    truth = true_outputs(view)
    facts = {
        "R": stated["R"].text,
        "λ": stated["lambda"].text,
        "G0": stated["G0"].text,
        "C on the board": stated["C"].text,
    }
    return {
        "stress": {
            "x": numbers(np.arange(1, len(view.rest) + 1) if places is None else places),
            "along": "channel" if places is None else "place y",
            "board": numbers(view.rest),
            "target": numbers(view.targets),
            "truth": None if truth is None else numbers(truth),
            "off": _largest(view.rest - view.targets),
            "error": None if truth is None else _relative(view.targets, truth),
        },
        "facts": facts,
        "has_curves": view.has_curves,
    }


def _largest(differences: Floats) -> str:
    return quantity(float(np.abs(differences).max(initial=0.0)), "V", 3)


def _relative(found: Floats, truth: Floats) -> str | None:
    size = float(np.linalg.norm(truth))
    return f"{100.0 * float(np.linalg.norm(found - truth)) / size:.3g} %" if size else None


def poles_part(view: PoleView) -> Part:
    """Return the poles in the upper half plane, and what they say."""
    poles = view.poles
    upper = poles.poles[poles.poles.imag >= 0.0][:POLES]
    lead = poles.rightmost
    text = figure(lead.real, "1/s")
    if lead.imag:
        text += f" at {quantity(abs(lead.imag) / math.tau, 'Hz')}"
    return {
        "state": view.state,
        "doubts": [readable(doubt) for doubt in view.doubts],
        "poles": {
            "x": numbers(upper.real),
            "y": numbers(upper.imag / math.tau),
            "view": _pole_window(poles),
            "lead": text,
            "damping": f"{poles.damping_ratio:.3g}" if poles.frequency else "does not ring",
        },
    }


def _pole_window(poles: Poles) -> list[float]:
    """Return left, right and top of the picture: the slow and ringing poles, in round numbers."""
    values = poles.poles
    ringing = values[(values.imag > 0.0) & (-values.real < 0.5 * np.abs(values))]
    shown = ringing if len(ringing) else values
    left = float(min(shown.real.min(initial=0.0), -1e-3 * np.abs(shown).max(initial=1.0)))
    right = max(float(values.real.max(initial=0.0)), 0.0)
    top = float(shown.imag.max(initial=0.0)) / math.tau
    return [-_rounded(-1.1 * left), _rounded(max(1.2 * right, -0.25 * left)), _rounded(1.15 * top)]


def _rounded(value: float) -> float:
    """Return the next of 1, 1.5, 2, 3, 5, 7 times a power of ten, so that a picture rarely jumps.

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


def curves_part(curves: Curves, view: RestView, window: str) -> Part:
    """Return the outputs of all channels in a window, at most about `POINTS` points each."""
    end = curves.rise if window == "rise" else curves.stop
    shown = curves.time <= end * (1.0 + 1e-9)
    time, outputs = curves.time[shown], curves.outputs[shown]
    limit = view.board.circuit.supply
    with np.errstate(invalid="ignore"):
        beyond = bool((~(np.abs(outputs) <= limit)).any())
    outputs = np.clip(np.nan_to_num(outputs, nan=limit, posinf=limit, neginf=-limit), -limit, limit)
    low = min(float(outputs.min()), float(view.targets.min()))
    high = max(float(outputs.max()), float(view.targets.max()))
    room = ROOM * ((high - low) or max(abs(high), 1e-12))
    step = float(np.abs(view.targets - outputs[0]).max(initial=0.0))
    lines = []
    for column in outputs.T:
        x, y = thinned(time, column, POINTS)
        lines.append({"x": packed(x)["bdata"], "y": packed(y)["bdata"]})
    return {
        "lines": lines,
        "colours": channel_colours(len(lines)),
        "targets": numbers(view.targets),
        "band": view.scene.checks.settling_time.band * step,
        "end": end,
        "low": low - room,
        "high": high + room,
        "clipped": quantity(limit, "V") if beyond else "",
    }


def boundary_part(boundary: Boundary, control: Control) -> Part:
    """Return the stable values of C as parts of the slider, and in words."""
    if boundary.unknown:
        text = f"not known: {readable(boundary.unknown)}"
        return {"boundary": {"parts": [], "text": text, "unknown": True}}
    parts = [[control.place(low), control.place(high)] for low, high in boundary.stable]
    texts = [_range(low, high, boundary) for low, high in boundary.stable]
    text = "; ".join(texts) or "no value on this slider"
    if boundary.near:
        near = ", ".join(quantity(value, "F") for value in boundary.near)
        text += f"; rounding decides near {near}"
    return {"boundary": {"parts": parts, "text": text, "unknown": False}}


def _range(low: float, high: float, boundary: Boundary) -> str:
    if low <= boundary.low and high >= boundary.high:
        return "every value on this slider"
    if high >= boundary.high:
        return f"above {quantity(low, 'F')}"
    if low <= boundary.low:
        return f"below {quantity(high, 'F')}"
    return f"{quantity(low, 'F')} to {quantity(high, 'F')}"


def verdict_part(found: Judgement) -> Part:
    """Return the checks of a verdict, and its numbers."""
    if found.outcome == "error":
        text = "there is no verdict on these values"
        return {"verdict": {"outcome": "error", "text": text, "error": readable(found.error)}}
    return {
        "verdict": {
            "outcome": found.outcome,
            "text": _sentence(found),
            "checks": [_bar(check) for check in found.checks],
            "figures": _figures(found),
            "warnings": [readable(text) for text in found.warnings],
            "engine": found.engine,
            "seconds": quantity(found.seconds, "s", 2),
        }
    }


def simulation_part(found: Judgement) -> Part:
    """Return what ngspice says, beside the state-space engine."""
    if found.outcome == "error":
        return {"simulation": {"outcome": "error", "error": readable(found.error)}}
    undecided = [check for check in found.checks if check.outcome.value != "pass"]
    return {
        "simulation": {
            "outcome": found.outcome,
            "engine": found.engine,
            "figures": _figures(found),
            "seconds": quantity(found.seconds, "s", 2),
            "difference": None if found.difference is None else figure(found.difference, "step", 3),
            "reasons": [readable(f"{check.name}: {check.reason}") for check in undecided],
        }
    }


def _figures(found: Judgement) -> dict[str, str]:
    return {
        "settling time": quantity(found.settling, "s"),
        "rise time": quantity(found.rise, "s"),
        "overshoot": figure(found.overshoot, "step"),
    }


def _bar(check: Check) -> Part:
    bar = check_bar(_record(check))
    return {**asdict(bar), "width": bar.width, "used": bar.used}


def _sentence(found: Judgement) -> str:
    """Return what decides the outcome in a sentence."""
    decisive = [check for check in found.checks if check.outcome.value == found.outcome]
    if found.outcome == "pass":
        return f"all {len(found.checks)} checks pass"
    if len(decisive) == 1:
        bar = check_bar(_record(decisive[0]))
        known = f"{bar.value}, {bar.limit}; " if bar.share is not None else ""
        return f"{bar.name}: {known}{bar.reason}"
    verb = "fail" if found.outcome == "fail" else "are not decided"
    names = ", ".join(spaced(check.name) for check in decisive)
    return f"{len(decisive)} of {len(found.checks)} checks {verb}: {names}"


def _record(check: Check) -> Part:
    return {**asdict(check), "outcome": check.outcome.value}
