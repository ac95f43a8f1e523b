"""KiCad projects and lists of wires, without KiCad; ``tests/kicad`` lets KiCad read them."""

from __future__ import annotations

import csv
import json
import re
from collections import Counter, defaultdict
from typing import Any

import pytest

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.kicad.board import KicadProject, kicad_project
from taction.netlist_gen.kicad.part_symbols import BoardParts, reference, wiring
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.open_tables import OPAMPS
from taction.netlist_gen.scene.scene import Scene
from tests.support.making import make_scene
from tests.support.paths import SCENES

OPEN, CLOSE = "()"
TOKEN = re.compile(r'[()]|"(?:\\.|[^"\\])*"|[^\s()"]+')
QUAD = {"opamp": "tl074", "strain_input": "voltage"}


def parsed(text: str) -> Any:
    """The nested lists of an S-expression, their atoms as text."""
    stack: list[list[Any]] = [[]]
    for token in TOKEN.findall(text):
        if token == OPEN:
            stack.append([])
        elif token == CLOSE:
            done = stack.pop()
            stack[-1].append(done)
        else:
            stack[-1].append(json.loads(token) if token[0] == '"' else token)
    ((whole,),) = stack
    return whole


def project_of(scene: Scene) -> KicadProject:
    return kicad_project(synthesise(scene), scene)


def custom() -> Scene:
    return load_scene(SCENES / "custom-matrix.toml")


def schematics(project: KicadProject) -> list[Any]:
    """All sheets, each parsed."""
    return [parsed(text) for name, text in project.files.items() if name.endswith(".kicad_sch")]


def package_pins(project: KicadProject, name: str) -> list[str]:
    """The numbers of the pins of a package, as the library has them."""
    symbols = items(parsed(project.files["scene.kicad_sym"]), "symbol")
    (package,) = (symbol for symbol in symbols if symbol[1] == name)
    drawn = [pin for unit in items(package, "symbol") for pin in items(unit, "pin")]
    return [items(pin, "number")[0][1] for pin in drawn]


def items(tree: Any, kind: str) -> list[Any]:
    return [item for item in tree if isinstance(item, list) and item[0] == kind]


def fields(symbol: Any) -> dict[str, str]:
    return {item[1]: item[2] for item in items(symbol, "property")}


def test_symbols_and_references() -> None:
    found = []
    for tree in schematics(project_of(custom())):
        library = {symbol[1] for symbol in items(items(tree, "lib_symbols")[0], "symbol")}
        assert {symbol[1][1] for symbol in items(tree, "symbol")} == library
        found += items(tree, "symbol")
    parts = [(fields(each)["Reference"], *items(each, "unit")[0]) for each in found]
    assert len(set(parts)) == len(parts)
    assert all(reference[-1].isdigit() for reference, *_ in parts)
    values = {fields(each)["Reference"]: fields(each)["Value"] for each in found}
    assert (values["Rr_1"], values["Cc_1"], values["Ra_in_1"]) == ("2.5M", "100p", "10k")
    assert values["U1"] == "OPA189"


def test_all_ends_are_on_the_grid_and_wires_are_straight() -> None:
    trees = schematics(project_of(load_scene(SCENES / "paper-exponential-devices.toml")))
    wires = [wire for tree in trees for wire in items(tree, "wire")]
    assert len(wires) > 100
    for wire in wires:
        (x, y), (other, below) = [list(map(float, point[1:])) for point in wire[1][1:]]
        assert (x == other) != (y == below)
        assert all(abs(each / 1.27 - round(each / 1.27)) < 1e-6 for each in (x, y, other, below))


@pytest.mark.parametrize("name", sorted(OPAMPS))
def test_every_package_has_as_many_pins_as_its_op_amps_need(name: str) -> None:
    """Op-amps whose pins are not those of all makers have names instead of numbers."""
    supply = {"ad8065": 5.0, "lmp7721": 2.5}.get(name, 15.0)
    project = project_of(make_scene(design={"opamp": name, "supply": supply}))
    pins = package_pins(project, name.upper())
    count = OPAMPS[name].channels_per_package
    assert len(set(pins)) == len(pins) == 3 * count + 2
    if name in ("ideal", "lmp7721"):
        assert not any(pin.isdigit() for pin in pins)
    else:
        assert max(map(int, pins)) <= {1: 8, 2: 8, 4: 14}[count]


def quad() -> Scene:
    return make_scene({"channels": 3, "span": 2.0}, design=QUAD)


SCENE_OF = {
    "quad": quad,
    "custom": lambda: load_scene(SCENES / "custom-matrix.toml"),
    "devices": lambda: load_scene(SCENES / "paper-exponential-devices.toml"),
    "passive": lambda: make_scene(
        {"channels": 3}, design={"topology": "passive", "opamp": "tl072", "lambda": 100.0}
    ),
    # Its columns have no op-amp at their nodes.
    "least squares": lambda: load_scene(SCENES / "least-squares.toml"),
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
    return list(csv.DictReader(wiring(BoardParts(circuit, scene)).splitlines()))


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
