"""Values, tables, pictures and exported waveforms as files."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from taction.netlist_gen.board.circuit import Output
from taction.netlist_gen.scene.loading import load_scene
from taction.system.documents import plain
from taction.system.raw_file import read_raw
from taction.system.waveforms import Cost, Waveforms
from taction.verification.readings.readings import Reading
from taction.verification.report.documents.verdict import verdict_document
from taction.verification.report.output_checks import (
    export,
)
from taction.verification.report.texts import KNOWN, figure, with_error
from taction.verification.report.views.answer_view import check_bar
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.record import Channel, finite
from taction.verification.verdict.verify import Verdict, verify
from tests.support.measured import channel
from tests.support.paths import SCENES


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (None, "s", "–"),
        (math.nan, "step", "–"),
        (1.5e-5, "s", "15 µs"),
        (0.0123, "step", "1.23 %"),
        (-1234.5, "1/s", "-1.234 k/s"),
        (2.0, "ratio", "2"),
        (12345, "", "12345"),
        ("ua741", "", "ua741"),
    ],
)
def test_values_with_their_units(value: float | str | None, unit: str, text: str) -> None:
    assert figure(value, unit) == text


@pytest.mark.parametrize("value", [1.0, 3.2e-9, -4.7e5])
def test_a_bound_is_written_down_to_1_ppm_and_never_as_a_smaller_unit(value: float) -> None:
    """What has no bound behind it is known as well as `KNOWN` says, or says that it is not."""
    assert "1 ppm" in KNOWN
    for share, shown in ((1e-3, True), (2e-6, True), (9e-7, False), (1e-13, False), (0.0, False)):
        text = with_error(value, share * abs(value), "s")
        assert ("±" in text) is shown, (share, text)
    assert with_error(value, None, "s").endswith("± unknown")
    assert with_error(value, math.inf, "s").endswith("± unknown")
    check = Check("rise_time", Outcome.PASS, value, 1e-10 * abs(value), None, None, "s", "")
    assert "±" not in check_bar(check).value


@cache
def verdict() -> Verdict:
    scene = load_scene(SCENES / "tuned-breadboard.toml")
    analysis = scene.analysis.model_copy(update={"engine": "statespace"})
    found = verify(scene.model_copy(update={"analysis": analysis}))
    every = slice(None, None, 40)  # enough points to draw
    waves = found.waveforms
    waves = replace(waves, time=waves.time[every], values=waves.values[every])
    return replace(found, run=replace(found.run, ends=waves))


def test_a_document_is_plain_and_counts_channels_from_one() -> None:
    document = verdict_document(verdict())
    assert [record["index"] for record in document["channels"]] == list(range(1, 8))
    for record in document["channels"]:
        bounds = record["uncertainties"]
        readings = {"rise_time", "settling_time", "overshoot", "undershoot"}
        assert readings < set(bounds) <= readings | {"equilibrium"} | {"rise_time"}
        assert all(0.0 < bounds[name] < 1e-6 for name in ("overshoot", "undershoot"))
    assert document["engine"] == document["simulator"] == "statespace"
    assert (document["solver"], document["method"]) == (None, "exact")
    assert document["error_budget"]["opamps"]["unit"] == "V"
    fragile = plain(Channel.of(channel(rise_time=Reading(1e-5, 0.0, True, 4e-6))))
    assert (fragile["fragile"], fragile["alternatives"]) == (True, {"rise_time": 4e-6})
    assert finite(None) is None
    assert finite(Reading(float("nan"), 0.0)) is None


def test_an_exported_record_keeps_every_digit(tmp_path: Path) -> None:
    """Two channels, the second read with a minus sign."""
    time = np.array([0.0, 1 / 3, 1.0])
    values = np.array([[0.0, 0.0], [1 / 7, -0.1], [1e-20, -2 / 3]])
    waveforms = Waveforms(time, ("v_1", "a_2"), values, "test", Cost(0.0, 3))
    circuit = replace(verdict().circuit, outputs=(Output("v_1", 1.0), Output("a_2", -1.0)))
    export(circuit, waveforms, str(tmp_path / "w.csv"))
    assert (tmp_path / "w.csv").read_text().splitlines()[0] == "time,u_1,u_2"
    table = np.loadtxt(tmp_path / "w.csv", delimiter=",", skiprows=1)
    assert np.array_equal(table, np.column_stack([time, values * [1.0, -1.0]]))
    export(circuit, waveforms, str(tmp_path / "w.raw"))
    plot = read_raw(tmp_path / "w.raw")
    assert plot.vectors == ("time", "v(v_1)", "v(a_2)")
    assert np.array_equal(plot.data, np.column_stack([time, values]))
