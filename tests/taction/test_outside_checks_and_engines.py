"""A check and an engine of other packages: the text of the recipes, in every command and medium."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

import taction
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import scene_type
from taction.system.waveforms import Waveforms
from taction.verification.verdict import recording
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.run_checks import CHECKS, OWN
from tests.support.paths import ROOT
from tests.support.plugins import recipe
from tests.support.running import document
from tests.support.running import taction as command

SCENE = """
name = "outside"
[problem]
kind = "tactile"
channels = 3
span = 2.0
[design]
gain = "1Mohm"
lambda = 0.5
opamp = { base = "ua741", input_errors = "none" }
[analysis]
engine = "even_steps"
[checks]
swing = "10V"
"""


@pytest.fixture
def scene(plugin: Callable[..., Path], tmp_path: Path) -> Path:
    """The file of a scene that asks for the outside check and the outside engine."""
    for title in ("Add a check", "Add an engine"):
        plugin(*recipe(title))
    file = tmp_path / "outside.toml"
    file.write_text(SCENE, "utf-8")
    return file


def found(verdict: Any, name: str) -> Any:
    return next(check for check in verdict.checks if check.name == name)


def changed(change: Callable[[np.ndarray[Any, Any]], np.ndarray[Any, Any]]) -> Any:
    """A function that changes the voltages of waveforms."""

    def plant(wave: Waveforms) -> Waveforms:
        return replace(wave, values=change(np.array(wave.values)))

    return plant


def test_own_checks_have_the_tables_of_the_scene() -> None:
    fields = scene_type().model_fields["checks"].annotation.model_fields  # type: ignore[union-attr]
    assert list(fields) == [name for name in fields if name in OWN]
    for name, kind in OWN.items():
        assert (kind.keys is not None) == (name in fields)
        assert kind.keys is None or str(kind.keys.__name__) in str(fields[name].annotation)


def test_a_verdict_has_the_check_and_the_error_of_the_engine(scene: Path) -> None:
    verdict = taction.verify(scene)
    assert verdict.outcome is Outcome.PASS
    check = found(verdict, "swing")
    assert check.value == pytest.approx(float(np.abs(verdict.u).max()))
    assert 0.0 < check.uncertainty < 1e-6
    assert list(CHECKS)[-1] == "swing"
    assert verdict.waveforms.engine == "even_steps"
    # The state-space engine simulates beside it, and both agree to rounding.
    assert found(verdict, "engines_agree").value < 1e-9
    assert verdict.accuracy.reached


def test_every_medium_shows_them(scene: Path, tmp_path: Path) -> None:
    page, picture = tmp_path / "a.html", tmp_path / "a.svg"
    asked = ("verify", str(scene), "--json", "--report", str(page), "--plot", str(picture))
    shown = command(*asked)
    assert shown.exit_code == 0, shown.output
    data = document(shown)
    (check,) = (each for each in data["checks"] if each["name"] == "swing")
    assert (check["outcome"], check["unit"], check["expected"]) == ("pass", "V", 10.0)
    assert data["engine"] == "even_steps"
    assert data["keys"]["checks.swing.max"] == {"value": 10.0, "unit": "V"}
    name = data["taction"]["schema"]
    known = json.loads((ROOT / f"docs/schemas/{name}.json").read_text("utf-8"))
    jsonschema.Draft202012Validator(known).validate(data)
    table = command("verify", str(scene)).stdout
    notebook = taction.verify(scene)._repr_html_()
    assert "swing" in picture.read_text("utf-8")  # a picture names no engine
    for text in (table, page.read_text("utf-8"), notebook):
        assert "swing" in text
        assert "even_steps" in text or "even steps" in text


def test_a_sweep_has_them(scene: Path, tmp_path: Path) -> None:
    """Also in the processes of a sweep, as an axis, and in every medium."""
    store = ("-o", str(tmp_path / "a.sqlite"))
    swept = command("sweep", str(scene), "--over", "gain=1M,2M", "--jobs", "2", "--json", *store)
    assert swept.exit_code == 0, swept.output
    points = document(swept)["points"]
    assert [point["engine"] for point in points] == ["even_steps"] * 2
    assert [point["outcome"] for point in points] == ["pass"] * 2
    page, picture = tmp_path / "a.html", tmp_path / "a.svg"
    over = ("--over", "checks.swing.max=1mV,10V", "--jobs", "1")
    files = ("-o", str(tmp_path / "b.sqlite"), "--report", str(page), "--plot", str(picture))
    limited = document(command("sweep", str(scene), *over, "--json", *files))
    assert [point["outcome"] for point in limited["points"]] == ["fail", "pass"]
    swing = f"{1e3 * found(taction.verify(scene), 'swing').value:.3g} mV"
    assert limited["points"][0]["reason"] == f"swing: {swing} (limit: at most 1 mV)"
    shown = command("sweep", str(scene), *over, *files[:2])  # as it is stored
    assert "engine: even steps" in shown.stdout
    for text in (shown.stdout, page.read_text("utf-8"), picture.read_text("utf-8")):
        assert "swing" in text
        assert "even_steps" in text or "even steps" in text


def test_a_fault_in_what_the_check_judges_is_caught(
    scene: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    true = found(taction.verify(scene), "swing").value
    outputs = recording.outputs
    limit = {"checks.swing.max": 1.5 * true}
    limited = with_values(load_scene(scene), limit)
    assert taction.verify(limited).outcome is Outcome.PASS
    monkeypatch.setattr(recording, "outputs", lambda *given: 2.0 * outputs(*given))
    assert found(taction.verify(limited), "swing").outcome is Outcome.FAIL


def test_a_fault_in_the_engine_is_caught(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import acme_engine  # type: ignore[import-not-found]

    assert taction.verify(scene).outcome is Outcome.PASS
    simulate, plant = acme_engine.simulate, changed(lambda volts: 1.01 * volts)
    monkeypatch.setattr(acme_engine, "simulate", lambda *given: plant(simulate(*given)))
    verdict = taction.verify(scene)
    assert verdict.outcome is Outcome.FAIL
    assert found(verdict, "engines_agree").outcome is Outcome.FAIL
