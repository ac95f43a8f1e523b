"""Compare the documents of two verdicts: keys, words and readings.

The bound on the error of a difference is the sum of the two readings' bounds: both are bounds, not
standard deviations.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from taction.system.reading_definitions import READINGS

Document = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class KeyDifference:
    """A key of the scenes that differs; None where a scene does not have the key."""

    key: str
    first: Any
    second: Any
    unit: str | None
    content: bool = False  # the same name of a file, with another content


@dataclass(frozen=True, slots=True)
class ReadingDifference:
    """One reading of both verdicts.

    Attributes
    ----------
    first, second : float, str or None
        The reading in `unit`, a word (an outcome, a state), or None where there is none.
    difference : float or None
        Second minus first; None where one of them is no number.
    uncertainty : float or None
        Bound on the error of the difference; None where a bound is unknown.
    beyond : bool or None
        Whether the readings differ by more than their uncertainties; None where that is unknown.
    """

    name: str
    channel: int | None  # from 1; None for a reading of the board
    first: float | str | None
    second: float | str | None
    unit: str
    difference: float | None
    uncertainty: float | None
    beyond: bool | None


@dataclass(frozen=True, slots=True)
class VerdictDifference:
    """The differences of two verdicts; `keys` is None where a document has no keys."""

    first: str
    second: str
    keys: tuple[KeyDifference, ...] | None
    readings: tuple[ReadingDifference, ...]

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
    one, two = _readings(first), _readings(second)
    readings = tuple(_reading(name, one.get(name), two.get(name)) for name in {**one, **two})
    return VerdictDifference(*names, keys, readings)


def _keys(first: Document, second: Document) -> Iterator[KeyDifference]:
    nothing: dict[str, Any] = {"value": None, "unit": None}
    for key in {**first, **second}:
        one, two = first.get(key, nothing), second.get(key, nothing)
        content = one.get("sha256") != two.get("sha256")
        if one["value"] != two["value"] or content:
            unit = one["unit"] or two["unit"]
            same_name = one["value"] == two["value"]
            yield KeyDifference(key, one["value"], two["value"], unit, content and same_name)


Name = tuple[str, int | None, str]  # of a reading: word, channel, unit
Reading = tuple[float | str | None, float | None]  # value, uncertainty


def _readings(document: Document) -> dict[Name, Reading]:
    """Return every reading of a document by name."""
    found: dict[Name, Reading] = {("outcome", None, ""): (document["outcome"], 0.0)}
    for check in document["checks"]:
        found[f"check {check['name']}", None, ""] = (check["outcome"], 0.0)
        value = (check["value"], check["uncertainty"])
        found[check["name"], None, check["unit"]] = value
    pole, stability = document["stability"]["rightmost_pole"], document["stability"]
    error = stability.get("rightmost_pole_uncertainty")
    found["growth_rate", None, "1/s"] = (pole[0], error)
    found["angular_frequency", None, "1/s"] = (pole[1], error)
    amplitude = (document["step_amplitude"], document.get("step_amplitude_uncertainty"))
    found["step_amplitude", None, "V"] = amplitude
    for channel in document["channels"]:
        number, bounds = channel["index"], channel.get("uncertainties", {})
        found["state", number, ""] = (channel["state"], 0.0)
        found["equilibrium", number, "V"] = (channel.get("equilibrium"), _rest(document))
        for name, kind in READINGS.items():
            found[name, number, kind.unit] = (channel[name], bounds.get(name))
    return found


def _rest(document: Document) -> float | None:
    """Return the bound on the error of the equilibrium, V."""
    bounds = (c["uncertainty"] for c in document["checks"] if c["name"] == "steady_state")
    share, amplitude = next(bounds, None), document["step_amplitude"]
    return None if share is None or amplitude is None else share * amplitude


def _reading(name: Name, first: Reading | None, second: Reading | None) -> ReadingDifference:
    word, channel, unit = name
    one, first_bound = first or (None, None)
    two, second_bound = second or (None, None)
    difference = bound = None
    beyond: bool | None = one != two
    if isinstance(one, float | int) and isinstance(two, float | int):
        difference = two - one
        if first_bound is not None and second_bound is not None:
            bound = first_bound + second_bound
            beyond = abs(difference) > bound
        elif difference:
            beyond = None
    return ReadingDifference(word, channel, one, two, unit, difference, bound, beyond)
