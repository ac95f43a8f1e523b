"""Arrays of a scene in files of numbers and in its own file, and what their mistakes ask."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest
from numpy.typing import NDArray

from taction.netlist_gen.scene.inverse_problem import (
    cylinder_stress,
    grid,
    kernel,
    make_problem,
    read_array,
)
from taction.netlist_gen.scene.problem_keys import CylinderLoad
from taction.netlist_gen.scene.scene import Scene, load_scene
from taction.system.errors import InputError
from tests.support.making import make_scene, write_matrix_scene

T = [[2.0, 0.5, 0.1], [0.5, 1.0, 0.2]]  # two sensors, three channels


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
        ("eps.csv", "0,1\n0,2\n", "shape 2 x 2; expected 2"),
        ("T.csv", "1,2,3\n4,x,6\n", "row 2, column 2: could not convert string to float: 'x'"),
        ("T.csv", "nan,1,2\n", "entry (1, 1) is not finite"),
        ("T.csv", "1,2,3\n4,٥,6\n", "row 2, column 2: '٥' has '٥'; expected numbers with '.'"),
        ("T.csv", "1,２,3\n", "row 1, column 2: '２' has '２'"),
        ("T.csv", "1,1_5,3\n", "row 1, column 2: '1_5' has '_'"),
        ("T.csv", "1,2,3\n4,1e-999,6\n", "row 2, column 2: '1e-999' would be 0"),
        ("T.csv", "1,-0.5e-400,3\n", "row 1, column 2: '-0.5e-400' would be 0"),
    ],
)
def test_a_wrong_file_is_refused_with_what_is_accepted(
    tmp_path: Path, name: str, text: str, expected: str
) -> None:
    scene = write_matrix_scene(tmp_path, T, [0.2, 0.1])
    (tmp_path / name).write_text(text)
    assert expected in message(tmp_path, scene)


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


def flamant_strain(y: float, x: float, E: float, nu: float, *, tangential: bool) -> mpmath.mpf:
    """Plane strain ``eps_xx`` under a unit line load on a half plane, from the radial stress."""
    with mpmath.workdps(40):
        y, x, E, nu = (mpmath.mpf(value) for value in (y, x, E, nu))
        r = mpmath.hypot(x, y)
        cosine, sine = x / r, y / r
        radial = 2 / (mpmath.pi * r) * (sine if tangential else cosine)
        normal, lateral = radial * cosine**2, radial * sine**2
        return ((1 - nu**2) * normal - nu * (1 + nu) * lateral) / E


@pytest.mark.parametrize("tangential", [False, True])
@pytest.mark.parametrize("nu", [-0.9, -0.2, 0.0, 0.3, 0.499, 0.5])
def test_the_kernel_is_the_plane_strain_of_flamants_half_plane(nu: float, tangential: bool) -> None:
    y = np.array([-7.0, -1.3, -0.2, 0.0, 0.4, 2.0, 31.0])
    found = kernel(y, depth=0.7, modulus=2.5, poisson=nu, tangential=tangential)
    wanted = [float(flamant_strain(v, 0.7, 2.5, nu, tangential=tangential)) for v in y.tolist()]
    assert found == pytest.approx(wanted, rel=1e-14, abs=1e-300)


def test_an_incompressible_layer_has_the_kernel_of_equation_19() -> None:
    y, x, E = np.linspace(-5, 5, 41), 1.25, 3.0
    closed = 3 / (2 * np.pi * E) * x * (x**2 - y**2) / (x**2 + y**2) ** 2
    found = kernel(y, depth=x, modulus=E, poisson=0.5)
    assert found == pytest.approx(closed, rel=1e-14, abs=1e-16)


@pytest.mark.parametrize("depth", [1.0, 0.1, 3.7, 1e-6])
def test_a_zero_of_the_kernel_is_exactly_zero(depth: float) -> None:
    for sign in (-1, 1):
        assert kernel(np.array([sign * depth]), depth=depth, modulus=1, poisson=0.5)[0] == 0.0
    near = kernel(np.array([depth * (1 + 1e-12)]), depth=depth, modulus=1.0, poisson=0.5)
    assert near[0] != 0.0


@pytest.mark.parametrize("channels", [3, 7, 15])
def test_the_tangential_kernel_is_skew_and_singular_for_odd_n(channels: int) -> None:
    T = make_problem(make_scene({"channels": channels, "kernel": "tangential"})).matrix
    assert np.array_equal(T, -T.T)
    sigma = np.linalg.svd(T, compute_uv=False)
    assert sigma[-1] < 1e-15 * sigma[0]
    even = make_problem(make_scene({"channels": channels + 1, "kernel": "tangential"})).matrix
    assert np.linalg.svd(even, compute_uv=False)[-1] > 1e-12


def test_the_normal_kernel_integrates_to_zero_and_a_compressible_one_does_not() -> None:
    def integral(nu: float) -> float:
        with mpmath.workdps(20):
            f = lambda y: flamant_strain(y, 1.0, 1.0, nu, tangential=False)  # noqa: E731
            return float(2 * mpmath.quad(f, [0, 1, 10, mpmath.inf]))

    assert integral(0.5) == pytest.approx(0.0, abs=1e-12)
    assert integral(0.3) == pytest.approx((1 + 0.3) * (1 - 2 * 0.3), rel=1e-12)
    y = np.linspace(-4000, 4000, 800_001)
    found = kernel(y, depth=1.0, modulus=1.0, poisson=0.3).sum() * (y[1] - y[0])
    assert found == pytest.approx(1.3 * 0.4, abs=2e-3 * 0.39)


@pytest.mark.parametrize(("normalised", "integral"), [(False, 1.5), (True, 3.0)])
def test_the_load_integrates_to_half_the_force_or_to_all_of_it(
    normalised: bool, integral: float
) -> None:
    load = CylinderLoad(force=3.0, half_width=0.8, centre=0.3, normalised=normalised)
    nodes, weights = np.polynomial.legendre.leggauss(300)
    total = 0.8 * weights @ cylinder_stress(0.3 + 0.8 * nodes, load)
    assert total == pytest.approx(integral, rel=1e-6)
    assert cylinder_stress(np.array([-0.51, 1.11]), load).tolist() == [0.0, 0.0]
    peak = (2 if normalised else 1) * 3.0 / (np.pi * 0.8)
    assert cylinder_stress(np.array([0.3]), load)[0] == pytest.approx(peak, rel=1e-15)


def test_more_sensors_than_channels() -> None:
    problem = make_problem(make_scene({"channels": 4, "sensors": 9, "span": 3.0}))
    assert problem.matrix.shape == (9, 4)
    assert problem.strain.shape == (9,)
    assert problem.positions is not None
    assert problem.positions.tolist() == [-1.5, -0.5, 0.5, 1.5]
    at = np.linspace(-1.5, 1.5, 9)
    wanted = kernel(at[3] - grid(4, 3.0), depth=1.0, modulus=1.0, poisson=0.5)
    assert problem.matrix[3] == pytest.approx(wanted, rel=1e-15)
    assert problem.stress is not None
    assert problem.strain == pytest.approx(problem.matrix @ problem.stress, rel=1e-15)


def test_noise_has_its_variance_and_its_seed() -> None:
    def noise(seed: int, variance: float) -> NDArray[np.float64]:
        table = {"channels": 2, "sensors": 5_000, "noise": {"variance": variance, "seed": seed}}
        quiet = make_problem(make_scene({**table, "noise": {}}))
        return make_problem(make_scene(table)).strain - quiet.strain

    found = noise(1, 0.1)
    assert np.array_equal(found, noise(1, 0.1))
    assert not np.array_equal(found, noise(2, 0.1))
    assert np.mean(found) == pytest.approx(0.0, abs=4 * np.sqrt(0.1 / 5_000))
    assert np.var(found) == pytest.approx(0.1, rel=4 * np.sqrt(2 / 5_000))


def test_a_load_from_a_table_is_interpolated_and_zero_outside(tmp_path: Path) -> None:
    (tmp_path / "load.csv").write_text("# y, stress\n-1,0\n0,2\n\n2,0\n")
    scene = tmp_path / "s.toml"
    text = '[problem]\nkind = "tactile"\nchannels = 7\nload = {kind = "csv", file = "load.csv"}\n'
    scene.write_text(text)
    stress = make_problem(load_scene(scene)).stress
    assert stress is not None
    assert stress.tolist() == [0.0, 0.0, 0.0, 2.0, 1.0, 0.0, 0.0]
    (tmp_path / "load.csv").write_text("0,1\n0,2\n")
    with pytest.raises(InputError, match="row 2: y must increase"):
        make_problem(load_scene(scene))


def test_a_problem_from_files_keeps_every_digit(tmp_path: Path) -> None:
    T = np.random.default_rng(3).standard_normal((3, 2)) * 10.0 ** np.array([[-9], [0], [7]])
    problem = make_problem(load_scene(write_matrix_scene(tmp_path, T, [1 / 3, -2.0, 0.0])))
    assert np.array_equal(problem.matrix, T)
    assert problem.strain.tolist() == [1 / 3, -2.0, 0.0]
    assert problem.stress is None
    assert problem.positions is None
