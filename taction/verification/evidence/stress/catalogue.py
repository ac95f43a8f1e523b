"""The catalogue of stress cases: TOML files of one family each.

A file has a table ``[base]`` with the tables of a scene, and tables ``[case.NAME]`` whose tables of
a scene are laid over the base. Beside them a case has the fields of
`Case` from `why` to `decided`.
"""

from __future__ import annotations

import copy
import difflib
import hashlib
import json
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from taction.netlist_gen.scene.scene import Scene, parse_scene
from taction.system.errors import Complaint, InputError
from taction.verification.evidence.stress.matrices import make_array
from taction.verification.evidence.stress.true_values import TrueValues

FOLDER = Path(__file__).parents[3] / "scenes" / "stress"
TRUE_VALUES = Path(__file__).parents[4] / "tests" / "data" / "true-values.json"
"""The true values of a checkout; an installed taction has none, and judges outcomes only."""
ENGINES = ("ngspice", "statespace")


@dataclass(frozen=True, slots=True)
class Case:
    """One scene with its right outcome.

    The first outcome of an engine is the right one; others are accepted where the accuracy of the
    engine decides, and none of them contradicts the first. Bad input is refused before an engine is
    chosen, so it has one engine.
    """

    name: str
    family: str  # stem of the case's file
    why: str  # why the scene is hard
    known: str  # how the right outcome is known
    outcome: Mapping[str, tuple[str, ...]]  # by engine: of a verdict, or names of exceptions
    decided: Mapping[str, str]  # outcomes of single checks, on every engine
    tables: Mapping[str, Any]  # of the scene
    truth: TrueValues | None  # None where the scene is refused, or where they are not stored

    @property
    def engines(self) -> tuple[str, ...]:
        """The engines that the case runs on."""
        return tuple(self.outcome)

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
    stored: dict[str, dict[str, Any]] = {}
    if TRUE_VALUES.exists():
        stored = json.loads(TRUE_VALUES.read_text("utf-8"))
    return stored


def select(cases: tuple[Case, ...], names: tuple[str, ...]) -> tuple[Case, ...]:
    """Return the cases with one of `names`, of cases or families; all for none.

    InputError for a name that is neither has the nearest.
    """
    known = {case.name for case in cases} | {case.family for case in cases}
    for name in names:
        if name not in known:
            close = difflib.get_close_matches(name, sorted(known), n=1, cutoff=0.0)
            text = f"no such case or family; did you mean {close[0]!r}?"
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
        truth = record and TrueValues.from_record(record)
        yield Case(name, path.stem, why, known, right, decided, tables, truth)


def _laid_over(base: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """Return `base` with the values of `own` in their places."""
    merged = dict(base)
    for key, value in own.items():
        both = isinstance(value, Mapping) and isinstance(merged.get(key), Mapping)
        whole = both and not {"make", "kind"} & value.keys()  # such a table is replaced
        merged[key] = _laid_over(merged[key], value) if whole else value
    return merged
