"""Tuning: faster within the limits, verified by ngspice, the solution held, and errors."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from typing import Any

import pytest
from click.testing import Result

import taction
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import EngineError, InputError
from taction.verification.design import tune as tune_module
from taction.verification.design.trials import Trial
from taction.verification.design.tune import Tuning, frontier
from taction.verification.verdict.verify import verify
from tests.support.making import make_scene
from tests.support.running import taction as command
from tests.support.trials import make_trial

REAL = {"base": "ideal", "dc_gain": 1e5, "gbw": "1MHz", "second_pole": "3MHz"}
DESIGN = {
    "capacitance": "100pF",
    "gain": "100kohm",
    "stray_capacitance": "5pF",
    "unit_conductance": "10uS",
    "lambda": 0.1,
    "opamp": REAL,
}
TEXT = """name = "slow"
[problem]
kind = "tactile"
channels = 2
span = 1.2
[design]
capacitance = "100pF"
gain = "100kohm"
stray_capacitance = "5pF"
unit_conductance = "10uS"
lambda = 0.1
opamp = { base = "ideal", dc_gain = 1e5, gbw = "1MHz", second_pole = "3MHz" }
"""


def scene(**tables: Any) -> Scene:
    return make_scene({"channels": 2, "span": 1.2}, design=DESIGN, **tables)


def tune(scene: Scene, over: str | Sequence[str] = "gain", **limits: Any) -> Tuning:
    return taction.tune(scene.with_engine("statespace"), over=over, **limits).tuning


@functools.cache
def tuned() -> Tuning:
    return tune(scene(), overshoot=0.02, margin=1.3)


def run(*arguments: str) -> Result:
    return command("tune", *arguments)


def test_the_board_becomes_faster_within_the_limits() -> None:
    found = tuned()
    assert found.after.settling_time < 0.5 * found.before.settling_time
    assert found.after.overshoot <= 0.02
    assert found.after.good
    assert found.after.values["design.gain"] > 1e5
    # No point of a fine grid that keeps the limits is much better.
    good = [c for c in found.frontier if c.overshoot <= 0.0198]
    assert found.after.settling_time == pytest.approx(min(c.settling_time for c in good), rel=1e-9)


def test_ngspice_verifies_what_was_found(ngspice: str) -> None:
    found = tuned()
    verdict = verify(found.scene.with_engine("ngspice"))
    assert verdict.waveforms.engine.startswith("ngspice")
    checks = {check.name: check for check in verdict.checks}
    assert {name: check.outcome.value for name, check in checks.items()} == dict.fromkeys(
        checks, "pass"
    )
    assert checks["overshoot"].expected == 0.02
    assert checks["stability"].expected == 1.3
    settling = verdict.measurements.settling_time
    assert settling.value == pytest.approx(found.after.settling_time, rel=0.05)


def test_lambda_is_held_and_the_resistance_follows() -> None:
    before, after = synthesise(scene()).value, synthesise(tuned().scene).value
    assert after("lambda") == pytest.approx(before("lambda"), rel=1e-12)
    assert after("R") * after("gain") == pytest.approx(before("R") * before("gain"))


def test_the_frontier_is_nondominated() -> None:
    frontier = tuned().frontier
    assert len(frontier) >= 3  # gains of three digits
    for one, other in itertools.pairwise(frontier):
        assert one.overshoot < other.overshoot
        assert one.settling_time > other.settling_time


def test_a_frontier_leaves_out_what_is_beaten_unstable_or_never_settles() -> None:
    def candidate(settling: float, overshoot: float, *left: str) -> Trial:
        return make_trial({}, settling, overshoot, left)

    best = [candidate(3.0, 0.1), candidate(1.0, 0.2)]
    beaten = [candidate(3.0, 0.2), candidate(4.0, 0.1), candidate(1.0, 0.3)]
    no_design = [candidate(0.5, 0.0, "stability"), candidate(float("inf"), 0.0)]
    no_design.append(make_trial({}, 0.5, 0.0, (), "resistors s below 100 ohm"))
    assert frontier([*beaten, *best, *no_design]) == tuple(best)


def test_the_scene_s_own_limits_are_the_defaults(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tune_module, "GRID", {1: 5})
    asked = scene(checks={"overshoot": {"max": 0.07}, "stability": {"margin": 1.2}})
    found = tune(asked)
    assert (found.overshoot_limit, found.margin) == (0.07, 1.2)
    assert tune(scene()).overshoot_limit == tune_module.OVERSHOOT


@pytest.mark.parametrize(
    ("keys", "text"),
    [
        (["gian"], "did you mean 'gain'"),
        ([], "one to 3 different keys"),
        (["gain", "C", "G0", "Ve"], "one to 3 different keys"),
        (["gain", "design.gain"], "one to 3 different keys"),
        (["channels"], "only the design can be tuned"),
        (["design.amplifier"], "a search needs a key with numbers"),
    ],
)
def test_keys_that_cannot_be_tuned(keys: list[str], text: str) -> None:
    with pytest.raises(InputError, match=text):
        tune(scene(), keys)


def test_nothing_feasible_says_what_came_closest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tune_module, "GRID", {1: 3})
    ringing = make_scene(
        {"channels": 2, "span": 1.2}, design=DESIGN | {"gain": 3e5, "capacitance": 1e-11}
    )
    closest = r"closest is design.gain = .* with an overshoot of .* does not pass overshoot"
    with pytest.raises(EngineError, match=closest):
        tune(ringing, overshoot=1e-9, reach=1.1)
    with pytest.raises(EngineError, match=r"a margin of 90 in C; .* does not pass .*stability"):
        tune(ringing, margin=90.0, reach=1.1)


def test_every_check_of_the_scene_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    """A least rise time, which the fastest design does not keep."""
    monkeypatch.setattr(tune_module, "GRID", {1: 7})
    free = tune(scene(), overshoot=0.02)
    fastest = verify(free.scene.with_engine("statespace")).measurements.rise_time
    asked = scene(checks={"rise_time": {"min": 2.0 * fastest.value}})
    slower = tune(asked, overshoot=0.02)
    rise = verify(slower.scene.with_engine("statespace")).measurements.rise_time
    assert rise.value >= 2.0 * fastest.value
    assert slower.after.settling_time > free.after.settling_time


def test_values_are_those_of_the_series(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tune_module, "GRID", {1: 5, 2: 4})
    series = {"capacitor_series": "E6", "resistor_series": "E96"}
    asked = make_scene({"channels": 2, "span": 1.2}, design=DESIGN | series)
    loose = with_values(asked, {"checks.steady_state.tolerance": 0.05})
    found = tune(loose, ["C", "gain"], overshoot=0.05)
    farads, ohms = found.after.values["design.capacitance"], found.after.values["design.gain"]
    assert f"{farads:.1e}"[:3] in {"1.0", "1.5", "2.2", "3.3", "4.7", "6.8"}
    steps = [round(10 ** (k / 96), 2) for k in range(96)]  # IEC 60063
    assert min(abs(float(f"{ohms:.3e}"[:5]) - step) for step in steps) < 1e-9


def test_a_range_is_kept_and_its_edge_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tune_module, "GRID", {1: 5})
    found = tune(scene(), ["gain=100k:120k"], overshoot=0.02)
    assert 1e5 <= found.after.values["design.gain"] <= 1.2e5
    assert found.at_edges == {"design.gain": 1.2e5}
    assert not tuned().at_edges


def test_resistors_that_nobody_sells_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """The gain would like to grow beyond the 40 Mohm that the scene has."""
    monkeypatch.setattr(tune_module, "GRID", {1: 5})
    design = DESIGN | {"gain": "40Mohm", "unit_conductance": "50nS", "capacitance": "100pF"}
    huge = make_scene({"channels": 2, "span": 1.2}, design=design | {"opamp": "ideal"})
    found = tune(huge, ["gain=10M:400M"], overshoot=0.9)
    assert found.after.values["design.gain"] <= 1.05 * 40e6
    found = tune(huge, ["gain=10M:400M"], overshoot=0.9, any_part=True)
    assert found.after.values["design.gain"] > 1.05 * 40e6
