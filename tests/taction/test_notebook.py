"""How results show themselves in a notebook: a short repr, a card, a picture with their data."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from lxml import etree, html

import taction
from taction.system.charts import OUTCOMES
from taction.verification.studies.tolerance.corners import worst_of
from taction.verification.studies.tolerance.varied_board import prepare
from tests.support.making import make_scene
from tests.support.report_pages import STATESPACE, swept, verdicts
from tests.support.studying import one_thread, scene_file, small_scene

MOST_BYTES = 30_000
KINDS = ("failing", "oscillating", "64 channels")
PICTURES = ("Scene", "Circuit", "Waveforms", "Verdict", "SweepResult", "YieldReport", "Onset")


def verdict(kind: str) -> taction.Verdict:
    return verdicts()[kind]


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """One result of every type, by the name of the type."""
    passing = verdict("passing")
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
    assert {each.tag for each in tree.iter()} <= {
        "div", "span", "b", "pre"
    }  # fmt: skip
    return " ".join(tree.text_content().split())


def is_short(text: str) -> bool:
    lines = text.splitlines()
    return 1 <= len(lines) <= 3 and len(text) < 300


@pytest.mark.parametrize("kind", KINDS)
def test_repr_and_card_of_a_verdict_name_the_outcome_and_the_values(kind: str) -> None:
    shown = verdict(kind)
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
    assert repr(corners).startswith(f"CornerStudy({len(corners.corners)} corners, ")
    assert "stable: " in repr(results["Onset"])
    assert "yield" in repr(results["YieldReport"])
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
