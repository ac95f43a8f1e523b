"""Scenes that overflow, nest without end or ask for too much: a message, soon, and no result."""

from __future__ import annotations

import re
import time
from pathlib import Path

import pytest

from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.loading import load_scene
from taction.system.errors import InputError

MANY = "9" * 5000
SCENES = {
    "digits": (f"channels = {MANY}", "", "TOML"),
    "digits of a quantity": ("", f'gain = "{MANY}"', "design.gain"),
    "digits of lambda": ("", f"lambda = 1{'0' * 400}", "design.lambda"),
    "text of lambda": ("", f'lambda = "1{"0" * 400}"', "design.lambda"),
    "gain": ("", "gain = 1e300", "design.gain"),
    "capacitance": ("", 'capacitance = "1e-300"', "design.capacitance"),
    "depth": ("depth = 1e-300", "", "problem.depth"),
    "depth and span": ("depth = 1e-99\nspan = 1e99", "", "T"),
    "span": ("span = 1e308", "", "problem.span"),
    "modulus": ("modulus = 1e-308", "", "problem.modulus"),
    "force": ('load = { kind = "cylinder", force = 1e99, half_width = 1e-99 }', "", "the strain"),
    "noise": ("noise = { variance = 1e308 }", "", "problem.noise.variance"),
    "channels": ("channels = 20000", "", "problem.channels"),
    "dotted keys": ("", "a" + ".a" * 20_000 + " = 1", "a key of over 50 parts"),
    "quoted keys": ("", '"a"' + " . 'a'" * 20_000 + " = 1", "a key of over 50 parts"),
    "deep arrays": ("", f"a = {'[' * 3000}{']' * 3000}", "nested too deeply"),
    "deep values": ("", f"a = {'[' * 300}{']' * 300}", "unknown key"),
}


@pytest.mark.parametrize("name", SCENES)
def test_the_message_names_the_key(name: str, tmp_path: Path) -> None:
    problem, design, says = SCENES[name]
    file = tmp_path / "scene.toml"
    file.write_text(f'[problem]\nkind = "tactile"\n{problem}\n[design]\n{design}\n')
    began = time.process_time()
    with pytest.raises(InputError) as caught:
        make_problem(load_scene(file))
    assert says in str(caught.value)
    assert str(file) in str(caught.value)
    # With the line, of which 76 characters are shown; the folder of a test has any length.
    assert len(str(caught.value).replace(str(tmp_path), "")) < 640
    assert time.process_time() - began < 10.0  # tomllib alone takes minutes for dotted keys


def test_large_arrays_are_refused_by_their_entries(tmp_path: Path) -> None:
    for entry in (1e308, 1e-308):
        (tmp_path / "T.csv").write_text(f"{entry!r},{entry!r}\n")
        (tmp_path / "eps.csv").write_text("1.0\n")
        file = tmp_path / "scene.toml"
        file.write_text('[problem]\nkind = "matrix"\nmatrix = "T.csv"\nstrain = "eps.csv"\n')
        with pytest.raises(InputError, match=re.escape(f"largest entry of T is {entry:g};")):
            make_problem(load_scene(file))


def test_comments_and_texts_with_dots_are_no_keys(tmp_path: Path) -> None:
    file = tmp_path / "scene.toml"
    file.write_text(f"# {'. ' * 100}{'...' * 100}\n[problem]\nkind = 'tactile'\nspan = 6.25\n")
    assert load_scene(file).problem.kind == "tactile"
