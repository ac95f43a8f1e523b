"""What a source of a flat deck does over time: a step, where its card has a function of time."""

from __future__ import annotations

import re
from dataclasses import dataclass

from taction.spice_models.foreign_expressions import number

_WAVE = re.compile(
    r"\b(pulse|pwl|sine?|exp|step|trnoise|trrandom)\s*\(?((?:(?!\b(?:\w+ ?=|[ad]c\b))[^()])*)\)?"
)
REMARKS = {
    "sin": "a sine counts with its offset",
    "noise": "noise over time (trnoise, trrandom) does not count: its source has its DC value",
    "repeated": "a pwl that repeats (r=) does not count: its source has its DC value",
}
"""What is said of kinds of sources that are constant here."""


@dataclass(frozen=True, slots=True)
class Stimulus:
    """What a source does: its value before and after the step, the instant, and the kind."""

    before: float
    after: float
    at: float = 0.0  # of its first change, s
    kind: str = "dc"
    ac: bool = False

    @property
    def moves(self) -> bool:
        """Whether it changes over time."""
        return self.before != self.after


def stimulus_of(text: str) -> Stimulus:
    """Return what a source does, from its card without name and nodes.

    Examples
    --------
    >>> stimulus_of("dc 0 ac 1 pulse(0 2.5 1u 1n 1n 1 2)")
    Stimulus(before=0.0, after=2.5, at=1e-06, kind='pulse', ac=True)
    """
    match = _WAVE.search(text)
    plain = (text[: match.start()] + " " + text[match.end() :]) if match else text
    words, dc, ac = re.sub(r"[=(),]", " ", plain).split(), None, False
    delay, repeats, wave = 0.0, False, match[1] if match else ""
    while words:
        word = words.pop(0)
        if word == "ac":
            ac = True
            _numbers(words)
        elif word in ("distof1", "distof2"):
            _numbers(words)
        elif word == "dc":
            dc = number(words.pop(0)) if words else 0.0
        elif wave == "pwl" and words and word in ("r", "td"):
            value = number(words.pop(0))
            delay, repeats = (value, repeats) if word == "td" else (delay, value >= 0.0)
        else:
            dc = number(word)
    if match is None:
        return Stimulus(dc or 0.0, dc or 0.0, ac=ac)
    given = [number(word) for word in re.split(r"[\s,]+", match[2].strip()) if word]
    if repeats or wave.startswith("tr"):  # ngspice rests at the first value, or at the mean
        rest = given[1] if repeats else given[4] if wave == "trrandom" and given[4:] else 0.0
        rest = rest if dc is None else dc
        return Stimulus(rest, rest, 0.0, "repeated" if repeats else "noise", ac)
    if wave == "pwl":
        changes = zip(given[::2], given[1::2], given[3::2], strict=False)
        at = next((t for t, one, other in changes if one != other), 0.0)
        return Stimulus(given[1], given[1::2][-1], at + delay, "pwl", ac)
    if wave.startswith("sin"):
        return Stimulus(given[0], given[0], delay, "sin", ac)
    at = given[2] if len(given) > 2 else 0.0
    return Stimulus(given[0], given[1], at + delay, "exp" if wave == "exp" else "pulse", ac)


def _numbers(words: list[str]) -> None:
    """Take the numbers at the front of some words: magnitude and phase."""
    while words and words[0] not in ("ac", "dc", "distof1", "distof2"):
        number(words.pop(0))
