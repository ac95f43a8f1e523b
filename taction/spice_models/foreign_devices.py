"""The devices of a foreign netlist, each checked and written anew."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Mapping

from taction.spice_models.foreign_expressions import (
    NAME,
    expression,
    number,
    piecewise,
    polynomial,
)
from taction.spice_models.foreign_lines import Line

MODELS = ("d", "npn", "pnp", "njf", "pjf", "nmos", "pmos", "sw", "vswitch", "res", "r")
_FIELD = re.compile(r"\{[^{}]*\}|[^\s={}]+\s*=\s*(?:\{[^{}]*\}|[^\s={}]+)|[^\s{}=]+")
_KEY = re.compile(r"[a-z][a-z0-9_]*")
_POLY = re.compile(r"poly\s*\(\s*(\d+)\s*\)(.*)")
_VALUE = re.compile(r"value\s*=?\s*\{([^{}]*)\}")
_BRACES = re.compile(r"\{([^{}]*)\}")
_PASSIVE = {"r": {"tc1", "tc2", "tc"}, "c": set[str](), "l": set[str]()}
_WITHOUT_EFFECT = re.compile(r"noiseless|tc ?= ?[^{}]+|ic ?= ?0(?:\.0*)?[a-z]*")
_NODES = {"d": (2, 2), "q": (3, 4), "j": (3, 3), "m": (4, 4), "s": (4, 4)}
_TABLE = re.compile(r"(?:table|tbl) ?(?:\{([^{}]*)\} ?=? ?)?(.*)")
_BRACKETS = re.compile(r"(\{[^{}]*\})|[(),]")  # those within braces stay
_THERMAL = {"tce", "t_abs", "tc1", "tc2"}  # of a resistor: without effect at 27 degrees C
_RANGE = {"ron": 1.0, "roff": 1e6, "von": 1.0, "voff": 0.0}  # of PSpice's switch
_INSTANCE = {"area", "l", "w", "m", "ad", "as", "pd", "ps", "nrd", "nrs"}
LEVELS = {1.0, 2.0, 3.0}


class Names:
    """Names that a device may refer to: `parameters` by their own name, the rest by new names.

    `models` has the card of each model.
    """

    def __init__(
        self, parameters: Collection[str], models: Mapping[str, Line], subcircuits: dict[str, str]
    ) -> None:
        self.parameters, self.models, self.subcircuits = parameters, models, subcircuits

    def has_model(self, name: str, *kinds: str) -> bool:
        """Whether `name` is a model of one of these kinds."""
        return name in self.models and model_kind(self.models[name]) in kinds


def device(line: Line, names: Names) -> str:
    """Return one device, checked.

    Raises
    ------
    RefusedError
        The device, one of its fields or a function is not accepted.
    """
    name, _, rest = line.text.partition(" ")
    try:
        if not NAME.fullmatch(name):
            raise ValueError(f"the name {name!r} is not accepted")
        writer = _WRITERS.get(name[0])
        if writer is None:
            raise ValueError(f"a device {name[0].upper()!r} is not accepted")
        written = writer(name[0], rest, names)
        if name[0] in "egfhis" and "=" in written:
            name = f"b_{name}"
        return f"{name} {written}"
    except ValueError as error:
        raise line.refused(str(error)) from None


def value(text: str, names: Names) -> str:
    """Return a number, or an expression in braces."""
    if match := _BRACES.fullmatch(text.strip()):
        return "{" + expression(match[1], names.parameters) + "}"
    return repr(number(text.strip()))


def assignments(texts: Collection[str], names: Names, known: Collection[str] = ()) -> list[str]:
    """Return ``key=value`` fields; with `known` only these keys."""
    written = []
    for text in texts:
        key, equals, right = (part.strip() for part in text.partition("="))
        if not equals or not _KEY.fullmatch(key):
            raise ValueError(f"the field {text!r} is not accepted")
        if known and key not in known:
            raise ValueError(f"the key {key!r} is not accepted")
        written.append(f"{key}={value(right, names)}")
    return written


_MODEL = re.compile(r"\.model (\S+) ([a-z]+) ?(?:\((.*)\)|(.*))")


def model_kind(line: Line) -> str:
    """Return the kind of a model, ``""`` for no model card."""
    match = _MODEL.fullmatch(line.text)
    return match[2] if match else ""


def model_card(line: Line, names: Names) -> list[str]:
    """Return a ``.model`` card; none for a kind whose devices are written without one.

    ngspice drops the commas of this card, so an expression with commas is a parameter before it.

    Raises
    ------
    RefusedError
        The kind of model, or a parameter, is not accepted.
    """
    try:
        name, kind, fields = _model(line, names)
        if kind in WITHOUT_CARD:
            WITHOUT_CARD[kind](fields)
            return []
        for field in fields:
            if field.startswith("level=") and float(field[6:].strip("{}")) not in LEVELS:
                raise ValueError(f"{field} is not accepted; only levels 1 to 3")
        cards = []
        for k, (key, _, text) in enumerate(field.partition("=") for field in fields):
            if "," in text:
                own = f"of_{re.sub('[^a-z0-9]', '_', name)}_{key}"
                cards.append(f".param {own}={text}")
                fields[k] = f"{key}={{{own}}}"
        return [*cards, f".model {name} {kind}({' '.join(fields)})"]
    except ValueError as error:
        raise line.refused(str(error)) from None


def _model(line: Line, names: Names) -> tuple[str, str, list[str]]:
    """Return name, kind and fields of a model."""
    match = _MODEL.fullmatch(line.text)
    if match is None or not NAME.fullmatch(match[1]):
        raise ValueError("not a model card")
    if match[2] not in MODELS:
        raise ValueError(f"a model {match[2]!r} is not accepted")
    body = match[3] if match[3] is not None else match[4]
    body = re.sub(r"(\{[^{}]*\})|,", lambda found: found[1] or " ", body)
    fields = [field for field in split_fields(body) if not field.startswith("t_abs")]
    return match[1], match[2], assignments(fields, names)


def _thermal(fields: list[str]) -> None:
    """Check a model of resistors: it may have what has no effect at the simulated temperature."""
    for field in fields:
        if field.partition("=")[0] not in _THERMAL:
            raise ValueError(f"{field} of a model of resistors is not accepted")


def _smooth_switch(fields: list[str]) -> tuple[float, float, float, float]:
    """Return ``ron, roff, von, voff`` of a switch of PSpice."""
    given = {key: number(text) for key, _, text in (field.partition("=") for field in fields)}
    if unknown := given.keys() - _RANGE.keys():
        raise ValueError(f"{min(unknown)} of a vswitch is not accepted")
    ron, roff, von, voff = (_RANGE | given).values()
    if not (ron > 0.0 and roff > 0.0 and von != voff):
        raise ValueError("a vswitch needs resistances above 0, and different von and voff")
    return ron, roff, von, voff


WITHOUT_CARD: dict[str, Callable[[list[str]], object]] = {
    "res": _thermal,
    "r": _thermal,
    "vswitch": _smooth_switch,
}
"""Models whose devices are written without a model, and the check of their fields."""


def split_fields(text: str) -> list[str]:
    """Split a card at blanks; a braced expression and ``key = value`` are one field each."""
    fields = [field.group() for field in _FIELD.finditer(text)]
    if "".join("".join(fields).split()) != "".join(text.split()):
        raise ValueError("braces or signs '=' that do not match")
    return fields


def _nodes(fields: list[str], count: int) -> list[str]:
    if len(fields) < count:
        raise ValueError(f"at least {count} fields are needed after the name")
    for node in fields[:count]:
        if not NAME.fullmatch(node):
            raise ValueError(f"the node {node!r} is not accepted")
    return fields[:count]


def _passive(letter: str, rest: str, names: Names) -> str:
    fields = split_fields(rest)
    nodes = _nodes(fields, 2)
    if letter == "r" and len(fields) > 3 and names.has_model(fields[2], "res", "r"):
        del fields[2]
    fields = [field for field in fields if not _WITHOUT_EFFECT.fullmatch(field)]
    if len(fields) < 3:
        raise ValueError("a value is missing")
    given = value(fields[2].removeprefix(f"{letter}="), names)
    if given == "0.0" and letter == "r":
        raise ValueError("a resistor of 0 ohm")
    return " ".join((*nodes, given, *assignments(fields[3:], names, _PASSIVE[letter] or {""})))


def _source(letter: str, rest: str, names: Names) -> str:
    if letter == "i" and (match := re.fullmatch(r"(\S+) (\S+) ((?:table|tbl)\b.*)", rest)):
        nodes = _nodes([match[1], match[2]], 2)
        return _behavioural(nodes, "i", _table(match[3], f"v({nodes[0]},{nodes[1]})", names))
    fields = split_fields(rest)
    nodes, words = _nodes(fields, 2), [word for word in fields[2:] if word != "dc"]
    if len(words) > 1:
        raise ValueError("only a constant voltage or current is accepted")
    return " ".join((*nodes, "dc", value(words[0], names) if words else "0.0"))


def _controlled(letter: str, rest: str, names: Names) -> str:
    """Write E, G, F or H; a polynomial or an expression becomes the one of a B source."""
    nodes = _nodes(rest.split(), 2)
    body = rest.split(None, 2)[2] if len(rest.split()) > 2 else ""
    by_voltage, quantity = letter in "eg", "v" if letter in "eh" else "i"
    if match := _VALUE.fullmatch(body):
        return _behavioural(nodes, quantity, expression(match[1], names.parameters))
    if by_voltage and (match := re.fullmatch(r"(?:(\S+) (\S+) )?((?:table|tbl)\b.*)", body)):
        across = ",".join(_nodes([match[1], match[2]], 2)) if match[1] else ""
        return _behavioural(nodes, quantity, _table(match[3], across and f"v({across})", names))
    if match := _POLY.fullmatch(body):
        count, words = int(match[1]), re.sub(r"[(),]", " ", match[2]).split()
        width = 2 * count if by_voltage else count
        controls = _nodes(words, width)
        pairs = zip(controls[::2], controls[1::2], strict=True) if by_voltage else ()
        inputs = [f"v({a},{b})" for a, b in pairs] or [f"i({source})" for source in controls]
        coefficients = [number(word) for word in words[width:]]
        return _behavioural(nodes, quantity, polynomial(inputs, coefficients))
    fields = split_fields(re.sub(r"[(),]", " ", body) if "{" not in body else body)
    controls = _nodes(fields, 2 if by_voltage else 1)
    if len(fields) != len(controls) + 1:
        raise ValueError("a gain, POLY or VALUE = {...} is expected")
    return " ".join((*nodes, *controls, value(fields[-1], names)))


def _table(text: str, across: str, names: Names) -> str:
    """Return PSpice's table of an expression, or LTspice's of the voltage `across`."""
    match = _TABLE.fullmatch(text)
    if match is None or (match[1] is None) == (across == ""):
        raise ValueError("expected TABLE {expression} = (x,y) (x,y) ... or TABLE(x y x y ...)")
    words = split_fields(_BRACKETS.sub(lambda found: found[1] or " ", match[2]))
    points = [value(word, names).replace("{", "(").replace("}", ")") for word in words]
    return piecewise(across or expression(match[1], names.parameters), *points)


def _behavioural(nodes: list[str], quantity: str, text: str) -> str:
    return f"{' '.join(nodes)} {quantity}={text}"


def _b_source(letter: str, rest: str, names: Names) -> str:
    match = re.fullmatch(r"(\S+) (\S+) ([vi]) ?= ?(?:\{([^{}]*)\}|([^{}]*))", rest)
    if match is None:
        raise ValueError("expected two nodes and v = ... or i = ...")
    text = expression(match[4] or match[5], names.parameters)
    return _behavioural(_nodes([match[1], match[2]], 2), match[3], text)


def _semiconductor(letter: str, rest: str, names: Names) -> str:
    fields, (least, most) = split_fields(rest), _NODES[letter]
    places = [k for k in range(least, min(most, len(fields) - 1) + 1) if fields[k] in names.models]
    if not places:
        raise ValueError(f"none of the fields is the model of a device {letter.upper()!r}")
    # `off` helps another simulator's iteration; it does not change the operating point.
    nodes, after = _nodes(fields, places[-1]), [f for f in fields[places[-1] + 1 :] if f != "off"]
    plain = [f"area={value(word, names)}" for word in after if "=" not in word]
    if len(plain) > 1 or (plain and letter not in "dqj"):
        raise ValueError("more numbers after the model than an area")
    given = assignments([word for word in after if "=" in word], names, _INSTANCE)
    return " ".join((*nodes, fields[places[-1]], *plain, *given))


def _switch(letter: str, rest: str, names: Names) -> str:
    """Write S; a switch of PSpice is a resistance that changes smoothly between two voltages."""
    fields = split_fields(rest)
    if len(fields) != 5 or not names.has_model(fields[4], "vswitch"):
        return _semiconductor(letter, rest, names)
    a, b, c, d = _nodes(fields, 4)
    ron, roff, von, voff = _smooth_switch(_model(names.models[fields[4]], names)[2])
    # ln R = ln sqrt(Ron Roff) + ln(Ron/Roff) (1.5 x - 2 x³), x from -1/2 to 1/2
    place = f"max(min((v({c},{d})-({0.5 * (von + voff)!r}))/({von - voff!r}),0.5),-0.5)"
    middle, ratio = 0.5 * math.log(ron * roff), math.log(ron / roff)
    power = f"({middle!r})+({ratio!r})*{place}*(1.5-2.0*{place}*{place})"
    return _behavioural([a, b], "i", f"v({a},{b})*exp(-({power}))")


def _instance(letter: str, rest: str, names: Names) -> str:
    fields = [field for field in split_fields(rest) if field != "params:"]
    words = [word for word in fields if "=" not in word]
    if not words or words[-1] not in names.subcircuits:
        raise ValueError(f"the subcircuit {words[-1] if words else ''!r} is not in the file")
    given = assignments([word for word in fields if "=" in word], names)
    return " ".join((*_nodes(words, len(words) - 1), names.subcircuits[words[-1]], *given))


_WRITERS: dict[str, Callable[[str, str, Names], str]] = {
    **dict.fromkeys("rcl", _passive),
    **dict.fromkeys("vi", _source),
    **dict.fromkeys("egfh", _controlled),
    **dict.fromkeys("dqjm", _semiconductor),
    "s": _switch,
    "b": _b_source,
    "x": _instance,
}
