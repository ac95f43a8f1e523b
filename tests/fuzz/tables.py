"""Matrices in CSV and ``.npy`` files, and the axes of a sweep."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from taction.netlist_gen.scene.array_files import read_array
from taction.netlist_gen.scene.axes import parse_axes
from taction.verification.studies.sweep.plan import Plan
from tests.fuzz.edits import BYTE_EDITS, VALUE_EDIT, edited
from tests.fuzz.target import Target
from tests.support.making import make_scene

NUMBERS = np.array([[1.0, -0.25, 3e-7], [0.0, 2.5, 1e30]])
SCENE = make_scene()


def _npy(values: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, values)
    return file.getvalue()


def _reader(name: str, expected: Callable[[bytes], np.ndarray]) -> Callable[[bytes, Path], str]:
    def examine(content: bytes, folder: Path) -> str:
        (folder / name).write_bytes(content)
        scene = SCENE.model_copy()
        scene._file = folder / "scene.toml"
        values = read_array(scene, "problem.matrix", name, (None, None))
        assert np.isfinite(values).all()
        np.testing.assert_array_equal(values, expected(content))
        return "accepted, the same numbers"

    return examine


def _split(content: bytes) -> np.ndarray:
    """Read numbers between commas without the csv module; quotes are taken away."""
    text = content.decode("utf-8-sig")
    lines = [line for line in re.split("\r\n|\r|\n", text) if re.sub('[,"]', "", line).strip()]
    rows = [line.split(",") for line in lines if not line.lstrip(' \t"').startswith("#")]
    return np.array([[float(cell.replace('"', "")) for cell in row] for row in rows])


def _axes(content: bytes, folder: Path) -> str:
    words = content.decode("utf-8", "replace").split("\n")
    groups = parse_axes(SCENE, words)
    plan = Plan(SCENE, groups, "statespace")
    values = [plan.values_at(place) for place in range(min(5, plan.points))]
    assert values
    return "accepted"


CSV = b"\n".join(b",".join(b"%r" % x for x in row) for row in NUMBERS.tolist())
NPY = [_npy(NUMBERS.round(1).clip(-9.0, 9.0).astype(kind)) for kind in ("<f8", ">f4", "i8", "u1")]
NPY.append(_npy(np.asfortranarray(NUMBERS)))
AXES = [b"C=1pF:1nF:31", b"gain=10k:1M:21:lin", b"lambda=0.1,0.2", b"C=1p:2p:3 gain=1M:2M:3"]

TABLES = (
    Target(
        "matrices, CSV",
        edited([CSV, b"# y\n1,2\r\n\n3,4\n", b"1\n"], [VALUE_EDIT, *BYTE_EDITS]),
        _reader("T.csv", _split),
    ),
    Target(
        "matrices, .npy",
        edited(NPY, [VALUE_EDIT, *BYTE_EDITS]),
        _reader("T.npy", lambda content: np.load(io.BytesIO(content), allow_pickle=False)),
    ),
    Target("axes of a sweep", edited(AXES, [VALUE_EDIT, *BYTE_EDITS]), _axes),
)
