"""What a verdict shows: numbers of the document, charts of the record, parts of the board."""

from __future__ import annotations

import io
import math
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from taction.netlist_gen.board.variation import with_factors
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.scene import Scene, load_scene
from taction.spice_models.input_errors import MOST
from taction.system.charts import Chart, Curve, Limit, Text
from taction.system.quantities import quantity, readable, show
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.evidence.paper.ideal_flow import linear_outputs, settling_time
from taction.verification.report.blocks import Bars, Code, Drawing, Facts, Notes, Page, Table
from taction.verification.report.documents.verdict import verdict_document
from taction.verification.report.renderers.terminal import Terminal, page_text, plain, print_page
from taction.verification.report.views.answer_view import check_bar, screen
from taction.verification.report.views.verdict_view import load_bars, view
from taction.verification.verdict.board_files import board_power
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.headroom import Load
from taction.verification.verdict.input_spread import outputs_at_rest
from taction.verification.verdict.verify import Verdict, verify
from tests.support import nightly
from tests.support.paths import SCENES
from tests.support.report_pages import VERDICTS, page, verdicts

PREFIXES = {"a": 1e-18, "f": 1e-15, "p": 1e-12, "n": 1e-9, "µ": 1e-6, "m": 1e-3, "": 1.0}
PREFIXES |= {"k": 1e3, "M": 1e6, "G": 1e9}
NUMBER = re.compile(r"^(-?[\d.]+)(?: ([afpnµmkMG]?)(s|V|/s|F|Ω|A|Hz)?)?(?: (%))?(?: |$)")
COLUMNS = 80
SHIPPED = {file.stem: file for file in sorted(SCENES.glob("*.toml"))}
TINY = re.compile(r"± [\d.]+ [zaf](V|s|A)\b")  # uncertainties that are rounding


def made(value: float | None, limit: float | None, **more: Any) -> Check:
    """Return a check of an overshoot; `more` replaces its fields."""
    check = Check("overshoot", Outcome.PASS, value, 0.01, limit, None, "step", "")
    return replace(check, **more)


def number(text: str) -> float:
    """Return the value of a text in SI units, a share of the step as a fraction."""
    found = NUMBER.match(text)
    assert found, text
    value = float(found[1]) * PREFIXES[found[2] or ""]
    return value / 100.0 if found[4] else value


def block(name: str, kind: type[Any], title: str = "") -> Any:
    """Return the first block of a kind and title on the page of a verdict."""
    found = (each for each in page(name).blocks() if isinstance(each, kind))
    return next(each for each in found if each.title.partition(":")[0] == title)


@pytest.mark.parametrize("name", VERDICTS)
def test_checks_and_channels_have_the_numbers_of_the_document(name: str) -> None:
    document = verdict_document(verdicts()[name])
    bars = block(name, Bars)
    assert len(bars.rows) == len(document["checks"])
    for bar, check in zip(bars.rows, document["checks"], strict=True):
        assert bar.outcome == check["outcome"]
        if check["value"] is None:
            said = readable(check["reason"].partition("; ")[0])
            assert bar.value == (said if bar.outcome == "pass" else "–")
        elif bar.value.startswith("under 1 ppm"):
            assert abs(check["value"]) < 1e-6
        else:
            assert number(bar.value) == pytest.approx(check["value"], rel=6e-3)
    records, table = document["channels"], block(name, Table, "Channels")
    assert len(table.rows) == len(records)
    for row, record in zip(table.rows, records, strict=True):
        cells = dict(zip(table.columns, row, strict=True))
        for column, key in (("target", "reference"), ("end", "final")):
            assert cells[column].number == pytest.approx(record[key])
            assert number(cells[column].text) == pytest.approx(record[key], rel=6e-3, abs=1e-9)


@pytest.mark.parametrize(("limited", "outcome"), [(True, ""), (False, "fail")])
def test_a_load_above_a_simulated_limit_is_no_failure(limited: bool, outcome: str) -> None:
    load = Load("c_8", "slope", 1e7, 5e5, 0.0, 0.0, math.inf)
    (bar,) = load_bars([load], limited=limited).rows
    assert (bar.outcome, bar.fill, bar.share) == (outcome, "fail", 20.0)


@pytest.mark.parametrize(
    ("check", "share", "width", "used"),
    [
        (made(0.1, 0.4), 0.25, 50.0, "25 % of the limit"),
        (made(0.8, 0.4), 2.0, 300.0, "200 % of the limit"),
        (made(6.0, 0.4), 15.0, 300.0, "15 times the limit"),
        (made(1e-9, 0.4), 2.5e-9, 0.0, "below 0.01 % of the limit"),
        (made(3.0, 1.5, name="stability", unit="ratio"), 0.5, 100.0, "50 % of the limit"),
        (made(None, 0.4), None, 0.0, "below 0.01 % of the limit"),
        (made(-1e4, 0.0, name="stability", unit="1/s"), None, 0.0, "below 0.01 % of the limit"),
    ],
)
def test_a_bar_is_the_used_part(check: Check, share: Any, width: float, used: str) -> None:
    bar = check_bar(check)
    assert bar.share == (None if share is None else pytest.approx(share))
    assert bar.width == pytest.approx(width, abs=1e-3)
    assert bar.used == used


def test_a_bar_shows_a_smallest_value_the_end_of_a_search_and_its_uncertainty() -> None:
    bar = check_bar(made(8e-6, 12e-6, name="rise_time", unit="s", outcome=Outcome.FAIL), 10e-6)
    assert bar.share == pytest.approx(1.25)
    assert bar.limit == "at least 10 µs"
    ended = made(100.0, 1.5, uncertainty=None, name="stability", unit="ratio")
    assert check_bar(ended).value == "100 or more"
    assert check_bar(replace(ended, value=2.5, uncertainty=1e-9)).value == "2.5"
    assert check_bar(replace(ended, outcome=Outcome.INCONCLUSIVE)).value == "100 ± unknown"
    assert check_bar(made(0.2, 0.4)).whisker == pytest.approx((95.0, 105.0))
    assert check_bar(made(0.2, 0.4, uncertainty=1e-6)).whisker is None


def test_the_parts_list_counts_every_part() -> None:
    circuit = verdicts()["passing"].circuit
    rows = block("passing", Table, "Parts").rows
    resistors = sum(int(np.isfinite(m.ohms).sum()) for m in circuit.matrices)
    found = sum(row[2].number for row in rows if row[0].text == "resistor")
    assert found == resistors + len(circuit.resistors)
    power = quantity(board_power(LinearBoard(circuit)).total, "W", 3)
    notes = (each.lines for each in page("passing").blocks() if isinstance(each, Notes))
    assert any(f"dissipation {power} at rest" in line for lines in notes for line in lines)


@pytest.mark.parametrize("name", VERDICTS)
def test_one_channel_is_drawn_with_the_parts_of_the_deck_that_runs(name: str) -> None:
    deck, drawing = block(name, Code, "the deck").text, block(name, Drawing, "One channel")
    assert deck.rstrip().endswith(".end")
    assert ".tran" in deck
    texts = re.findall(r">([^<>]+)</text>", drawing.svg)
    cards = {text for text in texts if text[0] in "RC" and "_" in text}
    assert cards <= set(deck.split())
    assert {each[:2] for each in cards} >= {"Rf", "Rb", "Cc"}


def test_the_ideal_network_and_the_energy_are_beside_the_effort() -> None:
    facts = dict(row for each in page("passing").blocks() if isinstance(each, Facts)
                 for row in each.rows)  # fmt: skip
    network = verdicts()["passing"].ideal.network
    time, u = linear_outputs(network)
    when = quantity(settling_time(time, u, verdicts()["passing"].measurements.band), "s", 3)
    assert facts["the ideal network settles to ±1 % in"] == when
    assert facts["energy"].endswith("; that of the ideal network never rises")


def test_what_moves_the_rest_most_moves_it_so_far() -> None:
    circuit = verdicts()["passing"].circuit
    table = block("passing", Table, "What moves the rest most")
    part, volts, share = table.rows[0]
    scales = ({part.text: math.exp(z)} for z in (1e-4, -1e-4))
    up, down = (outputs_at_rest(LinearBoard(with_factors(circuit, each))) for each in scales)
    moved = (up - down)[int(table.columns[1][7]) - 1] / 2e-4 * math.log1p(0.01) / MOST
    assert volts.number == pytest.approx(moved, rel=1e-4)
    assert 1.0 >= share.number == max(row[2].number for row in table.rows)


def test_the_outputs_show_the_record_and_the_targets() -> None:
    verdict = verdicts()["passing"]
    marks = block("passing", Chart, "Outputs").marks
    curves = [mark for mark in marks if isinstance(mark, Curve)]
    assert [curve.name for curve in curves] == ["u1", "u2", "u3"]
    for n, curve in enumerate(curves):
        x, y = np.asarray(curve.x), np.asarray(curve.y)
        exact = np.interp(x, verdict.waveforms.time, verdict.u[:, n])
        assert np.abs(y - exact).max() < 1e-9 * verdict.measurements.amplitude
        assert (y.min(), y.max()) == (verdict.u[:, n].min(), verdict.u[:, n].max())
    limits = {mark.value for mark in marks if isinstance(mark, Limit) and mark.across == "y"}
    assert limits == {channel.target for channel in verdict.measurements.channels}
    lines = {curve.name: curve.line for curve in curves}
    assert lines["u1"] != lines["u3"]  # symmetric channels
    assert "u1, u3" in [mark.text for mark in marks if isinstance(mark, Text)]


@pytest.mark.parametrize("name", VERDICTS)
def test_a_terminal_shows_checks_channels_and_the_outcome(name: str) -> None:
    verdict = verdicts()[name]
    text = page_text(view(verdict))
    for check in verdict.checks:
        said = f"{check.name.replace('_', ' ')}: {check.reason.split(';')[0]}"
        said = said.replace("settling time: ", "settling to ±1 %: ")
        assert plain(said.replace(": to ±1 %", ": within ±1 %")) in text
    for each in verdict.measurements.channels:
        assert show(each.target, "V") in text
    assert text.splitlines()[-1] == verdict.outcome.value.upper()
    assert len(page_text(view(verdict, verbose=True))) > len(text)


def lines_of(page: Page, width: int = COLUMNS) -> list[str]:
    """Return the lines of a page on a terminal of so many columns."""
    console = Terminal(file=io.StringIO())
    console.width, console.soft_wrap = width, False
    print_page(page, console)
    assert isinstance(console.file, io.StringIO)
    return [line.rstrip() for line in console.file.getvalue().splitlines()]


def drawn(scene: Scene) -> Verdict:
    """Return a verdict that says nothing of built boards."""
    verdict = verify(scene)
    vars(verdict)["answer"] = verdict.drawn_answer
    return verdict


def faults(verdict: Verdict) -> list[str]:
    """Return what a screen has that none may have."""
    lines = lines_of(screen(verdict))
    word = verdict.outcome.value.upper()
    wrong = {
        "its head": not lines[0].startswith(f"{word}: {verdict.scene.name}"[:COLUMNS]),
        "its end": lines[-1] != word or "more: -v" not in lines[-2],
        "too wide": max(map(len, lines)) > COLUMNS,
    }
    return [name for name, found in wrong.items() if found] + list(filter(TINY.search, lines))


NIGHTLY = {  # boards of amplifiers by steps, and more of one kind
    *("box", "lasso", "non-negative", "paper-exponential", "paper-exponential-devices"),
    *("ridge", "least-squares", "known-readings"),
}


@pytest.mark.parametrize("name", [*sorted({*SHIPPED} - NIGHTLY), *nightly(*sorted(NIGHTLY))])
def test_a_shipped_scene_has_a_screen(name: str) -> None:
    assert faults(drawn(load_scene(SHIPPED[name]).with_engine("statespace"))) == []


def test_an_unstable_board_has_its_cause_once() -> None:
    scene = load_scene(SHIPPED["paper-breadboard"]).with_engine("statespace")
    verdict = verify(with_values(scene, {"design.capacitance": 5e-12}))
    cause = r"oscillates at 37\.9 kHz, growth rate \+\S+ k/s \(limit: below 0 /s\)"
    text = " ".join(lines_of(screen(verdict)))
    assert len(re.findall(cause, text)) == text.count("37.9 kHz") == 1
    follows = "; from this follow steady state, settling time, rise time, overshoot"
    assert re.match(f"FAIL: paper-breadboard: {cause}{follows}", text)
    page = verdict.page()
    assert page.title == "paper-breadboard"
    assert re.match(f"{cause}{follows}", page.summary)
