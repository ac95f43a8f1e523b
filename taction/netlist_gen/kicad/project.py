"""The files of a KiCad project beside its schematics: symbols, project file, parts list."""

from __future__ import annotations

import csv
import io
import json

from taction.netlist_gen.kicad.parts import Catalogue
from taction.netlist_gen.kicad.sheet import library
from taction.netlist_gen.kicad.symbols import FLAG, GROUND, LIBRARY
from taction.netlist_gen.kicad.wiring import joined_parts
from taction.netlist_gen.scene.scene import Scene

# The columns of KiCad's own lists, then ours; parts that agree in GROUPED share a row.
COLUMNS = ("Reference", "Value", "Datasheet", "Footprint", "Qty", "DNP")
NAMES = {"Qty": "${QUANTITY}", "DNP": "${DNP}"}  # as KiCad names them
OWN = ("Tolerance", "MPN", "Description")
GROUPED = ("Value", "Tolerance", "MPN", "Description")


def project_files(catalogue: Catalogue, scene: Scene, name: str) -> dict[str, str]:
    """Return the files of the project `name` beside its schematics."""
    drawn = (part.symbol for part, _, _ in joined_parts(catalogue))
    symbols = {each.name: each for each in (GROUND, FLAG, *catalogue.rails, *drawn)}
    table = (
        f'(sym_lib_table\n  (version 7)\n  (lib (name "{LIBRARY}")(type "KiCad")(uri'
        f' "${{KIPRJMOD}}/{scene.name}.kicad_sym")(options "")(descr "Symbols of taction"))\n)\n'
    )
    return {
        f"{name}.kicad_pro": f"{json.dumps(_settings(name), indent=2)}\n",
        f"{scene.name}.kicad_sym": library(symbols.values()),
        "sym-lib-table": table,
        f"{scene.name}-bom.csv": parts_list(catalogue),
    }


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
    drawn = {part.reference: part for part, _, _ in joined_parts(catalogue) if part.symbol.bought}
    for part in drawn.values():
        key = (part.value, *(part.fields.get(name, "") for name in OWN))
        rows.setdefault(key, {})[part.reference] = None
    text = io.StringIO()
    table = csv.writer(text, quoting=csv.QUOTE_ALL, lineterminator="\n")
    table.writerow((*COLUMNS, *OWN))
    for (value, *own), names in rows.items():
        table.writerow((",".join(names), value, "", "", len(names), "", *own))
    return text.getvalue()
