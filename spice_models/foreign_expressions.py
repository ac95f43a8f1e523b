"""Numbers and expressions of a foreign netlist: only functions on a list, written anew."""

from __future__ import annotations

import math
import re
from collections.abc import Collection

_FUNCTIONS = """
    abs acos acosh asin asinh atan atanh ceil cos cosh exp floor int ln log log10 max min nint
    pow pwr pwrs sgn sin sinh sqrt tan tanh u uramp
"""
FUNCTIONS = frozenset(_FUNCTIONS.split())
SUFFIXES = {
    "meg": 1e6, "mil": 25.4e-6, "t": 1e12, "g": 1e9, "k": 1e3, "m": 1e-3, "u": 1e-6, "n": 1e-9,
    "p": 1e-12, "f": 1e-15,
}  # fmt: skip
NAME = re.compile(r"[a-z0-9_][a-z0-9_+\-]*")
_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)([a-z]*)")
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?[a-z]*)"
    r"|(?P<probe>[vi]\s*\(\s*[a-z0-9_][a-z0-9_+\-]*(?:\s*,\s*[a-z0-9_][a-z0-9_+\-]*)?\s*\))"
    r"|(?P<name>[a-z_][a-z0-9_]*)|(?P<operator>\*\*|<=|>=|==|!=|&&|\|\||[-+*/^<>!?:,()]))"
)


def number(text: str) -> float:
    """Return a SPICE number: ``M`` is milli, ``MEG`` mega, further letters are a unit.

    Raises
    ------
    ValueError
        The text is no number, or not finite.

    Examples
    --------
    >>> number("2.2k"), number("10meg"), number("3pf")
    (2200.0, 10000000.0, 3e-12)
    """
    match = _NUMBER.fullmatch(text)
    if match is None:
        raise ValueError(f"{text!r} is not a number")
    value = float(match[1])
    for suffix, scale in SUFFIXES.items():
        if match[2].startswith(suffix):
            value *= scale
            break
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is not finite")
    return value


def expression(text: str, parameters: Collection[str]) -> str:
    """Return an expression with plain numbers.

    Accepted are numbers, `parameters`, ``v(a)``, ``v(a,b)``, ``i(source)``, operators,
    parentheses and the functions of `FUNCTIONS`.

    Raises
    ------
    ValueError
        The text has another name or function, or parentheses that do not match.

    Examples
    --------
    >>> expression("limited*MAX(v(a, b), 1k)".lower(), {"limited"})
    'limited*max(v(a,b),1000.0)'
    """
    parts, place, depth, text = [], 0, 0, text.strip()
    while place < len(text):
        token = _TOKEN.match(text, place)
        if token is None:
            raise ValueError(f"{text[place:][:20]!r} cannot be read in an expression")
        place = token.end()
        kind, word = str(token.lastgroup), token[str(token.lastgroup)]
        if kind == "number":
            word = repr(number(word))
        elif kind == "probe":
            word = word.replace(" ", "")
        elif kind == "name":
            called = text[place:].lstrip().startswith("(")
            if called and word not in FUNCTIONS:
                raise ValueError(f"the function {word!r} is not accepted")
            if not called and word not in parameters:
                raise ValueError(f"the name {word!r} is no parameter")
        depth += (word == "(") - (word == ")")
        if depth < 0:
            break
        parts.append(word)
    if depth or not parts:
        raise ValueError(f"the parentheses of {text[:40]!r} do not match, or it is empty")
    return "".join(parts)


def polynomial(inputs: list[str], coefficients: list[float]) -> str:
    """Return SPICE's POLY as an expression of its inputs, ``v(a,b)`` or ``i(source)``.

    The coefficients are those of 1, then of each input, then of each product of two inputs in the
    order ``x1 x1, x1 x2, ..., x2 x2, ...``. With one input they are those of all its powers, and a
    single coefficient is that of the input itself.

    Raises
    ------
    ValueError
        More coefficients than those of the second degree of several inputs.

    Examples
    --------
    >>> polynomial(["v(3,0)", "v(4,0)"], [0.0, 0.5, 0.5])
    '0.5*v(3,0)+0.5*v(4,0)'
    """
    if len(inputs) == 1 and len(coefficients) == 1:
        coefficients = [0.0, *coefficients]
    powers: list[tuple[str, ...]] = [(), *((x,) for x in inputs)]
    if len(inputs) == 1:
        powers += [(inputs[0],) * degree for degree in range(2, len(coefficients))]
    else:
        powers += [(x, y) for k, x in enumerate(inputs) for y in inputs[k:]]
    if len(coefficients) > len(powers):
        text = f"{len(coefficients)} coefficients of {len(inputs)} inputs: only degree 2 is read"
        raise ValueError(text)
    terms = [
        "*".join((repr(value), *factors))
        for value, factors in zip(coefficients, powers, strict=False)
        if value != 0.0
    ]
    return "+".join(terms).replace("+-", "-") or "0.0"
