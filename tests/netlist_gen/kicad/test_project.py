"""KiCad projects and lists of wires beside the circuit; ``tests/kicad`` lets KiCad read them."""

from __future__ import annotations

import csv
import json
import re
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lxml import etree

import taction
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.kicad.board import channel_sheet, kicad_project
from taction.netlist_gen.kicad.part_symbols import BoardParts, reference, wiring
from taction.netlist_gen.kicad.sheet import Label, SchematicSheet
from taction.netlist_gen.scene.open_tables import OPAMPS
from taction.netlist_gen.scene.scene import Scene, load_scene, parse_scene
from tests.support.making import make_scene
from tests.support.paths import SCENES

OPEN, CLOSE = "()"
TOKEN = re.compile(r'[()]|"(?:\\.|[^"\\])*"|[^\s()"]+')
DEVICES = {"amplifier": "exponential", "exponential_slope": "100mV", "antilog": "device"}
NPN = {**DEVICES, "antilog": {"stage": "device", "transistors": "ssm2212"}}
PASSIVE = {"topology": "passive", "lambda": 100.0}
BENT = {"amplifier": "exponential", "exponential_slope": "1V", "bias": False, **PASSIVE}
ONE = {"matrix": np.array([[-0.7]]), "strain": np.array([0.3])}
MATRIX = {"matrix": [[1.0, 0.0], [0.5, 0.0]], "strain": [1.0, 0.0]}
THREE = {"channels": 3}
MADE: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "quad": (THREE, {"opamp": "tl074", "strain_input": "voltage"}),
    "npn": (THREE, {"opamp": "tl072", **NPN}),
    "pnp": (THREE, {"opamp": "ua741", **DEVICES}),
    "passive": (THREE, {"opamp": "tl072", **PASSIVE}),
    "passive exponential": (THREE, BENT),
    "wide": ({"channels": 70, "span": 40.0}, {"opamp": "tl084"}),
    # A column and a row without entries have sheets, too.
    "empty column": ({"kind": "matrix", **MATRIX}, {}),
}
NAMES = (
    *("new", "one by one", *MADE, "paper-breadboard.toml", "custom-matrix.toml"),
    "least-squares.toml",  # its columns have no op-amp at their nodes
    *("paper-exponential.toml", "paper-exponential-devices.toml", "tangential-exponential.toml"),
)
# Pins -, +, output of the op-amps A, B ... as the data sheets of the TL084 and the TL072 draw them.
SHEETS = {
    "TL084": (("2", "3", "1"), ("6", "5", "7"), ("9", "10", "8"), ("13", "12", "14")),
    "TL072": (("2", "3", "1"), ("6", "5", "7")),
    "UA741": (("2", "3", "6"),),
}
SHEETS |= {"TL074": SHEETS["TL084"], "OPA2134": SHEETS["TL072"], "OPA189": SHEETS["UA741"]}
RAILS = {"TL084": ("4", "11"), "TL072": ("8", "4"), "UA741": ("7", "4")}
RAILS |= {"TL074": RAILS["TL084"], "OPA2134": RAILS["TL072"], "OPA189": RAILS["UA741"]}


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


def project_of(scene: Scene) -> dict[str, str]:
    return kicad_project(synthesise(scene), scene)


def custom() -> Scene:
    return load_scene(SCENES / "custom-matrix.toml")


@pytest.mark.parametrize("file", ["custom-matrix", "inverse", "paper-exponential-devices"])
def test_one_channel_is_a_picture_with_every_part_of_its_sheet(file: str) -> None:
    scene = load_scene(SCENES / f"{file}.toml")
    sheet = channel_sheet(synthesise(scene), scene, 0, 0)
    texts = [each.text for each in etree.fromstring(sheet.svg()).iter("text")]
    cards = {each.part.fields["Deck"] for each in sheet.placed if "Deck" in each.part.fields}
    assert "Rf_1_1" in cards
    assert cards <= set(texts)
    assert not any(re.fullmatch(r"R[fb]_(?!1_1).*", text) for text in texts)


def test_a_text_in_a_picture_is_no_markup() -> None:
    sheet = SchematicSheet("one", labels=[Label("<b>&", (0, 0))])
    sheet.wire((0, 0), (4, 0))
    assert "&lt;b&gt;&amp;</text>" in sheet.svg()


def schematics(project: dict[str, str]) -> list[Any]:
    """All sheets, each parsed."""
    return [parsed(text) for name, text in project.items() if name.endswith(".kicad_sch")]


def package_pins(project: dict[str, str], name: str) -> list[str]:
    """The numbers of the pins of a package, as the library has them."""
    symbols = items(parsed(project["scene.kicad_sym"]), "symbol")
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


def scene_of(name: str, folder: Path) -> Scene:
    """Return a scene of `NAMES`."""
    if name == "new":
        taction.new(file=folder / "new.toml")
        return load_scene(folder / "new.toml")
    if name.endswith(".toml"):
        return load_scene(SCENES / name)
    rest = {"initial": "rest"}
    if name == "one by one":
        tables: dict[str, Any] = {
            "problem": {"kind": "matrix", **ONE},
            "design": {"opamp": "tl084", "bias": True, **NPN},
            "analysis": rest,
            "tolerances": {"resistor": 0.01},
        }
        return parse_scene(tables, "scene.toml")
    problem, design = MADE[name]
    return make_scene(problem, design=design, analysis=rest)


SLOW = pytest.param("wide", marks=pytest.mark.nightly)  # its 140 sheets take seconds to read


@pytest.fixture(scope="module", params=[SLOW if name == "wide" else name for name in NAMES])
def scene(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return scene_of(request.param, tmp_path_factory.mktemp("project"))


def sheets(files: dict[str, str]) -> dict[str, Any]:
    return {name: parsed(text) for name, text in files.items() if name.endswith(".kicad_sch")}


def two_ended(circuit: Circuit) -> Iterator[tuple[str, tuple[str, str]]]:
    """Every part with pins 1 and 2: its name in the deck, and their nodes."""
    for resistor in circuit.resistors:
        yield f"R{resistor.name}", (resistor.a, resistor.b)
    for matrix in circuit.matrices:
        for row, column, source, sink, _ in matrix.elements():
            yield f"{matrix.name}_{row + 1}_{column + 1}", (source, sink)
    for capacitor in circuit.capacitors:
        if not capacitor.name.startswith("stray_"):
            yield f"C{capacitor.name}", (capacitor.a, capacitor.b)
    for current in circuit.currents:
        yield f"I{current.name}", ("0", current.node)
    for amplifier in circuit.amplifiers:
        yield f"B{amplifier.name}", (amplifier.input, amplifier.output)
    for source in circuit.voltages:
        yield source.card, (source.node, "0")


def packing(circuit: Circuit) -> tuple[int, int]:
    size = next(iter(circuit.models.values())).channels_per_package
    return size, len(circuit.opamps)


def test_every_part_is_drawn_once(scene: Scene) -> None:
    circuit = synthesise(scene)
    drawn = Counter(
        (fields(symbol)["Reference"], items(symbol, "unit")[0][1])
        for tree in sheets(kicad_project(circuit, scene)).values()
        for symbol in items(tree, "symbol")
    )
    assert set(drawn.values()) == {1}  # also symbols of supplies, whose numbers are of the project
    references = {name for name, _ in drawn}
    assert {reference(name) for name, _ in two_ended(circuit) if name[0] in "RC"} <= references
    size, count = packing(circuit)
    for number in range(1, 1 + -(-count // size)):
        units = {int(unit) for name, unit in drawn if name == f"U{number}"}
        assert units == set(range(1, size + 2))  # used or not, and the supply


def test_the_wires_are_those_of_the_circuit(scene: Scene) -> None:
    """Every pin is on the net of its node; the number of a pin is that of the data sheet."""
    circuit = synthesise(scene)
    rows = list(csv.DictReader(wiring(BoardParts(circuit, scene)).splitlines()))
    rest = {(row["Part"], row["Pin"]): row["Net"] for row in rows}
    part_of = {row["Deck"]: row["Part"] for row in rows if row["Deck"]}
    values = {row["Part"]: row["Value"] for row in rows}
    size, count = packing(circuit)

    def take(part: str, pins: tuple[str, ...]) -> list[str]:
        return ["0" if net == "GND" else net for net in (rest.pop((part, pin)) for pin in pins)]

    def opamp(place: int) -> list[str]:
        part = f"U{place // size + 1}"
        return take(part, SHEETS.get(values[part], (("-", "+", "out"),))[place % size])

    for name, ends in two_ended(circuit):
        found = take(part_of[name], ("1", "2"))
        # Resistors and capacitors may be drawn either way round.
        assert found == list(ends) or (name[0] not in "IBV" and found[::-1] == list(ends))
    for place, cell in enumerate(circuit.opamps):
        assert opamp(place) == [cell.inverting, cell.noninverting, cell.output]
    for place, cell in enumerate(circuit.transistors):
        pins = tuple(f"{letter}{place % 2 + 1}" for letter in "CBE")
        assert take(f"Q{place // 2 + 1}", pins) == [cell.collector, cell.base, cell.emitter]
    used = [row["Net"] for row in rows]
    for place in range(count, size * -(-count // size)):
        minus, plus, out = opamp(place)
        assert (plus, minus) == ("0", out)  # a follower at ground, with nothing else
        assert used.count(out) == 2
    # All else is supply: packages, and capacitors from each rail to ground.
    rail = f"{circuit.supply:g}V"
    for (part, pin), net in rest.items():
        assert re.fullmatch(r"U\d+|CU\d+_[12]", part), (part, pin, net)
        plus, minus = RAILS.get(values[part], ("V+", "V-"))
        wanted = {plus: f"+{rail}", minus: f"-{rail}"}
        if part.startswith("C"):
            wanted = {"1": f"+{rail}", "2": "GND"}
            if part.endswith("_2"):
                wanted = {"1": "GND", "2": f"-{rail}"}
        assert net == wanted[pin]
    assert len(rest) == 6 * -(-count // size)


def drawn_at(tree: Any) -> tuple[complex, int]:
    """Where an item stands, mm, and how often it is turned by a right angle."""
    x, y, *angle = map(float, items(tree, "at")[0][1:])
    return complex(x, y), int(sum(angle) // 90)


def test_every_pin_meets_the_drawing_of_its_symbol(scene: Scene) -> None:
    library = parsed(project_of(scene)[f"{scene.name}.kicad_sym"])
    for unit in (unit for symbol in items(library, "symbol") for unit in items(symbol, "symbol")):
        paths = [[complex(*map(float, xy[1:])) for xy in e[1][1:]] for e in items(unit, "polyline")]
        radii = [float(items(each, "radius")[0][1]) for each in items(unit, "circle")]
        for pin in items(unit, "pin"):
            at, turns = drawn_at(pin)
            end = at + float(items(pin, "length")[0][1]) * 1j**turns
            away = [abs(abs(end) - radius) for radius in radii]
            for a, b in (ends for path in paths for ends in pairwise(path)):
                share = ((end - a) / (b - a)).real  # of the way from a to b, at the nearest point
                away.append(abs(end - a - min(max(share, 0.0), 1.0) * (b - a)))
            assert min(away) < 1e-6, (unit[1], pin)


def test_the_drawn_wires_are_those_of_the_list(scene: Scene) -> None:
    """Nets by places alone: wires and pins meet at their ends, and a label names its place."""
    circuit, found = synthesise(scene), list[tuple[str, str, str]]()
    for tree in sheets(kicad_project(circuit, scene)).values():
        wired, names, pins = dict[complex, set[complex]](), list[tuple[complex, str]](), []

        def on_grid(at: complex) -> complex:
            return complex(round(at.real / 1.27), round(at.imag / 1.27))

        for wire in items(tree, "wire"):
            ends = {on_grid(complex(*map(float, xy[1:]))) for xy in wire[1][1:]}
            joined = ends.union(*(wired.get(end, ()) for end in ends))
            wired |= dict.fromkeys(joined, joined)
        for label in items(tree, "label") + items(tree, "global_label"):
            names.append((on_grid(drawn_at(label)[0]), label[1]))
        library = {each[1]: each for each in items(items(tree, "lib_symbols")[0], "symbol")}
        for symbol in items(tree, "symbol"):
            (at, turns), texts = drawn_at(symbol), fields(symbol)
            unit = items(library[symbol[1][1]], "symbol")[int(items(symbol, "unit")[0][1]) - 1]
            for pin in items(unit, "pin"):  # of a symbol y is upwards
                place = on_grid(at + (drawn_at(pin)[0] * 1j**turns).conjugate())
                if texts["Reference"].startswith("#PWR"):
                    names.append((place, texts["Value"]))
                elif not texts["Reference"].startswith("#"):
                    number = "" if texts["Reference"][0] in "RC" else items(pin, "number")[0][1]
                    pins.append((texts["Reference"], number, place))  # R and C may be turned
        for part, number, place in pins:
            joined = wired.get(place, {place})
            (net,) = {name for there, name in names if there in joined}
            found.append((part, number, net))
    rows = csv.DictReader(wiring(BoardParts(circuit, scene)).splitlines())
    listed = [(r["Part"], "" if r["Part"][0] in "RC" else r["Pin"], r["Net"]) for r in rows]
    assert sorted(found) == sorted(listed)
