"""Who may import whom: the floors of the house, the three witnesses, a light command line."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from scripts.rooms import ENTRY, FLOORS, FOLDERS, ROOMS, arrows, below, imports, modules, room_of
from taction.system.results import load
from tests.support.paths import ROOT

# The three witnesses of a verdict. None may reach another one's modules, however long the way, else
# two of them could be wrong together. A name stands for a module or a package and all below it;
# what stands earlier in the table is not part of what stands later.
# These read the scene and ask the reference solver; the solver itself does not know them.
ASKS_THE_REFERENCE = tuple(
    f"verification.reference.{name}" for name in ("ideal_answer", "lambda_rule")
)
WITNESSES = {
    "ngspice": ("verification.engines.ngspice",),
    "state space": ("verification.engines.statespace",),
    "reference": ("verification.reference",),
}

# What else a witness must not know: ngspice sees the deck, the state space the circuit, and the
# reference solver the problem.
UNKNOWN = {
    "ngspice": (
        *(f"netlist_gen.{name}" for name in ("scene.scene", "scene.inverse_problem", "topologies")),
        *("netlist_gen.board.synthesis", "netlist_gen.board.circuit", "spice_models.opamp"),
    ),
    "state space": (
        *(f"netlist_gen.{name}" for name in ("scene.scene", "scene.inverse_problem", "topologies")),
        *("netlist_gen.board.synthesis", "netlist_gen.deck.deck", "spice_models.subcircuits"),
    ),
    "reference": (
        *("netlist_gen.board", "netlist_gen.topologies", "netlist_gen.deck"),
        *("spice_models.opamp", "spice_models.subcircuits"),
    ),
}

HEAVY = ("numpy", "scipy", "pydantic", "PySpice", "matplotlib", "mpmath")
# Inside the reports: what is shown, then how, then what each result shows.
REPORT_LAYERS = ("texts", "blocks", "output_checks", "renderers", "views")


def reached(module: str) -> set[str]:
    """Everything that `module` imports, directly or through others."""
    seen: set[str] = set()
    todo = [module]
    while todo:
        new = imports(todo.pop()) - seen
        seen |= new
        todo.extend(new)
    return seen


def test_what_is_in_no_room_is_the_empty_face_of_a_folder() -> None:
    faces = {module for module in modules() if room_of(module) is None}
    assert faces == {"verification", "verification.engines"}
    assert all(not imports(face) for face in faces)


def wrong_imports(modules_of: tuple[str, ...], allowed: Callable[[str], bool]) -> list[str]:
    """Return the imports of modules below these that are not allowed."""
    own = [each for each in modules() if below(each, modules_of) and each != ENTRY]
    assert own
    return [f"{each} imports {name}" for each in own for name in imports(each) if not allowed(name)]


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_imports_only_from_itself_and_from_the_floors_below(room: str) -> None:
    floor = next(number for number, rooms in enumerate(FLOORS) if room in rooms)
    rooms = {None, room, *(name for rooms in FLOORS[:floor] for name in rooms)}
    assert wrong_imports((room,), lambda name: room_of(name) in rooms) == []


@pytest.mark.parametrize("layer", REPORT_LAYERS)
def test_a_layer_of_the_reports_imports_only_from_the_layers_below(layer: str) -> None:
    room = "verification.report."
    low = (*REPORT_LAYERS[: REPORT_LAYERS.index(layer) + 1], "documents")

    def allowed(name: str) -> bool:
        return not name.startswith(room) or name.split(".")[2] in low

    assert wrong_imports((room + layer,), allowed) == []


def test_few_arrows_lead_from_room_to_room() -> None:
    assert len(arrows()) <= 80


def test_no_module_imports_itself_in_a_circle() -> None:
    assert [module for module in modules() if module in reached(module)] == []


def test_the_name_of_a_class_stands_for_one_class() -> None:
    places: dict[str, list[str]] = {}
    for module, path in modules().items():
        for name in re.findall(r"^ *class (\w+)[:(\[]", path.read_text("utf-8"), re.MULTILINE):
            places.setdefault(name, []).append(module)
    assert {name: found for name, found in places.items() if len(found) > 1} == {}
    assert len(places) > 400


def test_no_import_names_a_folder_without_taction() -> None:
    """A module that is imported by two names exists twice, with two sets of classes."""
    short = re.compile(rf"^ *(?:from|import) (?:{'|'.join(FOLDERS)})\b.*", re.MULTILINE)
    assert short.search("def f():\n    from cli.main import main\n")
    wrong = [
        f"{path.relative_to(ROOT)}: {found[0]}"
        for folder in ("taction", "tests", "benchmarks", "docs", "scripts")
        for path in (ROOT / folder).rglob("*.py")
        for found in short.finditer(path.read_text("utf-8"))
        if path.name not in {Path(__file__).name, "test_packaging.py"}  # they quote such lines
    ]
    assert not wrong, "\n".join(wrong)


def witness_of(module: str) -> str | None:
    if below(module, ASKS_THE_REFERENCE):
        return "asks the reference"
    return next((name for name, own in WITNESSES.items() if below(module, own)), None)


@pytest.mark.parametrize("witness", WITNESSES)
def test_a_witness_does_not_know_the_others(witness: str) -> None:
    own = [module for module in modules() if witness_of(module) == witness]
    assert own
    known = [
        f"{module} reaches {name}"
        for module in own
        for name in sorted(reached(module))
        if below(name, UNKNOWN[witness]) or witness_of(name) not in {witness, None}
    ]
    assert not known, "\n".join(known)


def test_the_reference_of_a_scene_reads_no_number_of_the_synthesis() -> None:
    """Lambda, units and bias come from the scene, not from the board that they judge."""
    board = ("netlist_gen.board", "netlist_gen.deck", "spice_models.subcircuits")
    own = [module for module in modules() if below(module, ASKS_THE_REFERENCE)]
    assert own
    known = {name for module in own for name in reached(module) if below(name, board)}
    assert not known


def test_help_loads_nothing_heavy() -> None:
    script = (
        "import sys\n"
        "from taction.cli.main import main\n"
        "sys.argv = ['taction', '--help']\n"
        "try:\n"
        "    main()\n"
        "except SystemExit as end:\n"
        "    assert not end.code, end.code\n"
        f"print(*sorted(set(sys.modules) & {set(HEAVY)!r}), file=sys.stderr)\n"
    )
    run = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert "verify" in run.stdout
    assert run.stderr.split() == []


def test_every_place_that_a_text_names_exists() -> None:
    """Tables name functions by texts, which are imported when a command needs them."""
    place = re.compile(rf'"(?:taction\.)?((?:{"|".join(FOLDERS)})(?:\.\w+)*:[\w.]+)"')
    texts = {found for path in modules().values() for found in place.findall(path.read_text())}
    assert len(texts) > 20
    for found in texts:
        assert callable(load(f"taction.{found}")), found
