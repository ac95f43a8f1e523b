"""A record beside another solution, whose readings bound the errors."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from taction.netlist_gen.scene.scene import parse_scene
from taction.verification.engines.statespace.transients.simulate import simulate
from taction.verification.reference.ideal_answer import IdealAnswer, ideal_answer
from taction.verification.verdict import bounded_measures, recording
from taction.verification.verdict.companion import Companion
from taction.verification.verdict.design import design_board
from taction.verification.verdict.planned_board import PlannedBoard
from taction.verification.verdict.progress import Clock
from taction.verification.verdict.recording import Recording, record_and_measure
from taction.verification.verdict.simulation import Pending, outputs
from taction.verification.verdict.state_space_error import StateSpaceError
from taction.verification.waveforms import Waveforms
from tests.support.paths import SCENES

DOUBT = 1e-6  # V, of the other record


@cache
def board() -> tuple[PlannedBoard, IdealAnswer, Waveforms]:
    """The shipped breadboard, its reference and its exact transient."""
    file = SCENES / "paper-breadboard.toml"
    data = tomllib.loads(file.read_text(encoding="utf-8"))
    data["analysis"] = data.get("analysis", {}) | {"engine": "ngspice"}
    design = design_board(parse_scene(data, file), Clock(lambda stage: None))
    ideal = ideal_answer(design.network, design.scene)
    times = np.linspace(0.0, design.transient.stop, 30_001)
    return design, ideal, simulate(design.board, design.transient, times=times)


def cut(waveforms: Waveforms, stop: float) -> Waveforms:
    kept = int(np.searchsorted(waveforms.time, stop, side="right"))
    return replace(waveforms, time=waveforms.time[:kept], values=waveforms.values[:kept])


def recorded(
    fine: Waveforms, other: Waveforms, stop: float, monkeypatch: pytest.MonkeyPatch
) -> Recording:
    """Measure `fine` beside `other`, the record of a board that has no exact solution."""
    design, ideal, _ = board()
    transient = replace(design.plan.transient, stop=stop)
    design = replace(design, plan=replace(design.plan, transient=transient))
    u, values = outputs(design.circuit, fine)[: len(other.time)], outputs(design.circuit, other)
    error = StateSpaceError(DOUBT, DOUBT, 0.0, "", "")
    beside = Companion(other.time, u, values, other, error, "")
    monkeypatch.setattr(recording, "find_companion", lambda *_: beside)
    monkeypatch.setattr(bounded_measures, "is_exact", lambda _: False)
    monkeypatch.setattr(recording, "better_plan", lambda *_: None)
    clock = Clock(lambda stage: None)
    pending = Pending(lambda: replace(fine, engine="ngspice"))
    return record_and_measure(design, ideal, pending, clock)[1]


def test_all_errors_follow_from_the_other_record(monkeypatch: pytest.MonkeyPatch) -> None:
    _, _, whole = board()
    stop = float(whole.time[-1])
    shifted = replace(whole, values=whole.values * (1 + 3e-4))
    found = recorded(whole, shifted, stop, monkeypatch)
    # All outputs are 3e-4 of themselves apart, and the largest difference counts.
    largest = max(abs(c.final) for c in found.measurements.channels)
    error = (3e-4 * largest + DOUBT) / found.measurements.amplitude
    assert found.error.steady_state == pytest.approx(error, rel=1e-9)
    assert 0 < found.error.readings["settling_time"] < 1e-2 * found.measurements.settling_time.value


def test_two_records_that_prove_nothing_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both end just inside their bands: readings are there, but no proof of settling."""
    _, _, whole = board()
    settled = recorded(whole, whole, float(whole.time[-1]), monkeypatch)
    part = cut(whole, 1.01 * settled.measurements.settling_time.value)
    stop = float(part.time[-1])
    found = recorded(part, part, stop, monkeypatch)
    assert found.measurements.settling_time is None
    assert found.error.readings["settling_time"] == 0.0


def test_a_record_that_settles_beside_one_that_does_not_leaves_it_open(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _, _, whole = board()
    stop = float(whole.time[-1])
    short = cut(whole, 0.9 * stop)  # it ends before the stop time, so it proves nothing
    found = recorded(whole, short, stop, monkeypatch)
    assert found.measurements.settling_time is not None
    assert found.error.readings["settling_time"] == math.inf
    assert math.isfinite(found.error.readings["rise_time"])
