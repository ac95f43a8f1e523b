"""What a second run is asked: its readings, and its state only where they leave a doubt."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from netlist_gen.scene.scene import parse_scene
from tests.support.paths import SCENES
from verification.engines.statespace.transients.exact import simulate
from verification.ideal.ideal_answer import IdealAnswer, ideal_answer
from verification.pipeline import recording
from verification.pipeline.clock import Clock
from verification.pipeline.design import Design, design_board
from verification.pipeline.effort import Effort
from verification.pipeline.recording import Recording, watch
from verification.pipeline.simulation import SHARE, Pending
from verification.waveforms import Waveforms


@cache
def board() -> tuple[Design, IdealAnswer, Waveforms]:
    """The shipped breadboard, its reference and its exact transient."""
    file = SCENES / "paper-breadboard.toml"
    data = tomllib.loads(file.read_text(encoding="utf-8"))
    data["analysis"] = data.get("analysis", {}) | {"engine": "statespace"}
    design = design_board(parse_scene(data, file), Clock(lambda stage: None))
    ideal = ideal_answer(design.network, design.scene)
    return design, ideal, simulate(design.circuit, design.transient)


def cut(waveforms: Waveforms, stop: float) -> Waveforms:
    kept = int(np.searchsorted(waveforms.time, stop, side="right"))
    return replace(waveforms, time=waveforms.time[:kept], values=waveforms.values[:kept])


def watched(fine: Waveforms, coarse: Waveforms, stop: float) -> Recording:
    design, ideal, _ = board()
    design = replace(design, transient=replace(design.transient, stop=stop))
    pending = Pending(lambda: fine, lambda: coarse, SHARE)
    clock = Clock(lambda stage: None)
    return watch(design, ideal, pending, clock, Effort(details=False))


@pytest.fixture
def judged(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The last instants of the records that are judged, s."""
    ends = []

    def counted(time, *arguments, **terms):
        ends.append(float(time[-1]))
        return measure(time, *arguments, **terms)

    measure = recording.measure
    monkeypatch.setattr(recording, "measure", counted)
    return ends


def test_the_second_run_of_a_board_that_settles_is_only_read(judged: list[float]) -> None:
    _, _, whole = board()
    stop = float(whole.time[-1])
    shifted = replace(whole, values=whole.values * (1 + 3e-4))
    found = watched(whole, shifted, stop)
    assert judged == [stop]
    # All outputs are 3e-4 of themselves apart: a third of that is the finer run's, of the largest.
    largest = max(abs(c.final) for c in found.measurements.channels)
    error = SHARE * 3e-4 * largest / found.measurements.amplitude
    assert found.error.steady_state == pytest.approx(error, rel=1e-9)
    assert 0 < found.error.settling_time < 1e-2 * found.measurements.settling_time.value


def test_two_runs_that_prove_nothing_agree(judged: list[float]) -> None:
    """Both end just inside their bands: readings are there, but no proof of settling."""
    _, _, whole = board()
    settled = watched(whole, whole, float(whole.time[-1])).measurements.settling_time.value
    part = cut(whole, 1.01 * settled)
    stop = float(part.time[-1])
    judged.clear()
    found = watched(part, part, stop)
    assert found.measurements.settling_time is None
    assert found.error.settling_time == 0.0
    assert judged == [stop, stop]


@pytest.mark.parametrize("first_is_whole", [True, False])
def test_one_run_that_settles_and_one_that_does_not_leave_it_open(first_is_whole: bool) -> None:
    _, _, whole = board()
    stop = float(whole.time[-1])
    short = cut(whole, 0.9 * stop)  # it ends before the stop time, so it proves nothing
    fine, coarse = (whole, short) if first_is_whole else (short, whole)
    found = watched(fine, coarse, stop)
    assert (found.measurements.settling_time is not None) == first_is_whole
    assert found.error.settling_time == math.inf
    assert math.isfinite(found.error.rise_time)
