"""``taction models`` and ``taction models show``."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.running import document, taction

OLD = {"ideal", "ua741", "lf353", "tl084", "lf356", "ne5534", "op27"}
NEW = {"lm324", "tl072", "opa2134", "ad711", "ad8065", "lt1028", "opa1612", "lmp7721"}


def test_the_list_has_every_preset() -> None:
    models = document(taction("models", "--json"))
    assert set(models) == OLD | NEW
    assert models["ideal"]["gbw"] is None  # infinite
    assert models["ua741"]["source"]
    assert models["lm324"]["bias_current"] == -20e-9
    assert "ua741" in taction("models").stdout


@pytest.mark.usefixtures("ngspice")
def test_one_op_amp_is_shown_with_what_its_model_does() -> None:
    shown = document(taction("models", "show", "ua741", "--json"))
    assert shown["figures"]["slew_rate"] == {"value": 0.5e6, "unit": "V/s", "note": ""}
    assert shown["figures"]["saturation"]["note"] == "14 V of 15 V into 10 kohm"
    swing = shown["measured"]["swing"]
    assert swing["stated"] == 14.0
    for witness in ("state space", "ngspice"):
        assert swing[witness] == pytest.approx(14.0, rel=1e-3)


@pytest.mark.usefixtures("ngspice")
def test_the_table_says_what_a_sheet_does_not_print() -> None:
    text = " ".join(taction("models", "show", "lf353").stdout.split())
    assert "phase margin 60 degrees 60 degrees 60 degrees no figure: assumed" in text
    assert "LF353-N Wide Bandwidth Dual JFET Input Operational Amplifier, SNOSBH3" in text


@pytest.mark.usefixtures("ngspice")
def test_the_picture_has_both_witnesses_and_the_crossing(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    file = tmp_path / "ua741.svg"
    assert taction("models", "show", "ua741", "--plot", str(file)).exit_code == 0
    drawn = file.read_text("utf-8")
    for text in ("unity gain at 1 MHz", "phase margin 65 degrees", "ngspice", "4.7 % overshoot"):
        assert f"<!-- {text}" in drawn or text in drawn


def test_mistakes_are_named(tmp_path: Path) -> None:
    unknown = taction("models", "show", "ua714")
    assert unknown.exit_code == 2
    assert "did you mean 'ua741'?" in unknown.stderr
    wrong = taction("models", "show", "ua741", "--plot", str(tmp_path / "x.gif"))
    assert wrong.exit_code == 2
    assert "--plot" in wrong.stderr


def test_without_ngspice_our_equations_remain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TACTION_NGSPICE", "/nowhere/ngspice")
    run = taction("models", "show", "op27", "--json")
    gain = document(run)["measured"]["dc_gain"]
    assert gain.keys() == {"unit", "stated", "state space"}
    assert "without ngspice" in run.stderr
