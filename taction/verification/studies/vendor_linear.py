"""The linear circuit of a vendor's op-amp: its cards on the bench, each measured where it rests.

Nothing is fitted. ngspice's own small signal of the bench is the witness, at every port.
"""

from __future__ import annotations

from dataclasses import replace

from taction.netlist_gen.board.branches import Source, VoltageBetween
from taction.netlist_gen.board.linear_models import record_of
from taction.netlist_gen.board.parts import Branch, Capacitor, Resistor
from taction.netlist_gen.deck.flat_cards import CardError, Flat, circuit_of, read_cards
from taction.spice_models.imported import LinearModel, LinearPart
from taction.system.errors import EngineError, SimulationError, one_line
from taction.system.quantities import show_rate
from taction.verification.characterise.bench import OUT, PROBES
from taction.verification.characterise.element_bench import measured
from taction.verification.characterise.element_parts import add_measured
from taction.verification.characterise.operating_point import DeckPoint
from taction.verification.engines.ngspice.executable import Simulator
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.stability.poles import poles
from taction.verification.studies.ac_witness import AcWitness, stepping

GOOD = 1e-4  # largest relative difference from ngspice of a linear model that serves as a witness
PORTS = {OUT: 1e-3, "inn": 1e-3, "of_inn": 1e-9, "of_inp": 1e-9}
"""What is compared, and what a smaller one counts as: V, and A into the inputs for 1 V."""
SERVO = ("gslow", "rslow", "cslow")
BENCH = ("vinp", "vinn", "vmid", "vdrive", "eservo", "iload", *SERVO)


def linear_model(point: DeckPoint, simulator: Simulator) -> tuple[LinearModel | None, str]:
    """Return the linear circuit of an op-amp at the operating point of its bench.

    None with the reason where there is none: an element that is not of the form ``G + s C``, a
    netlist that is unstable with its inputs held, ngspice's small signal another one.
    """
    try:
        flat = read_cards(point.found.linear)
        if moving := [card for card, found in flat.stimuli.items() if found.moves]:
            return None, f"no linear model: {moving[0]} changes over time"
        add_measured(flat, measured(point.found, point.volts, point.options, simulator))
        found = poles(LinearBoard(circuit_of(_held(flat), "bench", (OUT,))))
        if found.known_unstable:
            rate = show_rate(found.rightmost.real)
            return None, f"no linear model: the netlist itself has a pole at {rate}"
        driven = _driven(flat)
        board = LinearBoard(circuit_of(driven, "bench", (OUT,)))
        witness = AcWitness(point, stepping(driven.branches), simulator)
        seen = witness.compare(board, found.poles, PORTS)
    except (CardError, EngineError, SimulationError) as error:
        return None, f"no linear model: {one_line(error)}"
    if seen.worst is None:
        return None, f"no linear model: ngspice's .ac was not compared: {seen.where}"
    if not seen.worst <= GOOD:
        return None, (
            f"no linear model: it is {100.0 * seen.worst:.2g} % from the small signal of ngspice,"
            f" more than {100.0 * GOOD:g} %, at {seen.where}"
        )
    return LinearModel(_parts(flat), seen.worst, seen.band), ""


def _driven(flat: Flat) -> Flat:
    """Return the bench with 1 V at the inverting input, which else the servo holds."""
    branches = [
        replace(part, value=1.0, before=0.0)
        if isinstance(part, Source) and part.card.lower() == "vdrive"
        else part
        for part in flat.branches
    ]
    return replace(flat, branches=branches)


def _held(flat: Flat) -> Flat:
    """Return the bench with both inputs held, without the servo, whose 1e9 F hide the others."""
    held = [
        VoltageBetween(part.name, part.a, part.b, 0.0, 0.0)
        if part.card.lower() == "eservo"
        else part
        for part in flat.branches
        if part.card.lower() not in SERVO
    ]
    return replace(
        flat,
        branches=held,
        resistors=[part for part in flat.resistors if part.card.lower() not in SERVO],
        capacitors=[part for part in flat.capacitors if part.card.lower() not in SERVO],
    )


def _parts(flat: Flat) -> tuple[LinearPart, ...]:
    """Return the parts of the op-amp with its supplies: the bench without what drives it."""
    outside = {*BENCH, *(f"h{node}" for node in PROBES)}
    every: list[Resistor | Capacitor | Branch] = [
        *flat.resistors, *flat.capacitors, *flat.branches
    ]  # fmt: skip
    records = [record_of(part) for part in every if part.card.lower() not in outside]

    def port(node: str) -> str:
        return "inn" if node == "pin" else node

    return tuple(
        record if record.letter == "K" else replace(
            record,
            a=port(record.a),
            b=port(record.b),
            control=tuple(map(port, record.control)),
        )
        for record in records
    )  # fmt: skip
