"""The board: its numbers, one channel as a schematic, the matrix, what was left out, the parts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from taction.netlist_gen.board.bill_of_materials import bill_of_materials
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.kicad.picture import schematic_summary, schematic_svg
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.quantities import readable
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.report.html.blocks import (
    Cell,
    Drawing,
    Facts,
    Notes,
    Picture,
    Section,
    Table,
)
from taction.verification.report.html.pictures import axis, numbers
from taction.verification.report.html.texts import (
    counted,
    number_cell,
    opamp_name,
    percent,
    quantity,
    text_cells,
)
from taction.verification.report.parts_list import parts_document
from taction.verification.verdict.board_power import board_power
from taction.verification.verdict.verify import Verdict

WRITTEN = 12  # rows or columns up to which the entries are written into the picture
LARGEST = 160  # rows or columns of the picture of the matrix
REFERENCES = 12  # names of parts in a line


def board_lines(verdict: Verdict) -> tuple[str, ...]:
    """Return the size of the board and its numbers in one line each."""
    c = verdict.circuit
    rows, columns = c.shape
    numbers = ", ".join(f"{fact.symbol} = {fact.text}" for fact in c.facts.values())
    rule = f" (chosen by {verdict.scene.lambda_rule})" if verdict.scene.lambda_rule else ""
    return (
        f"{counted(columns, 'channel')}, {counted(rows, 'sensor')}, {c.amplifier} amplifiers,"
        f" topology {c.topology}, op-amps {', '.join(map(opamp_name, c.models))}",
        f"{numbers}{rule}",
    )


def board_section(verdict: Verdict) -> Section:
    """Return the schematic of one channel, the matrix and the numbers of the board."""
    circuit = verdict.circuit
    rows = [
        (f"{opamp_name(name)}, {title}", quantity(value, unit))
        for name, model in circuit.models.items()
        for title, value, unit in (
            ("gain-bandwidth product", model.gbw, "Hz"),
            ("input capacitance", model.input_capacitance, "F"),
            ("output resistance", model.output_resistance, "ohm"),
        )
    ]
    level = "small signal" if circuit.is_small_signal else "large signal"
    rows += [
        ("supply", f"±{quantity(circuit.supply, 'V')}"),
        ("level of the op-amp models", level),
    ]
    return Section("Board", (schematic(circuit), matrix_picture(circuit), Facts("", tuple(rows))))


def schematic(circuit: Circuit) -> Drawing:
    """Return the schematic of one channel and one sensor row."""
    return Drawing("One channel", schematic_svg(circuit), schematic_summary(circuit))


def matrix_picture(circuit: Circuit) -> Picture:
    """Return T as a heat map with signs: orange is negative, blue is positive."""
    forward = circuit.forward
    ohms = forward.ohms
    T = circuit.realised
    M, N = T.shape
    note = ""
    if max(M, N) > LARGEST:
        T, ohms = _coarse(T, ohms)
        note = f" Each square is the largest entry of a part of the {M} by {N} matrix."
    reach = float(np.abs(T).max()) or 1.0
    levels = np.where(T == 0.0, np.nan, np.sign(T) * np.sqrt(np.abs(T) / reach))
    texts = [
        [f"T = {entry:.4g}, {quantity(value, 'ohm')}" for entry, value in zip(*pair, strict=True)]
        for pair in zip(T.tolist(), ohms.tolist(), strict=True)
    ]
    rows, columns = T.shape
    data: dict[str, Any] = {
        "type": "heatmap", "z": [numbers(row) for row in levels], "zmin": -1, "zmax": 1,
        "customdata": texts,
        "x": list(range(1, columns + 1)), "y": list(range(1, rows + 1)), "xgap": 1, "ygap": 1,
        "colorscale": [[0, "--negative"], [0.5, "--neutral"], [1, "--positive"]],
        "colorbar": {
            "title": {"text": "T"}, "thickness": 12, "outlinewidth": 0,
            "tickvals": [-1, -0.5, 0, 0.5, 1],
            "ticktext": [f"{share * reach:.2g}" for share in (-1, -0.25, 0, 0.25, 1)],
        },
        "hovertemplate": "row %{y}, channel %{x}: %{customdata}<extra></extra>",
    }  # fmt: skip
    if max(rows, columns) <= WRITTEN:
        data["text"] = [[f"{value:+.2g}" if value else "" for value in row] for row in T.tolist()]
        data |= {"texttemplate": "%{text}", "textfont": {"size": 11}}
    layout = {
        "xaxis": axis("channel", showgrid=False, zeroline=False, **_ticks(columns)),
        "yaxis": axis(
            "sensor", showgrid=False, autorange="reversed", zeroline=False, **_ticks(rows)
        ),
        "plot_bgcolor": "--card",
    }
    present = int(np.isfinite(forward.ohms).sum())
    minus = int((forward.negative & np.isfinite(forward.ohms)).sum())
    summary = (
        f"The matrix T of {counted(M, 'sensor')} and {counted(N, 'channel')} as the resistors"
        f" realise it: {present} entries, of which {minus} are negative (orange, with a minus); an"
        f" empty square has no resistor. The colour follows the square root of the size.{note}"
    )
    height = int(min(max(28 * rows + 110, 240), 620))
    result = f"{counted(present, 'entry', 'entries')}, {minus} negative"
    spec = {"data": [data], "layout": layout}
    return Picture("Matrix", spec, summary, height, zoom=False, result=result)


def _ticks(count: int) -> dict[str, Any]:
    return {"dtick": 1} if count <= WRITTEN else {}


def _coarse(T: Floats, ohms: Floats) -> tuple[Floats, Floats]:
    """Return the entry with the largest magnitude of each part of a large matrix."""
    step = -(-max(T.shape) // LARGEST)
    rows, columns = (range(0, size, step) for size in T.shape)
    parts = [[T[k : k + step, n : n + step] for n in columns] for k in rows]
    coarse = np.array([[part.flat[int(np.abs(part).argmax())] for part in row] for row in parts])
    least = [[ohms[k : k + step, n : n + step].min() for n in columns] for k in rows]
    return coarse, np.array(least)


def omissions_section(document: Mapping[str, Any]) -> Section:
    """Return the parts that the board omits."""
    rows = tuple(
        text_cells((readable(each["what"]), readable(each["why"])))
        for each in document["omissions"]
    )
    if not rows:
        return Section("Left out", (Notes("", ("Nothing was left out.",)),))
    return Section(
        "Left out", (Table("Parts that this scene does not need", ("part", "why"), rows),)
    )


def parts_section(circuit: Circuit, scene: Scene) -> Section:
    """Return the bill of materials with the packages and the power."""
    parts = bill_of_materials(circuit, scene)
    document = parts_document(parts, board_power(LinearBoard(circuit)))
    rows = tuple(map(_part, document["parts"]))
    titles = ("part", "value", "count", "tolerance", "nearest preferred value", "references")
    power, opamps = document["power"], document["opamps"]
    facts = (
        ("op-amps", f"{len(opamps['packages'])} packages {opamps['preset']}"),
        ("op-amps without use", str(opamps["spare"])),
        ("supply current", quantity(power["supply_current"], "A", 3)),
        ("dissipation at rest", quantity(power["total"], "W", 3)),
    )
    missing = Notes("Not included", tuple(map(readable, document["not_listed"])))
    return Section(
        "Parts list", (Facts("", facts), Table("Bill of materials", titles, rows), missing)
    )


def _part(line: Mapping[str, Any]) -> tuple[Cell, ...]:
    near, names = line["preferred"], line["references"]
    more = len(names) - REFERENCES
    listed = " ".join(names[:REFERENCES]) + (f" and {more} more" if more > 0 else "")
    preferred = "standard value"
    if near is not None:
        value = quantity(near["value"], line["unit"])
        preferred = f"{near['series']}: {value} ({100 * near['deviation']:+.2g} %)"
    tolerance = "–" if line["tolerance"] is None else percent(line["tolerance"])
    return (
        Cell(line["kind"]),
        number_cell(line["value"], line["unit"]),
        Cell(str(line["count"]), line["count"]),
        Cell(tolerance, line["tolerance"]),
        Cell(preferred),
        Cell(listed),
    )
