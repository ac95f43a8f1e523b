"""What to buy for a board: preferred values (IEC 60063), counts, references and packages."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.scene.design import Design
from taction.netlist_gen.scene.scene import Scene, own_figures
from taction.system.array_types import Floats

DIGITS = 3  # of a value without a series
SLACK = 1e-9  # relative: a value that is off by less is one of the series
_E24 = (
    *(1.0, 1.1, 1.2, 1.3, 1.5, 1.6, 1.8, 2.0, 2.2, 2.4, 2.7, 3.0),
    *(3.3, 3.6, 3.9, 4.3, 4.7, 5.1, 5.6, 6.2, 6.8, 7.5, 8.2, 9.1),
)


@lru_cache
def mantissas(series: str) -> Floats:
    """Return the values of one decade, from 1 to below 10; read-only."""
    count = int(series[1:])
    if count <= len(_E24):
        values = np.array(_E24[:: len(_E24) // count])
    else:
        values = np.round(10.0 ** (np.arange(count) / count), 2)
        values[np.isclose(values, 9.19)] = 9.20  # as the standard has it
    values.flags.writeable = False
    return values


def nearest(values: Floats, series: str) -> Floats:
    """Return the nearest preferred values by ratio, ohm or F; infinite ones stay."""
    if series == "exact":
        return values
    steps = np.append(mantissas(series), 10.0)
    finite = np.isfinite(values)
    decade = np.floor(np.log10(values, where=finite, out=np.zeros_like(values)))
    mantissa = np.where(finite, values / 10.0**decade, 1.0)
    place = np.clip(np.searchsorted(steps, mantissa), 1, len(steps) - 1)
    lower, upper = steps[place - 1], steps[place]
    chosen = np.where(mantissa * mantissa < lower * upper, lower, upper)
    digits = np.round(chosen * 100.0)  # three digits: exact, so that 4.7k is 4700.0
    shift = decade - 2
    value = np.where(shift >= 0, digits * 10.0 ** np.abs(shift), digits / 10.0 ** np.abs(shift))
    return np.where(finite, value, values)


@lru_cache(maxsize=4096)
def preferred(ohms: float, series: str) -> float:
    """Return the value of a series that is nearest to `ohms`; see `nearest`."""
    return ohms if series == "exact" else float(nearest(np.array([ohms]), series)[0])


def series_of(design: Design, path: str) -> str:
    """Return the series of the values of a key: that of the scene, or ``"exact"``."""
    if path == "design.capacitance":
        return design.capacitor_series
    return design.resistor_series if path in RESISTORS else "exact"


RESISTORS = ("design.resistance", "design.gain", "design.inverter_resistance")


def buyable(value: float, series: str) -> float:
    """Return the nearest value of a series, or the value with three digits."""
    return float(f"{value:.{DIGITS - 1}e}") if series == "exact" else preferred(value, series)


SAME = 8  # digits behind the point of values that are one part
UNITS = {"resistor": "ohm", "capacitor": "F"}
STANDARD = {"resistor": ("E24", "E96", "E192"), "capacitor": ("E24",)}  # E24 holds E6 and E12
STOCKED = {"resistor": ("E24", "E96"), "capacitor": ("E24",)}  # series of the proposed values


@dataclass(frozen=True, slots=True)
class Preferred:
    """The nearest preferred value of a part whose own value is not a standard value."""

    series: str
    value: float  # ohm or F
    deviation: float  # of the preferred value from the part's value, fraction


@dataclass(frozen=True, slots=True)
class PartLine:
    """All parts of one kind and one value."""

    SHOWN: ClassVar[tuple[str, ...]] = ("unit", "count", "standard")

    kind: str  # a key of `UNITS`
    value: float  # in the unit of the kind
    references: tuple[str, ...]  # names of the parts in the deck, in its order
    tolerance: float | None  # fraction; None if the scene gives none
    preferred: Preferred | None  # the nearest preferred value; None for a standard value

    @property
    def unit(self) -> str:
        """Unit of `value`."""
        return UNITS[self.kind]

    @property
    def count(self) -> int:
        """Number of parts."""
        return len(self.references)

    @property
    def standard(self) -> bool:
        """Whether the value is a standard value."""
        return self.preferred is None


@dataclass(frozen=True, slots=True)
class Package:
    """A package with the op-amps that it holds."""

    reference: str  # "U1"
    opamps: tuple[str, ...]  # names in the circuit
    spare: int  # op-amps without use


@dataclass(frozen=True, slots=True)
class BillOfMaterials:
    """The parts of a board."""

    # Resistors, then capacitors, by value; no two of a kind have the same value.
    lines: tuple[PartLine, ...]
    opamp: str  # preset of the op-amps
    packages: tuple[Package, ...]  # in the order of the circuit
    not_listed: tuple[str, ...]  # what the list or the power lacks

    @property
    def spare(self) -> int:
        """Number of op-amps without use."""
        return sum(package.spare for package in self.packages)

    def count(self, kind: str) -> int:
        """Return the number of parts of a kind."""
        return sum(len(line.references) for line in self.lines if line.kind == kind)


def bill_of_materials(circuit: Circuit, scene: Scene) -> BillOfMaterials:
    """Return the parts of `circuit`, the board of `scene`, equal values in one line."""
    ohms = [(part.card, part.ohms) for part in circuit.resistors]
    for matrix in circuit.matrices:
        ohms += [(name, float(matrix.ohms[k, n])) for name, k, n in matrix.places()]
    farads = [(part.card, part.farads) for part in circuit.real_capacitors]
    return BillOfMaterials(
        lines=(*_lines("resistor", ohms, scene), *_lines("capacitor", farads, scene)),
        opamp=scene.design.opamp.file or scene.design.opamp.base,
        packages=tuple(packages(circuit)),
        not_listed=tuple(_not_listed(circuit, scene)),
    )


def tolerance_of(scene: Scene, kind: str, name: str) -> float | None:
    """Return the tolerance of a part by its name in the deck, fraction; None if none is given."""
    given = kind in scene.tolerances.model_fields_set
    common = float(getattr(scene.tolerances, kind)) if given else None
    return scene.tolerances.parts.get(name, common)


def _lines(kind: str, parts: list[tuple[str, float]], scene: Scene) -> Iterator[PartLine]:
    """Yield one line for each value, with `SAME` digits, and tolerance, the largest one first."""
    equal = defaultdict[tuple[float, str], list[tuple[str, float]]](list)
    for name, value in parts:
        own = tolerance_of(scene, kind, name)
        equal[math.inf if own is None else -own, f"{value:.{SAME}e}"].append((name, value))
    for tolerance, text in sorted(equal, key=lambda each: (each[0], float(each[1]))):
        names, values = zip(*equal[tolerance, text], strict=True)
        given = None if tolerance == math.inf else -tolerance
        yield PartLine(kind, values[0], names, given, _preferred(kind, values[0]))


def _preferred(kind: str, value: float) -> Preferred | None:
    def near(series: str) -> Preferred:
        found = preferred(value, series)
        return Preferred(series, found, found / value - 1.0)

    if any(abs(near(series).deviation) < SLACK for series in STANDARD[kind]):
        return None
    return min(map(near, STOCKED[kind]), key=lambda each: abs(each.deviation))


def packages(circuit: Circuit) -> Iterator[Package]:
    """Yield packages that are filled in the order of the op-amps, each with one type."""
    number = 0
    for name, model in circuit.models.items():
        cells = [cell.name for cell in circuit.opamps if cell.model == name]
        size = model.channels_per_package
        for first in range(0, len(cells), size):
            held = tuple(cells[first : first + size])
            number += 1
            yield Package(f"U{number}", held, size - len(held))


def _not_listed(circuit: Circuit, scene: Scene) -> Iterator[str]:
    choice = scene.design.opamp
    if changed := sorted(own_figures(choice)):
        yield f"op-amps with the scene's {', '.join(changed)}, which {choice.base} does not have"
    if not any(model.supply_current for model in circuit.models.values()):
        yield "the supply current of the op-amps: set design.opamp.supply_current"
    for model in circuit.models.values():
        if model.external_part:
            number = sum(cell.model == model.name for cell in circuit.opamps)
            yield f"{number} times the {model.external_part} of {choice.base}"
    if circuit.strains:
        kind = "current" if circuit.currents else "voltage"
        yield f"{len(circuit.strains)} {kind} sources of the strain, switched on at t = 0"
    yield from (f"the voltage source {source.name!r}" for source in circuit.constant_voltages)
    if circuit.transistors:
        pair = scene.design.antilog.transistors
        yield f"{len(circuit.transistors) // 2} matched pairs {pair}"
    if circuit.amplifiers:
        yield f"{len(circuit.amplifiers)} {circuit.amplifier} amplifiers: ideal in the circuit"
    yield f"the supply of ±{circuit.supply:g} V and its decoupling capacitors"
