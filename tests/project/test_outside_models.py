"""An op-amp and a signal amplifier of another package, in every command and medium.

The packages are the recipes of ``docs/extending.md``, installed as a user would install them.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jsonschema
import mpmath
import numpy as np
import pytest

import taction as door
from taction.netlist_gen.scene.open_tables import AMPLIFIERS
from taction.verification.engines.statespace.equations.amplifier_gains import GAINS
from taction.verification.reference.regularisers import REGULARISERS
from taction.verification.report.documents.catalogue import schema
from tests.support.paths import ROOT
from tests.support.plugins import environment, recipe
from tests.support.running import document, taction

Plugin = Callable[..., Path]
SCENE = """
name = "outside"
[problem]
kind = "tactile"
channels = 3
span = 2.0
[design]
capacitance = "200pF"
{design}
[checks]
overshoot = 0.3
noise = "1mV"
[analysis]
engine = "{engine}"
"""


@dataclass(frozen=True)
class Outside:
    """One addition: its recipe, its name, and what a scene says to use it."""

    title: str
    name: str
    design: str
    key: str  # of the scene, with another value
    other: str

    def scene(self, folder: Path, engine: str = "ngspice") -> Path:
        file = folder / "outside.toml"
        file.write_text(SCENE.format(design=self.design, engine=engine), "utf-8")
        return file


OPAMP = Outside("Add an op-amp", "acme1", 'opamp = "acme1"', "opamp.base", "tl084")
AMPLIFIER = Outside(
    "Add a signal amplifier",
    "cubic",
    'opamp = { base = "tl084", input_errors = "none" }\namplifier = "cubic"',
    "amplifier",
    "sinh",
)
BOTH = pytest.mark.parametrize("outside", [OPAMP, AMPLIFIER], ids=["op-amp", "amplifier"])


def checked(text: str, name: str) -> Any:
    """The document of a command, valid by its published schema."""
    data = json.loads(text)
    jsonschema.validate(data, schema(name))
    return data


@BOTH
def test_without_its_package_a_name_is_refused(outside: Outside, tmp_path: Path) -> None:
    run = taction("verify", str(outside.scene(tmp_path)))
    assert run.exit_code == 2
    assert f"'{outside.name}'" in run.stderr
    assert "one of '" in run.stderr


@BOTH
def test_verify_shows_it_in_every_medium(
    outside: Outside, tmp_path: Path, ngspice: str, plugin: Plugin
) -> None:
    assert ngspice
    plugin(*recipe(outside.title))
    scene = outside.scene(tmp_path)
    page, picture = tmp_path / "page.html", tmp_path / "picture.svg"
    files = ("--report", str(page), "--plot", str(picture))
    run = taction("verify", str(scene), "--json", *files)
    assert run.exit_code == 0, run.stderr
    found = checked(run.stdout, "verify")
    assert found["outcome"] == "pass"
    checks = {check["name"]: check for check in found["checks"]}
    assert checks["engines_agree"]["value"] < 1e-3
    assert checks["steady_state"]["value"] < 1e-3
    assert outside.name in page.read_text("utf-8")
    assert "<svg" in picture.read_text("utf-8")
    terminal = taction("verify", str(scene), "--engine", "statespace", "--changes", "0")
    assert terminal.stdout.rstrip().endswith("PASS")
    verdict = door.verify(scene, engine="statespace")
    assert "pass" in verdict._repr_html_().lower()
    assert outside.name in door.load_scene(scene)._repr_html_()


@BOTH
def test_a_sweep_runs_over_it_in_worker_processes(
    outside: Outside, tmp_path: Path, plugin: Plugin
) -> None:
    folder = plugin(*recipe(outside.title))
    scene = outside.scene(tmp_path, "statespace")
    page, picture = tmp_path / "page.html", tmp_path / "picture.svg"
    words = ("sweep", str(scene), "--over", f"{outside.key}={outside.other},{outside.name}")
    more = ("-o", str(tmp_path / "s.sqlite"), "--jobs", "2", "--json")
    run = subprocess.run(
        [sys.executable, "-m", "taction", *words, *more, "--report", page, "--plot", picture],
        cwd=ROOT,
        env=environment(folder),
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stderr
    found = checked(run.stdout, "sweep")
    assert outside.name in json.dumps(found)
    assert outside.name in page.read_text("utf-8")
    assert outside.name in picture.read_text("utf-8")
    assert document(taction(*words, *more))["ran"] == 0  # both are stored


@BOTH
def test_the_scene_schema_and_the_deck_have_it(
    outside: Outside, tmp_path: Path, plugin: Plugin
) -> None:
    plugin(*recipe(outside.title))
    made = document(taction("new", "--schema"))
    assert outside.name in json.dumps(made["$defs"]["Design"]) + json.dumps(
        made["$defs"]["OpAmpChoice"]
    )
    deck = taction("netlist", str(outside.scene(tmp_path)))
    assert deck.exit_code == 0
    assert outside.name in deck.stdout


def test_the_op_amp_is_listed_measured_and_chosen(tmp_path: Path, plugin: Plugin) -> None:
    plugin(*recipe(OPAMP.title))
    assert "acme1" in taction("models").stdout
    shown = checked(taction("models", "show", "acme1", "--json").stdout, "models-show")
    assert "acme1" in json.dumps(shown)
    scene = door.load_scene(OPAMP.scene(tmp_path, "statespace"))
    from taction.verification.design.choice_plan import ChoiceRequest, choice_plan

    assert "acme1" in choice_plan(scene, ChoiceRequest()).axes[0].values


def test_the_three_descriptions_of_the_amplifier_are_one_function(plugin: Plugin) -> None:
    plugin(*recipe(AMPLIFIER.title))
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
