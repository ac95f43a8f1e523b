"""KiCad projects without KiCad; ``tests/kicad`` lets KiCad read them."""

from __future__ import annotations

import csv
import json
import re
from typing import Any

import pytest

from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.kicad.board import KicadProject, kicad_project
from taction.netlist_gen.kicad.sheet import Quoted, written
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.open_tables import OPAMPS
from taction.netlist_gen.scene.scene import Scene
from tests.support.making import make_scene
from tests.support.paths import SCENES

OPEN, CLOSE = "()"
TOKEN = re.compile(r'[()]|"(?:\\.|[^"\\])*"|[^\s()"]+')


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


def test_texts_with_quotes_and_lines_stay_one_text() -> None:
    text = 'a "quoted" \\ backslash\nand a (second) line'
    assert parsed(written(["text", Quoted(text), ["at", 1.27 * 3, -0.0, 1e-9]])) == [
        *("text", text),
        ["at", "3.81", "0", "0"],
    ]


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


def test_the_list_has_every_part_of_the_board_once() -> None:
    circuit = synthesise(custom())
    files = project_of(custom()).files
    rows = list(csv.DictReader(files["custom-matrix-bom.csv"].splitlines()))
    listed = [name for row in rows for name in row["Reference"].split(",")]
    assert len(set(listed)) == len(listed) == sum(int(row["Qty"]) for row in rows)
    # 66 resistors and 4 capacitors (docs/parts.md), 19 packages with 2 capacitors each
    assert len(listed) == 66 + 4 + 19 + 38
    assert len(circuit.opamps) == 19
    (opamps,) = (row for row in rows if row["MPN"] == "OPA189")
    assert opamps["Reference"] == ",".join(f"U{k}" for k in range(1, 20))


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


def test_a_package_of_another_size_has_no_pin_numbers() -> None:
    opamp = {"base": "tl084", "channels_per_package": 3}
    project = project_of(make_scene(design={"opamp": opamp}))
    assert package_pins(project, "TL084")[:6] == ["A-", "A+", "Aout", "B-", "B+", "Bout"]
    drawn = (fields(each) for tree in schematics(project) for each in items(tree, "symbol"))
    unit = next(each for each in drawn if each["Value"] == "TL084")
    assert unit["MPN"] == ""  # no TL084 has three op-amps


def test_what_is_missing_is_said() -> None:
    decompensated = project_of(make_scene(design={"opamp": "ne5534"}))
    assert "the compensation capacitor of 22 pF of each op-amp" in decompensated.not_drawn
