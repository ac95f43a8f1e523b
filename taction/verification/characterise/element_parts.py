"""The linear parts that stand for measured elements in a circuit.

A device is ``G + s C`` between its terminals, with constant currents that make it rest where it
rests. All counts from its last terminal, so that a device between floating nodes stays floating.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from taction.netlist_gen.board.branches import (
    ChargeByVoltage,
    Coil,
    CurrentBetween,
    CurrentByCurrent,
    CurrentByVoltage,
    VoltageBetween,
    VoltageByCurrent,
    VoltageByVoltage,
)
from taction.netlist_gen.board.circuit import GROUND
from taction.netlist_gen.board.parts import Branch, Capacitor, Resistor
from taction.netlist_gen.deck.flat_cards import Flat, card_of, read_cards
from taction.netlist_gen.deck.stimuli import FIXED, Stimulus
from taction.verification.characterise.element_bench import MeasuredElement, measured
from taction.verification.characterise.operating_point import DeckPoint
from taction.verification.engines.ngspice.executable import Simulator

SMALL = 1e-9  # of the largest capacitance of an element: a difference below is rounding
SAME = 1e-12  # of two gains with opposite signs: they are one of a difference


def linear_flat(point: DeckPoint, simulator: Simulator) -> Flat:
    """Return the linear parts of a deck at its operating point; those measured are no knobs.

    `CardError`: an element is not of the form ``G + s C``, or ngspice does not measure it.
    """
    assert point.found is not None  # noqa: S101 - `find_point` sorts them
    flat = read_cards(point.found.linear)
    for each in measured(point.found, point.volts, point.options, simulator):
        name = each.element.name
        for outer, inner, ohms in each.resistors:
            flat.resistors.append(Resistor(inner, outer, inner, ohms))
        if each.outer:
            base = next(outer for outer, inner, _ in each.resistors if inner == each.ports[1])
            flat.capacitors.append(Capacitor(f"{name}#x", base, each.ports[0], each.outer))
        if each.element.terminals:
            _device(flat, each)
        for part in _outputs(each):
            if isinstance(part, VoltageBetween | CurrentBetween):
                flat.stimuli[part.card] = Stimulus(part.value, part.value, kind=FIXED)
            flat.branches.append(part)
    return flat


def _device(flat: Flat, each: MeasuredElement) -> None:
    name, ports, n = each.element.name, each.ports, each.element.terminals
    end, controls = ports[-1], [*ports, *each.element.held[n:]]
    for i, a in enumerate(ports[:-1]):
        for j, b in enumerate(controls):
            if j != n - 1 and each.G[i, j]:
                against = end if j < n else GROUND
                card = f"{name}#g{i}{j}"
                flat.branches.append(
                    CurrentByVoltage(card, a, end, float(each.G[i, j]), (b, against))
                )
        for j, source in enumerate(each.element.currents, len(each.element.held)):
            if each.G[i, j]:
                control = card_of(source)
                card = f"{name}#g{i}{j}"
                flat.branches.append(CurrentByCurrent(card, a, end, float(each.G[i, j]), control))
        offset = float(each.rest[i] - _drop(each, i))
        if offset and a != end:
            part = CurrentBetween(f"{name}#i{i}", a, end, offset, offset)
            flat.branches.append(part)
            flat.stimuli[part.card] = Stimulus(offset, offset, kind=FIXED)
    _charges(flat, each, controls)


def _charges(flat: Flat, each: MeasuredElement, controls: Sequence[str]) -> None:
    """Add the capacitances of a device, from the last of its terminals that have any.

    Where the substrate has none, the others sum to zero, and from there rounding would be a pole.
    """
    name, ports, n = each.element.name, each.ports, each.element.terminals
    scale = float(np.abs(each.C).max(initial=0.0))
    large = np.abs(each.C) > SMALL * scale
    *own, last = [i for i in range(n) if large[i].any() or large[:, i].any()] or [0]
    end, sums = ports[last], np.diag(each.C).copy()

    def charge(i: int, j: int, value: float, control: tuple[str, str]) -> None:
        if abs(value) > SMALL * scale:
            card = f"{name}#q{i}{j}"
            flat.branches.append(ChargeByVoltage(card, ports[i], end, value, control))

    for i in own:
        for j in own[: own.index(i)]:
            one, other = float(each.C[i, j]), float(each.C[j, i])
            shared = min(one, other, key=abs) if one * other > 0.0 else 0.0
            if abs(shared) > SMALL * scale and ports[i] != ports[j]:
                flat.capacitors.append(Capacitor(f"{name}#c{i}{j}", ports[i], ports[j], -shared))
                sums[i] += shared
                sums[j] += shared
            else:
                shared = 0.0
            charge(i, j, one - shared, (ports[j], end))
            charge(j, i, other - shared, (ports[i], end))
        for j in range(n, len(controls)):
            charge(i, j, float(each.C[i, j]), (controls[j], GROUND))
    for i in own:
        if abs(sums[i]) > SMALL * scale and ports[i] != end:
            flat.capacitors.append(Capacitor(f"{name}#c{i}", ports[i], end, float(sums[i])))


def _drop(each: MeasuredElement, i: int) -> float:
    """Return the current that the conductances take at rest, A, as they are stamped."""
    n = each.element.terminals
    total = sum(
        float(g) * (v - each.held[n - 1])
        for g, v in zip(each.G[i, : n - 1], each.held, strict=False)
    )
    return float(total + each.G[i, n:] @ each.held[n:])


def _outputs(each: MeasuredElement) -> Iterator[Branch]:
    """Yield the parts of an expression: sources in series for a voltage, else in parallel."""
    name = each.element.name
    for which, a, b in each.element.outs:
        row = len(each.element.held[: each.element.terminals])
        if which == "l":
            ohms = float(each.G[0, 0])
            middle = f"{name}#m" if ohms else b
            yield Coil(name[1:], a, middle, float(each.C[0, 0]))
            if ohms:
                yield VoltageByCurrent(f"{name}#r", middle, b, ohms, f"L{name[1:]}")
            continue
        terms = list(_terms(each, row))
        offset = float(each.rest[row] - each.G[row] @ each.held)
        nodes = [a, *(f"{name}#{k}" for k in range(len(terms))), b]
        for k, (value, control) in enumerate(terms):
            ends = (nodes[k], nodes[k + 1]) if which == "v" else (a, b)
            card = f"{name}#g{k}"
            if isinstance(control, str):
                by_current = VoltageByCurrent if which == "v" else CurrentByCurrent
                yield by_current(card, *ends, value, control)
            else:
                by_voltage = VoltageByVoltage if which == "v" else CurrentByVoltage
                yield by_voltage(card, *ends, value, control)
        if which == "v":
            yield VoltageBetween(f"{name}#i", nodes[-2], b, offset, offset)
            continue
        if offset:
            yield CurrentBetween(f"{name}#i", a, b, offset, offset)
        for j, node in enumerate(each.element.held):
            if value := float(each.C[row, j]):
                yield ChargeByVoltage(f"{name}#q{j}", a, b, value, (node, GROUND))


def _terms(each: MeasuredElement, row: int) -> Iterator[tuple[float, tuple[str, str] | str]]:
    """Yield gains with what they multiply; two opposite ones are that of a difference."""
    element, gains = each.element, each.G[row]
    left = [j for j in range(len(element.held)) if gains[j]]
    while left:
        j = left.pop(0)
        same = next((k for k in left if abs(gains[j] + gains[k]) <= SAME * abs(gains[j])), None)
        if same is None:
            yield float(gains[j]), (element.held[j], GROUND)
        else:
            left.remove(same)
            yield float(gains[j]), (element.held[j], element.held[same])
    for j, source in enumerate(element.currents, len(element.held)):
        if gains[j]:
            yield float(gains[j]), card_of(source)
