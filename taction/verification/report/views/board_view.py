"""The board: numbers, the matrix, what was left out, parts, deck."""

from __future__ import annotations

import hashlib

import numpy as np

from taction.netlist_gen.board.bill_of_materials import bill_of_materials
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.kicad.board import channel_sheet
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import DEFAULT_RESISTANCE, Scene, opamp_words
from taction.spice_models.presets import opamp_name
from taction.system.array_types import Floats
from taction.system.charts import BLUE, GREY, Axis, Chart, Curve, Grid, Limit
from taction.system.quantities import counted, quantity, readable, sizes
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.report.blocks import Code, Content, Drawing, Page, Section, Table
from taction.verification.report.views.opamp_view import parts_content
from taction.verification.verdict.board_files import board_power
from taction.verification.verdict.verify import Verdict

WRITTEN = 12  # rows or columns up to which the entries are written into the chart
LARGEST = 160  # rows or columns of the chart of the matrix
REFERENCES = 12  # names of parts in a line
CHANNEL, SENSOR = Axis("channel", whole=True), Axis("sensor", whole=True, reverse=True)
OPAMP = {
    "gbw": ("gain-bandwidth product", "Hz"),
    "input_capacitance": ("input capacitance", "F"),
    "output_resistance": ("output resistance", "ohm"),
}
LONGEST = 400_000  # characters of a deck on a page


def board_lines(verdict: Verdict) -> tuple[str, ...]:
    """Return the size of the board and its numbers in one line each."""
    c = verdict.circuit
    rows, columns = c.shape
    numbers = ", ".join(f"{fact.symbol} = {fact.text}" for fact in c.facts.values())
    rule = f" (chosen by {verdict.scene.lambda_rule})" if verdict.scene.lambda_rule else ""
    return (
        f"{counted(columns, 'channel')}, {counted(rows, 'sensor')}, {c.amplifier} amplifiers,"
        f" topology {c.topology}, op-amps {', '.join(map(opamp_name, c.models))}",
        readable(f"{numbers}{rule}"),
    )


def board_blocks(circuit: Circuit, scene: Scene) -> tuple[Content, ...]:
    """Return the middle channel and the sensor row it drives most, the matrix, and the numbers."""
    n = circuit.shape[1] // 2
    ohms = circuit.forward_ohms[:, n]
    k = int(np.argmax(ohms <= ohms.min() * (1.0 + 1e-9)))  # the first of equal ones
    text = (
        f"Channel {n + 1} and sensor row {k + 1}. Of each matrix only the resistor between the two"
        " is drawn; stray capacitances and supplies are not."
    )
    drawing = Drawing("One channel", channel_sheet(circuit, scene, k, n).svg(), text)
    rows = {
        f"{opamp_name(name)}, {title}": quantity(getattr(model, figure), unit)
        for name, model in circuit.models.items()
        for figure, (title, unit) in OPAMP.items()
    }
    rows["supply"] = f"±{quantity(circuit.supply, 'V')}"
    level = "small signal" if circuit.is_small_signal else "large signal"
    return drawing, matrix_chart(circuit), rows | {"level of the op-amp models": level}


def _problem_charts(scene: Scene) -> list[Chart]:
    """Return the matrix of a problem with its signs, the strain, and the truth."""
    problem = make_problem(scene)
    rows, columns = problem.matrix.shape
    title = f"matrix T: eps = T u, {rows} sensors, {columns} channels"
    empty, entries = "an empty square has no resistor", (_entries(problem.matrix),)
    charts = [
        Chart(title, CHANNEL, SENSOR, entries, empty),
        _marks("strain eps: the input", "sensor", problem.strain, BLUE),
    ]
    if problem.stress is not None:
        title = "true stress u: what the board shall recover"
        charts.append(_marks(title, "channel", problem.stress, GREY))
    return charts


def scene_view(scene: Scene) -> Page:
    """Return the card of a scene, which reads no file, and its pictures."""
    design, rule = scene.design, scene.lambda_rule
    ohms = DEFAULT_RESISTANCE if design.resistance is None else design.resistance
    weight = {"R": quantity(ohms, "ohm")}
    if design.lam is not None:
        number = design.lam if isinstance(design.lam, str) else f"{design.lam:.4g}"
        weight = {"lambda": f"{number}, by {rule}" if rule else number}
    opamp = opamp_words(design.opamp)
    facts = {
        "problem": f"{scene.problem.kind} problem, {scene.problem.size}",
        "board": f"{design.topology}, {design.amplifier} amplifiers, op-amp {opamp}",
        "C": quantity(design.capacitance, "F"),
        "gain s": quantity(design.gain, "ohm"),
        **weight,
        "engine": scene.analysis.engine,
        "file": str(scene.file),
    }
    charts = Section("", lambda: _problem_charts(scene), media="page picture")
    return Page(scene.name, "", sections=(Section("", facts, media="page notebook"), charts))


def _marks(title: str, along: str, values: Floats, colour: str) -> Chart:
    x = np.arange(1.0, len(values) + 1.0)
    marks = Curve(x, values, "", colour, "", "circle"), Limit(0.0, "y", line="solid")
    return Chart(title, Axis(along, whole=True), Axis(), marks)


def matrix_chart(circuit: Circuit) -> Chart | str:
    """Return T as colours with signs: blue is negative, orange is positive; not of a large one."""
    T, ohms = circuit.realised, circuit.forward_ohms
    M, N = T.shape
    if max(M, N) > LARGEST:
        return f"The matrix has {M} rows and {N} columns: a picture has at most {LARGEST}."
    count, minus = int(np.isfinite(ohms).sum()), int((T < 0.0).sum())
    hover = tuple(
        tuple(f"T = {t:.4g}, {quantity(value, 'ohm')}" for t, value in zip(*pair, strict=True))
        for pair in zip(T.tolist(), ohms.tolist(), strict=True)
    )
    summary = (
        f"The matrix T of {counted(M, 'sensor')} and {counted(N, 'channel')} as the resistors"
        f" realise it: {count} entries, of which {minus} are negative (blue, with a minus); an"
        f" empty square has no resistor. The colour follows the square root of the size."
    )
    height = int(min(max(28 * len(T) + 110, 240), 620))
    return Chart("Matrix", CHANNEL, SENSOR, (_entries(T, hover),), summary, height=height)


def _entries(T: Floats, hover: tuple[tuple[str, ...], ...] = ()) -> Grid:
    """Return T with a colour for each entry that is not zero."""
    written: tuple[tuple[str, ...], ...] = ()
    if max(T.shape) <= WRITTEN:
        written = tuple(tuple(f"{t:+.2g}" if t else "" for t in row) for row in T.tolist())
    y, x = (1.0 + np.arange(count) for count in T.shape)
    return Grid(x, y, np.where(T == 0.0, np.nan, T), "", "signed", texts=hover, written=written)


def omissions(circuit: Circuit) -> Content:
    """Return the parts that the board omits."""
    if not circuit.omissions:
        return "Nothing was left out."
    columns = {"part": lambda each: readable(each.what), "why": lambda each: readable(each.why)}
    return Table.of("Parts that this scene does not need", circuit.omissions, columns)


def parts_blocks(circuit: Circuit, scene: Scene) -> tuple[Content, ...]:
    """Return the bill of materials with the packages and the power."""
    power = board_power(LinearBoard(circuit))
    return parts_content(bill_of_materials(circuit, scene), power, REFERENCES)


def deck_blocks(verdict: Verdict) -> tuple[Content, ...]:
    """Return the deck of the simulated board, to copy."""
    deck = write_deck(verdict.circuit, verdict.transient).text
    digest = {"SHA-256 of the deck": hashlib.sha256(deck.encode()).hexdigest()}
    size = f"{len(deck.splitlines())} lines"
    if len(deck) > LONGEST:
        many = f"The deck has {size}, too many for this page: taction netlist SCENE -o board.cir"
        return many, digest
    return Code(
        "the deck", deck, f"{size}; it runs with: ngspice -b -r board.raw board.cir"
    ), digest


def view(circuit: Circuit) -> Page:
    """Return the card of a board, with the facts that its topology states, and its picture."""
    entries = sum(int(np.isfinite(matrix.ohms).sum()) for matrix in circuit.matrices)
    parts = (
        counted(len(circuit.opamps), "op-amp"),
        counted(entries, "matrix resistor"),
        counted(len(circuit.resistors), "other resistor"),
        counted(len(circuit.capacitors), "capacitor"),
    )
    facts = {
        "size": sizes(len(circuit.outputs), len(circuit.constraint_nodes)),
        "board": f"{circuit.topology}, {circuit.amplifier} amplifiers",
        "op-amps": f"{', '.join(circuit.models)}, supply ±{quantity(circuit.supply, 'V')}",
        **{f"{fact.title} {fact.symbol}": fact.text for fact in circuit.facts.values()},
        "parts": ", ".join(parts),
        "left out": f"{counted(len(circuit.omissions), 'kind')} of parts that it does not need",
    }
    card = Section("Board", facts, media="notebook")
    drawn = Section("Matrix", lambda: matrix_chart(circuit), media="picture")
    return Page(circuit.name, "", sections=(card, drawn))
