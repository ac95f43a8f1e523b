"""The deck that ngspice gets, read back: each card has to say what the circuit says.

The state-space engine has the circuit, ngspice has the text. A part that the writer left out, wired
to another node or wrote with another number makes them two boards. Values are compared exactly,
because the text has all digits. An op-amp's subcircuit has other parts than its model has figures:
it is read by the reader of decks, and both have to respond alike at their pins.

Not read: functions of behavioural amplifiers, limits of op-amps, and netlists of vendors; and where
the wires of an array lie, which the writer and the reader have from one function. The check
``engines_agree`` is their witness.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from taction.netlist_gen.board.branches import VoltageBetween
from taction.netlist_gen.board.circuit import GROUND, Circuit, common_facts
from taction.netlist_gen.board.parts import OpAmpCell, Resistor, SignalAmplifier, VoltageSource
from taction.netlist_gen.board.wired_arrays import wire_branches
from taction.netlist_gen.deck.flat_cards import CardError, read_cards
from taction.spice_models.opamp import OpAmp
from taction.spice_models.subcircuits import PORTS
from taction.spice_models.transistor import Transistor
from taction.system.array_types import Complexes
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.stamps import stamp

READ = "BCEIQRVX"  # letters of the cards of a board
LOAD = 1e6  # ohm, from each pin of an op-amp to ground
RATES = (1e2, 1e5, 1e8)  # rad/s: below, between and above the poles of op-amps
ALIKE = 1e-9  # relative difference of two responses; rounding is far below
SILENT = 1e-10  # of the largest response: below it is none
_CONTROL = re.compile(r"V\((\w+)\)")

Said = tuple[tuple[str, ...], float | str]  # nodes; and the value, or the name of a model


def unlike(circuit: Circuit, text: str) -> str:
    """Return the first difference between the text of a deck and its circuit; empty if none.

    Parameters
    ----------
    circuit : Circuit
        The board that the state-space engine has.
    text : str
        ngspice's deck of a transient, in one file and without parameters.

    Examples
    --------
    >>> import taction
    >>> deck = taction.netlist("scenes/custom-matrix.toml")
    >>> unlike(deck.circuit, deck.text)
    ''
    >>> unlike(deck.circuit, deck.text.replace("Cc_1 v_1 x_1 1e-10", "Cc_1 v_1 x_1 1.01e-10"))
    'Cc_1 is v_1 x_1 1.01e-10 in the deck, v_1 x_1 1e-10 in the circuit'
    """
    board, cells, models = _split(text)
    said = dict(_read(board))
    wanted = dict(_stated(circuit))
    if said != wanted or len(said) != len(board):
        return _first(said, wanted, board)
    for name, transistor in circuit.transistor_models.items():
        if models.get(name) != _figures(transistor):
            return f"the model {name} has other figures in the deck than in the circuit"
    return next(filter(None, (_unlike_cell(circuit, name, cells) for name in _used(circuit))), "")


def _first(said: Mapping[str, Said], wanted: Mapping[str, Said], board: Sequence[str]) -> str:
    """Return a sentence about the first card that differs."""
    for card in {**wanted, **said}:
        here, there = said.get(card), wanted.get(card)
        if here != there:
            texts = [
                "missing" if one is None else " ".join([*one[0], str(one[1])])
                for one in (here, there)
            ]
            return f"{card} is {texts[0]} in the deck, {texts[1]} in the circuit"
    return f"the deck has {len(board)} cards, and {len(said)} names of them"


def _split(
    text: str,
) -> tuple[list[str], dict[str, list[str]], dict[str, tuple[str, ...]]]:
    """Return the cards of the board, those of each subcircuit, and the models of transistors."""
    board, cells = list[str](), dict[str, list[str]]()
    models, inside, depth = dict[str, tuple[str, ...]](), list[str](), 0
    for line in text.split("\n"):
        if line.startswith(".subckt"):
            depth += 1
            if depth == 1:
                inside = cells[line.split()[1]] = [line]
        elif line.startswith(".ends"):
            depth -= 1
        elif depth:
            inside.append(line)
        elif line.startswith(".model"):
            _, name, rest = line.split(None, 2)
            models[name] = tuple(re.split(r"[()\s]+", rest.rstrip(")")))
        elif line[:1] in READ and line:
            board.append(line)
    return board, cells, models


def _read(board: Sequence[str]) -> Iterator[tuple[str, Said]]:
    """Yield what each card says."""
    for line in board:
        card, *words = line.split()
        if card[0] == "B":
            control = _CONTROL.search(line)
            yield card, ((*words[:2], control[1] if control else ""), "")
        elif card[0] in "XQ":
            yield card, (tuple(words[:-1]), words[-1])
        elif card[0] == "E":
            yield card, (tuple(words[:4]), float(words[4]))
        else:
            yield card, (tuple(words[:2]), float(words[-1].rstrip(")")))


def _stated(circuit: Circuit) -> Iterator[tuple[str, Said]]:
    """Yield what the card of each part of the circuit has to say."""
    for matrix in circuit.matrices:
        if matrix.wires is not None:
            for name, a, b, ohms in wire_branches(matrix):
                yield name, ((a, b), ohms)
            continue
        for k, n, drive, sink, ohms in matrix.elements():
            yield f"{matrix.name}_{k + 1}_{n + 1}", ((drive, sink), ohms)
    for cell in circuit.opamps:
        yield cell.card, ((cell.noninverting, cell.inverting, cell.output), cell.model)
    for resistor in circuit.resistors:
        yield resistor.card, ((resistor.a, resistor.b), resistor.ohms)
    for capacitor in circuit.capacitors:
        yield capacitor.card, ((capacitor.a, capacitor.b), capacitor.farads)
    for q in circuit.transistors:
        yield q.card, ((q.collector, q.base, q.emitter), q.model)
    for source in (*circuit.strains, *circuit.constant_voltages):
        if isinstance(source, VoltageSource):
            yield source.card, ((source.node, GROUND), source.volts)
        else:
            yield source.card, ((GROUND, source.node), source.amps)
    for stage in circuit.amplifiers:
        yield from _stage(stage)


def _stage(stage: SignalAmplifier) -> Iterator[tuple[str, Said]]:
    """Yield the cards of a stage: a source with a function, between gains that are not 1."""
    control, target = stage.input, stage.output
    if stage.v_scale != 1.0:
        control = f"{stage.name}_x"
        yield f"Ex{stage.name}", ((control, GROUND, stage.input, GROUND), 1.0 / stage.v_scale)
    if stage.u_scale != 1.0:
        target = f"{stage.name}_g"
        yield f"Eu{stage.name}", ((stage.output, GROUND, target, GROUND), -stage.u_scale)
    yield stage.card, ((target, GROUND, control), "")


def _figures(transistor: Transistor) -> tuple[str, ...]:
    """Return what the model card of a transistor has to say, word by word."""
    t = transistor
    values = {
        "is": t.saturation_current, "bf": t.forward_gain, "br": t.reverse_gain,
        "re": t.emitter_resistance, "cje": t.emitter_capacitance, "mje": 0,
        "cjc": t.collector_capacitance, "mjc": 0,
    }  # fmt: skip
    return (t.polarity, *(f"{name}={value!r}" for name, value in values.items()))


def _used(circuit: Circuit) -> Iterator[str]:
    """Yield the models of op-amps whose subcircuits are linear and our own."""
    for name in dict.fromkeys(cell.model for cell in circuit.opamps):
        model = circuit.models[name]
        if model.imported is None and not model.large_signal:
            yield name


def _unlike_cell(circuit: Circuit, name: str, cells: Mapping[str, Sequence[str]]) -> str:
    """Return how the subcircuit of an op-amp differs from its model; empty if it does not."""
    if name not in cells:
        return f"the deck has no subcircuit {name}"
    grounded = all(c.noninverting == GROUND for c in circuit.opamps if c.model == name)
    return _compared(circuit.models[name], grounded, "\n".join(cells[name]))


@lru_cache(maxsize=64)
def _compared(model: OpAmp, grounded: bool, text: str) -> str:
    head, *cards = text.split("\n")
    pins = PORTS[1:] if grounded else PORTS
    if head.split()[2:] != list(PORTS):
        return f"the subcircuit {model.name} has the pins {' '.join(head.split()[2:])}"
    cell = OpAmpCell("", model.name, GROUND if grounded else PORTS[0], *PORTS[1:])
    bench = replace(_EMPTY, models={model.name: model}, opamps=(cell,), resistors=_loads(pins))
    try:
        flat = read_cards(line.lower() for line in cards)
        parts = replace(
            _EMPTY,
            resistors=(*_loads(pins), *flat.resistors),
            capacitors=tuple(flat.capacitors),
            branches=(*flat.branches, *([_WIRE] if grounded else [])),
        )
        for rate in RATES:
            one, other = (_response(circuit, pins, rate) for circuit in (bench, parts))
            size = np.maximum(abs(one), abs(other))
            if np.any(abs(one - other) > ALIKE * size + SILENT * size.max(axis=0)):
                text = "responds otherwise than the op-amp of the circuit"
                return f"the subcircuit {model.name} {text}"
    except (CardError, EngineError, np.linalg.LinAlgError) as error:
        return f"the subcircuit {model.name} cannot be read back: {error}"
    return ""


_WIRE = VoltageBetween("wire", PORTS[0], GROUND, 0.0, 0.0)


_EMPTY = Circuit("cell", "linear", "", common_facts(U0=1.0), {}, *((),) * 11)


def _loads(pins: Sequence[str]) -> tuple[Resistor, ...]:
    return tuple(Resistor(f"load_{pin}", pin, GROUND, LOAD) for pin in pins)


def _response(circuit: Circuit, pins: Sequence[str], rate: float) -> Complexes:
    """Return the voltages at pins for 1 A into each, and for the sources within, V."""
    known = stamp(circuit)
    M, K = (matrix.astype(np.complex128) for matrix in (known.dense.mass, known.dense.stiffness))
    places = [known.place(pin) for pin in pins]
    drive = np.zeros((known.size + 1, len(pins) + 1), dtype=np.complex128)  # the last is ground's
    drive[known.balance_rows[places], range(len(pins))] = 1.0
    drive[:-1, -1] = known.drive(sources_on=True)
    found = np.linalg.solve(complex(rate, rate) * M - K, drive[:-1])
    return found[places].astype(np.complex128)
