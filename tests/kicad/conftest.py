"""Projects that a real ``kicad-cli`` reads.

Without ``TACTION_KICAD``, the path of a ``kicad-cli``, nothing here is collected.
"""

from __future__ import annotations

import csv
import json
import os
import subprocess
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.kicad.board import kicad_project
from taction.netlist_gen.scene.scene import Scene

KICAD = os.environ.get("TACTION_KICAD", "")
collect_ignore_glob = [] if KICAD else ["test_*.py"]
COLUMNS = {
    **{name: name for name in ("Reference", "Value", "Datasheet", "Footprint")},
    **{"${QUANTITY}": "Qty", "${DNP}": "DNP"},
    **{name: name for name in ("Tolerance", "MPN", "Description")},
}


@dataclass(frozen=True)
class Opened:
    """A project on the disk, its board, and what KiCad reads in it."""

    folder: Path
    scene: Scene
    circuit: Circuit
    files: dict[str, str]

    @classmethod
    def of(cls, scene: Scene, folder: Path) -> Opened:
        """Write the project of the board of a scene into a folder."""
        circuit = synthesise(scene)
        files = kicad_project(circuit, scene).files
        for name, text in files.items():
            (folder / name).write_text(text, encoding="utf-8")
        return cls(folder, scene, circuit, files)

    def file(self, ending: str) -> Path:
        """Return the first file of the project with an ending."""
        return self.folder / next(name for name in self.files if name.endswith(ending))

    def kicad(self, *words: str, out: str) -> Path:
        """Run ``kicad-cli sch ...`` on the schematic; return the file that it writes."""
        made = self.folder / out
        command = [KICAD, "sch", *words, "-o", str(made), str(self.file(".kicad_sch"))]
        home = {"HOME": str(self.folder), "KICAD_CONFIG_HOME": str(self.folder / "settings")}
        run = subprocess.run(command, env=os.environ | home, capture_output=True, text=True)
        assert run.returncode == 0, run.stdout + run.stderr
        assert "annotation errors" not in run.stdout + run.stderr
        return made

    @cached_property
    def violations(self) -> Counter[tuple[str, str]]:
        """Severity and kind of everything that KiCad's check of the rules finds, counted."""
        words = ("erc", "--severity-all", "--format", "json")
        found = json.loads(self.kicad(*words, out="erc.json").read_text("utf-8"))
        each = [item for sheet in found["sheets"] for item in sheet["violations"]]
        return Counter((item["severity"], item["type"]) for item in each)

    @cached_property
    def netlist(self) -> Any:
        """KiCad's netlist."""
        made = self.kicad("export", "netlist", "--format", "kicadxml", out="netlist.xml")
        return ElementTree.parse(made).getroot()  # noqa: S314 - KiCad's own file

    @cached_property
    def nets(self) -> dict[tuple[str, str], str]:
        """The net of every pin of every part, by reference and number of the pin."""
        return {
            (node.attrib["ref"], node.attrib["pin"]): net.attrib["name"].rpartition("/")[2]
            for net in self.netlist.find("nets")
            for node in net.findall("node")
        }

    @cached_property
    def fields(self) -> dict[str, dict[str, str]]:
        """The fields of every part, by its reference."""
        return {
            part.attrib["ref"]: {"Value": part.findtext("value")}
            | {each.attrib["name"]: each.text or "" for each in part.find("fields")}
            for part in self.netlist.find("components")
        }

    @cached_property
    def bill(self) -> list[dict[str, str]]:
        """KiCad's own parts list of the drawing."""
        words = ["--fields", ",".join(COLUMNS), "--labels", ",".join(COLUMNS.values())]
        words += ["--group-by", "Value,Tolerance,MPN,Description", "--ref-range-delimiter", ""]
        return rows(self.kicad("export", "bom", *words, out="kicad.csv"))


def rows(file: Path) -> list[dict[str, str]]:
    """Return the rows of a parts list, their references in one order."""
    with file.open(encoding="utf-8", newline="") as text:
        found = list(csv.DictReader(text))
    return [row | {"Reference": " ".join(sorted(row["Reference"].split(",")))} for row in found]
