"""The document of ``taction choose``."""

from __future__ import annotations

from taction.verification.report.schemas.grids import PointOutcome
from taction.verification.report.schemas.shared import Document, Number, Outcome, Part, Value, Word


class ChosenDesign(Part):
    """One design of a choice; `values` by dotted paths, `shares` of the limits by check."""

    place: int
    values: dict[str, Value]
    outcome: PointOutcome
    left: list[str]
    shares: dict[str, Number]
    settling_time: Number | None
    overshoot: Number | None
    headroom: Number | None
    noise_rms: Number | None
    reason: str
    refused: str
    worst_share: Number | None


class BestDesign(ChosenDesign):
    """One of the best designs, with what ngspice says."""

    ngspice: Outcome | None
    ngspice_settling_time: Number | None
    ngspice_reason: str
    file: Word


class ChooseDocument(Document):
    """``taction choose``: all designs, the best first, and those that ngspice ran."""

    designs: list[ChosenDesign]
    best: list[BestDesign]
