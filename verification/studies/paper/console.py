"""The CONSOLE step: the gain for least settling time under a limit on overshoot."""

from __future__ import annotations

import math

from netlist_gen.overrides.axes import with_values
from netlist_gen.overrides.keys import Value
from netlist_gen.quantities import show
from netlist_gen.scene.scene import Scene
from spice_models.errors import EngineError
from verification.pipeline.checks import Outcome
from verification.pipeline.effort import Effort
from verification.pipeline.recording import record_transient
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
from verification.studies.tune import OVERSHOOT, tune
from verification.verify import verify

SCENE = "paper-breadboard"
FACTORS = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0)
CENTRE = 3  # channel 4 of 7


def console(quick: bool) -> Chapter:
    """Judge what the gain does, and in a full run tune it and verify the result by ngspice."""
    scene = paper_scene(SCENE)
    first, over_gain = _controls(scene)
    if quick:
        return Chapter((first,), (over_gain,))
    second, picture = _tuned(scene)
    return Chapter((first, second), (over_gain, picture))


def _controls(scene: Scene) -> tuple[Finding, Picture]:
    settling, overshoot = [], []
    for factor in FACTORS:
        changes: dict[str, Value] = {"design.gain": factor * scene.design.gain}
        changes["analysis.engine"] = "statespace"
        found = record_transient(with_values(scene, changes)).measurements
        reading = found.settling_time
        settling.append(math.inf if reading is None else reading.value)
        overshoot.append(max(channel.overshoot for channel in found.channels))
    shown = [FACTORS.index(factor) for factor in (0.25, 0.5, 1.0)]
    finding = Finding(
        "gain-controls",
        "gain at 0.05 to 1 of the scene's own, R as it is",
        "at a quarter, half and the whole of it 1 % settling"
        f" {', '.join(show(settling[k], 's') for k in shown)}; overshoot"
        f" {listed([100 * overshoot[k] for k in shown])} %",
        weigh(max(settling) > 2.0 * min(settling) and max(overshoot) > 2.0 * min(overshoot)),
        {"least_settling_time": min(settling), "least_overshoot": min(overshoot)},
    )
    gains = [factor * scene.design.gain / 1e6 for factor in FACTORS]
    panels = (
        Panel(
            "1 % settling time", "gain (MΩ)", "s", (curve(gains, settling, "", "C0o-"),), logs="y"
        ),
        Panel(
            "overshoot",
            "gain (MΩ)",
            "% of the step",
            (curve(gains, [100 * each for each in overshoot], "", "C0o-"),),
        ),
    )
    text = "The gain alone trades settling time against overshoot (R and C as they are)."
    return finding, Picture("gain", text, panels)


def _tuned(scene: Scene) -> tuple[Finding, Picture]:
    found = tune(scene, ("gain",), overshoot=OVERSHOOT)
    verdict = verify(found.scene, effort=Effort(details=False))
    reading = verdict.measurements.settling_time
    if reading is None:
        raise EngineError(f"the tuned board does not settle: {verdict.measurements.reason}")
    overshoot = max(channel.overshoot for channel in verdict.measurements.channels)
    rise = verdict.measurements.channels[CENTRE].rise_time
    rising = "not at all" if rise is None else show(rise.value, "s")
    agree = abs(reading.value - found.after.settling_time) <= 0.05 * reading.value
    names = {check.name: check.outcome for check in verdict.checks}
    finding = Finding(
        "console",
        f"settling time minimised over the gain, overshoot at most {percent(OVERSHOOT)},"
        f" lambda held; {found.tried} designs; the best one by {verdict.waveforms.engine}",
        f"gain {show(found.after.values['design.gain'], 'ohm')}: settling"
        f" {show(found.before.settling_time, 's')} → {show(reading.value, 's')}, overshoot"
        f" {percent(found.before.overshoot)} → {percent(overshoot)}; the"
        f" centre output now rises in {rising}",
        weigh(
            agree
            and overshoot <= OVERSHOOT
            and reading.value < found.before.settling_time
            and names["steady_state"] is Outcome.PASS
        ),
        {"settling_time": reading.value, "overshoot": overshoot,
         "gain": found.after.values["design.gain"]},
    )  # fmt: skip
    frontier = found.frontier
    lines = (
        curve([100 * c.overshoot for c in frontier], [c.settling_time for c in frontier],
              "no other design tried beats these", "o-"),
        curve([100 * found.before.overshoot], [found.before.settling_time], "before", "C3s"),
        curve([100 * overshoot], [reading.value], "after, by ngspice", "C2*"),
    )  # fmt: skip
    panel = Panel("settling time against overshoot", "overshoot (% of the step)",
                  "1 % settling time (s)", lines, logs="y")  # fmt: skip
    return finding, Picture("console", "The trade-off that the gain offers.", (panel,))
