"""The seven-channel breadboard: its three numbers, figure 10, and the limits of its speed."""

from __future__ import annotations

import math

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.charts import SERIES, Axis, Chart, Curve
from taction.system.waveforms import Waveforms
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.engines.ngspice.process import simulate
from taction.verification.evidence.paper.constraint_stage import constraint_plane
from taction.verification.evidence.paper.findings import (
    Chapter,
    Finding,
    finding,
    paper_scene,
    seconds,
    weigh,
)
from taction.verification.evidence.paper.pictures import Picture, level, panel, picture
from taction.verification.stability.margin import find_margin
from taction.verification.studies.onset.onset import onset
from taction.verification.verdict.verify import Effort, Verdict, verify

CENTRE = 3  # channel 4 of 7
NEXT_E12 = 8.2e-12  # F, the E12 value below 10 pF
ONSET_RANGE = "C=8.8pF:10pF:5"
RECORD, STEP = 1.5e-3, 0.2e-6  # s
WINDOW_STARTS = (0.3e-3, 0.7e-3, 1.1e-3)  # s, of the three windows that show the ringing
WINDOW = 0.4e-3  # s
STABLE_CAPACITANCE = 20e-12  # F, above every onset of oscillation that is searched
ABOUT = 0.1  # relative difference that a printed "about" allows


def breadboard(quick: bool) -> Chapter:
    """Judge section 4.2.1 by ngspice on the scene that was fitted to its numbers."""
    scene = paper_scene("paper-breadboard")
    verdict = verify(scene)
    deck = write_deck(verdict.circuit.turned("C", NEXT_E12), Transient(RECORD, STEP),
                      saved=[f"v_{CENTRE + 1}"])  # fmt: skip
    unstable = simulate(deck, find_simulator(), timeout=120.0)
    findings = (
        *_constraint(verdict.circuit),
        _rise(verdict),
        _oscillation(scene, unstable),
        _convergence(verdict),
        _faster(scene),
        _negligible(scene),
    )
    return Chapter(findings, (_figure_10(verdict, unstable),))


def _constraint(circuit: Circuit) -> tuple[Finding, Finding]:
    plane = constraint_plane(circuit)
    amplifier, stage = plane.amplifier_rise_time, plane.stage_rise_time or 0.0
    about_1us = weigh(abs(amplifier - 1e-6) <= ABOUT * 1e-6, fitted=True)
    slower = weigh(stage > amplifier, fitted=True)
    return (
        finding("constraint-rise", {"rise_time": amplifier}, about_1us),
        finding("constraint-loaded", {"rise_time": stage}, slower, ratio=stage / amplifier),
    )


def _rise(verdict: Verdict) -> Finding:
    centre = verdict.measurements.channels[CENTRE]
    rise_time = seconds(centre.rise_time)
    values = {"rise_time": rise_time, "overshoot": centre.overshoot}
    outcome = weigh(abs(rise_time - 10e-6) <= ABOUT * 10e-6, fitted=True)
    return finding("figure-10", values, outcome, simulator=verdict.waveforms.engine)


def _oscillation(scene: Scene, unstable: Waveforms) -> Finding:
    crossings = onset(scene, over=ONSET_RANGE).findings
    highest = max((each.crossing.value for each in crossings), default=math.nan)
    confirmed = all(each.confirmation.confirmed for each in crossings)
    u, time = unstable[f"v_{CENTRE + 1}"], unstable.time
    heights = [
        float(np.ptp(u[(time > start) & (time < start + WINDOW)])) for start in WINDOW_STARTS
    ]
    grows = heights[-1] > 1.3 * heights[0]
    return finding(
        "oscillation",
        {"onset": highest, "first_height": heights[0], "last_height": heights[-1]},
        weigh(NEXT_E12 < highest < 10e-12 and confirmed and grows, fitted=True),
        confirmed="confirmed" if confirmed else "not confirmed",
        heights=heights,
        simulator=unstable.engine,
    )


def _convergence(verdict: Verdict) -> Finding:
    settling = seconds(verdict.measurements.settling_time)
    damped = verify(paper_scene("tuned-breadboard"), effort=Effort(details=False))
    values = {
        "settling_time": settling,
        "settling_time_damped": seconds(damped.measurements.settling_time),
    }
    return finding("convergence-10us", values, weigh(settling <= 20e-6, True))


def _faster(scene: Scene) -> Finding:
    """Double every op-amp's poles, alone and with half the capacitance at the summing nodes."""
    opamp, stray = scene.design.opamp, scene.design.stray_capacitance
    fast = {
        "design.opamp.gbw": 2.0 * (opamp.gbw or 0.0),
        "design.opamp.second_pole": 2.0 * (opamp.second_pole or 0.0),
    }
    light = {
        "design.stray_capacitance": 0.5 * stray,
        "design.opamp.input_capacitance": 0.5 * (opamp.input_capacitance or 0.0),
    }
    edge, edge_fast, edge_both = (
        _edge(with_values(scene, changes)) for changes in ({}, fast, {**fast, **light})
    )
    values = {"edge": edge, "edge_fast_opamps": edge_fast, "edge_both": edge_both}
    return finding("faster-opamps", values, weigh(edge_fast < 0.75 * edge, edge_both < 0.6 * edge))


def _edge(scene: Scene) -> float:
    """Return the largest C below which the board oscillates, F."""
    scene = with_values(scene, {"design.capacitance": STABLE_CAPACITANCE})
    return STABLE_CAPACITANCE / find_margin(synthesise(scene, make_problem(scene))).factor


def _negligible(scene: Scene) -> Finding:
    """Compare the board with the ideal network, which has no constraint-plane dynamics."""
    differences = {}
    for name, farads in {"at_10pF": 10e-12, "at_1nF": 1e-9, "at_100nF": 100e-9}.items():
        slow = with_values(scene, {"design.capacitance": farads, "analysis.engine": "statespace"})
        verdict = verify(slow, effort=Effort(details=False))
        settling = seconds(verdict.measurements.settling_time)
        differences[name] = abs(settling / verdict.ideal.settling_time - 1.0)
    outcome = weigh(differences["at_100nF"] < 0.02 and differences["at_10pF"] > 1.0)
    shown = list(differences.values())
    return finding("slow-signal-plane", differences, outcome, differences=shown)


def _figure_10(verdict: Verdict, unstable: Waveforms) -> Picture:
    target, node = verdict.measurements.channels[CENTRE].target, f"v_{CENTRE + 1}"
    at_target, levels = {target: "target"}, {0.1 * target: "10 %", 0.9 * target: "90 %"}
    stable = verdict.waveforms.time, verdict.u[:, CENTRE]
    oscillating = unstable.time, unstable[node]
    caption = (
        "Figure 10 by ngspice at 10 pF, the ringing that follows, and the same board with 8.2 pF."
    )
    charts = (
        _output("C = 10 pF: the rise", *stable, 60e-6, levels),
        _output("C = 10 pF: the ringing", *stable, 1e-3, at_target),
        _output("C = 8.2 pF", *oscillating, 1e-3, at_target, SERIES[3]),
    )
    return picture(caption, *charts)


def _output(
    title: str, time: Floats, u: Floats, end: float, levels: dict[float, str], look: str = SERIES[0]
) -> Chart:
    """Return the centre output up to `end`, s, with labelled levels, V."""
    shown = time <= end
    lines = (level(value, text, k) for k, (value, text) in enumerate(levels.items(), 1))
    axes = Axis("time", "s"), Axis("centre output", "V")
    return panel(title, *axes, Curve(time[shown], u[shown], colour=look, width=0.6), *lines)
