"""The claims of the paper, and what a run of each claim found."""

from __future__ import annotations

import enum
import math
import string
import tomllib
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene
from taction.system.quantities import UNITS, show
from taction.verification.evidence.paper.pictures import Picture
from taction.verification.readings.readings import Reading

HERE = Path(__file__).parent
SCENES = HERE.parents[2] / "scenes"  # below taction, as a link or as files


class ClaimOutcome(enum.Enum):
    """The verdict on a claim; the value is the printed text."""

    HOLDS = "holds"
    FITTED = "consistent with a fitted board"
    CONDITION = "holds under a stated condition"
    FAILS = "does not hold"
    NOT_RUN = "could not be run"


@dataclass(frozen=True, slots=True)
class Claim:
    """One entry of ``claims.toml``.

    `chapter` is a key of `verification.evidence.paper.reproduce.CHAPTERS`; `place` says where the
    paper makes the claim; `printed` is the paper's value or formula, or empty. `run` and `ours`
    are templates of `Sentence`: what taction runs, and what the run gives. A verdict other than
    `expected` is a regression. A quick run leaves out a claim that is not `quick`.
    """

    id: str
    chapter: str
    place: str
    claim: str
    printed: str
    run: str
    ours: str
    expected: ClaimOutcome
    quick: bool = True


@dataclass(frozen=True, slots=True)
class Finding:
    """The result for the claim `id`: `run` and `ours` as sentences, `values` in SI base units."""

    id: str
    run: str
    ours: str
    outcome: ClaimOutcome
    values: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Chapter:
    """The findings of one chapter, and its pictures."""

    findings: tuple[Finding, ...]
    pictures: tuple[Picture, ...] = ()


class Sentence(string.Formatter):
    """Templates for numbers and lists of numbers.

    Beside Python's formats, ``{x:.3g%}`` writes a fraction as per cent and ``{t:s.3}`` writes a
    time in seconds with an SI prefix and three digits (four without ``.3``).
    """

    def format_field(self, value: Any, format_spec: str) -> str:
        """Return `value` as text; the numbers of a list are separated by commas."""
        values = value if isinstance(value, list | tuple) else [value]
        if format_spec.endswith("%"):
            return self.format_field([100.0 * v for v in values], format_spec[:-1]) + " %"
        unit, _, digits = format_spec.partition(".")
        if unit in UNITS:
            return ", ".join(show(v, unit, int(digits or 4)) for v in values)
        return ", ".join(format(v, format_spec) for v in values)


def finding(id_: str, values: dict[str, float], outcome: ClaimOutcome, **others: Any) -> Finding:
    """Return the finding on the claim `id_`: `values` and `others` fill the claim's templates."""
    claim = next(claim for claim in load_claims() if claim.id == id_)
    run, ours = (Sentence().format(text, **values, **others) for text in (claim.run, claim.ours))
    return Finding(id_, run, ours, outcome, values)


def weigh(always: bool, condition: bool = False, *, fitted: bool = False) -> ClaimOutcome:
    """Return the verdict on a claim that holds `always`, or only under its `condition`.

    A claim on a board whose parts were chosen so that the claim holds is `fitted`: the run shows
    that such a board exists, not that the paper's board was like that.
    """
    if always:
        return ClaimOutcome.FITTED if fitted else ClaimOutcome.HOLDS
    return ClaimOutcome.CONDITION if condition else ClaimOutcome.FAILS


@cache
def load_claims() -> tuple[Claim, ...]:
    """Read the table of claims."""
    entries = tomllib.loads((HERE / "claims.toml").read_text(encoding="utf-8"))["claim"]
    return tuple(Claim(**{**e, "expected": ClaimOutcome(e["expected"])}) for e in entries)


def paper_scene(name: str) -> Scene:
    """Return one of the shipped scenes."""
    return load_scene(SCENES / f"{name}.toml")


def seconds(reading: Reading | None) -> float:
    """Return a measured time, s; infinity for a time that does not exist."""
    return math.inf if reading is None else reading.value
