"""Pictures of the first page and of the glossary, drawn from real boards when the pages are built.

Every title says what the picture shows.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

import taction
from taction.verification.engines.statespace.linearised.board import LinearBoard

SCENES = Path(__file__).resolve().parents[1] / "scenes"
INK, GOOD, BAD, GREY = "#222222", "#0072b2", "#d55e00", "#808080"
SIZE = (6.4, 3.4)  # of a picture, inches


def panel(title: str) -> tuple[Figure, Any]:
    """Return a figure with one panel below its title."""
    figure = Figure(SIZE, layout="constrained")
    axes = figure.add_subplot()
    axes.set_title(title, fontsize=11, loc="left")
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def board() -> Figure:
    """Return the schematic of one channel of the paper's board."""
    figure: Figure = taction.synthesise(taction.load_scene(SCENES / "paper-breadboard.toml")).plot()
    return figure


def schematic_of(scene: str) -> Callable[[], Figure]:
    """Return what draws one channel of the board of a scene."""

    def drawn() -> Figure:
        figure: Figure = taction.synthesise(taction.load_scene(SCENES / f"{scene}.toml")).plot()
        return figure

    return drawn


def feedback() -> Figure:
    """Return the rightmost pole of a closed-loop board over its feedback conductance gf."""
    circuit = taction.synthesise(taction.load_scene(SCENES / "least-squares.toml"))
    over = np.geomspace(1e-4, 1e-2, 121)
    growth = np.array([rightmost(circuit.turned("gf", value)) for value in over.tolist()])
    best = int(growth.argmin())
    falling = slice(best + 1)
    edge = float(np.exp(np.interp(0.0, -growth[falling], np.log(over[falling]))))
    figure, axes = panel(
        f"gf decides stability and speed: {1e6 * edge:.0f} µS is the least, fastest at"
        f" {1e6 * over[best]:.0f} µS"
    )
    axes.axhspan(0.0, 1.3 * growth.max() / 1e6, color=BAD, alpha=0.12)
    axes.axhline(0.0, color=GREY, lw=0.8)
    axes.plot(over * 1e6, growth / 1e6, color=GOOD)
    axes.plot([edge * 1e6, over[best] * 1e6], [0, growth[best] / 1e6], "o", color=INK)
    axes.set_xscale("log")
    axes.set(xlabel="gf (µS)", ylabel="rightmost pole (1/µs)")
    axes.set_ylim(1.15 * growth.min() / 1e6, 1.3 * growth.max() / 1e6)
    return figure


def transresistance() -> Figure:
    """Return an amplifier of the constraint plane: a current in, a voltage out."""
    circuit = taction.synthesise(taction.load_scene(SCENES / "paper-breadboard.toml"))
    ohms = circuit.facts["gain"].value
    figure, axes = panel(
        f"Transresistance s: 1 nA at the input moves the output by {1e-6 * ohms:.3g} mV"
    )
    axes.axis("off")
    axes.set(xlim=(0, 10), ylim=(0, 6), aspect="equal")
    wires = (
        [(0.6, 5.4), (3.2, 3.2)], [(3.6, 3.6, 4.3), (3.2, 5.2, 5.2)],
        [(6.1, 8.4, 8.4), (5.2, 5.2, 2.6)], [(7.4, 9.4), (2.6, 2.6)],
        [(5.4, 4.7, 4.7), (2.0, 2.0, 1.2)], [(4.35, 5.05), (1.2, 1.2)],
        [(5.4, 5.4, 7.4, 5.4), (1.4, 3.8, 2.6, 1.4)],
        [(4.3, 6.1, 6.1, 4.3, 4.3), (4.95, 4.95, 5.45, 5.45, 4.95)],
    )  # fmt: skip
    for x, y in wires:
        axes.plot(x, y, color=INK, lw=1.4)
    axes.plot([3.6, 8.4], [3.2, 2.6], "o", color=INK, ms=4)
    axes.annotate(
        "", (2.9, 3.2), (1.3, 3.2), arrowprops={"arrowstyle": "->", "color": BAD, "lw": 2}
    )
    axes.text(0.0, 3.6, "current: G0 U0 (T u - eps)", color=BAD, fontsize=9)
    axes.text(5.2, 5.6, f"s = {ohms / 1e6:.4g} Mohm", ha="center", fontsize=10)
    axes.text(8.6, 2.85, "w", color=GOOD, fontsize=11)
    axes.text(5.55, 3.1, "-", fontsize=11)
    axes.text(5.55, 1.85, "+", fontsize=11)
    axes.text(
        0.6, 0.3, "size of w = s x current: s is the gain of the constraint plane", fontsize=9
    )
    return figure


def regularisation() -> Figure:
    """Return the answers of one noisy problem with three values of lambda."""
    n = 25
    place = np.arange(n)
    T = np.exp(-((place[:, None] - place[None, :]) ** 2) / 8.0)
    u = np.where((place > 6) & (place < 12), 1.0, 0.0)
    eps = T @ u + np.random.default_rng(3).normal(0.0, 0.1, n)
    figure, axes = panel("Lambda: too small follows the noise, too large flattens the answer")
    axes.plot(place, u, color=GREY, lw=5, alpha=0.5, label="true u")
    for lam, colour, line in ((1e-3, BAD, ":"), (0.3, GOOD, "-"), (100.0, INK, "--")):
        answer = taction.solve(taction.Scene.from_arrays(T, eps, lam=lam, name="lambda")).u
        axes.plot(place, answer, line, color=colour, label=f"lambda = {lam:g}")
    axes.set(xlabel="channel", ylabel="u", ylim=(-1.2, 2.2))
    axes.legend(frameon=False, fontsize=9, ncols=2)
    return figure


def settling() -> Figure:
    """Return an output of a damped board with the band that decides the settling time."""
    band = 0.01
    record = taction.simulate(SCENES / "known-readings.toml", engine="statespace")
    time, volts = record.waveforms.time, record.waveforms["v_2"]
    off = (volts - volts[-1]) / abs(volts[-1])
    last = time[np.flatnonzero(np.abs(off) > band)[-1] + 1]
    figure, axes = panel(
        f"Settling time to 1 %: {last * 1e6:.0f} µs, the last instant outside the band"
    )
    axes.axhspan(-100 * band, 100 * band, color=GREY, alpha=0.3, lw=0)
    axes.plot(time * 1e6, 100 * off, color=GOOD, label="output u2")
    axes.axvline(last * 1e6, color=BAD, ls="--")
    axes.text(last * 1e6, 5.0, " settled", color=BAD)
    axes.set(
        xlim=(0, 2.2e6 * last), ylim=(-10, 10),
        xlabel="time (µs)", ylabel="distance from the target (% of the step)",
    )  # fmt: skip
    axes.legend(frameon=False, fontsize=9, loc="lower right")
    return figure


def margin() -> Figure:
    """Return the rightmost pole of a damped board over C, and its margin."""
    scene = taction.load_scene(SCENES / "tuned-breadboard.toml")
    circuit, over = taction.synthesise(scene), np.geomspace(3.4e-12, 20e-12, 60)
    growth = np.array([rightmost(circuit.turned("C", farads)) for farads in over])
    found = taction.onset(scene, over={"C": ("2pF", "20pF", 13)}, transients=False)
    edge, own = found.findings[-1].crossing.value, circuit.facts["C"].value
    figure, axes = panel(
        f"Margin {own / edge:.2g}: C may shrink {own / edge:.2g} times until the board oscillates"
    )
    axes.axhspan(0, 1e9, color=BAD, alpha=0.12, lw=0)
    axes.plot(over * 1e12, growth / 1e3, color=GOOD)
    axes.plot([edge * 1e12, own * 1e12], [0, rightmost(circuit) / 1e3], "o", color=INK)
    axes.set_xscale("log")
    axes.set_xticks([4, 5, 10, 20], ["4", "5", "10", "20"])
    axes.minorticks_off()
    low, high = growth.min() / 1e3, growth.max() / 1e3
    axes.set(xlabel="C (pF)", ylabel="rightmost pole (1/ms)", ylim=(1.15 * low, 1.3 * high))
    place = (edge * 1e12, 0.12 * high)
    axes.annotate(
        "", (edge * 1e12, 0.3 * low), (own * 1e12, 0.3 * low),
        arrowprops={"arrowstyle": "->", "color": INK},
    )  # fmt: skip
    axes.text(place[0], place[1], f" oscillates below {edge * 1e12:.3g} pF", color=BAD)
    axes.text(own * 1e12, rightmost(circuit) / 1e3, "  this board", va="top")
    return figure


def rightmost(circuit: taction.Circuit) -> float:
    """Return the largest real part of the poles of a board, 1/s."""
    return float(np.linalg.eigvals(LinearBoard(circuit).state_space.A).real.max())


PICTURES: dict[str, Callable[[], Figure]] = {
    "board": board,
    "inverse": schematic_of("inverse"),
    "least-squares": schematic_of("least-squares"),
    "ridge": schematic_of("ridge"),
    "feedback-conductance": feedback,
    "transresistance": transresistance,
    "lambda": regularisation,
    "settling": settling,
    "margin": margin,
}


def draw(folder: Path) -> None:
    """Draw every picture into `folder`, as SVG; the same code gives the same bytes."""
    with mpl.rc_context({"svg.hashsalt": "taction"}):
        for name, make in PICTURES.items():
            make().savefig(folder / f"{name}.svg", metadata={"Date": None})


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
