"""The KiCad project and the list of wires of a whole board, without KiCad."""

from __future__ import annotations

import csv
from collections import Counter, defaultdict
from typing import Any

import pytest

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.kicad.board import kicad_project
from taction.netlist_gen.kicad.parts import Catalogue, reference
from taction.netlist_gen.kicad.stages import branches
from taction.netlist_gen.kicad.wiring import wiring
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene
from tests.netlist_gen.kicad.test_project import fields, items, parsed
from tests.support.making import make_scene
from tests.support.paths import SCENES

QUAD = {"opamp": "tl074", "strain_input": "voltage"}


def quad() -> Scene:
    return make_scene({"channels": 3, "span": 2.0}, design=QUAD)


SCENE_OF = {
    "quad": quad,
    "custom": lambda: load_scene(SCENES / "custom-matrix.toml"),
    "devices": lambda: load_scene(SCENES / "paper-exponential-devices.toml"),
    "passive": lambda: make_scene(
        {"channels": 3}, design={"topology": "passive", "opamp": "tl072", "lambda": 100.0}
    ),
    # A column and a row without entries have sheets, too.
    "empty column": lambda: make_scene(
        {"kind": "matrix", "matrix": [[1.0, 0.0], [0.5, 0.0]], "strain": [1.0, 0.0]}
    ),
}


@pytest.fixture(scope="module", params=SCENE_OF)
def scene(request: pytest.FixtureRequest) -> Scene:
    return SCENE_OF[request.param]()


def sheets(files: dict[str, str]) -> dict[str, Any]:
    return {name: parsed(text) for name, text in files.items() if name.endswith(".kicad_sch")}


def rows_of(circuit: Circuit, scene: Scene) -> list[dict[str, str]]:
    return list(csv.DictReader(wiring(Catalogue(circuit, scene)).splitlines()))


def two_ended(circuit: Circuit) -> dict[str, tuple[str, str]]:
    """The nodes of every resistor and capacitor by its name in the deck, from the circuit."""
    ends = {f"R{part.name}": (part.a, part.b) for part in circuit.resistors}
    for matrix in circuit.matrices:
        for k, n, source, sink, _ in matrix.elements():
            ends[f"{matrix.name}_{k + 1}_{n + 1}"] = source, sink
    strays = "stray_"
    parts = (each for each in circuit.capacitors if not each.name.startswith(strays))
    return ends | {f"C{part.name}": (part.a, part.b) for part in parts}


def test_every_part_is_drawn_once(scene: Scene) -> None:
    circuit = synthesise(scene)
    drawn = Counter(
        (fields(symbol)["Reference"], items(symbol, "unit")[0][1])
        for tree in sheets(kicad_project(circuit, scene).files).values()
        for symbol in items(tree, "symbol")
    )
    assert set(drawn.values()) == {1}  # also symbols of supplies, whose numbers are of the project
    references = {name for name, _ in drawn}
    assert {reference(name) for name in two_ended(circuit)} <= references
    size = next(iter(circuit.models.values())).channels_per_package
    for number in range(1, 1 + -(-len(circuit.opamps) // size)):
        units = {int(unit) for name, unit in drawn if name == f"U{number}"}
        assert units == set(range(1, size + 2))  # used or not, and the supply


def test_the_boxes_are_the_sheets_and_their_pins_the_labels(scene: Scene) -> None:
    found = sheets(kicad_project(synthesise(scene), scene).files)
    first, *below = found
    boxes = items(found[first], "sheet")
    assert [fields(box)["Sheetfile"] for box in boxes] == below
    for box in boxes:
        tree = found[fields(box)["Sheetfile"]]
        labels = {label[1] for label in items(tree, "hierarchical_label")}
        assert {pin[1] for pin in items(box, "pin")} == labels
        assert not items(tree, "global_label")
        path = f"/{items(found[first], 'uuid')[0][1]}/{items(box, 'uuid')[0][1]}"
        for symbol in items(tree, "symbol"):
            assert items(items(items(symbol, "instances")[0], "project")[0], "path")[0][1] == path
    driven = [pin[1] for box in boxes for pin in items(box, "pin") if pin[2] == "output"]
    assert len(set(driven)) == len(driven)  # one sheet drives a net


def test_no_identifier_stands_twice() -> None:
    files = kicad_project(synthesise(quad()), quad()).files
    found = Counter(
        line.strip()
        for name, text in files.items()
        if name.endswith(".kicad_sch")
        for line in text.splitlines()
        if line.strip().startswith("(uuid")
    )
    assert set(found.values()) == {1}
    assert files == kicad_project(synthesise(quad()), quad()).files


def test_every_node_is_in_one_branch(scene: Scene) -> None:
    names = [name for name, _, _ in branches(synthesise(scene))]
    assert len(set(names)) == len(names)
    assert not any(name.startswith("more") for name in names)


def test_the_wires_are_those_of_the_circuit(scene: Scene) -> None:
    circuit = synthesise(scene)
    nets: dict[str, list[str]] = defaultdict(list)
    for row in rows_of(circuit, scene):
        nets[row["Deck"]].append("0" if row["Net"] == "GND" else row["Net"])
    for name, ends in two_ended(circuit).items():
        assert sorted(nets[name]) == sorted(ends)
    for cell in circuit.opamps:
        nodes = (cell.inverting, cell.noninverting, cell.output)
        assert sorted(nets[f"X{cell.name}"]) == sorted(nodes)
    for cell in circuit.transistors:
        assert sorted(nets[cell.card]) == sorted((cell.base, cell.collector, cell.emitter))
    for source in circuit.voltages:
        assert sorted(nets[source.card]) == sorted((source.node, "0"))


def test_the_pins_of_a_quad_op_amp() -> None:
    """As the data sheet of the TL074 draws them; what is left is a follower at ground."""
    circuit = synthesise(quad())
    rows = rows_of(circuit, quad())
    pins = {(row["Part"], row["Pin"]): row for row in rows}
    assert len(pins) == len(rows)
    outputs, minus, plus = ("1", "7", "8", "14"), ("2", "6", "9", "13"), ("3", "5", "10", "12")
    for place, cell in enumerate(circuit.opamps):
        part, unit = f"U{place // 4 + 1}", place % 4
        found = [pins[part, each[unit]] for each in (minus, plus, outputs)]
        assert [row["Net"] for row in found] == [cell.inverting, "GND", cell.output]
        assert [row["Name"] for row in found] == ["-", "+", "out"]
        assert {row["Unit"] for row in found} == {"ABCD"[unit]}
    last, left = f"U{-(-len(circuit.opamps) // 4)}", -len(circuit.opamps) % 4
    assert left  # this board has op-amps without use
    spare = [row for row in rows if row["Deck"] == "not used"]
    assert len(spare) == 3 * left
    for unit in range(4 - left, 4):
        node = f"unused_{last}_{unit + 1}"
        assert [pins[last, each[unit]]["Net"] for each in (minus, plus, outputs)] == [
            *(node, "GND", node)
        ]
    assert {pins[last, "4"]["Net"], pins[last, "11"]["Net"]} == {"+15V", "-15V"}
    assert pins[f"C{last}_1", "1"]["Net"] == "+15V"
    assert pins[f"C{last}_2", "2"]["Net"] == "-15V"
