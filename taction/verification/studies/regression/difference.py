"""The difference of two boards: keys of their scenes or their parts, then readings with bounds.

Both are bounds, so their sum bounds the error of a difference.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Annotated, Any

from taction.netlist_gen.scene.loading import read_toml
from taction.system.array_types import Floats
from taction.system.documents import OPTIONAL, read
from taction.system.errors import Complaint, InputError
from taction.system.foreign_files import LARGEST, UnusableFileError, read_bounded
from taction.system.reading_definitions import READINGS
from taction.system.results import Result
from taction.verification.verdict.checks import Check
from taction.verification.verdict.record import (
    Channel,
    Difference,
    Record,
    compare,
    within_uncertainties,
)

Document = Mapping[str, Any]
Value = bool | int | float | str
Curves = Callable[[], tuple[Floats, Floats] | None]
"""Returns instants (P,), s, and outputs (P, N), V; None where they cannot be drawn."""

DECKS = (".cir", ".ckt", ".cki", ".sp", ".spice", ".net", ".asc")
RECORDS = (".raw",)
DOCUMENT = "the document of one verdict, from `taction verify SCENE --json`"
ACCEPTED = (
    "a scene (.toml; `taction new` writes one), a deck (.cir), the raw file of one transient (.raw)"
    " or a stored verdict (.json)"
)
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
    """The differences of two boards.

    Attributes
    ----------
    keys : tuple of KeyDifference, or None
        What differs in their scenes, or in the parts of their decks; None beside a raw file.
    readings : tuple of Difference
        Every reading of either.
    outputs : tuple of str
        Names of the channels of readings; empty: u_1, u_2, ...
    curves : tuple of callable or None
        Instants (P,), s, and outputs (P, N), V, of each; None of a stored verdict.
    """

    VIEW = "taction.verification.report.views.comparison_view:difference_view"
    DOCUMENT = ("first", "second", "keys", "readings", "outputs", "notes", "exit_status")

    first: str
    second: str
    keys: tuple[KeyDifference, ...] | None
    readings: tuple[Difference, ...]
    outputs: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    curves: tuple[Curves | None, Curves | None] = (None, None)

    @property
    def exit_status(self) -> int:
        """1 if a reading differs beyond the uncertainties, else 3 if that is unknown, else 0."""
        found = {reading.beyond for reading in self.readings}
        return 1 if True in found else 3 if None in found else 0


def compare_verdicts(
    first: Document,
    second: Document,
    names: tuple[str, str],
    curves: tuple[Curves | None, Curves | None] = (None, None),
) -> VerdictDifference:
    """Return the differences of two documents; `names` are those of their files."""
    one, two = (read(_StoredVerdict, document) for document in (first, second))
    keys = tuple(key_differences(one.keys, two.keys))
    readings = compare(
        one.record,
        two.record,
        within_uncertainties(),
        figures=FIGURES,
        channel_figures=CHANNEL_FIGURES,
    )
    return VerdictDifference(*names, keys, readings, curves=curves)


@dataclass(frozen=True, slots=True)
class StoredKey:
    """A key of a scene or a value of a deck, base units; a file has the SHA-256 of its content."""

    value: Value | None
    unit: str | None = None
    sha256: Annotated[str | None, OPTIONAL] = None


@dataclass(frozen=True, slots=True)
class _StoredStability:
    rightmost_pole: tuple[float, float]
    rightmost_pole_uncertainty: float | None


@dataclass(frozen=True, slots=True)
class _StoredVerdict:
    """What is compared of the document of a verdict."""

    outcome: str
    checks: tuple[Check, ...]
    channels: tuple[Channel, ...]
    step_amplitude: float | None
    stability: _StoredStability
    engine: str
    step_amplitude_uncertainty: float | None
    keys: dict[str, StoredKey]

    @property
    def record(self) -> Record:
        """What is compared."""
        (rate, speed), bound = astuple(self.stability)
        values = rate, speed / math.tau, self.step_amplitude
        bounds = bound, None if bound is None else bound / math.tau, self.step_amplitude_uncertainty
        return Record(
            self.outcome,
            self.engine,
            figures=dict(zip(FIGURES, values, strict=True)),
            uncertainties=dict(zip(FIGURES, bounds, strict=True)),
            checks=self.checks,
            channels=self.channels,
        )


def key_differences(
    first: Mapping[str, StoredKey], second: Mapping[str, StoredKey]
) -> Iterator[KeyDifference]:
    """Yield the keys whose values differ."""
    nothing = StoredKey(None)
    for key in {**first, **second}:
        one, two = first.get(key, nothing), second.get(key, nothing)
        same = one.value == two.value
        if not same or one.sha256 != two.sha256:
            yield KeyDifference(key, one.value, two.value, one.unit or two.unit, content=same)


def stored_verdict(path: str | Path) -> dict[str, Any]:
    """Return the document in a file; `InputError` where it is none of one verdict."""

    def refused(key: str, text: object) -> InputError:
        return InputError(path, Complaint(key, "", f"{text}; expected {DOCUMENT}"))

    try:
        document = json.loads(read_bounded(path, LARGEST))
    except UnusableFileError as error:
        raise refused("file", error) from None
    except (ValueError, RecursionError) as error:
        raise refused("JSON", error) from None
    if isinstance(document, dict) and "verdicts" in document:
        raise refused("verdicts", "holds the verdicts of several scenes")
    try:
        read(_StoredVerdict, document)
    except (ValueError, OverflowError) as error:
        place, _, what = str(error).rpartition(": ")
        raise refused(place or "JSON", what) from None
    return dict(document)


def is_circuit(given: object) -> bool:
    """Return whether something is a file of a deck, or of a record of waveforms, by its ending."""
    return ends_with(given, (*DECKS, *RECORDS))


def ends_with(given: object, endings: tuple[str, ...]) -> bool:
    """Return whether something is a file with one of these endings."""
    return isinstance(given, str | Path) and Path(given).suffix.lower() in endings


def refuse_pair(first: object, second: object) -> None:
    """Refuse two things that cannot be compared, or a file that is none of them."""
    for given, other in ((first, second), (second, first)):
        if ends_with(given, (".json",)) and is_circuit(other):
            text = f"a stored verdict has no circuit to compare with {other}; expected its scene"
            raise InputError(str(given), Complaint("file", "", text))
    if ends_with(first, RECORDS) and ends_with(second, RECORDS):
        text = "a second record; expected the scene or the deck of the board (.toml, .cir)"
        raise InputError(str(second), Complaint("file", "", text))
    for given in (first, second):
        if isinstance(given, str | Path):
            path = Path(given)
            if not path.is_file() and path.suffix.lower() != ".asc":
                text = f"No such file or directory; expected {ACCEPTED}"
                raise InputError(path, Complaint("file", "", text))
            if not ends_with(given, (*DECKS, *RECORDS, ".json")):
                read_toml(path, ACCEPTED)
