"""Commands that need no scene: models, doctor, new."""

from __future__ import annotations

from pathlib import Path

from tests.support.running import document, taction


def test_models_and_doctor() -> None:
    models = document(taction("models", "--json"))
    assert set(models) == {"ideal", "ua741", "lf353", "tl084", "lf356", "ne5534", "op27"}
    assert models["ideal"]["gbw"] is None  # infinite
    assert models["ua741"]["source"]
    assert "ua741" in taction("models").stdout
    findings = document(taction("doctor", "--json"))["findings"]
    assert [finding["what"] for finding in findings[:2]] == ["Python", "ngspice"]


def test_new_does_not_overwrite(tmp_path: Path) -> None:
    file = tmp_path / "board.toml"
    assert document(taction("new", str(file), "--json")) == {"file": str(file)}
    again = taction("new", str(file))
    assert again.exit_code == 2
    assert "--force" in again.stderr
    assert taction("new", str(file), "--force").exit_code == 0
    assert taction("new", str(tmp_path / "no" / "x.toml")).exit_code == 2


def test_a_new_scene_verifies(tmp_path: Path) -> None:
    file = tmp_path / "board.toml"
    taction("new", str(file))
    assert taction("verify", str(file), "--engine", "statespace").exit_code == 0
