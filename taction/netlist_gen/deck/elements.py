"""Flat cards that are measured alone: transistors, diodes, switches, and any other expression.

An `Element` is a card with places for the nodes and currents that are held on a bench.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from taction.netlist_gen.deck.foreign_lines import number
from taction.spice_models.branches import label_of

OHMIC = {
    "d": (("rs",),),
    "q": (("rc",), ("rb", "rbm", "irb"), ("re",)),
    "j": (("rd",), (), ("rs",)),
    "m": (("rd", "rsh"), (), ("rs", "rsh")),
}
"""Parameters of a model that are resistances in series with its terminals, by terminal."""
SHEET = (("rsh",), (), ("rsh",))  # of a MOS transistor of another level than `LEVELS`
LEVELS = (None, "1", "2", "3")
STRIPPED = "__inner"  # ends the name of a model without them
LEAST_TERMINALS = {"d": 2, "q": 3, "j": 3, "m": 3}
_VOLTAGE = re.compile(r"(?<![\w.#])v ?\( ?([^,() ]+) ?(?:, ?([^,() ]+) ?)?\)")
_CURRENT = re.compile(r"(?<![\w.#])i ?\( ?([^,() ]+) ?\)")
_TAKES = re.compile(r"(?<![\w.#])[vi] ?\(")
_GIVEN = re.compile(r"(\w+) ?= ?([^\s(),]+)")
ACCEPTED = (
    "accepted are R C L K V I E F G H B, D Q J M with a .model, switches S W, and subcircuits X"
)
Models = Mapping[str, tuple[str, str]]
"""Kind and card of each model, by name."""


class CardError(ValueError):
    """A flat card that is not accepted; the text says what is."""


def shown(card: str) -> str:
    """Return the name of a flat card as its designer wrote it."""
    letter, dot, rest = card.partition(".")
    if not dot or len(letter) != 1 or "." not in rest:  # R.1 is a name of the top level
        return card[:1].upper() + card[1:]
    return label_of("", f".{rest}")


@dataclass(frozen=True, slots=True, eq=False)
class Element:
    """A card that is measured."""

    name: str  # of the flat card
    # the card: ``~`` for its name, ``{0}`` ``{1}`` for held nodes, ``{i0}`` for controlling
    # sources, ``{o0}`` ``{o1}`` for the nodes of its output
    pattern: str
    held: tuple[str, ...]  # nodes whose voltages are held, terminals first
    currents: tuple[str, ...] = ()  # sources whose currents are held
    out: tuple[str, str, str] | None = None  # kind (``v`` or ``i``) and both nodes of its output
    terminals: int = 0  # how many of `held` are terminals, whose currents are read
    # by terminal, the inner node behind an ohmic resistance, ohm
    inner: Mapping[int, tuple[str, float]] = field(default_factory=dict)

    @property
    def subcircuit(self) -> str:
        """The innermost subcircuit in which it stands, such as ``x1.xop``; empty at the top."""
        return ".".join(self.name.split(".")[1:-1])


def model_cards(models: Models, elements: Iterable[Element]) -> Iterator[str]:
    """Yield the models, and those without ohmic resistances that elements name."""
    yield from (card for _, card in models.values())
    words = {word for element in elements for word in element.pattern.split()}
    for name in sorted(w.removesuffix(STRIPPED) for w in words if w.endswith(STRIPPED)):
        kind, card = models[name]
        values = dict(_GIVEN.findall(card))
        if "xcjc" in values and "cjc" in values:  # its share is behind the base resistance
            try:
                inner = number(values["cjc"]) * number(values["xcjc"])
            except ValueError as error:
                raise CardError(f"{name}: {error}") from None
            card = re.sub(r"(?<=[\s(])xcjc ?= ?[^\s(),]+", " ", card)
            card = re.sub(r"(?<=[\s(])cjc ?= ?[^\s(),]+", f"cjc={inner!r}", card)
        keys = "|".join(key for each in _ohmic(_KINDS.get(kind, "m"), values) for key in each)
        card = re.sub(rf"(?<=[\s(])(?:{keys}) ?= ?[^\s(),]+", " ", card)
        yield re.sub(r"^\.model \S+", f".model {name}{STRIPPED}", card)


_KINDS = {"npn": "q", "pnp": "q", "d": "d", "njf": "j", "pjf": "j"}


def _ohmic(kind: str, values: Mapping[str, str]) -> tuple[tuple[str, ...], ...]:
    """Return the parameters of a model that are resistances in series, by terminal."""
    if kind in "mq" and values.get("level") not in LEVELS:
        return SHEET if kind == "m" else ((), (), ())
    return OHMIC[kind]


def spelt_card(card: str) -> str:
    """Return a card of a listing as ngspice reads it again."""
    card = re.sub(r"\s*=\s*", "=", " ".join(card.split()))
    card = re.sub(r"(?<=[a-z_0-9]) \(", "(", card) if card[0] in "begrcl" else card
    return re.sub(r"(?<=[\s=])\(\s*([-+\w.]+)\s*\)(?=\s|$)", r"\1", card)


def element_of(card: str, models: Models) -> Element | None:
    """Return the element of a card that is not linear; None of one that none can be."""
    kind, (name, *words) = card[0], card.split()
    if kind in "dqjm":
        return _device(card, models)
    held, currents, out, terminals = list[str](), list[str](), "", 0
    taking, front, count = _TAKES.search(card) is not None, "", 2
    if kind == "s":
        held, front, count, terminals = words[:4], "{0} {1} {2} {3}", 4, 2
    elif kind == "w":
        held, currents, front, count, terminals = words[:2], words[2:3], "{0} {1} {i0}", 3, 2
    elif kind in "rc" and (taking or any(word in models for word in words[2:])):
        card = re.sub(r"\bic=\S+", "", card)
        held, front, terminals = words[:2], "{0} {1}", 2
    elif kind in "begh" and "poly" not in card and (taking or kind in "eg"):
        front, value = "{o0} {o1}", " ".join(words[2:])
        is_current = re.match(r"(?:i|cur)=", value) or (kind == "g" and value[:3] != "vol")
        out = "i" if is_current else "v"
        if not taking:
            held, front, count = words[2:4], "{o0} {o1} {0} {1}", 4
    rest = " ".join(card.split()[count + 1 :])
    if not (front and rest):
        return None
    rest = _placed(rest, held, currents) if kind not in "sw" else rest
    outs = (out, words[0], words[1]) if out else None
    return Element(name, f"{kind}~ {front} {rest}", tuple(held), tuple(currents), outs, terminals)


def _placed(text: str, held: list[str], currents: list[str]) -> str:
    """Return an expression with places for its nodes and currents, which are added to the lists."""
    text = text.replace("{", "(").replace("}", ")")

    def place(node: str) -> str:
        if node == "0":
            return "0"
        if node not in held:
            held.append(node)
        return f"{{{held.index(node)}}}"

    def voltage(match: re.Match[str]) -> str:
        other = f",{place(match[2])}" if match[2] else ""
        return f"v({place(match[1])}{other})"

    def current(match: re.Match[str]) -> str:
        if match[1] not in currents:
            currents.append(match[1])
        return f"i({{i{currents.index(match[1])}}})"

    return _CURRENT.sub(current, _VOLTAGE.sub(voltage, text))


def _device(card: str, models: Models) -> Element:
    """Return a transistor or a diode; its ohmic resistances lead to inner nodes of their own."""
    kind, (name, *words) = card[0], card.split()
    n = next((k for k, w in enumerate(words) if k > 1 and (w in models or f"{w}.1" in models)), 0)
    if n < LEAST_TERMINALS[kind]:
        raise CardError(f"{shown(name)}: the deck has no .model of it; {ACCEPTED}: {card!r}")
    nodes, model, rest = words[:n], words[n], words[n + 1 :]
    if "thermal" in rest:
        raise CardError(f"{shown(name)}: a device that heats itself (thermal) is not measured")
    if kind == "q" and n == 3:
        nodes.append("0")  # its substrate
    type_name, text = models.get(model, ("", ""))
    values, given = dict(_GIVEN.findall(text)), dict(_GIVEN.findall(" ".join(rest)))
    inner = dict[int, tuple[str, float]]()
    try:
        plain = [number(word) for word in rest if "=" not in word and word != "off"]
        many = number(given.get("m", "1"))
        area = number(given.get("area", "1")) if not plain or kind == "m" else plain[0]
        for k, keys in enumerate(_ohmic(kind, values)):
            if not keys or type_name.startswith("vdmos"):
                continue
            ohms = number(values.get(keys[0], "0")) / (area * many)
            if kind == "m":
                squares = number(given.get("nrd" if k == 0 else "nrs", "1"))
                sheet = number(values.get("rsh", "0")) * squares
                own = keys[0] in values and keys[0] != "rsh"
                ohms = (number(values[keys[0]]) if own else sheet) / many
            if ohms > 0.0:
                inner[k] = f"{name}#r{k}", ohms
    except (ValueError, ZeroDivisionError) as error:
        raise CardError(f"{shown(name)}: {error}") from None
    places = " ".join(f"{{{k}}}" for k in range(len(nodes)))
    tail = " ".join(word for word in rest if word != "off" and not word.startswith("ic="))
    pattern = f"{kind}~ {places} {model}{STRIPPED if inner else ''} {tail}"
    return Element(name, pattern, tuple(nodes), (), None, len(nodes), inner)
