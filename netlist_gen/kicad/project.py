"""A KiCad project of one channel: schematic, symbols, project file, and the board's parts list."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from taction.netlist_gen.board.bill_of_materials import packages
from taction.netlist_gen.board.channel import Channel
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.kicad.parts import Catalogue, value_text
from taction.netlist_gen.kicad.schematic import channel_sheet
from taction.netlist_gen.kicad.sheet import Part, library
from taction.netlist_gen.kicad.symbols import LIBRARY
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import Complaint, InputError

# The columns of KiCad's own lists, then ours; parts that agree in GROUPED share a row.
COLUMNS = ("Reference", "Value", "Datasheet", "Footprint", "Qty", "DNP")
OWN = ("Tolerance", "MPN", "Description")
GROUPED = ("Value", "Tolerance", "MPN", "Description")


@dataclass(frozen=True, slots=True)
class Project:
    """The files of a project by their names, and what they show."""

    files: dict[str, str]
    channel: int
    row: int
    not_drawn: tuple[str, ...]


def kicad_project(circuit: Circuit, scene: Scene, channel: int = 1) -> Project:
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
    shown = _channel(circuit, channel)
    sheet = channel_sheet(shown, scene)
    name, catalogue = sheet.project, Catalogue(circuit, scene)
    table = (
        f'(sym_lib_table\n  (version 7)\n  (lib (name "{LIBRARY}")(type "KiCad")(uri'
        f' "${{KIPRJMOD}}/{scene.name}.kicad_sym")(options "")(descr "Symbols of taction"))\n)\n'
    )
    files = {
        f"{name}.kicad_sch": sheet.schematic(scene.name, _comments(shown)),
        f"{name}.kicad_pro": f"{json.dumps(_settings(name), indent=2)}\n",
        f"{scene.name}.kicad_sym": library(catalogue.symbols),
        "sym-lib-table": table,
        f"{scene.name}-bom.csv": parts_list(catalogue),
    }
    return Project(files, shown.n, shown.k, tuple(_not_drawn(circuit, shown)))


def _channel(circuit: Circuit, number: int) -> Channel:
    total = len(circuit.signal_nodes)
    if not 1 <= number <= total:
        text = f"the board has {total} channels, counted from 1"
        raise InputError("--channel", Complaint("N", repr(number), text))
    channel = Channel.of(circuit, number)
    if not channel.connected:
        text = "this channel has no resistor in the matrix, so there is nothing to draw"
        raise InputError("--channel", Complaint("N", repr(number), text))
    return channel


def _comments(channel: Channel) -> tuple[str, ...]:
    circuit = channel.circuit
    gain, lam = circuit.value("gain"), circuit.value("lambda")
    rows = len(channel.circuit.forward.sinks)
    return (
        f"Channel {channel.n} of {len(circuit.signal_nodes)}, sensor row {channel.k} of {rows}",
        f"C = {value_text(channel.farads)}F, gain s = {value_text(gain)}ohm, lambda = {lam:.4g}",
        "Field Deck: the name in the deck; packages U as in taction bom",
    )


def _not_drawn(circuit: Circuit, channel: Channel) -> Iterator[str]:
    strays = len(circuit.capacitors) - len(circuit.real_capacitors)
    if strays:
        yield f"{strays} stray capacitances, which are no parts"
    others = len(circuit.signal_nodes) - 1
    if others:
        yield f"{others} other channels: their signals are global labels"
    for model in circuit.models.values():
        if model.external_part:
            yield f"the {model.external_part} of each op-amp"
    if channel.amplifier is not None:
        yield f"parts of the {circuit.amplifier} amplifier, which is ideal in this scene"


def _settings(name: str) -> dict[str, object]:
    """Return the project file: KiCad takes its defaults for all that is missing."""
    fields = [
        {"group_by": field in GROUPED, "label": label, "name": field, "show": True}
        for field, label in _fields()
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


def _fields() -> Iterator[tuple[str, str]]:
    """Yield the fields of a parts list as KiCad names them, with the titles of their columns."""
    special = {"Qty": "${QUANTITY}", "DNP": "${DNP}"}
    for title in (*COLUMNS, *OWN):
        yield special.get(title, title), title


def parts_list(catalogue: Catalogue) -> str:
    """Return the parts of the whole board as CSV, as ``kicad-cli sch export bom`` writes it.

    Parts of one value, tolerance and kind share a row. Supplies have decoupling capacitors here,
    which the deck does not have.
    """
    rows: dict[tuple[str, ...], dict[str, None]] = {}  # names in their order, each once
    for part in _parts(catalogue):
        key = (part.value, *(part.fields.get(name, "") for name in OWN))
        rows.setdefault(key, {})[part.reference] = None
    text = io.StringIO()
    table = csv.writer(text, quoting=csv.QUOTE_ALL, lineterminator="\n")
    table.writerow((*COLUMNS, *OWN))
    for (value, *own), names in rows.items():
        table.writerow((",".join(names), value, "", "", len(names), "", *own))
    return text.getvalue()


def _parts(catalogue: Catalogue) -> Iterable[Part]:
    circuit = catalogue.circuit
    yield from map(catalogue.resistor, circuit.resistors)
    for matrix in circuit.matrices:
        yield from map(catalogue.resistor, matrix.resistors())
    yield from map(catalogue.capacitor, circuit.real_capacitors)
    for package in packages(circuit):
        yield from (catalogue.decoupling(package.reference, number) for number in (1, 2))
        yield catalogue.opamp_unit(package.reference)
    for n in range(1, 1 + len(circuit.transistors) // 2):
        yield catalogue.transistor(n, 1)
