"""The measures of a deck, run by ngspice, against the readings of `verify`.

ngspice joins points by straight lines and its trapezoidal rule has 125 points on a period of
ringing, so a rise time is right to 1e-3 and an overshoot to 1e-4 A. A settling time is the last
crossing of the band: where the ringing just touches the band, it is right to one period.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

import taction
from taction.netlist_gen.deck.deck import Deck
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.scene import load_scene
from taction.system.errors import InputError
from taction.verification.readings.measurements import ChannelMeasure
from tests.support import nightly
from tests.support.other_simulators import run_ngspice
from tests.support.paths import SCENES

RESULT = re.compile(r"(?m)^((?:last|t_settle|t_rise|overshoot)\w*)\s+=\s+(\S+)")
MODES = {"ngspice": "", "ltspice": "ltpsa", "hspice": "hsa"}


def results(deck: Deck, folder: Path, mode: str = "") -> dict[str, float]:
    words = ["-D", f"ngbehavior={mode}"] if mode else []
    printed = run_ngspice(deck, folder, *words).stdout
    found = dict(RESULT.findall(printed))
    return {name: float(value) for name, value in found.items() if value != "failed"}


def measured(name: str, **options: bool) -> Deck:
    return taction.netlist(SCENES / f"{name}.toml", measure=True, **options)


def agree(n: int, channel: ChannelMeasure, found: dict[str, float], period: float) -> None:
    """Every measure of a channel is there, and it is the reading within its error."""
    settling = channel.settling_time.value
    assert found[f"t_settle_{n}"] == pytest.approx(settling, rel=2e-3, abs=period)
    if channel.rise_time is None:
        assert f"t_rise_{n}" not in found
    else:
        assert found[f"t_rise_{n}"] == pytest.approx(channel.rise_time.value, rel=1e-3)
    assert found[f"overshoot_{n}"] == pytest.approx(channel.overshoot, abs=1e-4)


@pytest.mark.parametrize(
    ("name", "period"),
    [("tuned-breadboard", 0.0), ("paper-exponential", 0.0), *nightly(("paper-breadboard", 2.1e-5))],
)
def test_measures_are_readings(name: str, period: float, ngspice: str, tmp_path: Path) -> None:
    readings = taction.verify(SCENES / f"{name}.toml", engine="statespace").measurements
    found = results(measured(name), tmp_path)
    expected = readings.settling_time.value
    assert found["t_settle"] == pytest.approx(expected, rel=1e-3)
    for n, channel in enumerate(readings.channels, 1):
        agree(n, channel, found, period)


@pytest.mark.parametrize("dialect", MODES)
def test_every_dialect_measures_known_readings(dialect: str, ngspice: str, tmp_path: Path) -> None:
    deck = taction.netlist(SCENES / "known-readings.toml", dialect=dialect, measure=True)
    found = results(deck, tmp_path, MODES[dialect])
    settling = "last" if dialect == "ltspice" else "t_settle"  # ngspice does not read its PARAM
    assert 77.44e-6 < found[settling] < 78.22e-6  # the scene's limits, from 320-bit arithmetic
    assert 21.97e-6 < found["t_rise_2"] < 22.10e-6


def test_what_moves_at_the_end_of_a_record_has_not_settled(ngspice: str, tmp_path: Path) -> None:
    deck = measured("known-readings")
    stop = re.search(r"(?m)^\.tran \S+ (\S+)", deck.text)
    text = deck.text.replace(stop[1], "5e-05").replace(repr(0.9 * float(stop[1])), "4.5e-05")
    assert results(replace(deck, text=text), tmp_path)["t_settle"] == 1e99
    changes = {"design.capacitance": 8.2e-12, "analysis.stop": 300e-6}  # it oscillates: the paper
    scene = with_values(load_scene(SCENES / "paper-breadboard.toml"), changes)
    found = results(taction.netlist(scene, measure=True), tmp_path)
    assert 0.0 < found["last"] < 300e-6
    settlings = [value for name, value in found.items() if name.startswith("t_settle")]
    assert settlings == [1e99] * 8


def test_a_deck_for_another_program_has_even_steps() -> None:
    """125 on a period of the board's ringing at 37.3 kHz; ngspice controls its steps itself."""
    own, other = (
        taction.netlist(SCENES / "paper-breadboard.toml", dialect=dialect).analysis
        for dialect in ("ngspice", "ltspice")
    )
    assert other.max_step == pytest.approx(1.0 / (125 * 37.3e3), rel=1e-3)
    assert own.max_step > 100.0 * other.max_step


@pytest.mark.parametrize("dialect", ["xyce", "spectre"])
def test_measures_that_no_free_program_checks_are_refused(dialect: str) -> None:
    with pytest.raises(
        InputError, match=rf"--dialect = {dialect}: --measure: .*expected ngspice, ltspice, hspice$"
    ):
        taction.netlist(SCENES / "known-readings.toml", dialect=dialect, measure=True)
