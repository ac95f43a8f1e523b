"""The cards of a board: all its parts except the strain currents, in one file or in two."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache

from taction.netlist_gen.board.circuit import GROUND, Circuit
from taction.netlist_gen.deck.header import header_lines
from taction.netlist_gen.deck.matrix_cards import matrix_lines
from taction.netlist_gen.deck.parameters import NO_PARAMETERS, Parameters
from taction.netlist_gen.scene.open_tables import AMPLIFIERS
from taction.spice_models.opamp import OpAmp
from taction.spice_models.subcircuits import amplifier_lines, opamp_subcircuit
from taction.spice_models.transistor import model_card


def board_text(
    circuit: Circuit,
    matrix_file: str | None,
    noisy: bool,
    parameters: Parameters = NO_PARAMETERS,
) -> tuple[str, dict[str, str]]:
    """Return the text of all parts except the current sources, and the text of further files."""
    if matrix_file is not None:
        return _split(circuit, matrix_file, noisy, parameters)
    lines = [*_amplifiers(circuit), *matrix_lines(circuit.matrices)]
    parts = _parts(circuit, parameters)
    return _text(circuit, [*parameters.lines, *lines], parts, noisy), {}


def _split(
    circuit: Circuit, matrix_file: str, noisy: bool, parameters: Parameters
) -> tuple[str, dict[str, str]]:
    """Return the same with two subcircuits: amplifiers and, in `matrix_file`, matrices."""
    pads = _pads(circuit)
    nodes = [*circuit.signal_nodes, *circuit.constraint_nodes, *(o.node for o in circuit.outputs)]
    nodes += [source.node for source in circuit.voltages]
    ports = list(dict.fromkeys([*pads, *nodes]))
    parts = [
        *([""] if circuit.opamps else []),
        *_subcircuit("amplifiers", ports, [*_amplifiers(circuit), *_parts(circuit, parameters)]),
        " ".join(["Xamplifiers", *ports, "amplifiers"]),
        " ".join(["Xmatrix", *pads, "matrix"]),
    ]
    text = [
        "* the resistor matrix of a taction board: swap this file for another of the same ports",
        *_subcircuit("matrix", pads, matrix_lines(circuit.matrices)),
        "",
    ]
    board = _text(circuit, [*parameters.lines, f".include {matrix_file}"], parts, noisy)
    return board, {matrix_file: "\n".join(text)}


def _subcircuit(name: str, ports: Sequence[str], lines: Iterable[str]) -> list[str]:
    return [f".subckt {name} " + " ".join(ports), *lines, f".ends {name}"]


def _text(circuit: Circuit, before: Iterable[str], after: Iterable[str], noisy: bool) -> str:
    """Return header, `before`, subcircuits of the op-amps in use, `after` and bias sources."""
    grounded: dict[str, bool] = {}
    for cell in circuit.opamps:
        grounded[cell.model] = cell.noninverting == GROUND and grounded.get(cell.model, True)
    models = [model for model in circuit.models.values() if model.name in grounded]
    cells = "\n".join(
        _opamp_text(model, grounded[model.name], circuit.supply, noisy) for model in models
    )
    biases = [f"V{bias.name} {bias.node} {GROUND} {bias.volts!r}" for bias in circuit.voltages]
    cards = [model_card(model) for model in circuit.transistor_models.values()]
    head = [".title taction board", *header_lines(circuit), *cards, *before, ""]
    return "\n".join(head) + cells + "\n".join([*after, *biases, ""])


@lru_cache(maxsize=64)
def _opamp_text(model: OpAmp, grounded: bool, supply: float, noisy: bool) -> str:
    if model.imported is not None:
        return model.imported.text(model.name)
    return str(opamp_subcircuit(model, noninverting_grounded=grounded, supply=supply, noisy=noisy))


def _pads(circuit: Circuit) -> list[str]:
    """Return the nodes that connect the matrices with the amplifiers, each once."""
    nodes: dict[str, None] = {}
    for matrix in circuit.matrices:
        for _, _, drive, sink, _ in matrix.elements():
            nodes[drive] = nodes[sink] = None
    return list(nodes)


class _Texts(dict[float, str]):
    """The text of each number, printed once; many parts have the same value."""

    def __missing__(self, number: float) -> str:
        return self.setdefault(number, repr(number))


def _parts(circuit: Circuit, parameters: Parameters) -> list[str]:
    """Return the lines of op-amps, resistors, capacitors and transistors."""
    text = _Texts()
    own = {card: f"{{{value}}}" for card, value in parameters.expressions.items()}.get
    return [
        *(f"X{c.name} {c.noninverting} {c.inverting} {c.output} {c.model}" for c in circuit.opamps),
        *(f"R{r.name} {r.a} {r.b} {own(f'R{r.name}', text[r.ohms])}" for r in circuit.resistors),
        *(f"C{c.name} {c.a} {c.b} {own(f'C{c.name}', text[c.farads])}" for c in circuit.capacitors),
        *(f"Q{q.name} {q.collector} {q.base} {q.emitter} {q.model}" for q in circuit.transistors),
    ]


def _amplifiers(circuit: Circuit) -> list[str]:
    """Return the lines of the behavioural amplifiers."""
    return [
        line
        for stage in circuit.amplifiers
        for line in amplifier_lines(stage, AMPLIFIERS[stage.kind].expression)
    ]
