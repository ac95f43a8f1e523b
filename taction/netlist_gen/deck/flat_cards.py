"""Flat cards of a deck: linear ones, R C L K V I E F G H B, as parts, all others as elements.

The roles of the parts are unknown: each part is a knob of its own. What a deck says of time is a
step: a source rests at its value before the first change, and steps at t = 0 to its last one.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from taction.netlist_gen.board.circuit import (
    GROUND,
    Circuit,
    Fact,
    Knob,
    Output,
    common_facts,
    with_parts,
)
from taction.netlist_gen.deck.elements import CardError, Element, element_of, shown, spelt_card
from taction.netlist_gen.deck.expressions import OWN, affine
from taction.netlist_gen.deck.foreign_lines import number
from taction.spice_models.branches import Branch, Source
from taction.system.errors import Complaint, InputError, first_ones

_WAVE = re.compile(
    r"\b(pulse|pwl|sine?|sffm|exp|step|trnoise|trrandom)"
    r"\s*\(?((?:(?!\b(?:\w+ ?=|(?:[ad]c|distof[12])\b))[^()])*)\)?"
)
_SMALL = re.compile(r"\b(?:ac|distof[12])(?= |$)(?: +[-+.\d]\S*)*")  # with magnitude and phase
REMARKS = {
    "sin": "a sine (sin, sffm) counts with its offset",
    "noise": "noise over time (trnoise, trrandom) does not count: its source has its DC value",
    "repeated": "a pwl that repeats (r=) does not count: its source has its DC value",
}
"""What is said of kinds of sources that are constant here."""


@dataclass(frozen=True, slots=True)
class Stimulus:
    """What a source does: its value before and after the step, the instant, and the kind."""

    before: float
    after: float
    at: float = 0.0  # of its first change, s
    kind: str = "dc"
    ac: bool = False

    @property
    def moves(self) -> bool:
        """Whether it changes over time."""
        return self.before != self.after


def stimulus_of(text: str) -> Stimulus:
    """Return what a source does, from its card without name and nodes."""
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
        return Stimulus(dc or 0.0, dc or 0.0, ac=ac)
    given = [number(word) for word in re.split(r"[\s,]+", match[2].strip()) if word]
    repeats = number(keyed.get("r", "-1")) >= 0.0
    if repeats or wave.startswith("tr"):  # ngspice rests at the first value, or at the mean
        rest = given[1] if repeats else given[4] if wave == "trrandom" and given[4:] else 0.0
        rest = rest if dc is None else dc
        return Stimulus(rest, rest, 0.0, "repeated" if repeats else "noise", ac)
    if wave == "pwl":
        changes = zip(given[::2], given[1::2], given[3::2], strict=False)
        at = next((t for t, one, other in changes if one != other), 0.0)
        delay = number(keyed.get("td", "0"))
        return Stimulus(given[1], given[1::2][-1], at + delay, "pwl", ac)
    if wave in ("sin", "sine", "sffm"):
        return Stimulus(given[0], given[0], 0.0, "sin", ac)
    at = given[2] if len(given) > 2 else 0.0
    return Stimulus(given[0], given[1], at, "exp" if wave == "exp" else "pulse", ac)


PARTS = {
    "r": ("resistor", "ohm", 2, "two nodes"),
    "c": ("capacitor", "F", 2, "two nodes"),
    "l": ("coil", "H", 2, "two nodes"),
    "k": ("coupling", "", 2, "two coils"),
    "e": ("gain", "", 4, "four nodes"),
    "f": ("gain", "", 3, "two nodes, a voltage source"),
    "g": ("transconductance", "S", 4, "four nodes"),
    "h": ("transresistance", "ohm", 3, "two nodes, a voltage source"),
}
"""Parts that are knobs: what they are, their unit, and the names that stand before the number."""
IDLE = {"tc1", "tc2", "tc", "noisy", "ic"}  # without effect at 27 degrees C, or on poles
PASSIVE = ("r", "res", "c", "l")  # kinds of their models
_PASSIVE = re.compile(r"\.model \S+ \w+ ?\(?([^()]*)\)?")
_MODEL = re.compile(r"\.model (\S+) (\w+)")
SCALES = {"tc1", "tc2", "tce", "rsh", "cj", "cjsw", "defw", "defl", "narrow", "short", "kf", "af"}
"""What a model of R, C or L may have where the part has a value of its own, which counts."""
SMALL_STEP = 1e-3  # V or A, of a source of a circuit that is linear about its operating point
BIASED_STEP = 0.01  # of its DC value: the step of a source with AC, within the rails
LEAST_FARADS = 1e-12  # scale of the charges of a deck without capacitors
ABSENT = 1e-23  # F: at 1e12 ohm a pole beyond 10 GHz; vendors write 1e-30 for nothing, and areas
_FIELD = re.compile(r"[^\s=(),]+\s*=\s*[^\s=]+|[^\s=(),]+")
_B = re.compile(r"(\S+) (\S+) ([vi]) ?= ?(.+)")
_OUTPUT = re.compile(r"\bv\s*\(\s*([^\s,()]+)\s*\)")
USUAL = ("out", "vout", "output", "vo", "o")  # names of an output, in this order


def card_of(name: str) -> str:
    """Return the card of a part whose current is read, such as ``"Ebuf"`` of ``"ebuf"``."""
    return f"{name[0].upper()}{name[1:]}"


@dataclass(slots=True)
class Flat:
    """The cards of a deck while they are read."""

    parts: list[Branch] = field(default_factory=list)  # linear ones
    elements: list[Element] = field(default_factory=list)  # which are measured
    models: dict[str, tuple[str, str]] = field(default_factory=dict)  # kind and card, by name
    stimuli: dict[str, Stimulus] = field(default_factory=dict)  # of V and I, by card
    charged: list[str] = field(default_factory=list)  # cards with ic=
    absent: list[Branch] = field(default_factory=list)  # capacitances below `ABSENT`
    knobs: dict[str, Branch] = field(default_factory=dict)  # by name

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
            self.knobs[shown(part.letter.lower() + part.name)] = part


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
            _read(flat, name, rest)
        except (ValueError, IndexError) as error:
            element = element_of(card, flat.models) if measure else None
            if element is not None:
                flat.elements.append(element)
            elif isinstance(error, CardError):
                raise
            else:
                raise CardError(f"{shown(name)}: {error}: {card!r}") from None
    return flat


def _read(flat: Flat, name: str, text: str) -> None:
    """Add the parts of a linear card."""
    letter = name[0]
    if letter in "vi":
        a, b, *rest = text.split(None, 2)
        found = stimulus_of(rest[0] if rest else "")
        part = Source(letter.upper(), name[1:], a, b, found.after, before=found.before)
        flat.add(part)
        flat.stimuli[part.card] = found
    elif letter == "b":
        _expression(flat, name, text)
    elif letter in PARTS:
        _part(flat, name, text)
    else:
        raise ValueError(f"a device {letter.upper()!r} is not linear")


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


def outputs_of(flat: Flat, wanted: Sequence[str], shown_cards: Iterable[str]) -> tuple[str, ...]:
    """Return the output nodes: `wanted`, which must be there, or those shown, or the usual ones."""
    nodes = flat.nodes
    if wanted:
        names = [re.sub(r"^v\((.*)\)$", r"\1", name.strip().lower()) for name in wanted]
        for name in names:
            if name not in nodes:
                text = f"the deck has no such node; it has {', '.join(list(nodes)[:20])}"
                raise InputError("--output", Complaint("node", repr(name), text))
        return tuple(dict.fromkeys(names))
    held = {n for part in flat.parts if part.letter == "V" for n in part.nodes}
    seen = [name for card in shown_cards for name in _OUTPUT.findall(card)]
    known = tuple(dict.fromkeys(n for n in seen if n in nodes and n not in held))
    if known:
        return known
    usual = [name for name in USUAL if name in nodes]
    free = [name for name in nodes if name not in held and not {".", "#"} & set(name)]
    return tuple(usual[:1] or free or list(nodes)[:1])


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
        resistors=(),
        capacitors=(),
        outputs=tuple(Output(node, 1.0) for node in outputs),
        knobs=tuple(Knob(own, own, own, words=own) for own in flat.knobs),
        roles={own: frozenset((part.card,)) for own, part in flat.knobs.items()},
    )
    return with_parts(circuit, flat.parts)


def stepped(flat: Flat, *, small: bool = False) -> tuple[Flat, str]:
    """Return the parts with a step to show: where no source changes, one that is switched on.

    The sources with an ``ac`` value step from 0 to 1, or by `BIASED_STEP` to the DC value that they
    have; without one of them all are switched on. A `small` signal is a step by `SMALL_STEP` of
    those with an ``ac`` value, else of the last source.
    """
    moving = [card for card, found in flat.stimuli.items() if found.moves]
    if moving:
        return flat, f"step at t = 0: {_named(moving)}"
    sources, before, step = [*flat.stimuli], 0.0, 0.0
    excited = [card for card in sources if flat.stimuli[card].ac]
    if small:
        chosen, before, step = excited or sources[-1:], 1.0, SMALL_STEP
        text = f"a step by {SMALL_STEP:g} at t = 0"
    elif chosen := [card for card in excited if flat.stimuli[card].after]:
        before = 1.0 - BIASED_STEP
        text = f"at t = 0 from {before:.0%} to the DC value"
    else:
        chosen, text = excited or sources, "switched on at t = 0"
        if not any(flat.stimuli[card].after for card in chosen):  # of an AC analysis: to 1
            step, text = 1.0, "at t = 0 from 0 to 1"
    still = "no source changes over time"
    if not chosen:
        return flat, still if small else ""
    parts = [
        replace(part, before=before * part.value, value=part.value + step)
        if isinstance(part, Source) and part.card in chosen
        else part
        for part in flat.parts
    ]
    return replace(flat, parts=parts), f"{still}, so {text}: {_named(chosen)}"


def _named(cards: Sequence[str]) -> str:
    """Return the names of some cards; of many only the first ones."""
    return first_ones([shown(card[0].lower() + card[1:]) for card in cards])
