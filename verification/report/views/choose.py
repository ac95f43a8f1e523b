"""A choice of op-amp, C and gain: the best designs, a map for each op-amp, the best in full."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from taction.netlist_gen.scene.scene import Scene
from taction.verification.design.choose import CAPACITANCE, GAIN, Confirmation, Design
from taction.verification.report.blocks import (
    PAGE,
    TERMINAL,
    Block,
    Cell,
    Notes,
    Page,
    Section,
    Sheet,
    Table,
)
from taction.verification.report.charts import Axis, Chart, Curve, Grid
from taction.verification.report.texts import (
    counted,
    figure,
    number_cell,
    outcome_cell,
    quantity,
    readable,
)
from taction.verification.report.views.verdict import view as verdict_report
from taction.verification.verdict.record import finite
from taction.verification.verdict.verify import Verdict

SHOWN = 12  # op-amps in a terminal
LISTED = 500  # designs in the table
MAPS, ACROSS = 9, 3  # op-amps with a map, the best first; maps side by side in a picture
LOW, HIGH = 0.1, 10.0  # ends of the colours: shares of a limit
WORST = "Worst: the largest value over its limit; below 1 every check passes."
BOTH = (TERMINAL, PAGE)
COMMAND = "taction choose"


def view(
    scene: Scene,
    designs: Sequence[Design],
    best: Sequence[Design],
    confirmations: Sequence[Confirmation],
    verdict: Verdict | None = None,
) -> Page:
    """Return the page of a choice.

    Parameters
    ----------
    scene : Scene
        The scene that was asked about.
    designs, best, confirmations : sequences
        All designs in their order; those that ngspice ran; and what it says of these.
    verdict : Verdict or None
        Of the design that is proposed, shown in full below; None: without it.
    """
    passing = sum(design.good for design in designs)
    summary = f"{passing} of {len(designs)} designs pass with parts that can be bought."
    own = (
        Section("Best designs", tuple(_best(best, confirmations)), WORST, BOTH),
        Section("Op-amps", (_opamps(designs, SHOWN),), media=(TERMINAL,)),
        Section("Op-amps", (_opamps(designs, len(designs)),)),
        Section("Maps", lambda: _maps(designs, best)),
        Section("All designs", lambda: (_table(designs),)),
    )

    def picture() -> Sheet:
        return sheet(
            f"{scene.name}: worst value over its limit, for {len(designs)} designs", designs, best
        )

    if verdict is None and best:
        return Page(scene.name, COMMAND, "pass", summary, (), own, sheet=picture)
    if verdict is None:
        lines = ("No design passes; the table of op-amps has the nearest of each with its reason.",)
        return Page(scene.name, COMMAND, "fail", summary, lines, own[1:], sheet=picture)
    full = verdict_report(verdict, COMMAND)
    first = _words(best[proposed(confirmations)])
    return Page(
        title=scene.name,
        command=full.command,
        outcome=full.outcome,
        summary=f"{first}. {full.summary} {summary}",
        lines=(f"In full below: {verdict.scene.name}, {verdict.waveforms.simulator}.", *full.lines),
        sections=(*own, *full.sections),
        sheet=picture,
    )


def proposed(confirmations: Sequence[Confirmation]) -> int:
    """Return the number of the first design that ngspice confirms; 0 if it confirms none."""
    passed = (k for k, said in enumerate(confirmations) if _text_of(said) == "pass")
    return next(passed, 0)


def _text_of(confirmation: Confirmation) -> str:
    """Return what ngspice says in a word."""
    return "not run" if confirmation.outcome is None else confirmation.outcome.value


def _values(design: Design) -> tuple[float, float]:
    """Return C in F and the gain in ohm."""
    return float(design.values[CAPACITANCE]), float(design.values[GAIN])


def _words(design: Design) -> str:
    farads, ohms = _values(design)
    return f"{design.opamp}, C = {quantity(farads, 'F')}, gain = {quantity(ohms, 'ohm')}"


def _best(best: Sequence[Design], confirmations: Sequence[Confirmation]) -> Iterator[Block]:
    noise = _has_noise(best)
    rows = tuple(
        (
            *_cells(design, noise=noise),
            Cell(_text_of(said), None, said.outcome.value if said.outcome else ""),
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


def _opamps(designs: Sequence[Design], most: int) -> Table:
    """Return the best design of each op-amp, and why it does not pass."""
    first = _first_of_each(designs)
    counts = {d.opamp: sum(each.good for each in designs if each.opamp == d.opamp) for d in first}
    noise = _has_noise(designs)
    rows = tuple(
        (
            *_cells(each, noise=noise),
            Cell(str(counts[each.opamp]), counts[each.opamp]),
            Cell(_why(each)),
        )
        for each in first[:most]
    )
    more = f"{len(first) - most} more: --json." if first[most:] else ""
    titles = (*_titles(noise=noise), "passing", "why")
    return Table("The best design of each op-amp", titles, rows, more)


def _table(designs: Sequence[Design]) -> Table:
    noise = _has_noise(designs)
    rows = tuple((*_cells(d, noise=noise), Cell(_why(d))) for d in designs[:LISTED])
    more = f"The first {LISTED} of {len(designs)}; --json has all." if designs[LISTED:] else ""
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
    farads, ohms = _values(design)
    return (
        Cell(design.opamp),
        Cell(quantity(farads, "F", 3), farads),
        Cell(quantity(ohms, "ohm", 3), ohms),
        Cell("no parts", None, "fail") if design.refused else outcome_cell(design.outcome),
        number_cell(finite(design.settling_time), "s", 3),
        number_cell(finite(design.overshoot), "step", 3),
        number_cell(design.headroom, "step", 3),
        *([number_cell(design.noise, "V", 3)] if noise else []),
        number_cell(design.worst if design.shares else None, "", 3),
    )


def _first_of_each(designs: Sequence[Design]) -> list[Design]:
    """Return the best design of every op-amp, the best first; `designs` are in their order."""
    first: dict[str, Design] = {}
    for design in designs:
        first.setdefault(design.opamp, design)
    return list(first.values())


def _maps(designs: Sequence[Design], best: Sequence[Design]) -> Iterator[Block]:
    names = [design.opamp for design in _first_of_each(designs)]
    for name in names[:MAPS]:
        own = [design for design in designs if design.opamp == name]
        if any(design.shares for design in own):
            yield _map(name, own, best)
        else:
            text = f"{name} has no map: each of {counted(len(own), 'design')} is unstable,"
            yield Notes("", (f"{text} has no parts that can be bought, or has no verdict.",))
    if names[MAPS:]:
        yield Notes("", (f"The tables have {len(names) - MAPS} op-amps more.",))


def sheet(title: str, designs: Sequence[Design], best: Sequence[Design]) -> Sheet:
    """Return what the picture of a choice shows: a map for each of the best op-amps."""
    blocks = [block for block in _maps(designs, best) if isinstance(block, Chart)]
    count = max(min(len(blocks), ACROSS), 1)
    columns = tuple(tuple(blocks[k::count]) for k in range(count))
    return Sheet(
        title,
        columns,
        size=(2.0 + 3.6 * count, 1.4 + 3.0 * max(map(len, columns))),
        foot="circle: passes all checks, with parts that can be bought; star: among the best;"
        " empty: unstable or without a verdict",
    )


def _map(name: str, own: Sequence[Design], best: Sequence[Design]) -> Chart:
    farads, ohms = (sorted(set(values)) for values in zip(*map(_values, own), strict=True))
    at = {_values(design): design for design in own}
    cells = [[at.get((x, y)) for x in farads] for y in ohms]
    chosen = {design.place for design in best}
    passing = sum(design.good for design in own)
    grid = Grid(
        np.array(farads),
        np.array(ohms),
        np.array([[_level(design) for design in row] for row in cells]),
        scale="share",
        limits=(LOW, HIGH),
        title="worst value over its limit",
        texts=tuple(tuple(map(_hover, row)) for row in cells),
    )
    others = [design for design in own if design.good and design.place not in chosen]
    stars = [design for design in own if design.place in chosen]
    return Chart(
        name,
        Axis("C", "F", "log"),
        Axis("gain", "ohm", "log"),
        (
            grid,
            *_points(others, "passes", "circle-open", 6.0),
            *_points(stars, "among the best", "star", 13.0),
        ),
        message=f"{passing} of {len(own)} pass",
        summary=(
            f"{name}: {passing} of {counted(len(own), 'design')} pass. Colour: the worst value over"
            " its limit; empty: unstable, or without a verdict."
        ),
        legend="below",
    )


def _points(designs: Sequence[Design], name: str, mark: str, size: float) -> Iterator[Curve]:
    if designs:
        x, y = np.array([_values(design) for design in designs]).T
        yield Curve(x, y, name, "ink", "", mark, size=size)


def _level(design: Design | None) -> float:
    """Return the worst share; not a number for an unstable design."""
    if design is None or not design.shares:
        return math.nan
    return max(design.worst, LOW / 10.0)


def _hover(design: Design | None) -> str:
    if design is None:
        return ""
    share = figure(design.worst, "", 3) if design.shares else "no value"
    farads, ohms = _values(design)
    place = f"C {quantity(farads, 'F')}, gain {quantity(ohms, 'ohm')}"
    outcome = "no parts" if design.refused else design.outcome
    return f"{place}: {outcome}, worst {share}"
