"""A KiCad project of one channel: schematic, symbols, project file, and the board's parts list."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator
from dataclasses import dataclass, field

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.kicad.drawing import channel_sheet
from taction.netlist_gen.kicad.parts import Catalogue, knob_values
from taction.netlist_gen.kicad.sheet import library
from taction.netlist_gen.kicad.stages import driven_row
from taction.netlist_gen.kicad.symbols import LIBRARY
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import Complaint, InputError

# The columns of KiCad's own lists, then ours; parts that agree in GROUPED share a row.
COLUMNS = ("Reference", "Value", "Datasheet", "Footprint", "Qty", "DNP")
NAMES = {"Qty": "${QUANTITY}", "DNP": "${DNP}"}  # as KiCad names them
OWN = ("Tolerance", "MPN", "Description")
GROUPED = ("Value", "Tolerance", "MPN", "Description")


@dataclass(frozen=True, slots=True)
class KicadProject:
    """The drawing of a channel, and the files that were written."""

    DOCUMENT = (
        *("scene = scene.name", "files = written", "channel # from 1", "row # from 1"),
        "not_drawn",
    )

    scene: Scene = field(repr=False)
    files: dict[str, str] = field(repr=False)
    channel: int
    row: int
    not_drawn: tuple[str, ...] = field(repr=False)
    written: tuple[str, ...] = ()


def kicad_project(circuit: Circuit, scene: Scene, channel: int = 1) -> KicadProject:
    """Return the KiCad project of a channel, counted from 1, of the board of `scene`.

    The sensor row is the one that the channel drives most. The list has the parts of the whole
    board.

    Raises
    ------
    InputError
        There is no such channel, or it has no resistor in the matrix.

    Examples
    --------
    >>> import taction
    >>> scene = taction.load_scene("scenes/custom-matrix.toml")
    >>> project = kicad_project(taction.synthesise(scene), scene)
    >>> list(project.files)[:2]
    ['custom-matrix-channel-1.kicad_sch', 'custom-matrix-channel-1.kicad_pro']
    """
    total, row = len(circuit.signal_nodes), 0
    if not 1 <= channel <= total:
        text = f"the board has {total} channels, counted from 1"
    elif not (row := driven_row(circuit, channel)):
        text = "this channel has no resistor in the matrix, so there is nothing to draw"
    if not row:
        raise InputError("--channel", Complaint("N", repr(channel), text))
    sheet, catalogue = channel_sheet(circuit, channel, row, scene), Catalogue(circuit, scene)
    name = sheet.project
    comments = (
        f"Channel {channel} of {total}, sensor row {row} of {circuit.shape[0]}",
        knob_values(circuit),
        "Field Deck: the name in the deck; packages U as in taction export bom",
    )
    drawn = {f"{name}.kicad_sch": sheet.schematic(scene.name, comments)}
    files = drawn | project_files(catalogue, scene, name)
    return KicadProject(scene, files, channel, row, tuple(_not_drawn(circuit)))


def project_files(catalogue: Catalogue, scene: Scene, name: str) -> dict[str, str]:
    """Return the files of the project `name` beside its schematics."""
    table = (
        f'(sym_lib_table\n  (version 7)\n  (lib (name "{LIBRARY}")(type "KiCad")(uri'
        f' "${{KIPRJMOD}}/{scene.name}.kicad_sym")(options "")(descr "Symbols of taction"))\n)\n'
    )
    return {
        f"{name}.kicad_pro": f"{json.dumps(_settings(name), indent=2)}\n",
        f"{scene.name}.kicad_sym": library(catalogue.symbols),
        "sym-lib-table": table,
        f"{scene.name}-bom.csv": parts_list(catalogue),
    }


def _not_drawn(circuit: Circuit) -> Iterator[str]:
    strays = len(circuit.capacitors) - len(circuit.real_capacitors)
    if strays:
        yield f"{strays} stray capacitances, which are no parts"
    others = len(circuit.signal_nodes) - 1
    if others:
        yield f"{others} other channels: their signals are global labels"
    if any(matrix.wires is not None for matrix in circuit.matrices):
        yield "the wires of the arrays, which are no parts"
    for model in circuit.models.values():
        if model.external_part:
            yield f"the {model.external_part} of each op-amp"
    if circuit.amplifiers:
        yield f"parts of the {circuit.amplifier} amplifier, which is ideal in this scene"


def _settings(name: str) -> dict[str, object]:
    """Return the project file: KiCad takes its defaults for all that is missing."""
    fields = [
        {
            "group_by": title in GROUPED,
            "label": title,
            "name": NAMES.get(title, title),
            "show": True,
        }
        for title in (*COLUMNS, *OWN)
    ]
    preset = {
        **{"name": LIBRARY, "fields_ordered": fields, "sort_field": "Reference", "sort_asc": True},
        **{"filter_string": "", "group_symbols": True, "exclude_dnp": False},
        "include_excluded_from_bom": False,
    }
    return {
        "meta": {"filename": f"{name}.kicad_pro", "version": 3},
        "schematic": {"bom_settings": preset, "bom_presets": [preset]},
        "sheets": [],
        "text_variables": {},
    }


def parts_list(catalogue: Catalogue) -> str:
    """Return the parts of the whole board as CSV, as ``kicad-cli sch export bom`` writes it.

    Parts of one value, tolerance and kind share a row. Supplies have decoupling capacitors here,
    which the deck does not have.
    """
    rows: dict[tuple[str, ...], dict[str, None]] = {}  # names in their order, each once
    for part in catalogue.bought:
        key = (part.value, *(part.fields.get(name, "") for name in OWN))
        rows.setdefault(key, {})[part.reference] = None
    text = io.StringIO()
    table = csv.writer(text, quoting=csv.QUOTE_ALL, lineterminator="\n")
    table.writerow((*COLUMNS, *OWN))
    for (value, *own), names in rows.items():
        table.writerow((",".join(names), value, "", "", len(names), "", *own))
    return text.getvalue()
