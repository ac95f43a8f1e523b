"""What the page of the explorer receives: numbers and texts, ready to be drawn."""

from __future__ import annotations

import math
from dataclasses import asdict

from taction.netlist_gen.scene.open_tables import OPAMPS
from taction.verification.design.board_view import PoleView, RestView, StableValues
from taction.verification.design.explorer_judgement import Judgement
from taction.verification.design.explorer_settings import STEPS, Control, Settings, Start
from taction.verification.report.explorer.charts import (
    Part,
    chart_part,
    poles_chart,
    stress_chart,
)
from taction.verification.report.texts import figure, quantity, readable, spaced
from taction.verification.report.views.verdict import check_bar
from taction.verification.verdict.checks import Check

VALUE_DIGITS = 6


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
    stated = view.board.circuit.facts
    facts = {
        "R": stated["R"].text,
        "λ": stated["lambda"].text,
        "G0": stated["G0"].text,
        "C on the board": stated["C"].text,
    }
    return {"stress": chart_part(stress_chart(view)), "facts": facts}


def poles_part(view: PoleView) -> Part:
    """Return the poles in the upper half plane, and what they say."""
    doubts = [readable(doubt) for doubt in view.doubts]
    return {"doubts": doubts, "poles": chart_part(poles_chart(view))}


def boundary_part(boundary: StableValues, control: Control) -> Part:
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


def _range(low: float, high: float, boundary: StableValues) -> str:
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
    bar = check_bar(check)
    return {**asdict(bar), "width": bar.width, "used": bar.used}


def _sentence(found: Judgement) -> str:
    """Return what decides the outcome in a sentence."""
    decisive = [check for check in found.checks if check.outcome.value == found.outcome]
    if found.outcome == "pass":
        return f"all {len(found.checks)} checks pass"
    if len(decisive) == 1:
        bar = check_bar(decisive[0])
        known = f"{bar.value}, {bar.limit}; " if bar.share is not None else ""
        return f"{bar.name}: {known}{bar.reason}"
    verb = "fail" if found.outcome == "fail" else "are not decided"
    names = ", ".join(spaced(check.name) for check in decisive)
    return f"{len(decisive)} of {len(found.checks)} checks {verb}: {names}"
