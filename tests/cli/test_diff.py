"""``taction diff``: keys first, then readings with their difference and its bound."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from taction.spice_models.input_errors import NONE
from taction.verification.studies.difference import compare_verdicts
from tests.support.entries import write_fast
from tests.support.paths import DATA, SCENES
from tests.support.running import document, taction


def readings(found: Any) -> dict[tuple[str, int | None], Any]:
    return {(r["name"], r["channel"]): r for r in found["readings"] if r["group"] != "checks"}


def test_a_scene_differs_from_itself_in_nothing(tmp_path: Path) -> None:
    scene = str(write_fast(tmp_path / "a.toml"))
    result = taction("diff", scene, scene)
    assert result.exit_code == 0
    assert "keys: no difference" in result.stdout
    assert ", 0 beyond" in result.stdout


def test_keys_come_first_with_their_defaults_then_readings_beyond_the_bounds(
    tmp_path: Path,
) -> None:
    first = write_fast(tmp_path / "a.toml")
    second = write_fast(tmp_path / "b.toml", capacitance="20pF", opamp="lf353")
    found = document(result := taction("diff", str(first), str(second), "--json"))
    assert result.exit_code == 1
    keys = {key["key"]: key for key in found["keys"]}
    assert keys["design.capacitance"] == {
        "key": "design.capacitance",
        "first": 1e-11,
        "second": 2e-11,
        "unit": "F",
        "content": False,
    }
    assert keys["design.opamp.slew_rate"]["second"] == 13e6  # of the LF353's data sheet
    assert "design.gain" not in keys
    rise = readings(found)["rise_time", 2]
    assert rise["difference"] == rise["second"] - rise["first"] > 0
    assert rise["beyond"] is True
    text = taction("diff", str(first), str(second)).stdout
    assert text.index("Keys") < text.index("Readings")


def test_stored_documents_are_compared_without_a_run(tmp_path: Path) -> None:
    scene = str(write_fast(tmp_path / "a.toml"))
    stored = tmp_path / "a.json"
    stored.write_text(taction("verify", scene, "--json").stdout, encoding="utf-8")
    assert taction("diff", str(stored), scene, "--json").exit_code == 0
    known = json.loads(stored.read_text())
    bound = known["channels"][0]["uncertainties"]["settling_time"]
    known["channels"][0]["settling_time"] += 1.9 * bound
    stored.write_text(json.dumps(known))
    assert taction("diff", str(stored), scene).exit_code == 0
    known["channels"][0]["settling_time"] += 0.2 * bound
    del known["keys"]
    stored.write_text(json.dumps(known))
    result = taction("diff", str(stored), scene)
    assert result.exit_code == 1
    assert "keys: unknown" in result.stdout


def test_a_verdict_of_version_1_is_read(tmp_path: Path) -> None:
    """It was stored before the documents became types; its readings are those of today."""
    stored = str(DATA / "verdict-of-version-1.json")
    assert json.loads(Path(stored).read_text())["taction"]["schema"] == "verify-1"
    scene, today = str(SCENES / "custom-matrix.toml"), tmp_path / "today.json"
    as_then = ["opamp=tl084", "opamp.input_errors=none", "unit_voltage=1V"]
    settings = [word for text in as_then for word in ("--set", f"design.{text}")]
    settings += ["--set", "analysis.points_per_period=30"]
    run = taction("verify", scene, *settings, "--engine", "statespace", "--json")
    today.write_text(run.stdout, encoding="utf-8")
    found = document(result := taction("diff", stored, str(today), "--json"))
    assert result.exit_code == 0
    assert len(found["readings"]) > 30
    assert not [each for each in found["readings"] if each["beyond"] is not False]
    assert {key["key"] for key in found["keys"]} == {
        "design.exponential_slope",
        "design.strain_input",
        "design.opamp.input_errors",
        *(f"design.opamp.{name}" for name in NONE),
        *(f"design.opamp.{name}" for name in ("offset_drift", "bias_drift", "bias_doubling")),
        *("design.opamp.supply_rejection", "design.supply_tolerance"),
        "design.temperature_coefficient",
    }


def test_a_file_of_the_same_name_with_another_content_is_a_difference(tmp_path: Path) -> None:
    scenes = []
    for folder, entry in (("a", "1.0"), ("b", "1.1")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "T.csv").write_text(f"2.0,0.5\n0.5,{entry}\n")
        (tmp_path / folder / "e.csv").write_text("0.2\n0.1\n")
        scene = tmp_path / folder / "board.toml"
        problem = 'kind = "matrix"\nmatrix = "T.csv"\nstrain = "e.csv"'
        scene.write_text(f'[problem]\n{problem}\n[analysis]\nengine = "statespace"\n')
        scenes.append(str(scene))
    result = taction("diff", *scenes)
    assert "T.csv (another content)" in result.stdout


def test_an_unknown_bound_leaves_the_question_open() -> None:
    def one(value: float) -> dict[str, Any]:
        return {
            "outcome": "pass",
            "checks": [],
            "channels": [],
            "step_amplitude": value,
            "stability": {"rightmost_pole": [-1.0, 0.0], "rightmost_pole_uncertainty": 0.0},
        }

    assert compare_verdicts(one(1.0), one(1.0), ("a", "b")).exit_status == 0
    assert compare_verdicts(one(1.0), one(2.0), ("a", "b")).exit_status == 3


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("{", "expected the document of one verdict"),
        ("[1]", "the document = a list of 1: expected a table"),
        ('{"verdicts": []}', "several scenes"),
        ('{"scene": "a"}', "outcome: missing; expected a text"),
    ],
)
def test_what_is_no_verdict_is_refused(tmp_path: Path, text: str, reason: str) -> None:
    stored = tmp_path / "a.json"
    stored.write_text(text)
    result = taction("diff", str(stored), str(stored))
    assert result.exit_code == 2
    assert reason in result.stderr
