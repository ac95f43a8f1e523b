"""The boards of the paper: the breadboard, its tuning (CONSOLE), and the other hardware."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.polynomial import Polynomial

from taction.netlist_gen.analysis import OperatingPoint, Transient
from taction.netlist_gen.board.circuit import Circuit, Role
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Complexes, Floats, Waveforms
from taction.system.charts import Axis, Chart, Curve, Limit
from taction.verification.engines.ngspice.process import find_simulator, simulate
from taction.verification.evidence.paper.findings import (
    Chapter,
    Finding,
    finding,
    paper_scene,
    redesigned,
    seconds,
    weigh,
)
from taction.verification.evidence.paper.ideal_flow import linear_outputs, settling_time
from taction.verification.evidence.paper.sensing import difference
from taction.verification.readings.measurements import Measurements
from taction.verification.reference.ideal_answer import ideal_network
from taction.verification.reference.solve import solve
from taction.verification.stability.margin import find_margin
from taction.verification.stability.poles import poles
from taction.verification.studies.onset import onset
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.verify import Verdict, verify

CENTRE = 3  # channel 4 of 7
NEXT_E12 = 8.2e-12  # F, the E12 value below 10 pF
ONSET_RANGE = "C=8.8pF:10pF:5"
RECORD, STEP = 1.5e-3, 0.2e-6  # s
WINDOW_STARTS = (0.3e-3, 0.7e-3, 1.1e-3)  # s, of the three windows that show the ringing
WINDOW = 0.4e-3  # s
STABLE_CAPACITANCE = 20e-12  # F, above every onset of oscillation that is searched
ABOUT = 0.1  # relative difference that a printed "about" allows
POINTS, SPAN = 40_000, 7.0  # of the step of a stage, and their span over its slowest lag
FACTORS = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)  # of the scene's own gain
GAINS = 49  # tried by the search
OVERSHOOT = 0.05  # its limit
THICKER = 1.2  # depth of the layer that the other matrix chip is made for
CLOSE = 1e-3  # of the largest output


def breadboard() -> Chapter:
    """Judge section 4.2.1 by ngspice on the scene that was fitted to its numbers."""
    scene = paper_scene("paper-breadboard")
    verdict = verify(scene)
    record = Transient(RECORD, STEP)
    deck = write_deck(verdict.circuit.turned("C", NEXT_E12), record, saved=[f"v_{CENTRE + 1}"])
    unstable = simulate(deck, find_simulator(), timeout=120.0)
    findings = (
        *_constraint(verdict.circuit),
        *_rise(verdict),
        _oscillation(scene, unstable),
        _faster(scene),
        _negligible(scene),
    )
    return Chapter(findings, _figure_10(verdict, unstable))


def _constraint(circuit: Circuit) -> tuple[Finding, Finding]:
    (amplifier, _), (stage, _) = (stage_step(circuit, loaded=loaded) for loaded in (False, True))
    about_1us = abs(amplifier - 1e-6) <= ABOUT * 1e-6
    slower, ratio = weigh(stage > amplifier, fitted=True), stage / amplifier
    return (
        finding("constraint-rise", weigh(about_1us, fitted=True), rise_time=amplifier),
        finding("constraint-loaded", slower, rise_time=stage, ratio=ratio),
    )


def stage_step(circuit: Circuit, *, loaded: bool) -> tuple[float, float]:
    """Return the step of the constraint stage with the largest resistive load.

    That is its 10-90 % rise time, s, and its overshoot, a share of the step. With r the output
    resistance over s, Y the node's admittance and D = (1 + s A0/wt) (1 + s t2) of the op-amp,
    output over current is (r D - A0) / ((1 + r) Y D + (D + A0)/s). Only a `loaded` stage has the
    capacitance of the node; NaN if it grows.
    """
    load, sinks = np.sum(1.0 / circuit.forward_ohms, axis=1), circuit.forward.sinks
    for part in circuit.parts_of(Role.STRAIN_RESISTOR):
        load[sinks.index(part.b)] += 1.0 / part.ohms
    row = int(np.argmax(load))
    model = circuit.models[next(c.model for c in circuit.opamps if c.inverting == sinks[row])]
    strays = [part.farads for part in circuit.capacitors if part.a == sinks[row]]
    farads = math.fsum((*strays, model.input_capacitance, model.differential_capacitance))
    siemens = float(load[row]) + 1.0 / model.input_resistance
    wt, gain, A0 = math.tau * model.gbw, circuit.value("gain"), model.dc_gain
    r = model.output_resistance / gain
    Y = Polynomial([siemens, wt * farads] if loaded else [siemens])  # time times wt, as in D
    D = Polynomial([1.0, A0]) * Polynomial([1.0, model.gbw / model.second_pole])
    above, below = r * D - A0, (1.0 + r) * Y * D + (D + A0) / gain
    roots: Complexes = below.trim().roots().astype(complex)
    if not np.all(roots.real < 0.0):
        return math.nan, math.nan
    time = np.linspace(0.0, SPAN / float(np.abs(roots.real).min()), POINTS)
    parts = above(roots) / (below.deriv()(roots) * roots) * below(0.0) / above(0.0)
    shares = 1.0 + (np.exp(time[:, None] * roots) @ parts).real
    rising = slice(int(np.argmax(shares)) + 1)
    early, late = np.interp((0.1, 0.9), shares[rising], time[rising]).tolist()
    return float(late - early) / wt, max(float(shares.max()) - 1.0, 0.0)


def _rise(verdict: Verdict) -> tuple[Finding, Finding]:
    centre = verdict.measurements.channels[CENTRE]
    rise_time, settling = seconds(centre.rise_time), seconds(verdict.measurements.settling_time)
    about = weigh(abs(rise_time - 10e-6) <= ABOUT * 10e-6, fitted=True)
    damped = verify(paper_scene("tuned-breadboard"))
    settling_damped = seconds(damped.measurements.settling_time)
    shown = {"overshoot": centre.overshoot, "simulator": verdict.waveforms.engine}
    times = {"settling_time": settling, "settling_time_damped": settling_damped}
    return (
        finding("figure-10", about, rise_time=rise_time, **shown),
        finding("convergence-10us", weigh(settling <= 20e-6, True), **times),
    )


def _oscillation(scene: Scene, unstable: Waveforms) -> Finding:
    crossings = onset(scene, over=ONSET_RANGE).findings
    highest = max((each.crossing.value for each in crossings), default=math.nan)
    confirmed = all(each.confirmed for each in crossings)
    u, time = unstable[f"v_{CENTRE + 1}"], unstable.time
    heights = [float(np.ptp(u[(time > t) & (time < t + WINDOW)])) for t in WINDOW_STARTS]
    grows = heights[-1] > 1.3 * heights[0]
    return finding(
        "oscillation",
        weigh(NEXT_E12 < highest < 10e-12 and confirmed and grows, fitted=True),
        onset=highest,
        first_height=heights[0],
        last_height=heights[-1],
        heights=heights,
        confirmed="confirmed" if confirmed else "not confirmed",
        simulator=unstable.engine,
    )


def _faster(scene: Scene) -> Finding:
    """Double every op-amp's poles, alone and with half the capacitance at the summing nodes."""

    def edge(fast: float, light: float) -> float:
        """Return the largest C below which the board oscillates, F."""
        opamp, stray = scene.design.opamp, scene.design.stray_capacitance
        factors = {"gbw": fast, "second_pole": fast, "input_capacitance": light}
        figures = {f"opamp.{key}": x * getattr(opamp, key) for key, x in factors.items()}
        parts = {"stray_capacitance": light * stray, "capacitance": STABLE_CAPACITANCE}
        board = redesigned(scene, **figures, **parts)
        return STABLE_CAPACITANCE / find_margin(synthesise(board, make_problem(board))).factor

    own, fast, both = edge(1.0, 1.0), edge(2.0, 1.0), edge(2.0, 0.5)
    outcome = weigh(fast < 0.75 * own, both < 0.6 * own)
    return finding("faster-opamps", outcome, edge=own, edge_fast_opamps=fast, edge_both=both)


def _negligible(scene: Scene) -> Finding:
    """Compare the board with the ideal network, which has no constraint-plane dynamics."""
    off = {}
    for name, farads in {"at_10pF": 10e-12, "at_1nF": 1e-9, "at_100nF": 100e-9}.items():
        slow = redesigned(scene, capacitance=farads).with_engine("statespace")
        verdict = verify(slow)
        settling = seconds(verdict.measurements.settling_time)
        ideal = settling_time(*linear_outputs(verdict.ideal.network))
        off[name] = abs(settling / ideal - 1.0)
    outcome = weigh(off["at_100nF"] < 0.02 and off["at_10pF"] > 1.0)
    return finding("slow-signal-plane", outcome, **off)


def _figure_10(verdict: Verdict, unstable: Waveforms) -> tuple[Chart, ...]:
    target = verdict.measurements.channels[CENTRE].target
    stable = verdict.waveforms.time, verdict.u[:, CENTRE]
    oscillating = unstable.time, unstable[f"v_{CENTRE + 1}"]
    text = "Figure 10 by ngspice at 10 pF, the ringing that follows, and the same board at 8.2 pF."

    def output(title: str, time: Floats, u: Floats, end: float, *levels: float) -> Chart:
        shown = time <= end
        lines = (Limit(share * target, "y", f"{share:.0%} of the target") for share in levels)
        curve = Curve(time[shown], u[shown], width=0.6)
        axes = Axis("time", "s"), Axis("centre output", "V")
        return Chart(title, *axes, (curve, *lines), text)

    return (
        output("C = 10 pF: the rise", *stable, 60e-6, 0.1, 0.9),
        output("C = 10 pF: the ringing", *stable, 1e-3, 1.0),
        output("C = 8.2 pF", *oscillating, 1e-3, 1.0),
    )


def console() -> Chapter:
    """Judge what the gain does, tune it, and verify the result by ngspice."""
    scene = paper_scene("paper-breadboard")
    own, shown = float(scene.design.gain), [FACTORS.index(factor) for factor in (0.25, 0.5, 1.0)]
    gains = [factor * own for factor in FACTORS]
    settling, overshoot = zip(*(_by_gain(scene, gain) for gain in gains), strict=True)
    controls = finding(
        "gain-controls",
        weigh(max(settling) > 2.0 * min(settling) and max(overshoot) > 2.0 * min(overshoot)),
        least_settling_time=min(settling),
        least_overshoot=min(overshoot),
        settling=[settling[k] for k in shown],
        overshoot=[overshoot[k] for k in shown],
    )
    return Chapter((controls, _tuned(scene)))


def _by_gain(scene: Scene, gain: float, **others: float) -> tuple[float, float]:
    board = redesigned(scene, gain=gain, **others).with_engine("statespace")
    return _times(verify(board).measurements)


def _times(measurements: Measurements) -> tuple[float, float]:
    """Return the settling time, s, infinite without one, and the largest overshoot, a fraction."""
    overshoot = max(channel.overshoot for channel in measurements.channels)
    return seconds(measurements.settling_time), overshoot


def _tuned(scene: Scene) -> Finding:
    """Search the gain for the least settling time, with the solution of the scene."""
    # The limits of the rise time are what the paper measured on its own board, not a wish.
    checks = scene.checks.model_copy(update={"rise_time": None})
    scene = scene.model_copy(update={"checks": checks})
    lam, own = ideal_network(make_problem(scene), scene).lam, float(scene.design.gain)
    gains = [factor * own for factor in np.geomspace(FACTORS[0], FACTORS[-1], GAINS).tolist()]
    held = {"lambda": lam}
    found = {gain: _by_gain(scene, gain, **held) for gain in gains}
    before = _by_gain(scene, own, **held)
    kept = [gain for gain in gains if found[gain][1] <= OVERSHOOT]
    best = min(kept or gains, key=lambda gain: found[gain][0])
    verdict = verify(redesigned(scene, gain=best, **held))
    settling, overshoot = _times(verdict.measurements)
    agree = abs(settling - found[best][0]) <= 0.05 * settling
    better = settling < before[0] and overshoot <= OVERSHOOT
    outcomes = {check.name: check.outcome for check in verdict.checks}
    return finding(
        "console",
        weigh(agree and better and outcomes["steady_state"] is Outcome.PASS),
        settling_time=settling,
        overshoot=overshoot,
        gain=best,
        limit=OVERSHOOT,
        tried=len(found),
        before_settling=before[0],
        before_overshoot=before[1],
        rise_time=seconds(verdict.measurements.channels[CENTRE].rise_time),
        simulator=verdict.waveforms.engine,
    )


def hardware() -> Chapter:
    """Judge the second breadboard, the steady state, and the two-chip partition by ngspice."""
    verdict = verify(paper_scene("paper-exponential"))
    final, ideal, measured = verdict.u[-1], verdict.ideal, verdict.measurements
    least = float(final.min())
    off = float(np.max(np.abs(final - ideal.target))) / measured.amplitude
    works = finding(
        "second-breadboard",
        weigh(verdict.outcome is Outcome.PASS and least > 0.0),
        settling_time=seconds(measured.settling_time),
        least_output=least,
        simulator=verdict.waveforms.engine,
    )
    at_minimum = weigh(off <= CLOSE and ideal.solution.trusted)
    minimum = finding("minimum", at_minimum, difference=off, gap=ideal.solution.certificate)
    return Chapter((works, minimum, _two_chips()))


def _two_chips() -> Finding:
    thin = paper_scene("eleven-channel")
    thick = with_values(thin, {"problem.depth": THICKER})
    problem = make_problem(thick)
    thin_board, thick_board = synthesise(thin, make_problem(thin)), synthesise(thick, problem)
    board = replace(thin_board, currents=thick_board.currents, matrices=thick_board.matrices)
    simulator = find_simulator()
    deck = write_deck(board, OperatingPoint(), solver=simulator.solver_option)
    record = simulate(deck, simulator, timeout=60.0)
    u = np.array([out.sign * float(record[out.node][-1]) for out in board.outputs])
    target = solve(ideal_network(problem, thick).problem).u * thick.design.unit_voltage
    off = difference(u, target)
    stable = all(poles(each).known_stable for each in (thin_board, thick_board))
    return finding(
        "two-chips",
        weigh(off <= CLOSE and stable),
        difference=off,
        depth=THICKER,
        stable="yes" if stable else "no",
        simulator=record.engine,
    )
