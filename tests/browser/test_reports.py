"""Reports in a real browser: silent, without the network, usable, accessible, printable."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.browser.conftest import DESK, NAMES, PHONE, Open, Opened
from tests.support import nightly

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

ALIKE = ("passive", "one channel", "sweep, only op-amps", "sweep, op-amps", "choose, none passes")
"""Reports that have what others have."""
AXE = "axe.run({resultTypes: ['violations']})"
RANGE = "canvas => canvas._fullLayout.xaxis.range.map(Number)"
VIEWS = """[...document.querySelectorAll(".canvas")].map(each => each._fullLayout)
  .flatMap(({ xaxis, yaxis }) => [...xaxis.range, ...yaxis.range].map(Number))"""
FOCUSED = """(document.activeElement.ariaLabel || document.activeElement.textContent).trim()
  .slice(0, 20)"""
BACKGROUND = "getComputedStyle(document.body).backgroundColor"
INK = "document.querySelector('.canvas .xtick text').style.fill"

BEYOND = """width => [...document.querySelectorAll("main *, header *, nav *")]
  .filter(each => !each.closest("pre, svg, .hidden, .canvas"))
  .filter(each => each.getClientRects().length && each.getBoundingClientRect().right > width + 0.5)
  .map(each => each.outerHTML.slice(0, 90))"""
# Pairs of texts of one picture that share more than 2 pixels; a tick may touch its neighbour.
OVERLAPS = """() => [...document.querySelectorAll(".canvas")].flatMap(canvas => {
  const boxes = [...canvas.querySelectorAll("text")]
    .filter(text => text.textContent.trim() && text.getClientRects().length
      && getComputedStyle(text).opacity !== "0" && !text.closest(".modebar, .hoverlayer")
      && !/rotate\\([^0]/.test(text.getAttribute("transform")))  // a box of its own direction
    .map(text => [text.textContent, text.getBoundingClientRect()]);
  return boxes.flatMap(([one, a], k) => boxes.slice(k + 1)
    .filter(([, b]) => Math.min(a.right, b.right) - Math.max(a.left, b.left) > 2
      && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 5)
    .map(([two]) => [canvas.id, one, two]));
})"""


def violations(page: Any) -> list[tuple[str, str, str]]:
    """Return rule, impact and element of every finding of axe-core."""
    from axe_playwright_python.base import AXE_SCRIPT

    page.evaluate(AXE_SCRIPT)
    found = page.evaluate(AXE)["violations"]
    return [(each["id"], each["impact"], each["nodes"][0]["html"]) for each in found]


@pytest.mark.parametrize("name", [*(n for n in NAMES if n not in ALIKE), *nightly(*ALIKE)])
def test_a_report_is_silent_asks_for_nothing_is_legible_and_accessible(
    open_report: Open, name: str
) -> None:
    opened = open_report(name, color_scheme="light")
    opened.page.wait_for_timeout(100)
    assert opened.messages == []
    assert [url for url in opened.requests if not url.startswith(("file:", "data:", "blob:"))] == []
    assert opened.page.evaluate("document.documentElement.dataset.ready") == "true"
    drawn = opened.page.locator(".canvas .main-svg").count()
    assert drawn >= opened.page.locator(".canvas").count()
    assert opened.page.evaluate(OVERLAPS) == []
    assert (
        opened.page.locator("[aria-label^='Share chart']").count() == 0
    )  # which would upload the chart
    assert violations(opened.page) == []
    opened.page.emulate_media(color_scheme="dark")
    opened.page.wait_for_timeout(200)
    assert violations(opened.page) == []
    assert opened.messages == []


@pytest.mark.parametrize("name", ["passing", "64 channels", "montecarlo", "sweep, a map", "choose"])
def test_a_phone_shows_everything_and_scrolls_one_way(open_report: Open, name: str) -> None:
    page = open_report(name, viewport=PHONE, has_touch=True, is_mobile=True).page
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    assert page.evaluate(BEYOND, PHONE["width"]) == []
    assert page.evaluate(OVERLAPS) == []
    if name == "passing":
        assert violations(page) == []


@pytest.fixture(scope="module")
def opened_once(browser: Browser, files: Callable[[str], Path]) -> Iterator[Page]:
    """The passing report on a desk in light colours; its pictures are drawn."""
    context = browser.new_context(viewport=DESK, color_scheme="light")
    opened = Opened(context.new_page())
    opened.goto(files("passing"))
    yield opened.page
    context.close()


@pytest.fixture
def passing(opened_once: Page) -> Iterator[Page]:
    """The same, for tests that use it one after the other: each finds it as it was opened."""
    page = opened_once
    before = page.evaluate(VIEWS), page.evaluate(BACKGROUND)
    yield page
    page.emulate_media(color_scheme="light")
    page.wait_for_timeout(200)
    assert page.evaluate(VIEWS) == pytest.approx(before[0])
    assert page.evaluate(BACKGROUND) == before[1]


def test_a_drag_zooms_and_the_buttons_move(passing: Page) -> None:
    page = passing
    figure = page.locator(".picture", has_text="Outputs").first
    canvas = figure.locator(".canvas")
    canvas.scroll_into_view_if_needed()
    low, high = canvas.evaluate(RANGE)
    box = canvas.locator(".nsewdrag").first.bounding_box()
    assert box is not None
    middle = box["y"] + box["height"] / 2
    page.mouse.move(box["x"] + 0.25 * box["width"], middle)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.5 * box["width"], middle, steps=5)
    page.mouse.up()
    page.wait_for_timeout(300)
    left, right = canvas.evaluate(RANGE)
    width = high - low
    assert left == pytest.approx(low + 0.25 * width, abs=0.02 * width)
    assert right == pytest.approx(low + 0.5 * width, abs=0.02 * width)
    figure.get_by_role("button", name="Zoom out").click()
    page.wait_for_timeout(300)
    assert width_of(canvas) == pytest.approx(2 * (right - left))
    figure.get_by_role("button", name="Reset axes").click()
    page.wait_for_timeout(300)
    assert canvas.evaluate(RANGE) == pytest.approx([low, high])


def width_of(canvas: Any) -> float:
    low, high = canvas.evaluate(RANGE)
    return float(high - low)


def test_a_click_sorts_a_table_and_the_next_turns_it(passing: Page) -> None:
    page = passing
    table = page.locator("table", has_text="not a standard value")
    button = table.get_by_role("button", name="value", exact=True)

    def column() -> list[float]:
        cells = table.locator("tbody tr").evaluate_all(
            "rows => rows.map(row => Number(row.cells[1].dataset.number))"
        )
        return [float(cell) for cell in cells]

    before = column()
    assert len(before) > 3
    button.click()
    assert column() == sorted(before)
    assert table.locator("th[aria-sort=ascending]").count() == 1
    button.press("Enter")  # by keyboard
    assert column() == sorted(before, reverse=True)
    table.get_by_role("button", name="part", exact=True).click()
    names = table.locator("tbody th").all_inner_texts()
    assert names == sorted(names)


def test_the_theme_of_the_system_changes_page_and_pictures(passing: Page) -> None:
    page = passing
    light = page.evaluate(BACKGROUND), page.evaluate(INK)
    page.emulate_media(color_scheme="dark")
    page.wait_for_timeout(200)
    dark = page.evaluate(BACKGROUND), page.evaluate(INK)
    assert light[0] != dark[0]
    assert light[1] != dark[1]
    page.emulate_media(color_scheme="light")
    page.wait_for_timeout(200)
    assert (page.evaluate(BACKGROUND), page.evaluate(INK)) == light


def test_the_keyboard_reaches_everything(open_report: Open) -> None:
    page = open_report("passing").page
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.className") == "skip"
    reached = set()
    for _ in range(60):
        page.keyboard.press("Tab")
        reached.add(page.evaluate(FOCUSED))
    assert {"Waveforms", "Autoscale", "Zoom in"} <= reached


def test_paper_is_white_and_complete(open_report: Open, tmp_path: Path) -> None:
    page = open_report("passing", color_scheme="dark").page
    file = tmp_path / "report.pdf"
    page.pdf(path=str(file), format="A4")
    content = file.read_bytes()
    assert content.startswith(b"%PDF")
    assert content.count(b"/Type /Page\n") + content.count(b"/Type /Page ") >= 4
    page.emulate_media(media="print")
    page.set_viewport_size({"width": 720, "height": 1000})
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    page.wait_for_timeout(300)
    assert page.evaluate(BACKGROUND) == "rgb(255, 255, 255)"
    assert page.evaluate(INK) == "rgb(26, 32, 40)"
    assert page.locator(".tools").first.is_hidden()
    widths = page.locator(".canvas .main-svg").evaluate_all(
        "all => all.map(each => each.getBoundingClientRect().width)"
    )
    assert max(widths) <= 720


def test_texts_that_look_like_markup_do_nothing(open_report: Open) -> None:
    opened = open_report("hostile")
    assert opened.page.evaluate("typeof window.hacked") == "undefined"
    assert opened.page.locator("img").count() == 0
    assert opened.messages == []


def test_without_javascript_the_text_is_whole(browser: Any, files: Callable[[str], Path]) -> None:
    page = browser.new_context(viewport=DESK, java_script_enabled=False).new_page()
    page.goto(files("passing").as_uri())
    assert "need JavaScript" in page.locator("noscript").inner_text()
    assert page.locator("table").count() >= 4
    page.context.close()
