"""A matrix and a strain that stand in the scene file itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from taction.netlist_gen.scene.file import load_scene
from taction.system.errors import InputError
from taction.verification.verdict.verify import verify
from tests.support.running import taction

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


def test_the_board_settles_at_the_solution_of_the_normal_equations(tmp_path: Path) -> None:
    T, eps = np.array([[1.0, 0.2], [0.2, 1.0]]), np.array([1.0, 0.5])
    verdict = verify(load_scene(scene_file(tmp_path, "[[1, 0.2], [0.2, 1]]")))
    expected = np.linalg.solve(T.T @ T + 0.1 * np.eye(2), T.T @ eps)
    assert [c.target for c in verdict.measurements.channels] == pytest.approx(expected.tolist())
    assert verdict.outcome.value == "pass"


def test_a_sweep_and_its_workers_read_it_too(tmp_path: Path) -> None:
    path = scene_file(tmp_path, "[[1, 0.2], [0.2, 1]]")
    words = ("sweep", str(path), "--over", "C=50p,100p", "-o", str(tmp_path / "a.sqlite"))
    done = taction(*words, "--jobs", "2")
    assert done.exit_code == 0, done.output
    assert "2 points: 2 pass" in done.output


@pytest.mark.parametrize(
    ("matrix", "text"),
    [
        (
            "[[1.0, 0.2], [0.2]]",
            "problem.matrix = [[1.0, 0.2], [0.2]]: expected the name",
        ),
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
