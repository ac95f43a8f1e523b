"""KiCad's own reading of the projects: rules, nets pin by pin, values, parts lists."""

from __future__ import annotations

import csv
import json
import os
import re
import subprocess
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.kicad.board import kicad_project
from taction.netlist_gen.kicad.part_symbols import BoardParts, wiring
from taction.netlist_gen.scene.scene import Scene
from tests.netlist_gen.kicad.test_project import NAMES, SLOW, scene_of

KICAD = os.environ.get("TACTION_KICAD", "")
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
        files = kicad_project(circuit, scene)
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


@pytest.fixture(scope="module", params=[SLOW if name == "wide" else name for name in NAMES])
def opened(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Opened:
    folder = tmp_path_factory.mktemp("project")
    return Opened.of(scene_of(request.param, folder), folder)


def test_the_rules_are_kept(opened: Opened) -> None:
    assert not opened.violations


def test_values_are_those_of_the_circuit(opened: Opened) -> None:
    values = {f"R{part.name}": part.ohms for part in opened.circuit.resistors}
    for matrix in opened.circuit.matrices:
        for row, column, _, _, ohms in matrix.elements():
            values[f"{matrix.name}_{row + 1}_{column + 1}"] = ohms
    values |= {f"C{part.name}": part.farads for part in opened.circuit.capacitors}
    values |= {f"I{part.name}": part.amps for part in opened.circuit.currents}
    values |= {f"V{part.name}": part.volts for part in opened.circuit.voltages}
    prefixes = {"p": 1e-12, "n": 1e-9, "u": 1e-6, "m": 1e-3, "k": 1e3, "M": 1e6, "G": 1e9}
    checked = 0
    for fields in opened.fields.values():
        if (name := fields.get("Deck", "B"))[0] in "RCIV":
            assert float(fields["Exact"].split()[0]) == values[name]
            number, prefix = re.fullmatch(r"(-?[\d.]+)([pnumkMG]?)[AV]?", fields["Value"]).groups()
            shown = float(number) * prefixes.get(prefix, 1.0)
            assert shown == pytest.approx(values[name], rel=5.1e-4)
            checked += 1
    assert checked > 5


def test_the_list_of_kicad_has_every_part_once(opened: Opened) -> None:
    """What is to be bought: ideal amplifiers, sources and symbols of supplies are not."""
    listed = [name for row in opened.bill for name in row["Reference"].split()]
    parts = BoardParts(opened.circuit, opened.scene)
    units = (*parts.signal, *parts.supply)
    bought = {unit.part.reference for unit in units if unit.part.symbol.bought}
    assert sorted(listed) == sorted(bought)


def test_every_sheet_is_one_page(opened: Opened) -> None:
    made = opened.kicad("export", "pdf", out="drawing.pdf").read_bytes()
    assert made.startswith(b"%PDF")
    sheets = sum(name.endswith(".kicad_sch") for name in opened.files)
    assert made.count(b"/Type /Page\n") == sheets


def test_the_list_of_wires_is_that_of_kicad(opened: Opened) -> None:
    """`tests/netlist_gen/kicad` compares the list with the circuit, pin by pin."""
    text = wiring(BoardParts(opened.circuit, opened.scene))
    listed = {(row["Part"], row["Pin"]): row["Net"] for row in csv.DictReader(text.splitlines())}
    assert len(listed) == len(text.splitlines()) - 1
    for reference in {reference for reference, _ in listed}:
        pins = [pin for pin in listed if pin[0] == reference]
        wires, drawn = ([nets[pin] for pin in pins] for nets in (listed, opened.nets))
        if reference[0] in "RC":  # may be turned
            wires, drawn = sorted(wires), sorted(drawn)
        assert wires == drawn
    assert listed.keys() == opened.nets.keys()
    assert len(listed) > 20
