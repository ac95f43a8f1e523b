"""How results show themselves in a notebook: a short repr, a card, a picture with their data."""

from __future__ import annotations

import importlib.util
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lxml import etree, html

import taction
from taction.netlist_gen.card import LONGEST
from taction.system.charts import OUTCOMES
from taction.system.quantities import quantity
from taction.verification.report.blocks import NOTEBOOK, Cell, Notes, Page, Section, Table
from taction.verification.report.renderers.notebook import MOST_NOTES, MOST_ROWS
from taction.verification.report.renderers.notebook import card as card_of
from taction.verification.studies.tolerance.corners import worst_of
from taction.verification.studies.tolerance.varied_board import prepare
from taction.verification.verdict.checks import Outcome
from tests.support.making import make_scene
from tests.support.report_pages import HOSTILE, STATESPACE, swept, verdicts
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
        "div", "span", "b", "table", "tbody", "tr", "th", "td"
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


def test_an_inconclusive_verdict_says_why() -> None:
    given = verdict("passing")
    check = replace(given.checks[0], outcome=Outcome.INCONCLUSIVE, value=None, reason=HOSTILE)
    shown = replace(given, checks=(check, *given.checks[1:]))
    assert f"inconclusive ({check.name})" in repr(shown)
    card = text_of(shown._repr_html_())
    assert "? inconclusive" in card
    assert " ".join(HOSTILE.split()) in card


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


def test_long_texts_and_tables_are_cut_and_say_so() -> None:
    table = Table("", ("a",), ((Cell("x"),),) * 100)
    blocks = (table, Notes("", ("y" * 1000,) * 9))
    page = Page("b", "a", "", "", (), (Section("", blocks, "", NOTEBOOK),))
    text = text_of(card_of(page))
    assert f"and {100 - MOST_ROWS} more rows" in text
    assert f"and {9 - MOST_NOTES} more" in text
    assert text.count("y") == MOST_NOTES * (LONGEST - 1)


def test_repr_and_card_read_no_file_and_no_database(tmp_path: Path) -> None:
    result = swept("C=50pF:200pF:3")
    with result.store:
        pass  # closed: nothing can be read any more
    assert "3 points" in repr(result)
    assert "3 points" in text_of(result._repr_html_())
    path = tmp_path / "a.toml"
    path.write_text('[problem]\nkind = "matrix"\nmatrix = "no.csv"\nstrain = "no.csv"\n')
    scene = taction.load_scene(path)
    assert "matrix 'no.csv'" in repr(scene)
    assert "no.csv" in text_of(scene._repr_html_())
    with pytest.raises(taction.InputError, match=r"no\.csv"):
        scene.plot()


@pytest.mark.parametrize("name", PICTURES)
def test_plot_returns_the_figure_and_writes_it(
    name: str, results: dict[str, Any], tmp_path: Path
) -> None:
    figure = results[name].plot(tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes()[:4] == figure._repr_png_()[:4] == b"\x89PNG"
    with pytest.raises(taction.InputError, match="expected a file that ends in"):
        results[name].plot(tmp_path / "a.txt")


@pytest.mark.parametrize("name", PICTURES)
def test_without_matplotlib_plot_says_what_to_install(
    name: str, results: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda package: None)
    with pytest.raises(taction.InputError, match=r"pip install 'taction\[(plot|report)\]'"):
        results[name].plot()


def test_the_picture_of_waveforms_has_every_voltage(results: dict[str, Any]) -> None:
    wave = results["Waveforms"]
    lines = wave.plot().axes[0].lines
    assert [line.get_label() for line in lines] == list(wave.nodes)
    for line, node in zip(lines, wave.nodes, strict=True):
        assert np.array_equal(line.get_ydata(), wave[node])
    assert len(wave.plot(nodes=[wave.nodes[1]]).axes[0].lines) == 1
    with pytest.raises(KeyError):
        wave.plot(nodes=["nothing"])


@pytest.mark.parametrize("kind", ["failing", "passive"])
def test_the_picture_of_a_circuit_has_the_values_of_a_channel(kind: str) -> None:
    circuit = verdict(kind).circuit
    shown = " ".join(text.get_text() for text in circuit.plot().axes[0].texts)
    middle = (len(circuit.outputs) + 1) // 2
    (farads,) = (c.farads for c in circuit.capacitors if c.name == f"c_{middle}")
    (ohms,) = (r.ohms for r in circuit.resistors if r.name == f"r_{middle}")
    for value in (quantity(farads, "F"), quantity(ohms, "ohm"), f"Rr_{middle}"):
        assert value in shown


def test_the_picture_of_a_yield_has_every_sample(results: dict[str, Any]) -> None:
    report = results["YieldReport"]
    panels = {axes.get_title().partition(":")[0]: axes for axes in report.plot().axes}
    assert len(report.boards) == report.samples == 40
    bars = [bar for group in panels["Steady state"].containers for bar in group]
    assert sum(bar.get_height() for bar in bars) == 40
    known = [board.value("steady_state") for board in report.boards]
    edges = [bar.get_x() for bar in bars]
    assert min(edges) <= 100 * min(known) * (1 + 1e-9)
    title = " ".join(report.plot().get_suptitle().split())  # also at spaces that do not break
    assert f"{report.passed} of 40 boards pass" in title


def test_the_picture_of_an_onset_has_the_poles(results: dict[str, Any]) -> None:
    onset = results["Onset"]
    (axes,) = (each for each in onset.plot().axes if each.get_title().startswith("Pole map"))
    dots = [each for each in axes.lines if each.get_marker() == "o"]
    dots = [each for each in dots if each.get_markerfacecolor() != "none"]
    places = np.concatenate([each.get_xydata() for each in dots])
    poles = [pole for sample in onset.scan.samples for pole in sample.poles.tolist()]
    ringing = [pole for pole in poles if pole.imag > 0.0 and -pole.real < 0.5 * abs(pole)]
    assert len(places) == len(ringing) > 10
    ratios = sorted(y / x for x, y in places)
    expected = sorted(pole.imag / math.tau / pole.real for pole in ringing)
    assert ratios == pytest.approx(expected, rel=1e-9)
