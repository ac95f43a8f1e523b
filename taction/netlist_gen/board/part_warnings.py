"""The limits of real parts, and warnings about parts of a board that break them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.board.circuit import Circuit, Role
from taction.netlist_gen.board.parts import Resistor
from taction.netlist_gen.board.wired_arrays import joined_resistors
from taction.system.array_types import Floats
from taction.system.quantities import show

LEAST_OHMS, MOST_OHMS = 10.0, 10e6  # of a resistor that a proposal may have
SAME = 1.0 + 1e-9  # ratio of values that count as equal
ROUNDING = 1.05  # the most that E24 moves a value by


@dataclass(frozen=True, slots=True)
class PartLimit:
    """A limit of a real part, and why it is one."""

    way: str  # "above" or "below": the values beyond it
    value: float
    unit: str
    reason: str
    label: str = ""  # in the place of value and unit


LIMITS = {
    "most ohms": PartLimit(
        "above",
        MOST_OHMS,
        "ohm",
        "few makers sell 1 % resistors above; a bias current of 30 nA makes an error of 0.3 V; the"
        " leakage of a board without guard rings, about 10 Gohm, is beside 0.1 %",
    ),
    "least ohms": PartLimit(
        "below", LEAST_OHMS, "ohm", "contacts and tracks, about 50 mohm, are beside 0.5 %"
    ),
    "stray": PartLimit(
        "below", 0.0, "F", "the layout sets the dynamics, not the part", "the stray capacitance"
    ),
    "most strain": PartLimit(
        "above", 10e-3, "A", "the op-amps must take the current of the source beside their loads"
    ),
    "least strain": PartLimit(
        "below", 10e-9, "A", "the leakage of a board, 100 pA at 1 V, is above 1 % of every source"
    ),
    "most supply": PartLimit("above", 18.0, "V", "common op-amps stand no more than 36 V in total"),
    "least supply": PartLimit(
        "below", 2.25, "V", "common op-amps do not work below 4.5 V in total"
    ),
    "output current": PartLimit(
        "above", 20e-3, "A", "common op-amps deliver 20 to 40 mA into a short circuit"
    ),
    "common mode": PartLimit(
        "above", 0.8, "", "inputs of common op-amps work up to 3 V from ±15 V", "80 % of the supply"
    ),
}
"""What proposals keep, and what `verify` warns of. An op-amp with an output current or a supply of
its own has these in the place of the table's."""


MATRIX, CAPACITORS, SUPPLY = "matrix resistors", "capacitors C", "supplies of op-amps"
STRAIN, LARGEST_STRAIN = "strain currents", "largest strain currents"
CURRENT, COMMON = "output currents of op-amps at rest", "common-mode voltages at rest"
REMEDIES: dict[str, dict[str, str]] = {
    CAPACITORS: {
        "stray": "a larger design.capacitance, or a layout with a smaller design.stray_capacitance"
    },
    STRAIN: {"most strain": "a smaller design.unit_conductance or design.unit_voltage"},
    # A small strain beside a large one needs no source that is accurate.
    LARGEST_STRAIN: {"least strain": "a larger design.unit_conductance or design.unit_voltage"},
    SUPPLY: {"most supply": "a smaller design.supply", "least supply": "a larger design.supply"},
    CURRENT: {"output current": "a smaller design.unit_voltage or design.unit_conductance"},
    COMMON: {"common mode": "a smaller design.unit_voltage or a larger design.supply"},
}
"""The limits of each kind of value that the same keys of the scene set, with their remedies."""

_UNIT = "design.unit_conductance"
RESISTORS: dict[str, tuple[tuple[str, ...], str, str]] = {
    MATRIX: (
        (),
        f"a larger {_UNIT}, or design.prune, which leaves out small entries of T",
        f"a smaller {_UNIT}",
    ),
    "resistors R": (
        (Role.SIGNAL_RESISTOR, Role.BIAS_RESISTOR),
        "a smaller design.resistance",
        "a larger design.resistance or a smaller lambda",
    ),
    "resistors s": ((Role.CONSTRAINT_RESISTOR,), "a smaller design.gain", "a larger design.gain"),
    "inverter resistors": (
        (Role.INVERTER_RESISTOR, Role.SUM),
        "a smaller design.inverter_resistance",
        "a larger design.inverter_resistance",
    ),
    "resistors 1/gf": (
        (Role.OUTPUT_CONDUCTANCE,),
        "a larger design.feedback_conductance",
        "a smaller design.feedback_conductance",
    ),
    "resistors of the rows that add lambda": (
        (Role.REGULARISING,),
        f"a larger {_UNIT} or lambda",
        f"a smaller {_UNIT} or lambda",
    ),
    "resistors of the offset column": ((Role.OFFSET,), f"a larger {_UNIT}", f"a smaller {_UNIT}"),
    "strain resistors": ((Role.STRAIN_RESISTOR,), f"a larger {_UNIT}", f"a smaller {_UNIT}"),
    "resistors of the antilog stages": (
        (Role.STAGE,),
        "a larger design.antilog.reference_current",
        "a larger design.antilog.divider_resistance or emitter_resistance",
    ),
}
"""The roles of each kind of resistor, and the remedies for too many ohms and for too few."""

_KINDS = {role: kind for kind, (roles, *_) in RESISTORS.items() for role in roles}
REMEDIES |= {
    kind: {"most ohms": less, "least ohms": more} for kind, (_, less, more) in RESISTORS.items()
}
Rest = Callable[[str], float]  # the voltage of a node at rest, V


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
    """What a proposal may have beyond the limits: what the scene itself has, but for rounding.

    Attributes
    ----------
    own : mapping of str to BrokenLimit
        What the scene has, by the kind of part and the limit.
    any_part : bool
        Whether any part may be proposed.
    """

    own: Mapping[str, BrokenLimit]
    any_part: bool = False

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
    """Return the warnings by the kind of part and the limit that it breaks.

    Examples
    --------
    >>> import taction
    >>> scene = taction.load_scene("scenes/paper-breadboard.toml")
    >>> list(broken_limits(taction.synthesise(scene)))[0]
    'matrix resistors above 10 Mohm'
    """
    strays = [part.farads for part in circuit.capacitors_of(Role.STRAY)]
    stray = max(strays, default=0.0)
    limits = LIMITS | {
        "stray": replace(
            LIMITS["stray"], value=stray, label=f"the stray capacitance of {show(stray, 'F')}"
        )
    }
    found = {}
    for kind, values, name in (*_by_kind(circuit), *_at_rest(circuit, rest)):
        for key, remedy in REMEDIES[kind].items():
            broken = _broken(kind, limits[key], values, name, remedy)
            if broken is not None:
                label = LIMITS[key].label or show(LIMITS[key].value, LIMITS[key].unit)
                found[f"{kind} {LIMITS[key].way} {label}"] = broken
    return found


_Values = tuple[str, Floats, Callable[[int], str]]


def _named(kind: str, values: dict[str, float]) -> _Values:
    return kind, np.array(list(values.values())), list(values).__getitem__


def _by_kind(circuit: Circuit) -> Iterator[_Values]:
    """Yield the values of each kind, infinite where there is no part, and their names."""
    yield (
        MATRIX,
        np.concatenate([matrix.ohms.ravel() for matrix in circuit.matrices]),
        lambda place: _card(circuit, place),
    )
    kinds: dict[str, list[Resistor]] = {}
    for part in circuit.resistors:
        for role, kind in _KINDS.items():
            if part.card in circuit.named(role):
                kinds.setdefault(kind, []).append(part)
    for kind, parts in kinds.items():
        yield _named(kind, {part.card: part.ohms for part in parts})
    signal = circuit.capacitors_of(Role.SIGNAL_CAPACITOR)
    yield _named(CAPACITORS, {part.card: part.farads for part in signal})
    amps = {source.card: abs(source.amps) for source in circuit.currents if source.amps}
    yield _named(LARGEST_STRAIN, dict(sorted(amps.items(), key=lambda item: -item[1])[:1]))
    volts = {source.node: source for source in circuit.voltages if source.switched}
    for part in circuit.resistors_of(Role.STRAIN_RESISTOR):
        if (source := volts.get(part.a)) is not None:
            amps[source.card] = abs(source.volts) / part.ohms
    yield _named(STRAIN, amps)
    supplied = {
        cell.card: circuit.supply
        for cell in circuit.opamps
        if math.isinf(circuit.models[cell.model].most_supply)
        and circuit.models[cell.model].is_limited
    }
    yield _named(SUPPLY, supplied)


def _at_rest(circuit: Circuit, rest: Rest | None) -> Iterator[_Values]:
    """Yield the output currents, A, and the common modes, shares of the supply, of the op-amps."""
    if rest is None:
        return
    judged = {  # the others have a check with their own figure
        cell.output: cell.card
        for cell in circuit.opamps
        if not math.isfinite(circuit.models[cell.model].output_current)
        or not circuit.models[cell.model].output_resistance
    }
    amps = dict.fromkeys(judged.values(), 0.0)
    for a, b, ohms in joined_resistors(circuit) if judged else ():
        for near, far in ((a, b), (b, a)):
            if near in judged:
                amps[judged[near]] += (rest(near) - rest(far)) / ohms
    yield _named(CURRENT, {name: abs(value) for name, value in amps.items()})
    common = {c.card: c.noninverting for c in circuit.opamps if c.noninverting != "0"}
    yield _named(COMMON, {name: abs(rest(n)) / circuit.supply for name, n in common.items()})


def _card(circuit: Circuit, place: int) -> str:
    """Return the name of a matrix resistor from its place in all entries of all matrices."""
    for matrix in circuit.matrices:
        if place < matrix.ohms.size:
            k, n = divmod(place, matrix.ohms.shape[1])
            return f"{matrix.name}_{k + 1}_{n + 1}"
        place -= matrix.ohms.size
    raise IndexError(place)


def _broken(
    kind: str, limit: PartLimit, values: Floats, name: Callable[[int], str], remedy: str
) -> BrokenLimit | None:
    """Return what breaks a limit; None if nothing does."""
    present = np.isfinite(values) & (values > 0.0)
    sizes = np.where(present, values, 1.0)
    factor = sizes / limit.value if limit.way == "above" else limit.value / sizes
    wrong = present & (factor > SAME)
    if not wrong.any():
        return None
    place = int(np.where(wrong, factor, 0.0).argmax())
    beyond = f"{limit.way} {limit.label or show(limit.value, limit.unit)}"
    direction = "up" if limit.way == "above" else "down"
    text = (
        f"{np.count_nonzero(wrong)} of {np.count_nonzero(present)} {kind} are {beyond},"
        f" {direction} to {show(float(values[place]), limit.unit)} ({name(place)});"
        f" remedy: {remedy}"
    )
    return BrokenLimit(text, float(factor[place]))
