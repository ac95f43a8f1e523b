"""What mends a board, as parts of the documents of ``verify`` and ``montecarlo``."""

from __future__ import annotations

from pydantic import Field

from taction.verification.report.schemas.shared import Number, Part, Value


class StableRange(Part):
    """The nearest stable range of a key of an unstable board; `own` is the scene's value."""

    path: str
    unit: str
    own: Number
    least: Number = Field(description="the search began here")
    most: Number = Field(description="and ended here")
    low: Number
    high: Number
    found: bool
    reason: str
    edge: Number
    factor: Number = Field(description="from the own value to the edge")
    text: str
    doubt: str


class Change(Part):
    """A change with what the state-space verdict says of it; `values` by dotted paths."""

    values: dict[str, Value]
    mends: list[str]
    left: list[str] = Field(description="checks that do not pass with the change")
    resistance: Number
    verified: bool
    engine: str


class WithoutChange(Part):
    """A search without a change that mends."""

    keys: list[str]
    low: Number = Field(alias="from")
    high: Number = Field(alias="to")


class WhatToChange(Part):
    """The changes that mend a failed verdict."""

    failed: list[str]
    stable_ranges: dict[str, StableRange]
    stable_opamps: list[str]
    changes: list[Change]
    without: list[WithoutChange]
    not_searched: list[list[str]] = Field(description="the time limit ended these searches")
    unmendable: list[str]
    trials: int
    time_limit: Number


class Remedy(Part):
    """Smaller tolerances of parts and of kinds of parts, and the yield that they give."""

    parts: dict[str, Number]
    kinds: dict[str, Number]
    target: Number
    predicted: Number
    samples: int
    passed: int
    low: Number
    high: Number
