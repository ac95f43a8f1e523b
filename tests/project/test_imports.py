"""Who may import whom: the floors of the house, the three witnesses, a light command line."""

from __future__ import annotations

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from tests.support.paths import ROOT

PACKAGES = ("spice_models", "netlist_gen", "verification", "taction", "cli")

# The floors of the house, the lowest first, and the rooms on each. A room imports from itself and
# from the floors below, never from another room of its own floor. A longer name wins over a
# shorter one: `verification.waveforms` is a room of its own.
FLOORS: tuple[tuple[str, ...], ...] = (
    ("spice_models",),
    ("netlist_gen", "verification.waveforms", "verification.reference", "verification.measures"),
    ("verification.engines.ngspice", "verification.engines.statespace", "verification.ideal"),
    ("verification.small_signal", "verification.characterise"),
    ("verification.pipeline",),
    ("verification.verify",),
    ("verification.studies",),
    ("verification.report",),
    ("taction",),
    ("cli",),
)
ROOMS = tuple(room for floor in FLOORS for room in floor)

# The command's entry point stands in `taction` for its name's sake and above all floors.
ENTRY = "taction.__main__"

# The wheel moves these below `taction` (setup.py).
MOVED = ("spice_models", "netlist_gen", "verification", "cli")

# The three witnesses of a verdict. None may reach another one's modules, however long the way, else
# two of them could be wrong together. A name stands for a module or a package and all below it;
# what stands earlier in the table is not part of what stands later.
WITNESSES = {
    "ngspice": ("verification.engines.ngspice",),
    "state space": ("verification.engines.statespace",),
    "reference": ("verification.reference",),
}

# What else a witness must not know: ngspice sees the deck, the state space the circuit, and the
# reference solver the problem.
UNKNOWN = {
    "ngspice": (
        "netlist_gen.scene.scene",
        "netlist_gen.problem.inverse_problem",
        "netlist_gen.board.synthesis",
        "netlist_gen.board.circuit",
        "netlist_gen.board.components",
        "spice_models.opamp",
    ),
    "state space": (
        "netlist_gen.scene.scene",
        "netlist_gen.problem.inverse_problem",
        "netlist_gen.board.synthesis",
        "netlist_gen.deck.deck",
        "spice_models.subcircuits",
    ),
    "reference": (
        "netlist_gen.board",
        "netlist_gen.deck",
        "spice_models.opamp",
        "spice_models.subcircuits",
    ),
}

HEAVY = ("numpy", "scipy", "pydantic", "PySpice", "matplotlib", "mpmath")


@cache
def modules() -> dict[str, Path]:
    """Every module of ours by its dotted name; a package is its ``__init__``."""
    found = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@cache
def imports(module: str) -> frozenset[str]:
    """Our modules that `module` imports: at its top, in a function or for type checking."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(modules()[module].read_text("utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module} line {node.lineno}: relative imports hide the floor"
            for alias in node.names:
                name = f"{node.module}.{alias.name}"
                found.add(name if name in modules() else str(node.module))
    return frozenset(found & modules().keys())


def reached(module: str) -> set[str]:
    """Everything that `module` imports, directly or through others."""
    seen: set[str] = set()
    todo = [module]
    while todo:
        new = imports(todo.pop()) - seen
        seen |= new
        todo.extend(new)
    return seen


def below(name: str, roots: tuple[str, ...]) -> bool:
    return any(name == root or name.startswith(root + ".") for root in roots)


def room_of(module: str) -> str | None:
    """The room that a module is in; None for the face of a package above the rooms."""
    return max((room for room in ROOMS if below(module, (room,))), key=len, default=None)


def test_what_is_in_no_room_is_the_empty_face_of_a_folder() -> None:
    faces = {module for module in modules() if room_of(module) is None}
    assert faces == {"verification", "verification.engines"}
    assert all(not imports(face) for face in faces)


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_imports_only_from_itself_and_from_the_floors_below(room: str) -> None:
    floor = next(number for number, rooms in enumerate(FLOORS) if room in rooms)
    allowed = {None, room, *(name for rooms in FLOORS[:floor] for name in rooms)}
    own = [module for module in modules() if room_of(module) == room]
    assert own
    wrong = [
        f"{module} imports {name}"
        for module in own
        if module != ENTRY
        for name in sorted(imports(module))
        if room_of(name) not in allowed
    ]
    assert not wrong, "\n".join(wrong)


def test_no_module_imports_itself_in_a_circle() -> None:
    assert [module for module in modules() if module in reached(module)] == []


def strings(module: str) -> list[str]:
    """The strings of a module that are no docstrings."""
    tree = ast.parse(modules()[module].read_text("utf-8"))
    alone = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    constants = [node for node in ast.walk(tree) if isinstance(node, ast.Constant)]
    return [n.value for n in constants if isinstance(n.value, str) and id(n) not in alone]


def test_no_string_names_a_module_that_the_wheel_moves() -> None:
    """The build rewrites imports and nothing else; other names follow from ``__name__``."""
    named = [
        f"{module}: {text!r}"
        for module in modules()
        for text in strings(module)
        if text in modules() and "." in text and below(text, MOVED)
    ]
    assert not named, "\n".join(named)


def test_imports_are_of_the_kinds_that_the_build_rewrites() -> None:
    unclear = [
        f"{module} line {node.lineno}"
        for module, path in modules().items()
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.Import)
        and any(below(name.name, MOVED) for name in node.names)
        and (len(node.names) > 1 or node.names[0].name not in MOVED or node.names[0].asname)
    ]
    assert not unclear, "\n".join(unclear)


def witness_of(module: str) -> str | None:
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
    own = [module for module in modules() if room_of(module) == "verification.ideal"]
    assert own
    known = {name for module in own for name in reached(module) if below(name, board)}
    assert not known


def test_help_loads_nothing_heavy() -> None:
    script = (
        "import sys\n"
        "from cli.main import main\n"
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
