"""What is asked of a deck: one table, from which every medium follows.

An entry states what a number is called, its unit, how it is found, how it is asked for and what is
good. ``--check``, ``--over``, the document, the terminal, the report, worst corners and the yield
read `QUESTIONS`. To add one is to add a file with a `Question`, and its entry.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from taction.netlist_gen.scene.checks import Checks
from taction.system.errors import Complaint, InputError
from taction.system.quantities import fraction, number, parse
from taction.system.reading_definitions import READINGS
from taction.verification.readings.readings import Reading
from taction.verification.studies.measured_board import MeasuredBoard
from taction.verification.verdict.checks import Check, at_most, undecided
from taction.verification.verdict.record import finite

Answers = Sequence[Reading | None]  # of the outputs


@dataclass(frozen=True, slots=True)
class Question:
    """A number of each output of a deck.

    Attributes
    ----------
    name, unit : str
        Key of the document and name of the check; unit of the number.
    title : str
        Of its column.
    words : str
        What the number is, in the sentence of its check.
    answer : callable
        Returns the number of each output, with its bound; None where an output has none.
    short : str
        Word of ``--check``; empty: `name`.
    example : str
        Of a limit.
    second : str
        Key of the scene's check for what follows ``@`` in a limit.
    large : bool
        Whether a large number is good: the limit is the least one.
    over : bool
        Whether a sweep shows it.
    whole : callable, optional
        Returns the number of the whole board; by default the worst one of the outputs.
    """

    name: str
    unit: str
    title: str
    words: str
    answer: Callable[[MeasuredBoard], Answers]
    short: str = ""
    example: str = ""
    second: str = ""
    large: bool = False
    over: bool = True
    whole: Callable[[MeasuredBoard], Reading | None] | None = None

    @property
    def asked(self) -> str:
        """The word of ``--check``."""
        return self.short or self.name

    @property
    def bound(self) -> str:
        """Key of the bound in a document."""
        return f"{self.name.removesuffix('_time')}_bound"

    @property
    def is_of_scenes(self) -> bool:
        """Whether scenes have a check of this name, which judges it."""
        return self.name in Checks.model_fields

    def worst(self, found: MeasuredBoard) -> Reading | None:
        """Return the number of the whole board; None where an output has none."""
        if self.whole is not None:
            return self.whole(found)
        every = self.answer(found)
        known = [each for each in every if each is not None]
        if not known or len(known) < len(every):
            return None
        return (min if self.large else max)(known, key=lambda each: each.value)

    def keys(self, text: str, extra: str) -> dict[str, Any]:
        """Return the table of the check with a limit, and what follows it behind ``@``.

        Raises
        ------
        InputError
            There is no limit, or it is no quantity in the unit; nothing may follow it.
        """
        if not text:
            accepted = f"expected a limit, such as {self.asked}={self.example or 1}"
            raise InputError("--check", Complaint(self.asked, "", accepted))
        if extra and not self.second:
            several = (
                f"{q.asked}=LIMIT@{q.second.upper()}" for q in QUESTIONS.values() if q.second
            )
            accepted = f"only {' and '.join(several)} have a second value"
            raise InputError("--check", Complaint(self.asked, repr(extra), accepted))
        if not self.is_of_scenes:
            try:
                return {"limit": parse(text, self.unit) if self.unit else number(text)}
            except ValueError as error:
                raise InputError("--check", Complaint(self.asked, repr(text), str(error))) from None
        keys: dict[str, Any] = {"max": share_of(text) if self.unit == "step" else text}
        if extra:
            keys[self.second] = share_of(extra) if self.second == "band" else extra
        return keys

    def figures(self, reading: Reading | None) -> dict[str, float | None]:
        """Return a number and its bound by their keys, None where there is none."""
        bound = None if reading is None else finite(reading.uncertainty)
        return {self.name: finite(reading), self.bound: bound}

    def check(self, found: MeasuredBoard, limit: float) -> Check:
        """Judge the number of the whole board; `run_checks` judges what scenes have, too."""
        reading = self.worst(found)
        if reading is None or not math.isfinite(reading.uncertainty):
            return undecided(self.name, self.unit, f"{self.words} is not known", limit)
        sign = -1.0 if self.large else 1.0
        outcome = at_most(sign * reading.value, reading.uncertainty, sign * limit)
        value, error = reading.value, reading.uncertainty
        return Check(self.name, outcome, value, error, limit, None, self.unit, self.words)


def share_of(text: str, option: str = "--check") -> float:
    """Return a fraction from ``5%`` or ``0.05``.

    Raises
    ------
    InputError
        It is neither, negative or without a limit.
    """
    try:
        share = fraction(text)
        if not 0.0 <= share < math.inf:
            raise ValueError("a share is finite and not negative")
        return share
    except ValueError:
        accepted = "expected a share such as 5% or 0.05"
        raise InputError(option, Complaint("share", repr(text), accepted)) from None


def _reading(name: str, title: str, words: str, example: str, second: str = "") -> Question:
    """Return the question of a reading of the step, which `measurements` has."""
    return Question(
        name,
        READINGS[name].unit,
        title,
        words,
        lambda found: [channel.readings[name] for channel in found.measurements.channels],
        name.removesuffix("_time"),
        example,
        second,
        whole=lambda found: found.measurements.readings[name],
    )


def _noise(found: MeasuredBoard) -> Answers:
    rms, bounds = found.noise.rms, found.noise.error
    return [Reading(*each) if math.isfinite(each[0]) else None
            for each in zip(rms, bounds, strict=True)]  # fmt: skip


EVERY = (
    _reading("settling_time", "settles", "the settling time", "1ms@1%", "band"),
    _reading("rise_time", "rises", "the rise time", "10us"),
    _reading("overshoot", "overshoot", "the overshoot", "5%"),
    _reading("undershoot", "undershoot", "the undershoot", "5%"),
    Question("noise", "V", "output noise", "the noise at rest, rms", _noise,
             example="1mV", second="lowest", over=False),
)  # fmt: skip
QUESTIONS = {each.name: each for each in EVERY}
"""The questions by name."""


def units(*, over: bool = False) -> dict[str, str]:
    """Return the units of all numbers and bounds, by the keys of documents; or those of sweeps."""
    asked = [each for each in QUESTIONS.values() if each.over or not over]
    return {key: each.unit for each in asked for key in (each.name, each.bound)}
