"""A linear part between any two nodes: every linear card of SPICE, and a source that steps.

What transistors have besides is a charge that flows as a voltage elsewhere changes (Y).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

CONTROLS = {"E": 2, "G": 2, "Y": 2, "F": 1, "H": 1}
"""How many nodes or cards control a part of a letter."""
LETTERS = "RCLKVIEGYFH"


def label_of(letter: str, name: str) -> str:
    """Return the name of a part as its designer wrote it: ``R1``, or ``x1.Rin`` in a subcircuit."""
    path, _, last = name.rpartition(".")  # R.1 and Ra.b are names of the top level
    nested = path.startswith(".")
    return f"{path[1:]}.{last[:1].upper()}{last[1:]}" if nested else letter + name


@dataclass(frozen=True, slots=True)
class Branch:
    """A linear part: the letter of its card, its name, both nodes and its value.

    A current flows from `a` through the part to `b`. `control` has two nodes (E, G, and Y, a charge
    by a voltage), or the card of a source (F, H). K joins two coils: `a` and `b` are their cards.
    """

    letter: str
    name: str
    a: str
    b: str
    value: float  # ohm, F, H, V, A, or a gain
    control: tuple[str, ...] = ()

    @property
    def card(self) -> str:
        """Its name in the deck."""
        return self.letter + self.name

    @property
    def label(self) -> str:
        """Its name as its designer wrote it."""
        return label_of(self.letter, self.name)

    @property
    def nodes(self) -> tuple[str, ...]:
        """The nodes that it touches: both ends, then those that control it."""
        if self.letter == "K":
            return ()
        return self.a, self.b, *(self.control if CONTROLS.get(self.letter) == 2 else ())


@dataclass(frozen=True, slots=True)
class Source(Branch):
    """A source V or I of `value` from t = 0, and of `before` until then."""

    before: float = field(kw_only=True)
    at: float = field(default=0.0, kw_only=True)  # of its first change in its deck, s
    kind: str = field(default="dc", kw_only=True)  # of its waveform there
    ac: bool = field(default=False, kw_only=True)  # whether it has a small signal there

    @property
    def step(self) -> float:
        """What is switched on at t = 0."""
        return self.value - self.before


def check_parts(parts: Iterable[Branch]) -> None:
    """Raise ValueError for a part of a file with a kind, control or value that no part has."""
    every = tuple(parts)
    cards = {part.card for part in every}
    if len(cards) < len(every):
        raise ValueError("linear.parts: expected a name of its own for each part")
    for part in every:
        where = f"linear.parts: {part.card!r}"
        if part.letter not in tuple(LETTERS):
            raise ValueError(f"{where}: expected one of {' '.join(LETTERS)}")
        if part.letter in "RL" and part.value == 0.0:
            raise ValueError(f"{where}: expected a value other than 0")
        wanted = CONTROLS.get(part.letter, 0)
        if len(part.control) != wanted:
            raise ValueError(f"{where}: expected {wanted} controls")
        known = (part.a, part.b) if part.letter == "K" else part.control if wanted == 1 else ()
        if lacking := [card for card in known if card not in cards]:
            raise ValueError(f"{where}: there is no part {lacking[0]!r}")
