"""The catalogue of stress cases: TOML files of one family each, and matrices made by name.

Numbers of a matrix come from Python's own generator and are rounded to 12 digits, so they are the
same on every processor. A file has a table ``[base]`` with the tables of a scene, over which those
of ``[case.NAME]`` are laid; beside them a case has the fields of `Case` from `why` to `decided`.
"""

from __future__ import annotations

import copy
import hashlib
import json
import random
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from taction.netlist_gen.scene.scene import Scene, parse_scene
from taction.system.documents import read
from taction.system.errors import Complaint, InputError, nearest_question

Rows = list[list[float]]


def make_array(spec: Any) -> Any:
    """Return the rows or values of a table ``make``; lists and names of files are unchanged."""
    if not isinstance(spec, Mapping):
        return spec
    arguments = dict(spec)
    return GENERATORS[arguments.pop("make")](**arguments)


def _rounded(value: float) -> float:
    return float(f"{value:.12g}")


def diagonal(values: Sequence[float]) -> Rows:
    """Return `values` on the diagonal."""
    return [[v * (i == j) for j in range(len(values))] for i, v in enumerate(values)]


def uniform(rows: int, columns: int, seed: int, low: float = -1.0, high: float = 1.0) -> Rows:
    """Return independent entries between `low` and `high`."""
    draw = random.Random(seed).uniform  # noqa: S311
    return [[_rounded(draw(low, high)) for _ in range(columns)] for _ in range(rows)]


def sparse(rows: int, columns: int, seed: int, share: float) -> Rows:
    """Return entries of which a `share` is not zero, at least one per row and per column."""
    draw = random.Random(seed)  # noqa: S311
    dense = uniform(rows, columns, seed + 1)
    kept = [[draw.random() < share for _ in range(columns)] for _ in range(rows)]
    for i in range(max(rows, columns)):
        kept[i % rows][i % columns] = True
    return [[x * k for x, k in zip(*pair, strict=True)] for pair in zip(dense, kept, strict=True)]


def blocks(size: int, block: int, seed: int) -> Rows:
    """Return independent blocks on the diagonal, which do not touch each other."""
    found = [[0.0] * size for _ in range(size)]
    for k in range(0, size, block):
        for i, row in enumerate(uniform(block, block, seed + k)):
            found[k + i][k : k + block] = row
    return found


def graded(rows: int, columns: int, seed: int, decades: float) -> Rows:
    """Return entries of both signs whose sizes are spread over `decades` below 1."""
    draw = random.Random(seed)  # noqa: S311
    exponents = [[-decades * draw.random() for _ in range(columns)] for _ in range(rows)]
    return [[_rounded(draw.choice((-1.0, 1.0)) * 10.0**e) for e in row] for row in exponents]


def hilbert(rows: int, columns: int) -> Rows:
    """Return ``1 / (i + j + 1)``."""
    return [[1.0 / (i + j + 1) for j in range(columns)] for i in range(rows)]


def singular(values: Sequence[float], seed: int) -> Rows:
    """Return a square matrix with these singular values, between two reflections."""
    size = len(values)
    draw = random.Random(seed)  # noqa: S311
    u, v = ([draw.uniform(-1.0, 1.0) for _ in range(size)] for _ in range(2))
    left, right = _reflection(u), _reflection(v)

    def entry(i: int, j: int) -> float:
        return _rounded(sum(left[i][k] * values[k] * right[k][j] for k in range(size)))

    return [[entry(i, j) for j in range(size)] for i in range(size)]


def _reflection(x: Sequence[float]) -> Rows:
    square = sum(value * value for value in x)
    return [[(i == j) - 2.0 * a * b / square for j, b in enumerate(x)] for i, a in enumerate(x)]


def drawn(size: int, seed: int, scale: float = 1.0) -> list[float]:
    """Return independent values between plus and minus `scale`."""
    return uniform(1, size, seed, -scale, scale)[0]


GENERATORS: dict[str, Callable[..., Rows | list[float]]] = {
    function.__name__: function
    for function in (diagonal, uniform, sparse, blocks, graded, hilbert, singular, drawn)
}


FOLDER = Path(__file__).parents[3] / "scenes" / "stress"
TRUE_VALUES = Path(__file__).parents[4] / "tests" / "data" / "true-values.json"
"""The true values of a checkout; an installed taction has none, and judges outcomes only."""
ENGINES = ("ngspice", "statespace")


@dataclass(frozen=True, slots=True)
class TrueValues:
    """The true readings of a case's board."""

    amplitude: float  # of the step, V
    rightmost: tuple[float, float]  # pole, 1/s
    steady_state: float  # largest distance of the equilibrium from the reference, of the step
    channels: tuple[Mapping[str, float], ...]  # the `READINGS` and `final` that exist
    error: float  # of the numbers: relative for times, of the step for the others
    by: str  # how the numbers were computed
    arrives: bool = True  # False: stable, but the transient leaves every bound
    readable: bool = True  # False: it rings for so many periods that readings were not computed
    margin: float | None = None  # factor by which C shrinks until the board oscillates, if known


@dataclass(frozen=True, slots=True)
class Case:
    """One scene with its right outcome, the first of those that are accepted."""

    name: str
    family: str  # stem of the case's file
    why: str  # why the scene is hard
    known: str  # how the right outcome is known
    outcome: Mapping[str, tuple[str, ...]]  # by engine: of a verdict, or names of exceptions
    decided: Mapping[str, str]  # outcomes of single checks, on every engine
    tables: Mapping[str, Any]  # of the scene
    truth: TrueValues | None  # None where the scene is refused, or where they are not stored

    @property
    def refused(self) -> bool:
        """Whether the scene is bad input, of which no board can be made."""
        return any(InputError.__name__ in words for words in self.outcome.values())

    @property
    def digest(self) -> str:
        """Digest of the tables: the true values hold for the tables of which they have it."""
        text = json.dumps(self.tables, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def scene(self, engine: str | None = None) -> Scene:
        """Return the scene of the case, for its own or another engine; InputError if refused."""
        tables = copy.deepcopy(dict(self.tables))
        problem = tables.get("problem", {})
        for key in ("matrix", "strain", "stress"):
            if key in problem:
                problem[key] = make_array(problem[key])
        scene = parse_scene(tables | {"name": self.name}, FOLDER / f"{self.family}.toml")
        return scene if engine is None else scene.with_engine(engine)


def load_catalogue(folder: Path = FOLDER) -> tuple[Case, ...]:
    """Return all cases by family, in the order of their files."""
    return tuple(case for path in sorted(folder.glob("*.toml")) for case in _cases(path))


@cache
def stored_values() -> dict[str, dict[str, Any]]:
    """Return the records of the true values by the names of their cases; empty if installed."""
    return json.loads(TRUE_VALUES.read_text("utf-8")) if TRUE_VALUES.exists() else {}


def select(cases: tuple[Case, ...], names: tuple[str, ...]) -> tuple[Case, ...]:
    """Return the cases with one of `names`, of cases or families; all for none."""
    known = {case.name for case in cases} | {case.family for case in cases}
    for name in names:
        if name not in known:
            text = f"no such case or family; {nearest_question(name, sorted(known), 0.0)}".rstrip()
            raise InputError("--only", Complaint("NAME", repr(name), text))
    return tuple(c for c in cases if not names or c.name in names or c.family in names)


def _cases(path: Path) -> Iterator[Case]:
    document = tomllib.loads(path.read_text("utf-8"))
    for name, table in document["case"].items():
        own = dict(table)
        why, known, decided = own.pop("why"), own.pop("known"), own.pop("decided", {})
        outcome = own.pop("outcome")
        if not isinstance(outcome, dict):
            engines = ENGINES[-1:] if outcome == InputError.__name__ else ENGINES
            outcome = dict.fromkeys(engines, outcome)
        right = {e: (x,) if isinstance(x, str) else tuple(x) for e, x in outcome.items()}
        tables = _laid_over(document.get("base", {}), own)
        record = stored_values().get(name, {}).get("truth")
        truth = record and read(TrueValues, record)
        yield Case(name, path.stem, why, known, right, decided, tables, truth)


def _laid_over(base: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """Return `base` with the values of `own` in their places."""
    merged = dict(base)
    for key, value in own.items():
        both = isinstance(value, Mapping) and isinstance(merged.get(key), Mapping)
        whole = both and not {"make", "kind"} & value.keys()  # such a table is replaced
        merged[key] = _laid_over(merged[key], value) if whole else value
    return merged
