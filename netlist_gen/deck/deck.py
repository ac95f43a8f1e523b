"""From a `Circuit` and an analysis to an ngspice deck.

The op-amps' macromodels are objects of PySpice; the other parts and the resistor matrices are lines
of text, because an object per part costs twenty times as much. Every number is a plain float
(``repr``): in a deck ``1M`` is a milliohm. The same circuit gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from netlist_gen.analysis import (
    Analysis,
    Noise,
    OperatingPoint,
    SmallSignal,
    Tolerances,
    Transient,
)
from netlist_gen.board.circuit import GROUND, Circuit
from netlist_gen.deck.board_cards import board_text
from netlist_gen.deck.checks import check_circuit, check_request, tolerances
from netlist_gen.deck.noise_cards import noise_cards


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
    texts = {noisy: board_text(circuit, matrix_file, noisy) for noisy in kinds}
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
