"""The schematic of one channel and of one sensor row, with the values of the board."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taction.netlist_gen.board.channel import Channel
from taction.netlist_gen.board.circuit import Circuit
from taction.spice_models.presets import opamp_name
from taction.system.output_files import check_package
from taction.system.picture import figure_file
from taction.system.quantities import quantity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCHEMDRAW = ("schemdraw", "needs schemdraw: pip install 'taction[report]'")
PAGE = "currentColor"  # of the page, in both themes
SMALL = 10  # points
ROW = -5.6  # height of the sensor row below the channel


def schematic_svg(circuit: Circuit) -> str:
    """Return the drawing of the middle channel and the sensor row that it drives most, as SVG.

    Its colour is that of the page's text.

    Examples
    --------
    >>> import taction
    >>> board = taction.synthesise(taction.load_scene("scenes/paper-breadboard.toml"))
    >>> "1.9 MΩ" in schematic_svg(board)
    True
    """
    drawing = _drawing("svg", PAGE, Channel.of(circuit))
    svg: str = drawing.get_imagedata("svg").decode()
    return svg[svg.index("<svg") :]


def plot_schematic(circuit: Circuit, path: str | Path | None = None) -> Figure:
    """Draw the schematic of one channel as a figure; write it to `path`, if there is one.

    Raises
    ------
    InputError
        See `taction.system.picture.figure_file`; or schemdraw is not installed.
    """
    check_package(*SCHEMDRAW, "plot")
    title = f"{circuit.name}: one of {len(circuit.outputs)} channels"
    with figure_file(path, 11.0, 6.6, title) as figure:
        axes = figure.add_subplot(aspect="equal")
        axes.set_axis_off()
        example = Channel.of(circuit)
        drawing = _drawing(axes, "black", example)
        drawing.draw(show=False)
        figure.supxlabel("\n".join(textwrap.wrap(_summary(example), 120)), fontsize="small")
    return figure


def schematic_summary(circuit: Circuit) -> str:
    """Return in words what the schematic shows."""
    return _summary(Channel.of(circuit))


def _drawing(canvas: Any, colour: str, example: Channel) -> Any:
    import schemdraw

    if canvas == "svg":
        schemdraw.use("svg")
    drawing = schemdraw.Drawing(show=False, canvas=canvas)
    drawing.config(unit=2.4, fontsize=11, color=colour, bgcolor="none", lw=1.5, margin=0.6)
    passive = example.circuit.topology == "passive"
    output = (_passive_node if passive else _integrator)(drawing, example)
    _stage(drawing, example, output)
    _row(drawing, example)
    return drawing


def _summary(example: Channel) -> str:
    into, row = (len(example.rungs(m)) for m in (example.feedback, example.forward))
    gain = example.circuit.facts["gain"].text
    return (
        f"Channel {example.n} with sensor row {example.k}, one of {into} resistors into the channel"
        f" and of {row} resistors into the row. C = {quantity(example.farads, 'F')}, gain s ="
        f" {gain}, matrix resistor {quantity(example.entry, 'ohm')}"
        f" (T is {'negative' if example.negative else 'positive'}), op-amps"
        f" {opamp_name(next(iter(example.circuit.models)))}. Stray capacitances are not drawn."
    )


def _elements() -> Any:
    """Return the parts that can be drawn; the library's types are incomplete."""
    from schemdraw import elements

    return elements


def _put(drawing: Any, part: Any, name: str, value: str) -> Any:
    """Add a part with its name over it and its value under it."""
    return drawing.add(
        part.label(name, "top", fontsize=SMALL).label(value, "bottom", fontsize=SMALL)
    )


def _opamp(drawing: Any, place: tuple[float, float], name: str) -> Any:
    elm = _elements()
    cell = drawing.add(elm.Opamp(leads=True).right().anchor("in1").at(place))
    drawing.add(elm.Line().down(0.5).at(cell.in2))
    drawing.add(elm.Ground(lead=False))
    _text(drawing, name, cell.center[0] - 0.15, cell.center[1])
    return cell


def _text(drawing: Any, text: str, x: float, y: float) -> None:
    elm = _elements()
    drawing.add(elm.Label().at((x, y)).label(text, fontsize=SMALL))


def _over(drawing: Any, cell: Any, part: Any, name: str, value: str, height: float) -> None:
    """Draw a part from the output of an op-amp over it to its inverting input."""
    elm = _elements()
    left, right, level = cell.in1[0], cell.out[0], cell.in1[1] + height
    drawing.add(elm.Line().at(cell.in1).to((left, level)))
    _put(drawing, part.at((left, level)).to((right, level)), name, value)
    drawing.add(elm.Line().at((right, level)).to(cell.out))


def _matrix_resistor(drawing: Any, example: Channel, *, feedback: bool, level: float) -> Any:
    """Draw the matrix resistor from its driving node; return the place of its summing node."""
    elm = _elements()
    matrix = example.circuit.matrices[1 if feedback else 0]
    drive = example.k if feedback else example.n
    source = (matrix.minus if example.negative else matrix.plus)[drive - 1]
    start = drawing.add(elm.Dot(open=True).at((0, level)).label(source, "left"))
    name = f"{matrix.name}_{example.k}_{example.n}"
    _put(drawing, elm.Resistor().right().at(start.center), name, quantity(example.entry, "ohm"))
    sink = matrix.sinks[(example.n if feedback else example.k) - 1]
    return drawing.add(elm.Dot().label(sink, "top", fontsize=SMALL)).center


def _integrator(drawing: Any, example: Channel) -> Any:
    elm = _elements()
    n = example.n
    node = _matrix_resistor(drawing, example, feedback=True, level=0.0)
    biased = example.ohms(f"bias_{n}")
    if biased is not None:
        drawing.add(elm.Line().down(1.4).at(node))
        _put(drawing, elm.Resistor().left(), f"Rbias_{n}", quantity(biased, "ohm"))
        volts = quantity(example.circuit.value("Ve"), "V")
        drawing.add(elm.Dot(open=True).label(f"Ve = {volts}", "left"))
    cell = _opamp(drawing, (node[0] + 0.9, 0.0), f"v_{n}")
    drawing.add(elm.Line().at(node).to(cell.in1))
    value = quantity(example.ohms(f"r_{n}"), "ohm")
    _over(drawing, cell, elm.Resistor(), f"Rr_{n}", value, 1.5)
    _over(drawing, cell, elm.Capacitor(), f"Cc_{n}", quantity(example.farads, "F"), 3.1)
    return cell.out


def _passive_node(drawing: Any, example: Channel) -> Any:
    elm = _elements()
    n = example.n
    x, level = _matrix_resistor(drawing, example, feedback=True, level=0.0)
    parts = (
        (elm.Resistor(), f"Rr_{n}", quantity(example.ohms(f"r_{n}"), "ohm")),
        (elm.Capacitor(), f"Cc_{n}", quantity(example.farads, "F")),
    )
    for place, (part, name, value) in zip((x + 0.6, x + 3.2), parts, strict=True):
        text = f"{name}\n{value}"
        drawing.add(part.down().at((place, level)).label(text, "bottom", fontsize=SMALL))
        drawing.add(elm.Ground())
    drawing.add(elm.Line().right().at((x, level)).to((x + 4.6, level)))
    if example.circuit.amplifiers:
        return (x + 4.6, level)
    # A buffer, since the matrix must not load the node.
    cell = drawing.add(elm.Opamp(leads=True).right().flip().anchor("in2").at((x + 4.6, level)))
    _text(drawing, f"u_{n}", cell.center[0] - 0.15, cell.center[1])
    low = cell.in1[1] - 0.9
    drawing.add(elm.Line().at(cell.in1).to((cell.in1[0], low)))
    drawing.add(elm.Line().to((cell.out[0], low)))
    drawing.add(elm.Line().to(cell.out))
    return cell.out


def _stage(drawing: Any, example: Channel, output: Any) -> None:
    """Draw the signal amplifier: an inverter, or an amplifier with its own characteristic."""
    from schemdraw import flow

    elm = _elements()
    n, circuit = example.n, example.circuit
    place = drawing.add(elm.Dot().at(output)).center
    amplifier = next((a for a in circuit.amplifiers if a.name == f"a_{n}"), None)
    if circuit.transistors:
        kind, pair = circuit.amplifier, next(iter(circuit.transistor_models))
        scales = circuit.facts["U0"].text, circuit.facts["Ve"].text
        inverts = circuit.outputs[n - 1].sign < 0.0
        text = f"{kind} stage\n{pair}, 2 op-amps\nu = {scales[0]} exp(v / {scales[1]})"
    elif amplifier is not None:
        scales, inverts = (quantity(amplifier.u_scale, "V"), quantity(amplifier.v_scale, "V")), True
        text = f"{amplifier.kind}\nu = {scales[0]} g(v / {scales[1]})"
    else:
        _text(drawing, f"+u_{n}", place[0], place[1] - 0.5)
        if example.ohms(f"a_{n}_in") is not None:
            _inverter(drawing, example, place, f"a_{n}", f"a_{n} = -u_{n}")
        return
    drawing.add(elm.Line().right(0.6).at(place))
    box = drawing.add(flow.Box(w=4.6, h=2.2).anchor("W").label(text, "center", fontsize=SMALL))
    drawing.add(elm.Line().right(1.6).at(box.E))
    minus, plus = (f"a_{n}", f"a_{n} = -u_{n}"), (f"u_{n}", f"+u_{n}")
    (_, label), (name, inverted) = (minus, plus) if inverts else (plus, minus)
    place = drawing.add(elm.Dot().label(label, "top", fontsize=SMALL)).center
    if example.ohms(f"{name}_in") is not None:
        _inverter(drawing, example, place, name, inverted)


def _inverter(drawing: Any, example: Channel, place: Any, name: str, output: str) -> None:
    elm = _elements()
    drawing.add(elm.Line().right(0.4).at(place))
    values = [quantity(example.ohms(f"{name}_{end}"), "ohm") for end in ("in", "fb")]
    _put(drawing, elm.Resistor().right(), f"R{name}_in", values[0])
    node = drawing.add(elm.Dot())
    cell = _opamp(drawing, (node.center[0] + 0.6, place[1]), name)
    drawing.add(elm.Line().at(node.center).to(cell.in1))
    _over(drawing, cell, elm.Resistor(), f"R{name}_fb", values[1], 1.5)
    drawing.add(elm.Dot(open=True).at(cell.out).label(output, "right"))


def _row(drawing: Any, example: Channel) -> None:
    """Draw the constraint amplifier of the row below the channel, with its inverter."""
    elm = _elements()
    k = example.k
    node = _matrix_resistor(drawing, example, feedback=False, level=ROW)
    if example.strain is not None:
        drawing.add(elm.Line().down(0.4).at(node))
        text = f"strain\n{quantity(example.strain.amps, 'A')}"
        drawing.add(elm.SourceI().down().reverse().label(text, "top", fontsize=SMALL))
        drawing.add(elm.Ground())
    cell = _opamp(drawing, (node[0] + 0.9, ROW), f"w_{k}")
    drawing.add(elm.Line().at(node).to(cell.in1))
    value = quantity(example.ohms(f"s_{k}"), "ohm")
    _over(drawing, cell, elm.Resistor(), f"Rs_{k}", value, 1.5)
    place = drawing.add(elm.Dot().at(cell.out)).center
    _text(drawing, f"w_{k}", place[0], place[1] - 0.5)
    if example.ohms(f"z_{k}_in") is not None:
        _inverter(drawing, example, place, f"z_{k}", f"z_{k} = -w_{k}")
