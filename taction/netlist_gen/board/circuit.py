"""`Circuit`: the board, its parts with values and nodes, and what its topology states about them.

A topology states which parts do what, by their names in the deck (`Role`), the numbers of the
design (`Fact`), and the keys of a scene that scale parts (`Knob`). Node ``"0"`` is ground.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from taction.netlist_gen.board import parts as boards
from taction.spice_models.branches import CONTROLS, Branch
from taction.spice_models.opamp import OpAmp
from taction.spice_models.transistor import NOMINAL, Transistor
from taction.system.array_types import Floats
from taction.system.quantities import quantity, sizes
from taction.system.results import Result

GROUND = "0"
SMALL_CAPACITANCE = 1e-12  # F
ROUNDING = 1e-12  # of an offset: an entry of T below it is zero
SCALED = {"resistors": "ohms", "capacitors": "farads", "branches": "value", "matrices": "ohms"}


class Role:
    """What parts of a board do; a topology may have roles of its own besides."""

    SIGNAL_CAPACITOR = "capacitor C of a signal node"
    SIGNAL_RESISTOR = "resistor R of a signal node"
    BIAS_RESISTOR = "resistor of a bias current"
    CONSTRAINT_RESISTOR = "resistor s of a constraint amplifier"
    RIDGE_RESISTOR = "resistor from u that removes a share of the ridge term"
    INVERTER_RESISTOR = "resistor of an inverter"
    STRAIN_RESISTOR = "resistor 1/G0 from a strain voltage"
    STAGE = "part of an antilog stage"
    STRAY = "stray capacitance"
    OUTPUT_CONDUCTANCE = "resistor 1/gf of a stage that turns a current into its voltage"
    REGULARISING = "resistor 1/(sqrt(lambda) G0) of a row that adds lambda"
    PADDING = "resistor to ground that loads both inputs of an op-amp alike"
    OFFSET = "resistor of an offset column"
    SUM = "resistor of an inverter of a sum"
    UNIT = "resistor in proportion to 1/G0"
    FORWARD = "matrix from the signal amplifiers to the constraint nodes"
    FEEDBACK = "matrix from the constraint amplifiers to the signal nodes"


@dataclass(frozen=True, slots=True)
class Fact:
    """A number of the design."""

    name: str  # "C"; its key in `Circuit.facts`
    value: float  # SI base unit
    unit: str  # empty for a plain number
    symbol: str  # as the deck's header and the reports write it
    title: str  # what it is, in some words
    key: str  # the key of the scene that sets it, dotted
    sentence: str = ""  # its definition, beyond the title
    role: str = ""  # the parts with this value; empty: a scale

    @property
    def text(self) -> str:
        """The value with its unit, as a person reads it."""
        return quantity(self.value, self.unit) if self.unit else f"{self.value:.4g}"


# Numbers that every board has: unit, symbol, title, key, sentence and role of each.
_COMMON: Mapping[str, Any] = {
    "G0": ("S", "G0", "unit conductance", "design.unit_conductance",
           "T = 1 is this conductance: R_kn = 1/(|T_kn| G0)"),
    "U0": ("V", "U0", "unit voltage", "design.unit_voltage",
           "u = 1 is this voltage at an output"),
    "R": ("ohm", "R", "resistor of every signal node", "design.resistance", "",
          Role.SIGNAL_RESISTOR),
    "C": ("F", "C", "capacitor of every signal node", "design.capacitance", "",
          Role.SIGNAL_CAPACITOR),
    "gain": ("ohm", "s", "gain of the constraint amplifiers", "design.gain", "",
             Role.CONSTRAINT_RESISTOR),
    "lambda": ("", "lambda", "regularisation parameter", "design.lambda"),
    "Ve": ("V", "Ve", "slope of the signal amplifiers", "design.exponential_slope",
           "u = U0 g(v/Ve)"),
    "gf": ("S", "gf", "feedback conductance of every first stage", "design.feedback_conductance",
           "", Role.OUTPUT_CONDUCTANCE),
}  # fmt: skip
NEEDED = ("G0", "U0", "lambda")  # facts of every board that is verified


def common_facts(**values: float) -> dict[str, Fact]:
    """Return the facts of a board by their names, from those of `_COMMON` that are given."""
    return {
        name: Fact(name, values[name], *texts) for name, texts in _COMMON.items() if name in values
    }


@dataclass(frozen=True, slots=True)
class Knob:
    """A key of the scene that can be moved; parts are proportional to `power` of its value."""

    name: str  # of the fact that has its value: "C"
    key: str  # dotted: "design.capacitance"
    role: str = ""  # of these parts; empty if more changes than values of parts
    # other facts that change with a power of it, while R keeps its value
    moves: Mapping[str, float] = field(default_factory=dict)
    # the direction in which a stable board becomes unstable; empty without a margin
    margin: Literal["", "smaller", "larger"] = ""
    words: str = ""  # the subject of a sentence: "the gain"
    series: str = ""  # the key of the series that rounds these parts alone, if there is one
    power: float = 1.0  # -1 for a conductance


def common_knobs(*, linear: bool) -> tuple[Knob, ...]:
    """Return the knobs of a board with the common facts, with linear amplifiers or with others."""
    C, series = "design.capacitance", "design.capacitor_series"
    gain, role = "design.gain", Role.CONSTRAINT_RESISTOR
    return (
        Knob("C", C, Role.SIGNAL_CAPACITOR, {}, "smaller", "C", series),
        Knob("gain", gain, role, {"lambda": -1.0}, "larger", "the gain"),
        Knob("G0", "design.unit_conductance", moves={"lambda": -2.0}),
        Knob("U0", "design.unit_voltage", moves={} if linear else {"lambda": -1.0}),
    )


@dataclass(frozen=True, slots=True)
class Output:
    """The output of one channel: ``u = sign * V(node)``, V."""

    node: str
    sign: float


@dataclass(frozen=True, slots=True)
class Omission:
    """A part that the board omits because the scene does not need it."""

    what: str
    why: str


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Circuit(Result):
    """A whole board."""

    VIEW = "taction.verification.report.views.board_view:view"
    CARD = "Circuit"

    name: str
    amplifier: str
    topology: str
    facts: Mapping[str, Fact]  # by name
    models: dict[str, OpAmp] = field(default_factory=dict)  # op-amp types by name
    opamps: tuple[boards.OpAmpCell, ...] = ()
    amplifiers: tuple[boards.SignalAmplifier, ...] = ()
    resistors: tuple[boards.Resistor, ...] = ()
    matrices: tuple[boards.ResistorMatrix, ...] = ()
    capacitors: tuple[boards.Capacitor, ...] = ()
    currents: tuple[boards.CurrentSource, ...] = ()
    voltages: tuple[boards.VoltageSource, ...] = ()
    signal_nodes: tuple[str, ...] = ()  # nodes of v_n, one per channel
    constraint_nodes: tuple[str, ...] = ()  # nodes of w_k, one per sensor
    outputs: tuple[Output, ...] = ()  # u_n
    omissions: tuple[Omission, ...] = ()
    supply: float = 15.0  # both supply voltages of the op-amps, ±V
    noises: tuple[boards.NoiseCurrent, ...] = ()  # of the sensors; for noise analyses only
    transistors: tuple[boards.TransistorCell, ...] = ()
    transistor_models: dict[str, Transistor] = field(default_factory=dict)  # types by name
    temperature: float = NOMINAL  # of the transistors, degrees C
    branches: tuple[Branch, ...] = ()  # of a deck: its linear parts that no topology has
    # Names in the deck, by role; with the facts, these follow from the code of the topology.
    roles: Mapping[str, Collection[str]] = field(default_factory=dict)
    knobs: tuple[Knob, ...] = ()

    def value(self, name: str) -> float:
        """Return the number of a fact; ValueError if the topology does not state it."""
        if name not in self.facts:
            raise ValueError(f"topology {self.topology!r} states no fact {name!r}")
        return self.facts[name].value

    def number(self, name: str) -> float | None:
        """Return the number of a fact; None where the topology does not state it."""
        return self.facts[name].value if name in self.facts else None

    def named(self, role: str) -> Collection[str]:
        """Return the names in the deck of the parts with a role."""
        return self.roles.get(role, ())

    def parts_of(self, role: str) -> tuple[Any, ...]:
        """Return the resistors and capacitors with a role, in the order of the board."""
        names = self.named(role)
        return tuple(p for p in (*self.resistors, *self.capacitors) if p.card in names)

    @property
    def real_capacitors(self) -> tuple[boards.Capacitor, ...]:
        """The capacitors that are parts: all but stray capacitances."""
        strays = self.named(Role.STRAY)
        return tuple(part for part in self.capacitors if part.card not in strays)

    @property
    def charged_capacitance(self) -> float:
        """C, F, or without it the largest capacitance at an input of an op-amp, or 1 pF."""
        if "C" in self.facts:
            return self.value("C")
        strays = [part.farads for part in self.capacitors]
        inputs = [model.input_capacitance for model in self.models.values()]
        return max([*strays, *inputs], default=0.0) or SMALL_CAPACITANCE

    @property
    def forward(self) -> boards.ResistorMatrix:
        """The matrix from the signal amplifiers to the constraint nodes."""
        return self._matrix(Role.FORWARD)

    @property
    def feedback(self) -> boards.ResistorMatrix:
        """The matrix from the constraint amplifiers to the signal nodes."""
        return self._matrix(Role.FEEDBACK)

    def _matrix(self, role: str) -> boards.ResistorMatrix:
        names = self.named(role)
        for matrix in self.matrices:
            if matrix.name in names:
                return matrix
        raise ValueError(f"topology {self.topology!r} states no {role}")

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of sensors and channels: the shape (M, N) of T."""
        rows, columns = next(iter(self.matrices)).ohms.shape
        return rows, columns

    @property
    def forward_ohms(self) -> Floats:
        """Resistors of T towards the constraint nodes, ohm, (M, N); infinite without one."""
        names = self.named(Role.FORWARD)
        parts = [matrix.ohms for matrix in self.matrices if matrix.name in names]
        return np.asarray(np.minimum.reduce(parts))

    @property
    def realised(self) -> Floats:
        """T (M, N) as the resistors have it, with their rounding, less an offset column."""
        names, siemens = self.named(Role.FORWARD), self.value("G0")
        T = np.zeros(self.shape)
        for matrix in self.matrices:
            if matrix.name in names:
                sign = np.where(matrix.negative, -1.0, 1.0) * (-1.0 if matrix.opposite else 1.0)
                T = T + sign / (matrix.ohms * siemens)
        offset = self.number("offset")
        if offset is None:
            return T
        T = T - offset
        return np.where(np.abs(T) < ROUNDING * offset, 0.0, T)

    def knob(self, name: str) -> Knob:
        """Return the knob of a fact, or of a key of the scene; ValueError without one."""
        for knob in self.knobs:
            if name in (knob.name, knob.key):
                return knob
        raise ValueError(f"topology {self.topology!r} has no knob {name!r}")

    def scales_arrays(self, knob: Knob) -> bool:
        """Tell whether a knob scales all resistors of an array."""
        names = self.named(knob.role)
        return any(matrix.name in names for matrix in self.matrices)

    def turned(self, name: str, value: float) -> Circuit:
        """Return the board with a knob at another value, SI base unit; R keeps its value.

        ValueError: the knob does not scale parts, so the board needs another synthesis.
        """
        knob = self.knob(name)
        if not knob.role:
            raise ValueError(f"{knob.key} does not scale parts of the board")
        names, ratio = self.named(knob.role), value / self.value(knob.name)
        factor = ratio if knob.power == 1.0 else ratio**knob.power
        changed = {knob.name: value}
        changed |= {other: self.value(other) * ratio**by for other, by in knob.moves.items()}

        board = self.scaled(lambda part: factor if getattr(part, "card", part.name) in names else 1)
        facts = {
            name: replace(fact, value=changed.get(name, fact.value))
            for name, fact in self.facts.items()
        }
        return replace(board, facts=facts)

    def scaled(self, factor: Callable[[Any], Floats | float]) -> Circuit:
        """Return the board with the value of each part times a `factor`; a matrix may have many."""

        def changed(part: Any, quantity: str) -> Any:
            times = factor(part)
            same = isinstance(times, float | int) and times == 1.0
            return part if same else replace(part, **{quantity: getattr(part, quantity) * times})

        parts: dict[str, Any] = {
            kind: tuple(changed(part, quantity) for part in getattr(self, kind))
            for kind, quantity in SCALED.items()
        }
        return replace(self, **parts)

    @property
    def is_small_signal(self) -> bool:
        """Whether no op-amp is at the large-signal level."""
        return not any(model.large_signal for model in self.models.values())

    @property
    def is_linear(self) -> bool:
        """Whether no signal amplifier is nonlinear, and no op-amp at the large-signal level."""
        return not self.has_nonlinear_amplifiers and self.is_small_signal

    @property
    def has_nonlinear_amplifiers(self) -> bool:
        """Whether signal amplifiers are behavioural, or have transistors."""
        return bool(self.amplifiers or self.transistors)

    @property
    def has_imported(self) -> bool:
        """Whether op-amps are a vendor's macromodel."""
        return any(model.imported is not None for model in self.models.values())

    @property
    def has_constant_sources(self) -> bool:
        """Whether the board without strain may rest at other voltages than zero."""
        errors = any(model.input_errors for model in self.models.values())
        nonlinear = self.has_nonlinear_amplifiers
        return bool(self.constant_voltages or nonlinear or errors or self.has_imported)

    @property
    def constant_voltages(self) -> tuple[boards.VoltageSource, ...]:
        """The voltages that are on at all times."""
        return tuple(source for source in self.voltages if not source.switched)

    @property
    def strains(self) -> tuple[boards.CurrentSource | boards.VoltageSource, ...]:
        """The sources that are switched on at t = 0."""
        return *self.currents, *(source for source in self.voltages if source.switched)

    @property
    def without_strain(self) -> Circuit:
        """The board with no strain: its resistors from strain voltages end at ground."""
        nodes = {source.node for source in self.strains if isinstance(source, boards.VoltageSource)}
        resistors = tuple(replace(p, a=GROUND) if p.a in nodes else p for p in self.resistors)
        return replace(self, currents=(), voltages=self.constant_voltages, resistors=resistors)

    def __repr__(self) -> str:
        size = sizes(len(self.outputs), len(self.constraint_nodes))
        parts = (size, self.topology, f"{self.amplifier} amplifiers", self.values)
        words = ", ".join(filter(None, (*parts, f"op-amps {', '.join(self.models)}")))
        return f"Circuit({self.name!r}, {words})"

    @property
    def values(self) -> str:
        """The values of the knobs with a margin, in words."""
        moved = (self.facts[knob.name] for knob in self.knobs if knob.margin)
        return ", ".join(f"{fact.name} = {fact.text}" for fact in moved)


def with_parts(circuit: Circuit, parts: Iterable[Branch]) -> Circuit:
    """Return a circuit with further linear parts."""
    every = [*parts]
    resistors = (boards.Resistor(p.name, p.a, p.b, p.value) for p in every if p.letter == "R")
    capacitors = (boards.Capacitor(p.name, p.a, p.b, p.value) for p in every if p.letter == "C")
    return replace(
        circuit,
        resistors=(*circuit.resistors, *resistors),
        capacitors=(*circuit.capacitors, *capacitors),
        branches=(*circuit.branches, *(part for part in every if part.letter not in "RC")),
    )


def with_linear_models(circuit: Circuit) -> Circuit:
    """Return a circuit with linear parts in the place of imported op-amps that have them."""
    parts, own = list[Branch](), list[boards.OpAmpCell]()
    for cell in circuit.opamps:
        imported = circuit.models[cell.model].imported
        if imported is None or imported.linear is None:
            own.append(cell)
        else:
            parts += [_placed(part, cell) for part in imported.linear.parts]
    return replace(with_parts(circuit, parts), opamps=tuple(own))


def _placed(part: Branch, cell: boards.OpAmpCell) -> Branch:
    """Return a part of one op-amp of the board, with nodes and cards of its own."""
    ports = {GROUND: GROUND, "inp": cell.noninverting, "inn": cell.inverting, "out": cell.output}

    def node(name: str) -> str:
        return ports.get(name) or f"x{cell.name}.{name}"

    def card(name: str) -> str:
        return f"{name}.x{cell.name}"

    end = card if part.letter == "K" else node
    control = card if CONTROLS.get(part.letter) == 1 else node
    ends = end(part.a), end(part.b)
    return Branch(part.letter, card(part.name), *ends, part.value, (*map(control, part.control),))


def port_matrices(circuit: Circuit) -> tuple[boards.ResistorMatrix, ...]:
    """Return the matrices of a board as they are seen from their ports; see `at_ports`."""
    return tuple(each for matrix in circuit.matrices for each in boards.at_ports(matrix))


def joined_resistors(circuit: Circuit) -> Iterator[tuple[str, str, float]]:
    """Yield both nodes and ohms of every resistor, of wired arrays those between ports."""
    for part in circuit.resistors:
        yield part.a, part.b, part.ohms
    for matrix in port_matrices(circuit):
        for _, _, source, sink, ohms in matrix.elements():
            yield source, sink, ohms


def without_wires(circuit: Circuit) -> Circuit:
    """Return `circuit` as it would be with ideal wires: without them and their compensation."""
    if all(each.wires is None for each in circuit.matrices):
        return circuit
    scales = [1.0 if m.wires is None or m.wires.scale is None else m.wires.scale
              for m in circuit.matrices]  # fmt: skip
    pairs = zip(circuit.matrices, scales, strict=True)
    straight = tuple(replace(m, wires=None, ohms=m.ohms / scale) for m, scale in pairs)
    return replace(circuit, matrices=straight)
