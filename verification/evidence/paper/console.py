"""The CONSOLE step: the gain for least settling time under a limit on overshoot."""

from __future__ import annotations

from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.keys import Value
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import EngineError
from taction.verification.design.tune import OVERSHOOT, tune
from taction.verification.evidence.paper.findings import (
    Chapter,
    Finding,
    finding,
    paper_scene,
    seconds,
    weigh,
)
from taction.verification.evidence.paper.pictures import Panel, Picture, curve
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.progress import Effort
from taction.verification.verdict.record import FIGURES
from taction.verification.verdict.recording import record_transient
from taction.verification.verdict.verify import verify

FACTORS = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)  # of the scene's own gain
CENTRE = 3  # channel 4 of 7


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
        measurements = record_transient(with_values(scene, changes)).measurements
        settling.append(seconds(measurements.settling_time))
        overshoot.append(max(channel.overshoot for channel in measurements.channels))
    shown = [FACTORS.index(factor) for factor in (0.25, 0.5, 1.0)]
    result = finding(
        "gain-controls",
        {"least_settling_time": min(settling), "least_overshoot": min(overshoot)},
        weigh(max(settling) > 2.0 * min(settling) and max(overshoot) > 2.0 * min(overshoot)),
        settling=[settling[k] for k in shown],
        overshoot=[overshoot[k] for k in shown],
    )
    gains = [factor * scene.design.gain / 1e6 for factor in FACTORS]
    percent = [100.0 * each for each in overshoot]
    x, style = "gain (MΩ)", "C0o-"
    panels = (
        Panel("1 % settling time", x, "s", (curve(gains, settling, "", style),), logs="y"),
        Panel("overshoot", x, "% of the step", (curve(gains, percent, "", style),)),
    )
    text = "The gain alone trades settling time against overshoot (R and C as they are)."
    return result, Picture("gain", text, panels)


def _tuned(scene: Scene) -> tuple[Finding, Picture]:
    tuning = tune(scene, ("gain",), overshoot=OVERSHOOT)
    verdict = verify(tuning.scene, effort=Effort(details=False))
    settling, overshoot = (FIGURES[name].of(verdict) for name in ("settling_time", "overshoot"))
    if settling is None or overshoot is None:
        raise EngineError(f"the tuned board does not settle: {verdict.measurements.reason}")
    before, after = tuning.before, tuning.after
    agree = abs(settling - after.settling_time) <= 0.05 * settling
    better = settling < before.settling_time and overshoot <= OVERSHOOT
    outcomes = {check.name: check.outcome for check in verdict.checks}
    gain = after.values["design.gain"]
    result = finding(
        "console",
        {"settling_time": settling, "overshoot": overshoot, "gain": gain},
        weigh(agree and better and outcomes["steady_state"] is Outcome.PASS),
        limit=OVERSHOOT,
        tried=tuning.tried,
        before=before,
        rise_time=seconds(verdict.measurements.channels[CENTRE].rise_time),
        simulator=verdict.waveforms.engine,
    )
    lines = (
        curve([100.0 * c.overshoot for c in tuning.frontier],
              [c.settling_time for c in tuning.frontier],
              "no other design tried is better than these", "o-"),
        curve([100.0 * before.overshoot], [before.settling_time], "before", "C3s"),
        curve([100.0 * overshoot], [settling], "after, by ngspice", "C2*"),
    )  # fmt: skip
    x, y = "overshoot (% of the step)", "1 % settling time (s)"
    panel = Panel("settling time against overshoot", x, y, lines, logs="y")
    return result, Picture("console", "The trade-off that the gain offers.", (panel,))
