"""Additions of other packages, in every command and medium: an op-amp, an amplifier, a check with
an engine. They are the recipes of ``docs/extending.md``, installed as a user would install them.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jsonschema
import mpmath
import numpy as np
import pytest

import taction as door
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.open_tables import AMPLIFIERS
from taction.netlist_gen.scene.scene import load_scene
from taction.verification.engines.statespace.equations.amplifier_gains import GAINS
from taction.verification.reference.regularisers import REGULARISERS
from taction.verification.report.documents.document_catalogue import schema
from taction.verification.verdict import run as run_module
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.run_checks import CHECKS
from tests.support.packages import environment, recipe
from tests.support.running import document, python, taction

Plugin = Callable[..., Path]
SCENE = """
name = "outside"
[problem]
kind = "tactile"
channels = 3
span = 2.0
[design]
{design}
[checks]
overshoot = 0.3
{check}
[analysis]
engine = "{engine}"
"""
PLAIN = 'opamp = { base = "tl084", input_errors = "none" }'
CALM = 'capacitance = "200pF"\n'
JUDGED = 'gain = "1Mohm"\nlambda = 0.5\nopamp = { base = "ua741", input_errors = "none" }'


@dataclass(frozen=True)
class Outside:
    """An addition: its recipes, its names, and what a scene says to use it; an axis with it."""

    titles: tuple[str, ...]
    names: tuple[str, ...]
    over: str
    design: str
    engine: str = "ngspice"
    check: str = 'noise = "1mV"'

    def scene(self, folder: Path, engine: str = "") -> Path:
        """Write the scene into a folder."""
        file = folder / "outside.toml"
        text = SCENE.format(design=self.design, check=self.check, engine=engine or self.engine)
        file.write_text(text, "utf-8")
        return file


OPAMP = Outside(("Add an op-amp",), ("acme1",), "opamp.base=tl084,acme1", CALM + 'opamp = "acme1"')
AMPLIFIER = Outside(
    ("Add a signal amplifier",), ("cubic",), "amplifier=sinh,cubic",
    f'{CALM}{PLAIN}\namplifier = "cubic"',
)  # fmt: skip
JUDGE = Outside(
    ("Add a check", "Add an engine"), ("swing", "even steps"), "checks.swing.max=1mV,10V", JUDGED,
    engine="even_steps", check='swing = "10V"',
)  # fmt: skip
ADDITIONS = {"op-amp": OPAMP, "amplifier": AMPLIFIER, "check and engine": JUDGE}


@pytest.fixture(params=ADDITIONS)
def outside(request: pytest.FixtureRequest) -> Outside:
    return ADDITIONS[request.param]


@pytest.fixture
def installed(outside: Outside, plugin: Plugin) -> list[Path]:
    return [plugin(*recipe(title)) for title in outside.titles]


def has(text: str, outside: Outside, *, picture: bool = False) -> bool:
    """Whether a text has the names of the addition; a picture names no engine."""
    names = outside.names[:1] if picture else outside.names
    return all(name in text or name.replace(" ", "_") in text for name in names)


def checked(text: str, name: str) -> Any:
    """Return the document of a command, valid by its schema."""
    data = json.loads(text)
    jsonschema.validate(data, schema(name))
    return data


def test_without_its_package_a_name_is_refused(outside: Outside, tmp_path: Path) -> None:
    run = taction("verify", str(outside.scene(tmp_path)))
    assert run.exit_code == 2
    assert f"'{outside.names[0]}'" in run.stderr or f"checks.{outside.names[0]}" in run.stderr


@pytest.mark.usefixtures("installed", "ngspice")
def test_verify_shows_it_in_every_medium(outside: Outside, tmp_path: Path) -> None:
    scene, page, picture = outside.scene(tmp_path), tmp_path / "a.html", tmp_path / "a.svg"
    run = taction("verify", str(scene), "--json", "--report", str(page), "--plot", str(picture))
    assert run.exit_code == 0, run.stderr
    found = checked(run.stdout, "verify")
    assert found["outcome"] == "pass"
    checks = {check["name"]: check for check in found["checks"]}
    assert checks["engines_agree"]["value"] < 1e-3
    assert checks["steady_state"]["value"] < 1e-3
    assert has(json.dumps(found), outside)
    assert has(page.read_text("utf-8"), outside)
    assert "<svg" in picture.read_text("utf-8")
    shown = taction("verify", str(scene), "--changes", "0").stdout
    assert shown.rstrip().endswith("PASS")
    cards = door.verify(scene)._repr_html_() + door.load_scene(scene)._repr_html_()
    assert has(cards, outside)
    deck = taction("netlist", str(scene)).stdout
    assert outside is JUDGE or has(deck, outside)
    made = json.dumps(door.scene_schema())
    assert outside.names[0] in made


@pytest.mark.parametrize("outside", ["check and engine"], indirect=True)
def test_a_sweep_runs_over_it_in_worker_processes(
    outside: Outside, installed: list[Path], tmp_path: Path
) -> None:
    scene = outside.scene(tmp_path, "even_steps" if outside is JUDGE else "statespace")
    page, picture = tmp_path / "page.html", tmp_path / "picture.svg"
    words = ("sweep", str(scene), "--over", outside.over)
    more = ("-o", str(tmp_path / "s.sqlite"), "--jobs", "2", "--json")
    files = ("--report", str(page), "--plot", str(picture))
    run = python("-m", "taction", *words, *more, *files, env=environment(*installed))
    assert run.returncode == 0, run.stderr
    found = checked(run.stdout, "sweep")
    for text in (run.stdout, page.read_text("utf-8")):
        assert has(text, outside)
    assert has(picture.read_text("utf-8"), outside, picture=True)
    assert document(taction(*words, *more))["ran"] == 0  # both are stored
    if outside is JUDGE:
        assert [point["outcome"] for point in found["points"]] == ["fail", "pass"]
        check = next(each for each in door.verify(scene).checks if each.name == "swing")
        swing = f"{1e3 * check.value:.3g} mV"
        assert found["points"][0]["reason"] == f"swing: {swing} (limit: at most 1 mV)"


def test_the_three_descriptions_of_the_amplifier_are_one_function(plugin: Plugin) -> None:
    plugin(*recipe(AMPLIFIER.titles[0]))
    v = np.array([-3.0, -0.2, 0.0, 1e-9, 0.7, 25.0])
    with mpmath.workdps(40):
        exact = [mpmath.mpf(x) + mpmath.mpf(x) ** 3 / 3 for x in v.tolist()]
        g, slope = [float(x) for x in exact], [float(1 + mpmath.mpf(x) ** 2) for x in v.tolist()]
        area = [float(mpmath.quad(lambda t: t + t**3 / 3, [0, x])) for x in v.tolist()]
    gain, entry = GAINS["cubic"], REGULARISERS["cubic"]
    assert gain.value(v) == pytest.approx(g, rel=1e-14)
    assert gain.slope(v) == pytest.approx(slope, rel=1e-14)
    h = np.full(6, 0.3)
    assert gain.from_coordinate(v + h * gain.value(v), h) == pytest.approx(v, rel=1e-12)
    assert entry.g(v) == pytest.approx(g, rel=1e-14)
    assert entry.slope(v) == pytest.approx(slope, rel=1e-14)
    assert entry.inverse(np.array(g)) == pytest.approx(v, rel=1e-12)
    assert entry.potential(v) == pytest.approx(area, rel=1e-12, abs=1e-30)
    assert entry.v_from_q(0.2 * v + h * np.array(g), 0.2, h) == pytest.approx(v, rel=1e-12)
    assert AMPLIFIERS["cubic"].expression.format(x="V(a)") == "(V(a)+V(a)*V(a)*V(a)/3)"


def test_a_check_and_an_engine_of_others_are_judged_as_ours(
    plugin: Plugin, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for title in JUDGE.titles:
        plugin(*recipe(title))
    scene = JUDGE.scene(tmp_path)
    verdict = door.verify(scene)
    checks = {check.name: check for check in verdict.checks}
    assert checks["swing"].value == pytest.approx(float(np.abs(verdict.u).max()))
    assert 0.0 < checks["swing"].uncertainty < 1e-6
    assert list(CHECKS)[-1] == "swing"
    # The state-space engine simulates beside it, and both agree to rounding.
    assert (verdict.waveforms.engine, verdict.accuracy.reached) == ("even_steps", True)
    assert checks["engines_agree"].value < 1e-9
    limited = with_values(load_scene(scene), {"checks.swing.max": 1.5 * checks["swing"].value})
    assert door.verify(limited).outcome is Outcome.PASS

    def failed() -> set[str]:
        return {each.name for each in door.verify(limited).checks if each.outcome is Outcome.FAIL}

    outputs = run_module.outputs
    with monkeypatch.context() as patch:  # a fault in what the check judges
        patch.setattr(run_module, "outputs", lambda *given: 2.0 * outputs(*given))
        assert "swing" in failed()
    import acme_engine  # type: ignore[import-not-found]

    simulate = acme_engine.simulate

    def faulty(*given: Any) -> Any:
        wave = simulate(*given)
        return replace(wave, values=1.01 * np.array(wave.values))

    monkeypatch.setattr(acme_engine, "simulate", faulty)
    assert "engines_agree" in failed()
