"""Functions of a foreign netlist (``.func``): how long its expressions become.

A simulator writes the text of a function in the place of each call, so that 40 functions that each
call the one before twice become a text of 10^12 characters. Here it is written up to a limit.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from taction.netlist_gen.deck.foreign_lines import MOST_WRITTEN, Card

DEEPEST = 200  # calls and parentheses within one another
TOO_LONG = (
    f"over {MOST_WRITTEN:,} characters with every .func in the place of its calls;"
    f" at most {MOST_WRITTEN:,} are read"
)
_FUNC = re.compile(r"\.func ([a-z_]\w*) ?\(([^()]*)\) ?=? ?(.*)")
_WORD = re.compile(r"[a-z_]\w*")
_INNERMOST = re.compile(r"([a-z_]\w*)? ?\(([^()]*)\)")
Functions = Mapping[str, tuple[list[str], str]]  # parameters and text, by name


def check_functions(cards: Sequence[Card]) -> None:
    """Refuse the card with which expressions are too long with every function in its place."""
    made, left = dict[str, tuple[list[str], str]](), MOST_WRITTEN
    for card in cards:
        if card.text.startswith(".func") and (match := _FUNC.fullmatch(card.text)):
            made[match[1]] = [word.strip() for word in match[2].split(",")], match[3]
    for card in cards:
        match = _FUNC.fullmatch(card.text)
        text = match[3] if match else card.text
        if not match and made.keys().isdisjoint(_WORD.findall(text)):
            continue
        try:
            left -= len(written(text, made, left))
        except ValueError as error:
            raise card.refused(str(error)) from None


def written(text: str, functions: Functions, most: int) -> str:
    """Return a text with functions in the place of their calls; ``[ ; ]`` stand for ``( , )``.

    Raises
    ------
    ValueError
        It would have more than `most` characters, or has more than `DEEPEST` calls and parentheses
        within one another.

    Examples
    --------
    >>> written("1+f(g(a,b),3)", {"f": (["x", "y"], "x*(x-y)")}, 100)
    '1+[g[a;b]*[g[a;b]-3]]'
    """
    left = most

    def within(match: re.Match[str]) -> str:
        name, inner = match[1] or "", match[2]
        if name not in functions:
            return f"{name}[{inner.replace(',', ';')}]"
        parameters, body = functions[name]
        given = dict(zip(parameters, inner.split(","), strict=False))
        nonlocal left
        left -= len(body) + sum(len(given.get(word, "")) for word in _WORD.findall(body))
        if left < 0:
            raise ValueError(TOO_LONG)
        return f"({_WORD.sub(lambda word: given.get(word[0], word[0]), body)})"

    for _ in range(DEEPEST):
        if len(text) > most:
            raise ValueError(TOO_LONG)
        text, count = _INNERMOST.subn(within, text)
        if not count:
            return text
    raise ValueError(f"a function that calls itself, or more than {DEEPEST} within one another")
