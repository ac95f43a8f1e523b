"""Scenes for matrices from files: shapes, headers, lambda by its definition, boards that pass.

The limits of a fresh scene, against boards that are drawn and solved by numpy alone.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.board.part_warnings import broken_limits
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.scene import Scene, load_scene
from taction.system.array_types import Floats
from taction.system.errors import InputError
from taction.verification.design import fresh_scene as module
from taction.verification.design.fresh_scene import BAND, GRADES, NewScene, exceeded, with_limits
from taction.verification.verdict.verify import verify
from tests.support.running import taction

T = np.array([[1.0, 0.5, 0.2], [0.5, 1.0, 0.5], [0.2, 0.5, 1.0], [0.1, 0.2, 0.5]])
EPS = np.array([1.0, 0.8, 0.3, 0.2])
LAMBDA = 0.1
SIGMA = 0.01


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene.from_arrays(T, EPS, lam=LAMBDA, base="ideal", engine="statespace")


def errors(grade: float, count: int) -> Floats:
    """Return the largest error of boards with ideal op-amps, in steps, by Kirchhoff's laws.

    T has no negative entry: an inverter (two resistors) drives each column of the forward matrix.
    """
    rng, (M, N) = np.random.default_rng(5), T.shape
    exact = np.linalg.solve(T.T @ T + LAMBDA * np.eye(N), T.T @ EPS)

    def off(*shape: int) -> Floats:
        return np.asarray(1.0 / (1.0 + grade / 3.0 * rng.standard_normal(shape)))

    found = []
    for _ in range(count):
        forward = T * off(M, N) * (off(N) / off(N))[None, :]
        backward, gain, leak = T * off(M, N), 1.0 / off(M), LAMBDA * off(N)
        system = backward.T @ (gain[:, None] * forward) + np.diag(leak)
        u = np.linalg.solve(system, backward.T @ (gain * EPS))
        found.append(np.abs(u - exact).max() / np.abs(exact).max())
    return np.array(found)


def test_the_limits_are_those_that_most_boards_keep(scene: Scene) -> None:
    predicted = exceeded(with_values(scene, {"tolerances.resistor": 0.01}))
    drawn = float(np.quantile(errors(0.01, 4000), 0.98))
    assert predicted == pytest.approx(drawn, rel=0.1)
    limited, note = with_limits(scene)
    grade, limit = limited.tolerances.resistor, limited.checks.steady_state.tolerance
    assert grade in GRADES
    assert np.mean(errors(grade, 2000) <= limit) > 0.95
    assert limited.checks.settling_time.band == BAND * limit
    assert f"the limit is {100 * limit:g} %" in note


def test_the_values_are_of_a_series_can_be_bought_and_are_all_used(plain: Path) -> None:
    """The files that needed no change stay where they are, and nothing is pruned."""
    assert [path.name for path in plain.parent.iterdir()] == ["board.toml"]
    assert "prune" not in plain.read_text(encoding="utf-8")
    scene = load_scene(plain)
    assert scene.problem.matrix == "../T.csv"  # type: ignore[union-attr]
    circuit = synthesise(scene)
    ohms = circuit.forward.ohms[np.isfinite(circuit.forward.ohms)]
    decades = 10.0 ** np.floor(np.log10(ohms))
    E96 = {round(10.0 ** (k / 96.0), 2) for k in range(96)}
    assert set(np.round(ohms / decades, 9).tolist()) <= E96
    assert not broken_limits(circuit)


@pytest.fixture(scope="module")
def problem() -> tuple[Floats, Floats]:
    rng = np.random.default_rng(1993)
    T = rng.normal(size=(6, 3))
    return T, T @ np.array([1.0, 0.5, -0.3]) + SIGMA * rng.normal(size=6)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory, problem: tuple[Floats, Floats]) -> Path:
    """The scene that `new` writes for the matrix without an option, in a folder beside it."""
    folder = tmp_path_factory.mktemp("plain")
    (folder / "elsewhere").mkdir()
    file = folder / "elsewhere" / "board.toml"
    assert taction("new", *write(folder, *problem), str(file)).exit_code == 0
    return file


def fresh(folder: Path, **options: Any) -> NewScene:
    """The scene for the files that `write` wrote."""
    files = {"matrix": folder / "T.csv", "strain": folder / "eps.csv"}
    return module.new(folder / "s.toml", **files, force=True, **options)


def write(folder: Path, T: Floats, eps: Floats, head: str = "") -> list[str]:
    paths = [folder / "T.csv", folder / "eps.csv"]
    for path, values in zip(paths, (T, eps), strict=True):
        text = "".join(",".join(map(repr, row)) + "\n" for row in np.atleast_2d(values).tolist())
        path.write_text(head + text, encoding="utf-8")
    return ["--matrix", str(paths[0]), "--strain", str(paths[1])]


@pytest.mark.parametrize("opamp", ["tl084", "op27"])
def test_scenes_pass_at_once(tmp_path: Path, problem: tuple[Floats, Floats], opamp: str) -> None:
    file = tmp_path / "board.toml"
    found = taction("new", str(file), *write(tmp_path, *problem), "--opamp", opamp, "--json")
    assert found.exit_code == 0, found.stderr
    assert json.loads(found.stdout)["outcome"] == "pass"
    verdict = verify(load_scene(file).with_engine("statespace"))
    assert verdict.outcome.value == "pass"
    assert max(load.share for load in verdict.parts.loads) <= 0.9


def test_bias_currents_that_leave_no_answer_are_refused(
    tmp_path: Path, problem: tuple[Floats, Floats], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a uA741 up to 500 nA: with the least conductances that its outputs drive, 19 %."""
    monkeypatch.setattr(module, "WORST", 0.1)
    found = taction("new", str(tmp_path / "b.toml"), *write(tmp_path, *problem), "--opamp", "ua741")
    assert found.exit_code == 2
    assert "expected an op-amp with smaller errors" in found.stderr


def test_the_residual_is_that_of_the_noise(tmp_path: Path, problem: tuple[Floats, Floats]) -> None:
    T, eps = problem
    write(tmp_path, T, eps)
    lam = fresh(tmp_path, noise=SIGMA).scaled.verdict.circuit.value("lambda")
    u = np.linalg.solve(T.T @ T + lam * np.eye(3), T.T @ eps)
    residual = float(np.sum((T @ u - eps) ** 2))
    assert residual == pytest.approx(1.3 * len(eps) * SIGMA**2, rel=0.02)  # lambda has 3 digits
    default, largest = fresh(tmp_path), np.linalg.svd(T)[1][0]
    lam = default.scaled.verdict.circuit.value("lambda")
    assert lam == pytest.approx(0.01 * largest**2, rel=0.005)
    assert "default" in default.rule


@pytest.mark.parametrize(
    ("T", "eps", "noise", "says"),
    [
        (np.ones((4, 3)), np.ones(5), None, "shape 5; expected 4"),
        (np.zeros((2, 2)), np.ones(2), None, "T is all zeros"),
        (np.eye(2), np.ones(2), 100.0, r"SIGMA = 100: this noise hides .* between 0 and 0\.88"),
    ],
    ids=["shapes", "zeros", "noise above the strain"],
)
def test_a_problem_without_an_answer_is_refused(
    tmp_path: Path, T: Floats, eps: Floats, noise: float | None, says: str
) -> None:
    write(tmp_path, T, eps)
    with pytest.raises(InputError, match=says):
        fresh(tmp_path, noise=noise)


def test_a_noise_that_explains_nothing_is_refused_with_those_that_do(tmp_path: Path) -> None:
    """The residual of 12 rows is scaled to that of a noise of 0.03 with ten degrees of freedom."""
    rng = np.random.default_rng(3)
    T = rng.normal(size=(12, 2))
    drawn = rng.normal(0.0, 0.03, 12)
    drawn -= T @ np.linalg.lstsq(T, drawn, rcond=None)[0]
    eps = T @ np.array([1.0, -0.5]) + drawn * (0.03 * np.sqrt(10.0) / np.linalg.norm(drawn))
    write(tmp_path, T, eps)
    says = r"more of the strain unexplained; expected a number between 0\.024 and 1\.3"
    with pytest.raises(InputError, match=says):
        fresh(tmp_path, noise=1e-3)


def test_entries_without_a_resistor_are_left_out(tmp_path: Path) -> None:
    """Of a ratio above that of the largest and the smallest resistor that can be bought."""
    T = np.array([[1.0, 1e-3, 1e-7], [1e-3, 1.0, 1e-3], [1e-7, 1e-3, 1.0]])
    write(tmp_path, T, np.array([1.0, 0.5, 0.8]))
    made = fresh(tmp_path)
    assert "leaves out 2 of the entries of T" in made.notes[0]
    assert load_scene(made.file).design.prune == module.NECESSARY
