"""A board with ideal antilog stages in the place of those of transistors."""

from __future__ import annotations

from dataclasses import replace

from taction.netlist_gen.board.antilog import CAPACITORS, REFERENCE, RESISTORS, SUMMING_NODES
from taction.netlist_gen.board.circuit import Circuit, Output, SignalAmplifier


def with_ideal_stages(circuit: Circuit) -> Circuit:
    """Return `circuit` with the function ``U0 exp(v/Ve)`` itself as its stages, for comparisons.

    All other parts stay as they are; a board without transistors is returned unchanged. An ideal
    stage in the place of NPN transistors does not invert, so it has a negative `u_scale`.
    """
    if not circuit.transistors:
        return circuit
    scalings = circuit.scalings
    inner = {f"{node}_{n}" for node in SUMMING_NODES for n, _ in _numbered(circuit)}
    return replace(
        circuit,
        opamps=tuple(cell for cell in circuit.opamps if cell.inverting not in inner),
        amplifiers=tuple(
            SignalAmplifier(
                output.node,
                circuit.amplifier,
                f"v_{n}",
                output.node,
                -output.sign * scalings.unit_voltage,
                scalings.exponential_slope,
            )
            for n, output in _numbered(circuit)
        ),
        resistors=tuple(part for part in circuit.resistors if _prefix(part.name) not in RESISTORS),
        capacitors=tuple(
            part
            for part in circuit.capacitors
            if _prefix(part.name) not in CAPACITORS and part.a not in inner
        ),
        voltages=tuple(source for source in circuit.voltages if source.name != REFERENCE),
        transistors=(),
        transistor_models={},
    )


def _numbered(circuit: Circuit) -> list[tuple[int, Output]]:
    return list(enumerate(circuit.outputs, 1))


def _prefix(name: str) -> str:
    return name.partition("_")[0]
