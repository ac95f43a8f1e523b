"""From a `Circuit` and an analysis to an ngspice deck.

The op-amps' macromodels are objects of PySpice; the other parts and the resistor matrices are lines
of text, because an object per part costs twenty times as much. Every number is a plain float
(``repr``): in a deck ``1M`` is a milliohm. The same circuit gives the same bytes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from netlist_gen.analysis import (
    Analysis,
    Noise,
    OperatingPoint,
    SmallSignal,
    Tolerances,
    Transient,
)
from netlist_gen.board.circuit import GROUND, Circuit, ResistorMatrix
from netlist_gen.deck.checks import check_circuit, check_request, tolerances
from netlist_gen.deck.header import header_lines
from netlist_gen.deck.noise_cards import noise_cards
from spice_models.array_types import Floats
from spice_models.opamp import OpAmp
from spice_models.subcircuits import amplifier_lines, opamp_subcircuit
from spice_models.transistor import model_card


@dataclass(frozen=True, slots=True)
class Deck:
    """A complete deck with one analysis (of one card for each band, if the analysis is `Noise`)."""

    text: str = field(repr=False)  # the first line is a fixed title
    saved: tuple[str, ...]  # nodes whose voltages are saved, in this order
    analysis: Analysis
    files: Mapping[str, str] = field(default_factory=dict, repr=False)  # included files by name


def write_deck(
    circuit: Circuit,
    analysis: Analysis,
    *,
    solver: str = "klu",
    relative: float = 1e-6,
    saved: Iterable[str] | None = None,
    matrix_file: str | None = None,
) -> Deck:
    """Write the deck of `circuit` for `analysis`.

    Parameters
    ----------
    solver : str
        Option for the matrix solver: ``"klu"``, or ``"noopiter"`` for an ngspice without KLU. A
        noise analysis always has ``"noopiter"``, since ngspice has none with KLU.
    relative : float
        ngspice's reltol; the absolute tolerances follow from the circuit's scales.
    saved : iterable of str, optional
        Nodes to save; by default the outputs. A noise analysis has one node.
    matrix_file : str, optional
        Name of an include file for the subcircuit of the resistor matrices, which can then be
        replaced; the amplifiers are a second subcircuit.

    Raises
    ------
    ValueError
        A name or a value that must not reach a simulator. Only a circuit that was not made from a
        scene can cause it.

    Examples
    --------
    >>> import taction
    >>> scene = taction.load_scene("scenes/paper-breadboard.toml")
    >>> deck = taction.netlist(scene)
    >>> taction.write_deck(taction.synthesise(scene), deck.analysis) == deck
    True
    """
    (deck,) = write_decks(
        circuit, [analysis], solver=solver, relative=relative, saved=saved, matrix_file=matrix_file
    )
    return deck


def write_decks(
    circuit: Circuit,
    analyses: Sequence[Analysis],
    *,
    solver: str = "klu",
    relative: float = 1e-6,
    saved: Iterable[str] | None = None,
    matrix_file: str | None = None,
) -> list[Deck]:
    """Write one deck per analysis; parameters and errors are those of `write_deck`."""
    check_circuit(circuit)
    nodes = tuple(saved) if saved is not None else tuple(o.node for o in circuit.outputs)
    for analysis in analyses:
        check_request(analysis, nodes, solver, matrix_file)
    kinds = {isinstance(analysis, Noise) for analysis in analyses}
    texts = {noisy: _board_text(circuit, matrix_file, noisy) for noisy in kinds}
    limits = tolerances(circuit, relative)
    decks = []
    for analysis in analyses:
        parts, files = texts[isinstance(analysis, Noise)]
        tail = [
            *_current_sources(circuit, analysis),
            *_options(limits, analysis, solver),
            *_temperature(circuit),
            *_analysis_cards(circuit, analysis, nodes),
            ".end",
            "",
        ]
        decks.append(Deck(parts + "\n".join(tail), nodes, analysis, files))
    return decks


def matrix_lines(matrices: Iterable[ResistorMatrix]) -> list[str]:
    """Return one line per resistor, by matrices and rows: ``Rf_3_5`` is row 3, column 5."""
    lines: list[str] = []
    printed: dict[int, list[list[str]]] = {}  # forward and feedback resistors are one array
    for matrix in matrices:
        if id(matrix.ohms) not in printed:
            printed[id(matrix.ohms)] = _printed(matrix.ohms)
        for k, row in enumerate(printed[id(matrix.ohms)]):
            name = f"{matrix.name}_{k + 1}_"
            lines += [
                f"{name}{n} {drive} {sink} {ohms}"
                for n, (drive, sink, ohms) in enumerate(zip(*_ends(matrix, k), row, strict=True), 1)
                if ohms
            ]
    return lines


def _printed(ohms: Floats) -> list[list[str]]:
    """Return the text of every entry, "" if infinite; each distinct value is printed once."""
    values, places = np.unique(ohms, return_inverse=True)
    texts = np.array([repr(v) if v != math.inf else "" for v in values.tolist()], dtype=object)
    rows: list[list[str]] = texts[places].reshape(ohms.shape).tolist()
    return rows


def _ends(matrix: ResistorMatrix, k: int) -> tuple[Sequence[str], Sequence[str]]:
    """Return the driving and the summing nodes of row `k`."""
    signs = matrix.negative[k].tolist()
    if not matrix.by_column:
        ends = matrix.plus[k], matrix.minus[k]
        return [ends[sign] for sign in signs], matrix.sinks
    pairs = zip(matrix.plus, matrix.minus, signs, strict=True)
    drives = [minus if negative else plus for plus, minus, negative in pairs]
    return drives, [matrix.sinks[k]] * len(drives)


def _board_text(
    circuit: Circuit, matrix_file: str | None, noisy: bool
) -> tuple[str, dict[str, str]]:
    """Return the text of all parts except the current sources, and the text of further files."""
    if matrix_file is not None:
        return _split(circuit, matrix_file, noisy)
    lines = [*_amplifiers(circuit), *matrix_lines(circuit.matrices)]
    return _text(circuit, lines, _parts(circuit), noisy), {}


def _split(circuit: Circuit, matrix_file: str, noisy: bool) -> tuple[str, dict[str, str]]:
    """Return the same with two subcircuits: amplifiers and, in `matrix_file`, matrices."""
    pads = _pads(circuit)
    nodes = [*circuit.signal_nodes, *circuit.constraint_nodes, *(o.node for o in circuit.outputs)]
    nodes += [source.node for source in circuit.voltages]
    ports = list(dict.fromkeys([*pads, *nodes]))
    parts = [
        *([""] if circuit.opamps else []),
        *_subcircuit("amplifiers", ports, [*_amplifiers(circuit), *_parts(circuit)]),
        " ".join(["Xamplifiers", *ports, "amplifiers"]),
        " ".join(["Xmatrix", *pads, "matrix"]),
    ]
    text = [
        "* the resistor matrix of a taction board: swap this file for another of the same ports",
        *_subcircuit("matrix", pads, matrix_lines(circuit.matrices)),
        "",
    ]
    board = _text(circuit, [f".include {matrix_file}"], parts, noisy)
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


def _parts(circuit: Circuit) -> list[str]:
    """Return the lines of op-amps, resistors and capacitors."""
    text = _Texts()
    return [
        *(f"X{c.name} {c.noninverting} {c.inverting} {c.output} {c.model}" for c in circuit.opamps),
        *(f"R{r.name} {r.a} {r.b} {text[r.ohms]}" for r in circuit.resistors),
        *(f"C{c.name} {c.a} {c.b} {text[c.farads]}" for c in circuit.capacitors),
        *(f"Q{q.name} {q.collector} {q.base} {q.emitter} {q.model}" for q in circuit.transistors),
    ]


def _amplifiers(circuit: Circuit) -> list[str]:
    """Return the lines of the behavioural amplifiers."""
    return [line for stage in circuit.amplifiers for line in amplifier_lines(stage)]


def _current_sources(circuit: Circuit, analysis: Analysis) -> list[str]:
    """Return the strain currents, the only parts that depend on `analysis`."""
    values = [repr(source.amps) for source in circuit.currents]
    if isinstance(analysis, Transient) and _starts_from_rest(circuit, analysis):
        ramp = repr(analysis.begin)
        values = [f"PWL(0 0 {ramp} {value})" for value in values]
    return [
        f"I{source.name} {GROUND} {source.node} {value}"
        for source, value in zip(circuit.currents, values, strict=True)
    ]


def _starts_from_rest(circuit: Circuit, analysis: Transient) -> bool:
    """Return whether the start needs an operating point; without constant sources rest is 0 V."""
    return analysis.initial == "rest" and circuit.has_constant_sources


def _temperature(circuit: Circuit) -> list[str]:
    """Return the option for the temperature; the figures of the models are those at it."""
    if not circuit.transistors:
        return []
    return [f".options temp={circuit.temperature!r} tnom={circuit.temperature!r}"]


def _options(limits: Tolerances, analysis: Analysis, solver: str) -> list[str]:
    lines = [
        f".options {'noopiter' if isinstance(analysis, Noise) else solver}",
        f".options reltol={limits.relative!r} abstol={limits.current!r} vntol={limits.voltage!r}",
    ]
    charge = limits.charge
    if isinstance(analysis, Transient) and analysis.charge is not None:
        charge = analysis.charge
    lines.append(f".options chgtol={charge!r} gmin={limits.junction!r} pivtol={limits.gmin!r}")
    if isinstance(analysis, Transient):
        method = "trap" if analysis.method == "trapezoidal" else "gear"
        lines.append(f".options method={method} trtol={analysis.truncation / limits.relative!r}")
    return lines


def _analysis_cards(circuit: Circuit, analysis: Analysis, nodes: Sequence[str]) -> list[str]:
    if isinstance(analysis, Noise):
        return noise_cards(analysis, nodes[0], circuit.noises)
    if isinstance(analysis, SmallSignal):
        raise ValueError("a board has no AC source; verification.characterise has benches with one")
    save = ".save " + " ".join(f"v({node})" for node in nodes)
    if isinstance(analysis, OperatingPoint):
        return [save, ".op"]
    rest = _starts_from_rest(circuit, analysis)
    step = repr(analysis.max_step)
    begin = repr(10.0 * analysis.begin)  # ngspice's first step is a tenth of the card's figure
    cards = [f".tran {begin} {analysis.stop!r} 0.0 {step}" + ("" if rest else " uic")]
    if analysis.voltages:
        known = {node: volts for node, volts in analysis.voltages.items() if _is_node(node)}
        pairs = " ".join(f"v({node})={volts!r}" for node, volts in known.items())
        cards.insert(0, f".ic {pairs}")
    return [save, *cards]


def _is_node(name: str) -> bool:
    """Whether an unknown of the state-space engine is a node of the deck, also in an op-amp.

    The inner unknowns of a transistor are not: ngspice takes its charges from the outer nodes.
    """
    return "." not in name or name.rpartition(".")[2] in ("p1", "p2")
