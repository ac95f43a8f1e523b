"""KiCad's own reading of the projects: rules, nets pin by pin, values, parts lists."""

from __future__ import annotations

import csv
import json
import os
import re
import subprocess
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import taction
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.kicad.board import kicad_project
from taction.netlist_gen.kicad.part_symbols import BoardParts, wiring
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene, parse_scene
from tests.support.making import make_scene
from tests.support.paths import SCENES

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


DEVICES = {"amplifier": "exponential", "exponential_slope": "100mV", "antilog": "device"}
NPN = {**DEVICES, "antilog": {"stage": "device", "transistors": "ssm2212"}}
PASSIVE = {"topology": "passive", "lambda": 100.0}
# Pins -, +, output of the op-amps A, B ... as the data sheets of the TL084 and the TL072 draw them.
SHEETS = {
    "TL084": (("2", "3", "1"), ("6", "5", "7"), ("9", "10", "8"), ("13", "12", "14")),
    "TL072": (("2", "3", "1"), ("6", "5", "7")),
    "OPA2134": (("2", "3", "1"), ("6", "5", "7")),
    "UA741": (("2", "3", "6"),),
    "OPA189": (("2", "3", "6"),),
}
RAILS = {"TL084": ("4", "11"), "TL072": ("8", "4"), "UA741": ("7", "4"), "OPA189": ("7", "4")}
SHEETS["TL074"], RAILS["TL074"] = SHEETS["TL084"], RAILS["TL084"]
RAILS["OPA2134"] = RAILS["TL072"]


def one_by_one() -> Scene:
    tables: dict[str, Any] = {
        "problem": {"kind": "matrix", "matrix": np.array([[-0.7]]), "strain": np.array([0.3])},
        "design": {"opamp": "tl084", "bias": True, **NPN},
        "analysis": {"initial": "rest"},
        "tolerances": {"resistor": 0.01},
    }
    return parse_scene(tables, "scene.toml")


def scene_of(name: str, folder: Path) -> Scene:
    if name.endswith(".toml"):
        return load_scene(SCENES / name)
    rest = {"analysis": {"initial": "rest"}}
    if name == "one by one":
        return one_by_one()
    if name == "new":
        taction.new(file=folder / "new.toml")
        return load_scene(folder / "new.toml")
    made = {
        "quad": ({"channels": 3}, {"opamp": "tl074", "strain_input": "voltage"}),
        "npn": ({"channels": 3}, {"opamp": "tl072", **NPN}),
        "pnp": ({"channels": 3}, {"opamp": "ua741", **DEVICES}),
        "passive": ({"channels": 3}, {"opamp": "tl072", **PASSIVE}),
        "passive exponential": (
            {"channels": 3},
            {"amplifier": "exponential", "exponential_slope": "1V", "bias": False, **PASSIVE},
        ),
        "wide": ({"channels": 70, "span": 40.0}, {"opamp": "tl084"}),
    }
    problem, design = made[name]
    return make_scene(problem, design=design, **rest)


NAMES = (
    "new",
    "quad",
    "paper-breadboard.toml",
    "least-squares.toml",
    "custom-matrix.toml",
    "paper-exponential.toml",
    "paper-exponential-devices.toml",
    "tangential-exponential.toml",
    "one by one",
    "npn",
    "pnp",
    "passive",
    "passive exponential",
    "wide",
)


@pytest.fixture(scope="module", params=NAMES)
def opened(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Opened:
    folder = tmp_path_factory.mktemp("project")
    return Opened.of(scene_of(request.param, folder), folder)


def test_the_rules_are_kept(opened: Opened) -> None:
    assert not opened.violations


def deck_pins(circuit: Circuit) -> Iterator[tuple[str, dict[str, str]]]:
    """Every part of the board: its name in the deck, and the nodes of its pins."""
    for resistor in circuit.resistors:
        yield f"R{resistor.name}", {"1": resistor.a, "2": resistor.b}
    for matrix in circuit.matrices:
        for row, column, source, sink, _ in matrix.elements():
            yield f"{matrix.name}_{row + 1}_{column + 1}", {"1": source, "2": sink}
    for capacitor in circuit.capacitors:
        if not capacitor.name.startswith("stray_"):
            yield f"C{capacitor.name}", {"1": capacitor.a, "2": capacitor.b}
    for current in circuit.currents:
        yield f"I{current.name}", {"1": "0", "2": current.node}


def expected_nets(opened: Opened) -> dict[tuple[str, str], str]:
    """The node of every pin that the drawing must have, from the circuit alone."""
    circuit = opened.circuit
    by_deck = {fields["Deck"]: ref for ref, fields in opened.fields.items() if "Deck" in fields}
    found = {}
    for name, pins in deck_pins(circuit):
        # Two-ended parts may be drawn either way round: only current has a direction.
        drawn = [opened.nets[by_deck[name], pin] for pin in ("1", "2")]
        ends = [pins["1"], pins["2"]]
        turned = drawn == [("GND" if node == "0" else node) for node in reversed(ends)]
        assert not (turned and name.startswith("I"))
        for pin, node in zip(("1", "2"), reversed(ends) if turned else ends, strict=True):
            found[by_deck[name], pin] = node
    for place, cell in enumerate(circuit.opamps):
        nodes = cell.inverting, cell.noninverting, cell.output
        found |= dict(zip(opamp_pins(opened, place), nodes, strict=True))
    for amplifier in circuit.amplifiers:
        name = by_deck[f"B{amplifier.name}"]
        found |= {(name, "1"): amplifier.input, (name, "2"): amplifier.output}
    for place, cell in enumerate(circuit.transistors):
        number = str(place % 2 + 1)
        for letter, node in zip("CBE", (cell.collector, cell.base, cell.emitter), strict=True):
            found[f"Q{place // 2 + 1}", f"{letter}{number}"] = node
    for source in circuit.voltages:
        found |= {(by_deck[f"V{source.name}"], "1"): source.node}
        found |= {(by_deck[f"V{source.name}"], "2"): "0"}
    return {pin: "GND" if node == "0" else node for pin, node in found.items()}


def opamp_pins(opened: Opened, place: int) -> list[tuple[str, str]]:
    """Pins -, + and output of an op-amp of the board, by its place: packages fill in this order."""
    size, _ = packing(opened.circuit)
    reference = f"U{place // size + 1}"
    pins = SHEETS.get(opened.fields[reference]["Value"], (("-", "+", "out"),))[place % size]
    return [(reference, pin) for pin in pins]


def unused_pins(opened: Opened) -> Iterator[list[tuple[str, str]]]:
    """Pins -, + and output of each op-amp without use, of a whole board."""
    size, count = packing(opened.circuit)
    for place in range(count, size * -(-count // size)):
        yield opamp_pins(opened, place)


def packing(circuit: Circuit) -> tuple[int, int]:
    size = next(iter(circuit.models.values())).channels_per_package
    return size, len(circuit.opamps)


def test_every_pin_is_on_the_net_of_the_circuit(opened: Opened) -> None:
    expected = expected_nets(opened)
    assert len(expected) > 20
    rest = {pin: net for pin, net in opened.nets.items() if pin not in expected}
    assert {pin: opened.nets.get(pin) for pin in expected} == expected
    for pins in unused_pins(opened):
        nets = [rest.pop(pin) for pin in pins]
        assert nets == [nets[2], "GND", nets[2]]  # a follower at ground, with nothing else
        assert list(opened.nets.values()).count(nets[2]) == 2
    # All else is supply: packages, and capacitors from each rail to ground.
    rail = f"{opened.circuit.supply:g}V"
    for (reference, pin), net in rest.items():
        assert re.fullmatch(r"U\d+|CU\d+_[12]", reference), (reference, pin, net)
        plus, minus = RAILS.get(opened.fields[reference]["Value"], ("V+", "V-"))
        wanted = {plus: f"+{rail}", minus: f"-{rail}"}
        if reference.startswith("C"):
            wanted = {"1": f"+{rail}", "2": "GND"}
            if reference.endswith("_2"):
                wanted = {"1": "GND", "2": f"-{rail}"}
        assert net == wanted[pin]
    packages = {reference for reference, _ in opened.nets if reference.startswith("U")}
    assert len(rest) == 6 * len(packages)


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
