"""Stated uncertainties of random boards against their true errors, and what rounding changes.

The oracle reads the deck's text. `make proof ARGS=coverage` does the same for 200 boards.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from taction.netlist_gen.scene.axes import with_settings
from taction.netlist_gen.scene.scene import Scene, load_scene
from taction.verification.engines.statespace.equations import descriptor, stamps
from taction.verification.engines.statespace.equations.descriptor import Descriptor
from taction.verification.engines.statespace.transients import exact, stepped
from taction.verification.evidence.stress.run_cases import TruthComparison, compare
from taction.verification.readings.settling import ChannelState
from taction.verification.verdict import run
from taction.verification.verdict.verify import Verdict, verify
from tests.support import nightly
from tests.support.making import make_scene
from tests.support.paths import ROOT
from tests.support.random_scenes import AMPLIFIERS, random_scene, random_setting
from tests.support.true_values import true_values

SEEDS = (0, 1, 2, 3, 5, 8, 9, 14)  # stable boards whose runs are short
EXPONENTIAL = (0, 5, 14, 18, 27, 29, 33)  # the same, with amplifiers
LOOSE = 0.01  # analysis.error: far above the error of the run that counts as true
READINGS = ("settling_time", "rise_time", "overshoot", "undershoot", "steady_state")
COVERED, TIGHT = 0.99, 5.0  # share of the numbers; times the true error: median of the bounds
TAIL = 1e-5  # of the step: a larger bound is of what may follow the record
LEVEL = 1e-6  # of the step, or of a time: to this readings are known (docs/verdict.md)


def check_coverage(compared: list[TruthComparison]) -> None:
    assert not [c for c in compared if c.wrong]
    assert sum(not c.outside for c in compared) >= COVERED * len(compared)


def ratios(compared: list[TruthComparison]) -> list[float]:
    """Return uncertainty over error of the readings whose error the truth resolves."""
    readings = [c for c in compared if c.name.startswith(READINGS) and c.error > 2.0 * c.doubt]
    return [c.uncertainty / c.error for c in readings]


@pytest.mark.usefixtures("ngspice")
def test_the_uncertainties_of_linear_boards_cover_their_errors() -> None:
    by_engine: dict[str, list[TruthComparison]] = {"ngspice": [], "statespace": []}
    for seed in SEEDS:
        scene = random_scene(seed, topology="integrator", **random_setting(seed))
        truth = true_values(scene)
        for engine, compared in by_engine.items():
            verdict = verify(scene.with_engine(engine))
            for check in verdict.checks:
                assert check.value is None or check.uncertainty is None or check.uncertainty > 0.0
            compared += compare(verdict, truth)
    for compared in by_engine.values():
        check_coverage(compared)
    found = ratios(by_engine["ngspice"])
    assert len(found) > 25
    assert np.median(found) < TIGHT
    times = [c for c in by_engine["statespace"] if c.unit == "s" and c.value]
    assert np.quantile([c.uncertainty / c.value for c in times], 0.9) < LEVEL


def test_the_uncertainties_of_boards_with_amplifiers_cover_their_errors() -> None:
    """Also where the checks allow far more, readings are found to 1e-6: times to as much of them.

    They err by less than the oracle resolves, so bounds are not compared with errors.
    """
    compared: list[TruthComparison] = []
    for seed in EXPONENTIAL:
        scene = random_scene(seed, "exponential", topology="integrator", error=LOOSE)
        compared += compare(verify(scene.with_engine("statespace")), true_values(scene))
    check_coverage(compared)
    times = [c.uncertainty / c.value for c in compared if c.unit == "s" and c.value]
    assert np.median(times) < LEVEL
    assert np.quantile(times, 0.9) < 10.0 * LEVEL
    excursions = [c.uncertainty for c in compared if c.name.startswith(("overshoot", "undershoot"))]
    assert sum(each > TAIL for each in excursions) < 0.25 * len(excursions)
    assert max(each for each in excursions if each < TAIL) < LEVEL


SHIPPED = sorted((ROOT / "scenes").glob("*.toml"))
# 1: a seed a scene; `make nightly`: twenty times as many, of both efforts.
SCALE = int(os.environ.get("TACTION_ROUNDING_SCALE", "1"))
ROUNDED_READINGS = {"steady_state", "settling_time", "rise_time", "overshoot"}
GONE = (ChannelState.DIVERGED, ChannelState.OSCILLATING, ChannelState.CLIPPED)
ONSET = ("9.2pF", "8.7pF")  # the paper's breadboard beside its onset: stable, unstable
DRAWN = tuple(map(str, range(10)))  # seeds, two of each amplifier
LARGE = {"capacitance": "1nF", "lambda": 0.05, "opamp": "lf353", "gain": "100kohm"}
NAMES = [*(path.stem for path in SHIPPED), *ONSET, *DRAWN, "large"]
QUICK = ("custom-matrix", "ridge", "tangential-exponential", "tuned-breadboard", *ONSET, *DRAWN[:5])

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
            mass=d.mass._replace(values=nudged(d.mass.values)),
            local=d.local._replace(values=nudged(d.local.values)),
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
    if name in DRAWN:
        scene = random_scene(int(name), AMPLIFIERS[int(name) % 5], topology="integrator")
    elif name == "large":
        design = LARGE | {"unit_conductance": "20uS", "stray_capacitance": "5pF"}
        scene = make_scene({"channels": 9}, design=design)
    elif name in ONSET:
        scene = load_scene(ROOT / "scenes" / "paper-breadboard.toml")
        scene = with_settings(scene, [f"C={name}", "analysis.stop=1ms"])
    else:
        scene = load_scene(ROOT / "scenes" / f"{name}.toml")
    return scene.with_engine("statespace")


def decisions(verdict: Verdict) -> tuple[object, ...]:
    checks = tuple((check.name, check.outcome) for check in verdict.checks)
    states = tuple((c.index, c.state) for c in verdict.measurements.channels)
    return verdict.outcome, checks, states


def assert_within(wanted: Verdict, found: Verdict) -> None:
    """Readings are apart by no more than both uncertainties; a growing ringing has none."""
    if any(c.state in GONE for c in wanted.measurements.channels):
        return
    for check, other in zip(wanted.checks, found.checks, strict=True):
        if check.name in ROUNDED_READINGS and check.value is not None and other.value is not None:
            both = check.uncertainty + other.uncertainty
            assert abs(check.value - other.value) <= both, (check, other)
    moved = abs(found.poles.rightmost.real - wanted.poles.rightmost.real)
    assert moved <= wanted.poles.resolution + found.poles.resolution


@pytest.mark.parametrize("name", [*QUICK, *nightly(*sorted({*NAMES} - {*QUICK}))])
def test_rounding_changes_no_verdict_or_state(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
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
    scene = scene_of("1")
    plain = verify(scene)
    with rounded(1):
        found = verify(scene, problem=plain.problem, ideal=plain.ideal)
    assert (found.u != plain.u).mean() > 0.5
    assert found.poles.rightmost != plain.poles.rightmost
