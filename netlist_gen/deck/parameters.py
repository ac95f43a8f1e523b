"""C, gain and lambda as parameters of a deck, and the values that follow from them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from taction.netlist_gen.board.circuit import Circuit, Fact

ROUNDING = 1e-12  # relative: above it a value of the board is not what its expression gives


@dataclass(frozen=True, slots=True)
class Parameters:
    """The head of a deck with parameters, and the expressions of its parts.

    Attributes
    ----------
    lines : tuple of str
        Cards ``.param`` and comments, in the words of ngspice.
    expressions : dict of str to str
        Expression in the place of the number, by the name of the card.
    """

    lines: tuple[str, ...]
    expressions: Mapping[str, str]


NO_PARAMETERS = Parameters((), {})


def parameters_of(circuit: Circuit, *, fixed_lambda: bool = False) -> Parameters:
    """Return C, gain and lambda of `circuit` as parameters.

    The parameters are the facts that are knobs with a margin, and lambda; R follows from them. The
    topology states the expressions of the parts.

    Parameters
    ----------
    fixed_lambda : bool
        Whether lambda stays the number that it is, for a deck whose measures hold for it alone.

    Raises
    ------
    ValueError
        A part of the board has another value than its expression.

    Examples
    --------
    >>> import taction
    >>> found = parameters_of(taction.synthesise(taction.load_scene("scenes/known-readings.toml")))
    >>> found.lines[1:4]
    ('.param C=1.5e-11', '.param gain=1000000.0', '.param lambda=0.05')
    >>> found.expressions["Rs_1"], found.expressions["Cc_1"], found.expressions["Rr_1"]
    ('gain', 'C', 'R')
    """
    free = [knob.name for knob in circuit.knobs if knob.margin]
    free += [] if fixed_lambda else ["lambda"]
    lines = [
        "* edit these numbers; the values of all other parts stay as they are",
        *(f".param {name}={circuit.value(name)!r}" for name in free),
        *(f".param {fact.name}={{{_law(circuit, fact, free)}}}" for fact in _following(circuit)),
        "* the stop time and the steps hold for the numbers that taction wrote",
    ]
    values = {part.card: part.ohms for part in circuit.resistors}
    values |= {part.card: part.farads for part in circuit.capacitors}
    expressions: dict[str, str] = {}
    for card, (text, number) in circuit.expressions.items():
        if not math.isclose(number, values[card], rel_tol=ROUNDING):
            raise ValueError(
                f"{card} is {values[card]!r}, but its expression {text} gives {number!r}"
            )
        expressions[card] = text
    return Parameters(tuple(lines), expressions)


def _following(circuit: Circuit) -> list[Fact]:
    return [fact for fact in circuit.facts.values() if fact.follows is not None]


def _law(circuit: Circuit, fact: Fact, free: Sequence[str]) -> str:
    """Return the expression of a fact that follows from others; those not `free` are numbers."""
    number, over = fact.follows or (fact.value, ())
    for name in over:
        if name not in free:
            number /= circuit.value(name)
    names = "*".join(name for name in over if name in free)
    return f"{number!r}/({names})" if "*" in names else f"{number!r}/{names}"
