"""From a `Circuit` and an analysis to an ngspice deck.

The op-amps' macromodels are objects of PySpice; the other parts and the resistor matrices are lines
of text, because an object per part costs twenty times as much. Every number is a plain float
(``repr``): in a deck ``1M`` is a milliohm. The same circuit gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from taction.netlist_gen.analysis import Analysis, NoiseAnalysis, Transient
from taction.netlist_gen.board.circuit import GROUND, Circuit
from taction.netlist_gen.board.parts import VoltageSource
from taction.netlist_gen.deck.board_cards import board_text
from taction.netlist_gen.deck.circuit_checks import check_circuit, check_request, tolerances
from taction.netlist_gen.deck.dialects import DIALECTS, NATIVE, Dialect, starts_from_rest

if TYPE_CHECKING:
    from PySpice.Spice.Netlist import Circuit as PySpiceCircuit

    from taction.netlist_gen.deck.measures import Measures


@dataclass(frozen=True, slots=True)
class Deck:
    """A complete deck with one analysis; a `NoiseAnalysis` has a card for each band."""

    text: str = field(repr=False)  # the first line is a fixed title
    saved: tuple[str, ...]  # nodes whose voltages are saved, in this order
    analysis: Analysis
    files: Mapping[str, str] = field(default_factory=dict, repr=False)  # included files by name
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
    from taction.netlist_gen.deck.measures import measure_lines

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
