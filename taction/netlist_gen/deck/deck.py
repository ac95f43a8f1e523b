"""From a `Circuit` and an analysis to an ngspice deck.

The op-amps' macromodels are objects of PySpice; the other parts and the resistor matrices are lines
of text, because an object per part costs twenty times as much. Every number is a plain float
(``repr``): in a deck ``1M`` is a milliohm. The same circuit gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby
from typing import TYPE_CHECKING

from taction.netlist_gen.analysis import Analysis, NoiseAnalysis, SimulatedDeck, Transient
from taction.netlist_gen.board.circuit import GROUND, Circuit, Fact
from taction.netlist_gen.board.parts import ResistorMatrix, SignalAmplifier, VoltageSource
from taction.netlist_gen.board.wired_arrays import wire_branches
from taction.netlist_gen.deck.circuit_checks import check_circuit, check_request, tolerances
from taction.netlist_gen.deck.dialects import DIALECTS, NATIVE, Dialect, starts_from_rest
from taction.netlist_gen.scene.open_tables import AMPLIFIERS
from taction.spice_models.opamp import OpAmp
from taction.spice_models.subcircuits import opamp_subcircuit
from taction.spice_models.transistor import model_card

if TYPE_CHECKING:
    from PySpice.Spice.Netlist import Circuit as PySpiceCircuit

    from taction.netlist_gen.deck.dialects import Measures


@dataclass(frozen=True, slots=True)
class Deck(SimulatedDeck):
    """A complete deck with one analysis; a `NoiseAnalysis` has a card for each band."""

    dialect: str = NATIVE

    def to_pyspice(self) -> PySpiceCircuit:
        """Return the board as a ``PySpice.Spice.Netlist.Circuit`` to go on with.

        It has subcircuits, models and elements by name, and options; analysis and saved
        nodes are PySpice's. ``str(circuit)`` is a deck without an analysis.

        Raises
        ------
        ValueError
            The deck is in another dialect than ngspice's.

        Examples
        --------
        >>> import taction
        >>> circuit = taction.netlist("scenes/paper-breadboard.toml").to_pyspice()
        >>> circuit.Cc_4.capacitance = 12e-12
        >>> "Cc_4 v_4 x_4 1.2e-11" in str(circuit)
        True
        """
        if self.dialect != NATIVE:
            raise ValueError(f"dialect {self.dialect!r} has no PySpice circuit; expected {NATIVE}")
        from taction.netlist_gen.deck.pyspice_circuit import pyspice_circuit

        return pyspice_circuit(self.text, self.files)


def write_deck(
    circuit: Circuit,
    analysis: Analysis,
    *,
    solver: str = "klu",
    relative: float = 1e-6,
    saved: Iterable[str] | None = None,
    matrix_file: str | None = None,
    dialect: str = NATIVE,
    measures: Measures | None = None,
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
    dialect : str
        Key of `DIALECTS`; all but ngspice's have transients only.
    measures : Measures, optional
        Rise time, settling time and overshoot as ``.meas`` cards of a transient.

    Raises
    ------
    ValueError
        A name or a value that must not reach a simulator: only a circuit that was not made from a
        scene can cause it. Or the dialect cannot express the board or measures.

    Examples
    --------
    >>> import taction
    >>> scene = taction.load_scene("scenes/paper-breadboard.toml")
    >>> deck = taction.netlist(scene)
    >>> taction.write_deck(taction.synthesise(scene), deck.analysis).text == deck.text
    True
    """
    check_circuit(circuit)
    nodes = tuple(saved) if saved is not None else tuple(o.node for o in circuit.outputs)
    check_request(analysis, nodes, solver, matrix_file)
    language = _language(dialect, circuit, measures)
    noisy = isinstance(analysis, NoiseAnalysis)
    parts, files = board_text(circuit, matrix_file, noisy)
    added = [*_strains(circuit, analysis), *_measures(circuit, analysis, measures)]
    board = language.cards(parts + "\n".join(added))
    limits = tolerances(circuit, relative)
    text = "\n".join([board, *language.closing(circuit, analysis, nodes, limits, solver)])
    files = {name: language.cards(text) for name, text in files.items()}
    return Deck(text, nodes, analysis, files, dialect)


def _language(dialect: str, circuit: Circuit, measures: Measures | None) -> Dialect:
    """Return the dialect of a name, which can express all that the deck is to have."""
    language = DIALECTS[dialect]
    refused = [str(complaint) for complaint in language.refusals(circuit)]
    if measures is not None and not language.measures:
        refused.append("measures")
    if refused:
        raise ValueError(f"dialect {dialect!r} cannot express: {'; '.join(refused)}")
    return language


def _measures(circuit: Circuit, analysis: Analysis, measures: Measures | None) -> list[str]:
    if measures is None:
        return []
    if not isinstance(analysis, Transient):
        raise ValueError("measures need a transient")
    from taction.netlist_gen.deck.dialects import measure_lines

    return measure_lines(circuit, measures, analysis.stop)


def _strains(circuit: Circuit, analysis: Analysis) -> list[str]:
    """Return the sources of the strain, the only parts that depend on `analysis`."""
    ramp = ""
    if isinstance(analysis, Transient) and starts_from_rest(circuit, analysis):
        ramp = repr(analysis.begin)
    lines = []
    for source in circuit.strains:
        if isinstance(source, VoltageSource):
            ends, value = (source.node, GROUND), repr(source.volts)
        else:
            ends, value = (GROUND, source.node), repr(source.amps)
        lines.append(" ".join([source.card, *ends, f"PWL(0 0 {ramp} {value})" if ramp else value]))
    return lines


def matrix_lines(matrices: Iterable[ResistorMatrix]) -> list[str]:
    """Return one line per resistor by rows, ``Rf_3_5`` in row 3, column 5, or with its wires."""
    text, lines = _Texts(), list[str]()
    for matrix in matrices:
        if matrix.wires is not None:
            lines += [f"{name} {a} {b} {ohms!r}" for name, a, b, ohms in wire_branches(matrix)]
        else:
            lines += [
                f"{matrix.name}_{k + 1}_{n + 1} {drive} {sink} {text[ohms]}"
                for k, n, drive, sink, ohms in matrix.elements()
            ]
    return lines


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
    for wires in {each.wires.described for each in circuit.matrices if each.wires is not None}:
        lines.append(wires)
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


def board_text(
    circuit: Circuit, matrix_file: str | None, noisy: bool
) -> tuple[str, dict[str, str]]:
    """Return the text of all parts but the sources of the strain, and the text of further files."""
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
    biases = [
        f"{bias.card} {bias.node} {GROUND} {bias.volts!r}" for bias in circuit.constant_voltages
    ]
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
    """Return the lines of op-amps, resistors, capacitors and transistors."""
    text = _Texts()
    return [
        *(f"X{c.name} {c.noninverting} {c.inverting} {c.output} {c.model}" for c in circuit.opamps),
        *(f"R{r.name} {r.a} {r.b} {text[r.ohms]}" for r in circuit.resistors),
        *(f"C{c.name} {c.a} {c.b} {text[c.farads]}" for c in circuit.capacitors),
        *(f"Q{q.name} {q.collector} {q.base} {q.emitter} {q.model}" for q in circuit.transistors),
    ]


def _amplifiers(circuit: Circuit) -> list[str]:
    """Return the lines of the behavioural amplifiers."""
    return [
        line
        for stage in circuit.amplifiers
        for line in amplifier_lines(stage, AMPLIFIERS[stage.kind].expression)
    ]


def amplifier_lines(stage: SignalAmplifier, expression: str) -> tuple[str, ...]:
    """Return the lines of one stage, ``V(output) = -u_scale g(V(input) / v_scale)``.

    The `expression` of g is that of its `AmplifierKind`.

    A stage is a ``B`` card. ngspice cuts a number in a B expression to 11 digits, so a `v_scale`
    other than 1 V is the gain of a card ``Ex{name}`` before it (node ``{name}_x``), and a `u_scale`
    other than 1 V the gain of a card ``Eu{name}`` after it (node ``{name}_g``).
    """
    if not expression:
        raise ValueError(f"{stage.name}: an op-amp stage has no behavioural source")
    name, before, after = stage.name, [], []
    control, target, sign = stage.input, stage.output, "-"
    if stage.v_scale != 1.0:
        control = f"{name}_x"
        before.append(f"Ex{name} {control} 0 {stage.input} 0 {1.0 / stage.v_scale!r}")
    if stage.u_scale != 1.0:
        target, sign = f"{name}_g", ""
        after.append(f"Eu{name} {stage.output} 0 {target} 0 {-stage.u_scale!r}")
    value = expression.format(x=f"V({control})")
    return (*before, f"B{name} {target} 0 V={sign}{value}", *after)
