"""Devices of a foreign netlist: each kind is checked field by field and written anew."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection

from taction.spice_models.foreign_expressions import NAME, expression, number, polynomial
from taction.spice_models.foreign_lines import Line

MODELS = ("d", "npn", "pnp", "njf", "pjf", "nmos", "pmos", "sw")
_FIELD = re.compile(r"\{[^{}]*\}|[^\s=]+\s*=\s*(?:\{[^{}]*\}|[^\s={}]+)|[^\s{}=]+")
_KEY = re.compile(r"[a-z][a-z0-9_]*")
_POLY = re.compile(r"poly\s*\(\s*(\d+)\s*\)(.*)")
_VALUE = re.compile(r"value\s*=?\s*\{([^{}]*)\}")
_BRACES = re.compile(r"\{([^{}]*)\}")
_PASSIVE = {"r": {"tc1", "tc2", "tc"}, "c": set[str](), "l": set[str]()}
_NODES = {"d": (2, 2), "q": (3, 4), "j": (3, 3), "m": (4, 4), "s": (4, 4)}
_INSTANCE = {"area", "l", "w", "m", "ad", "as", "pd", "ps", "nrd", "nrs"}
LEVELS = {1.0, 2.0, 3.0}


class Names:
    """Names that a device may refer to: `parameters` by their own name, the rest by new names."""

    def __init__(
        self, parameters: Collection[str], models: Collection[str], subcircuits: dict[str, str]
    ) -> None:
        self.parameters, self.models, self.subcircuits = parameters, models, subcircuits


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
        if name[0] in "egfh" and "=" in written:
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


def model_card(line: Line, names: Names) -> str:
    """Return a ``.model`` card.

    Raises
    ------
    RefusedError
        The kind of model, or a parameter, is not accepted.
    """
    match = re.fullmatch(r"\.model (\S+) ([a-z]+) ?(?:\((.*)\)|(.*))", line.text)
    try:
        if match is None or not NAME.fullmatch(match[1]):
            raise ValueError("not a model card")
        if match[2] not in MODELS:
            raise ValueError(f"a model {match[2]!r} is not accepted")
        body = (match[3] if match[3] is not None else match[4]).replace(",", " ")
        fields = assignments(split_fields(body), names)
        for field in fields:
            if field.startswith("level=") and float(field[6:].strip("{}")) not in LEVELS:
                raise ValueError(f"{field} is not accepted; only levels 1 to 3")
        return f".model {match[1]} {match[2]}({' '.join(fields)})"
    except ValueError as error:
        raise line.refused(str(error)) from None


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
    if len(fields) < 3:
        raise ValueError("a value is missing")
    given = value(fields[2].removeprefix(f"{letter}="), names)
    if given == "0.0" and letter == "r":
        raise ValueError("a resistor of 0 ohm")
    return " ".join((*nodes, given, *assignments(fields[3:], names, _PASSIVE[letter] or {""})))


def _source(letter: str, rest: str, names: Names) -> str:
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
    nodes, after = _nodes(fields, places[-1]), fields[places[-1] + 1 :]
    plain = [value(word, names) for word in after if "=" not in word]
    if len(plain) > 1:
        raise ValueError("more than one number after the model")
    given = assignments([word for word in after if "=" in word], names, _INSTANCE)
    return " ".join((*nodes, fields[places[-1]], *plain, *given))


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
    **dict.fromkeys("dqjms", _semiconductor),
    "b": _b_source,
    "x": _instance,
}
