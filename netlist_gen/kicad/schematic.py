"""The schematic of one channel and of one sensor row, for KiCad 8 and newer.

Above is the signal plane: all feedback resistors into the channel's summing node, the integrator
with R and C, and the signal amplifier. Below is the constraint plane: all forward resistors into
the row's summing node, the strain, and the amplifier with its gain. Signals of the rest of the
board have global labels.

The stages of a board drawn on a sheet: ladders of resistors, op-amps with their feedback.

Places are in steps of the grid; every stage starts at a point on its left and returns where its
output is on its right.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from taction.netlist_gen.board.channel import Channel
from taction.netlist_gen.board.circuit import GROUND as GROUND_NODE
from taction.netlist_gen.board.circuit import Capacitor, OpAmpCell, Resistor, ResistorMatrix, Role
from taction.netlist_gen.kicad.parts import Catalogue
from taction.netlist_gen.kicad.sheet import Part, Placed, Sheet
from taction.netlist_gen.kicad.symbols import CAPACITOR, FLAG, GROUND, Point, Symbol
from taction.netlist_gen.scene.scene import Scene

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


LEFT, TOP = 12, 14  # of the drawing, in steps of the grid
TITLE = 2.0  # height of a title, mm


def channel_sheet(channel: Channel, scene: Scene | None = None, *, brief: bool = False) -> Sheet:
    """Draw a channel of the board of `scene` with its row; every part has its name in the deck.

    A `brief` drawing has one resistor of each matrix, that between channel and row, and no
    supplies.
    """
    return _Drawing(channel, scene, brief).draw()


class _Drawing:
    def __init__(self, channel: Channel, scene: Scene | None, brief: bool) -> None:
        self.channel, self.circuit, self.brief = channel, channel.circuit, brief
        self.sheet = Sheet(f"{channel.circuit.name}-channel-{channel.n}")
        self.catalogue = Catalogue(channel.circuit, scene)
        self.stages = Stages(self.sheet, self.catalogue)
        self.width = 0

    def draw(self) -> Sheet:
        """Draw the rows one below the other, and the supplies on the right."""
        n, k = self.channel.n, self.channel.k
        y = self._title(TOP, f"Signal plane, channel {n}") + 3 * LEVEL
        y = self._signal_row((LEFT, y))
        if self.channel.transistors:
            y = self._title(y, f"Antilog stage of channel {n}") + 3 * LEVEL
            y = self._antilog_row((LEFT, y))
        y = self._title(y, f"Constraint plane, sensor row {k}") + 2 * LEVEL
        self._constraint_row((LEFT, y))
        if not self.brief:
            self._supplies((self.width + 22, TOP))
        return self.sheet

    def _title(self, y: float, text: str) -> int:
        self.sheet.text(text, (LEFT, y), size=TITLE)
        return int(y)

    def _end(self, point: Point) -> None:
        self.width = max(self.width, round(point[0]))

    def _rungs(self, matrix: ResistorMatrix) -> list[tuple[str, Part]]:
        """Return the resistors of a matrix into the node of the channel or the row."""
        channel = self.channel
        rungs, shown = channel.rungs(matrix), f"{matrix.name}_{channel.k}_{channel.n}"
        return self._drawn([part for part in rungs if not self.brief or part.card == shown])

    def _drawn(self, parts: Sequence[Resistor]) -> list[tuple[str, Part]]:
        return [(each.a, self.catalogue.resistor(each)) for each in parts]

    def _signal_row(self, at: Point) -> int:
        """Draw the feedback resistors, the signal node and its amplifier; return the next row."""
        channel = self.channel
        rungs = self._rungs(self.circuit.feedback) + self._drawn(channel.biases())
        node = self.stages.ladder(at, rungs)
        cell = channel.summing(channel.sink)
        output = self._grounded(node) if cell is None else self._summing(node, cell)
        self._end(self._amplifier(output))
        return _below(at, len(rungs))

    def _summing(self, at: Point, cell: OpAmpCell) -> Point:
        """Draw an op-amp with the parts from its output to its summing node."""
        parts = self.channel.between(cell.output, cell.inverting)
        return self.stages.summing(self.sheet.wire(at, (at[0] + 4, at[1])), cell, parts)

    def _grounded(self, at: Point) -> Point:
        """Draw the parts from the signal node to ground, and its buffer if it has one."""
        node, (x, y) = self.channel.sink, at
        self.sheet.name(node, (x + 1, y))
        for number, part in enumerate(self.channel.between(node, GROUND_NODE)):
            place = x + 6 + 12 * number
            drawn = self.stages.down(self.catalogue.part(part), (place, y + 6))
            self.sheet.wire((place, y), drawn.pin(0))
            self.stages.port(GROUND, drawn.pin(1))
        end = self.sheet.wire(at, (x + 34, y))
        buffer = self.channel.follower(node)
        if buffer is None:
            return end
        drawn = self.stages.cell(buffer, (end[0] + 8, y - 2))
        self.sheet.wire(end, drawn.pin(1))
        left, right = drawn.pin(0), drawn.pin(2)
        self.sheet.wire(left, (left[0], y - 10), (right[0] + 2, y - 10), (right[0] + 2, right[1]))
        return self.sheet.wire(right, (right[0] + 2, right[1]))

    def _amplifier(self, at: Point) -> Point:
        """Draw the signal amplifier after the signal node, and an inverter where there is one."""
        channel, amplifier = self.channel, self.channel.amplifier
        if channel.transistors:
            return self.stages.out(at, channel.v)
        if amplifier is None:
            return self._with_inverter(at, self.circuit.outputs[channel.n - 1].node)
        self.sheet.name(channel.v, (at[0] + 1, at[1]))
        part = self.catalogue.function(amplifier)
        x, y = at[0] + 20, at[1]
        drawn = self.sheet.place(part, (x, y), reference=(x, y - 5.2), value=(x, y + 5.2))
        self.sheet.text("ideal: no part", (x, y), middle=True)
        self.sheet.wire(at, drawn.pin(0))
        return self._with_inverter(drawn.pin(1), amplifier.output)

    def _with_inverter(self, at: Point, signal: str) -> Point:
        found = self.channel.inverter(signal)
        if found is None:
            return self.stages.out(at, signal)
        x, y = self.stages.tap(at, signal)
        enters, cell = found
        drawn = self.stages.across(self.catalogue.resistor(enters), (x + 7, y))
        self.sheet.wire((x, y), drawn.pin(0))
        start = self.sheet.wire(drawn.pin(1), (x + 12, y))
        back = self.channel.between(cell.output, cell.inverting)
        return self.stages.out(self.stages.summing(start, cell, back), cell.output)

    def _antilog_row(self, at: Point) -> int:
        """Draw the divider with the pair, the reference op-amp and the output op-amp."""
        channel, (x, y) = self.channel, at
        first, second = channel.transistors
        drive, last = (self._cell(each.collector) for each in (first, second))
        stage = self.circuit.resistors_of(Role.STAGE)
        (reference,) = (each for each in stage if each.b == first.collector)
        (emitter,) = (each for each in stage if each.b == first.emitter)
        node = self.stages.ladder(at, self._drawn([reference]))
        out = self._summing(node, drive)
        self.sheet.name(drive.output, (out[0] + 1, out[1]))
        drawn = self.stages.across(self.catalogue.resistor(emitter), (out[0] + 10, out[1]))
        self.sheet.wire(out, drawn.pin(0))
        end = self.sheet.wire(drawn.pin(1), (drawn.pin(1)[0] + 4, out[1]))
        self.sheet.name(first.emitter, end)
        parts = channel.between(last.output, last.inverting)
        output = self.stages.summing((drawn.pin(1)[0] + 12, y), last, parts)
        self._end(self._with_inverter(output, last.output))
        self._pair((x + 9, y + 20))
        return round(y) + 42

    def _cell(self, node: str) -> OpAmpCell:
        return next(each for each in self.circuit.opamps if each.inverting == node)

    def _pair(self, at: Point) -> None:
        """Draw the divider of v and the pair, whose collectors have the names of their nodes."""
        divider, (x, y) = self.channel.divider, at
        if divider is None:
            return
        first, second = self.channel.transistors
        (below,) = self.channel.between(divider.b, GROUND_NODE)
        self.sheet.signal(self.channel.v, at, output=False)
        drawn = self.stages.across(self.catalogue.resistor(divider), (x + 8, y))
        self.sheet.wire(at, drawn.pin(0))
        base = self.stages.down(self.catalogue.part(below), (x + 16, y + 4))
        self.sheet.wire(drawn.pin(1), (x + 16, y), base.pin(0))
        self.stages.port(GROUND, base.pin(1))
        self.sheet.name(divider.b, self.sheet.wire((x + 16, y), (x + 22, y)))
        left, right = x + 44, x + 56
        for cell, unit, place, mirrored in ((first, 1, left, False), (second, 2, right, True)):
            part, out = self.catalogue.transistor(self.channel.n, unit), 4 if mirrored else -4
            aside = place + 1.2 * out
            self.sheet.text(cell.card, (aside, y - 6.2), middle=True)
            texts = (aside, y - 4.4), (aside, y - 2.6)
            placed = self.sheet.place(
                part, (place, y), mirrored=mirrored, reference=texts[0], value=texts[1]
            )
            end, collector, emitter = (placed.pin(number) for number in range(3))
            if cell.base == GROUND_NODE:
                self.stages.port(GROUND, self.sheet.wire(end, (end[0], y + 6)))
            else:
                self.sheet.name(cell.base, self.sheet.wire(end, (end[0] + out, y)))
            up = -1 if collector[1] < y else 1
            top = self.sheet.wire(collector, (collector[0], collector[1] + 2 * up))
            self.sheet.name(cell.collector, top)
            middle = ((left + right) // 2, emitter[1] - 2 * up)
            self.sheet.wire(emitter, (emitter[0], middle[1]), middle)
        self.sheet.name(first.emitter, middle)

    def _constraint_row(self, at: Point) -> None:
        channel = self.channel
        rungs = self._rungs(self.circuit.forward)
        if channel.strain is not None:
            rungs.append(("", self.catalogue.strain(channel.strain)))
        node, cell = self.stages.ladder(at, rungs), self._cell(channel.row)
        self._end(self._with_inverter(self._summing(node, cell), cell.output))
        self.sheet._reach((node[0], _below(at, len(rungs))))

    def _supplies(self, at: Point) -> None:
        """Draw the supplies of the packages, the constant voltages, and what is not drawn."""
        x, y = at
        self.sheet.text("Supplies", (x - 6, y), size=TITLE)
        self.stages.flags((x, y + 10))
        y += 30
        used = sorted({p.part.reference for p in self.sheet.placed if p.part.symbol.prefix == "U"},
                      key=lambda name: int(name[1:]))  # fmt: skip
        for place, package in enumerate(used):
            self.stages.supply((x + 30 * (place % 2), y + 34 * (place // 2)), package)
        y += 34 * ((len(used) + 1) // 2)
        for place, source in enumerate(self.circuit.voltages):
            drawn = self.stages.down(self.catalogue.voltage(source), (x + 24 * place, y))
            top = drawn.pin(0)
            self.sheet.signal(
                source.node, self.sheet.wire(top, (top[0], top[1] - 3), (top[0] + 2, top[1] - 3)),
                output=True,
            )  # fmt: skip
            self.stages.port(GROUND, drawn.pin(1))


def _below(at: Point, rungs: int) -> int:
    """Return the height of the next row below a ladder and its op-amps."""
    rows = min(rungs, LONGEST) + (rungs > LONGEST)
    return round(at[1]) + max(RUNG * rows, 16) + 6
