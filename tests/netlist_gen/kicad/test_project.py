"""KiCad projects without KiCad; ``tests/kicad`` lets KiCad read them."""

from __future__ import annotations

import csv
import json
import re
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.kicad.project import KicadProject, kicad_project
from taction.netlist_gen.kicad.sheet import Quoted, written
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.open_tables import OPAMPS
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import InputError
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


def project_of(scene: Scene, channel: int = 1) -> KicadProject:
    return kicad_project(synthesise(scene), scene, channel)


def custom() -> Scene:
    return load_scene(SCENES / "custom-matrix.toml")


def schematic(project: KicadProject) -> Any:
    (text,) = (text for name, text in project.files.items() if name.endswith(".kicad_sch"))
    return parsed(text)


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
    tree = schematic(project_of(custom()))
    library = {symbol[1] for symbol in items(items(tree, "lib_symbols")[0], "symbol")}
    placed = items(tree, "symbol")
    assert {symbol[1][1] for symbol in placed} == library
    parts = [(fields(each)["Reference"], *items(each, "unit")[0]) for each in placed]
    assert len(set(parts)) == len(parts)
    assert all(reference[-1].isdigit() for reference, *_ in parts)
    values = {fields(each)["Reference"]: fields(each)["Value"] for each in placed}
    assert (values["Rr_1"], values["Cc_1"], values["Ra_in_1"]) == ("2.5M", "100p", "10k")
    assert values["U1"] == "OPA189"


def test_all_ends_are_on_the_grid_and_wires_are_straight() -> None:
    tree = schematic(project_of(load_scene(SCENES / "paper-exponential-devices.toml"), 3))
    for wire in items(tree, "wire"):
        (x, y), (other, below) = [list(map(float, point[1:])) for point in wire[1][1:]]
        assert (x == other) != (y == below)
        assert all(abs(each / 1.27 - round(each / 1.27)) < 1e-6 for each in (x, y, other, below))


def test_the_same_scene_gives_the_same_files() -> None:
    assert project_of(custom(), 2).files == project_of(custom(), 2).files
    first, second = (project_of(custom(), channel).files for channel in (1, 2))
    same = {"custom-matrix.kicad_sym", "sym-lib-table", "custom-matrix-bom.csv"}
    assert first.keys() & second.keys() == same
    assert all(first[name] == second[name] for name in same)


def test_the_row_is_the_one_that_the_channel_drives_most() -> None:
    T = np.loadtxt(SCENES / "custom-matrix" / "T.csv", delimiter=",")
    expected = (1 + np.argmax(np.abs(T), axis=0)).tolist()
    assert [project_of(custom(), channel).row for channel in (1, 2, 3, 4)] == expected


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


@pytest.mark.parametrize(("channel", "says"), [(0, "4 channels"), (5, "4 channels")])
def test_a_channel_that_is_not_there_is_refused(channel: int, says: str) -> None:
    with pytest.raises(InputError, match=says):
        project_of(custom(), channel)


def test_a_channel_without_resistors_is_refused() -> None:
    problem = {"kind": "matrix", "matrix": [[1.0, 0.0], [0.5, 0.0]], "strain": [1.0, 0.0]}
    with pytest.raises(InputError, match="no resistor in the matrix"):
        project_of(make_scene(problem), 2)


@pytest.mark.parametrize("name", sorted(OPAMPS))
def test_every_package_has_as_many_pins_as_its_op_amps_need(name: str) -> None:
    """Op-amps whose pins are not those of all makers have names instead of numbers."""
    supply = {"ad8065": 5.0, "lmp7721": 2.5}.get(name, 15.0)
    tree = schematic(project_of(make_scene(design={"opamp": name, "supply": supply})))
    symbols = items(items(tree, "lib_symbols")[0], "symbol")
    (package,) = (symbol for symbol in symbols if symbol[1] == f"taction:{name.upper()}")
    drawn = [pin for unit in items(package, "symbol") for pin in items(unit, "pin")]
    pins = [items(pin, "number")[0][1] for pin in drawn]
    count = OPAMPS[name].channels_per_package
    assert len(set(pins)) == len(pins) == 3 * count + 2
    if name in ("ideal", "lmp7721"):
        assert not any(pin.isdigit() for pin in pins)
    else:
        assert max(map(int, pins)) <= {1: 8, 2: 8, 4: 14}[count]


def test_a_package_of_another_size_has_no_pin_numbers() -> None:
    opamp = {"base": "tl084", "channels_per_package": 3}
    tree = schematic(project_of(make_scene(design={"opamp": opamp})))
    symbols = items(items(tree, "lib_symbols")[0], "symbol")
    (package,) = (symbol for symbol in symbols if symbol[1] == "taction:TL084")
    drawn = [pin for unit in items(package, "symbol") for pin in items(unit, "pin")]
    pins = [items(pin, "number")[0][1] for pin in drawn]
    assert pins[:6] == ["A-", "A+", "Aout", "B-", "B+", "Bout"]
    (unit, *_) = (
        fields(each) for each in items(tree, "symbol") if fields(each)["Value"] == "TL084"
    )
    assert unit["MPN"] == ""  # no TL084 has three op-amps


def test_what_is_missing_is_said() -> None:
    decompensated = project_of(make_scene(design={"opamp": "ne5534"}))
    assert "the compensation capacitor of 22 pF of each op-amp" in decompensated.not_drawn
