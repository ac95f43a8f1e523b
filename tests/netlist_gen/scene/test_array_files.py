"""Arrays from NumPy files and CSV."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from taction.netlist_gen.scene.array_files import read_array, read_profile
from taction.netlist_gen.scene.file import load_scene
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import InputError


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    path = tmp_path / "s.toml"
    path.write_text('problem = {kind = "tactile"}')
    return load_scene(path)


def test_a_numpy_file(scene: Scene, tmp_path: Path) -> None:
    wanted = np.arange(6, dtype=np.int32).reshape(2, 3)
    np.save(tmp_path / "T.npy", wanted)
    found = read_array(scene, "problem.matrix", "T.npy", (None, None))
    assert found.dtype == np.float64
    assert np.array_equal(found, wanted)


@pytest.mark.parametrize("text", ["1,2,3\n", "1\n2\n3\n", "# c\n\n 1 ,2, 3\n", "\ufeff1,2,3\n"])
def test_a_vector_may_stand_as_a_row_or_a_column(scene: Scene, tmp_path: Path, text: str) -> None:
    (tmp_path / "v.csv").write_text(text, encoding="utf-8")
    assert read_array(scene, "problem.strain", "v.csv", (3,)).tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("values", "says"),
    [
        (np.array([[1.0, np.nan]]), r"entry \(1, 2\) is not finite"),
        (np.array([[1j]]), "real numbers"),
        (np.array([["a"]]), "real numbers"),
        (np.array([[True]]), "real numbers"),
        (np.zeros((2, 2, 2)), "shape 2 x 2 x 2; expected rows of numbers"),
        (np.zeros((0, 3)), "shape 0 x 3"),
        (np.array([[object()]]), "its type is object"),
    ],
)
def test_a_numpy_file_that_holds_no_matrix(
    scene: Scene, tmp_path: Path, values: NDArray[np.generic], says: str
) -> None:
    np.save(tmp_path / "T.npy", values, allow_pickle=True)
    with pytest.raises(InputError, match=says) as caught:
        read_array(scene, "problem.matrix", "T.npy", (None, None))
    assert caught.value.file.endswith("T.npy")
    assert caught.value.complaints[0].key == "problem.matrix"


@pytest.mark.parametrize("content", [b"", b"no numpy file", b"\x93NUMPY\x01\x00"])
def test_a_file_that_is_no_numpy_file(scene: Scene, tmp_path: Path, content: bytes) -> None:
    (tmp_path / "T.npy").write_bytes(content)
    with pytest.raises(InputError, match=r"expected a \.npy file of real numbers"):
        read_array(scene, "problem.matrix", "T.npy", (None, None))


def test_a_profile_has_two_columns(scene: Scene, tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text("0,1,2\n1,2,3\n")
    with pytest.raises(InputError, match="shape 2 x 3; expected any x 2"):
        read_profile(scene, "problem.load.file", "p.csv")


def test_a_numpy_header_that_lies_takes_no_memory(scene: Scene, tmp_path: Path) -> None:
    file = tmp_path / "T.npy"
    np.save(file, np.eye(3))
    lie, truth = b"(9999, 9999), }", b"(3, 3), }      "
    assert truth in file.read_bytes()
    file.write_bytes(file.read_bytes().replace(truth, lie))
    with pytest.raises(InputError, match="72 bytes of values, its header says 799840008"):
        read_array(scene, "problem.matrix", "T.npy", (None, None))


def test_a_numpy_file_in_columns(scene: Scene, tmp_path: Path) -> None:
    values = np.arange(6.0).reshape(2, 3)
    np.save(tmp_path / "T.npy", np.asfortranarray(values))
    assert np.array_equal(read_array(scene, "problem.matrix", "T.npy", (None, None)), values)


def test_a_pipe_is_no_matrix(scene: Scene, tmp_path: Path) -> None:
    for name in ("T.csv", "T.npy"):
        os.mkfifo(tmp_path / name)
        with pytest.raises(InputError, match="not a regular file"):
            read_array(scene, "problem.matrix", name, (None, None))


@pytest.mark.parametrize("damage", [b"\r\x0c", b"(3", b"'''", b"\\", b"\x00", b"L"])
def test_a_numpy_header_that_is_damaged(scene: Scene, tmp_path: Path, damage: bytes) -> None:
    file = tmp_path / "T.npy"
    np.save(file, np.eye(3))
    content = file.read_bytes()
    file.write_bytes(content.replace(b"False", damage.ljust(5, b" "), 1))
    with pytest.raises(InputError, match=r"expected a \.npy file of real numbers"):
        read_array(scene, "problem.matrix", "T.npy", (None, None))
