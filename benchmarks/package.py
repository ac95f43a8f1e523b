"""What an installation costs: time of the import, and size of the core and of each extra.

`import taction` loads a job at its first use; a board needs numpy, pydantic and parts of SciPy.
Sizes are those of the packages in this environment, without bytecode.
"""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from benchmarks.measuring import (
    ROOT,
    SCENES,
    Extent,
    Figure,
    Result,
    Table,
    in_turns,
    python,
    ratios,
)

ROUNDS = {Extent.TINY: 1, Extent.QUICK: 7, Extent.FULL: 20}
NAME = "taction"
DEVELOPMENT = "dev"
SCENE = SCENES / "paper-breadboard.toml"
LARGE = ("numpy", "scipy")
NOTHING, IMPORTS = "a Python that does nothing", "import of numpy and pydantic"
ALONE, BOARD = "import taction", "import taction, and synthesise a board"


def measure(extent: Extent) -> Result:
    """Measure imports in processes of their own, then the sizes."""
    times, table = import_times(ROUNDS[extent])
    size, sizes = installed_sizes()
    return Result([*times, size], [table, sizes])


def import_times(rounds: int) -> tuple[list[Figure], Table]:
    """Time processes that only import."""
    codes = {
        NOTHING: "",
        ALONE: "import taction",
        IMPORTS: "import numpy, pydantic",
        BOARD: f"import taction; taction.synthesise(taction.load_scene({str(SCENE)!r}))",
    }
    jobs = {what: (lambda code=code: python(code)) for what, code in codes.items()}
    costs = in_turns(jobs, rounds)
    clock = {what: [cost.wall for cost in found] for what, found in costs.items()}
    figures = [
        Figure(ALONE, NOTHING, ratios(clock[ALONE], clock[NOTHING])),
        Figure(BOARD, IMPORTS, ratios(clock[BOARD], clock[IMPORTS])),
    ]
    rows = [
        (
            what,
            f"{1e3 * sorted(clock[what])[rounds // 2]:.0f}",
            f"{max(c.memory for c in found):.0f}",
        )
        for what, found in costs.items()
    ]
    return figures, Table("Imports", ("", "median, ms", "MB of memory"), rows)


def installed_sizes() -> tuple[Figure, Table]:
    """Return the size of the core beside that of its largest packages, and the table of extras."""
    core = closure(NAME, frozenset())
    whole, large = sum(map(size, core)), sum(map(size, LARGE))
    rows = [("core", f"{len(core)}", megabytes(whole), largest(core))]
    for extra in sorted(metadata.metadata(NAME).get_all("Provides-Extra") or ()):
        if extra != DEVELOPMENT:
            more = closure(NAME, frozenset({extra})) - core
            rows.append((extra, f"{len(more)}", megabytes(sum(map(size, more))), largest(more)))
    columns = ("", "packages", "MB", "largest")
    table = Table("Installed sizes, of an extra what it adds to the core", columns, rows)
    figure = Figure("installed core", "numpy and scipy", [whole / large], None, whole / 1e6, "MB")
    return figure, table


def largest(packages: frozenset[str]) -> str:
    """Return the names of the three largest packages."""
    return ", ".join(sorted(packages, key=size, reverse=True)[:3])


def megabytes(size: int) -> str:
    """Return a size as text."""
    return f"{size / 1e6:.1f}"


def closure(name: str, extras: frozenset[str]) -> frozenset[str]:
    """Return the packages that an installation of `name` with `extras` brings, with itself."""
    found: set[str] = set()
    todo = [(canonicalize_name(name), extras)]
    seen: set[tuple[str, frozenset[str]]] = set()
    while todo:
        each = todo.pop()
        if each in seen:
            continue
        seen.add(each)
        package, wanted = each
        try:
            needs = metadata.requires(package) or ()
        except metadata.PackageNotFoundError:  # of an extra that is not installed here
            continue
        found.add(package)
        for need in map(Requirement, needs):
            if need.marker is None or any(
                need.marker.evaluate({"extra": extra}) for extra in wanted or {""}
            ):
                todo.append((canonicalize_name(need.name), frozenset(need.extras)))
    return frozenset(found)


def size(name: str) -> int:
    """Return the size of the files of an installed package, bytes; bytecode does not count."""
    if name == NAME:  # here the checkout itself
        own = (file for file in (ROOT / "taction").rglob("*"))
    else:
        own = (Path(str(file.locate())) for file in metadata.files(name) or ())
    return sum(
        file.stat().st_size for file in own if file.is_file() and "__pycache__" not in file.parts
    )
