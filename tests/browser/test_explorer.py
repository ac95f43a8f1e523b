"""The explorer in a real browser: what it shows is what `verify` computes."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import taction
from taction.netlist_gen.scene.axes import with_settings
from taction.system.quantities import quantity
from taction.verification.report.texts import figure
from tests.browser.conftest import DESK, Opened
from tests.browser.test_reports import violations
from tests.support.paths import ROOT, SCENES

CODE = "from taction.cli.main import main; main()"
LONG = 60_000  # ms
VERDICT = "#readings:not(.old)"
SERIES = """() => document.getElementById('outputs')._fullData
  .map(({ name, x, y }) => [name, [...x].map((each, k) => [each, y[k]]).flat()])"""


@dataclass(frozen=True)
class Server:
    """A running explorer."""

    process: subprocess.Popen[str]
    address: str
    scene: Path

    @property
    def host(self) -> str:
        return self.address.partition("/?")[0]


@pytest.fixture(scope="module")
def serve(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[str], Server]]:
    """Return a function that explores a copy of a shipped scene."""
    running: dict[str, Server] = {}

    def served(name: str) -> Server:
        if name not in running:
            folder = tmp_path_factory.mktemp("scenes")
            scene = Path(shutil.copy(SCENES / f"{name}.toml", folder))
            running[name] = started(scene)
        return running[name]

    yield served
    for server in running.values():
        server.process.send_signal(signal.SIGINT)
        server.process.communicate(timeout=20)


def run(scene: Path, *options: str) -> subprocess.Popen[str]:
    variables = {name: text for name, text in os.environ.items() if "PYTEST" not in name}
    return subprocess.Popen(
        [sys.executable, "-c", CODE, "explore", str(scene), "--no-browser", *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**variables, "PYTHONPATH": str(ROOT)},
    )


def started(scene: Path) -> Server:
    process = run(scene)
    assert process.stdout is not None
    return Server(process, process.stdout.readline().strip(), scene)


@pytest.fixture
def explore(browser: Any, serve: Callable[[str], Server]) -> Iterator[Callable[..., Opened]]:
    """Return a function that opens the explorer of a scene in a fresh context."""
    contexts = []

    def opened(name: str = "paper-breadboard", **options: object) -> Opened:
        context = browser.new_context(**{"viewport": DESK, "bypass_csp": True, **options})
        contexts.append(context)
        found = Opened(context.new_page())
        found.page.goto(serve(name).address)
        found.page.wait_for_selector(VERDICT, timeout=LONG)
        return found

    yield opened
    for context in contexts:
        context.close()


def type_value(page: Any, number: int, text: str) -> None:
    field = page.locator(f"#value-{number}")
    field.fill(text)
    field.press("Enter")
    page.wait_for_selector(VERDICT, timeout=LONG)


def drawn(page: Any, name: str) -> list[np.ndarray]:
    """Return the curves of a name as arrays (P, 2), s and V."""
    return [np.reshape(data, (-1, 2)) for each, data in page.evaluate(SERIES) if each == name]


def test_the_page_is_silent_and_asks_nobody_else(
    explore: Callable[..., Opened], serve: Callable[[str], Server]
) -> None:
    opened = explore(bypass_csp=False)
    host = serve("paper-breadboard").host
    assert opened.messages == []
    foreign = [u for u in opened.requests if not u.startswith((f"{host}/", "data:", "blob:"))]
    assert foreign == []
    assert "token" not in opened.page.url


def test_numbers_and_curves_are_those_of_verify(explore: Callable[..., Opened]) -> None:
    page, capacitance = explore().page, "47 pF"
    type_value(page, 0, capacitance)
    scene = with_settings(
        taction.load_scene(SCENES / "paper-breadboard.toml"), [f"C={capacitance}"]
    )
    verdict = taction.verify(scene, engine="statespace")
    shown = page.inner_text("#readings")
    measured = verdict.measurements
    assert measured.settling_time is not None
    assert measured.rise_time is not None
    assert quantity(measured.settling_time.value, "s") in shown
    assert quantity(measured.rise_time.value, "s") in shown
    assert figure(max(c.overshoot for c in measured.channels), "step") in shown
    assert page.inner_text("#verdict-mark") == verdict.outcome.value
    for n in range(7):
        (curve,) = drawn(page, f"u{n + 1}")
        expected = np.interp(curve[:, 0], verdict.waveforms.time, verdict.u[:, n])
        assert curve[:, 1] == pytest.approx(expected, abs=1e-3 * measured.amplitude)
        assert len(curve) <= 510


def test_a_slider_moves_the_board_and_back(explore: Callable[..., Opened]) -> None:
    page = explore().page
    before = page.inner_text("#readings")
    slider = page.locator("#slider-0")
    slider.focus()
    for _ in range(40):
        slider.press("ArrowRight")
    page.wait_for_function("document.getElementById('value-0').value !== '10 pF'")
    page.wait_for_selector(VERDICT, timeout=LONG)
    assert page.inner_text("#readings") != before
    assert "--set design.capacitance=" in page.inner_text("#command")
    with page.expect_download() as saved:
        page.click("#save")
    assert "capacitance = " in saved.value.path().read_text("utf-8")
    page.click("#reset")
    page.wait_for_function("document.getElementById('value-0').value === '10 pF'")
    page.wait_for_selector(VERDICT, timeout=LONG)
    assert page.inner_text("#readings") == before


def test_an_unstable_board_and_the_boundary_of_onset(explore: Callable[..., Opened]) -> None:
    page = explore().page
    onset = taction.onset(SCENES / "paper-breadboard.toml", over="C=1pF:300pF")
    edge = max(each.crossing.value for each in onset.findings)
    assert f"above {quantity(edge, 'F')}" in page.inner_text("#stable-text")
    type_value(page, 0, "5 pF")
    assert "unstable" in page.inner_text("#doubts")
    assert page.inner_text("#verdict-mark") == "fail"
    assert f"above {quantity(edge, 'F')}" in page.inner_text("#stable-text")


def test_wrong_values_are_refused_and_change_nothing(explore: Callable[..., Opened]) -> None:
    page = explore().page
    before = page.inner_text("#verdict-text")
    for text in ("12 ohm", "-1 pF", "<b>1</b>", "10"):
        page.locator("#value-0").fill(text)
        page.locator("#value-0").press("Enter")
        page.wait_for_function("document.getElementById('mistake-0').textContent.length > 0")
        assert page.input_value("#value-0") == text
        assert page.get_attribute("#value-0", "aria-invalid") == "true"
        assert page.inner_text("#verdict-text") == before
        page.evaluate("document.getElementById('mistake-0').textContent = ''")
    type_value(page, 0, "10 pF")
    assert page.get_attribute("#value-0", "aria-invalid") is None
    assert page.inner_text("#mistake-0") == ""


@pytest.mark.parametrize(("scheme", "capacitance"), [("light", "10 pF"), ("dark", "5 pF")])
def test_axe_finds_nothing_serious(
    explore: Callable[..., Opened], scheme: str, capacitance: str
) -> None:
    page = explore(color_scheme=scheme).page
    if capacitance != "10 pF":
        type_value(page, 0, capacitance)
    found = [each for each in violations(page) if each[1] in ("serious", "critical")]
    assert found == []


@pytest.mark.parametrize(("name", "status"), [("SIGINT", 0), ("SIGHUP", 129)])
def test_a_signal_ends_it_cleanly(tmp_path: Path, name: str, status: int) -> None:
    server = started(Path(shutil.copy(SCENES / "paper-breadboard.toml", tmp_path)))
    assert server.address.startswith("http://127.0.0.1:")
    server.process.send_signal(getattr(signal, name))
    _, errors = server.process.communicate(timeout=30)
    assert server.process.returncode == status
    assert "Traceback" not in errors
    assert [path.name for path in tmp_path.iterdir()] == ["paper-breadboard.toml"]
