"""The catalogue of stress cases: what it holds, and that its true values belong to it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.loading import load_scene
from taction.system import errors
from taction.system.errors import InputError
from taction.verification.evidence.stress.catalogue import TRUE_VALUES, Case, load_catalogue, select
from taction.verification.verdict.checks import Outcome
from tests.support.paths import CASES
from tests.support.true_values import deck_digest

ALL = load_catalogue()
STORED = json.loads(TRUE_VALUES.read_text("utf-8"))
REFUSED = [case for case in ALL if case.refused]
BOARDS = [case for case in ALL if not case.refused]
FILE = """
[base.problem]
kind = "matrix"
matrix = [[1.0]]
strain = [1.0]
[case.a]
why = "w"
known = "k"
outcome = "pass"
"""


def name_of(case: Case) -> str:
    return case.name


# In the catalogue this board has op-amps that do not slew, as the report assumed.
SLEWING = {"rise-after-band"}


@pytest.mark.parametrize("path", sorted(CASES.glob("*.toml")), ids=lambda path: path.stem)
def test_their_numbers_are_those_of_the_reports(path: Path) -> None:
    case, scene = select(ALL, (path.stem,))[0].scene(), load_scene(path)
    assert case.checks == scene.checks
    same = {"opamp": scene.design.opamp} if path.stem in SLEWING else {}
    assert case.design.model_copy(update=same) == scene.design
    ours, theirs = make_problem(case), make_problem(scene)
    assert (ours.matrix == theirs.matrix).all()
    assert (ours.strain == theirs.strain).all()


LARGEST = "channels-500"  # its deck alone takes 7 s of processor time; `make stress` verifies it


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(c, marks=[pytest.mark.nightly] * (k % 4 != 0 or c.name == LARGEST))
        for k, c in enumerate(BOARDS)
    ],
    ids=name_of,
)
def test_a_scene_is_read_and_its_true_values_are_those_of_its_tables_and_deck(case: Case) -> None:
    assert {case.scene(engine).analysis.engine for engine in case.engines} == set(case.engines)
    assert case.truth is not None, "scripts/stress_truth.py computes it"
    record = STORED[case.name]
    assert record["tables"] == case.digest
    assert record["deck"] == deck_digest(case), "scripts/stress_truth.py computes the truth anew"


def test_no_true_values_of_cases_that_are_gone() -> None:
    assert set(STORED) <= {case.name for case in ALL}


def test_every_case_has_its_own_name_and_an_outcome_that_exists() -> None:
    refusals = {name for name, kind in vars(errors).items() if isinstance(kind, type)}
    words = {word for case in ALL for each in case.outcome.values() for word in each}
    assert words <= {outcome.value for outcome in Outcome} | refusals
    assert len({case.name for case in ALL}) == len(ALL)


def test_tables_of_a_case_are_laid_over_the_base(tmp_path: Path) -> None:
    (tmp_path / "one.toml").write_text(FILE + "problem.strain = [2.0]\n")
    (case,) = load_catalogue(tmp_path)
    assert case.tables["problem"] == {"kind": "matrix", "matrix": [[1.0]], "strain": [2.0]}
    assert case.outcome == {"ngspice": ("pass",), "statespace": ("pass",)}


def test_cases_are_selected_by_name_and_by_family() -> None:
    assert [case.name for case in select(ALL, ("identity",))] == ["identity"]
    assert {case.family for case in select(ALL, ("gain", "strain"))} == {"gain", "strain"}
    with pytest.raises(InputError, match="did you mean 'identity'"):
        select(ALL, ("identiti",))
