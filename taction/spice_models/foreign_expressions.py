"""The expressions of a foreign netlist, checked word by word and written anew.

Only functions on a list are accepted. Those of other simulators (``if``, ``limit``, tables) are
written with the functions of ngspice.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterator
from itertools import chain

from taction.spice_models.foreign_lines import LONGEST, beyond

_FUNCTIONS = """
    abs acos acosh asin asinh atan atanh ceil cos cosh exp floor int ln log log10 max min nint
    pow pwr pwrs sgn sin sinh sqrt tan tanh u uramp
"""
FUNCTIONS = frozenset(_FUNCTIONS.split())
CONSTANTS = {"pi": math.pi, "temp": 27.0, "temper": 27.0}  # of names; degrees C
_SPELT = {"|": "||", "&": "&&", "**": "^"}  # operators of other simulators, as ngspice has them
SUFFIXES = {
    "meg": 1e6, "mil": 25.4e-6, "t": 1e12, "g": 1e9, "k": 1e3, "m": 1e-3, "u": 1e-6, "n": 1e-9,
    "p": 1e-12, "f": 1e-15,
}  # fmt: skip
DEEPEST = 50  # parentheses within one another
NAME = re.compile(r"[a-z0-9_][a-z0-9_+\-]*")
SUBCIRCUIT = re.compile(r"[a-z0-9_][a-z0-9_+\-/.]*")  # is never written: it becomes a new name
_NUMBER = re.compile(r"([+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:e[+-]?\d+)?)([a-z]*)")
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?[a-z]*)"
    r"|(?P<probe>[vi]\s*\(\s*[a-z0-9_][a-z0-9_+\-]*(?:\s*,\s*[a-z0-9_][a-z0-9_+\-]*)?\s*\))"
    r"|(?P<call>[a-z_][a-z0-9_]*\s*\()|(?P<name>[a-z_][a-z0-9_]*)"
    r"|(?P<operator>\*\*|<=|>=|==|!=|&&|\|\||[-+*/^<>!?:,()&|]))\s*"
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

    Accepted are numbers, `parameters`, ``pi``, ``v(a)``, ``v(a,b)``, ``i(source)``, operators,
    parentheses, the functions of `FUNCTIONS`, and those of `REWRITTEN`, written with them.

    Raises
    ------
    ValueError
        The text has another name or function, or parentheses that do not match.

    Examples
    --------
    >>> expression("limited*MAX(v(a, b), 1k)".lower(), {"limited"})
    'limited*max(v(a,b),1000.0)'
    >>> expression("if(v(a)>0, v(a), 0)", ())
    '((v(a)>0.0)?(v(a)):(0.0))'
    """
    words, end = _arguments(list(_tokens(text.strip(), parameters)), 0)
    if end is not None or len(words) != 1 or not words[0]:
        raise ValueError(f"the parentheses of {text[:40]!r} do not match, or it is empty")
    return words[0]


def _tokens(text: str, parameters: Collection[str]) -> Iterator[str]:
    """Yield the checked words of an expression; a function has its opening parenthesis."""
    place = 0
    while place < len(text):
        token = _TOKEN.match(text, place)
        if token is None:
            raise ValueError(f"{text[place:][:20]!r} cannot be read in an expression")
        place = token.end()
        kind, word = str(token.lastgroup), token[str(token.lastgroup)].replace(" ", "")
        if kind == "number":
            word = repr(number(word))
        elif kind == "call" and word[:-1] not in FUNCTIONS and word[:-1] not in REWRITTEN:
            raise ValueError(f"the function {word[:-1]!r} is not accepted")
        elif kind == "name" and word not in parameters:
            if word not in CONSTANTS:
                raise ValueError(f"the name {word!r} is no parameter")
            word = repr(CONSTANTS[word])
        yield _SPELT.get(word, word)


def _arguments(tokens: list[str], place: int, depth: int = 0) -> tuple[list[str], int | None]:
    """Return what stands between commas, and the place after the ``)``; None at the end."""
    found = [""]
    if depth > DEEPEST:
        raise ValueError(f"more than {DEEPEST} parentheses within one another")
    while place < len(tokens):
        word, place = tokens[place], place + 1
        if word == ")":
            return found, place
        if word == ",":
            found.append("")
        elif word.endswith("("):
            inner, end = _arguments(tokens, place, depth + 1)
            if end is None or not all(inner) or (word == "(" and len(inner) > 1):
                raise ValueError("parentheses or commas that do not match")
            found[-1] += _called(word, inner)
            place = end
        else:
            found[-1] += word
        if len(found[-1]) > LONGEST:
            text = "characters in an expression written anew"
            raise ValueError(beyond(len(found[-1]), text, LONGEST))
    return found, None


def _called(name: str, arguments: list[str]) -> str:
    """Return a call; `name` has its opening parenthesis."""
    if name[:-1] not in REWRITTEN:
        return f"{name}{','.join(arguments)})"
    try:
        return REWRITTEN[name[:-1]](*arguments)
    except TypeError:
        raise ValueError(f"{len(arguments)} arguments of {name[:-1]!r}") from None


def _choice(condition: str, yes: str, no: str) -> str:
    return f"(({condition})?({yes}):({no}))"


def _limit(value: str, one: str, other: str) -> str:
    return f"min(max({value},min({one},{other})),max({one},{other}))"


def piecewise(value: str, *points: str) -> str:
    """Return the function of straight lines through points x0, y0, x1, y1, ..., level beyond them.

    Raises
    ------
    ValueError
        No pairs, or an x that is not above the one before.

    Examples
    --------
    >>> piecewise("v(a)", "0.0", "1.0", "2.0", "5.0")
    '(1.0+((5.0)-(1.0))/((2.0)-(0.0))*(max(min(v(a),2.0),0.0)-(0.0)))'
    """
    x, y = points[::2], points[1::2]
    if not y or len(x) != len(y):
        raise ValueError("a table needs pairs of numbers")
    terms = [y[0]]
    for k in range(1, len(x)):
        if all(map(_PLAIN.fullmatch, x[k - 1 : k + 1])) and not float(x[k]) > float(x[k - 1]):
            raise ValueError(f"a table in which {x[k]} follows {x[k - 1]}")
        rise, run = f"(({y[k]})-({y[k - 1]}))", f"(({x[k]})-({x[k - 1]}))"
        terms.append(f"{rise}/{run}*(max(min({value},{x[k]}),{x[k - 1]})-({x[k - 1]}))")
    return f"({'+'.join(terms)})"


_PLAIN = re.compile(r"-?[0-9.]+(?:e[+-]?[0-9]+)?")
REWRITTEN: dict[str, Callable[..., str]] = {
    "if": _choice,
    "limit": _limit,
    "table": piecewise,
    "tbl": piecewise,
}
"""Functions of other simulators, written with those of `FUNCTIONS`."""


def polynomial(inputs: list[str], coefficients: list[float]) -> str:
    """Return SPICE's POLY as an expression of its inputs, ``v(a,b)`` or ``i(source)``.

    The coefficients are those of 1, then of each input, then of each product of two inputs in the
    order ``x1 x1, x1 x2, ..., x2 x2, ...``. With one input they are those of all its powers, and a
    single coefficient is that of the input itself.

    Raises
    ------
    ValueError
        More coefficients than those of the second degree of several inputs, or too long.

    Examples
    --------
    >>> polynomial(["v(3,0)", "v(4,0)"], [0.0, 0.5, 0.5])
    '0.5*v(3,0)+0.5*v(4,0)'
    """
    if len(inputs) == 1 and len(coefficients) == 1:
        coefficients = [0.0, *coefficients]
    several = len(inputs) > 1
    most = 1 + len(inputs) + len(inputs) * (len(inputs) + 1) // 2
    if several and len(coefficients) > most:
        text = f"{len(coefficients)} coefficients of {len(inputs)} inputs: only degree 2 is read"
        raise ValueError(text)
    pairs = ((x, y) for k, x in enumerate(inputs) for y in inputs[k:])
    powers = (inputs * k for k in range(len(coefficients)))
    factors = chain([()], ((x,) for x in inputs), pairs) if several else powers
    terms, length = list[str](), 0
    for value, each in zip(coefficients, factors, strict=False):
        if value != 0.0:
            terms.append("*".join((repr(value), *each)))
            length += len(terms[-1]) + 1
        if length > LONGEST:
            raise ValueError(beyond(length, "characters in a polynomial written anew", LONGEST))
    return "+".join(terms).replace("+-", "-") or "0.0"
