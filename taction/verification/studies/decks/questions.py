"""What is asked of a deck: one table, from which every medium follows, and how it is judged.

An entry states what a number is called, its unit, how it is found, how it is asked for and what is
good. ``--check``, ``--over``, the document, the terminal, the report, worst corners and the yield
read `QUESTIONS`. To add one is to add a file with a `Question`, and its entry.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from taction.netlist_gen.scene.check_keys import Checks
from taction.netlist_gen.scene.mistakes import validated
from taction.system.array_types import EPS
from taction.system.errors import Complaint, InputError
from taction.system.quantities import fraction, number, parse, show_rate
from taction.system.reading_definitions import READINGS
from taction.verification.readings.readings import Reading
from taction.verification.stability.poles import Poles
from taction.verification.studies.decks.measured_board import LATCH, WANTED, MeasuredBoard
from taction.verification.verdict import record
from taction.verification.verdict.board import SteadyState
from taction.verification.verdict.checks import (
    Check,
    Evidence,
    Outcome,
    at_most,
    cause,
    doubtful,
    overall,
    undecided,
)
from taction.verification.verdict.record import Figure, Record, finite
from taction.verification.verdict.run_checks import run_checks

SHARE = 1e-3  # default tolerance of an expected value
LISTED = 20  # nodes in a message
LARGEST = 100.0  # factor of a value up to which `stability.margin` searches
OSCILLATES = "oscillates"
Answers = Sequence[Reading | None]  # of the outputs


@dataclass(frozen=True, slots=True)
class Question:
    """A number of each output of a deck."""

    name: str  # key of the document, and name of the check
    unit: str
    title: str  # of its column
    words: str  # what the number is, in the sentence of its check
    # the number of each output, with its bound; None where an output has none
    answer: Callable[[MeasuredBoard], Answers]
    example: str = "1"  # of a limit
    second: str = ""  # key of the scene's check for what follows ``@`` in a limit
    large: bool = False  # whether a large number is good: the limit is the least one
    over: bool = True  # whether a sweep shows it
    # the number of the whole board; by default the worst one of the outputs
    whole: Callable[[MeasuredBoard], Reading | None] | None = None

    @property
    def asked(self) -> str:
        """The word of ``--check``."""
        return self.name.removesuffix("_time")

    @property
    def bound(self) -> str:
        """Key of the bound in a document."""
        return f"{self.asked}_bound"

    def worst(self, found: MeasuredBoard) -> Reading | None:
        """Return the number of the whole board; None where an output has none."""
        if self.whole is not None:
            return self.whole(found)
        every = self.answer(found)
        known = [each for each in every if each is not None]
        if not known or len(known) < len(every):
            return None
        return (min if self.large else max)(known, key=lambda each: each.value)

    def limits(self, text: str, extra: str) -> dict[str, Any]:
        """Return the keys of the check of a limit, and of what follows it behind ``@``."""
        if not text:
            raise _refused(self.asked, "", f"expected a limit, such as {self.asked}={self.example}")
        if extra and not self.second:
            raise _refused(self.asked, repr(extra), f"expected one value: {self.asked}={text}")
        if self.name not in Checks.model_fields:  # scenes' checks judge those in it
            try:
                return {"limit": parse(text, self.unit) if self.unit else number(text)}
            except ValueError as error:
                raise _refused(self.asked, repr(text), str(error)) from None
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
        value, error, sign = reading.value, reading.uncertainty, -1.0 if self.large else 1.0
        outcome = at_most(sign * value, error, sign * limit)
        return Check(self.name, outcome, value, error, limit, None, self.unit, self.words)


def _reading(name: str, title: str, words: str, example: str, second: str = "") -> Question:
    """Return the question of a reading of the step, which `measurements` has."""

    def answer(found: MeasuredBoard) -> Answers:
        return [channel.readings[name] for channel in found.measurements.channels]

    def whole(found: MeasuredBoard) -> Reading | None:
        return found.measurements.readings[name]

    unit = READINGS[name].unit
    return Question(name, unit, title, words, answer, example, second, whole=whole)


def _noise(found: MeasuredBoard) -> Answers:
    rms, bounds = found.noise.rms, found.noise.error
    return [Reading(*each) if math.isfinite(each[0]) else None
            for each in zip(rms, bounds, strict=True)]  # fmt: skip


QUESTIONS = {each.name: each for each in (
    _reading("settling_time", "settles", "the settling time", "1ms@1%", "band"),
    _reading("rise_time", "rises", "the rise time", "10us"),
    _reading("overshoot", "overshoot", "the overshoot", "5%"),
    _reading("undershoot", "undershoot", "the undershoot", "5%"),
    Question("noise", "V", "output noise", "the noise at rest, rms", _noise,
             example="1mV", second="lowest", over=False),
)}  # fmt: skip
"""The questions by name."""


def units(*, over: bool = False) -> dict[str, str]:
    """Return the units of all numbers and bounds, by the keys of documents; or those of sweeps."""
    asked = [each for each in QUESTIONS.values() if each.over or not over]
    return {key: each.unit for each in asked for key in (each.name, each.bound)}


class Expected(NamedTuple):
    """An expected voltage at rest."""

    node: str
    volts: float
    tolerance: float  # accepted deviation, V


@dataclass(frozen=True)
class Wanted:
    """What is to be checked."""

    names: tuple[str, ...]  # of the checks that are asked for
    limits: Checks  # those of a scene without checks where nothing is asked
    expected: tuple[Expected, ...]
    own: Mapping[str, float]  # limits of questions that no scene has
    oscillates: bool  # it has to; else it has to be stable

    @property
    def lowest(self) -> float | None:
        """Lowest frequency of the noise, Hz, where it was given."""
        return None if self.limits.noise is None else self.limits.noise.lowest

    @property
    def margin(self) -> bool:
        """Whether a margin is asked for."""
        return self.limits.stability.margin > 1.0

    def refuse_unknown(self, nodes: Collection[str]) -> None:
        """Refuse an expected value of a node that is not one of `nodes`."""
        for each in self.expected:
            if each.node not in nodes:
                text = f"the board has the nodes {', '.join([*nodes][:LISTED])}"
                raise _refused(f"v({each.node})", "", text, "--expect")


def wanted(checks: Iterable[str] = (), expect: Iterable[str] = ()) -> Wanted:
    """Read the texts of checks and expected values; InputError says what is accepted."""
    tables: dict[str, dict[str, Any]] = {}
    for text in checks:
        name, keys = _check_of(text)
        known = tables.setdefault(name, {})
        if any(known.get(key, value) != value for key, value in keys.items()):
            raise _refused(name, repr(text), "two limits of one reading")
        known.update(keys)
    oscillates = tables.pop(OSCILLATES, None) is not None
    own = {name: keys["limit"] for name, keys in tables.items() if "limit" in keys}
    names = (*tables, *(() if oscillates else ("stability",)))
    expected = tuple(map(_expected, expect))
    scenes = {name: keys for name, keys in tables.items() if name not in own}
    return Wanted(names, validated(Checks, scenes, "--check"), expected, own, oscillates)


def _check_of(text: str) -> tuple[str, dict[str, Any]]:
    """Return the name of a check and the keys of its table."""
    word, _, value = (part.strip() for part in text.partition("="))
    limit, _, extra = (part.strip() for part in value.partition("@"))
    for question in QUESTIONS.values():
        if word in (question.asked, question.name):
            return question.name, question.limits(limit, extra)
    if word == "margin" or (word == "stability" and value):
        with suppress(ValueError):
            if 1.0 <= (factor := float(value)) <= LARGEST:  # margins are searched up to it
                return "stability", {"margin": factor}
        accepted = f"expected a factor from 1 to {LARGEST:g}, such as {word}=2"
        raise _refused(word, repr(value), accepted)
    if word in ("agree", "engines_agree"):
        return "engines_agree", {"tolerance": share_of(value)}
    if word in ("stable", "stability", OSCILLATES) and not value:
        return ("stability" if word == "stable" else word), {}
    if word in ("stable", OSCILLATES):
        raise _refused(word, repr(value), "expected no value")
    known = [f"{each.asked}={each.example}" for each in QUESTIONS.values()]
    accepted = ", ".join([*known, f"margin=2, agree=1e-3, stable or {OSCILLATES}"])
    raise _refused("check", repr(word), f"expected {accepted}")


def _expected(text: str) -> Expected:
    name, _, value = (part.strip() for part in text.partition("="))
    value, at, tolerance = (part.strip() for part in value.partition("@"))
    try:
        volts = parse(value, "V")
        if not at or tolerance.endswith("%"):
            accepted = (share_of(tolerance, "--expect") if at else SHARE) * abs(volts)
        else:
            accepted = parse(tolerance, "V")
        if not 0.0 <= accepted < math.inf:
            raise ValueError("a tolerance is finite and not negative")
        return Expected(name.lower().removeprefix("v(").removesuffix(")"), volts, accepted)
    except ValueError as error:
        usual = f"{error}; expected v(NODE)=VALUE@TOLERANCE, such as v(out)=1.25@0.1%"
        raise _refused("value", repr(text), usual, "--expect") from None


def share_of(text: str, option: str = "--check") -> float:
    """Return a fraction from ``5%`` or ``0.05``."""
    with suppress(ValueError):
        if 0.0 <= (share := fraction(text)) < math.inf:
            return share
    raise _refused("share", repr(text), "expected a share such as 5% or 0.05", option)


def _refused(key: str, value: str, text: str, option: str = "--check") -> InputError:
    return InputError(option, Complaint(key, value, text))


def judge(found: MeasuredBoard, asked: Wanted) -> Iterator[Check]:
    """Yield the expected values, then the limits that were asked for."""
    yield from (_at_rest(found, each) for each in asked.expected)
    evidence = Evidence(
        limits=asked.limits,
        measurements=found.measurements,
        steady=SteadyState.of(found.board, found.scales),
        wanted=WANTED,
        poles=found.poles,
        margin=found.margin if asked.margin else None,
        noise=found.noise if asked.limits.noise is not None else None,
    )
    for check in run_checks(evidence):
        if check.name == "stability" and evidence.growth:
            check = replace(check, reason=f"{check.reason}; {found.remedy}")
        if check.name in asked.names:
            yield check
    yield from (QUESTIONS[name].check(found, limit) for name, limit in asked.own.items())
    if asked.oscillates:
        yield _oscillates(found.poles)


def _at_rest(found: MeasuredBoard, wanted: Expected) -> Check:
    """Compare the equilibrium of a node with an expected value."""
    name, place = f"v({wanted.node})", found.board.descriptor.place(wanted.node)
    value = float(found.board.equilibrium.values[place])
    error = max(float(found.board.rounding[place]), EPS * abs(value))
    outcome, reason = at_most(abs(value - wanted.volts), error, wanted.tolerance), "equilibrium"
    if not found.poles.known_stable:
        reason = "the board is not stable: it does not come to rest there"
        outcome = Outcome.FAIL if found.poles.known_unstable else Outcome.INCONCLUSIVE
    return Check(name, outcome, value, error, wanted.volts, wanted.tolerance, "V", reason)


def _oscillates(found: Poles) -> Check:
    """Pass a board in which a complex pair grows, and no real pole; its value is the frequency."""
    p, errors, value, bound = found.poles, found.errors, None, None
    growing, may_grow = p.real > errors, p.real >= -errors
    if np.any(growing & (p.imag == 0.0)):
        outcome, reason = Outcome.FAIL, f"runs away, a real pole grows: {LATCH}"
    elif not np.any(may_grow):
        outcome, reason = Outcome.FAIL, "every mode decays"
    elif not np.any(growing) or np.any(may_grow & (np.abs(p.imag) <= errors)):
        outcome, reason = Outcome.INCONCLUSIVE, doubtful(found)
    else:
        first, outcome = int(np.argmax(growing)), Outcome.PASS
        value, bound = abs(float(p[first].imag)) / math.tau, float(errors[first]) / math.tau
        reason = f"grows with {show_rate(p.real[first])}; of its start, before anything limits it"
    return Check("oscillates", outcome, value, bound, None, None, "Hz", reason)


def record_of(found: MeasuredBoard, asked: Wanted | None = None) -> Record:
    """Return what is known of a board as a record; its outcome is that of the checks."""
    judged, poles = () if asked is None else tuple(judge(found, asked)), found.poles
    decisive, lead = cause(judged), poles.rightmost if len(poles.poles) else None
    bound, named = finite(poles.resolution), () if asked is None else asked.names
    margin = found.margin if asked is not None and asked.margin else None
    figures = {
        each.name: record.FigureRule(each.unit, each.worst).figure(found)
        if each.over or each.name in named
        else Figure(None, each.unit)
        for each in QUESTIONS.values()
    }
    rate, hertz = (None, None) if lead is None else (lead.real, abs(lead.imag) / math.tau)
    figures |= {
        "growth_rate": Figure(rate, "1/s", bound),
        "frequency": Figure(hertz, "Hz", None if bound is None else bound / math.tau),
        "step_amplitude": Figure(found.measurements.amplitude, "V", 2.0 * found.rest_error),
        "margin": Figure(None if margin is None else margin.factor),
    }
    channels = found.measurements.channels
    rests = [{"equilibrium": Figure(v, "V", found.rest_error)} for v in found.rest.tolist()]
    return Record(
        overall(judged).value if judged else Outcome.PASS.value,
        "statespace",
        "statespace",
        None,
        "" if decisive is None else decisive.text,
        max((each.state for each in channels), key=record.STATES.index).value,
        poles.stable,
        *record.three(figures),
        judged,
        tuple(map(record.Channel.of, channels, rests)),
    )
