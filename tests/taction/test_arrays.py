"""Arrays in memory in the place of files, and many right-hand sides for one board."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike

import taction
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.verification.studies.running.versions import digest
from tests.support.making import write_matrix_scene

T = [[1.0, 0.5, 0.1], [0.5, 1.0, 0.5], [0.1, 0.5, 1.0]]
EPS = [0.3, 0.2, 0.1]
STRAINS = [[0.3, 0.2, 0.1], [0.1, 0.0, -0.2], [0.0, 0.3, 0.0]]
DESIGN = '[design]\ncapacitance = "1nF"\ngain = "1Mohm"\nlambda = 0.5\n'


def scene(**values: object) -> taction.Scene:
    return taction.Scene.from_arrays(
        T, EPS, **({"capacitance": "1nF", "gain": "1Mohm", "lam": 0.5} | values)
    )


def test_arrays_give_the_deck_that_files_give(tmp_path: Path) -> None:
    file = write_matrix_scene(tmp_path, T, EPS, DESIGN)
    assert taction.netlist(scene()).text == taction.netlist(file).text


def test_keys_of_any_table_are_found_by_name() -> None:
    found = scene(
        opamp="lf353",
        variance=1e-4,
        engine="statespace",
        resistor=0.02,
        stress=[1, 2, 3],
        settling_time={"max": "1ms"},
        **{"checks.steady_state.tolerance": 0.01},
    )
    assert found.design.opamp.base == "lf353"
    assert found.problem.noise.variance == 1e-4
    assert found.analysis.engine == "statespace"
    assert found.tolerances.resistor == 0.02
    assert found.checks.settling_time.max == 1e-3
    assert found.checks.steady_state.tolerance == 0.01
    assert make_problem(found).stress is not None


@pytest.mark.parametrize(
    ("matrix", "strain", "values", "text"),
    [
        (T, EPS, {"capacitanc": "1pF"}, "capacitanc = '1pF': unknown key; did you mean 'capac"),
        (T, EPS, {"max": 1}, "max = 1: several keys have this name; one of 'checks.settling_t"),
        (T, EPS, {"capacitance": "1nH"}, "design.capacitance = '1nH': the unit is 'H'"),
        (T, EPS, {"stress": [1.0]}, "problem.stress = array([1.]): shape 1; expected 3"),
        (T, [1.0, 2.0], {}, "problem.strain = array([1., 2.]): shape 2; expected 3"),
        (T, [1.0, np.nan, 0.0], {}, "entry (2) is not finite"),
        ([[1.0], [1.0, 2.0]], EPS, {}, "problem.matrix = [[1.0], [1.0, 2.0]]: expected the name"),
        ([[1j]], EPS, {}, "or an array of real numbers"),
    ],
)
def test_what_is_wrong_is_named(
    matrix: ArrayLike, strain: ArrayLike, values: dict[str, object], text: str
) -> None:
    with pytest.raises(taction.InputError) as caught:
        taction.Scene.from_arrays(matrix, strain, **values)
    assert text in str(caught.value)
    assert str(caught.value).startswith("Scene.from_arrays: ")


def test_scenes_with_arrays_compare_travel_and_digest_by_content() -> None:
    other = taction.Scene.from_arrays(T, [0.3, 0.2, 0.2])
    same = taction.Scene.from_arrays(np.array(T), np.array(EPS))
    made = taction.Scene.from_arrays(T, EPS)
    assert made == same
    assert hash(made.problem) == hash(same.problem)
    assert made != other
    assert pickle.loads(pickle.dumps(made)) == made  # noqa: S301 - our own
    assert digest(made) == digest(same) != digest(other)


@pytest.mark.parametrize("amplifier", ["linear", "exponential"])
def test_many_strains_give_what_each_gives_alone(amplifier: str) -> None:
    made = scene(amplifier=amplifier)
    several = taction.solve(made, strains=np.abs(STRAINS))
    for strain, solution in zip(np.abs(STRAINS), several, strict=True):
        alone = taction.solve(
            taction.Scene.from_arrays(
                T, strain, amplifier=amplifier, capacitance="1nF", gain="1Mohm", lam=0.5
            )
        )
        assert solution.u.tolist() == alone.u.tolist()
        assert solution.trusted
        assert solution.error_bound == alone.error_bound


def test_verify_takes_many_strains_in_order() -> None:
    made = scene(engine="statespace")
    verdicts = taction.verify(made, strains=STRAINS)
    for strain, verdict in zip(STRAINS, verdicts, strict=True):
        alone = taction.verify(
            taction.Scene.from_arrays(
                T, strain, engine="statespace", capacitance="1nF", gain="1Mohm", lam=0.5
            )
        )
        assert verdict.outcome is alone.outcome
        assert verdict.u.tolist() == alone.u.tolist()


@pytest.mark.parametrize(
    ("strains", "text"),
    [
        ([[1.0, 2.0]], "strains: strains: shape 1 x 2; expected any x 3"),
        ([[1.0, np.nan, 0.0]], "entry (1, 2) is not finite"),
        ([["a", "b", "c"]], "could not convert string to float"),
    ],
)
def test_strains_that_do_not_fit_are_refused(strains: ArrayLike, text: str) -> None:
    with pytest.raises(taction.InputError) as caught:
        taction.verify(scene(), strains=strains)
    assert text in str(caught.value)
