"""The stages of a board drawn on a sheet: ladders of resistors, op-amps with their feedback.

Places are in steps of the grid; every stage starts at a point on its left and returns where its
output is on its right.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from taction.netlist_gen.board.circuit import Capacitor, OpAmpCell, Resistor
from taction.netlist_gen.kicad.parts import Catalogue
from taction.netlist_gen.kicad.sheet import Part, Placed, Sheet
from taction.netlist_gen.kicad.symbols import CAPACITOR, FLAG, GROUND, Point, Symbol

RUNG, LONGEST = 4, 32  # distance of the rungs of a ladder, and the most of them in one column
COLUMN = 44  # width of a column
LEVEL = 8  # height of one feedback part over an op-amp


class Stages:
    """Draws the stages of one board on one sheet."""

    def __init__(self, sheet: Sheet, catalogue: Catalogue) -> None:
        self.sheet, self.catalogue = sheet, catalogue
        self.ports = 0

    def port(self, symbol: Symbol, at: Point) -> None:
        """Place the symbol of ground, of a supply or of a power flag, with its name."""
        self.ports += 1
        reference = f"{symbol.prefix}{self.ports:03d}"
        shown = symbol.name not in (GROUND.name, FLAG.name)
        up = -3.2 if symbol.name.startswith("+") else 3.2
        place = (at[0], at[1] + up) if shown else None
        self.sheet.place(Part(symbol, reference, symbol.name), at, value=place)

    def across(self, part: Part, at: Point, *, texts: str = "around") -> Placed:
        """Place a part with two pins from left to right, `at` its middle.

        Its texts are above and below it, or both above its wires.
        """
        if texts == "around":
            away = 2.8 if part.symbol is CAPACITOR else 2.2
            reference, value = (at[0], at[1] - away), (at[0], at[1] + away)
        else:
            reference, value = (at[0] - 7.5, at[1] - 1.0), (at[0] + 7.5, at[1] - 1.0)
        return self.sheet.place(part, at, angle=90, reference=reference, value=value)

    def down(self, part: Part, at: Point) -> Placed:
        """Place a part with two pins from above to below, its texts on the right."""
        x, y = at
        right = x + 0.45 * max(len(part.reference), len(part.value))
        right += 3.0 if part.symbol.circles else 2.4
        reference, value = (right, y - 1.0), (right, y + 1.0)
        return self.sheet.place(part, at, reference=reference, value=value)

    def ladder(self, at: Point, rungs: Sequence[tuple[str, Part]]) -> Point:
        """Draw parts from named signals to one node; return the node at the upper right.

        A rung without a signal starts at ground. Long ladders have several columns.
        """
        buses = []
        for first in range(0, len(rungs), LONGEST):
            x = at[0] + COLUMN * (first // LONGEST)
            chosen = rungs[first : first + LONGEST]
            for place, (signal, part) in enumerate(chosen):
                y = at[1] + RUNG * place
                drawn = self.across(part, (x + 22, y), texts="above")
                start = (x + 9, y)
                self.sheet.wire(start, drawn.pin(0))
                self.sheet.wire(drawn.pin(1), (x + 35, y))
                if signal:
                    self.sheet.signal(signal, start, output=False)
                else:
                    self.port(GROUND, start)
            self.sheet.wire((x + 35, at[1]), (x + 35, at[1] + RUNG * (len(chosen) - 1)))
            buses.append((x + 35, at[1] + RUNG * (len(chosen) - 1)))
        level = max(y for _, y in buses) + RUNG
        for (x, y), (other, bottom) in pairwise(buses):
            self.sheet.wire((x, y), (x, level), (other, level))
            if (other, bottom) == buses[-1]:
                self.sheet.wire((other, level), (other, bottom))
        return buses[-1][0], at[1]

    def summing(
        self, at: Point, cell: OpAmpCell, feedback: Sequence[Resistor | Capacitor]
    ) -> Point:
        """Draw an op-amp from its summing node `at`, its feedback parts above it."""
        x, y = at
        left, right = x + 8, x + 24
        self.sheet.name(cell.inverting, at)
        self.sheet.wire(at, (left, y), (left + 2, y))
        drawn = self.cell(cell, (left + 8, y + 2))
        output = drawn.pin(2)
        self.sheet.wire(output, (right, output[1]))
        self.sheet.wire(drawn.pin(1), (left + 2, y + 6))
        self.port(GROUND, (left + 2, y + 6))
        for number, each in enumerate(feedback, 1):
            level = y - LEVEL * number
            over = self.across(self.catalogue.part(each), ((left + right) // 2, level))
            self.sheet.wire((left, level), over.pin(0))
            self.sheet.wire(over.pin(1), (right, level))
        if feedback:
            self.sheet.wire((left, y), (left, y - LEVEL * len(feedback)))
            self.sheet.wire((right, output[1]), (right, y - LEVEL * len(feedback)))
        return right, output[1]

    def cell(self, cell: OpAmpCell, at: Point) -> Placed:
        """Place an op-amp with the name of the deck in it."""
        x, y = at
        part = self.catalogue.opamp(cell)
        self.sheet.text(cell.name, (x - 1, y), middle=True)
        return self.sheet.place(part, at, reference=(x + 3, y - 4.2), value=(x + 3, y + 4.2))

    def out(self, at: Point, signal: str) -> Point:
        """Label an output at the end of the stages."""
        end = self.sheet.wire(at, (at[0] + 4, at[1]))
        self.sheet.signal(signal, end, output=True)
        return end

    def tap(self, at: Point, signal: str) -> Point:
        """Label an output that the next stage takes, too; return where it starts."""
        x, y = at[0] + 2, at[1]
        self.sheet.wire(at, (x, y), (x, y + 8), (x + 2, y + 8))
        self.sheet.signal(signal, (x + 2, y + 8), output=True)
        return self.sheet.wire((x, y), (x + 4, y))

    def supply(self, at: Point, package: str) -> None:
        """Draw the supply pins of a package with two decoupling capacitors."""
        x, y = at
        plus, minus = self.catalogue.rails
        unit = self.catalogue.opamp_unit(package)
        drawn = self.sheet.place(unit, at, reference=(x - 5, y - 1), value=(x - 5, y + 1))
        upper = self.down(self.catalogue.decoupling(package, 1), (x + 10, y - 6))
        lower = self.down(self.catalogue.decoupling(package, 2), (x + 10, y + 6))
        for symbol, end, part, level in (
            (plus, drawn.pin(0), upper.pin(0), y - 10),
            (minus, drawn.pin(1), lower.pin(1), y + 10),
        ):
            self.sheet.wire(end, (x, level), (x + 10, level), part)
            self.port(symbol, (x, level))
        self.sheet.wire(upper.pin(1), (x + 10, y), lower.pin(0))
        self.sheet.wire((x + 10, y), (x + 16, y))
        self.port(GROUND, (x + 16, y))

    def flags(self, at: Point) -> None:
        """Say where the supplies and ground come from, for KiCad's check of the rules."""
        for place, symbol in enumerate((*self.catalogue.rails, GROUND)):
            x, y = at[0] + 12 * place, at[1]
            self.sheet.wire((x, y), (x + 4, y))
            self.port(symbol, (x, y))
            self.port(FLAG, (x + 4, y))
