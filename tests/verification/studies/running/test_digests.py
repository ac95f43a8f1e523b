"""Digests: equal content, equal key; any change that could change a result, another key."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.verification.studies.running.digests import digest, own_code
from tests.support.making import make_scene
from tests.support.paths import ROOT


def test_the_encoding_is_fixed() -> None:
    # By hand: sha256 of b"t1:" + b"int1:7" (types and lengths are part of it).
    assert digest(7) == hashlib.sha256(b"t1:int1:7").digest()


def test_types_and_borders_count() -> None:
    values: list[tuple[object, ...]] = [
        (1,),
        (1.0,),
        ("1",),
        (True,),
        (b"1",),
        (None,),
        ("ab", "c"),
        ("a", "bc"),
        (("a", "b"), "c"),
        ("a", ("b", "c")),
        (np.array([1.0, 2.0]),),
        (np.array([[1.0, 2.0]]),),
        (np.array([1.0, 2.0], dtype=np.float32),),
        (0.0,),
        (-0.0,),
    ]
    assert len({digest(*value) for value in values}) == len(values)


def test_order_of_a_mapping_and_layout_of_an_array_do_not_count() -> None:
    T = np.arange(6.0).reshape(2, 3)
    assert digest({"a": 1, "b": 2}) == digest({"b": 2, "a": 1})
    assert digest(T) == digest(np.asfortranarray(T)) == digest(T.astype(">f8"))


def test_equal_circuits_have_equal_digests_in_any_process() -> None:
    scene = make_scene({"channels": 3})
    circuit = synthesise(scene, make_problem(scene))
    script = (
        "from taction.netlist_gen.scene.inverse_problem import make_problem\n"
        "from taction.netlist_gen.board.synthesis import synthesise\n"
        "from tests.support.making import make_scene\n"
        "from taction.verification.studies.running.digests import digest\n"
        "scene = make_scene({'channels': 3})\n"
        "print(digest(synthesise(scene, make_problem(scene))).hex())\n"
    )
    other = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True)
    assert other.stdout.strip() == digest(circuit).hex()


def test_one_resistor_makes_another_digest() -> None:
    scene = make_scene({"channels": 3})
    circuit = synthesise(scene, make_problem(scene))
    ohms = circuit.forward.ohms.copy()
    ohms[1, 2] = np.nextafter(ohms[1, 2], np.inf)
    changed = replace(circuit, matrices=(replace(circuit.forward, ohms=ohms),))
    assert digest(changed.forward) != digest(circuit.forward)


def test_unknown_content_is_refused() -> None:
    with pytest.raises(TypeError, match="no canonical encoding of object"):
        digest(object())


def test_the_own_code_is_one_number_a_version() -> None:
    assert len(own_code()) == 32
    assert own_code() == own_code()
