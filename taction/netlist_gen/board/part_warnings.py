"""The limits of real parts, and warnings about parts of a board that break them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.board.circuit import GROUND, Circuit, Role, joined_resistors
from taction.system.quantities import show

LEAST_OHMS, MOST_OHMS = 10.0, 10e6  # of a resistor that a proposal may have
SAME = 1.0 + 1e-9  # ratio of values that count as equal
ROUNDING = 1.05  # the most that E24 moves a value by


@dataclass(frozen=True, slots=True)
class PartLimits:
    """The limits of the parts of one kind, with remedies; `docs/parts.md` has the reasons."""

    kind: str
    unit: str
    least: float
    most: float
    more: str  # remedy where a value is below `least`
    less: str = ""  # where one is above `most`
    roles: tuple[str, ...] = ()  # of resistors
    label: str = ""  # in the place of value and unit

    def beyond(self) -> Iterator[tuple[str, float, str]]:
        """Yield what breaks each limit, such as ``"above 10 Mohm"``, its value, and the remedy."""
        ends = (("above", self.most, self.less), ("below", self.least, self.more))
        for way, value, remedy in ends:
            if remedy:
                yield f"{way} {self.label or show(value, self.unit)}", value, remedy


def _ohms(kind: str, more: str, less: str, *roles: str) -> PartLimits:
    return PartLimits(kind, "ohm", LEAST_OHMS, MOST_OHMS, more, less, roles)


_UNIT, _VOLTS = "design.unit_conductance", "design.unit_voltage"
_SMALLER, _LARGER = f"a smaller {_UNIT}", f"a larger {_UNIT}"
_BOTH = f"a smaller {_VOLTS} or {_UNIT}"
_PRUNE = "or design.prune, which leaves out small entries of T"
_DIVIDER = "a larger design.antilog.divider_resistance or emitter_resistance"
_R = "a larger design.resistance or a smaller lambda"
_SPREAD = "a larger design.capacitance, or a layout with a smaller design.stray_capacitance"
_MATRIX = "matrix resistors"
LIMITS = (
    _ohms(_MATRIX, _SMALLER, f"{_LARGER}, {_PRUNE}"),
    _ohms("resistors R", _R, "a smaller design.resistance",
          Role.SIGNAL_RESISTOR, Role.BIAS_RESISTOR),
    _ohms("resistors s", "a larger design.gain", "a smaller design.gain", Role.CONSTRAINT_RESISTOR),
    _ohms("inverter resistors", "a larger design.inverter_resistance",
          "a smaller design.inverter_resistance", Role.INVERTER_RESISTOR, Role.SUM),
    _ohms("resistors 1/gf", "a smaller design.feedback_conductance",
          "a larger design.feedback_conductance", Role.OUTPUT_CONDUCTANCE),
    _ohms("resistors of the rows that add lambda", f"{_SMALLER} or lambda",
          f"{_LARGER} or lambda", Role.REGULARISING),
    _ohms("resistors of the offset column", _SMALLER, _LARGER, Role.OFFSET),
    _ohms("strain resistors", _SMALLER, _LARGER, Role.STRAIN_RESISTOR),
    _ohms("resistors of the antilog stages", _DIVIDER,
          "a larger design.antilog.reference_current", Role.STAGE),
    # The least capacitance is that of the board's strays.
    PartLimits("capacitors C", "F", 0.0, math.inf, _SPREAD, label="the stray capacitance"),
    # A small strain beside a large one needs no source that is accurate.
    PartLimits("largest strain currents", "A", 10e-9, math.inf, f"{_LARGER} or {_VOLTS}"),
    PartLimits("strain currents", "A", 0.0, 10e-3, "", f"{_SMALLER} or {_VOLTS}"),
    PartLimits("supplies of op-amps", "V", 2.25, 18.0, "a larger design.supply",
               "a smaller design.supply"),
    PartLimits("output currents of op-amps at rest", "A", 0.0, 20e-3, "", _BOTH),
    PartLimits("common-mode voltages at rest", "", 0.0, 0.8, "",
               f"a smaller {_VOLTS} or a larger design.supply", label="80 % of the supply"),
)  # fmt: skip
"""What proposals keep, and what `verify` warns of. An op-amp with an output current or a supply of
its own has these in the place of the table's."""
Rest = Callable[[str], float]  # the voltage of a node at rest, V


def part_warnings(circuit: Circuit, rest: Rest | None = None) -> tuple[str, ...]:
    """Return a warning for each limit that parts break; `rest`: voltages of nodes, V."""
    return tuple(broken.text for broken in broken_limits(circuit, rest).values())


def stuck_cells(circuit: Circuit) -> tuple[str, ...]:
    """Return a warning that the check of the rest counts no stuck cells, if there may be some."""
    counts = [
        (int(np.isfinite(matrix.ohms).sum()), matrix.device.stuck)
        for matrix in circuit.matrices
        if matrix.device is not None and matrix.device.stuck
    ]
    if not counts:
        return ()
    stuck = math.fsum(k * share for k, share in counts)
    none = math.prod((1.0 - share) ** k for k, share in counts)
    text = (
        f"stuck cells: {stuck:.3g} of {sum(k for k, _ in counts)} on average, one or more in"
        f" {100.0 * (1.0 - none):.3g} % of the boards; steady_state does not count them,"
        " 'taction yield montecarlo' does"
    )
    return (text,)


@dataclass(frozen=True, slots=True)
class BrokenLimit:
    """A warning, and the factor by which the extreme part is beyond the limit, above 1."""

    text: str
    factor: float


@dataclass(frozen=True, slots=True)
class AcceptedParts:
    """What a proposal may have beyond the limits: what the scene itself has, but for rounding."""

    own: Mapping[str, BrokenLimit]  # what the scene has, by the kind of part and the limit

    def refused(self, broken: Mapping[str, BrokenLimit]) -> str:
        """Return which parts are beyond a limit, and farther than those of the scene."""
        return ", ".join(
            name
            for name, limit in broken.items()
            if name not in self.own or limit.factor > ROUNDING * self.own[name].factor
        )


def broken_limits(circuit: Circuit, rest: Rest | None = None) -> dict[str, BrokenLimit]:
    """Return the warnings by the kind of part and the limit that it breaks."""
    stray = max((part.farads for part in circuit.parts_of(Role.STRAY)), default=0.0)
    known, found = _values(circuit, rest), dict[str, BrokenLimit]()
    for limits in LIMITS:
        own = replace(limits, least=stray) if limits.unit == "F" else limits
        values = {n: v for n, v in known.get(own.kind, {}).items() if 0.0 < v < math.inf}
        for beyond, limit, remedy in own.beyond():
            above = beyond.startswith("above")
            factors = {n: v / limit if above else limit / v for n, v in values.items()}
            count = sum(factor > SAME for factor in factors.values())
            if not count:
                continue
            worst, given = max(factors, key=factors.__getitem__), f" of {show(limit, 'F')}"
            text = (
                f"{count} of {len(values)} {own.kind} are {beyond}{given * (own.unit == 'F')},"
                f" {'up' if above else 'down'} to {show(values[worst], own.unit)} ({worst});"
                f" remedy: {remedy}"
            )
            found[f"{own.kind} {beyond}"] = BrokenLimit(text, factors[worst])
    return found


def _values(circuit: Circuit, rest: Rest | None) -> dict[str, dict[str, float]]:
    """Return the values of the parts of each kind, by their names."""
    places = ((m, each) for m in circuit.matrices for each in m.places())
    found = {_MATRIX: {name: float(m.ohms[k, n]) for m, (name, k, n) in places}}
    for limits in (each for each in LIMITS if each.roles):
        names = {name for role in limits.roles for name in circuit.named(role)}
        parts = (part for part in circuit.resistors if part.card in names)
        found[limits.kind] = {part.card: part.ohms for part in parts}
    signal = circuit.parts_of(Role.SIGNAL_CAPACITOR)
    found["capacitors C"] = {part.card: part.farads for part in signal}
    amps = {source.card: abs(source.amps) for source in circuit.currents if source.amps}
    largest = max(amps, key=amps.__getitem__, default="")
    found["largest strain currents"] = {largest: amps[largest]} if amps else {}
    volts = {source.node: source for source in circuit.voltages if source.switched}
    for part in circuit.parts_of(Role.STRAIN_RESISTOR):
        if (source := volts.get(part.a)) is not None:
            amps[source.card] = abs(source.volts) / part.ohms
    found["strain currents"] = amps
    models = circuit.models
    own = {name for name, model in models.items() if math.isinf(model.most_supply)}
    supplied = [c.card for c in circuit.opamps if c.model in own and models[c.model].is_limited]
    found["supplies of op-amps"] = dict.fromkeys(supplied, circuit.supply)
    if rest is not None:
        found["output currents of op-amps at rest"] = _output_currents(circuit, rest)
        common = {c.card: c.noninverting for c in circuit.opamps if c.noninverting != GROUND}
        shares = {name: abs(rest(node)) / circuit.supply for name, node in common.items()}
        found["common-mode voltages at rest"] = shares
    return found


def _output_currents(circuit: Circuit, rest: Rest) -> dict[str, float]:
    """Return the currents of op-amps without a figure of their own, which has a check, A."""
    models = circuit.models
    limited = {name for name, model in models.items() if model.has_largest_current}
    judged = {cell.output: cell.card for cell in circuit.opamps if cell.model not in limited}
    amps = dict.fromkeys(judged.values(), 0.0)
    for a, b, ohms in joined_resistors(circuit) if judged else ():
        for near, far in ((a, b), (b, a)):
            if near in judged:
                amps[judged[near]] += (rest(near) - rest(far)) / ohms
    return {name: abs(value) for name, value in amps.items()}
