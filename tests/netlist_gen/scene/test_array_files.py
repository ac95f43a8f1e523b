"""Arrays of a scene in files of numbers and in its own file, and what their mistakes ask."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from taction.netlist_gen.scene.array_files import read_array
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import InputError
from tests.support.making import write_matrix_scene


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    path = tmp_path / "s.toml"
    path.write_text('problem = {kind = "tactile"}')
    return load_scene(path)


@pytest.mark.parametrize("order", ["C", "F"])
def test_a_numpy_file_in_rows_or_in_columns(scene: Scene, tmp_path: Path, order: Any) -> None:
    wanted = np.arange(6, dtype=np.int32).reshape(2, 3)
    np.save(tmp_path / "T.npy", np.asarray(wanted, order=order))
    found = read_array(scene, "problem.matrix", "T.npy", (None, None))
    assert found.dtype == np.float64
    assert np.array_equal(found, wanted)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        (np.array([[1.0, np.nan]]), r"entry \(1, 2\) is not finite"),
        (np.array([[1j]]), "real numbers"),
        (np.array([["a"]]), "real numbers"),
        (np.array([[True]]), "real numbers"),
        (np.zeros((2, 2, 2)), "shape 2 x 2 x 2; expected rows of numbers"),
        (np.zeros((0, 3)), "shape 0 x 3"),
        (np.array([[object()]]), "Object arrays cannot be loaded"),
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


def header(damage: bytes) -> bytes:
    """A good file with a damaged header."""
    file = io.BytesIO()
    np.save(file, np.eye(3))
    return file.getvalue().replace(b"False", damage.ljust(5, b" "), 1)


DAMAGED = [header(damage) for damage in (b"\r\x0c", b"(3", b"'''", b"\\", b"\x00", b"L")]


@pytest.mark.parametrize("content", [b"", b"no numpy file", b"\x93NUMPY\x01\x00", *DAMAGED])
def test_a_file_that_is_no_numpy_file(scene: Scene, tmp_path: Path, content: bytes) -> None:
    (tmp_path / "T.npy").write_bytes(content)
    with pytest.raises(InputError, match=r"expected a \.npy file of real numbers"):
        read_array(scene, "problem.matrix", "T.npy", (None, None))


def test_a_numpy_header_that_lies_takes_no_memory(scene: Scene, tmp_path: Path) -> None:
    file = tmp_path / "T.npy"
    np.save(file, np.eye(3))
    lie, truth = b"(9999, 9999), }", b"(3, 3), }      "
    assert truth in file.read_bytes()
    file.write_bytes(file.read_bytes().replace(truth, lie))
    with pytest.raises(InputError, match="EOF: reading array data"):
        read_array(scene, "problem.matrix", "T.npy", (None, None))


T = [[2.0, 0.5, 0.1], [0.5, 1.0, 0.2]]  # two sensors, three channels


def message(folder: Path, scene: Path) -> str:
    with pytest.raises(InputError) as caught:
        make_problem(load_scene(scene))
    return str(caught.value)


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("T.csv", "u1,u2,u3\n1,2,3\n4,5,6\n", "a header begins with '#'"),
        ("eps.csv", "strain\n0.1\n0.2\n", "a header begins with '#'"),
        ("T.csv", "2,0;0,5;0,1\n0,5;1,0;0,2\n", "'.' as the decimal point and ',' between them"),
        ("T.csv", "2.0;0.5;0.1\n0.5;1.0;0.2\n", "'.' as the decimal point and ',' between them"),
        ("T.csv", "2.0\t0.5\t0.1\n", "'.' as the decimal point and ',' between them"),
        ("T.csv", "2.0 0.5 0.1\n", "'.' as the decimal point and ',' between them"),
        ("eps.csv", "0,1\n0,2\n", "is ',' a decimal comma here?"),
        ("T.csv", "1,2,3\n4,x,6\n", "line 2, column 2: 'x' is not a finite number; expected num"),
        ("T.csv", "nan,1,2\n", "'nan' is not a finite number; expected numbers"),
        ("T.csv", "1,2,3\n4,٥,6\n", "line 2, column 2: '٥' has '٥'; expected numbers with '.'"),
        ("T.csv", "1,２,3\n", "line 1, column 2: '２' has '２'"),
        ("T.csv", "1,1_5,3\n", "line 1, column 2: '1_5' has '_'"),
        ("T.csv", "1,2,3\n4,1e-999,6\n", "line 2, column 2: '1e-999' would be 0"),
        ("T.csv", "1,-0.5e-400,3\n", "line 1, column 2: '-0.5e-400' would be 0"),
    ],
)
def test_what_a_file_seems_to_be_is_asked(
    tmp_path: Path, name: str, text: str, expected: str
) -> None:
    scene = write_matrix_scene(tmp_path, T, [0.2, 0.1])
    (tmp_path / name).write_text(text)
    assert expected in message(tmp_path, scene)


def test_a_transposed_matrix_is_recognised_by_the_shapes(tmp_path: Path) -> None:
    scene = write_matrix_scene(tmp_path, T, [0.2, 0.1, 0.3])
    text = message(tmp_path, scene)
    assert "shape 3 x 1; expected 2" in text or "shape 3; expected 2" in text
    assert "is problem.matrix transposed?" in text
    other = write_matrix_scene(tmp_path, T, [0.2, 0.1, 0.3, 0.4])
    assert "is problem.matrix" not in message(tmp_path, other)


SCENE = """
[problem]
kind = "matrix"
matrix = {matrix}
strain = [1, 0.5]
[design]
lambda = 0.1
gain = "100k"
opamp = {{ base = "ideal" }}
[analysis]
engine = "statespace"
"""


def scene_file(folder: Path, matrix: str) -> Path:
    path = folder / "scene.toml"
    path.write_text(SCENE.format(matrix=matrix), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("matrix", "text"),
    [
        ("[[1.0, 0.2], [0.2]]", "problem.matrix = [[1.0, 0.2], [0.2]]: expected the name"),
        ("[true, false]", "or an array of real numbers: rows of one length"),
        ("[[[1.0]]]", "or an array of real numbers"),
        ('[["1"]]', "or an array of real numbers"),
        ("[[]]", "shape 1 x 0"),
        ("[[nan, 1]]", "entry (1, 1) is not finite"),
        (f"[[1{'0' * 400}, 1]]", "a number is out of range"),
    ],
)
def test_what_is_no_matrix_is_refused(tmp_path: Path, matrix: str, text: str) -> None:
    with pytest.raises(InputError) as caught:
        load_scene(scene_file(tmp_path, matrix))
    assert text in str(caught.value)
