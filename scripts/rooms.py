"""The rooms of the house, the floors they are on, and who imports whom, read from the imports.

`tests/project/test_imports.py` holds the order.
"""

from __future__ import annotations

import ast
from collections import Counter
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

PACKAGE = ROOT / "taction"
# The folders of the package; the files beside them are the room `door`.
FOLDERS = ("system", "spice_models", "netlist_gen", "verification", "cli")

# The floors of the house, the lowest first, and the rooms on each. A room imports from itself and
# from the floors below, never from another room of its own floor. All names are below `taction`.
FLOORS: tuple[tuple[str, ...], ...] = (
    ("system", "spice_models"),
    ("netlist_gen",),
    ("verification.reference", "verification.engines.ngspice", "verification.engines.statespace"),
    ("verification.readings", "verification.stability", "verification.characterise"),
    ("verification.verdict",),
    ("verification.studies",),
    ("verification.design", "verification.evidence"),
    ("verification.report",),
    ("door",),
    ("cli",),
)
ROOMS = tuple(room for floor in FLOORS for room in floor)

# The command's entry point stands in `taction` for its name's sake and above all floors.
ENTRY = "door.__main__"


@cache
def modules() -> dict[str, Path]:
    """Return every module of ours by its name below `taction`; a package is its ``__init__``.

    The files of the folder `taction` itself are the room `door`.
    """
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        parts = parts if parts[0] in FOLDERS else ("door", *parts)
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def short(name: str) -> str:
    """Return the name of a module of ours below `taction`."""
    first, _, rest = name.partition(".")
    if first != "taction":
        return f"not ours: {name}"
    return rest if rest.partition(".")[0] in FOLDERS else f"door.{rest}".rstrip(".")


@cache
def imports(module: str) -> frozenset[str]:
    """Return our modules that `module` imports: at its top, in a function or for type checking.

    ValueError: a relative import, which hides the floor.
    """
    found: set[str] = set()
    for node in ast.walk(ast.parse(modules()[module].read_text("utf-8"))):
        if isinstance(node, ast.Import):
            found |= {short(alias.name) for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            if node.level:
                raise ValueError(f"{module} line {node.lineno}: a relative import hides the floor")
            for alias in node.names:
                name = short(f"{node.module}.{alias.name}")
                found.add(name if name in modules() else short(str(node.module)))
    return frozenset((found & modules().keys()) - {module})


def below(name: str, roots: tuple[str, ...]) -> bool:
    """Tell whether `name` is one of `roots`, or stands below one."""
    return any(name == root or name.startswith(root + ".") for root in roots)


def room_of(module: str) -> str | None:
    """Return the room that a module is in; None for the face of a package above the rooms."""
    return max((room for room in ROOMS if below(module, (room,))), key=len, default=None)


def arrows() -> dict[tuple[str, str], int]:
    """Return how many imports of modules lead from a room to another one."""
    found = Counter[tuple[str, str]]()
    for module in modules().keys() - {ENTRY}:
        room, others = room_of(module), map(room_of, imports(module))
        found.update((room, other) for other in others if room and other and other != room)
    return found
