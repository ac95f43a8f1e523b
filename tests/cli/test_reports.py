"""``--report`` of the commands: written, refused, and never over an input."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from lxml import html

from taction.cli.main import COMMANDS, main
from tests.support.entries import write_fast

TOLERANCES = "\n[tolerances]\nresistor = 0.01\n"
WITH_REPORT = (
    "verify",
    "sweep",
    "montecarlo",
    "corners",
    "onset",
    "accuracy",
    "tune",
    "regress",
    "choose",
)


def taction(*arguments: str) -> Result:
    return CliRunner().invoke(main, arguments)


def headings(file: Path) -> list[str]:
    tree = html.document_fromstring(file.read_text("utf-8"))
    return [str(each.text) for each in tree.xpath("//h2")]


@pytest.mark.parametrize("name", WITH_REPORT)
def test_the_option_is_documented(name: str) -> None:
    assert name in COMMANDS
    assert "--report FILE" in taction(name, "--help").output


@pytest.mark.parametrize(
    ("words", "heading", "summary"),
    [
        (("verify",), "Waveforms", "All 4 checks pass"),
        (("corners", "--corner", "resistor=1"), "Corners", "1 corner: 1 "),
        (("montecarlo", "--sample", "3"), "Waveforms", ""),
        (("onset", "--over", "C=5pF:50pF:7", "--no-confirm"), "Crossings", "Stable for C: "),
    ],
)
def test_a_command_writes_its_report(
    tmp_path: Path, words: tuple[str, ...], heading: str, summary: str
) -> None:
    scene, out = write_fast(tmp_path / "a.toml", more=TOLERANCES), tmp_path / "a.html"
    run = taction(words[0], str(scene), *words[1:], "--report", str(out))
    assert run.exit_code in (0, 1, 3), run.output
    assert heading in headings(out)
    assert f"wrote {out}" in run.stderr
    tree = html.document_fromstring(out.read_text("utf-8"))
    assert summary in tree.xpath("string(//p[@class='verdict'])")


def test_a_regression_writes_its_report(tmp_path: Path) -> None:
    folder = tmp_path / "scenes"
    folder.mkdir()
    write_fast(folder / "a.toml")
    files = ("--baseline", str(tmp_path / "b.json"), "--report", str(tmp_path / "a.html"))
    run = taction("regress", str(folder), *files, "--update", "--jobs", "1")
    assert run.exit_code == 0, run.output
    assert headings(tmp_path / "a.html")[0] == "Scenes"


@pytest.mark.parametrize("name", WITH_REPORT)
def test_a_report_that_is_no_page_is_refused_before_any_work(tmp_path: Path, name: str) -> None:
    scene = write_fast(tmp_path / "a.toml", more=TOLERANCES)
    target = str(tmp_path) if name == "regress" else str(scene)
    more = {
        "sweep": ("--over", "C=1pF,2pF", "-o", str(tmp_path / "a.sqlite")),
        "onset": ("--over", "C"),
        "choose": ("--store", str(tmp_path / "a.sqlite")),
        "regress": ("--baseline", str(tmp_path / "b.json"), "--update"),
    }
    run = taction(name, target, *more.get(name, ()), "--report", str(tmp_path / "a.txt"))
    assert run.exit_code == 2
    assert "expected a file that ends in .html" in run.output
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a.toml"]
