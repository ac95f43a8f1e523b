"""The schematic of one channel and of one sensor row, for KiCad 8 and newer.

Above is the signal plane: all feedback resistors into the channel's summing node, the integrator
with R and C, and the signal amplifier. Below is the constraint plane: all forward resistors into
the row's summing node, the strain, and the amplifier with its gain. Signals of the rest of the
board have global labels.
"""

from __future__ import annotations

from taction.netlist_gen.board.channel import Channel
from taction.netlist_gen.board.circuit import GROUND as GROUND_NODE
from taction.netlist_gen.board.circuit import Resistor
from taction.netlist_gen.kicad.parts import Catalogue
from taction.netlist_gen.kicad.sheet import Part, Sheet
from taction.netlist_gen.kicad.stages import LEVEL, LONGEST, RUNG, Stages
from taction.netlist_gen.kicad.symbols import GROUND, Point
from taction.netlist_gen.scene.scene import Scene

LEFT, TOP = 12, 14  # of the drawing, in steps of the grid
TITLE = 2.0  # height of a title, mm


def channel_sheet(channel: Channel, scene: Scene) -> Sheet:
    """Draw a channel of the board of `scene` with its row; every part has its name in the deck."""
    return _Drawing(channel, scene).draw()


class _Drawing:
    def __init__(self, channel: Channel, scene: Scene) -> None:
        self.channel, self.circuit = channel, channel.circuit
        self.sheet = Sheet(f"{scene.name}-channel-{channel.n}")
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
        self._supplies((self.width + 22, TOP))
        return self.sheet

    def _title(self, y: float, text: str) -> int:
        self.sheet.text(text, (LEFT, y), size=TITLE)
        return int(y)

    def _end(self, point: Point) -> None:
        self.width = max(self.width, round(point[0]))

    def _signal_row(self, at: Point) -> int:
        """Draw the feedback resistors, the signal node and its amplifier; return the next row."""
        channel, n = self.channel, self.channel.n
        rungs = [
            (each.a, self.catalogue.resistor(each)) for each in channel.rungs(channel.feedback)
        ]
        bias = channel.resistor(f"bias_{n}")
        if bias is not None:
            rungs.append((bias.a, self.catalogue.resistor(bias)))
        node = self.stages.ladder(at, rungs)
        passive = self.circuit.topology == "passive"
        output = self._passive_node(node) if passive else self._integrator(node)
        self._end(self._amplifier(output))
        return _below(at, len(rungs))

    def _integrator(self, at: Point) -> Point:
        n = self.channel.n
        parts = (self.channel.resistor(f"r_{n}"), self.channel.capacitor(f"c_{n}"))
        x, y = at
        start = self.sheet.wire(at, (x + 4, y))
        return self.stages.summing(start, self.stages.cell_of(f"v_{n}"), parts)

    def _passive_node(self, at: Point) -> Point:
        """Draw R and C to ground, and the buffer of a linear board."""
        n, (x, y) = self.channel.n, at
        self.sheet.name(f"v_{n}", (x + 1, y))
        parts = (self.channel.resistor(f"r_{n}"), self.channel.capacitor(f"c_{n}"))
        for place, part in zip((x + 6, x + 18), parts, strict=True):
            if part is not None:
                drawn = self.stages.down(self.catalogue.part(part), (place, y + 6))
                self.sheet.wire((place, y), drawn.pin(0))
                self.stages.port(GROUND, drawn.pin(1))
        end = self.sheet.wire(at, (x + 34, y))
        buffer = self.channel.opamp(f"u_{n}")
        if buffer is None or buffer.noninverting != f"v_{n}":
            return end
        drawn = self.stages.cell(buffer, (end[0] + 8, y - 2))
        self.sheet.wire(end, drawn.pin(1))
        left, right = drawn.pin(0), drawn.pin(2)
        self.sheet.wire(left, (left[0], y - 10), (right[0] + 2, y - 10), (right[0] + 2, right[1]))
        return self.sheet.wire(right, (right[0] + 2, right[1]))

    def _amplifier(self, at: Point) -> Point:
        """Draw the signal amplifier after the signal node, and an inverter where there is one."""
        channel, n = self.channel, self.channel.n
        amplifier = channel.amplifier
        if channel.transistors:
            return self.stages.out(at, f"v_{n}")
        if amplifier is None:
            return self._with_inverter(at, self.circuit.outputs[n - 1].node, f"a_{n}")
        self.sheet.name(f"v_{n}", (at[0] + 1, at[1]))
        part = self.catalogue.function(amplifier)
        x, y = at[0] + 20, at[1]
        drawn = self.sheet.place(part, (x, y), reference=(x, y - 5.2), value=(x, y + 5.2))
        self.sheet.text("ideal: no part", (x, y), middle=True)
        self.sheet.wire(at, drawn.pin(0))
        return self._with_inverter(drawn.pin(1), amplifier.output, f"u_{n}")

    def _with_inverter(self, at: Point, signal: str, inverted: str) -> Point:
        if self.channel.resistor(f"{inverted}_in") is None:
            return self.stages.out(at, signal)
        return self.stages.inverter(self.stages.tap(at, signal), inverted)

    def _antilog_row(self, at: Point) -> int:
        """Draw the divider with the pair, the reference op-amp and the output op-amp."""
        channel, n = self.channel, self.channel.n
        x, y = at
        reference, emitter = (self._part(f"{head}_{n}") for head in ("ref", "em"))
        node = self.stages.ladder(at, [(self.stages.catalogue_resistor(f"ref_{n}").a, reference)])
        start = self.sheet.wire(node, (node[0] + 4, y))
        drive = self.stages.summing(
            start, self.stages.cell_of(f"d_{n}"), [channel.capacitor(f"ref_{n}")]
        )
        self.sheet.name(f"d_{n}", (drive[0] + 1, drive[1]))
        drawn = self.stages.across(emitter, (drive[0] + 10, drive[1]))
        self.sheet.wire(drive, drawn.pin(0))
        self.sheet.name(f"e_{n}", self.sheet.wire(drawn.pin(1), (drawn.pin(1)[0] + 4, drive[1])))
        output = channel.transistors[1].collector
        cell = next(each for each in self.circuit.opamps if each.inverting == output)
        begin = (drawn.pin(1)[0] + 12, y)
        parts = (channel.resistor(f"out_{n}"), channel.capacitor(f"out_{n}"))
        end = self.stages.summing(begin, cell, parts)
        inverted = {"u": "a", "a": "u"}[cell.output[0]]
        self._end(self._with_inverter(end, cell.output, f"{inverted}_{n}"))
        self._pair((x + 9, y + 20))
        return round(y) + 42

    def _part(self, name: str) -> Part:
        return self.catalogue.resistor(self.stages.catalogue_resistor(name))

    def _pair(self, at: Point) -> None:
        """Draw the divider of v and the pair, whose collectors have the names of their nodes."""
        n, (x, y) = self.channel.n, at
        first, second = self.channel.transistors
        self.sheet.signal(f"v_{n}", at, output=False)
        drawn = self.stages.across(self._part(f"div_{n}"), (x + 8, y))
        self.sheet.wire(at, drawn.pin(0))
        base = self.stages.down(self._part(f"base_{n}"), (x + 16, y + 4))
        self.sheet.wire(drawn.pin(1), (x + 16, y), base.pin(0))
        self.stages.port(GROUND, base.pin(1))
        self.sheet.name(f"b_{n}", self.sheet.wire((x + 16, y), (x + 22, y)))
        left, right = x + 44, x + 56
        for cell, unit, place, mirrored in ((first, 1, left, False), (second, 2, right, True)):
            part, out = self.catalogue.transistor(n, unit), 4 if mirrored else -4
            aside = place + 1.2 * out
            self.sheet.text(f"Q{cell.name}", (aside, y - 6.2), middle=True)
            texts = (aside, y - 4.4), (aside, y - 2.6)
            placed = self.sheet.place(
                part, (place, y), mirrored=mirrored, reference=texts[0], value=texts[1]
            )
            end, collector = placed.pin(0), placed.pin(1)
            if cell.base == GROUND_NODE:
                self.stages.port(GROUND, self.sheet.wire(end, (end[0], y + 6)))
            else:
                wide = self.sheet.wire(end, (end[0] + out, y))
                self.sheet.name(cell.base, wide)
            up = -1 if collector[1] < y else 1
            self.sheet.name(
                cell.collector, self.sheet.wire(collector, (collector[0], collector[1] + 2 * up))
            )
            emitter = placed.pin(2)
            middle = ((left + right) // 2, emitter[1] - 2 * up)
            self.sheet.wire(emitter, (emitter[0], middle[1]), middle)
        self.sheet.name(first.emitter, middle)

    def _constraint_row(self, at: Point) -> None:
        channel, k = self.channel, self.channel.k
        rungs = [(each.a, self.catalogue.resistor(each)) for each in channel.rungs(channel.forward)]
        if channel.strain is not None:
            rungs.append(("", self.catalogue.strain(channel.strain)))
        x, y = self.stages.ladder(at, rungs)
        start = self.sheet.wire((x, y), (x + 4, y))
        gain: list[Resistor | None] = [channel.resistor(f"s_{k}")]
        output = self.stages.summing(start, self.stages.cell_of(f"w_{k}"), gain)
        self._end(self._with_inverter(output, f"w_{k}", f"z_{k}"))
        self.sheet._reach((x, _below(at, len(rungs))))

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
