"""The claims of the paper, what a run of each claim found, and the charts of a chapter."""

from __future__ import annotations

import enum
import math
import string
import tomllib
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.scene import Scene, load_scene
from taction.system.charts import Chart
from taction.system.quantities import UNITS, show
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
    """One table of ``claims.toml``: what the paper says where, and what taction finds."""

    id: str
    chapter: str
    place: str
    claim: str
    run: str
    ours: str
    expected: ClaimOutcome
    printed: str = ""


@dataclass(frozen=True, slots=True)
class Finding:
    """The result for a claim: `run` and `ours` as sentences, `values` in SI base units."""

    DOCUMENT = (
        *("id = claim.id", "claim = claim.claim", "place = claim.place", "run"),
        *("printed = claim.printed", "ours", "verdict = outcome"),
        *("expected = claim.expected", "as_expected"),
        "values # behind `ours`, in SI base units",
    )

    claim: Claim
    run: str
    ours: str
    outcome: ClaimOutcome
    values: dict[str, float] = field(default_factory=dict)

    @property
    def as_expected(self) -> bool:
        """Whether the verdict is the one in the table."""
        return self.outcome is self.claim.expected


@dataclass(frozen=True, slots=True, eq=False)
class Chapter:
    """The findings of one chapter, and its charts; `seconds` is its wall time."""

    DOCUMENT = ("title", "seconds [s]")

    findings: tuple[Finding, ...]
    charts: tuple[Chart, ...] = ()
    title: str = ""
    seconds: float = 0.0


class Sentence(string.Formatter):
    """Templates for numbers and lists of numbers.

    ``{x:.3g%}`` writes a fraction as per cent, ``{t:s.3}`` three digits with an SI prefix.
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


def finding(id_: str, outcome: ClaimOutcome, **found: Any) -> Finding:
    """Return the finding on the claim `id_`: `found` fills its templates, its reals are values."""
    claim = next(claim for claim in load_claims() if claim.id == id_)
    run, ours = (Sentence().format(text, **found) for text in (claim.run, claim.ours))
    values = {name: float(each) for name, each in found.items() if isinstance(each, float)}
    return Finding(claim, run, ours, outcome, values)


def weigh(always: object, condition: object = False, *, fitted: bool = False) -> ClaimOutcome:
    """Return the verdict on a claim that holds `always`, or only under its `condition`."""
    if always:
        return ClaimOutcome.FITTED if fitted else ClaimOutcome.HOLDS
    return ClaimOutcome.CONDITION if condition else ClaimOutcome.FAILS


@cache
def load_claims() -> tuple[Claim, ...]:
    """Read the table of claims."""
    chapters = tomllib.loads((HERE / "claims.toml").read_text(encoding="utf-8"))
    return tuple(
        Claim(id_, chapter, **{**entry, "expected": ClaimOutcome(entry["expected"])})
        for chapter, entries in chapters.items()
        for id_, entry in entries.items()
    )


def paper_scene(name: str) -> Scene:
    """Return one of the shipped scenes."""
    return load_scene(SCENES / f"{name}.toml")


def redesigned(scene: Scene, **design: Any) -> Scene:
    """Return a scene with other values of its design."""
    return with_values(scene, {f"design.{key}": value for key, value in design.items()})


def seconds(reading: Reading | None) -> float:
    """Return a measured time, s; infinity for a time that does not exist."""
    return math.inf if reading is None else reading.value
