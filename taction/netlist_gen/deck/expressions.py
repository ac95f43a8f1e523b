"""Expressions of B, E, F, G and H cards: sums, polynomials, tables and transfer functions.

A transfer function becomes a chain of states, each the voltage of a capacitor.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import chain, combinations_with_replacement, count, pairwise

SUFFIXES = {
    "meg": 1e6, "mil": 25.4e-6, "t": 1e12, "g": 1e9, "k": 1e3, "m": 1e-3, "u": 1e-6, "n": 1e-9,
    "p": 1e-12, "f": 1e-15,
}  # fmt: skip
_NUMBER = re.compile(r"([+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:e[+-]?\d+)?)([a-z]*)")
LONGEST = 20_000  # characters of a line, with its continuations, and of an expression written anew
DEEPEST = 50  # parentheses within one another
OWN = "_taction_"  # in names of cards that are made: such parts are no knobs
Probe = tuple[str, ...]
"""``("v", a, b)``: the voltage from a to b; ``("i", source)``: the current of a source; (): 1."""
NOT_LINEAR = (
    "not linear: expected sums of voltages v(a), v(a,b) and currents i(source) times numbers"
)
_OPERATORS: dict[type, Callable[[_Ratio, _Ratio], _Ratio]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul,
    ast.Div: operator.truediv, ast.Pow: operator.pow,
}  # fmt: skip
_LEAF = re.compile(r"[a-z_]\w*|(?:\d+(?:\.\d*)?|\.\d+)(?:e[-+]?\d+)?[a-z]*", re.I)
_PROBE = re.compile(r"\b([vi])\s*\(\s*([^\s(),]+)\s*(?:,\s*([^\s(),]+)\s*)?\)")


def number(text: str) -> float:
    """Return a SPICE number: ``M`` is milli, ``MEG`` mega, further letters are a unit."""
    match = _NUMBER.fullmatch(text)
    if match is None:
        raise ValueError(f"{text!r} is not a number")
    scale = next((by for suffix, by in SUFFIXES.items() if match[2].startswith(suffix)), 1.0)
    value = float(match[1]) * scale
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is not finite")
    return value


def beyond(count: int, what: str, most: int) -> str:
    """Return the reason for a refusal, such as ``"9 cards; at most 8 are read"``."""
    return f"{count:,} {what}; at most {most:,} are read"


def _evaluated(text: str, leaf: Callable[[str | float], _Ratio], refused: str) -> _Ratio:
    """Return an expression of what `leaf` makes of its names, numbers and calls."""

    def plain(match: re.Match[str]) -> str:
        word = match[0]
        return word if word[0].isalpha() or word[0] == "_" else repr(number(word))

    def value(node: ast.expr) -> _Ratio:
        match node:
            case ast.Constant(value=float(constant)):
                return leaf(constant)
            case ast.Name() | ast.Call():
                return leaf(ast.unparse(node))
            case ast.UnaryOp(op=ast.USub() | ast.UAdd() as sign, operand=inner):
                return leaf(-1.0 if isinstance(sign, ast.USub) else 1.0) * value(inner)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                return _OPERATORS[type(op)](value(left), value(right))
        raise ValueError(refused)

    if text.count("(") > DEEPEST:
        raise ValueError(f"more than {DEEPEST} parentheses")
    try:
        tree = ast.parse(_LEAF.sub(plain, text.strip()).replace("^", "**"), mode="eval")
        return value(tree.body)
    except (SyntaxError, MemoryError):
        raise ValueError(f"the expression {text[:40]!r} cannot be read; {refused}") from None
    except RecursionError:
        raise ValueError("the expression has too many terms; expected several cards") from None
    except ZeroDivisionError:
        raise ValueError(f"a denominator of 0; {refused}") from None
    except OverflowError:
        raise ValueError(f"a number that is not finite; {refused}") from None


Coefficient = float | str  # a number, or an expression of parameters
Form = dict[tuple[str, ...], Coefficient]
"""Coefficients by the product of unknowns, such as ``("s", "s")``; those that are 0 are absent."""
HIGHEST = 12  # order of a transfer function
RATIONAL = "expected a quotient of polynomials of s, such as {1e5/(1+s/62.8)}, of order 0 to 12"


def _joined(sign: str, one: Coefficient, other: Coefficient) -> Coefficient:
    """Return a sum or a product: a number where both are numbers."""
    if isinstance(one, float) and isinstance(other, float):
        return one + other if sign == "+" else one * other
    return f"({one}{sign}{other})" if sign == "+" or one != 1.0 else other


def _sum(one: Form, other: Form) -> Form:
    every = {**one, **other} | {k: _joined("+", one[k], other[k]) for k in one.keys() & other}
    return {k: each for k, each in every.items() if each != 0.0}


def _product(one: Form, other: Form) -> Form:
    if max(map(len, one), default=0) + max(map(len, other), default=0) > 2 * HIGHEST:
        raise ValueError(f"an order above {2 * HIGHEST}; {RATIONAL}")
    found: Form = {}
    for i, a in one.items():
        for j, b in other.items():
            found = _sum(found, {tuple(sorted(i + j)): _joined("*", a, b)})
    return found


@dataclass(frozen=True, slots=True)
class _Ratio:
    """A quotient of sums."""

    above: Form
    below: Form = field(default_factory=lambda: {(): 1.0})

    @property
    def value(self) -> float | None:
        """A plain number, None where it is none."""
        found = self.above.get((), 0.0)
        alone = self.below == {(): 1.0} and not self.above.keys() - {()}
        return found if alone and isinstance(found, float) else None

    def __add__(self, other: _Ratio) -> _Ratio:
        if self.below == other.below:
            return _Ratio(_sum(self.above, other.above), self.below)
        crossed = _product(self.above, other.below), _product(other.above, self.below)
        return _Ratio(_sum(*crossed), _product(self.below, other.below))

    def __sub__(self, other: _Ratio) -> _Ratio:
        return self + _Ratio({(): -1.0}) * other

    def __mul__(self, other: _Ratio) -> _Ratio:
        return _Ratio(_product(self.above, other.above), _product(self.below, other.below))

    def __truediv__(self, other: _Ratio) -> _Ratio:
        if (value := other.value) is not None:
            return self * _Ratio({(): 1.0 / value})
        return self * _Ratio(other.below, other.above)

    def __pow__(self, other: _Ratio) -> _Ratio:
        base, power = self.value, other.value
        if base is not None and power is not None and base > 0.0:
            return _Ratio({(): base**power})
        if power is None or power not in range(HIGHEST + 1):
            raise ValueError(f"no quotient of polynomials; {RATIONAL}")
        found = _Ratio({(): 1.0})
        for _ in range(int(power)):
            found = found * self
        return found


def affine(text: str) -> dict[Probe, float]:
    """Return the coefficients of an expression by their probes; ValueError: it is not linear."""
    probes: dict[str, Probe] = {}

    def placed(match: re.Match[str]) -> str:
        kind, one, other = match.groups()
        name = f"P{len(probes)}"
        probes[name] = (kind, one, other or "0") if kind == "v" else (kind, one)
        return name

    def leaf(found: str | float) -> _Ratio:
        if isinstance(found, str) and found not in probes:
            raise ValueError(NOT_LINEAR)
        return _Ratio({(): found} if isinstance(found, float) else {(found,): 1.0})

    made = _evaluated(_PROBE.sub(placed, text.strip().strip("{}'")), leaf, NOT_LINEAR)
    if made.below != {(): 1.0} or max(map(len, made.above), default=0) > 1:
        raise ValueError(NOT_LINEAR)
    found = dict[Probe, float]()
    for names, value in made.above.items():
        probe = probes[names[0]] if names else ()
        found[probe] = found.get(probe, 0.0) + float(value)
    return found


_POLY = re.compile(r"([efgh])(\S+) (\S+) (\S+) poly ?\(? ?(\d+)\b ?\)? ?(.*)")
_POLY_OF_B = re.compile(r"b(\S+) (\S+) (\S+) ([vi]) ?= ?\{ ?poly ?\( ?(\d+) ?\) ?(.*)\}")  # Xyce's
_TABLE = re.compile(
    r"([egi])(\S+) (\S+) (\S+) (?:([^\s{}]+ [^\s{}]+) )?(?:table|tbl) ?(?:\{([^{}]*)\})? ?=? ?(.*)"
)
_CALL = re.compile(r"(?<![\w.])(?:table|tbl) ?\((?=[^()]*[(,])")
_POINT = re.compile(r"\{[^{}]*\}|[^\s(),{}]+")
_PLAIN = re.compile(r"-?[0-9.]+(?:e[+-]?[0-9]+)?")


def as_expression(text: str) -> str:
    """Return a card with ``POLY`` or a table as a B card; any other card as it is."""
    if match := _POLY_OF_B.fullmatch(text):
        name, a, b, kind, many, rest = match.groups()
        kinds = {probe[1] for probe in _PROBE.finditer(rest)}
        named = _PROBE.sub(
            lambda probe: f"{probe[2]} {(probe[3] or '0') * (probe[1] == 'v')}", rest
        )
        if len(kinds) != 1:
            raise ValueError("POLY needs its inputs: voltages v(a,b), or currents i(source)")
        return f"b{name} {a} {b} {kind}={polynomial('v' in kinds, many, named)}"
    if match := _POLY.fullmatch(text):
        letter, name, a, b, many, rest = match.groups()
        made = polynomial(letter in "eg", many, rest)
    elif match := _TABLE.fullmatch(text):
        letter, name, a, b, across, inner, points = match.groups()
        across = across and f"v({','.join(across.split())})"
        across = across or (f"v({a},{b})" if letter == "i" else "")
        if not (inner or across):
            raise ValueError("a table needs its expression: TABLE {expression} = (x,y) (x,y) ...")
        made = _piecewise(inner or across, _POINT.findall(points))
    else:
        return text
    return f"b{letter}{name} {a} {b} {'v' if letter in 'eh' else 'i'}={made}"


def polynomial(by_voltage: bool, many: str, rest: str) -> str:
    """Return SPICE's ``POLY(many)`` of the names of its inputs and its coefficients.

    It is an expression of ``v(a,b)`` or ``i(source)``. The coefficients, numbers or expressions of
    parameters, are those of 1, then of each input, then of each product of two inputs in the order
    ``x1 x1, x1 x2, ..., x2 x2, ...``, of three, and so on. A single coefficient of one input is
    that of the input itself.
    """
    if len(many) > len(str(LONGEST)):
        raise ValueError(f"POLY of {many[:20]}... inputs; expected as many as the card has")
    words, width = re.sub(r"[(),]", " ", rest).split(), int(many) * (2 if by_voltage else 1)
    if len(words) <= width:
        raise ValueError(f"POLY({many}) needs {width} names of its inputs, and coefficients")
    pairs = zip(words[:width:2], words[1:width:2], strict=False)
    inputs = [f"v({p},{q})" for p, q in pairs] if by_voltage else [f"i({w})" for w in words[:width]]
    coefficients = words[width:]
    if len(inputs) == len(coefficients) == 1:
        coefficients = ["0", *coefficients]
    factors = chain.from_iterable(combinations_with_replacement(inputs, k) for k in count())
    terms, length = list[str](), 0
    for word, each in zip(coefficients, factors, strict=False):
        if (value := _point(word)) != "0.0":
            terms.append("*".join((value, *each)))
            length += len(terms[-1]) + 1
        if length > LONGEST:
            raise ValueError(beyond(length, "characters in a polynomial written anew", LONGEST))
    return "+".join(terms).replace("+-", "-") or "0.0"


def without_calls(text: str) -> str:
    """Return a card with each call of ``table`` or ``tbl`` as an expression of straight lines."""
    for _ in range(DEEPEST):
        every = list(_CALL.finditer(text))
        if not every:
            return text
        begin, depth = every[-1], 0  # the innermost one, or one after it
        places = [begin.end()]  # where its arguments begin
        for end in range(begin.end(), len(text)):
            depth += (text[end] == "(") - (text[end] == ")")
            if depth < 0 or (depth == 0 and text[end] == ","):
                places.append(end + 1)
            if depth < 0:
                break
        else:
            raise ValueError("parentheses that do not match")
        words = [text[one : other - 1] for one, other in pairwise(places)]
        made = _piecewise(words[0].strip(), words[1:])
        text = f"{text[: begin.start()]}{made}{text[end + 1 :]}"
        if len(text) > LONGEST:
            raise ValueError(beyond(len(text), "characters with tables written anew", LONGEST))
    raise ValueError(f"more than {DEEPEST} tables in an expression")


def _piecewise(value: str, points: list[str]) -> str:
    """Return the function of straight lines through points x0, y0, x1, y1, ..., level outside."""
    x, y = list(map(_point, points[::2])), list(map(_point, points[1::2]))
    if not y or len(x) != len(y):
        raise ValueError("a table needs pairs of numbers")
    terms = [y[0]]
    for k in range(1, len(x)):
        if all(map(_PLAIN.fullmatch, x[k - 1 : k + 1])) and not float(x[k]) > float(x[k - 1]):
            raise ValueError(f"a table in which {x[k]} follows {x[k - 1]}")
        rise, run = f"(({y[k]})-({y[k - 1]}))", f"(({x[k]})-({x[k - 1]}))"
        terms.append(f"{rise}/{run}*(max(min(({value}),{x[k]}),{x[k - 1]})-({x[k - 1]}))")
    return f"({'+'.join(terms)})"


def _point(text: str) -> str:
    """Return a number in plain digits, or an expression in parentheses."""
    try:
        return repr(number(text.strip()))
    except ValueError:
        return f"({text.strip().strip('{}')})"


FARADS = 1e-9  # of a state
_LAPLACE = (  # of PSpice, of LTspice, and of LTspice's B
    re.compile(r"([eg]\S*) (\S+) (\S+) laplace ?=? ?\{(?P<inner>[^{}]*)\} ?=? ?[{(](.*)[)}]"),
    re.compile(r"([eg]\S*) (\S+) (\S+) (?P<plus>\S+) (?P<minus>\S+) laplace ?= ?(.+)"),
    re.compile(r"(b\S*) (\S+) (\S+) (?P<kind>[vi]) ?= ?(?P<inner>.+?) laplace ?= ?(.+)"),
)
_OPAMP = re.compile(r"(e\S*) (\S+) (\S+) opamp (\S+) (\S+)")
_NUMERICAL = re.compile(r" (?:window|nfft|mtol) ?= ?\S+")  # of LTspice's inverse transform


def _ratio(text: str) -> _Ratio:
    """Return a transfer function."""

    def leaf(found: str | float) -> _Ratio:
        if found == "s":
            return _Ratio({("s",): 1.0})
        if isinstance(found, str) and re.search(r"\bs\b", found):
            raise ValueError(f"no quotient of polynomials; {RATIONAL}")
        value = found if isinstance(found, float) else f"({found})"
        return _Ratio({(): value} if value else {})

    made = _evaluated(text, leaf, RATIONAL)
    if not made.below:
        raise ValueError(f"a denominator of 0; {RATIONAL}")
    order, highest = (max(map(len, each), default=0) for each in (made.below, made.above))
    if order > HIGHEST or highest > order:
        raise ValueError(f"the order of the numerator is {highest}, above {order}; {RATIONAL}")
    return made


def source_cards(text: str) -> list[str]:
    """Return plain cards for a source with LAPLACE or OPAMP; any other card alone.

    The ideal op-amp of HSPICE makes the voltage between its inputs 0: this voltage times 1 S is the
    only current of a node whose voltage is that of the output.
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
    match = next(filter(None, (each.fullmatch(text) for each in _LAPLACE)), None)
    if match is None:
        raise ValueError("expected E or G with LAPLACE {V(a,b)} {F(s)}, or a b Laplace=F(s)")
    (name, a, b, *_, ratio), given = match.groups(), match.groupdict()
    is_voltage = given.get("kind", "v" if name[0] == "e" else "i") == "v"
    inner = given.get("inner") or f"v({given['plus']},{given['minus']})"
    cards = [f"b{OWN}{name}_u taction_{name}_u 0 v={inner}"]
    cards += _states(name, (a, b), is_voltage, _ratio(ratio.strip().strip("{}'\"")))
    if max(map(len, cards)) > LONGEST:
        raise ValueError(f"a transfer function that is too long; {RATIONAL}")
    return cards


def _states(name: str, ends: tuple[str, str], is_voltage: bool, ratio: _Ratio) -> list[str]:
    """Return the cards of the states and of the output.

    With ``p = s / w`` the voltage of node k is ``p^k x``. Capacitors hold all but the last one,
    which has ``sum below_k w^k p^k x = u``; the output is ``sum above_k w^k p^k x``. All
    coefficients are shares of the lowest one of the denominator.
    """
    node, own = f"taction_{name}", f"{OWN}{name}"
    by_order = sorted(ratio.below, key=len)
    first, order = len(by_order[0]), len(by_order[-1])
    lowest, highest = ratio.below[by_order[0]], ratio.below[by_order[-1]]
    w = f"abs(({lowest})/({highest}))**{1.0 / (order - first)!r}" if order > first else "1"
    below, above = (
        {len(s): f"({each})/({lowest})*({w})**{len(s)}" for s, each in form.items()}
        for form in (ratio.below, ratio.above)
    )
    *states, last = nodes = [f"{node}_{k}" for k in range(order + 1)]
    a, b = ("0", f"{node}_y") if is_voltage else ends
    currents = [("0", one, other, f"{FARADS!r}*{w}") for one, other in pairwise(nodes)]
    currents += [(last, "0", nodes[k], each) for k, each in below.items()]
    currents += [("0", last, f"{node}_u", "1")]
    currents += [(a, b, nodes[k], each) for k, each in above.items()]
    cards = [f"c{own}_{k} {state} 0 {FARADS!r}" for k, state in enumerate(states)]
    if is_voltage:
        currents.append((b, "0", b, "1"))
        cards.append(f"e{own}_y {ends[0]} {ends[1]} {b} 0 1")
    return cards + [
        f"g{own}_{k} {one} {other} {control} 0 {{{factor}}}"
        for k, (one, other, control, factor) in enumerate(currents)
    ]
