"""Three ways to give an array of conductances negative entries, each with its price.

==============  ============================  ===========================================
way             parts                         price
==============  ============================  ===========================================
inverters       an inverter for each driver   as many op-amps again, and their poles
                with a negative entry         stand in the loop
differential    negative entries end at the   resistors to ground that load both inputs
                other input of the op-amp     alike; the inputs are no virtual grounds
offset          one column, driven by one     an op-amp with the noise gain N + 1, and
                inverter of the sum           outputs that add up: its time grows with N
==============  ============================  ===========================================

All three rest at the same answer.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from taction.netlist_gen.board.circuit import GROUND, Fact, Role
from taction.netlist_gen.board.parts import ResistorMatrix
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.entries import matrix_resistors
from taction.netlist_gen.topologies.frame.parts import Parts
from taction.system.array_types import Bools, Floats


@dataclass(frozen=True, slots=True, eq=False)
class Array:
    """An array of conductances with the signs of T."""

    role: str  # `Role.FORWARD`: columns drive and rows sum; else rows drive and columns sum
    name: str  # of its resistors in the deck
    T: Floats  # (M, N): the entries
    drives: tuple[str, ...]  # nodes of the drivers
    sinks: tuple[str, ...]  # the input of each op-amp that takes the array
    others: tuple[str, ...]  # its other input

    @property
    def by_column(self) -> bool:
        """Whether columns drive."""
        return self.role == Role.FORWARD

    def of_driver(self, place: int) -> Floats:
        """Return the entries of a driver, from 0."""
        return self.T[:, place] if self.by_column else self.T[place]


class Way(ABC):
    """How the entries of an array get their signs."""

    # whether negative entries end at the other input of an op-amp
    uses_other_input: ClassVar[bool] = False

    @abstractmethod
    def connect(self, parts: Parts, scene: Scene, array: Array) -> None:
        """Place the resistors of an array, and what its negative entries need."""

    def facts(self, T: Floats) -> dict[str, Fact]:
        """Return what a board with the matrix `T` states besides."""
        return {}


class Inverters(Way):
    """An inverter for each driver with a negative entry."""

    def connect(self, parts: Parts, scene: Scene, array: Array) -> None:
        """Place inverters and one matrix; see `Way`."""
        inverted = []
        for place, source in enumerate(array.drives):
            node = ""
            if source and np.any(array.of_driver(place) < 0.0):
                head, _, number = source.partition("_")
                node = f"{INVERSE[head]}_{number}"
                parts.inverting(node, source, node)
            inverted.append(node)
        ohms, negative = matrix_resistors(array.T, scene)
        _place(parts, array, array.name, ohms, negative, tuple(inverted))


class Differential(Way):
    """Negative entries at the other input of the op-amp."""

    uses_other_input = True

    def connect(self, parts: Parts, scene: Scene, array: Array) -> None:
        """Place a matrix for each sign; see `Way`."""
        ohms, negative = matrix_resistors(array.T, scene)
        _place(parts, array, array.name, np.where(negative, np.inf, ohms))
        if negative.any():
            below = np.where(negative, ohms, np.inf)
            _place(parts, array, f"{array.name}n", below, opposite=True)


class Offset(Way):
    """One more column: T less its least entry is positive."""

    def connect(self, parts: Parts, scene: Scene, array: Array) -> None:
        """Place the shifted matrix, an inverter of the sum, and the column; see `Way`."""
        below = _offset(array.T)
        ohms, _ = matrix_resistors(array.T + below, scene)
        _place(parts, array, array.name, ohms)
        if below == 0.0:
            return
        head = next(source for source in array.drives if source).partition("_")[0]
        output = f"sum_{head}"
        summing, inverter = f"j{output}", scene.design.inverter_resistance
        parts.opamp(output, summing, output)
        for source in filter(None, array.drives):
            parts.resistor(Role.SUM, f"{output}_{source}", (source, summing), inverter)
        parts.resistor(Role.SUM, f"{output}_fb", (output, summing), inverter)
        column = 1.0 / (below * scene.design.unit_conductance)
        for sink in filter(None, array.sinks):
            parts.resistor(Role.OFFSET, f"off_{sink}", (output, sink), column)

    def facts(self, T: Floats) -> dict[str, Fact]:
        """Return the offset; see `Way`."""
        below = _offset(T)
        if below == 0.0:
            return {}
        title, key = "offset of every entry of T", "design.negative_entries"
        return {"offset": Fact("offset", below, "", "b", title, key)}


def _offset(T: Floats) -> float:
    return max(0.0, -float(T.min()))


def _place(
    parts: Parts,
    array: Array,
    name: str,
    ohms: Floats,
    negative: Bools | None = None,
    minus: tuple[str, ...] = (),
    *,
    opposite: bool = False,
) -> None:
    """Place a matrix of resistors between the drivers and the inputs of an array."""
    signs: Bools = np.zeros(ohms.shape, dtype=np.bool_) if negative is None else negative
    inverted = minus or ("",) * len(array.drives)
    sinks = array.others if opposite else array.sinks
    ends = tuple(node or GROUND for node in sinks)
    parts.matrix(
        array.role,
        ResistorMatrix(name, ohms, signs, array.by_column, array.drives, inverted, ends, opposite),
    )


INVERSE = {"v": "a", "w": "z", "y": "q"}
"""The letter of the inverse of an output."""
WAYS: Mapping[str, Way] = {
    "inverters": Inverters(),
    "differential": Differential(),
    "offset": Offset(),
}
"""By the words of ``design.negative_entries``."""
