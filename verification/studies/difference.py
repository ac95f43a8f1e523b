"""The difference of two verdicts: keys of their scenes, then readings with their bounds.

Both bounds of a reading are bounds, not standard deviations, so their sum bounds the error of a
difference. A verdict may be a file that `taction verify SCENE --json` wrote, also an older one.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from taction.system.documents import read
from taction.system.errors import Complaint, InputError
from taction.system.foreign_files import LARGEST, UnusableFileError, read_bounded
from taction.system.reading_definitions import READINGS
from taction.system.results import Result
from taction.verification.verdict.checks import Check
from taction.verification.verdict.compare import Difference, compare, within_uncertainties
from taction.verification.verdict.record import Channel, Record

Document = Mapping[str, Any]
Value = bool | int | float | str

PARTS = ("scene", "outcome", "checks", "channels", "step_amplitude", "stability")
ACCEPTED = "the document of one verdict, from `taction verify SCENE --json`"
FIGURES = ("growth_rate", "frequency", "step_amplitude")
CHANNEL_FIGURES = ("equilibrium", *READINGS)


@dataclass(frozen=True, slots=True)
class KeyDifference:
    """A key of the scenes that differs; None where a scene does not have the key."""

    key: str
    first: Value | None
    second: Value | None
    unit: str | None
    content: bool = False  # the same name of a file, with another content


@dataclass(frozen=True, slots=True)
class VerdictDifference(Result):
    """The differences of two verdicts; `keys` is None where a document has no keys."""

    VIEW = "taction.verification.report.views.difference:view"

    SHOWN: ClassVar[tuple[str, ...]] = ("exit_status",)

    first: str
    second: str
    keys: tuple[KeyDifference, ...] | None
    readings: tuple[Difference, ...]

    @property
    def exit_status(self) -> int:
        """1 if a reading differs beyond the uncertainties, else 3 if that is unknown, else 0."""
        found = {reading.beyond for reading in self.readings}
        return 1 if True in found else 3 if None in found else 0


def compare_verdicts(
    first: Document, second: Document, names: tuple[str, str]
) -> VerdictDifference:
    """Return the differences of two documents; `names` are those of their files."""
    keys = None
    if "keys" in first and "keys" in second:
        keys = tuple(_keys(first["keys"], second["keys"]))
    readings = compare(
        document_record(first),
        document_record(second),
        within_uncertainties(),
        figures=FIGURES,
        channel_figures=CHANNEL_FIGURES,
    )
    return VerdictDifference(*names, keys, readings)


def document_record(document: Document) -> Record:
    """Return the record of a verdict's document of version 1 or 2.

    Raises
    ------
    ValueError
        A field has another type.
    """
    stability, amplitude = document["stability"], document["step_amplitude"]
    rate, speed = stability["rightmost_pole"]
    bound = stability.get("rightmost_pole_uncertainty")
    turn = 2.0 * math.pi
    return Record(
        outcome=document["outcome"],
        engine=document.get("engine", ""),
        figures={"growth_rate": rate, "frequency": speed / turn, "step_amplitude": amplitude},
        uncertainties={
            "growth_rate": bound,
            "frequency": None if bound is None else bound / turn,
            "step_amplitude": document.get("step_amplitude_uncertainty"),
        },
        checks=read(tuple[Check, ...], document["checks"]),
        channels=tuple(_channel(each, _rest(document)) for each in document["channels"]),
    )


def _channel(data: Document, rest: float | None) -> Channel:
    bounds = {**data.get("uncertainties", {}), "equilibrium": rest}
    figures = {name: data.get(name) for name in CHANNEL_FIGURES}
    return Channel(data["index"], data["state"], figures, bounds)


def _rest(document: Document) -> float | None:
    """Return the bound on the error of the equilibrium, V."""
    bounds = (c["uncertainty"] for c in document["checks"] if c["name"] == "steady_state")
    share, amplitude = next(bounds, None), document["step_amplitude"]
    return None if share is None or amplitude is None else share * amplitude


def _keys(first: Document, second: Document) -> Iterator[KeyDifference]:
    nothing: dict[str, Any] = {"value": None, "unit": None}
    for key in {**first, **second}:
        one, two = first.get(key, nothing), second.get(key, nothing)
        content = one.get("sha256") != two.get("sha256")
        if one["value"] != two["value"] or content:
            unit = one["unit"] or two["unit"]
            same_name = one["value"] == two["value"]
            yield KeyDifference(key, one["value"], two["value"], unit, content and same_name)


def stored_verdict(path: str | Path) -> dict[str, Any]:
    """Return the document in a file.

    Raises
    ------
    InputError
        The file cannot be read, is not JSON, or does not hold the document of one verdict.
    """
    try:
        document = json.loads(read_bounded(path, LARGEST))
    except UnusableFileError as error:
        raise InputError(path, Complaint("file", "", f"{error}; expected {ACCEPTED}")) from None
    except (ValueError, RecursionError) as error:
        raise InputError(path, Complaint("JSON", "", f"{error}; expected {ACCEPTED}")) from None
    if isinstance(document, dict) and "verdicts" in document:
        text = f"holds the verdicts of several scenes; expected {ACCEPTED}"
        raise InputError(path, Complaint("verdicts", "", text))
    missing = [name for name in PARTS if not isinstance(document, dict) or name not in document]
    if missing:
        text = f"lacks {', '.join(missing)}; expected {ACCEPTED}"
        raise InputError(path, Complaint("JSON", "", text))
    try:
        document_record(document)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        text = f"damaged ({error}); expected {ACCEPTED}"
        raise InputError(path, Complaint("JSON", "", text)) from None
    return dict(document)
