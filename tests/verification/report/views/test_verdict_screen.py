"""What a terminal shows of a verdict: its outcome, bars, notes and the last word."""

from __future__ import annotations

import io
import re

import pytest

from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.loading import load_scene
from taction.netlist_gen.scene.scene import Scene
from taction.verification.report.blocks import Page
from taction.verification.report.renderers.terminal import Terminal, print_page
from taction.verification.report.views.verdict_view import screen
from taction.verification.verdict.verify import Verdict, verify
from tests.support.paths import SCENES

COLUMNS = 80
SHIPPED = {file.stem: file for file in sorted(SCENES.glob("*.toml"))}
TINY = re.compile(r"± [\d.]+ [zaf](V|s|A)\b")  # uncertainties that are rounding


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


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_scene_has_a_screen(name: str) -> None:
    assert faults(drawn(load_scene(SHIPPED[name]).with_engine("statespace"))) == []


def test_the_screen_of_a_pass_names_nearest_limit_distance_answer_and_warnings() -> None:
    verdict = verify(load_scene(SHIPPED["paper-breadboard"]).with_engine("statespace"))
    first, *bars = lines_of(screen(verdict))[:6]
    text = " ".join(lines_of(screen(verdict)))
    assert first == "PASS: paper-breadboard, 5 checks; nearest to its limit: overshoot (95.8 %)"
    assert bars[1] == "  settling to ±1 %  #####.......|     2.42 ms, at most 5 ms (48.4 %)"
    assert "Distance to oscillation: damping ratio 0.0048 at 37.3 kHz" in text
    assert "within 0.0025 % of the step, 95 % of built boards within 0.91 %" in text
    assert "is 77 % (of the largest, 955 mV) from the true stress in channel 4" in text
    assert (
        "passes as drawn; at most 11 % of built boards pass: the others rest beyond 0.1 %" in text
    )
    assert "of the step (resistors 1 %, op-amp gains 50 %; the check counts none of these)" in text
    assert "more: -v (2 warnings), --report FILE" in text


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
