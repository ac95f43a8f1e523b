"""How results show themselves in a notebook; arrays for files, many right-hand sides."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lxml import etree, html
from numpy.typing import ArrayLike

import taction
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.system.charts import OUTCOMES
from taction.verification.studies.running.versions import digest
from taction.verification.studies.tolerance.corners import worst_of
from taction.verification.studies.tolerance.montecarlo import prepare
from tests.support.making import make_scene, write_matrix_scene
from tests.support.report_pages import STATESPACE, swept, verdicts
from tests.support.studying import one_thread, scene_file, small_scene

MOST_BYTES = 30_000
KINDS = ("failing", "oscillating", "64 channels")
PICTURES = ("Scene", "Circuit", "Verdict", "SweepResult", "YieldReport", "Onset")
T = [[1.0, 0.5, 0.1], [0.5, 1.0, 0.5], [0.1, 0.5, 1.0]]
EPS = [0.3, 0.2, 0.1]
STRAINS = [[0.3, 0.2, 0.1], [0.1, 0.0, -0.2], [0.0, 0.3, 0.0]]
DESIGN = '[design]\ncapacitance = "1nF"\ngain = "1Mohm"\nlambda = 0.5\n'


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """One result of every type, by the name of the type."""
    passing = verdicts()["passing"]
    scene = make_scene({"channels": 3, "span": 2.0}, analysis=STATESPACE)
    two = scene_file(tmp_path_factory.mktemp("yield"))
    made = (
        passing,
        passing.scene,
        passing.circuit,
        passing.waveforms,
        swept("C=50pF:200pF:3", "gain=50k:200k:2"),
        taction.onset(scene, over="C=1pF:100pF:13", transients=False),
        taction.montecarlo(two, samples=40, jobs=1),
    )
    return {type(each).__name__: each for each in made}


def text_of(card: str) -> str:
    """The text of a card, which must be well-formed and have no element that runs or loads."""
    assert len(card.encode()) < MOST_BYTES
    etree.fromstring(card)  # strict: every element is closed, every attribute is quoted
    tree = html.fromstring(card)
    assert {each.tag for each in tree.iter()} <= {"div", "span", "b", "pre"}
    return " ".join(tree.text_content().split())


def is_short(text: str) -> bool:
    lines = text.splitlines()
    return 1 <= len(lines) <= 3 and len(text) < 300


@pytest.mark.parametrize("kind", KINDS)
def test_repr_and_card_of_a_verdict_name_the_outcome_and_the_values(kind: str) -> None:
    shown = verdicts()[kind]
    C = {"oscillating": "10 pF", "failing": "100 pF"}.get(kind, "1 nF")
    for text in (repr(shown), text_of(shown._repr_html_())):
        assert shown.outcome.value in text
        assert f"C = {C}" in text
    assert is_short(repr(shown))
    card = text_of(shown._repr_html_())
    sign = OUTCOMES[shown.outcome.value].sign
    assert f"{sign} {shown.outcome.value}" in card
    titles = (check.name.replace("_", " ") for check in shown.checks)
    assert all(title in card or title == "settling time" for title in titles)
    assert "settling time" in card or "settling to ±" in card
    assert "simulated by statespace" in card
    assert "of the step" in card


def test_every_result_has_a_short_repr(results: dict[str, Any]) -> None:
    scene = small_scene(tolerances={"resistor": 0.05, "distribution": "uniform"})
    with one_thread() as workers:
        corners = worst_of(prepare(scene, full_margin=True), workers)
    made = (*results.values(), corners, taction.solve(scene), taction.simulate(scene))
    assert all(is_short(repr(each)) for each in made)
    assert repr(corners).startswith(f"CornerStudy('{scene.name}', {len(corners.corners)} corners: ")
    assert "Stable for C: " in repr(results["Onset"])
    assert "Yield" in repr(results["YieldReport"])
    assert "ms, statespace" in repr(results["Waveforms"]) or "µs" in repr(results["Waveforms"])


def test_a_file_name_with_markup_is_shown_as_it_is(tmp_path: Path) -> None:
    folder = tmp_path / '<b>&"x"'
    folder.mkdir()
    scene = taction.load_scene(scene_file(folder))
    assert "<b>&" in text_of(scene._repr_html_())
    assert "<b>&" in repr(scene)


@pytest.mark.parametrize("name", PICTURES)
def test_plot_returns_the_figure_and_writes_it(
    name: str, results: dict[str, Any], tmp_path: Path
) -> None:
    figure = results[name].plot(tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes()[:4] == figure._repr_png_()[:4] == b"\x89PNG"
    with pytest.raises(taction.InputError, match="expected a file that ends in"):
        results[name].plot(tmp_path / "a.txt")


def scene(strain: ArrayLike = EPS, **values: object) -> taction.Scene:
    return taction.Scene.from_arrays(
        T, strain, **({"capacitance": "1nF", "gain": "1Mohm", "lam": 0.5} | values)
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
        alone = taction.solve(scene(strain, amplifier=amplifier))
        assert solution.u.tolist() == alone.u.tolist()
        assert solution.trusted
        assert solution.error_bound == alone.error_bound


def test_verify_takes_many_strains_in_order() -> None:
    made = scene(engine="statespace")
    verdicts = taction.verify(made, strains=STRAINS)
    for strain, verdict in zip(STRAINS, verdicts, strict=True):
        alone = taction.verify(scene(strain, engine="statespace"))
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
