"""The CONSOLE step: the gain for least settling time under a limit on overshoot."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.keys import Value
from taction.netlist_gen.scene.scene import Scene
from taction.system.charts import SERIES, Axis, Curve
from taction.verification.evidence.paper.findings import (
    Chapter,
    Finding,
    finding,
    paper_scene,
    seconds,
    weigh,
)
from taction.verification.evidence.paper.pictures import Picture, panel, picture
from taction.verification.readings.measurements import Measurements
from taction.verification.reference.ideal_answer import ideal_network
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.recording import record_transient
from taction.verification.verdict.verify import Effort, verify

FACTORS = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)  # of the scene's own gain
GAINS = 49  # tried by the search
OVERSHOOT = 0.05  # its limit
CENTRE = 3  # channel 4 of 7
SETTLING = Axis("settling time to ±1 %", "s", "log")


def console(quick: bool) -> Chapter:
    """Judge what the gain does, and in a full run tune it and verify the result by ngspice."""
    scene = paper_scene("paper-breadboard")
    parts = [_controls(scene)] if quick else [_controls(scene), _tuned(scene)]
    findings, pictures = zip(*parts, strict=True)
    return Chapter(findings, pictures)


def _controls(scene: Scene) -> tuple[Finding, Picture]:
    settling, overshoot = [], []
    for factor in FACTORS:
        changes: dict[str, Value] = {"design.gain": factor * scene.design.gain}
        changes["analysis.engine"] = "statespace"
        times = _times(record_transient(with_values(scene, changes)).measurements)
        settling.append(times[0])
        overshoot.append(times[1])
    shown = [FACTORS.index(factor) for factor in (0.25, 0.5, 1.0)]
    result = finding(
        "gain-controls",
        {"least_settling_time": min(settling), "least_overshoot": min(overshoot)},
        weigh(max(settling) > 2.0 * min(settling) and max(overshoot) > 2.0 * min(overshoot)),
        settling=[settling[k] for k in shown],
        overshoot=[overshoot[k] for k in shown],
    )
    gains, x = [factor * scene.design.gain for factor in FACTORS], Axis("gain", "ohm")
    by_time, by_share = (Curve(gains, each, mark="circle") for each in (settling, overshoot))
    charts = (
        panel("settling time to ±1 %", x, SETTLING, by_time),
        panel("overshoot", x, Axis("overshoot", "step"), by_share),
    )
    text = "The gain alone trades settling time against overshoot (R and C as they are)."
    return result, picture(text, *charts)


def _tuned(scene: Scene) -> tuple[Finding, Picture]:
    # The limits of the rise time are what the paper measured on its own board, not a wish.
    checks = scene.checks.model_copy(update={"rise_time": None})
    scene = scene.model_copy(update={"checks": checks})
    lam = ideal_network(make_problem(scene), scene).lam

    def board(gain: float) -> Scene:
        return with_values(scene, {"design.gain": gain, "design.lambda": lam})

    def tried(gain: float) -> tuple[float, float]:
        return _times(record_transient(board(gain).with_engine("statespace")).measurements)

    own = float(scene.design.gain)
    gains = [factor * own for factor in np.geomspace(FACTORS[0], FACTORS[-1], GAINS).tolist()]
    found = {gain: tried(gain) for gain in gains}
    before = tried(own)
    kept = [gain for gain in gains if found[gain][1] <= OVERSHOOT]
    best = min(kept or gains, key=lambda gain: found[gain][0])
    verdict = verify(board(best), effort=Effort(details=False))
    settling, overshoot = _times(verdict.measurements)
    agree = abs(settling - found[best][0]) <= 0.05 * settling
    better = settling < before[0] and overshoot <= OVERSHOOT
    outcomes = {check.name: check.outcome for check in verdict.checks}
    result = finding(
        "console",
        {"settling_time": settling, "overshoot": overshoot, "gain": best},
        weigh(agree and better and outcomes["steady_state"] is Outcome.PASS),
        limit=OVERSHOOT,
        tried=len(found),
        before_settling=before[0],
        before_overshoot=before[1],
        rise_time=seconds(verdict.measurements.channels[CENTRE].rise_time),
        simulator=verdict.waveforms.engine,
    )
    over, times = _front(found.values())
    chart = panel(
        "settling time against overshoot",
        Axis("overshoot", "step"),
        SETTLING,
        Curve(over, times, "no other gain tried is better than these", mark="circle"),
        Curve([before[1]], [before[0]], "before", SERIES[3], "", "square"),
        Curve([overshoot], [settling], "after, by ngspice", SERIES[2], "", "star", size=13.0),
    )
    return result, picture("The trade-off that the gain offers.", chart)


def _times(measurements: Measurements) -> tuple[float, float]:
    """Return the settling time, s, infinite without one, and the largest overshoot, a fraction."""
    overshoot = max(channel.overshoot for channel in measurements.channels)
    return seconds(measurements.settling_time), overshoot


def _front(found: Iterable[tuple[float, float]]) -> tuple[list[float], list[float]]:
    """Return overshoot and settling time, s, of the gains that no other one beats in both."""
    best: list[tuple[float, float]] = []
    for settling, overshoot in sorted(found, key=lambda pair: (pair[1], pair[0])):
        if not best or settling < best[-1][1]:
            best.append((overshoot, settling))
    return [pair[0] for pair in best], [pair[1] for pair in best]
