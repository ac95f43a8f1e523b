"""What a baseline keeps of a verdict."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from taction.netlist_gen.scene.file import load_scene
from taction.verification.studies.regression.baseline_entry import (
    INSTANTS,
    Observation,
    fingerprint,
    observe,
)
from taction.verification.verdict.verify import Verdict, verify
from tests.support.entries import write_fast
from tests.support.making import write_matrix_scene


@pytest.fixture(scope="module")
def verdict(tmp_path_factory: pytest.TempPathFactory) -> Verdict:
    return verify(load_scene(write_fast(tmp_path_factory.mktemp("scene") / "fast.toml")))


@pytest.fixture(scope="module")
def seen(verdict: Verdict) -> Observation:
    return observe(verdict, "abc")


def test_measures_are_the_verdict_s_own(verdict: Verdict, seen: Observation) -> None:
    entry, m = seen.entry, verdict.measurements
    assert (entry.outcome, entry.revision, entry.simulator) == ("pass", "abc", "statespace, exact")
    assert entry.levels["u_2.final"] == m.channels[1].final == verdict.u[-1, 1]
    assert entry.times["settling_time"][0] == m.settling_time.value  # type: ignore[union-attr]
    assert entry.poles["growth_rate"] == verdict.poles.rightmost.real
    assert set(entry.states.values()) == {"settled"}
    assert set(entry.checks) == {check.name for check in verdict.checks}


def test_samples_are_simulated_points_with_both_ends(verdict: Verdict, seen: Observation) -> None:
    time = verdict.waveforms.time
    kept = seen.entry.time
    assert len(kept) <= INSTANTS
    assert (kept[0], kept[-1]) == (time[0], time[-1])
    where = np.searchsorted(time, kept)
    np.testing.assert_array_equal(time[where], kept)
    np.testing.assert_allclose(seen.entry.outputs["u_2"], verdict.u[where, 1], rtol=1e-8)


def test_samples_follow_what_the_outputs_do(verdict: Verdict, seen: Observation) -> None:
    """No output moves by more than a twentieth of the step between two samples while it rises."""
    moves = np.abs(np.diff(np.array(list(seen.entry.outputs.values())), axis=1))
    assert moves.max() < 0.05 * verdict.measurements.amplitude


def test_an_unstable_board_keeps_no_waveform(tmp_path: Path) -> None:
    scene = load_scene(write_fast(tmp_path / "fast.toml", capacitance="1pF"))
    entry = observe(verify(scene), "abc").entry
    assert entry.outcome == "fail"
    assert (entry.time, entry.outputs, entry.times) == ([], {}, {})
    assert entry.poles["growth_rate"] > 0
    assert set(entry.levels) == {"u_1.target", "u_2.target", "u_3.target"}


def test_a_fingerprint_is_of_what_was_asked_not_of_how_it_was_written(tmp_path: Path) -> None:
    def of(**changes: str) -> str:
        return fingerprint(load_scene(write_fast(tmp_path / "s.toml", **changes)))

    same = of()
    assert of(capacitance="1e-11") == same
    assert of(more="# a comment\n[regression]\ntimes = { relative = 0.5 }\n") == same
    assert of(capacitance="11pF") != same


def test_a_fingerprint_covers_the_arrays_of_a_scene(tmp_path: Path) -> None:
    def made(entry: str) -> str:
        text = f"[problem]\nkind = 'matrix'\nmatrix = [[{entry}]]\nstrain = [1.0]\n"
        file = tmp_path / "arrays.toml"
        file.write_text(text)
        return fingerprint(load_scene(file))

    assert made("2.0") == made("2")
    assert made("2.0") != made("2.5")


def test_a_fingerprint_covers_the_files_that_a_scene_names(tmp_path: Path) -> None:
    scene = load_scene(write_matrix_scene(tmp_path, [[1.0, 0.5], [0.5, 1.0]], [1.0, 2.0]))
    before = fingerprint(scene)
    (tmp_path / "eps.csv").write_text("1.0\n2.5\n")
    assert fingerprint(scene) != before
