"""The rooms of the house, the floors they are on, and who imports whom, read from the imports.

``python scripts/rooms.py`` prints the rooms and their arrows, ``python scripts/rooms.py FILE.svg``
draws them. `tests/project/test_imports.py` holds the order; the documentation has the picture.
"""

from __future__ import annotations

import ast
import sys
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

NAMES = {"door": "taction"}
"""What the picture calls a room; else the last part of its name."""


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

    Raises
    ------
    ValueError
        A relative import, which hides the floor.
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
    found: dict[tuple[str, str], int] = {}
    for module in modules():
        room = room_of(module)
        if room is None or module == ENTRY:
            continue
        for name in imports(module):
            other = room_of(name)
            if other is not None and other != room:
                found[room, other] = found.get((room, other), 0) + 1
    return found


def lines() -> dict[str, int]:
    """Return the lines of every room; pages, styles and scripts of the browser count, too."""
    found = dict.fromkeys(ROOMS, 0)
    for module, path in modules().items():
        room = room_of(module)
        if room is not None:
            found[room] += len(path.read_text("utf-8").splitlines())
    page = PACKAGE / "verification" / "report"
    for path in page.rglob("*"):
        if path.suffix in {".css", ".js", ".html"}:
            found["verification.report"] += len(path.read_text("utf-8").splitlines())
    return found


WIDTH, ROW, BOX, HEIGHT = 900, 74, 190, 40  # of the picture, of a floor, of a room
STYLE = (
    "text{font-family:sans-serif;font-size:14px;fill:#222}"
    "rect{fill:#e8f0f8;stroke:#35618f;rx:6}"
    "path{fill:none;stroke:#8a8a8a;stroke-width:1.2;marker-end:url(#tip)}"
    ".lines{font-size:11px;fill:#555}"
)


def drawing() -> str:
    """Return the rooms on their floors as SVG; an arrow that follows from others is left out."""
    place, counted = {}, lines()
    for number, floor in enumerate(reversed(FLOORS)):
        for at, room in enumerate(floor):
            x = WIDTH * (at + 1) / (len(floor) + 1)
            place[room] = (x, ROW * number + HEIGHT)
    edges = set(arrows())
    far = {room: _reached(room, edges) for room in ROOMS}
    direct = [
        (a, b)
        for a, b in sorted(edges)
        if not any(b in far[c] for one, c in edges if one == a and c != b)
    ]
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {ROW * len(FLOORS) + 20}">',
        "<title>Rooms of taction: an arrow leads to what a room imports</title>",
        f"<style>{STYLE}</style>",
        '<defs><marker id="tip" markerWidth="8" markerHeight="8" refX="7" refY="3" orient="auto">'
        '<path d="M0,0 L7,3 L0,6" style="marker-end:none"/></marker></defs>',
        '<rect x="0" y="0" width="100%" height="100%" style="fill:white;stroke:none"/>',
    ]
    for a, b in direct:
        (x, y), (to, end) = place[a], place[b]
        start, end = y + HEIGHT / 2, end - HEIGHT / 2
        middle = (start + end) / 2
        curve = f"M{x:g},{start:g} C{x:g},{middle:g} {to:g},{middle:g} {to:g},{end:g}"
        parts.append(f'<path d="{curve}"/>')
    for room, (x, y) in place.items():
        name = NAMES.get(room, room.rpartition(".")[2])
        about = f"{counted[room]:,} lines"
        parts += [
            f'<rect x="{x - BOX / 2:g}" y="{y - HEIGHT / 2:g}" width="{BOX}" height="{HEIGHT}"/>',
            f'<text x="{x:g}" y="{y - 1:g}" text-anchor="middle">{name}/</text>',
            f'<text x="{x:g}" y="{y + 14:g}" text-anchor="middle" class="lines">{about}</text>',
        ]
    return "\n".join([*parts, "</svg>\n"])


def _reached(room: str, edges: set[tuple[str, str]]) -> set[str]:
    seen: set[str] = set()
    todo = [room]
    while todo:
        new = {b for a, b in edges if a == todo[0]} - seen
        todo = todo[1:] + sorted(new)
        seen |= new
    return seen


def main() -> None:
    """Print or draw the rooms."""
    if len(sys.argv) > 1:
        Path(sys.argv[1]).write_text(drawing(), encoding="utf-8")
        return
    counted, found = lines(), arrows()
    for number, floor in enumerate(FLOORS, 1):
        for room in floor:
            below_it = sorted(b.rpartition(".")[2] for a, b in found if a == room)
            print(f"{number:2} {room:32} {counted[room]:6,} lines -> {', '.join(below_it)}")
    about = f"{len(ROOMS)} rooms on {len(FLOORS)} floors, {len(found)} arrows"
    print(f"{about}, {sum(counted.values()):,} lines")


if __name__ == "__main__":
    main()
