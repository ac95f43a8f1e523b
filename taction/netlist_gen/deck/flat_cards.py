"""Flat cards of a deck: linear ones, R C L K V I E F G H B, as parts, all others as elements.

The roles of the parts are unknown: each part is a knob of its own. What a deck says of time is a
step: a source rests at its value before the first change, and steps at t = 0 to its last one.
An `Element` is a card that is measured alone, a transistor, a diode, a switch or any other
expression, with places for the nodes and currents that are held on a bench.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial

from taction.netlist_gen.board.circuit import (
    GROUND,
    Circuit,
    Fact,
    Knob,
    Output,
    common_facts,
    with_parts,
)
from taction.netlist_gen.deck.expressions import OWN, affine, number
from taction.spice_models.branches import Branch, Source, label_of

OHMIC = {  # parameters of a model that are resistances in series with its terminals, by terminal
    "d": (("rs",),),
    "q": (("rc",), ("rb", "rbm", "irb"), ("re",)),
    "j": (("rd",), (), ("rs",)),
    "m": (("rd", "rsh"), (), ("rs", "rsh")),
}
SHEET = (("rsh",), (), ("rsh",))  # of a MOS transistor of another level than `LEVELS`
LEVELS = (None, "1", "2", "3")
BSIM4 = ("14", "54")  # which has a sheet only where nrd or nrs are given
STRIPPED = "__inner"  # ends the name of a model without them
LEAST_TERMINALS = {"d": 2, "q": 3, "j": 3, "m": 3}
_VOLTAGE = re.compile(r"(?<![\w.#])v ?\( ?([^,() ]+) ?(?:, ?([^,() ]+) ?)?\)")
_CURRENT = re.compile(r"(?<![\w.#])i ?\( ?([^,() ]+) ?\)")
_TAKES = re.compile(r"(?<![\w.#])[vi] ?\(")
_GIVEN = re.compile(r"(\w+) ?= ?([^\s(),]+)")
ACCEPTED = (
    "accepted are R C L K V I E F G H B, D Q J M with a .model, switches S W, and subcircuits X"
)
Models = Mapping[str, tuple[str, str]]  # kind and card of each model, by name


class CardError(ValueError):
    """A flat card that is not accepted; the text says what is."""


def shown(card: str) -> str:
    """Return the name of a flat card as its designer wrote it."""
    return label_of(card[:1].upper(), card[1:])


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
                usual = "0" if values.get("level") in BSIM4 else "1"
                squares = number(given.get("nrd" if k == 0 else "nrs", usual))
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


_WAVE = re.compile(
    r"\b(pulse|pwl|sine?|sffm|exp|step|trnoise|trrandom)"
    r"\s*\(?((?:(?!\b(?:\w+ ?=|(?:[ad]c|distof[12])\b))[^()])*)\)?"
)
_SMALL = re.compile(r"\b(?:ac|distof[12])(?= |$)(?: +[-+.\d]\S*)*")  # with magnitude and phase


def source_of(name: str, text: str) -> Source:
    """Return a source V or I from its name and the rest of its card."""
    a, b, *words = text.split(None, 2)
    made, text = partial(Source, name[0].upper(), name[1:], a, b), "".join(words)
    match = _WAVE.search(text)
    plain = text if match is None else f"{text[: match.start()]} {text[match.end() :]}"
    plain, wave = re.sub(r"[=(),]", " ", plain), match[1] if match else ""
    ac, plain = " ac " in f" {plain} ", _SMALL.sub(" ", plain)
    key = re.compile(rf"\b(dc{'|r|td' * (wave == 'pwl')})\b\s*(\S*)")
    keyed = dict(key.findall(plain))
    values = [number(word) for word in key.sub(" ", plain).split()]
    if len(values) + ("dc" in keyed) > 1:
        raise ValueError("two DC values")
    dc = number(keyed["dc"] or "0") if "dc" in keyed else values[-1] if values else None
    if match is None:
        return made(dc or 0.0, before=dc or 0.0, ac=ac)
    given = [number(word) for word in re.split(r"[\s,]+", match[2].strip()) if word]
    repeats = number(keyed.get("r", "-1")) >= 0.0
    if repeats or wave.startswith("tr"):  # ngspice rests at the first value, or at the mean
        rest = given[1] if repeats else given[4] if wave == "trrandom" and given[4:] else 0.0
        rest = rest if dc is None else dc
        return made(rest, before=rest, kind="repeated" if repeats else "noise", ac=ac)
    if wave == "pwl":
        changes = zip(given[::2], given[1::2], given[3::2], strict=False)
        at = next((t for t, one, other in changes if one != other), 0.0)
        delay = number(keyed.get("td", "0"))
        return made(given[1::2][-1], before=given[1], at=at + delay, kind="pwl", ac=ac)
    if wave in ("sin", "sine", "sffm"):
        return made(given[0], before=given[0], kind="sin", ac=ac)
    at = given[2] if len(given) > 2 else 0.0
    kind = "exp" if wave == "exp" else "pulse"
    return made(given[1], before=given[0], at=at, kind=kind, ac=ac)


PARTS = {
    "r": ("resistor", "ohm", 2, "two nodes"),
    "c": ("capacitor", "F", 2, "two nodes"),
    "l": ("coil", "H", 2, "two nodes"),
    "k": ("coupling", "", 2, "two coils"),
    "e": ("gain", "", 4, "four nodes"),
    "f": ("gain", "", 3, "two nodes, a voltage source"),
    "g": ("transconductance", "S", 4, "four nodes"),
    "h": ("transresistance", "ohm", 3, "two nodes, a voltage source"),
}  # parts that are knobs: what they are, their unit, and the names that stand before the number
IDLE = {"tc1", "tc2", "tc", "noisy", "ic"}  # without effect at 27 degrees C, or on poles
PASSIVE = ("r", "res", "c", "l")  # kinds of their models
_PASSIVE = re.compile(r"\.model \S+ \w+ ?\(?([^()]*)\)?")
_MODEL = re.compile(r"\.model (\S+) (\w+)")
SCALES = {"tc1", "tc2", "tce", "rsh", "cj", "cjsw", "defw", "defl", "narrow", "short", "kf", "af"}
"""What a model of R, C or L may have where the part has a value of its own, which counts."""
LEAST_FARADS = 1e-12  # scale of the charges of a deck without capacitors
ABSENT = 1e-23  # F: at 1e12 ohm a pole beyond 10 GHz; vendors write 1e-30 for nothing, and areas
_FIELD = re.compile(r"[^\s=(),]+\s*=\s*[^\s=]+|[^\s=(),]+")
_B = re.compile(r"(\S+) (\S+) ([vi]) ?= ?(.+)")


def card_of(name: str) -> str:
    """Return the card of a part whose current is read, such as ``"Ebuf"`` of ``"ebuf"``."""
    return f"{name[0].upper()}{name[1:]}"


@dataclass(slots=True)
class Flat:
    """The cards of a deck while they are read."""

    parts: list[Branch] = field(default_factory=list)  # linear ones
    elements: list[Element] = field(default_factory=list)  # which are measured
    models: dict[str, tuple[str, str]] = field(default_factory=dict)  # kind and card, by name
    charged: list[str] = field(default_factory=list)  # cards with ic=
    absent: list[Branch] = field(default_factory=list)  # capacitances below `ABSENT`
    knobs: dict[str, Branch] = field(default_factory=dict)  # by name

    @property
    def sources(self) -> list[Source]:
        """The sources V and I, but for those of expressions."""
        return [part for part in self.parts if isinstance(part, Source)]

    @property
    def nodes(self) -> dict[str, None]:
        """All nodes without ground: those of R, then of C, then of other parts and of elements."""
        parts = sorted(self.parts, key=lambda part: {"R": 0, "C": 1}.get(part.letter, 2))
        found = dict.fromkeys(node for part in parts for node in part.nodes)
        for each in self.elements:
            inner = (node for node, _ in each.inner.values())
            found |= dict.fromkeys((*each.held, *(each.out or ())[1:], *inner))
        found.pop(GROUND, None)
        return found

    def add(self, part: Branch, knob: bool = False) -> None:
        """Add a part; it can be moved as a `knob` unless it is one of ours."""
        self.parts.append(part)
        if knob and OWN not in part.name:
            self.knobs[part.label] = part


def read_cards(lines: Iterable[str], *, measure: bool = False) -> Flat:
    """Read flat cards; raise CardError for one with an unknown field.

    One that is not linear becomes an element with `measure`, and is refused without.
    """
    flat, cards = Flat(), [spelt_card(line) for line in lines]
    flat.models = {m[1]: (m[2], card) for card in cards if (m := _MODEL.match(card))}
    for card in cards:
        name, _, rest = card.partition(" ")
        if name.startswith("."):
            continue
        try:
            if name[0] in "vi":
                flat.add(source_of(name, rest))
            elif name[0] == "b":
                _expression(flat, name, rest)
            elif name[0] in PARTS:
                _part(flat, name, rest)
            else:
                raise ValueError(f"a device {name[0].upper()!r} is not linear")
        except (ValueError, IndexError) as error:
            element = element_of(card, flat.models) if measure else None
            if element is not None:
                flat.elements.append(element)
            else:
                raise CardError(f"{shown(name)}: {error}: {card!r}") from None
    return flat


def _part(flat: Flat, name: str, text: str) -> None:
    """Add R, C, L, K, E, F, G or H with one number."""
    letter, (_, _, count, names) = name[0], PARTS[name[0]]
    passive, shape = letter in "rcl", f"{names} and one number"
    words = _FIELD.findall(_without_model(letter, text, flat.models) if passive else text)
    plain = [word for word in words if "=" not in word]
    keyed = dict(re.split(r"\s*=\s*", word, maxsplit=1) for word in words if "=" in word)
    plain += [keyed.pop(letter)] if passive and letter in keyed else []
    if len(plain) != count + 1:
        raise ValueError(f"expected {shape}")
    value, many = number(plain[-1]), number(keyed.pop("m", "1"))
    if unknown := keyed.keys() - (IDLE if passive else set()):
        raise ValueError(f"the field {min(unknown)!r} is not known; expected {shape}, or m= or ic=")
    if not many > 0.0 or (value == 0.0 and letter in "rl"):
        raise ValueError("a value of 0 is not accepted; leave the part out, or join its nodes")
    value = value / many if letter in "rl" else value * many
    ends, control, knob = plain[:2], tuple(plain[2:count]), passive or value != 0.0
    if letter == "c" and abs(value) < ABSENT:
        flat.absent.append(Branch("C", name[1:], ends[0], ends[1], value))
        return
    if letter == "l" and value < 0.0:
        raise ValueError("an inductance above 0 is expected")
    if letter == "k":
        if not abs(value) <= 1.0:
            raise ValueError("a coupling from -1 to 1 is expected")
        ends, knob = [f"L{coil[1:]}" for coil in ends], abs(value) < 1.0  # no tolerance at 1
    elif letter in "fh":
        if control[0][0] != "v":
            raise ValueError(f"{control[0]!r} is no voltage source")
        control = (card_of(control[0]),)
    flat.add(Branch(letter.upper(), name[1:], ends[0], ends[1], value, control), knob=knob)
    flat.charged += [shown(name)] if letter in "cl" and number(keyed.get("ic", "0")) else []


def _without_model(letter: str, text: str, models: Mapping[str, tuple[str, str]]) -> str:
    """Return R, C or L with a value of its own without the name of its model."""
    words = text.split()
    model = next((w for w in words[2:4] if w in models and models[w][0] in PASSIVE), None)
    if model is None:
        return text
    words.remove(model)
    plain = _PASSIVE.fullmatch(models[model][1])
    given = {key.strip() for key in re.findall(r"\b(\w+) ?=", plain[1] if plain else "?=")}
    own = len(words) > 2 and ("=" not in words[2] or words[2].startswith(f"{letter}="))
    if not own or not plain or given - SCALES:
        keys = " ".join(sorted(SCALES))
        raise ValueError(f"expected a value beside the model, and a model of {keys}")
    return " ".join(words)


def _expression(flat: Flat, name: str, text: str) -> None:
    if (match := _B.fullmatch(text)) is None:
        raise ValueError("expected two nodes and v=... or i=...")
    a, b, kind, formula = match.groups()
    found = affine(formula)
    if not all(map(math.isfinite, found.values())):
        raise ValueError("a number of the expression is not finite")
    constant = found.pop((), 0.0)
    terms = [
        (value, probe[1:] if probe[0] == "v" else (card_of(probe[1]),))
        for probe, value in found.items()
    ]
    for part in sum_parts(name, kind, (a, b), terms, constant):
        flat.add(part)


def sum_parts(
    name: str,
    kind: str,
    ends: tuple[str, str],
    terms: Iterable[tuple[float, tuple[str, ...]]],
    constant: float,
) -> Iterator[Branch]:
    """Yield the parts of a sum: of voltages sources in series, of currents in parallel.

    `kind` is ``v`` or ``i``; a term is a gain with two nodes, or with the card of a source.
    """
    by_voltage, by_current, own = "EHV" if kind == "v" else "GFI"
    made = [(by_voltage if len(control) == 2 else by_current, gain, control)
            for gain, control in terms if gain]  # fmt: skip
    if constant or not made:
        made.append((own, constant, ()))
    nodes = [ends[0], *(f"{name}#{k}" for k in range(1, len(made))), ends[1]]
    for k, (letter, value, control) in enumerate(made):
        a, b = nodes[k : k + 2] if kind == "v" else ends
        yield Branch(letter, f"{name}#g{k}" if control else f"{name}#i", a, b, value, control)


def circuit_of(flat: Flat, name: str, outputs: Iterable[str]) -> Circuit:
    """Return the circuit of flat cards: its parts are its knobs, its facts are their values."""
    farads = [abs(part.value) for part in flat.parts if part.letter == "C"]
    largest = max(farads, default=LEAST_FARADS)
    facts = common_facts(U0=1.0, C=largest)  # the scales of voltages and charges
    for own, part in flat.knobs.items():
        title, unit, *_ = PARTS[part.letter.lower()]
        facts[own] = Fact(own, part.value, unit, own, title, own, role=own)
    circuit = Circuit(
        name=name,
        amplifier="linear",
        topology="deck",
        facts=facts,
        outputs=tuple(Output(node, 1.0) for node in outputs),
        knobs=tuple(Knob(own, own, own, words=own) for own in flat.knobs),
        roles={own: frozenset((part.card,)) for own, part in flat.knobs.items()},
    )
    return with_parts(circuit, flat.parts)
