"""Expressions of B, E, F, G and H cards that are linear: polynomials, and sums of voltages."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from taction.spice_models.foreign_expressions import DEEPEST, number, piecewise, polynomial
from taction.spice_models.foreign_lines import LONGEST

Probe = tuple[str, ...]
"""``("v", a, b)``: the voltage from a to b; ``("i", source)``: the current of a source."""
_POLY = re.compile(r"([efgh])(\S+) (\S+) (\S+) poly ?\( ?(\d+) ?\) ?(.*)")
_TABLE = re.compile(
    r"([egi])(\S+) (\S+) (\S+) (?:([^\s{}]+ [^\s{}]+) )?(?:table|tbl) ?(?:\{([^{}]*)\})? ?=? ?(.*)"
)
_POINT = re.compile(r"\{[^{}]*\}|[^\s(),{}]+")
_PROBE = re.compile(r"\b([vi])\s*\(\s*([^\s(),]+)\s*(?:,\s*([^\s(),]+)\s*)?\)")
_TOKEN = re.compile(r"[a-z_]\w*|(?:\d+(?:\.\d*)?|\.\d+)(?:e[+-]?\d+)?[a-z]*")


def without_poly(text: str) -> str:
    """Return a card with ``POLY`` as a B card with its expression; any other card as it is.

    Raises
    ------
    ValueError
        Too few names of inputs, too many coefficients, or one of a higher degree that is no number.

    Examples
    --------
    >>> without_poly("e1 s 0 poly(2) a 0 b 0 0 1 2")
    'be1 s 0 v=0+1*v(a,0)+2*v(b,0)'
    """
    if not (match := _POLY.fullmatch(text)):
        return text
    letter, name, a, b, count, rest = match.groups()
    if len(count) > len(str(LONGEST)):
        raise ValueError(f"POLY of {count[:20]}... inputs; expected as many as the card has")
    words, by_voltage = re.sub(r"[(),]", " ", rest).split(), letter in "eg"
    width = int(count) * (2 if by_voltage else 1)
    if len(words) <= width:
        raise ValueError(f"POLY({count}) needs {width} names of its inputs, and coefficients")
    controls = words[:width]
    if by_voltage:
        inputs = [f"v({p},{q})" for p, q in zip(controls[::2], controls[1::2], strict=False)]
    else:
        inputs = [f"i({source})" for source in controls]
    coefficients = words[width:]
    if 1 < len(coefficients) <= len(inputs) + 1:  # linear, perhaps with parameters
        terms = [coefficients[0], *map("*".join, zip(coefficients[1:], inputs, strict=False))]
        made = "+".join(terms)
    else:
        made = polynomial(inputs, [number(word) for word in coefficients])
    return f"b{letter}{name} {a} {b} {'v' if letter in 'eh' else 'i'}={made}"


def without_table(text: str) -> str:
    """Return a card with a table, of PSpice or LTspice, as a B card with its expression.

    Raises
    ------
    ValueError
        No pairs of numbers, or one that is not above the one before.

    Examples
    --------
    >>> without_table("e1 s 0 table {v(a)} = (0,0) (1,2)")
    'be1 s 0 v=(0.0+((2.0)-(0.0))/((1.0)-(0.0))*(max(min((v(a)),1.0),0.0)-(0.0)))'
    """
    match = _TABLE.fullmatch(text)
    if match is None:
        return text
    letter, name, a, b, across, inner, points = match.groups()
    across = across and f"v({','.join(across.split())})"
    across = across or (f"v({a},{b})" if letter == "i" else "")
    if not (inner or across):
        raise ValueError("a table needs its expression: TABLE {expression} = (x,y) (x,y) ...")
    words = [w.replace("{", "(").replace("}", ")") for w in _POINT.findall(points)]
    words = [w if w[0] == "(" else f"{number(w)!r}" for w in words]
    made = piecewise(f"({inner or across})", *words)
    return f"b{letter}{name} {a} {b} {'v' if letter in 'eh' else 'i'}={made}"


@dataclass(frozen=True, slots=True)
class Affine:
    """``constant + sum of terms``: a coefficient for each probe."""

    constant: float = 0.0
    terms: Mapping[Probe, float] = field(default_factory=dict)

    def scaled(self, factor: float) -> Affine:
        """Return its product with a number."""
        return Affine(factor * self.constant, {p: factor * c for p, c in self.terms.items()})

    def plus(self, other: Affine) -> Affine:
        """Return the sum of both."""
        terms = dict(self.terms)
        for probe, value in other.terms.items():
            terms[probe] = terms.get(probe, 0.0) + value
        return Affine(self.constant + other.constant, terms)


def affine(text: str) -> Affine:
    """Return an expression of voltages and currents as a constant and coefficients.

    Raises
    ------
    ValueError
        It is not linear in them, or has another name or function.

    Examples
    --------
    >>> affine("2.5 - 10*(v(a,b) - v(c)/4)")
    Affine(constant=2.5, terms={('v', 'a', 'b'): -10.0, ('v', 'c', '0'): 2.5})
    """
    probes: list[Probe] = []

    def placed(match: re.Match[str]) -> str:
        kind, one, other = match.groups()
        probes.append((kind, one, other or "0") if kind == "v" else (kind, one))
        return f"P{len(probes) - 1}"

    def plain(match: re.Match[str]) -> str:
        word = match[0]
        return word if word[0].isalpha() or word[0] == "_" else repr(number(word))

    inner = _PROBE.sub(placed, text.strip().strip("{}'"))
    inner = "".join(
        part if part.startswith("P") else _TOKEN.sub(plain, part)
        for part in re.split(r"(P\d+)", inner)
    )
    if inner.count("(") > DEEPEST:
        raise ValueError(f"more than {DEEPEST} parentheses")
    try:
        tree = ast.parse(inner.strip().replace("^", "**"), mode="eval").body
        return _value(tree, probes)
    except (SyntaxError, MemoryError):
        raise ValueError("the expression cannot be read") from None
    except RecursionError:
        raise ValueError("the expression has too many terms; expected several cards") from None


def _value(node: ast.expr, probes: list[Probe]) -> Affine:
    """Return the value of a tree."""
    match node:
        case ast.Constant(value=float(value)):
            return Affine(value)
        case ast.Name(id=name) if name.startswith("P"):
            return Affine(0.0, {probes[int(name[1:])]: 1.0})
        case ast.UnaryOp(op=ast.USub() | ast.UAdd() as sign, operand=inner):
            return _value(inner, probes).scaled(-1.0 if isinstance(sign, ast.USub) else 1.0)
        case ast.BinOp(left=left, op=op, right=right):
            return _both(_value(left, probes), op, _value(right, probes))
    raise ValueError(
        "not linear: expected sums of voltages v(a), v(a,b) and currents i(source) times numbers"
    )


def _both(one: Affine, op: ast.operator, other: Affine) -> Affine:
    if isinstance(op, ast.Add | ast.Sub):
        return one.plus(other.scaled(-1.0 if isinstance(op, ast.Sub) else 1.0))
    if isinstance(op, ast.Mult) and not (one.terms and other.terms):
        return one.scaled(other.constant) if one.terms else other.scaled(one.constant)
    if isinstance(op, ast.Div) and not other.terms and other.constant:
        return one.scaled(1.0 / other.constant)
    if isinstance(op, ast.Pow) and not (one.terms or other.terms) and one.constant > 0.0:
        try:
            return Affine(one.constant**other.constant)
        except OverflowError:
            pass
    raise ValueError("not linear: a product or a quotient of voltages, or no number")
