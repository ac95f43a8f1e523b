"""The seven-channel breadboard: its three numbers, figure 10, and what limits its speed."""

from __future__ import annotations

import numpy as np

from netlist_gen.analysis import Transient
from netlist_gen.board.circuit import Circuit
from netlist_gen.board.synthesis import synthesise
from netlist_gen.deck.deck import write_deck
from netlist_gen.overrides.axes import with_values
from netlist_gen.problem.inverse_problem import make_problem
from netlist_gen.quantities import show
from netlist_gen.scene.scene import Scene
from verification.engines.ngspice.executable import find_simulator
from verification.engines.ngspice.process import simulate
from verification.pipeline.effort import Effort
from verification.small_signal.constraint_stage import constraint_plane
from verification.small_signal.margin import capacitance_margin, with_capacitance
from verification.studies.onset.onset import onset, parse_onset_axis
from verification.studies.paper.findings import (
    Chapter,
    Finding,
    Panel,
    Picture,
    curve,
    listed,
    paper_scene,
    percent,
    weigh,
)
from verification.verify import Verdict, verify
from verification.waveforms import Waveforms

SCENE = "paper-breadboard"
CENTRE = 3  # channel 4 of 7
NEXT = 8.2e-12  # the E12 value below 10 pF
AROUND_EDGE = "C=8.8pF:10pF:5"
RECORD, STEP = 1.5e-3, 0.2e-6
WINDOWS = (0.3e-3, 0.7e-3, 1.1e-3)  # beginnings of three windows in which ringing is measured
WIDTH = 0.4e-3
TOP = 20e-12  # above every edge of oscillation that is looked for
NEAR = 0.1  # relative difference within which a printed "about" counts as met


def breadboard(quick: bool) -> Chapter:
    """Judge section 4.2.1 by ngspice on the scene that was fitted to its numbers."""
    scene = paper_scene(SCENE)
    found = verify(scene)
    small = _transient(with_capacitance(found.circuit, NEXT))
    findings = (
        *_constraint(found),
        _rise(found),
        _oscillation(scene, small),
        _convergence(found),
        _faster(scene, found),
        _negligible(scene),
    )
    return Chapter(findings, (_figure_10(found, small),))


def _transient(circuit: Circuit) -> Waveforms:
    deck = write_deck(circuit, Transient(RECORD, STEP), saved=[f"v_{CENTRE + 1}"])
    return simulate(deck, find_simulator(), timeout=120.0)


def _constraint(found: Verdict) -> tuple[Finding, Finding]:
    plane = constraint_plane(found.circuit)
    alone = plane.amplifier_rise_time if plane else 0.0
    stage = plane.stage_rise_time if plane else 0.0
    return (
        Finding(
            "constraint-rise",
            "step of one constraint amplifier at its noise gain of 2.4, exact solution",
            f"{show(alone, 's')} (10 to 90 %)",
            weigh(abs(alone - 1e-6) <= NEAR * 1e-6),
            {"rise_time": alone},
        ),
        Finding(
            "constraint-loaded",
            "the same stage with its summing node's capacitance, 13 pF",
            f"{show(stage, 's')}, {stage / alone:.2g} times as long",
            weigh(stage > alone),
            {"rise_time": stage},
        ),
    )


def _rise(found: Verdict) -> Finding:
    reading = found.measurements.channels[CENTRE].rise_time
    value = float("nan") if reading is None else reading.value
    overshoot = found.measurements.channels[CENTRE].overshoot
    return Finding(
        "figure-10",
        f"scene {SCENE}, {found.waveforms.engine}",
        f"centre output {show(value, 's')} (10 to 90 %), overshoot {percent(overshoot)}",
        weigh(abs(value - 10e-6) <= NEAR * 10e-6),
        {"rise_time": value, "overshoot": overshoot},
    )


def _oscillation(scene: Scene, small: Waveforms) -> Finding:
    edges = onset(scene, parse_onset_axis(scene, AROUND_EDGE)).findings
    highest = max((each.crossing.value for each in edges), default=float("nan"))
    confirmed = all(each.confirmation.confirmed for each in edges)
    heights = _heights(small)
    grows = heights[-1] > 1.3 * heights[0]
    return Finding(
        "oscillation",
        f"poles over C = 8.8 to 10 pF with ngspice transients beside each crossing; {small.engine}"
        " at 8.2 pF",
        f"oscillates below {show(highest, 'F')}"
        f" ({'confirmed' if confirmed else 'not confirmed'} by transients); at 8.2 pF the ringing"
        f" is {listed(heights)} V peak to peak in three successive windows",
        weigh(8.2e-12 < highest < 10e-12 and confirmed and grows),
        {"onset": highest, "first_height": heights[0], "last_height": heights[-1]},
    )


def _heights(record: Waveforms) -> list[float]:
    """Peak-to-peak height of the centre output in three windows after the rise, V."""
    u = record[f"v_{CENTRE + 1}"]
    inside = [(record.time > start) & (record.time < start + WIDTH) for start in WINDOWS]
    return [float(np.ptp(u[window])) for window in inside]


def _convergence(found: Verdict) -> Finding:
    settling = found.measurements.settling_time
    value = float("inf") if settling is None else settling.value
    damped = verify(paper_scene("tuned-breadboard"), effort=Effort(details=False))
    other = damped.measurements.settling_time
    better = float("inf") if other is None else other.value
    return Finding(
        "convergence-10us",
        "the same transient until every output stays within 1 % of the step; scene"
        " tuned-breadboard, which rises as fast",
        f"1 % settling takes {show(value, 's')}, so close to the edge it rings that long; a"
        f" well-damped board with the same rise time takes {show(better, 's')}. Condition:"
        " convergence time means rise time",
        weigh(value <= 20e-6, True),
        {"settling_time": value, "settling_time_damped": better},
    )


def _faster(scene: Scene, found: Verdict) -> Finding:
    """Double every op-amp's poles, alone and with half the capacitance at the summing nodes."""
    opamp, stray = scene.design.opamp, scene.design.stray_capacitance
    quick = {
        "design.opamp.gbw": 2.0 * (opamp.gbw or 0.0),
        "design.opamp.second_pole": 2.0 * (opamp.second_pole or 0.0),
    }
    light = {
        "design.stray_capacitance": 0.5 * stray,
        "design.opamp.input_capacitance": 0.5 * (opamp.input_capacitance or 0.0),
    }
    own, alone, both = (_edge(with_values(scene, each)) for each in ({}, quick, {**quick, **light}))
    return Finding(
        "faster-opamps",
        "every op-amp twice as fast: alone, and with half the capacitance at every summing node",
        f"oscillates below {show(own, 'F')}; op-amps alone: {show(alone, 'F')}; both:"
        f" {show(both, 'F')}, and so everything twice as fast. Condition: the summing nodes get"
        " faster too; their capacitance and the resistors limit this board",
        weigh(alone < 0.75 * own, both < 0.6 * own),
        {"edge": own, "edge_fast_opamps": alone, "edge_both": both},
    )


def _edge(scene: Scene) -> float:
    """Return the largest C below which the board oscillates, F."""
    scene = with_values(scene, {"design.capacitance": TOP})
    return TOP / capacitance_margin(synthesise(scene, make_problem(scene))).factor


def _negligible(scene: Scene) -> Finding:
    """Compare the board with the ideal network, which has no constraint-plane dynamics."""
    differences = []
    for farads in (10e-12, 1e-9, 100e-9):
        slow = with_values(scene, {"design.capacitance": farads, "analysis.engine": "statespace"})
        verdict = verify(slow, effort=Effort(details=False))
        reading = verdict.measurements.settling_time
        value = float("inf") if reading is None else reading.value
        differences.append(abs(value / verdict.ideal.transient.settling_time - 1.0))
    return Finding(
        "slow-signal-plane",
        "1 % settling of the board against that of the ideal network at C = 10 pF, 1 nF, 100 nF",
        f"relative differences {listed(differences)}",
        weigh(differences[-1] < 0.02 and differences[0] > 1.0),
        {"at_10pF": differences[0], "at_1nF": differences[1], "at_100nF": differences[2]},
    )


def _figure_10(found: Verdict, small: Waveforms) -> Picture:
    time, u = found.waveforms.time, found.u[:, CENTRE]
    target = found.measurements.channels[CENTRE].target
    early = time <= 60e-6
    late = time <= 1e-3
    marks = ((0.1 * target, "10 %"), (0.9 * target, "90 %"))
    wild = small.time <= 1e-3
    return Picture(
        "figure-10",
        "Figure 10 as ngspice sees it at 10 pF, the ringing that follows, and the same board with"
        " 8.2 pF.",
        (
            Panel(
                "C = 10 pF: the rise",
                "time (µs)",
                "centre output (V)",
                (curve(1e6 * time[early], u[early], "", "C0-"),),
                marks=marks,
            ),
            Panel(
                "C = 10 pF: the ringing",
                "time (ms)",
                "centre output (V)",
                (curve(1e3 * time[late], u[late], "", "C0-"),),
                marks=((target, "target"),),
            ),
            Panel(
                "C = 8.2 pF",
                "time (ms)",
                "centre output (V)",
                (curve(1e3 * small.time[wild], small[f"v_{CENTRE + 1}"][wild], "", "C3-"),),
                marks=((target, "target"),),
            ),
        ),
    )
