"""Expressions of B, E, F, G and H cards: polynomials, tables, and sums of voltages."""

from __future__ import annotations

import ast
import re
from itertools import chain, combinations_with_replacement, count

from taction.netlist_gen.deck.foreign_lines import LONGEST, beyond, number

DEEPEST = 50  # parentheses within one another
Probe = tuple[str, ...]
"""``("v", a, b)``: the voltage from a to b; ``("i", source)``: the current of a source; (): 1."""
Sum = dict[Probe, float]
"""Coefficients of a linear expression."""
_POLY = re.compile(r"([efgh])(\S+) (\S+) (\S+) poly ?\(? ?(\d+)\b ?\)? ?(.*)")
_TABLE = re.compile(
    r"([egi])(\S+) (\S+) (\S+) (?:([^\s{}]+ [^\s{}]+) )?(?:table|tbl) ?(?:\{([^{}]*)\})? ?=? ?(.*)"
)
_CALL = re.compile(r"(?<![\w.])(?:table|tbl) ?\((?=[^()]*[(,])")
_POINT = re.compile(r"\{[^{}]*\}|[^\s(),{}]+")
_PROBE = re.compile(r"\b([vi])\s*\(\s*([^\s(),]+)\s*(?:,\s*([^\s(),]+)\s*)?\)")
_PLAIN = re.compile(r"-?[0-9.]+(?:e[+-]?[0-9]+)?")
_TOKEN = re.compile(r"[a-z_]\w*|(?:\d+(?:\.\d*)?|\.\d+)(?:e[+-]?\d+)?[a-z]*")


def without_poly(text: str) -> str:
    """Return a card with ``POLY`` as a B card with its expression; any other card as it is.

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


def without_calls(text: str) -> str:
    """Return a card with each call of ``table`` or ``tbl`` as an expression of straight lines."""
    for _ in range(DEEPEST):
        every = list(_CALL.finditer(text))
        if not every:
            return text
        begin, depth = every[-1], 0  # the innermost one, or one after it
        words = [""]
        for end in range(begin.end(), len(text)):
            letter = text[end]
            if letter == ")" and depth == 0:
                break
            depth += (letter == "(") - (letter == ")")
            if letter == "," and depth == 0:
                words.append("")
            else:
                words[-1] += letter
        else:
            raise ValueError("parentheses that do not match")
        value, points = f"({words[0].strip()})", map(_point, words[1:])
        text = f"{text[: begin.start()]}{piecewise(value, *points)}{text[end + 1 :]}"
        if len(text) > LONGEST:
            raise ValueError(beyond(len(text), "characters with tables written anew", LONGEST))
    raise ValueError(f"more than {DEEPEST} tables in an expression")


def without_table(text: str) -> str:
    """Return a card with a table, of PSpice or LTspice, as a B card with its expression.

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
    made = piecewise(f"({inner or across})", *map(_point, _POINT.findall(points)))
    return f"b{letter}{name} {a} {b} {'v' if letter in 'eh' else 'i'}={made}"


def piecewise(value: str, *points: str) -> str:
    """Return the function of straight lines through points x0, y0, x1, y1, ..., level outside."""
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


def polynomial(inputs: list[str], coefficients: list[float]) -> str:
    """Return SPICE's POLY as an expression of its inputs, ``v(a,b)`` or ``i(source)``.

    The coefficients are those of 1, then of each input, then of each product of two inputs in the
    order ``x1 x1, x1 x2, ..., x2 x2, ...``, of three, and so on. A single coefficient of one input
    is that of the input itself.
    """
    if len(inputs) == 1 and len(coefficients) == 1:
        coefficients = [0.0, *coefficients]
    factors = chain.from_iterable(combinations_with_replacement(inputs, k) for k in count())
    terms, length = list[str](), 0
    for value, each in zip(coefficients, factors, strict=False):
        if value != 0.0:
            terms.append("*".join((repr(value), *each)))
            length += len(terms[-1]) + 1
        if length > LONGEST:
            raise ValueError(beyond(length, "characters in a polynomial written anew", LONGEST))
    return "+".join(terms).replace("+-", "-") or "0.0"


def _point(text: str) -> str:
    """Return a number in plain digits, or an expression in parentheses."""
    try:
        return repr(number(text.strip()))
    except ValueError:
        return f"({text.strip().strip('{}')})"


def affine(text: str) -> Sum:
    """Return the coefficients of an expression by their probes; raise where it is not linear.

    Examples
    --------
    >>> affine("2.5 - 10*(v(a,b) - v(c)/4)")
    {(): 2.5, ('v', 'a', 'b'): -10.0, ('v', 'c', '0'): 2.5}
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
    parts = re.split(r"(P\d+)", inner)
    inner = "".join(part if part.startswith("P") else _TOKEN.sub(plain, part) for part in parts)
    if inner.count("(") > DEEPEST:
        raise ValueError(f"more than {DEEPEST} parentheses")
    try:
        tree = ast.parse(inner.strip().replace("^", "**"), mode="eval").body
        return _sum(tree, probes)
    except (SyntaxError, MemoryError):
        raise ValueError("the expression cannot be read") from None
    except RecursionError:
        raise ValueError("the expression has too many terms; expected several cards") from None


def _sum(node: ast.expr, probes: list[Probe]) -> Sum:
    """Return the coefficients of a tree."""
    match node:
        case ast.Constant(value=float(value)):
            return {(): value}
        case ast.Name(id=name) if name.startswith("P"):
            return {probes[int(name[1:])]: 1.0}
        case ast.UnaryOp(op=ast.USub() | ast.UAdd() as sign, operand=inner):
            return _scaled(_sum(inner, probes), -1.0 if isinstance(sign, ast.USub) else 1.0)
        case ast.BinOp(left=left, op=op, right=right):
            return _both(_sum(left, probes), op, _sum(right, probes))
    raise ValueError(
        "not linear: expected sums of voltages v(a), v(a,b) and currents i(source) times numbers"
    )


def _scaled(one: Sum, factor: float) -> Sum:
    return {probe: factor * value for probe, value in one.items()}


def _both(one: Sum, op: ast.operator, other: Sum) -> Sum:
    value, factor = one.get((), 0.0), other.get((), 0.0)
    by_number, of_number = not other.keys() - {()}, not one.keys() - {()}
    match op:
        case ast.Add() | ast.Sub():
            added = _scaled(other, -1.0 if isinstance(op, ast.Sub) else 1.0)
            return {p: one.get(p, 0.0) + added.get(p, 0.0) for p in {**one, **added}}
        case ast.Mult() if by_number:
            return _scaled(one, factor)
        case ast.Mult() if of_number:
            return _scaled(other, value)
        case ast.Div() if by_number and factor:
            return _scaled(one, 1.0 / factor)
        case ast.Pow() if by_number and of_number and value > 0.0:
            try:
                return {(): value**factor}
            except OverflowError:
                pass
    raise ValueError("not linear: a product or a quotient of voltages, or no number")
