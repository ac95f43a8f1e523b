"""A choice of op-amp, C and gain: the best designs, a map for each op-amp, the best in full."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from taction.netlist_gen.scene.scene import Scene
from taction.system.charts import Axis, Chart, Curve, Grid, Mark, segments, zero_lines
from taction.system.foreign_files import shortened
from taction.system.quantities import counted, percent, quantity, readable, spaced
from taction.verification.design.choose import (
    CAPACITANCE,
    FEEDBACK,
    G0,
    GAIN,
    NAMES,
    U0,
    BestDesign,
    Choice,
    ChosenDesign,
)
from taction.verification.report import texts
from taction.verification.report.blocks import Content, Notes, Page, Section, Table
from taction.verification.report.texts import Cell, Column, fields, figure, number_cell
from taction.verification.verdict.checks import Outcome, band_text
from taction.verification.verdict.record import ERROR, finite

if TYPE_CHECKING:
    from taction.verification.verdict.verify import Verdict


LONGEST = 60  # characters of a reason in a table
SHOWN = 12  # op-amps in a terminal
LISTED = 500  # designs in the table
MAPS, ACROSS = 9, 3  # op-amps with a map, the best first; maps side by side in a picture
KNOWN = 1e-3, 1e3  # shares of a limit on a map
ENDS = -1.0, 1.0  # of the colours: decades of a limit
MAP = (
    "Blue: within every limit; orange: beyond one; the line is where the worst value reaches its"
    " limit; empty: unstable, or without a verdict. Circle: passes, with parts that can be bought;"
    " star: among the best."
)
WORST = (
    "Worst: the largest value over its limit; below 1 every check passes; -: a check that does not"
    " pass has no value."
)
COMMAND = "taction design choose"
UNITS = {CAPACITANCE: "F", GAIN: "ohm", G0: "S", U0: "V", FEEDBACK: "S"}


def full_view(choice: Choice) -> Page:
    """Return the page with the proposed design in full, verified anew without ngspice."""
    if not choice.best:
        return view(choice)
    from taction.verification.verdict.verify import verify

    one = proposed(choice.best)
    return view(choice, one.verdict or verify(one.scene.with_engine("statespace")))


def view(choice: Choice, verdict: Verdict | None = None) -> Page:
    """Return the page of a choice; with a verdict, of the proposed design, this is in full."""
    scene, designs, best = choice.scene, choice.designs, choice.best
    passing = sum(design.good for design in designs)
    summary = f"{passing} of {len(designs)} designs pass with parts that can be bought."
    own = (
        Section("Best designs", tuple(_best(best)), WORST, "terminal page"),
        Section("Op-amps", _opamps(designs), media="terminal page"),
        Section("Maps", lambda: _maps(designs, best), MAP, "page picture", ACROSS),
        Section("All designs", lambda: _table(designs)),
    )
    lines = tuple(_moved(scene, designs))
    if not best:
        none = "No design passes; the table of op-amps has the nearest of each with its reason."
        lines = (none, *lines)
    page = Page(
        title=scene.name,
        command=COMMAND,
        outcome="pass" if best else "fail",
        summary=summary,
        lines=lines,
        sections=own,
    )
    if verdict is None:
        return page
    from taction.verification.report.views.verdict_view import view as verdict_report

    full = verdict_report(verdict, COMMAND)
    return replace(
        page,
        outcome=full.outcome,
        summary=f"{_words(proposed(best).design)}. {full.summary} {summary}",
        lines=(f"In full below: {verdict.scene.name}, {verdict.waveforms.simulator}.", *full.lines),
        sections=(*own, *full.sections),
    )


def _moved(scene: Scene, designs: Sequence[ChosenDesign]) -> Iterator[str]:
    """Yield which op-amps have another G0 than the scene, and why."""
    own = scene.design.unit_conductance
    moved = {
        one.opamp: float(one.values[G0])
        for one in designs
        if G0 not in one.keys and one.values.get(G0, own) != own
    }
    if moved:
        values = ", ".join(f"{name} {quantity(G0, 'S')}" for name, G0 in moved.items())
        yield (
            f"G0 is moved from {quantity(own, 'S')}, with U0, s and C, for op-amps whose input"
            f" errors miss the limit of the steady state with the scene's resistors: {values}."
        )


def proposed(best: Sequence[BestDesign]) -> BestDesign:
    """Return the first design that ngspice confirms; the first if it confirms none."""
    return next((one for one in best if one.outcome is Outcome.PASS), best[0])


def _values(design: ChosenDesign) -> tuple[float, float]:
    """Return the values of the two keys that its topology searches."""
    first, second = (float(design.values[path]) for path in design.keys)
    return first, second


def _words(design: ChosenDesign) -> str:
    values = zip(design.keys, _values(design), strict=True)
    return ", ".join((design.opamp, *(f"{NAMES[path]} = {_text(path, v)}" for path, v in values)))


def _text(path: str, value: float) -> str:
    return quantity(value, UNITS[path])


def _best(best: Sequence[BestDesign]) -> Iterator[Content]:
    said = {one.design.place: one for one in best}

    def ngspice(design: ChosenDesign) -> Cell:
        outcome = said[design.place].outcome
        return Cell("not run") if outcome is None else Cell(outcome.value, None, outcome.value)

    def built(design: ChosenDesign) -> Cell:
        verdict = said[design.place].verdict
        boards = None if verdict is None else verdict.answer.built
        if boards is None or not boards.known:
            return Cell("-" if boards is None else "not known")
        if texts.rounded_up(boards.most, 2) < 1.0:
            return Cell(f"at most {percent(boards.most)} pass", boards.most)
        return Cell(f"{percent(boards.least)} or more rest within the limits", boards.most)

    designs = [one.design for one in best]
    columns = {**_columns(designs), "built boards": built, "ngspice": ngspice}
    answers = (one.verdict.answer.built for one in best if one.verdict is not None)
    covers = next((each.covers for each in answers if each is not None), "")
    note = f"Built boards vary in what stands here: {covers}." if covers else ""
    yield Table.of("Best designs", designs, columns, note)
    reasons = (f"{one.design.opamp}: {readable(one.reason)}" for one in best if one.reason)
    yield Notes("What ngspice says", tuple(reasons))


def _opamps(designs: Sequence[ChosenDesign]) -> Table:
    """Return the best design of each op-amp, and why it does not pass; `_table` has its G0, U0."""
    passing = Counter(design.opamp for design in designs if design.good)
    more = {"passing": lambda each: passing[each.opamp], "outcome": _outcome}
    left_out = NAMES[G0], NAMES[U0]
    columns = {k: v for k, v in (_columns(designs) | more).items() if k not in left_out}
    title, most = "The best design of each op-amp", {"terminal": SHOWN}
    return Table.of(title, _first_of_each(designs), columns, "", most, "{} more: --json.")


def _table(designs: Sequence[ChosenDesign]) -> Table:
    columns = {**_columns(designs), "outcome": _outcome}
    more = f"The first {LISTED} of {len(designs)}; --json has all."
    return Table.of("Designs, the best first", designs, columns, "", {"page": LISTED}, more)


def _outcome(design: ChosenDesign) -> Cell:
    """Return the outcome with the check that decides it, or what cannot be bought."""
    if design.refused:
        return Cell(f"no parts: {readable(design.refused)}", None, "fail")
    line = design.reason.split("\n")[0]
    if design.outcome == ERROR:  # file, key and value, then what is wrong with it
        line = line.rpartition(": ")[2]
    check = shortened(spaced(line.partition(" (limit")[0].partition("; ")[0]), LONGEST)
    return texts.outcome_cell(": ".join(filter(None, (design.outcome, check))), design.outcome)


def _columns(designs: Sequence[ChosenDesign]) -> dict[str, Column]:
    bands = (band_text(check) for each in designs for check in each.record.checks)
    settling = f"settling {next(filter(None, bands), '')}".rstrip()
    columns: dict[str, Column] = {
        "op-amp": "opamp",
        **dict(_moved_columns(designs)),
        settling: lambda each: number_cell(finite(each.settling_time), "s", 3),
        "overshoot": lambda each: number_cell(finite(each.overshoot), "step", 3),
        **fields("op-amp load = headroom step 3; output noise = noise V 3"),
        **fields("worst = worst_share ratio 3"),
    }
    if all(design.noise is None for design in designs):
        del columns["output noise"]
    return columns


def _moved_columns(designs: Sequence[ChosenDesign]) -> Iterator[tuple[str, Column]]:
    """Yield the columns of the keys that move: those that are searched, then G0 and U0."""

    def shown(each: ChosenDesign, path: str) -> Cell | str:
        known = path in each.values
        return number_cell(float(each.values[path]), UNITS[path], 3) if known else ""

    searched = designs[0].keys if designs else ()
    for path in dict.fromkeys((*searched, G0, U0)):
        if any(path in design.values for design in designs):
            yield NAMES[path], partial(shown, path=path)


def _first_of_each(designs: Sequence[ChosenDesign]) -> list[ChosenDesign]:
    """Return the best design of every op-amp, the best first; `designs` are in their order."""
    first: dict[str, ChosenDesign] = {}
    for design in designs:
        first.setdefault(design.opamp, design)
    return list(first.values())


def _maps(designs: Sequence[ChosenDesign], best: Sequence[BestDesign]) -> Iterator[Content]:
    names = [design.opamp for design in _first_of_each(designs)]
    for name in names[:MAPS]:
        own = [design for design in designs if design.opamp == name]
        if any(design.shares for design in own):
            yield _map(name, own, best)
        else:
            text = f"{name} has no map: each of {counted(len(own), 'design')} is unstable,"
            yield f"{text} has no parts that can be bought, or has no verdict."
    if names[MAPS:]:
        yield f"The tables have {len(names) - MAPS} op-amps more."


def _map(name: str, own: Sequence[ChosenDesign], best: Sequence[BestDesign]) -> Chart:
    across, up = (np.array(sorted(set(each))) for each in zip(*map(_values, own), strict=True))
    at = {_values(design): design for design in own}
    cells = [[at.get((x, y)) for x in across.tolist()] for y in up.tolist()]
    levels = np.log10([[_level(design) for design in row] for row in cells])
    hover = tuple(tuple(map(_hover, row)) for row in cells)
    grid = Grid(across, up, levels, "", "signed", ENDS, texts=hover, bar=False)
    edge = list(zero_lines(np.log(across), np.log(up), levels))
    line_x, line_y = map(np.exp, segments(edge))
    limit = (Curve(line_x, line_y, "the limit", "ink", width=2.0),) if edge else ()
    chosen = {one.design.place for one in best}
    others = [design for design in own if design.good and design.place not in chosen]
    stars = [design for design in own if design.place in chosen]
    x, y = (Axis(NAMES[path], UNITS[path], "log") for path in own[0].keys)
    marks: tuple[Mark, ...] = (
        grid,
        *limit,
        *_points(others, "passes", "circle-open", 6.0),
        *_points(stars, "among the best", "star", 13.0),
    )
    title = f"{name}: {sum(design.good for design in own)} of {len(own)} pass and can be bought"
    words = f"The worst value over its limit, by {x.title} and {y.title}."
    return Chart(title, x, y, marks, words, legend=False, height=230)


def _points(designs: Sequence[ChosenDesign], name: str, mark: str, size: float) -> Iterator[Curve]:
    if designs:
        x, y = np.array([_values(design) for design in designs]).T
        yield Curve(x, y, name, "ink", "", mark, size=size)


def _level(design: ChosenDesign | None) -> float:
    """Return the worst share; NaN for a design without a verdict."""
    undecided = design is not None and design.outcome == "inconclusive"
    if design is None or not design.shares or (undecided and design.worst_share is None):
        return math.nan
    return float(np.clip(design.worst, *KNOWN))


def _hover(design: ChosenDesign | None) -> str:
    if design is None:
        return ""
    worst = design.worst_share
    share = "no value" if worst is None else figure(worst, "", 3)
    values = zip(design.keys, _values(design), strict=True)
    place = ", ".join(f"{NAMES[path]} {_text(path, value)}" for path, value in values)
    outcome = "no parts" if design.refused else design.outcome
    return f"{place}: {outcome}, worst {share}"
