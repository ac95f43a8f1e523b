"""A page with every block and every kind of chart, in known numbers."""

from __future__ import annotations

import numpy as np

from taction.netlist_gen.kicad.drawing import Strokes
from taction.system.charts import (
    Axis,
    Band,
    Cells,
    Chart,
    Columns,
    Curve,
    Grid,
    Limit,
    Text,
    View,
    looks_of,
    segments,
    spread_colours,
)
from taction.verification.report.blocks import (
    PAGE,
    Bar,
    Bars,
    Block,
    Cell,
    Code,
    Drawing,
    Facts,
    Notes,
    Page,
    Section,
    Table,
)
from taction.verification.report.views.waveforms_view import end_names

EVERYWHERE = "terminal page notebook"

STROKES = Strokes([[(0.0, 0.0), (9.0, 9.0)]], [((1.0, 1.0), 2.0, True)], [])


def charts() -> dict[str, Chart]:
    """Return a chart of every kind by its name."""
    time = np.linspace(0.0, 1e-4, 201)
    records = [target * (1.0 - np.exp(-time / 1e-5)) for target in (0.1, 0.101, -0.05)]
    colours = spread_colours(3)
    outputs = (
        *(
            Curve(time, record, f"u{n}", look, label="", line="dash" if n == 3 else "solid")
            for n, (record, look) in enumerate(zip(records, colours, strict=True), 1)
        ),
        *end_names([float(record[-1]) for record in records], -0.06, 0.12, colours),
        Curve(time, records[2], "second engine", colours[2], "", "circle-open"),
        Limit(4e-5, "x", "settled", "ink"),
        Band(-0.01, 0.01, "y", "band of 1 %"),
    )  # fmt: skip
    decades = np.geomspace(1e-12, 1e-9, 7)
    ohms = np.geomspace(1e3, 1e5, 5)
    rates = np.log10(decades * 1e11)[None, :] * np.log10(ohms / 1e2)[:, None] * 1e4
    words = np.where(rates > 0.0, "pass", "fail: stability").astype(object)
    words[0, 0], words[1, 0], words[2, 0] = "", "inconclusive: rise time", "error: TimedOut"
    looks = looks_of(words.ravel().tolist())
    plane = Axis("C", "F", "log"), Axis("gain", "ohm", "log")
    edge = segments([((1e-11, 1e3), (1e-11, 1e5))])
    poles = np.array([-2e5 + 3e5j, -1e4 + 8e5j, 3e4 + 5e5j])
    steps = np.array([3e-4, -1e-4, 5e-5])
    return {
        "waveforms": Chart(
            "Outputs", Axis("time", "s"), Axis("output", "V"), outputs,
            "Three outputs over time.",
            (View("first rise", (0.0, 5e-5)), View("everything", (0.0, 1e-4), (-0.06, 0.12))),
        ),
        "deviation": Chart(
            "Deviation", Axis("time", "s"), Axis("deviation", "step", limits=(-0.06, 0.06)),
            (Band(-0.01, 0.01, "y"), Curve(time, 0.05 * np.exp(-time / 1e-5), "u1")),
            summary="The deviation in per cent of the step.",
        ),
        "poles": Chart(
            "Pole map", Axis("real part", "1/s"), Axis("frequency", "Hz"),
            (Band(0.0, 1e5, "x", colour="fail"), Limit(0.0),
             Curve(poles.real[:2], poles.imag[:2] / 6.28, "decays", "pass", "", "circle"),
             Curve(poles.real[2:], poles.imag[2:] / 6.28, "grows", "fail", "", "x"),
             Curve([0.0, -4e5], [0.0, 1.3e5], "", "band", "solid", behind=True),
             Text("grows →", None, None, ("left", "above"), "muted")),
            "Three poles.",
        ),
        "values": Chart(
            "Growth rate", *plane,
            (Grid(decades, ohms, rates, "1/s", "signed"),
             Curve(*edge, "edge of stability", "ink", width=2.5)),
            summary="Rates over two axes.", legend=False,
        ),
        "results": Chart(
            "Outcome", *plane,
            (Cells(decades, ohms, words, looks),
             Curve(*edge, "edge of stability", "ink", width=2.5)),
            summary="Results over two axes.",
        ),
        "shares": Chart(
            "Worst value", Axis("C", scale="names", names=("1 pF", "10 pF")),
            Axis("gain", scale="names", names=("1 kΩ", "10 kΩ")),
            (Grid([0, 1], [0, 1], [[0.2, 3.0], [0.9, np.nan]], "ratio", "share", (0.1, 10.0),
                  written=(("0.2", "3"), ("0.9", ""))),),
            summary="Shares of a limit.",
        ),
        "histogram": Chart(
            "Settling time", Axis("settling time", "s"), Axis("samples", whole=True),
            (Columns([1e-5, 2e-5, 3e-5], [4.0, 9.0, 2.0], widths=[1e-5] * 3, name="samples",
                     looks=("pass", "pass", "fail")), Limit(2.5e-5, "x", "limit")),
            summary="Fifteen samples.",
        ),
        "waterfall": Chart(
            "Waterfall", Axis("error", "V"),
            Axis(scale="names", names=("op-amps", "strays", "whole"), reverse=True),
            (Columns([0, 1, 2], [*steps[:2], steps[0] + steps[1]], "y",
                     looks=("pass", "fail", "band")),),
            summary="Parts of an error.", legend=False,
        ),
        "work": Chart(
            "Error against run time", Axis("wall time", "s", "log"), Axis("error", "step", "log"),
            (Curve([0.1, 1.0, 10.0], [1e-2, 1e-4, 1e-6], "order 2", "#009e73", mark="square"),
             Curve([0.1, 10.0], [1e-3, 1e-5], "fit", "#cc79a7", "dot")),
            summary="Errors of three runs.",
        ),
    }  # fmt: skip


def gallery() -> Page:
    """Return a page with every block, everywhere."""
    blocks: tuple[Block, ...] = (
        Table(
            "Channels", ("channel", "state", "target", "why"),
            (
                (Cell("u1", 1.0), Cell("settled", None, "pass"), Cell("12.3 µV", 12.3e-6),
                 Cell("")),
                (Cell("u2", 2.0), Cell("grows", None, "fail"), Cell("–"),
                 Cell("a mode grows with 23.1 k/s at 49 kHz")),
            ),
            "in SI units",
        ),
        Bars(
            "Checks",
            (
                Bar("overshoot", "pass", 0.25, 0.02, "10 % ± 1 %", "at most 40 %"),
                Bar("rise time", "fail", 2.0, 0.0, "2 µs", "at most 1 µs", "u1 is slow"),
                Bar("stability", "inconclusive", None, 0.0, "–", "", "a pole is near the axis"),
            ),
        ),
        Facts("Board", (("R", "10 kΩ"), ("channels", "3"))),
        Code("deck", "* a board\nR1 a b 1e4"),
        Notes("Warnings", ("the record ends early",), "fail"),
        Drawing("Cell", STROKES, "a cell"),
        *charts().values(),
    )  # fmt: skip
    return Page(
        "gallery", "taction gallery", "fail", "1 of 3 checks fails.", ("3 channels",),
        (Section("Everything", blocks, "Every block.", EVERYWHERE),), ("made in 1 s",),
    )  # fmt: skip


def drawn_blocks() -> list[Block]:
    """Return every chart and the two other blocks of pictures."""
    found = [*charts().values()]
    bars = next(b for b in gallery().sections[0].made(PAGE) if isinstance(b, Bars))
    return [*found, bars, Notes("Nothing", ("No sample stands out.",))]
