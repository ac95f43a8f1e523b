"""A headless Chromium, and the files of reports that it opens.

Without ``TACTION_BROWSER``, the path of a Chromium, nothing here is collected.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from taction.verification.report.blocks import Page as Report
from taction.verification.report.renderers.page import page_html
from tests.support.report_pages import STUDIES, VERDICTS, hostile, page

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

PATH = os.environ.get("TACTION_BROWSER", "")
PHONE = {"width": 390, "height": 844}
DESK = {"width": 1200, "height": 900}
NAMES = (*VERDICTS, *STUDIES)

Open = Callable[..., "Opened"]


class Opened:
    """A page of the browser with what it reported: console messages, errors, requests."""

    def __init__(self, page: Page) -> None:
        self.page = page
        self.messages: list[str] = []
        self.requests: list[str] = []
        page.on("console", lambda message: self.messages.append(message.text))
        page.on("pageerror", lambda error: self.messages.append(str(error)))
        page.on("dialog", lambda dialog: self.messages.append(dialog.message))
        page.on("request", lambda request: self.requests.append(request.url))

    def goto(self, file: Path) -> None:
        """Open a report and wait until its pictures are drawn."""
        self.page.goto(file.as_uri())
        self.page.wait_for_selector("html[data-ready]", state="attached", timeout=60_000)


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=PATH, args=["--no-sandbox"])
        yield running
        running.close()


@pytest.fixture(scope="session")
def files(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Return the file of a report by its name; each is made once."""
    folder = tmp_path_factory.mktemp("reports")

    def made(name: str) -> Path:
        file = folder / f"{name.replace(' ', '-')}.html"
        if not file.exists():
            report: Report = hostile() if name == "hostile" else page(name)
            file.write_text(page_html(report), encoding="utf-8")
        return file

    return made


@pytest.fixture
def open_report(browser: Browser, files: Callable[[str], Path]) -> Iterator[Open]:
    """Return a function that opens a report in a fresh context; options go to the context."""
    contexts = []

    def opened(name: str, **options: object) -> Opened:
        settings = {"viewport": DESK, **options}
        context = browser.new_context(**settings)  # type: ignore[arg-type]
        contexts.append(context)
        found = Opened(context.new_page())
        found.goto(files(name))
        return found

    yield opened
    for context in contexts:
        context.close()
