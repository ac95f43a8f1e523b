"""Transistors and diodes of a deck as linear cards, at the operating point that ngspice finds.

Each device is put alone between voltage sources that hold its terminals where they rest: ngspice
tells its currents and its admittances: the small signal of a device is ``G + s C`` between its
terminals, and a constant current makes it rest where it rested. Its ohmic resistances (RB RC RE RS
RD) become resistors first. A device whose admittance is not ``G + s C`` is refused by name.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from taction.netlist_gen.analysis import Analysis, NoiseBand, OperatingPoint, SmallSignal
from taction.netlist_gen.deck.deck import Deck
from taction.netlist_gen.deck.flat_cards import CardError, shown
from taction.spice_models.foreign_expressions import number
from taction.system.array_types import Complexes, Floats
from taction.system.errors import SimulationError, one_line
from taction.system.frozen import frozen
from taction.verification.engines.ngspice.executable import Simulator
from taction.verification.engines.ngspice.process import simulate, start

TERMINALS = {"d": 2, "q": 3, "j": 3, "m": 4}  # of the devices that are accepted; q may have 4
OHMIC = {"d": ("rs",), "q": ("rc", "rb", "re"), "j": ("rd", "", "rs"), "m": ("rd", "", "rs")}
"""Names of a model's resistances in series with the terminals, in their order."""
ACCEPTED = "linearised are diodes D, transistors Q J M with a .model; no switches S W"
BAND = NoiseBand(1e3, 6, 1)  # Hz: where the admittance has to be G + s C
LEAST_SURE = 1e6  # Hz
MISFIT = 1e-3  # of the largest admittance of a device
ONE_SIDED = 1.01  # of the difference of a pair: a smaller mean tells nothing
SMALL = 1e-12  # of the largest one: a smaller element is left out
NAMED = 12  # devices in a note
SECONDS = 20.0
_MODEL = re.compile(r"^\.model (\S+) (\S+?)\s*(?:\((.*)\)|\s(.*))?$")
_VALUE = re.compile(r"\b(\w+)\s*=\s*([^\s()]+)")


@frozen
class _SmallSignalDevice:
    """A card: its name, the nodes of its terminals, and what follows them."""

    name: str
    nodes: tuple[str, ...]
    rest: str
    sure: float = math.inf  # Hz: up to here its admittance is G + s C

    def card(self, name: str, nodes: Sequence[str]) -> str:
        """Return the card with other names."""
        return f"{self.name[0]}{name} {' '.join(nodes)} {self.rest}"


def linearised(cards: Iterable[str], simulator: Simulator) -> tuple[tuple[str, ...], str]:
    """Return flat cards with linear ones in the place of diodes and transistors, and what was done.

    Raises
    ------
    CardError
        A device that is not accepted, or whose admittance is not that of a linear card.
    SimulationError
        ngspice finds no operating point.
    """
    models, devices, others = _sorted(cards)
    if not devices:
        return tuple(others), ""
    devices, resistors = _with_resistors(devices, models)
    text = [each for each, _ in models.values()]
    bare = [*others, *resistors]
    volts = _operating_point([*text, *bare, *(d.card(d.name[1:], d.nodes) for d in devices)],
                             devices, simulator)  # fmt: skip
    made, least = list[str](), math.inf
    for device, currents, response in _measured(text, devices, volts, simulator):
        rest = np.array([volts[node] for node in device.nodes])
        found, sure = _cards(device, rest, currents, response)
        made += found
        least = min(least, sure)
    names = ", ".join(shown(device.name) for device in devices[:NAMED])
    names += f" and {len(devices) - NAMED} more" * (len(devices) > NAMED)
    where = "" if least >= BAND.stop else f", up to {least:.0e} Hz"
    note = (
        f"linearised at ngspice's operating point, for small signals only: {names}"
        f" (within {100 * MISFIT:g} %{where}); their own noise does not count"
    )
    return (*bare, *made), note


Models = dict[str, tuple[str, Mapping[str, str]]]  # cards and values, by name


def _sorted(cards: Iterable[str]) -> tuple[Models, list[_SmallSignalDevice], list[str]]:
    """Return models, devices, and all other cards."""
    every, models = list(cards), Models()
    for card in every:
        if match := _MODEL.match(card):
            values = dict(_VALUE.findall(match[3] or match[4] or ""))
            models[match[1]] = card, values
    devices, others = list[_SmallSignalDevice](), list[str]()
    for card in every:
        if card[0] in TERMINALS:
            devices.append(_device(card, models))
        elif card[0] in "sw":
            raise CardError(f"{shown(card.split()[0])}: {ACCEPTED}: {card!r}")
        elif not card.startswith("."):
            others.append(card)
    return models, devices, others


def _device(card: str, models: Models) -> _SmallSignalDevice:
    name, *words = card.split()
    place = next((k for k, word in enumerate(words) if word in models), None)
    least = TERMINALS[name[0]]
    if place is None or not least <= place <= least + (name[0] == "q"):
        raise CardError(f"{shown(name)}: the deck has no .model of it; {ACCEPTED}: {card!r}")
    return _SmallSignalDevice(name, tuple(words[:place]), " ".join(words[place:]))


def _with_resistors(
    devices: Sequence[_SmallSignalDevice], models: Models
) -> tuple[list[_SmallSignalDevice], list[str]]:
    """Return devices between inner nodes, and the resistors that lead there.

    The models in `models` lose these resistances. Devices with an area or other parameters keep
    them.
    """
    plain = [device for device in devices if " " not in device.rest]
    kept = {device.rest.split()[0] for device in devices if " " in device.rest}
    moved, resistors, used = list[_SmallSignalDevice](), list[str](), set[str]()
    for device in devices:
        if device not in plain or device.rest in kept or "irb" in models[device.rest][1]:
            moved.append(device)
            continue
        values, nodes = models[device.rest][1], list(device.nodes)
        for k, key in enumerate(OHMIC[device.name[0]]):
            try:
                ohms = number(values.get(key, "0")) if key else 0.0
            except ValueError as error:
                raise CardError(f"{shown(device.name)}: {key} of its model: {error}") from None
            if ohms > 0.0:
                inner = f"{device.name}#{key[1]}"
                resistors.append(f"r.{device.name}.{key} {nodes[k]} {inner} {ohms!r}")
                nodes[k] = inner
        used.add(device.rest)
        moved.append(replace(device, nodes=tuple(nodes)))
    for name in used:
        card, values = models[name]
        for key in {*OHMIC["q"], *OHMIC["d"], *OHMIC["m"], "rbm"} - {""}:
            card = re.sub(rf"\b{key}\s*=\s*[^\s()]+", "", card)
        models[name] = card, values
    return moved, resistors


def _operating_point(
    cards: Sequence[str], devices: Sequence[_SmallSignalDevice], simulator: Simulator
) -> dict[str, float]:
    """Return the voltages of the terminals at rest, V, by node."""
    nodes = list(dict.fromkeys(n for device in devices for n in device.nodes if n != "0"))
    deck = _deck(cards, nodes, OperatingPoint(), ".op", simulator)
    try:
        found = simulate(deck, simulator, timeout=SECONDS)
    except SimulationError as error:
        text = f"ngspice finds no operating point: {one_line(error)}"
        raise CardError(text) from None
    return {"0": 0.0, **dict(zip(nodes, found.values[-1].tolist(), strict=True))}


def _deck(
    cards: Sequence[str],
    saved: Sequence[str],
    analysis: Analysis,
    command: str,
    simulator: Simulator,
) -> Deck:
    closing = [
        f".options {simulator.solver_option} reltol=1e-9 abstol=1e-15 vntol=1e-12",
        ".save " + " ".join(f"v({node})" for node in saved),
        command,
        ".end",
        "",
    ]
    return Deck("\n".join(["* operating point", *cards, *closing]), tuple(saved), analysis)


def _measured(
    models: Sequence[str],
    devices: Sequence[_SmallSignalDevice],
    volts: Mapping[str, float],
    simulator: Simulator,
) -> Iterator[tuple[_SmallSignalDevice, Floats, Complexes]]:
    """Yield each device with its currents, A, (n,), and admittances, S, (P, n, n).

    A copy of it stands on the bench for each terminal that is driven.
    """
    cards, saved = list(models), list[str]()
    for k, device in enumerate(devices):
        for j in range(len(device.nodes)):
            nodes = [f"b{k}_{j}_{i}" for i in range(len(device.nodes))]
            cards.append(device.card(f"b{k}_{j}", nodes))
            for i, (node, place) in enumerate(zip(nodes, device.nodes, strict=True)):
                cards.append(f"v{node} {node} 0 dc {volts[place]!r} ac {float(i == j)!r}")
                cards.append(f"hc{node} c{node} 0 v{node} -1")
                cards.append(f"rc{node} c{node} 0 1")
                saved.append(f"c{node}")
    point = simulate(
        _deck(cards, saved, OperatingPoint(), ".op", simulator), simulator, timeout=SECONDS
    )
    command = f".ac dec {BAND.density} {BAND.start!r} {BAND.stop!r}"
    deck = _deck(cards, saved, SmallSignal(BAND), command, simulator)
    with start(deck, simulator, timeout=SECONDS) as run:
        _, response = run.response()
    first = 0
    for device in devices:
        n = len(device.nodes)
        taken = slice(first, first + n * n)
        currents = point.values[-1, taken].reshape(n, n)[0]
        yield device, currents, response[:, taken].reshape(-1, n, n).transpose(0, 2, 1)
        first += n * n


def _symmetric(C: Floats) -> Floats:
    """Return capacitances that capacitors can have; 0 where the two of a pair tell no sign.

    A charge that follows a voltage elsewhere makes one of a pair alone, which no capacitor does.
    Half of it would be a pole of a capacitor that the device does not have.
    """
    even, odd = 0.5 * (C + C.T), 0.5 * (C - C.T)
    known = np.abs(even) > ONE_SIDED * np.abs(odd)
    return np.where(known, even, 0.0)


def _cards(
    device: _SmallSignalDevice, rest: Floats, currents: Floats, response: Complexes
) -> tuple[list[str], float]:
    """Return the linear cards of a device, and the frequency up to which they hold, Hz.

    Voltages count from its last terminal, into which the currents of the others return.
    """
    omega = math.tau * BAND.start * 10.0 ** np.arange(BAND.steps + 1)
    Y = response[:, :-1, :-1]
    sure_at = int(np.searchsorted(omega, math.tau * LEAST_SURE * 0.99))
    G, C = Y[0].real, Y[sure_at].imag / omega[sure_at]
    C = _symmetric(C)
    misfit = np.abs(Y - G - 1j * omega[:, None, None] * C).max(axis=(1, 2))
    fits = misfit <= MISFIT * np.abs(Y).max(axis=(1, 2))
    last = len(omega) if fits.all() else int(np.argmin(fits))
    if last <= sure_at:
        text = f"its admittance is not G + s C up to {LEAST_SURE:.0e} Hz; {ACCEPTED}"
        raise CardError(f"{shown(device.name)}: {text}")
    name, nodes, end = device.name, device.nodes[:-1], device.nodes[-1]
    volts, scale = rest[:-1] - rest[-1], float(np.abs(G).max())
    offsets = currents[:-1] - G @ volts
    found = [
        f"g.{name}.g{i}{j} {a} {end} {b} {end} {float(G[i, j])!r}"
        for i, a in enumerate(nodes)
        for j, b in enumerate(nodes)
        if abs(G[i, j]) > SMALL * scale
    ]
    # C_ij between two terminals, and from each what is left to the last one
    pairs = [(a, b, -C[i, j]) for i, a in enumerate(nodes) for j, b in enumerate(nodes) if i < j]
    pairs += [(a, end, C[i].sum()) for i, a in enumerate(nodes)]
    least = 1e-6 * float(np.abs(C).max())
    found += [
        f"c.{name}.c{k} {a} {b} {float(c)!r}"
        for k, (a, b, c) in enumerate(pairs)
        if abs(c) > least and a != b
    ]
    found += [
        f"i.{name}.i{i} {a} {end} dc {float(offsets[i])!r}" for i, a in enumerate(nodes) if a != end
    ]
    return found, float(omega[last - 1]) / math.tau
