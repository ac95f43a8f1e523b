"""Messages about files of numbers ask what the file seems to be."""

from __future__ import annotations

from pathlib import Path

import pytest

from taction.netlist_gen.scene.file import load_scene
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.system.errors import InputError
from tests.support.making import write_matrix_scene

T = [[2.0, 0.5, 0.1], [0.5, 1.0, 0.2]]  # two sensors, three channels


def message(folder: Path, scene: Path) -> str:
    with pytest.raises(InputError) as caught:
        make_problem(load_scene(scene))
    return str(caught.value)


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("T.csv", "u1,u2,u3\n1,2,3\n4,5,6\n", "is line 1 a header?"),
        ("eps.csv", "strain\n0.1\n0.2\n", "is line 1 a header?"),
        ("T.csv", "2,0;0,5;0,1\n0,5;1,0;0,2\n", "separated by ';' and ',' is a decimal comma"),
        ("T.csv", "2.0;0.5;0.1\n0.5;1.0;0.2\n", "separated by ';'; expected ',' between values"),
        ("T.csv", "2.0\t0.5\t0.1\n", "separated by tabs; expected"),
        ("T.csv", "2.0 0.5 0.1\n", "separated by blanks; expected"),
        ("eps.csv", "0,1\n0,2\n", "is ',' a decimal comma here?"),
        ("T.csv", "1,2,3\n4,x,6\n", "line 2, column 2: 'x' is not a finite number; expected a num"),
        ("T.csv", "nan,1,2\n", "'nan' is not a finite number; expected a number"),
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
