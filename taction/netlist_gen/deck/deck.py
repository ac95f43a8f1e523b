"""From a `Circuit`, which is checked, and an analysis to an ngspice deck.

The op-amps' macromodels are objects of PySpice, other parts are lines of text. Every number is a
plain float (``repr``): in a deck ``1M`` is a milliohm. The same circuit gives the same bytes.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from taction.netlist_gen.analysis import (
    Analysis,
    NoiseAnalysis,
    SimulatedDeck,
    SimulatorTolerances,
    Transient,
)
from taction.netlist_gen.board.circuit import GROUND, Circuit
from taction.netlist_gen.board.parts import (
    PLACES,
    ResistorMatrix,
    SignalAmplifier,
    VoltageSource,
    wire_branches,
)
from taction.netlist_gen.deck.dialects import (
    DIALECTS,
    NATIVE,
    Measures,
    measure_lines,
    starts_from_rest,
)
from taction.netlist_gen.scene.open_tables import AMPLIFIERS
from taction.spice_models.subcircuits import opamp_subcircuit
from taction.spice_models.transistor import ZERO_CELSIUS, model_card

if TYPE_CHECKING:
    from PySpice.Spice.Netlist import Circuit as PySpiceCircuit

_CELL = re.compile(r"^\.subckt (\S+).*\n((?:.*\n)*?)\.ends \1\n", re.M)
VALUES = ("resistance", "voltage_gain", "transconductance", "dc_value")
_FOREIGN = re.compile(r"^[^RCIVEGBXQ]", re.M)  # a card that taction does not write


@dataclass(frozen=True, slots=True)
class Deck(SimulatedDeck):
    """A complete deck with one analysis; a `NoiseAnalysis` has a card for each band."""

    dialect: str = NATIVE

    def to_pyspice(self) -> PySpiceCircuit:
        """Return the board as a ``PySpice.Spice.Netlist.Circuit`` to go on with.

        It has subcircuits, models and elements by name, and options; analysis and saved
        nodes are PySpice's. ``str(circuit)`` is a deck without an analysis. A vendor's
        subcircuit stays text (``raw_spice``).

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
        from PySpice.Spice.BasicElement import BehavioralCapacitor
        from PySpice.Spice.Parser import SpiceParser

        text = self.text
        kept = [cell[0] for cell in _CELL.finditer(text) if _FOREIGN.search(cell[2])]
        for vendors in kept:
            text = text.replace(vendors, "")
        parser = SpiceParser(source=text)
        circuit = parser.build_circuit()
        for statement in parser.subcircuits:
            circuit.subcircuit(statement.build())
        for netlist in (circuit, *circuit.subcircuits):
            for element in [*netlist.elements]:
                if isinstance(element, BehavioralCapacitor):  # the parser takes all C for these
                    nodes, farads = element.nodes, float(element.capacitance_expression)
                    element.detach()
                    element = netlist.C(element.name[1:], *nodes, farads)
                for key in VALUES:
                    with suppress(AttributeError, ValueError):  # another part, or a waveform
                        setattr(element, key, float(getattr(element, key)))
        options = (line + "\n" for line in text.split("\n") if line.startswith(".options"))
        circuit.raw_spice += "".join((*kept, *options))
        return circuit


def write_deck(
    circuit: Circuit,
    analysis: Analysis,
    *,
    solver: str = "klu",
    relative: float = 1e-6,
    saved: Iterable[str] | None = None,
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
    check_request(analysis, nodes, solver)
    language, added = DIALECTS[dialect], _strains(circuit, analysis)
    refused = [str(complaint) for complaint in language.refusals(circuit)]
    refused += ["measures"] if measures is not None and not language.measures else []
    if refused:
        raise ValueError(f"dialect {dialect!r} cannot express: {'; '.join(refused)}")
    if measures is not None:
        if not isinstance(analysis, Transient):
            raise ValueError("measures need a transient")
        added += measure_lines(circuit, measures, analysis.stop)
    parts = board_text(circuit, noisy=isinstance(analysis, NoiseAnalysis))
    board = language.cards(parts + "\n".join(added))
    limits = tolerances(circuit, relative)
    text = "\n".join([board, *language.closing(circuit, analysis, nodes, limits, solver)])
    return Deck(text, nodes, analysis, dialect=dialect)


def _strains(circuit: Circuit, analysis: Analysis) -> list[str]:
    """Return the sources of the strain, the only parts that depend on `analysis`."""
    ramps = isinstance(analysis, Transient) and starts_from_rest(circuit, analysis)
    begin, lines = getattr(analysis, "begin", 0.0), []
    for source in circuit.strains:
        if isinstance(source, VoltageSource):
            ends, value = f"{source.node} {GROUND}", source.volts
        else:
            ends, value = f"{GROUND} {source.node}", source.amps
        wave = f"PWL(0 0 {begin!r} {value!r})" if ramps else repr(value)
        lines.append(f"{source.card} {ends} {wave}")
    return lines


def matrix_lines(matrices: Iterable[ResistorMatrix]) -> list[str]:
    """Return one line per resistor by rows, ``Rf_3_5`` in row 3, column 5, or with its wires."""
    lines = list[str]()
    for one in matrices:
        if one.wires is not None:
            lines += [f"{card} {a} {b} {ohms!r}" for card, a, b, ohms in wire_branches(one)]
            continue
        lines += [f"{one.name}_{k + 1}_{n + 1} {a} {b} {r!r}" for k, n, a, b, r in one.elements()]
    return lines


def header_lines(circuit: Circuit) -> list[str]:
    """Return the header as SPICE comments; its only text by the user is the scene's name."""
    sensors, channels = circuit.shape
    lines = [
        f"scene {circuit.name}: {channels} channels, {sensors} sensors,"
        f" {circuit.amplifier} amplifiers, topology {circuit.topology}",
        "units: ohm, F, V, A, s; values are plain floats",
    ]
    for fact in circuit.facts.values():
        sentence = f"   ({fact.sentence})" if fact.sentence else ""
        lines.append(f"{fact.symbol} = {fact.value!r} {fact.unit}".rstrip() + sentence)
    outputs = ", ".join(
        f"u_{n} = {'-' if out.sign < 0 else ''}v({out.node})"
        for n, out in enumerate(circuit.outputs[:3], 1)
    )
    lines.append("outputs: " + outputs + (", ..." if len(circuit.outputs) > 3 else ""))
    lines.append("Rf_k_n, Rb_k_n: forward and feedback resistor of row k, column n of T")
    lines += dict.fromkeys(m.wires.described for m in circuit.matrices if m.wires is not None)
    lines += [f"left out: {item.what}; {item.why}" for item in circuit.omissions]
    return ["* " + line for line in lines]


def board_text(circuit: Circuit, *, noisy: bool) -> str:
    """Return the text of all parts but the sources of the strain; `noisy` op-amps have noise."""
    stages = [
        line
        for stage in circuit.amplifiers
        for line in amplifier_lines(stage, AMPLIFIERS[stage.kind].expression)
    ]
    parts = [
        *(f"X{c.name} {c.noninverting} {c.inverting} {c.output} {c.model}" for c in circuit.opamps),
        *(f"R{r.name} {r.a} {r.b} {r.ohms!r}" for r in circuit.resistors),
        *(f"C{c.name} {c.a} {c.b} {c.farads!r}" for c in circuit.capacitors),
        *(f"Q{q.name} {q.collector} {q.base} {q.emitter} {q.model}" for q in circuit.transistors),
    ]
    used = {cell.model for cell in circuit.opamps}
    driven = {cell.model for cell in circuit.opamps if cell.noninverting != GROUND}
    cells = "\n".join(
        model.imported.text(model.name)
        if model.imported is not None
        else str(opamp_subcircuit(model, model.name not in driven, circuit.supply, noisy))
        for model in circuit.models.values()
        if model.name in used
    )
    biases = [f"{b.card} {b.node} {GROUND} {b.volts!r}" for b in circuit.constant_voltages]
    cards = [model_card(model) for model in circuit.transistor_models.values()]
    matrices = matrix_lines(circuit.matrices)
    head = [".title taction board", *header_lines(circuit), *cards, *stages, *matrices, ""]
    return "\n".join(head) + cells + "\n".join([*parts, *biases, ""])


def amplifier_lines(stage: SignalAmplifier, expression: str) -> tuple[str, ...]:
    """Return the lines of one stage, ``V(output) = -u_scale g(V(input) / v_scale)``.

    A stage is a ``B`` card with the `expression` of g. ngspice cuts a number in it to 11 digits, so
    a `v_scale` other than 1 V is the gain of a card ``Ex{name}`` before it (node ``{name}_x``), and
    a `u_scale` other than 1 V that of a card ``Eu{name}`` after it (node ``{name}_g``).
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


NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
SCENE_NAME = re.compile(r"[A-Za-z0-9_.-]*")
# S and A: ngspice's default conductance, at which a vendor's model converges and was measured, and
# the tolerance of its bench; a board's own tolerances are below the rounding of its junctions.
VENDORS_GMIN, VENDORS_AMPS = 1e-12, 1e-15


def check_circuit(circuit: Circuit) -> None:
    """Raise ValueError for a name or a value that must not reach a simulator.

    No circuit that was made from a scene has one. ngspice runs a line after a newline in a name as
    a command, and reads 1/0 as 1e32.
    """
    if not SCENE_NAME.fullmatch(circuit.name):
        raise ValueError(f"{circuit.name!r} is not a valid name of a scene")
    for item in circuit.omissions:
        if not (item.what + item.why).isprintable():
            raise ValueError(f"{item!r} has characters that a comment line cannot hold")
    names = [circuit.amplifier, circuit.topology]
    for kind in PLACES.values():
        parts = () if kind == "matrices" else getattr(circuit, kind)
        own = [part.name for part in parts]
        for each in fields(parts[0]) if parts else ():
            values = [getattr(part, each.name) for part in parts]
            if isinstance(values[0], str):
                names += values
            elif isinstance(values[0], float):
                for name, value in zip(own, values, strict=True):
                    _check_value(name, abs(value) if kind in ("currents", "voltages") else value)
        if len(set(own)) != len(own):
            twice = next(name for name in own if own.count(name) > 1)
            raise ValueError(f"two {kind} have the name {twice!r}")
    for matrix in circuit.matrices:
        names += [matrix.name, *matrix.sinks, *matrix.plus, *filter(None, matrix.minus)]
        if not np.all(matrix.ohms > 0):
            raise ValueError(f"matrix {matrix.name} has a resistance that is not above zero")
    _check_names(names)
    _check_value("the absolute temperature", circuit.temperature + ZERO_CELSIUS)


def check_request(analysis: Analysis, saved: Sequence[str], solver: str) -> None:
    """Raise ValueError for a node, option or time that no deck may contain."""
    _check_names((*saved, solver))
    if isinstance(analysis, NoiseAnalysis):
        if len(saved) != 1:
            raise ValueError("a noise analysis has one node, since ngspice does not name the nodes")
        for band in analysis.bands:
            for name in ("start", "steps", "density"):
                _check_value(name, getattr(band, name))
    if isinstance(analysis, Transient):
        for name in ("stop", "max_step", "truncation", "begin"):
            _check_value(name, getattr(analysis, name))
        _check_value("charge", 1.0 if analysis.charge is None else analysis.charge)
        # a dot separates a subcircuit from its node, as in "xv_1.p1"
        _check_names(part for node in analysis.voltages for part in node.split("."))
        for node, volts in analysis.voltages.items():
            if not math.isfinite(volts):
                raise ValueError(f"the initial voltage of {node} is {volts!r}; it must be finite")


def tolerances(circuit: Circuit, relative: float) -> SimulatorTolerances:
    """Return tolerances that follow from the scales of `circuit`, for 1e-12 S as for 1e-3 S.

    The step control takes the tolerance of currents for the error of a capacitor's current, so it
    follows from the strain currents.
    """
    volts, siemens = circuit.value("U0"), circuit.value("G0")
    each = (
        siemens * source.volts if isinstance(source, VoltageSource) else source.amps
        for source in circuit.strains
    )
    amps = max(map(abs, each), default=0.0) or siemens * volts
    return SimulatorTolerances(
        relative=relative,
        current=max(1e-3 * relative * amps, VENDORS_AMPS * circuit.has_imported),
        voltage=1e-3 * relative * volts,
        charge=1e-3 * relative * circuit.charged_capacitance * volts,
        gmin=1e-6 * relative * siemens,
        junction=VENDORS_GMIN if circuit.has_imported else 1e-6 * relative * siemens,
    )


def _check_names(names: Iterable[str]) -> None:
    for name in dict.fromkeys(names):  # each node occurs in several parts
        if name != GROUND and not NAME.fullmatch(name):
            raise ValueError(f"{name!r} is not a valid name in a deck")


def _check_value(name: str, value: float) -> None:
    if not 0.0 < value < math.inf:
        raise ValueError(f"{name} has the value {value!r}; it must be finite and above zero")
