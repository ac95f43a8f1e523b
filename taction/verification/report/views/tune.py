"""A tuning: before and after, the trade-off, and the verification of the design."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from taction.netlist_gen.scene.keys import find_key
from taction.system.charts import Axis, Chart, Curve, Limit, Mark, Text
from taction.system.quantities import written
from taction.verification.design.trials import Trial
from taction.verification.design.tune import Tuned, Tuning
from taction.verification.report.blocks import (
    BOTH,
    DRAWN,
    Block,
    Cell,
    Code,
    Facts,
    Notes,
    Page,
    Section,
    Table,
)
from taction.verification.report.texts import banded, figure, number_cell, percent, quantity
from taction.verification.report.views.verdict import view as verdict_report
from taction.verification.report.views.verdict_screen import on_screen
from taction.verification.stability.margin import first_knob
from taction.verification.verdict.verify import Verdict

LINE = 0.08  # of the height of the picture: two texts at the same place lie over each other
LEAST_REACH, EDGE = 1e-3, 0.12  # of the step, and of the width: around the points of the picture


def view(result: Tuned) -> Page:
    """Return the page of a tuning."""
    tuning, verdict = result.tuning, result.verdict
    verified = verdict_report(verdict, "taction design tune")
    before, after = tuning.before.settling_time, tuning.after.settling_time
    lead = banded("settles", verdict.measurements.band).capitalize()
    summary = f"{lead} in {figure(after, 's')}, before: {figure(before, 's')}. {verified.summary}"
    own = (
        Section("Tuning", tuple(_blocks(tuning, verdict)), media=BOTH),
        Section("Trade-off", lambda: (_tradeoff(tuning),), media=DRAWN),
    )
    return replace(
        verified,
        summary=summary,
        sections=(*own, *on_screen(verified, verdict)),
        foot=(*verified.foot, "more: --report FILE"),
    )


def _blocks(tuning: Tuning, verdict: Verdict) -> Iterator[Block]:
    units, circuit = _units(tuning), verdict.circuit
    rows = tuple(
        (
            Cell(name),
            *(number_cell(value, units[path], 5) for path, value in trial.values.items()),
            number_cell(trial.settling_time, "s"),
            number_cell(trial.overshoot, "step", 3)
            if math.isfinite(trial.overshoot)
            else Cell("–"),
        )
        for name, trial in (("before", tuning.before), ("after", tuning.after))
    )
    settling = banded("settling_time", tuning.scene.checks.settling_time.band)
    titles = ("design", *map(_key_name, units), settling, "overshoot")
    yield Table("Before and after", titles, rows)
    facts = (
        ("designs tried", str(tuning.tried)),
        ("designs on the trade-off curve", str(len(tuning.frontier))),
        ("limit of the overshoot", percent(tuning.overshoot_limit, 4)),
        (f"margin of {first_knob(circuit)}", f"{tuning.margin:g}"),
        ("lambda, unchanged", circuit.facts["lambda"].text),
    )
    yield Facts("", facts)
    lines = [
        f"{path.removeprefix('design.')} = {written(value, units[path])}"
        for path, value in tuning.after.values.items()
    ]
    if "R" in circuit.facts:
        lines.append(f"resistance = {written(circuit.value('R'), 'ohm')}")
    yield Code("the values for the table [design]", "\n".join(lines))
    edges = tuple(
        f"{name} is at the edge of its range, {quantity(edge, units[path])}: a wider range may hold"
        f" a better design, such as --over {name}=LOW:HIGH or a larger --reach"
        for path, edge in tuning.at_edges.items()
        if (name := path.removeprefix("design."))
    )
    yield Notes("", edges)


def _units(tuning: Tuning) -> dict[str, str]:
    return {path: find_key(tuning.scene, path).unit for path in tuning.after.values}


def _key_name(path: str) -> str:
    return path.removeprefix("design.").replace("_", " ")


def _tradeoff(tuning: Tuning) -> Chart:
    """Return the frontier, the limit, and the designs before and after with their values.

    The neighbours of the chosen design on the frontier have their values, too.
    """
    units = _units(tuning)

    def text(candidate: Trial) -> str:
        return ", ".join(
            f"{_key_name(path)} {quantity(value, units[path])}"
            for path, value in candidate.values.items()
        )

    frontier = sorted(tuning.frontier, key=lambda each: each.overshoot)
    near = _neighbours(frontier, tuning)
    curve = Curve(
        *_places(*frontier),
        "no design tried is better than these",
        "true",
        mark="circle",
        hover=tuple(map(text, frontier)),
        written=tuple(text(each) if each in near else "" for each in frontier),
    )
    limit = f"overshoot limit, {figure(tuning.overshoot_limit, 'step', 3)}"
    marks: list[Mark] = [curve]
    ends = _ends([*frontier, tuning.before, tuning.after], tuning.overshoot_limit)
    if ends is None or ends[0] <= tuning.overshoot_limit <= ends[1]:
        marks.append(Limit(tuning.overshoot_limit, "x", limit, "ink", "dot"))
    else:
        marks.append(Text(f"{limit} →", None, None, ("left", "below")))
    for name, candidate, mark, outcome in (
        ("before", tuning.before, "square-open", "fail"),
        ("after", tuning.after, "star", "pass"),
    ):
        if math.isfinite(candidate.settling_time + candidate.overshoot):
            title = f"{name}: {quantity(candidate.settling_time, 's')}"
            texts = (text(candidate),)
            moved = name == "after" or candidate.values != tuning.after.values
            marks.append(
                Curve(
                    *_places(candidate), title, outcome, "", mark, size=13.0, hover=texts,
                    written=(f"{name}: {texts[0]}" if moved else "",),
                )
            )  # fmt: skip
    return Chart(
        "Trade-off",
        Axis("overshoot", "step", limits=ends),
        Axis(banded("settling_time", tuning.scene.checks.settling_time.band), "s", "log"),
        tuple(marks),
        message=_gain(tuning),
        summary=(
            "Settling time against overshoot of the designs on the trade-off curve; dotted: the"
            " limit."
        ),
        legend="below",
    )


def _ends(shown: list[Trial], limit: float) -> tuple[float, float] | None:
    """Return the overshoots that the chart shows: those of its points, and a limit near them."""
    known = [each.overshoot for each in shown if math.isfinite(each.settling_time + each.overshoot)]
    if not known:
        return None
    low, high = min(known), max(known)
    reach = max(high - low, 0.1 * high, LEAST_REACH)
    if low <= limit <= high + reach:
        high = max(high, limit)
    return max(0.0, low - EDGE * reach), high + 2.0 * EDGE * reach  # texts stand on the right


def _places(*candidates: Trial) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.array([(each.overshoot, each.settling_time) for each in candidates]).reshape(-1, 2).T
    return x, y


def _neighbours(frontier: list[Trial], tuning: Tuning) -> list[Trial]:
    """Return the designs of the frontier beside the chosen one whose text has room on the chart."""
    if tuning.after not in frontier:
        return []
    place = frontier.index(tuning.after)
    beside = [frontier[k] for k in (place - 1, place + 1) if 0 <= k < len(frontier)]
    times = [math.log(each.settling_time) for each in frontier]
    room = LINE * (max(times) - min(times))

    def apart(one: Trial, other: Trial) -> bool:
        known = math.isfinite(other.settling_time)
        return not known or abs(math.log(one.settling_time / other.settling_time)) > room

    return [one for one in beside if all(apart(one, p) for p in (tuning.before, tuning.after))]


def _gain(tuning: Tuning) -> str:
    """Return how much faster the design settles."""
    before, after = tuning.before.settling_time, tuning.after.settling_time
    if not (math.isfinite(before) and after > 0.0):
        return f"it settles in {figure(after, 's')}"
    if f"{before / after:.3g}" == "1":
        return "no design that was tried settles faster"
    return f"it settles {before / after:.3g} times as fast"
