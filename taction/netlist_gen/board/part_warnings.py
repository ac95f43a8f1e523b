"""The limits of real parts, and warnings about parts of a board that break them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.board.circuit import GROUND, Circuit, Role
from taction.netlist_gen.board.wired_arrays import joined_resistors
from taction.system.array_types import Floats
from taction.system.quantities import show

LEAST_OHMS, MOST_OHMS = 10.0, 10e6  # of a resistor that a proposal may have
SAME = 1.0 + 1e-9  # ratio of values that count as equal
ROUNDING = 1.05  # the most that E24 moves a value by


@dataclass(frozen=True, slots=True)
class PartLimit:
    """A limit of the parts of one kind; `docs/parts.md` has the reasons."""

    kind: str
    way: str  # "above" or "below": the values beyond it
    value: float
    unit: str
    remedy: str
    label: str = ""  # in the place of value and unit

    @property
    def beyond(self) -> str:
        """What breaks it, such as ``"above 10 Mohm"``."""
        return f"{self.way} {self.label or show(self.value, self.unit)}"


_UNIT, _VOLTS = "design.unit_conductance", "design.unit_voltage"
_MATRIX = "matrix resistors"
_RESISTORS: tuple[tuple[str, tuple[str, ...], str, str], ...] = (
    (
        _MATRIX,
        (),
        f"a larger {_UNIT}, or design.prune, which leaves out small entries of T",
        f"a smaller {_UNIT}",
    ),
    (
        "resistors R",
        (Role.SIGNAL_RESISTOR, Role.BIAS_RESISTOR),
        "a smaller design.resistance",
        "a larger design.resistance or a smaller lambda",
    ),
    ("resistors s", (Role.CONSTRAINT_RESISTOR,), "a smaller design.gain", "a larger design.gain"),
    (
        "inverter resistors",
        (Role.INVERTER_RESISTOR, Role.SUM),
        "a smaller design.inverter_resistance",
        "a larger design.inverter_resistance",
    ),
    (
        "resistors 1/gf",
        (Role.OUTPUT_CONDUCTANCE,),
        "a larger design.feedback_conductance",
        "a smaller design.feedback_conductance",
    ),
    (
        "resistors of the rows that add lambda",
        (Role.REGULARISING,),
        f"a larger {_UNIT} or lambda",
        f"a smaller {_UNIT} or lambda",
    ),
    ("resistors of the offset column", (Role.OFFSET,), f"a larger {_UNIT}", f"a smaller {_UNIT}"),
    ("strain resistors", (Role.STRAIN_RESISTOR,), f"a larger {_UNIT}", f"a smaller {_UNIT}"),
    (
        "resistors of the antilog stages",
        (Role.STAGE,),
        "a larger design.antilog.reference_current",
        "a larger design.antilog.divider_resistance or emitter_resistance",
    ),
)
"""Each kind of resistor with its roles, and the remedies for too many ohms and for too few."""
LIMITS = (
    *(
        limit
        for kind, _, less, more in _RESISTORS
        for limit in (
            PartLimit(kind, "above", MOST_OHMS, "ohm", less),
            PartLimit(kind, "below", LEAST_OHMS, "ohm", more),
        )
    ),
    PartLimit(
        "capacitors C",
        "below",
        0.0,  # that of the board
        "F",
        "a larger design.capacitance, or a layout with a smaller design.stray_capacitance",
        "the stray capacitance",
    ),
    # A small strain beside a large one needs no source that is accurate.
    PartLimit("largest strain currents", "below", 10e-9, "A", f"a larger {_UNIT} or {_VOLTS}"),
    PartLimit("strain currents", "above", 10e-3, "A", f"a smaller {_UNIT} or {_VOLTS}"),
    PartLimit("supplies of op-amps", "above", 18.0, "V", "a smaller design.supply"),
    PartLimit("supplies of op-amps", "below", 2.25, "V", "a larger design.supply"),
    PartLimit(
        "output currents of op-amps at rest", "above", 20e-3, "A", f"a smaller {_VOLTS} or {_UNIT}"
    ),
    PartLimit(
        "common-mode voltages at rest",
        "above",
        0.8,
        "",
        f"a smaller {_VOLTS} or a larger design.supply",
        "80 % of the supply",
    ),
)
"""What proposals keep, and what `verify` warns of. An op-amp with an output current or a supply of
its own has these in the place of the table's."""
Rest = Callable[[str], float]  # the voltage of a node at rest, V
_Values = tuple[Floats, Callable[[int], str]]  # infinite where there is no part; names by place


def part_warnings(circuit: Circuit, rest: Rest | None = None) -> tuple[str, ...]:
    """Return one warning for each kind of part and limit that parts of `circuit` break.

    Each has the number of parts, the extreme value with the name of its part, and a remedy.

    Parameters
    ----------
    rest : callable, optional
        The voltages of the nodes at rest, V; without it currents and common modes are not judged.

    Examples
    --------
    >>> import taction
    >>> scene = taction.load_scene("scenes/paper-breadboard.toml")
    >>> print(part_warnings(taction.synthesise(scene))[0][:65])
    60 of 74 matrix resistors are above 10 Mohm, up to 247.3 Mohm (Rf
    """
    return tuple(broken.text for broken in broken_limits(circuit, rest).values())


def stuck_cells(circuit: Circuit) -> tuple[str, ...]:
    """Return a warning that the check of the rest counts no stuck cells, if there may be some."""
    arrays = [m for m in circuit.matrices if m.device is not None and m.device.stuck]
    counts = [int(np.isfinite(matrix.ohms).sum()) for matrix in arrays]
    shares = [each.device.stuck for each in arrays if each.device is not None]
    if not counts:
        return ()
    stuck = math.fsum(k * share for k, share in zip(counts, shares, strict=True))
    none = math.prod((1.0 - share) ** k for k, share in zip(counts, shares, strict=True))
    text = (
        f"stuck cells: {stuck:.3g} of {sum(counts)} on average, one or more in"
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
    any_part: bool = False  # whether any part may be proposed

    def refused(self, broken: Mapping[str, BrokenLimit]) -> str:
        """Return which parts are beyond a limit, and farther than those of the scene."""
        return ", ".join(
            name
            for name, limit in broken.items()
            if not self.any_part
            and (name not in self.own or limit.factor > ROUNDING * self.own[name].factor)
        )


ANY_PART = AcceptedParts({}, any_part=True)


def broken_limits(circuit: Circuit, rest: Rest | None = None) -> dict[str, BrokenLimit]:
    """Return the warnings by the kind of part and the limit that it breaks."""
    stray = max((part.farads for part in circuit.capacitors_of(Role.STRAY)), default=0.0)
    values, found = dict(_values(circuit, rest)), dict[str, BrokenLimit]()
    for limit in LIMITS:
        own = replace(limit, value=stray) if limit.unit == "F" else limit
        broken = _broken(own, *values[own.kind]) if own.kind in values else None
        if broken is not None:
            found[f"{own.kind} {own.beyond}"] = broken
    return found


def _named(kind: str, values: Mapping[str, float]) -> tuple[str, _Values]:
    return kind, (np.array(list(values.values())), list(values).__getitem__)


def _values(circuit: Circuit, rest: Rest | None) -> Iterator[tuple[str, _Values]]:
    """Yield the values of the parts of each kind, and their names."""
    yield (
        _MATRIX,
        (
            np.concatenate([matrix.ohms.ravel() for matrix in circuit.matrices]),
            lambda place: _card(circuit, place),
        ),
    )
    for kind, roles, *_ in _RESISTORS[1:]:
        names = {name for role in roles for name in circuit.named(role)}
        yield _named(
            kind, {part.card: part.ohms for part in circuit.resistors if part.card in names}
        )
    signal = circuit.capacitors_of(Role.SIGNAL_CAPACITOR)
    yield _named("capacitors C", {part.card: part.farads for part in signal})
    amps = {source.card: abs(source.amps) for source in circuit.currents if source.amps}
    largest = max(amps, key=amps.__getitem__, default="")
    yield _named("largest strain currents", {largest: amps[largest]} if amps else {})
    volts = {source.node: source for source in circuit.voltages if source.switched}
    for part in circuit.resistors_of(Role.STRAIN_RESISTOR):
        if (source := volts.get(part.a)) is not None:
            amps[source.card] = abs(source.volts) / part.ohms
    yield _named("strain currents", amps)
    models = circuit.models
    supplied = (
        cell.card
        for cell in circuit.opamps
        if math.isinf(models[cell.model].most_supply) and models[cell.model].is_limited
    )
    yield _named("supplies of op-amps", dict.fromkeys(supplied, circuit.supply))
    if rest is None:
        return
    yield _named("output currents of op-amps at rest", _output_currents(circuit, rest))
    common = {c.card: c.noninverting for c in circuit.opamps if c.noninverting != GROUND}
    shares = {name: abs(rest(node)) / circuit.supply for name, node in common.items()}
    yield _named("common-mode voltages at rest", shares)


def _output_currents(circuit: Circuit, rest: Rest) -> dict[str, float]:
    """Return the currents of op-amps without a figure of their own, which has a check, A."""
    models = circuit.models
    judged = {
        cell.output: cell.card
        for cell in circuit.opamps
        if not models[cell.model].has_largest_current
    }
    amps = dict.fromkeys(judged.values(), 0.0)
    for a, b, ohms in joined_resistors(circuit) if judged else ():
        for near, far in ((a, b), (b, a)):
            if near in judged:
                amps[judged[near]] += (rest(near) - rest(far)) / ohms
    return {name: abs(value) for name, value in amps.items()}


def _card(circuit: Circuit, place: int) -> str:
    """Return the name of a matrix resistor from its place in all entries of all matrices."""
    for matrix in circuit.matrices:
        if place < matrix.ohms.size:
            k, n = divmod(place, matrix.ohms.shape[1])
            return f"{matrix.name}_{k + 1}_{n + 1}"
        place -= matrix.ohms.size
    raise IndexError(place)


def _broken(limit: PartLimit, values: Floats, name: Callable[[int], str]) -> BrokenLimit | None:
    """Return what breaks a limit; None if nothing does."""
    present = np.isfinite(values) & (values > 0.0)
    sizes = np.where(present, values, 1.0)
    factor = sizes / limit.value if limit.way == "above" else limit.value / sizes
    wrong = present & (factor > SAME)
    if not wrong.any():
        return None
    place = int(np.where(wrong, factor, 0.0).argmax())
    own = f" of {show(limit.value, 'F')}" if limit.unit == "F" else ""
    direction = "up" if limit.way == "above" else "down"
    text = (
        f"{np.count_nonzero(wrong)} of {np.count_nonzero(present)} {limit.kind} are"
        f" {limit.beyond}{own}, {direction} to {show(float(values[place]), limit.unit)}"
        f" ({name(place)}); remedy: {limit.remedy}"
    )
    return BrokenLimit(text, float(factor[place]))
