"""Flat linear cards of a deck, R C L K V I E F G H and linear B, as a `Circuit` without a topology.

The roles of the parts are unknown: each part is a knob of its own. What a deck says of time is a
step: a source rests at its value before the first change, and steps at t = 0 to its last one.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from taction.netlist_gen.board.branches import (
    BranchCoupling,
    Coil,
    CurrentBetween,
    CurrentByCurrent,
    CurrentByVoltage,
    Source,
    VoltageBetween,
    VoltageByCurrent,
    VoltageByVoltage,
)
from taction.netlist_gen.board.circuit import GROUND, Circuit, Fact, Knob, Output, common_facts
from taction.netlist_gen.board.parts import Branch, Capacitor, Part, Resistor
from taction.netlist_gen.deck.linear_expressions import affine
from taction.netlist_gen.deck.stimuli import FIXED, Stimulus, stimulus_of
from taction.netlist_gen.deck.transfer_functions import OWN
from taction.spice_models.foreign_expressions import number
from taction.system.errors import Complaint, InputError

KINDS = {
    "r": ("resistor", "ohm"),
    "c": ("capacitor", "F"),
    "l": ("coil", "H"),
    "k": ("coupling", ""),
    "e": ("gain", ""),
    "f": ("gain", ""),
    "g": ("transconductance", "S"),
    "h": ("transresistance", "ohm"),
}
"""Letters of the parts that are knobs: what they are, and their unit."""
IDLE = {"tc1", "tc2", "tc", "noisy"}  # without effect at 27 degrees C, or on poles
_PASSIVE = re.compile(r"\.model (\S+) (?:r|res|c|l) ?\(?([^()]*)\)?")
SCALES = {"tc1", "tc2", "tce", "rsh", "cj", "cjsw", "defw", "defl", "narrow", "short", "kf", "af"}
"""What a model of R, C or L may have where the part has a value of its own, which counts."""
NAMED = 4  # sources in a sentence
SMALL_STEP = 1e-3  # V or A, of a source of a circuit that is linear about its operating point
BIASED_STEP = 0.01  # of its DC value: the step of a source with AC, within the rails
LEAST_FARADS = 1e-12  # scale of the charges of a deck without capacitors
ABSENT = 1e-24  # F: at 1e12 ohm a pole beyond 10 GHz; vendors write 1e-30 for nothing
_FIELD = re.compile(r"[^\s=(),]+\s*=\s*[^\s=]+|[^\s=(),]+")
_B = re.compile(r"(\S+) (\S+) ([vi]) ?= ?(.+)")
_OUTPUT = re.compile(r"\bv\s*\(\s*([^\s,()]+)\s*\)")
USUAL = ("out", "vout", "output", "vo", "o")  # names of an output, in this order


class CardError(ValueError):
    """A flat card that is not accepted; the text says what is."""


def shown(card: str) -> str:
    """Return the name of a flat card as its designer wrote it.

    Examples
    --------
    >>> shown("r1"), shown("r.1"), shown("r.x1.xop.rin")
    ('R1', 'R.1', 'x1.xop.Rin')
    """
    letter, dot, rest = card.partition(".")
    if not dot or len(letter) != 1 or "." not in rest:  # R.1 is a name of the top level
        return card[:1].upper() + card[1:]
    return Part(f".{rest}").label


def card_of(name: str) -> str:
    """Return the card of a part whose current is read, such as ``"Ebuf"`` of ``"ebuf"``."""
    return f"{name[0].upper()}{name[1:]}"


@dataclass(slots=True)
class Flat:
    """The parts of a deck while they are read."""

    resistors: list[Resistor] = field(default_factory=list)
    capacitors: list[Capacitor] = field(default_factory=list)
    branches: list[Branch] = field(default_factory=list)
    stimuli: dict[str, Stimulus] = field(default_factory=dict)
    charged: list[str] = field(default_factory=list)  # cards with ic=
    absent: list[str] = field(default_factory=list)  # capacitors below `ABSENT`
    knobs: dict[str, tuple[str, float]] = field(default_factory=dict)  # card and value, by name

    @property
    def nodes(self) -> dict[str, None]:
        """All nodes without ground, in the order of the deck."""
        found: dict[str, None] = {}
        plain: list[Resistor | Capacitor] = [*self.resistors, *self.capacitors]
        for part in plain:
            found |= dict.fromkeys((part.a, part.b))
        for branch in self.branches:
            found |= dict.fromkeys(branch.nodes)
        found.pop(GROUND, None)
        return found


def read_cards(lines: Iterable[str]) -> Flat:
    """Read flat cards; raise CardError for one that is not linear, or has an unknown field."""
    flat, every = Flat(), tuple(lines)
    plain = {match[1]: match[2] for line in every if (match := _PASSIVE.fullmatch(line))}
    for line in every:
        name, _, rest = line.partition(" ")
        if name == ".model" and rest.split()[0] in plain:
            continue
        reader = _READERS.get(name[0])
        if reader is None:
            raise CardError(f"{shown(name)}: a device {name[0].upper()!r} is not linear: {line!r}")
        try:
            if plain and name[0] in "rcl":
                rest = _without_model(name[0], rest, plain)
            reader(flat, name, rest)
        except CardError:
            raise
        except (ValueError, IndexError) as error:
            raise CardError(f"{shown(name)}: {error}: {line!r}") from None
    return flat


def _without_model(letter: str, text: str, models: Mapping[str, str]) -> str:
    """Return R, C or L with a value of its own without the name of its model."""
    words = text.split()
    model = next((word for word in words[2:4] if word in models), None)
    if model is not None:
        words.remove(model)
        given = {key.strip() for key in re.findall(r"\b(\w+) ?=", models[model])}
        own = len(words) > 2 and ("=" not in words[2] or words[2].startswith(f"{letter}="))
        if not own or given - SCALES:
            keys = " ".join(sorted(SCALES))
            raise ValueError(f"expected a value beside the model, and a model of {keys}")
    return " ".join(words)


def _fields(text: str, least: int) -> tuple[list[str], dict[str, str]]:
    """Return plain fields, at least so many, and ``key=value`` fields."""
    words = _FIELD.findall(text)
    plain = [word for word in words if "=" not in word]
    keyed = dict(re.split(r"\s*=\s*", word, maxsplit=1) for word in words if "=" in word)
    if len(plain) < least:
        raise ValueError(f"{len(plain)} fields, at least {least} are needed")
    return plain, keyed


def _value(letter: str, text: str) -> tuple[str, str, float, dict[str, str]]:
    """Return both nodes, the value and further keys of R, C or L."""
    plain, keyed = _fields(text, 2)
    given = keyed.pop(letter, None) or (plain[2] if len(plain) > 2 else "")
    if len(plain) > 3 or not given:
        raise ValueError("expected two nodes and one number")
    value, many = number(given), number(keyed.pop("m", "1"))
    if (value == 0.0 and letter != "c") or not many > 0.0:
        raise ValueError("a value of 0 is not accepted; leave the part out, or join its nodes")
    value = value / many if letter in "rl" else value * many
    if unknown := keyed.keys() - IDLE - {"ic"}:
        raise ValueError(f"the field {min(unknown)!r} is not known; expected a number, m= or ic=")
    return plain[0], plain[1], value, keyed


def _passive(flat: Flat, name: str, text: str) -> None:
    """Read R, C or L."""
    letter = name[0]
    a, b, value, keyed = _value(letter, text)
    if letter == "c" and abs(value) < ABSENT:
        flat.absent.append(shown(name))
        return
    part: Resistor | Capacitor | Coil
    if letter == "r":
        part = Resistor(name[1:], a, b, value)
        flat.resistors.append(part)
    elif letter == "c":
        part = Capacitor(name[1:], a, b, value)
        flat.capacitors.append(part)
    else:
        if not value > 0.0:
            raise ValueError("an inductance above 0 is expected")
        part = Coil(name[1:], a, b, value)
        flat.branches.append(part)
    _knob(flat, name, part.card, value)
    if letter != "r" and number(keyed.get("ic", "0")):
        flat.charged.append(shown(name))


def _knob(flat: Flat, name: str, card: str, value: float) -> None:
    """Enter a part that can be moved: it is not one of ours."""
    if OWN not in name:
        flat.knobs[shown(name)] = (card, value)


def _coupling(flat: Flat, name: str, text: str) -> None:
    *coils, last = _fields(text, 3)[0]
    value = number(last)
    if not abs(value) <= 1.0:
        raise ValueError("a coupling from -1 to 1 is expected")
    if len(coils) != 2:
        raise ValueError("expected two coils and one number")
    one, other = (f"L{coil[1:]}" for coil in coils)
    flat.branches.append(BranchCoupling(name[1:], one, other, value))
    if abs(value) < 1.0:  # an ideal one has no tolerance
        _knob(flat, name, flat.branches[-1].card, value)


def _controlled(kind: Callable[..., Branch]) -> Callable[[Flat, str, str], None]:
    by_voltage = kind in (VoltageByVoltage, CurrentByVoltage)
    count, accepted = (5, "four nodes and one number; polynomials are not linear")
    if not by_voltage:
        count, accepted = 4, "two nodes, a voltage source and one number"

    def read(flat: Flat, name: str, text: str) -> None:
        plain, keyed = _fields(text, count)
        if len(plain) > count or keyed.keys() - {"m"}:
            raise ValueError(f"expected {accepted}")
        if not by_voltage and plain[2][0] != "v":
            raise ValueError(f"{plain[2]!r} is no voltage source")
        value = number(plain[-1]) * number(keyed.get("m", "1"))
        control = (plain[2], plain[3]) if by_voltage else card_of(plain[2])
        part = kind(name[1:], plain[0], plain[1], value, control)
        flat.branches.append(part)
        if value:
            _knob(flat, name, part.card, value)

    return read


def _source(kind: Callable[..., Source]) -> Callable[[Flat, str, str], None]:
    def read(flat: Flat, name: str, text: str) -> None:
        a, b, *rest = text.split(None, 2)
        stimulus = stimulus_of(rest[0] if rest else "")
        part = kind(name[1:], a, b, stimulus.after, stimulus.before)
        flat.branches.append(part)
        flat.stimuli[part.card] = stimulus

    return read


def _expression(flat: Flat, name: str, text: str) -> None:
    """Read a B card: a sum of voltages becomes sources in series, a sum of currents in parallel."""
    if (match := _B.fullmatch(text)) is None:
        raise ValueError("expected two nodes and v=... or i=...")
    a, b, kind, formula = match.groups()
    found = affine(formula)
    if not all(map(math.isfinite, found.values())):
        raise ValueError("a number of the expression is not finite")
    parts = [(probe, value) for probe, value in found.items() if value] or [((), 0.0)]
    parts.sort(key=lambda part: not part[0])  # a constant last
    nodes = [a, *(f"{name}#{k}" for k in range(1, len(parts))), b]
    for k, (probe, value) in enumerate(parts):
        ends = (nodes[k], nodes[k + 1]) if kind == "v" else (a, b)
        made, control = _OF_PROBES[kind, probe[:1]], list[Any]()
        if probe:
            control = [probe[1:] if probe[0] == "v" else card_of(probe[1])]
        part = made(f"{name}#{k}", *ends, value, *(control or [value]))
        flat.branches.append(part)
        if not probe:
            flat.stimuli[part.card] = Stimulus(value, value, kind=FIXED)


_OF_PROBES: Mapping[tuple[str, tuple[str, ...]], Callable[..., Branch]] = {
    ("v", ()): VoltageBetween,
    ("i", ()): CurrentBetween,
    ("v", ("v",)): VoltageByVoltage,
    ("i", ("v",)): CurrentByVoltage,
    ("v", ("i",)): VoltageByCurrent,
    ("i", ("i",)): CurrentByCurrent,
}
"""Parts of a B card: what it is a source of, and the kind of what it depends on."""
_READERS: Mapping[str, Callable[[Flat, str, str], None]] = {
    **dict.fromkeys("rcl", _passive),
    "k": _coupling,
    "v": _source(VoltageBetween),
    "i": _source(CurrentBetween),
    "e": _controlled(VoltageByVoltage),
    "g": _controlled(CurrentByVoltage),
    "f": _controlled(CurrentByCurrent),
    "h": _controlled(VoltageByCurrent),
    "b": _expression,
}


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
    held = {n for part in flat.branches if isinstance(part, VoltageBetween) for n in part.nodes}
    seen = [name for card in shown_cards for name in _OUTPUT.findall(card)]
    known = tuple(dict.fromkeys(n for n in seen if n in nodes and n not in held))
    if known:
        return known
    usual = [name for name in USUAL if name in nodes]
    free = [name for name in nodes if name not in held and not {".", "#"} & set(name)]
    return tuple(usual[:1] or free or list(nodes)[:1])


def circuit_of(flat: Flat, name: str, outputs: Iterable[str]) -> Circuit:
    """Return the circuit of flat cards: its parts are its knobs, its facts are their values."""
    largest = max((abs(part.farads) for part in flat.capacitors), default=LEAST_FARADS)
    facts = common_facts(U0=1.0, C=largest)  # the scales of voltages and charges
    knobs, roles = list[Knob](), dict[str, frozenset[str]]()
    for part, (card, value) in flat.knobs.items():
        title, unit = KINDS[card[0].lower()]
        facts[part] = Fact(part, value, unit, part, title, part, role=part)
        knobs.append(Knob(part, part, part, words=part))
        roles[part] = frozenset((card,))
    return Circuit(
        name=name,
        amplifier="linear",
        topology="deck",
        facts=facts,
        resistors=tuple(flat.resistors),
        capacitors=tuple(flat.capacitors),
        outputs=tuple(Output(node, 1.0) for node in outputs),
        branches=tuple(flat.branches),
        knobs=tuple(knobs),
        roles=roles,
    )


def stepped(flat: Flat, *, small: bool = False) -> tuple[Flat, str]:
    """Return the parts with a step to show: where no source changes, one that is switched on.

    The sources with an ``ac`` value step at t = 0, and the others hold the circuit. They step from
    0 to 1, or, where they have a DC value, by `BIASED_STEP` of it to this value: the circuit comes
    to rest at its operating point and starts close to it. Without one of them all sources but
    those at the supplies of op-amps are switched on.
    A `small` signal is a step by `SMALL_STEP` of the sources with an ``ac`` value, else of the last
    source: the others hold the circuit at its operating point.
    """
    moving = [card for card, found in flat.stimuli.items() if found.moves]
    if moving:
        return flat, f"step at t = 0: {_named(moving)}"
    still = "no source changes over time"
    sources = [card for card, found in flat.stimuli.items() if found.kind != FIXED]
    excited = [card for card in sources if flat.stimuli[card].ac]
    faint = [card for card in excited if flat.stimuli[card].after]
    before, step = 0.0, 0.0
    if small:
        chosen, before, step = excited or sources[-1:], 1.0, SMALL_STEP
        text = f"{still}, so a step by {SMALL_STEP:g} at t = 0"
    elif faint:
        chosen, before = faint, 1.0 - BIASED_STEP
        text = f"{still}, so at t = 0 from {before:.0%} to the DC value"
    else:
        chosen, text = excited or sources, f"{still}, so switched on at t = 0"
        if not any(flat.stimuli[card].after for card in chosen):  # of an AC analysis: to 1
            step, text = 1.0, f"{still}, so at t = 0 from 0 to 1"
    if not chosen:
        return flat, still if small else ""
    branches = [
        replace(part, before=before * part.value, value=part.value + step)
        if isinstance(part, Source) and part.card in chosen
        else part
        for part in flat.branches
    ]
    return replace(flat, branches=branches), f"{text}: {_named(chosen)}"


def _named(cards: Sequence[str]) -> str:
    """Return the names of some cards; of many only the first ones."""
    names = [shown(card[0].lower() + card[1:]) for card in cards]
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return ", ".join(names[:NAMED]) + more
