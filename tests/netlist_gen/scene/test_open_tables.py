"""Names and tables of keys that other packages add to a scene."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path

import pytest

from taction.netlist_gen.scene.axes import parse_axes, with_settings
from taction.netlist_gen.scene.keys import scene_text
from taction.netlist_gen.scene.scene import Scene, parse_scene
from taction.system.errors import InputError
from taction.verification.studies.running.versions import digest

Plugin = Callable[..., Path]
GROUPS = {
    "taction.checks": {"droop": "DROOP", "quiet": "QUIET"},
    "taction.topologies": {"ladder": "LADDER", "mesh": "MESH"},
    "taction.engines": {"spectre": "SPECTRE"},
}
SOURCE = """
from types import SimpleNamespace
from pydantic import Field
from taction.netlist_gen.scene.check_keys import UpperLimit
from taction.netlist_gen.scene.fields import Count, Model, NonNegative, Ohms, Seconds

class DroopCheck(UpperLimit):
    max: NonNegative = Field(description="fraction of the step amplitude")
    after: Seconds = 1e-3

class LadderKeys(Model):
    sections: Count = 3
    rung: Ohms = 1e3

DROOP, QUIET = SimpleNamespace(keys=DroopCheck), SimpleNamespace(keys=None)
LADDER, MESH = SimpleNamespace(keys=LadderKeys), SimpleNamespace()
SPECTRE = object()
"""


def data(**tables: object) -> dict[str, object]:
    return {"problem": {"kind": "tactile"}, **tables}


def complaints(**tables: object) -> str:
    with pytest.raises(InputError) as refused:
        parse_scene(data(**tables), "scene.toml")
    return str(refused.value)


def test_a_scene_has_the_tables_and_names_of_plugins(plugin: Plugin) -> None:
    before = parse_scene(data(), "scene.toml")
    plugin("acme", GROUPS, SOURCE)
    scene = parse_scene(
        data(
            checks={"droop": {"max": 0.1, "after": "2ms"}},
            design={"topology": "ladder", "ladder": {"rung": "2.2k"}},
            analysis={"engine": "spectre"},
        ),
        "scene.toml",
    )
    assert isinstance(scene, Scene)
    assert (scene.checks.droop.max, scene.checks.droop.after) == (0.1, 2e-3)  # type: ignore[attr-defined]
    assert scene.design.ladder.model_dump() == {"sections": 3, "rung": 2200.0}  # type: ignore[attr-defined]
    assert scene.design.topology == "ladder"
    assert scene.with_engine("spectre") == scene
    plain = parse_scene(data(checks={"droop": 0.2}), "scene.toml")
    assert plain.checks.droop.max == 0.2  # type: ignore[attr-defined]
    assert parse_scene(data(), "scene.toml").checks.droop is None  # type: ignore[attr-defined]
    assert not hasattr(before.checks, "droop")


def test_a_scene_with_plugins_can_be_sent_stored_written_and_varied(plugin: Plugin) -> None:
    plugin("acme", GROUPS, SOURCE)
    tables = {"checks": {"droop": 0.1}, "design": {"topology": "ladder", "ladder": {"rung": 50}}}
    scene = parse_scene(data(**tables), "scene.toml")
    again = pickle.loads(pickle.dumps(scene))  # noqa: S301 - our own
    assert again == scene
    assert type(again) is type(scene)
    assert digest(again) == digest(scene)
    assert digest(parse_scene(data(**{**tables, "checks": {"droop": 0.2}}), "s")) != digest(scene)
    text = scene_text(scene)
    assert "droop = { max = 0.1 }" in text
    assert "ladder = { rung = 50.0 }" in text or 'ladder = { rung = "50ohm" }' in text
    ((axis,),) = parse_axes(scene, ["design.ladder.rung=10:1k:3"])
    assert axis.key.unit == "ohm"
    moved = with_settings(scene, ["checks.droop.after=5ms", "design.ladder.sections=7"])
    assert moved.checks.droop.after == 5e-3  # type: ignore[attr-defined]
    assert moved.design.ladder.sections == 7  # type: ignore[attr-defined]


def test_keys_that_are_no_model_are_refused(plugin: Plugin) -> None:
    plugin("acme", {"taction.checks": {"droop": "DROOP"}}, "class DROOP:\n    keys = dict\n")
    with pytest.raises(InputError) as refused:
        parse_scene(data(), "scene.toml")
    assert str(refused.value) == (
        "plug-in acme 1.0: taction.checks = 'droop': acme:DROOP.keys is dict; expected Model"
    )
