"""The report of a choice: best designs, a map for each op-amp, all designs, the best in full."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

from taction.netlist_gen.scene.scene import Scene
from taction.verification.design.choose_ranking import Confirmation, Design
from taction.verification.design.choose_request import CAPACITANCE, GAIN
from taction.verification.report.choose.tables import first_of_each, number, proposed, text_of
from taction.verification.report.html.blocks import (
    Block,
    Cell,
    Notes,
    Picture,
    Report,
    Section,
    Table,
)
from taction.verification.report.html.pictures import log_axis, numbers
from taction.verification.report.html.texts import (
    counted,
    figure,
    number_cell,
    outcome_cell,
    quantity,
    readable,
)
from taction.verification.report.html.verdict_report import verdict_report
from taction.verification.verdict.record import finite
from taction.verification.verdict.verify import Verdict

LISTED = 500  # designs in the table
MAPS = 9  # op-amps with a map, the best first
LOW, HIGH = 0.1, 10.0  # ends of the colours: shares of a limit
TICKS = (0.1, 0.3, 1.0, 3.0, 10.0)
WORST = "Worst: the largest value over its limit; below 1 every check passes."


def choice_report(
    scene: Scene,
    designs: Sequence[Design],
    best: Sequence[Design],
    confirmations: Sequence[Confirmation],
    verdict: Verdict | None,
) -> Report:
    """Return the report of a choice.

    Parameters
    ----------
    scene : Scene
        The scene that was asked about.
    designs, best, confirmations : sequences
        All designs in their order; those that ngspice ran; and what it says of these.
    verdict : Verdict or None
        Of the design that is proposed; None where none passes.
    """
    passing = sum(design.good for design in designs)
    summary = f"{passing} of {counted(len(designs), 'design')} pass with parts that can be bought."
    own = (
        Section("Best designs", tuple(_best(best, confirmations)), WORST),
        Section("Op-amps", (_opamps(designs),)),
        Section("Maps", tuple(_maps(designs, best))),
        Section("All designs", (_table(designs),)),
    )
    if verdict is None:
        lines = ("No design passes; the table of op-amps has the nearest of each with its reason.",)
        return Report(scene.name, "taction choose", "fail", summary, lines, own[1:])
    full = verdict_report(verdict, "taction choose")
    first = _words(best[proposed(confirmations)])
    return Report(
        title=scene.name,
        command=full.command,
        outcome=full.outcome,
        summary=f"{first}. {full.summary} {summary}",
        lines=(f"In full below: {verdict.scene.name}, {verdict.waveforms.simulator}.", *full.lines),
        sections=(*own, *full.sections),
    )


def _words(design: Design) -> str:
    farads, ohms = (number(design.values[path]) for path in (CAPACITANCE, GAIN))
    return f"{design.opamp}, C = {quantity(farads, 'F')}, gain = {quantity(ohms, 'ohm')}"


def _best(best: Sequence[Design], confirmations: Sequence[Confirmation]) -> Iterator[Block]:
    noise = _has_noise(best)
    rows = tuple(
        (
            *_cells(design, noise=noise),
            Cell(text_of(said), None, said.outcome.value if said.outcome else ""),
        )
        for design, said in zip(best, confirmations, strict=True)
    )
    yield Table("Best designs", (*_titles(noise=noise), "ngspice"), rows)
    reasons = tuple(
        f"{design.opamp}: {readable(said.reason)}"
        for design, said in zip(best, confirmations, strict=True)
        if said.reason
    )
    if reasons:
        yield Notes("What ngspice says", reasons)


def _opamps(designs: Sequence[Design]) -> Table:
    """Return the best design of each op-amp, and why it does not pass."""
    counts = {name: sum(d.good for d in designs if d.opamp == name) for name in _names(designs)}
    noise = _has_noise(designs)
    rows = tuple(
        (
            *_cells(each, noise=noise),
            Cell(str(counts[each.opamp]), counts[each.opamp]),
            Cell(_why(each)),
        )
        for each in first_of_each(designs)
    )
    return Table("The best design of each op-amp", (*_titles(noise=noise), "passing", "why"), rows)


def _table(designs: Sequence[Design]) -> Table:
    noise = _has_noise(designs)
    rows = tuple((*_cells(d, noise=noise), Cell(_why(d))) for d in designs[:LISTED])
    more = f"The first {LISTED} of {len(designs)}; --json has all." if rows[LISTED - 1 :] else ""
    return Table("Designs, the best first", (*_titles(noise=noise), "why"), rows, more)


def _why(design: Design) -> str:
    reason = design.reason.split("\n")[0]
    return readable(reason or (design.refused and f"cannot be bought: {design.refused}"))


def _has_noise(designs: Sequence[Design]) -> bool:
    return any(design.noise is not None for design in designs)


def _titles(*, noise: bool) -> tuple[str, ...]:
    names = ("op-amp", "C", "gain", "outcome", "settling", "overshoot", "headroom")
    return (*names, "noise", "worst") if noise else (*names, "worst")


def _cells(design: Design, *, noise: bool) -> tuple[Cell, ...]:
    farads, ohms = (number(design.values[path]) for path in (CAPACITANCE, GAIN))
    return (
        Cell(design.opamp),
        Cell(quantity(farads, "F"), farads),
        Cell(quantity(ohms, "ohm"), ohms),
        Cell("no parts", None, "fail") if design.refused else outcome_cell(design.outcome),
        number_cell(finite(design.settling_time), "s"),
        number_cell(finite(design.overshoot), "step"),
        number_cell(design.headroom, "step"),
        *([number_cell(design.noise, "V")] if noise else []),
        number_cell(design.worst if design.shares else None, "", 3),
    )


def _names(designs: Sequence[Design]) -> list[str]:
    return [design.opamp for design in first_of_each(designs)]


def _maps(designs: Sequence[Design], best: Sequence[Design]) -> Iterator[Block]:
    names = _names(designs)
    for name in names[:MAPS]:
        own = [design for design in designs if design.opamp == name]
        if any(design.shares for design in own):
            yield _map(name, own, best)
        else:
            text = f"{name} has no map: each of {counted(len(own), 'design')} is unstable,"
            yield Notes("", (f"{text} has no parts that can be bought, or has no verdict.",))
    if names[MAPS:]:
        yield Notes("", (f"The tables have {len(names) - MAPS} op-amps more.",))


def _map(name: str, own: Sequence[Design], best: Sequence[Design]) -> Picture:
    farads, ohms = (sorted({number(d.values[path]) for d in own}) for path in (CAPACITANCE, GAIN))
    at = {(number(d.values[CAPACITANCE]), number(d.values[GAIN])): d for d in own}
    levels, texts = [], []
    for y in ohms:
        row = [at.get((x, y)) for x in farads]
        levels.append(numbers([_level(design) for design in row]))
        texts.append([_hover(design) for design in row])
    heat: dict[str, Any] = {
        "type": "heatmap", "x": _edges(farads), "y": _edges(ohms), "z": levels, "customdata": texts,
        "zmin": math.log10(LOW), "zmax": math.log10(HIGH), "showlegend": False,
        "colorscale": [[0, "--map-low"], [1, "--map-high"]],
        "colorbar": {"thickness": 12, "tickvals": [math.log10(tick) for tick in TICKS],
                     "ticktext": [f"{tick:g}" for tick in TICKS]},
        "hovertemplate": "%{customdata}<extra></extra>",
    }  # fmt: skip
    chosen = {design.place for design in best}
    marks = (
        ("passes", "circle", 8, [d for d in own if d.good and d.place not in chosen]),
        ("among the best", "star", 15, [d for d in own if d.place in chosen]),
    )
    points = [
        {"type": "scatter", "mode": "markers", "name": title, "hoverinfo": "skip",
         "x": [number(d.values[CAPACITANCE]) for d in found],
         "y": [number(d.values[GAIN]) for d in found],
         "marker": {"symbol": symbol, "size": size, "color": "--paper",
                    "line": {"color": "--ink", "width": 1.2}}}
        for title, symbol, size, found in marks if found
    ]  # fmt: skip
    layout = {
        "xaxis": log_axis("C", "F", _edges(farads)), "yaxis": log_axis("gain", "ohm", _edges(ohms)),
        "showlegend": bool(points), "legend": {"orientation": "h", "y": -0.25},
    }  # fmt: skip
    passing = sum(design.good for design in own)
    summary = (
        f"{name}: {passing} of {counted(len(own), 'design')} pass. Colour: the worst value over its"
        " limit; empty: unstable, or without a verdict."
    )
    return Picture(name, {"data": [heat, *points], "layout": layout}, summary, 380)


def _edges(values: Sequence[float]) -> list[float]:
    """Return the edges of the cells of a map, n + 1 for n values: in the middle in decades.

    Plotly would put the edges in the middle of the numbers, and the first below zero.
    """
    inner = [math.sqrt(a * b) for a, b in pairwise(values)]
    first = inner[0] if inner else values[0] * math.sqrt(10.0)
    last = inner[-1] if inner else values[0] / math.sqrt(10.0)
    return [values[0] ** 2 / first, *inner, values[-1] ** 2 / last]


def _level(design: Design | None) -> float:
    """Return the worst share as a power of ten; not a number for an unstable design."""
    if design is None or not design.shares:
        return math.nan
    return math.log10(max(design.worst, LOW / 10.0))


def _hover(design: Design | None) -> str:
    if design is None:
        return ""
    share = figure(design.worst, "", 3) if design.shares else "no value"
    farads, ohms = (number(design.values[path]) for path in (CAPACITANCE, GAIN))
    place = f"C {quantity(farads, 'F')}, gain {quantity(ohms, 'ohm')}"
    outcome = "no parts" if design.refused else design.outcome
    return f"{place}: {outcome}, worst {share}"
