"""The schematic of one channel and of one sensor row, with the values of the board."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from netlist_gen.board.circuit import Circuit
from verification.report.html.blocks import Drawing
from verification.report.html.texts import quantity

COLOUR = "currentColor"  # of the page, in both themes


@dataclass(frozen=True, slots=True)
class _Example:
    """Channel `n` and row `k`, from 1: the middle channel and its largest entry of T."""

    circuit: Circuit
    n: int
    k: int

    @classmethod
    def of(cls, circuit: Circuit) -> _Example:
        ohms = circuit.matrices[0].ohms
        n = (ohms.shape[1] - 1) // 2
        if not np.isfinite(ohms[:, n]).any():
            n = int(np.flatnonzero(np.isfinite(ohms).any(axis=0))[0])
        return cls(circuit, n + 1, 1 + int(np.argmin(ohms[:, n])))

    def ohms(self, name: str) -> float | None:
        """Return the value of a resistor; None if the board has no such resistor."""
        return next((r.ohms for r in self.circuit.resistors if r.name == name), None)

    def resistor(self, name: str) -> str:
        """Return a resistor's name and value."""
        return f"R{name}\n{quantity(self.ohms(name), 'ohm')}"

    @property
    def farads(self) -> float:
        """C of the channel."""
        return next(c.farads for c in self.circuit.capacitors if c.name == f"c_{self.n}")

    @property
    def entry(self) -> float:
        """The matrix resistor, ohm."""
        return float(self.circuit.matrices[0].ohms[self.k - 1, self.n - 1])

    @property
    def negative(self) -> bool:
        """Whether the entry of T is negative."""
        return bool(self.circuit.matrices[0].negative[self.k - 1, self.n - 1])

    @property
    def opamp(self) -> str:
        """Name of the op-amp's model."""
        return next(iter(self.circuit.models))

    @property
    def current(self) -> float | None:
        """Strain current of the row, A; None without one."""
        name = f"eps_{self.k}"
        return next((c.amps for c in self.circuit.currents if c.name == name), None)

    def count(self) -> tuple[int, int]:
        """Return the numbers of matrix resistors into the channel and into the row."""
        present = np.isfinite(self.circuit.matrices[0].ohms)
        return int(present[:, self.n - 1].sum()), int(present[self.k - 1].sum())


def schematic(circuit: Circuit) -> Drawing:
    """Return the drawing of the middle channel and the sensor row that it drives most.

    Examples
    --------
    >>> import taction
    >>> board = taction.synthesise(taction.load_scene("scenes/paper-breadboard.toml"))
    >>> "1.9 MΩ" in schematic(board).svg
    True
    """
    import schemdraw

    example = _Example.of(circuit)
    schemdraw.use("svg")
    drawing = schemdraw.Drawing(show=False, canvas="svg")
    drawing.config(unit=2.2, fontsize=11, color=COLOUR, bgcolor="none", lw=1.5)
    passive = circuit.topology == "passive"
    output = (_passive_node if passive else _integrator)(drawing, example)
    _stage(drawing, example, output)
    _row(drawing, example)
    svg = drawing.get_imagedata("svg").decode()
    return Drawing("One channel", svg[svg.index("<svg") :], _summary(example))


def _summary(example: _Example) -> str:
    into, row = example.count()
    scalings = example.circuit.scalings
    return (
        f"Channel {example.n} with sensor row {example.k}, one of {into} resistors into the channel"
        f" and of {row} resistors into the row. C = {quantity(example.farads, 'F')}, gain s ="
        f" {quantity(scalings.gain, 'ohm')}, matrix resistor {quantity(example.entry, 'ohm')}"
        f" (T is {'negative' if example.negative else 'positive'}), op-amps {example.opamp}."
        " Stray capacitances are not drawn."
    )


def _opamp(drawing: Any, place: tuple[float, float], name: str) -> Any:
    import schemdraw.elements as elm

    cell = drawing.add(elm.Opamp(leads=True).anchor("in1").at(place))
    drawing.add(elm.Line().down(0.5).at(cell.in2))
    drawing.add(elm.Ground(lead=False))
    drawing.add(elm.Label().at((cell.center[0] - 0.15, cell.center[1])).label(name, fontsize=9))
    return cell


def _over(drawing: Any, cell: Any, part: Any, text: str, height: float) -> None:
    """Draw a part from the output of an op-amp over it to its inverting input."""
    import schemdraw.elements as elm

    left, right, level = cell.in1[0], cell.out[0], cell.in1[1] + height
    drawing.add(elm.Line().at(cell.in1).to((left, level)))
    drawing.add(part.at((left, level)).to((right, level)).label(text, fontsize=10, ofst=0.12))
    drawing.add(elm.Line().at((right, level)).to(cell.out))


def _source(example: _Example, *, feedback: bool) -> str:
    """Return the node that drives the matrix resistor of the example."""
    matrix = example.circuit.matrices[1 if feedback else 0]
    place = example.k if feedback else example.n
    nodes = matrix.minus if example.negative else matrix.plus
    return nodes[place - 1]


def _integrator(drawing: Any, example: _Example) -> Any:
    import schemdraw.elements as elm

    n, k = example.n, example.k
    name = f"Rb_{k}_{n}\n{quantity(example.entry, 'ohm')}"
    start = drawing.add(elm.Dot(open=True).at((0, 0)).label(_source(example, feedback=True), "left"))
    drawing.add(elm.Resistor().right().at(start.center).label(name, fontsize=10))
    node = drawing.add(elm.Dot().label(f"x_{n}", "bottom", fontsize=9))
    biased = example.ohms(f"bias_{n}")
    if biased is not None:
        drawing.add(elm.Line().down(1.3).at(node.center))
        text = f"Rbias_{n}\n{quantity(biased, 'ohm')}"
        drawing.add(elm.Resistor().left().label(text, "bottom", fontsize=10))
        drawing.add(elm.Dot(open=True).label(f"Ve = {_volts(example)}", "left"))
    cell = _opamp(drawing, (node.center[0] + 0.9, 0.0), f"v_{n}")
    drawing.add(elm.Line().at(node.center).to(cell.in1))
    _over(drawing, cell, elm.Resistor(), example.resistor(f"r_{n}"), 1.0)
    _over(drawing, cell, elm.Capacitor(), f"C_{n}\n{quantity(example.farads, 'F')}", 2.4)
    return cell.out


def _volts(example: _Example) -> str:
    return quantity(example.circuit.scalings.exponential_slope, "V")


def _passive_node(drawing: Any, example: _Example) -> Any:
    import schemdraw.elements as elm

    n, k = example.n, example.k
    name = f"Rb_{k}_{n}\n{quantity(example.entry, 'ohm')}"
    start = drawing.add(elm.Dot(open=True).at((0, 0)).label(_source(example, feedback=True), "left"))
    drawing.add(elm.Resistor().right().at(start.center).label(name, fontsize=10))
    node = drawing.add(elm.Dot().label(f"v_{n}", "top", fontsize=9))
    x = node.center[0]
    drawing.add(elm.Resistor().down().at(node.center).label(example.resistor(f"r_{n}"), "bottom", fontsize=10))
    drawing.add(elm.Ground())
    drawing.add(elm.Line().at(node.center).to((x + 1.4, 0)))
    text = f"C_{n}\n{quantity(example.farads, 'F')}"
    drawing.add(elm.Capacitor().down().at((x + 1.4, 0)).label(text, "bottom", fontsize=10))
    drawing.add(elm.Ground())
    drawing.add(elm.Line().right(1.2).at((x + 1.4, 0)))
    end = drawing.here
    if not example.circuit.amplifiers:  # a buffer, since the matrix must not load the node
        cell = drawing.add(elm.Opamp(leads=True).flip().anchor("in2").at(end))
        drawing.add(elm.Label().at((cell.center[0] - 0.15, cell.center[1])).label(f"u_{n}", fontsize=9))
        low = cell.in1[1] - 0.7
        drawing.add(elm.Line().at(cell.in1).to((cell.in1[0], low)))
        drawing.add(elm.Line().to((cell.out[0], low)))
        drawing.add(elm.Line().to(cell.out))
        return cell.out
    return end


def _stage(drawing: Any, example: _Example, output: Any) -> None:
    """Draw the signal amplifier: an inverter, or an amplifier with its own characteristic."""
    import schemdraw.elements as elm

    n, circuit = example.n, example.circuit
    dot = drawing.add(elm.Dot().at(output))
    amplifier = next((a for a in circuit.amplifiers if a.name == f"a_{n}"), None)
    if amplifier is None:
        drawing.add(elm.Label().at((output[0], output[1] - 0.45)).label(f"u_{n}", fontsize=10))
        if example.ohms(f"a_{n}_in") is not None:
            _inverter(drawing, example, dot.center, f"a_{n}")
        return
    drawing.add(elm.Line().right(0.6).at(dot.center))
    text = f"{amplifier.kind}\nu = {quantity(amplifier.u_scale, 'V')} g(v / {quantity(amplifier.v_scale, 'V')})"
    box = drawing.add(elm.RBox(w=3.6, h=1.5).anchor("W").label(text, "center", fontsize=10))
    drawing.add(elm.Line().right(0.6).at(box.E))
    dot = drawing.add(elm.Dot().label(f"a_{n} = -u_{n}", "top", fontsize=10))
    if example.ohms(f"u_{n}_in") is not None:
        _inverter(drawing, example, dot.center, f"u_{n}")


def _inverter(drawing: Any, example: _Example, place: Any, name: str) -> None:
    import schemdraw.elements as elm

    drawing.add(elm.Line().right(0.4).at(place))
    drawing.add(elm.Resistor().right().label(example.resistor(f"{name}_in"), fontsize=10))
    node = drawing.add(elm.Dot())
    cell = _opamp(drawing, (node.center[0] + 0.6, place[1]), name)
    drawing.add(elm.Line().at(node.center).to(cell.in1))
    _over(drawing, cell, elm.Resistor(), example.resistor(f"{name}_fb"), 1.0)
    sign = "-" if name.startswith("a") else "+"
    drawing.add(elm.Dot(open=True).at(cell.out).label(f"{name} = {sign}u_{example.n}", "right"))


def _row(drawing: Any, example: _Example) -> None:
    """Draw the constraint amplifier of the row below the channel, with its inverter."""
    import schemdraw.elements as elm

    n, k = example.n, example.k
    name = f"Rf_{k}_{n}\n{quantity(example.entry, 'ohm')}"
    level = -5.4
    source = _source(example, feedback=False)
    start = drawing.add(elm.Dot(open=True).at((0, level)).label(source, "left"))
    drawing.add(elm.Resistor().right().at(start.center).label(name, fontsize=10))
    node = drawing.add(elm.Dot().label(f"c_{k}", "top", fontsize=9))
    if example.current is not None:
        drawing.add(elm.Line().down(0.4).at(node.center))
        source_part = elm.SourceI().down().reverse().label(
            f"strain\n{quantity(example.current, 'A')}", "bottom", fontsize=10
        )
        drawing.add(source_part)
        drawing.add(elm.Ground())
    cell = _opamp(drawing, (node.center[0] + 0.9, level), f"w_{k}")
    drawing.add(elm.Line().at(node.center).to(cell.in1))
    _over(drawing, cell, elm.Resistor(), example.resistor(f"s_{k}"), 1.0)
    dot = drawing.add(elm.Dot().at(cell.out).label(f"w_{k}", "bottom", fontsize=10))
    if example.ohms(f"z_{k}_in") is not None:
        _inverter(drawing, example, dot.center, f"z_{k}")
