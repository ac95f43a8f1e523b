"""What a claim of the paper is, what was found out about it, and pictures as plain data."""

from __future__ import annotations

import enum
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from netlist_gen.scene.file import load_scene
from netlist_gen.scene.scene import Scene
from spice_models.array_types import Floats

HERE = Path(__file__).parent
SCENES = HERE.parents[1] / "scenes"  # a link to the checkout's scenes; a wheel holds the files


class ClaimOutcome(enum.Enum):
    """What became of a claim; the value is what is printed."""

    HOLDS = "holds"
    CONDITION = "holds under a stated condition"
    FAILS = "does not hold"
    NOT_RUN = "could not be run"


@dataclass(frozen=True, slots=True)
class Claim:
    """One entry of ``claims.toml``.

    Attributes
    ----------
    id : str
        Short name.
    chapter : str
        Key of `verification.studies.paper.reproduce.CHAPTERS`.
    place : str
        Where in the paper.
    claim : str
        What is said there, in short.
    printed : str
        The printed value or formula; empty where there is none.
    expected : ClaimOutcome
        The verdict that this project stands by; another one is a regression.
    quick : bool
        Whether a quick run judges it.
    """

    id: str
    chapter: str
    place: str
    claim: str
    printed: str
    expected: ClaimOutcome
    quick: bool = True


@dataclass(frozen=True, slots=True)
class Finding:
    """What running a claim showed.

    Attributes
    ----------
    id : str
        Of the claim.
    run : str
        What was run.
    ours : str
        What came out, in words and numbers.
    outcome : ClaimOutcome
        The verdict.
    values : dict of str to float
        The numbers behind it, SI base units.
    """

    id: str
    run: str
    ours: str
    outcome: ClaimOutcome
    values: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """One line of a picture; `style` is a format string of matplotlib's."""

    x: Floats
    y: Floats
    label: str = ""
    style: str = "-"


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """One set of axes; `marks` are labelled horizontal lines, `logs` names axes (``"xy"``)."""

    title: str
    x: str
    y: str
    curves: tuple[Curve, ...]
    logs: str = ""
    limits: tuple[float, float] | None = None
    marks: tuple[tuple[float, str], ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A picture: `name` is its file's stem, `caption` says what to see."""

    name: str
    caption: str
    panels: tuple[Panel, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Chapter:
    """What one chapter found."""

    findings: tuple[Finding, ...]
    pictures: tuple[Picture, ...] = ()


def weigh(always: bool, condition: bool = False) -> ClaimOutcome:
    """Return the verdict on a claim that holds `always`, or only under its `condition`."""
    if always:
        return ClaimOutcome.HOLDS
    return ClaimOutcome.CONDITION if condition else ClaimOutcome.FAILS


def curve(x: ArrayLike, y: ArrayLike, label: str = "", style: str = "-") -> Curve:
    """Return a `Curve` of anything that is an array."""
    return Curve(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64), label, style)


@cache
def load_claims() -> tuple[Claim, ...]:
    """Read the table of claims."""
    entries = tomllib.loads((HERE / "claims.toml").read_text(encoding="utf-8"))["claim"]
    words = {outcome.value: outcome for outcome in ClaimOutcome}
    return tuple(Claim(**{**entry, "expected": words[entry["expected"]]}) for entry in entries)


def paper_scene(name: str) -> Scene:
    """Return one of the shipped scenes."""
    return load_scene(SCENES / f"{name}.toml")


def percent(part: float) -> str:
    """Return a fraction as per cent."""
    return f"{100.0 * part:.3g} %"


def listed(values: Sequence[float], digits: int = 3) -> str:
    """Return numbers in one line."""
    return ", ".join(f"{value:.{digits}g}" for value in values)
