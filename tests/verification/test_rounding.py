"""What a processor rounds differently changes no verdict, and no value by more than its ±."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene
from taction.verification.engines.statespace.equations import descriptor, stamps
from taction.verification.engines.statespace.equations.descriptor import Descriptor
from taction.verification.engines.statespace.transients import exact, stepped
from taction.verification.readings.settling import ChannelState
from taction.verification.verdict import run
from taction.verification.verdict.verify import Verdict, verify
from tests.support.making import make_scene
from tests.support.paths import ROOT

SHIPPED = sorted((ROOT / "scenes").glob("*.toml"))
# 1: a seed a scene; `make nightly`: twenty times as many, of both efforts.
SCALE = int(os.environ.get("TACTION_ROUNDING_SCALE", "1"))
READINGS = {"steady_state", "settling_time", "rise_time", "overshoot"}
GONE = (ChannelState.DIVERGED, ChannelState.OSCILLATING, ChannelState.CLIPPED)
SLOW_AMPLIFIER = {"base": "ideal", "dc_gain": 1e5, "gbw": "718kHz", "second_pole": "2.154MHz"}

BREADBOARD: dict[str, Any] = {
    "resistance": "1.9Mohm",
    "opamp": {**SLOW_AMPLIFIER, "output_resistance": "75ohm", "input_capacitance": "3pF"},
}
DAMPED: dict[str, Any] = {"lambda": 0.05, "opamp": "lf353", "gain": "100kohm"}
DAMPED |= {"unit_conductance": "20uS", "stray_capacitance": "5pF"}
BENT: dict[str, Any] = DAMPED | {"capacitance": "220pF", "exponential_slope": 0.3}
# problem, design, analysis
MADE: dict[str, tuple[dict[str, Any], dict[str, Any], dict[str, Any]]] = {
    "stiff": ({"channels": 3}, DAMPED | {"capacitance": "1uF", "opamp": "ne5534"}, {}),
    "stiff-fast": ({"channels": 3}, DAMPED | {"opamp": "op27", "capacitance": "1nF"}, {}),
    "stiff-weak": ({"channels": 5}, DAMPED | {"lambda": 1e-6, "capacitance": "1nF"}, {}),
    "from-rest": ({"channels": 3}, DAMPED | {"capacitance": "1nF"}, {"initial": "rest"}),
    "single": ({"channels": 1}, DAMPED | {"capacitance": "100pF"}, {}),
    "uneven": ({"channels": 3, "sensors": 5}, DAMPED | {"capacitance": "1nF"}, {}),
    "tangential": ({"channels": 5, "kernel": "tangential"}, DAMPED | {"capacitance": "1nF"}, {}),
    "passive": (
        {"channels": 3},
        DAMPED | {"topology": "passive", "capacitance": "1nF", "lambda": 0.5},
        {},
    ),
    "exponential": ({"channels": 3}, BENT | {"amplifier": "exponential"}, {}),
    "exponential-rest": (
        {"channels": 3},
        BENT | {"amplifier": "exponential"},
        {"initial": "rest"},
    ),
    "softplus": ({"channels": 3}, BENT | {"amplifier": "softplus"}, {}),
    "tanh": ({"channels": 3}, BENT | {"amplifier": "tanh"}, {}),
    "marginal-stable": ({}, BREADBOARD | {"capacitance": "9.2pF"}, {}),
    "marginal-unstable": ({}, BREADBOARD | {"capacitance": "8.7pF"}, {"stop": "1ms"}),
    "large": ({"channels": 9}, DAMPED | {"capacitance": "1nF"}, {}),
}
NAMES = [*(path.stem for path in SHIPPED), *MADE]


SIZE = 4e-16  # relative; standard deviation
TRANSIENTS = (exact, stepped)


@contextmanager
def rounded(seed: int) -> Iterator[None]:
    """Multiply every stamped value, initial state and recorded sample by ``1 + SIZE z``."""
    rng = np.random.default_rng(seed)

    def nudged(x: Any) -> Any:
        return x * (1.0 + SIZE * rng.standard_normal(np.shape(x)))

    def after(function: Callable[..., Any]) -> Callable[..., Any]:
        return lambda *given, **named: nudged(function(*given, **named))

    def stamped(*given: Any, **named: Any) -> Descriptor:
        d = Descriptor(*given, **named)
        scales = {"u_scale": nudged(d.devices.u_scale), "v_scale": nudged(d.devices.v_scale)}
        return replace(
            d,
            mass=replace(d.mass, values=nudged(d.mass.values)),
            local=replace(d.local, values=nudged(d.local.values)),
            couplings=tuple(replace(c, conductance=nudged(c.conductance)) for c in d.couplings),
            switched=nudged(d.switched),
            constant=nudged(d.constant),
            devices=replace(d.devices, **scales),
        )

    begins = [(room, "initial_unknowns") for room in TRANSIENTS]
    with ExitStack() as changed:
        changed.enter_context(patch.object(stamps, "Descriptor", stamped))
        for owner, name in (*begins, (run, "outputs")):
            changed.enter_context(patch.object(owner, name, after(getattr(owner, name))))
        yield


def scene_of(name: str) -> Scene:
    if name in MADE:
        problem, design, analysis = MADE[name]
        return make_scene(problem, design=design, analysis=analysis | {"engine": "statespace"})
    scene = load_scene(ROOT / "scenes" / f"{name}.toml")
    analysis = scene.analysis.model_copy(update={"engine": "statespace"})
    return scene.model_copy(update={"analysis": analysis})


def decisions(verdict: Verdict) -> tuple[object, ...]:
    checks = tuple((check.name, check.outcome) for check in verdict.checks)
    states = tuple((c.index, c.state) for c in verdict.measurements.channels)
    return verdict.outcome, checks, states


def assert_within(wanted: Verdict, found: Verdict) -> None:
    """Readings are apart by no more than both uncertainties; a growing ringing has none."""
    if any(c.state in GONE for c in wanted.measurements.channels):
        return
    for check, other in zip(wanted.checks, found.checks, strict=True):
        if check.name in READINGS and check.value is not None and other.value is not None:
            both = check.uncertainty + other.uncertainty
            assert abs(check.value - other.value) <= both, (check, other)
    moved = abs(found.poles.rightmost.real - wanted.poles.rightmost.real)
    assert moved <= wanted.poles.resolution + found.poles.resolution


@pytest.mark.parametrize("name", NAMES)
def test_rounding_changes_no_verdict_and_no_state(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if name == "large":  # solved through its structure, as boards of more than 600 unknowns
        monkeypatch.setattr(descriptor, "LARGE", 100)
    scene = scene_of(name)
    efforts = (False,) if name == "large" else (True, False, False, False)
    used = dict.fromkeys(efforts[:SCALE])
    plain = {effort: verify(scene, full_margin=effort) for effort in used}
    for k in range(SCALE):
        seed, effort = 2 * NAMES.index(name) * SCALE + k, efforts[k % len(efforts)]
        wanted = plain[effort]
        with rounded(seed):
            found = verify(scene, problem=wanted.problem, ideal=wanted.ideal, full_margin=effort)
        assert decisions(found) == decisions(wanted), f"seed {seed}"
        assert_within(wanted, found)


def test_the_adversary_reaches_the_numbers_that_it_should() -> None:
    scene = scene_of("stiff")
    plain = verify(scene)
    with rounded(1):
        found = verify(scene, problem=plain.problem, ideal=plain.ideal)
    assert (found.u != plain.u).mean() > 0.5
    assert found.poles.rightmost != plain.poles.rightmost
