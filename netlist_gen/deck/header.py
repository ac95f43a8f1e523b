"""The comment lines at the head of a deck: scene, units, facts of the board and omitted parts."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby

from taction.netlist_gen.board.circuit import Circuit, Fact


def header_lines(circuit: Circuit) -> list[str]:
    """Return the header of `circuit` as SPICE comments.

    Its only text by the user is the scene's name: letters, digits and ``-_.`` only.
    """
    sensors, channels = circuit.shape
    lines = [
        f"scene {circuit.name}: {channels} channels, {sensors} sensors,"
        f" {circuit.amplifier} amplifiers, topology {circuit.topology}",
        "units: ohm, F, V, A, s; values are plain floats",
        *_facts(circuit),
    ]
    outputs = ", ".join(
        f"u_{n} = {'-' if out.sign < 0 else ''}v({out.node})"
        for n, out in enumerate(circuit.outputs[:3], 1)
    )
    lines.append("outputs: " + outputs + (", ..." if len(circuit.outputs) > 3 else ""))
    lines.append("Rf_k_n, Rb_k_n: forward and feedback resistor of row k, column n of T")
    lines += [f"left out: {item.what}; {item.why}" for item in circuit.omissions]
    return ["* " + line for line in lines]


def _facts(circuit: Circuit) -> Iterator[str]:
    """Yield the facts, values of parts in one line, others in a line each with their sentence."""
    for of_parts, facts in groupby(circuit.facts.values(), lambda fact: bool(fact.role)):
        texts = [_written(fact) for fact in facts]
        yield from [", ".join(texts)] if of_parts else texts


def _written(fact: Fact) -> str:
    text = f"{fact.symbol} = {fact.value!r} {fact.unit}".rstrip()
    return f"{text}   ({fact.sentence})" if fact.sentence else text
