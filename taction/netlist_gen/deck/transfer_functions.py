"""Sources with a transfer function (LAPLACE) and ideal op-amps (OPAMP) as plain cards."""

from __future__ import annotations

import ast
import operator
import re
from collections.abc import Callable
from itertools import pairwise, zip_longest

from taction.netlist_gen.deck.foreign_lines import LONGEST, number

OWN = "_taction_"
"""In names of cards that are made: such parts are no knobs."""
HIGHEST = 12  # order of a transfer function
FARADS = 1e-9  # of a state
RATIONAL = "expected a quotient of polynomials of s, such as {1e5/(1+s/62.8)}, of order 0 to 12"
_PSPICE = re.compile(r"([eg]\S*) (\S+) (\S+) laplace ?=? ?\{([^{}]*)\} ?=? ?[{(](.*)[)}]")
_LTSPICE = re.compile(r"([eg]\S*) (\S+) (\S+) (\S+) (\S+) laplace ?= ?(.+)")
_LTSPICE_B = re.compile(r"(b\S*) (\S+) (\S+) ([vi]) ?= ?(.+?) laplace ?= ?(.+)")
_OPAMP = re.compile(r"(e\S*) (\S+) (\S+) opamp (\S+) (\S+)")
_NUMERICAL = re.compile(r" (?:window|nfft|mtol) ?= ?\S+")  # of LTspice's inverse transform
_NUMBER = re.compile(r"(?<![\w.])(?:\d+(?:\.\d*)?|\.\d+)(?:e[-+]?\d+)?[a-z]*")
_SIGNS: dict[str, Callable[[float, float], float]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv,
    "**": operator.pow,
}  # fmt: skip
Coefficient = float | str
Polynomial = list[Coefficient]
"""Coefficients, that of 1 first: numbers, or expressions of parameters."""


def source_cards(text: str) -> list[str]:
    """Return plain cards for a source with LAPLACE or OPAMP; any other card alone.

    A transfer function becomes a chain of states, each the voltage of a capacitor. The ideal op-amp
    of HSPICE makes the voltage between its inputs 0: this voltage times 1 S is the only current of
    a node whose voltage is that of the output.

    Raises
    ------
    ValueError
        The transfer function is no quotient of polynomials, or its numerator has the higher order.

    Examples
    --------
    >>> source_cards("e1 o 0 opamp p n")[:2]
    ['g_taction_e1 0 taction_e1 p n 1', 'e_taction_e1 o 0 taction_e1 0 1']
    >>> source_cards("e1 o 0 p n laplace=10/(1+s/5)")[3:5]
    ['g_taction_e1_0 0 taction_e1_0 taction_e1_u 0 {1e-09}', \
'g_taction_e1_1 0 taction_e1_0 taction_e1_0 0 {-5e-09}']
    """
    if match := _OPAMP.fullmatch(text):
        name, a, b, plus, minus = match.groups()
        inner = f"taction_{name}"
        return [
            f"g{OWN}{name} 0 {inner} {plus} {minus} 1",
            f"e{OWN}{name} {a} {b} {inner} 0 1",
            *(f"g{OWN}{name}_{k} 0 {inner} {inner} 0 {k}" for k in (1, -1)),  # nothing together
        ]
    if "laplace" not in text:
        return [text]
    text = _NUMERICAL.sub("", text)
    if match := _PSPICE.fullmatch(text):
        name, a, b, inner, ratio = match.groups()
    elif match := _LTSPICE.fullmatch(text):
        name, a, b, plus, minus, ratio = match.groups()
        inner = f"v({plus},{minus})"
    elif match := _LTSPICE_B.fullmatch(text):
        name, a, b, _, inner, ratio = match.groups()
    else:
        raise ValueError("expected E or G with LAPLACE {V(a,b)} {F(s)}, or a b Laplace=F(s)")
    out = match[4] if name[0] == "b" else "v" if name[0] == "e" else "i"
    cards = [f"b{OWN}{name}_u taction_{name}_u 0 v={inner}"]
    cards += _states(name, (a, b), out == "v", *_ratio(ratio.strip().strip("{}'\"")))
    if max(map(len, cards)) > LONGEST:
        raise ValueError(f"a transfer function that is too long; {RATIONAL}")
    return cards


def _states(
    name: str, ends: tuple[str, str], is_voltage: bool, above: Polynomial, below: Polynomial
) -> list[str]:
    """Return the cards of the states and of the output.

    With ``p = s / w`` state k is ``p^k x``; ``sum below_k w^k p^k x = u`` gives the last rate.
    """
    order, node, own = len(below) - 1, f"taction_{name}", f"{OWN}{name}"
    if len(above) > len(below) or order > HIGHEST:
        raise ValueError(
            f"the order of the numerator is {len(above) - 1}, above {order}; {RATIONAL}"
        )
    first = next(k for k, each in enumerate(below) if each != 0.0)
    w: Coefficient = 1.0
    if order > first:
        ratio = _folded("/", below[first], below[-1])
        size = abs(ratio) if isinstance(ratio, float) else f"abs({ratio})"
        w = _folded("**", size, 1.0 / (order - first))
    above = above + [0.0] * (len(below) - len(above))
    powers = [_folded("**", w, float(k)) for k in range(order + 1)]
    scaled = [_folded("*", each, power) for each, power in zip(below, powers, strict=True)]
    seen = [_folded("*", each, power) for each, power in zip(above, powers, strict=True)]
    source, states = f"{node}_u", [f"{node}_{k}" for k in range(order)]
    rate, through = _folded("*", FARADS, w), _folded("/", seen[-1], scaled[-1])
    cards = [f"c{own}_{k} {state} 0 {FARADS!r}" for k, state in enumerate(states)]
    currents = [("0", a, b, rate) for a, b in pairwise(states)]
    if order:
        last = _folded("/", rate, scaled[-1])
        currents.append(("0", states[-1], source, last))
        back = [_folded("-", 0.0, _folded("*", last, each)) for each in scaled[:-1]]
        currents += [("0", states[-1], *each) for each in zip(states, back, strict=True)]
    a, b = ("0", f"{node}_y") if is_voltage else ends
    shown = [_folded("-", x, _folded("*", through, y)) for x, y in zip(seen, scaled, strict=True)]
    shown[-1] = through
    currents += [(a, b, *each) for each in zip([*states, source], shown, strict=True)]
    if is_voltage:
        currents.append((b, "0", b, 1.0))
        cards.append(f"e{own}_y {ends[0]} {ends[1]} {b} 0 1")
    cards += [
        f"g{own}_{k} {one} {other} {control} 0 {{{factor}}}"
        for k, (one, other, control, factor) in enumerate(currents)
        if factor != 0.0
    ]
    return cards


def _folded(sign: str, one: Coefficient, other: Coefficient) -> Coefficient:
    """Return an operation of two coefficients: a number where both are numbers."""
    if isinstance(one, float) and isinstance(other, float):
        try:
            return _SIGNS[sign](one, other)
        except (OverflowError, ZeroDivisionError):
            raise ValueError(f"a coefficient that is not finite; {RATIONAL}") from None
    if (sign == "*" and 0.0 in (one, other)) or (sign == "/" and one == 0.0):
        return 0.0
    if (sign in "+-" and other == 0.0) or (sign in "*/**" and other == 1.0):
        return one
    if (sign == "+" and one == 0.0) or (sign == "*" and one == 1.0):
        return other
    return 1.0 if sign == "**" and other == 0.0 else f"({one}{sign}{other})"


def _ratio(text: str) -> tuple[Polynomial, Polynomial]:
    """Return numerator and denominator of a transfer function."""
    plain = _NUMBER.sub(lambda match: repr(number(match[0])), text.replace("^", "**"))
    try:
        above, below = _quotient(ast.parse(plain.strip(), mode="eval").body)
    except (SyntaxError, RecursionError, MemoryError):
        raise ValueError(f"{text[:40]!r} cannot be read; {RATIONAL}") from None
    if below == [0.0]:
        raise ValueError(f"a denominator of 0; {RATIONAL}")
    return above, below


def _quotient(node: ast.expr) -> tuple[Polynomial, Polynomial]:
    one: Polynomial = [1.0]
    match node:
        case ast.Constant(value=float(value)):
            return [value], one
        case ast.Name(id="s"):
            return [0.0, 1.0], one
        case ast.Name(id=name):
            return [f"({name})"], one
        case ast.Call(func=ast.Name(id=name), args=inner) if not any(
            isinstance(each, ast.Name) and each.id == "s" for each in ast.walk(node)
        ):
            return [f"{name}({','.join(ast.unparse(each) for each in inner)})"], one
        case ast.UnaryOp(op=ast.USub() | ast.UAdd() as sign, operand=inner):
            above, below = _quotient(inner)
            return (_product(above, [-1.0]) if isinstance(sign, ast.USub) else above), below
        case ast.BinOp(left=left, op=ast.Pow(), right=ast.Constant(value=float(power))) if (
            power in range(HIGHEST + 1)
        ):
            above, below = _quotient(left)
            return _power(above, int(power)), _power(below, int(power))
        case ast.BinOp(left=left, op=op, right=right):
            return _both(_quotient(left), op, _quotient(right))
    raise ValueError(f"no quotient of polynomials; {RATIONAL}")


def _both(
    one: tuple[Polynomial, Polynomial], op: ast.operator, other: tuple[Polynomial, Polynomial]
) -> tuple[Polynomial, Polynomial]:
    (a, b), (c, d) = one, other
    match op:
        case ast.Mult():
            return _product(a, c), _product(b, d)
        case ast.Div():
            return _product(a, d), _product(b, c)
        case ast.Add() | ast.Sub():
            sign = "+" if isinstance(op, ast.Add) else "-"
            if b == d:
                return _sum_of(a, sign, c), b
            return _sum_of(_product(a, d), sign, _product(c, b)), _product(b, d)
    raise ValueError(f"no quotient of polynomials; {RATIONAL}")


def _sum_of(one: Polynomial, sign: str, other: Polynomial) -> Polynomial:
    return _trimmed([_folded(sign, a, b) for a, b in zip_longest(one, other, fillvalue=0.0)])


def _product(one: Polynomial, other: Polynomial) -> Polynomial:
    if len(one) + len(other) - 2 > 2 * HIGHEST:
        raise ValueError(f"an order above {2 * HIGHEST}; {RATIONAL}")
    found: Polynomial = [0.0] * (len(one) + len(other) - 1)
    for i, a in enumerate(one):
        for j, b in enumerate(other):
            found[i + j] = _folded("+", found[i + j], _folded("*", a, b))
    return _trimmed(found)


def _power(base: Polynomial, power: int) -> Polynomial:
    found: Polynomial = [1.0]
    for _ in range(power):
        found = _product(found, base)
    return found


def _trimmed(found: Polynomial) -> Polynomial:
    while len(found) > 1 and found[-1] == 0.0:
        found = found[:-1]
    return found
