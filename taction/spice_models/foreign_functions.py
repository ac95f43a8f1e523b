"""Functions of a foreign netlist (``.func``): how long its expressions become, and who calls what.

A simulator writes the text of a function in the place of each call, so that 40 functions that each
call the one before twice become a text of 10^12 characters. Here the characters are only counted.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from taction.spice_models.foreign_lines import MOST_WRITTEN, Card, beyond

_FUNC = re.compile(r"\.func ([a-z_]\w*) ?\(([^()]*)\) ?=? ?(.*)")
_WORD = re.compile(r"[a-z_]\w*")
_PIECE = re.compile(r"[a-z_]\w*|[(),]|[^a-z_(),]+")
_MOST = 10**12  # characters: more are not told apart
Length = Counter[str]
"""Characters of a text: its own by ``""``, and how often each parameter stands in it."""


@dataclass(slots=True)
class _Open:
    """A parenthesis that is open: the function before it, and what stands between its commas."""

    name: str
    arguments: list[Length] = field(default_factory=lambda: [Counter()])

    @property
    def count(self) -> int:
        """How many arguments it has."""
        return len(self.arguments) if self.arguments != [Counter()] else 0


@dataclass(slots=True)
class _Function:
    """A function: its parameters, its length with all others in it, and those that it calls."""

    parameters: list[str]
    length: Length


def calls(text: str) -> Iterator[tuple[str, int]]:
    """Yield each function that is called in a text, with the number of its arguments.

    Examples
    --------
    >>> list(calls("r1 a b {gauss(10k,0.1,3)*sqrt(2)}"))
    [('gauss', 3), ('sqrt', 1)]
    """
    for found in _closed(text, {}, ()):
        if found.name:
            yield found.name, found.count


def check_functions(cards: Sequence[Card]) -> None:
    """Refuse expressions that are too long with every function in its place.

    Raises
    ------
    Exception
        The error of the card with which they have more than `MOST_WRITTEN` characters, or of a
        function that calls itself.
    """
    made, total = dict[str, tuple[Card, re.Match[str]]](), 0

    def count(card: Card, characters: int) -> int:
        if characters > MOST_WRITTEN:
            text = "characters with every .func in the place of its calls"
            raise card.refused(beyond(characters, text, MOST_WRITTEN))
        return characters

    for card in cards:
        if card.text.startswith(".func") and (match := _FUNC.fullmatch(card.text)):
            made[match[1]] = card, match
            total = count(card, total + len(card.text))
    known: dict[str, _Function] = {}
    for name in _in_order(made):
        card, match = made[name]
        parameters = [word.strip() for word in match[2].split(",")]
        known[name] = _Function(parameters, _length(match[3], known, parameters))
        total = count(card, total + known[name].length.total() - len(match[3]))
    for card in cards:
        if known.keys() & set(_WORD.findall(card.text)) and not card.text.startswith(".func"):
            total = count(card, total + len(card.text))
            total = count(card, total + _length(card.text, known, ()).total() - len(card.text))


def _in_order(made: Mapping[str, tuple[Card, re.Match[str]]]) -> list[str]:
    """Return the functions, each after those that it calls."""
    order, within = dict[str, None](), list[str]()
    for first in made:
        waiting = [(first, True)]
        while waiting:
            name, new = waiting.pop()
            if not new:  # all that it calls is done
                order[within.pop()] = None
            elif name in within:
                raise made[name][0].refused("a function that calls itself")
            elif name not in order:
                within.append(name)
                waiting.append((name, False))
                inner = {called for called, _ in calls(made[name][1][3])}
                waiting += [(each, True) for each in sorted(inner & made.keys())]
    return list(order)


def _length(text: str, known: Mapping[str, _Function], parameters: Sequence[str]) -> Length:
    """Return the length of a text with all functions in it."""
    *_, whole = _closed(text, known, parameters)
    return whole.arguments[0]


def _closed(
    text: str, known: Mapping[str, _Function], parameters: Sequence[str]
) -> Iterator[_Open]:
    """Yield every pair of parentheses when it is closed, and the whole text as the last one."""
    open_ones, word = [_Open("")], ""
    for piece in _PIECE.findall(text):
        if piece == "(":
            open_ones[-1].arguments[-1][""] -= len(word) if word in known else 0
            open_ones.append(_Open(word))
        elif piece == "," and len(open_ones) > 1:
            open_ones[-1].arguments.append(Counter())
        elif piece == ")" and len(open_ones) > 1:
            found = open_ones.pop()
            yield found
            _add(open_ones[-1].arguments[-1], _written(found, known))
        else:
            key = piece if piece in parameters else ""
            open_ones[-1].arguments[-1][key] += 1 if key else len(piece)
        word = piece if piece[0].isalpha() or piece[0] == "_" else ""
    while len(open_ones) > 1:  # one that is never closed
        found = open_ones.pop()
        _add(open_ones[-1].arguments[-1], _written(found, known))
    yield open_ones[0]


def _written(found: _Open, known: Mapping[str, _Function]) -> Length:
    """Return the length of a pair of parentheses, or of the function that is called with it."""
    if (function := known.get(found.name)) is None:
        total: Length = Counter({"": 1 + len(found.arguments)})
        for each in found.arguments:
            _add(total, each)
        return total
    total = Counter({"": 2 + function.length[""]})
    for name, argument in zip(function.parameters, found.arguments, strict=False):
        _add(total, argument, function.length[name])
    return total


def _add(total: Length, more: Length, times: int = 1) -> None:
    for key, count in more.items():
        total[key] = min(total[key] + times * count, _MOST)
