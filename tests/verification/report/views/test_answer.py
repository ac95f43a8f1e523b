"""The sentence about the answer's error; values, bands and waveforms as they are shown."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from taction.netlist_gen.board.circuit import Output
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.keys import scene_text
from taction.netlist_gen.scene.scene import load_scene
from taction.system.array_types import Cost, Waveforms
from taction.system.documents import plain
from taction.system.raw_file import read_raw
from taction.verification.readings.readings import Reading
from taction.verification.reference.ideal_answer import IdealNetwork
from taction.verification.reference.solve import solve
from taction.verification.report.blocks import PICTURE
from taction.verification.report.documents.verdict import verdict_document
from taction.verification.report.output_checks import export
from taction.verification.report.renderers.page import page_html
from taction.verification.report.renderers.terminal import page_text
from taction.verification.report.texts import KNOWN, with_error
from taction.verification.report.views.answer_view import (
    answer_text,
    check_bar,
    screen,
    true_error_text,
)
from taction.verification.report.views.verdict_view import view
from taction.verification.verdict.answer_error import AnswerError
from taction.verification.verdict.checks import Check, Outcome, cause
from taction.verification.verdict.record import Channel, Record, finite
from taction.verification.verdict.verify import Verdict, verify
from tests.support.measured import channel
from tests.support.paths import SCENES

LESS = "; a smaller lambda regularises less, but lets more noise through"
MORE = "; a larger lambda lets less noise through, but regularises more"
BOARD = "scenes/known-readings.toml"
BAND = "to ±2.5 %"


def one(eps: float, lam: float, stress: float | None, board: float | None = 1e-5) -> AnswerError:
    """u = eps / (1 + lam), in units of 2 V; the step has 1 V."""
    network = IdealNetwork(np.eye(1), np.array([eps]), lam, 1e-6, U0=2.0)
    known = None if stress is None else np.array([stress])
    found = AnswerError.of(network, solve(network.problem), known)
    return replace(found, board=board, step=1.0)  # V


@pytest.mark.parametrize(
    ("eps", "lam", "end"),
    [
        # 0.9 / 1.25 = 0.72: 0.2 lost by lambda, 0.08 by noise.
        (0.9, 0.25, "28 % OF from the true stress, because of regularisation (20 %) and"
                     " strain noise (8 %)"),
        # 1.5 / 1.25 = 1.2: noise of 0.4, of which lambda takes 0.2.
        (
            1.5,
            0.25,
            "20 % OF from the true stress, because of strain noise (40 %), partly cancelled by"
            " regularisation (20 %)",
        ),
        (1.0, 0.25, "20 % OF from the true stress, because of regularisation alone"),
        (1.0 + 1e-10, 1.0, "50 % OF from the true stress, because of regularisation (50 %), partly"
                           " cancelled by strain noise (under 1 ppm)"),
        (1.25, 0.25, "the true stress within 1 ppm"),  # noise cancels lambda
    ],
)  # fmt: skip
def test_causes(eps: float, lam: float, end: str) -> None:
    start = "The board as drawn finds the regularised answer within 0.001 % of the step"
    answer, end = one(eps, lam, 1.0), end.replace("OF", "(of the largest, 2 V)")
    if "because" in end:
        end += MORE if abs(eps - 1.0) > lam else LESS  # 1 + lambda divides both
    assert answer_text(answer) == f"{start}; that answer is {end}."
    assert true_error_text(answer) == f"The regularised answer is {end}."


def test_lambda_trades_regularisation_against_noise_as_the_sentence_says() -> None:
    """A smaller lambda has less of the one part and more of the other; the sentence names it."""
    for eps, ends in ((1.1, LESS), (1.6, MORE)):
        less, own, more = (one(eps, lam, 1.0) for lam in (0.2, 0.25, 0.3))
        assert f"{ends}." in answer_text(own)
        bias, noise = (
            [abs(getattr(each, name)) for each in (less, own, more)]
            for name in ("regularisation", "noise")
        )
        assert bias == sorted(bias)
        assert noise == sorted(noise, reverse=True)
        errors = [abs(each.true_error) for each in (less, own, more)]
        assert (errors == sorted(errors)) is (ends is LESS)


def test_what_is_known() -> None:
    assert answer_text(one(1.25, 0.25, None)) == (
        "The board as drawn finds the regularised answer within 0.001 % of the step; the true"
        " stress is not known."
    )
    assert answer_text(one(1.25, 0.25, 0.0)).endswith("of the step; the true stress is zero.")
    assert "within 1 ppm of the step;" in answer_text(one(1.25, 0.25, None, board=0.0))
    shares = {(1.21e-5, 0.0): "0.0013 %", (1.2e-5, 1e-9): "0.0013 %", (3.0, 0.0): "300 %"}
    for (volts, error), shown in (shares | {(1e-6, 0.0): "1 ppm"}).items():  # never too small
        answer = replace(one(1.0, 0.25, 1.0, board=volts), board_error=error)
        assert f" within {shown} of the step;" in answer_text(answer)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene whose band is no round number, so that no text has it by chance."""
    scene = with_values(load_scene(BOARD), {"checks.settling_time.band": 0.025})
    free = scene.checks.settling_time.model_copy(update={"min": None, "max": 1e-3})
    checks = scene.checks.model_copy(update={"settling_time": free})
    place = tmp_path_factory.mktemp("bands") / "board.toml"
    found = scene.model_copy(update={"checks": checks}).with_engine("statespace")
    place.write_text(scene_text(found), encoding="utf-8")
    return place


def test_verdicts_in_every_medium(file: Path) -> None:
    verdict = verify(load_scene(file))
    whole = view(verdict)
    for text in (page_text(whole), page_text(screen(verdict)), page_html(whole)):
        assert re.search(rf"[Ss]ettl\w* {BAND}", re.sub(r"\s+", " ", text))
    assert BAND in next(iter(whole.blocks(PICTURE))).title
    slow = [replace(c, expected=1e-9) for c in verdict.checks if c.name == "settling_time"]
    late = cause([replace(c, outcome=Outcome.FAIL) for c in slow])
    assert late is not None
    assert late.text.startswith(f"settles {BAND} in ")


def test_a_board_that_grows_has_no_excursions_in_any_record() -> None:
    """That of its record depends on its length."""
    boards = (with_values(load_scene(BOARD), {"design.capacitance": c}) for c in (1e-12, 1e-11))
    grows, rests = (Record.of(verify(each.with_engine("statespace"))) for each in boards)
    assert (grows.stable, rests.stable) == (False, True)
    for one, other in zip((grows, *grows.channels), (rests, *rests.channels), strict=True):
        assert one.figure("rise_time").value is None
        for name in ("overshoot", "undershoot"):
            assert one.figure(name).value is None
            assert other.figure(name).value is not None


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
