"""Names of files and folders that are unusual: not UTF-8, with quotes, braces or line breaks."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest
from lxml import etree

from tests.support.entries import write_fast
from tests.support.paths import SCENES
from tests.support.running import document, python, taction

SCENE = SCENES / "tuned-breadboard.toml"
NAME = os.fsdecode(b"board-\xff.toml")


def run(*words: str, **variables: str) -> subprocess.CompletedProcess[str]:
    return python("-m", "taction", *words, env=variables)


@pytest.fixture
def temporary(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Return a function that names the folder for temporary files of this process."""

    def named(folder: str) -> None:
        monkeypatch.setenv("TMPDIR", folder)
        monkeypatch.setattr(tempfile, "tempdir", None)

    return named


def test_a_temporary_folder_may_have_any_name(
    tmp_path: Path, ngspice: str, temporary: Callable[[str], None]
) -> None:
    place = tmp_path / "a'quote, a line\nbreak, $HOME;`x` {\\"
    place.mkdir()
    temporary(str(place))
    scene = str(write_fast(tmp_path / "a.toml"))
    done = taction("verify", scene, "--engine", "ngspice")
    assert done.exit_code == 0, done.stderr
    words = ("sweep", scene, "--over", "C=10p", "--engine", "ngspice", "--jobs", "1")
    done = taction(*words, "-o", str(tmp_path / "a.sqlite"), "--json")
    assert done.exit_code == 0, done.stderr
    assert "error" not in document(done)["outcomes"]
    assert not list(place.iterdir())


def test_a_temporary_folder_that_is_missing_is_named_and_no_point_is_stored(
    tmp_path: Path, ngspice: str
) -> None:
    scene = str(write_fast(tmp_path / "a.toml"))
    words = ("sweep", scene, "--over", "C=10p", "--engine", "ngspice", "--jobs", "1")
    done = run(*words, "-o", str(tmp_path / "a.sqlite"), TMPDIR="/missing")
    assert done.returncode == 3
    assert "no folder can be made in /missing (TMPDIR)" in done.stderr
    assert document(taction(*words, "-o", str(tmp_path / "a.sqlite"), "--json"))["ran"] == 1


def test_a_regression_with_a_name_that_is_no_text(tmp_path: Path) -> None:
    shutil.copy(SCENE, tmp_path / NAME)
    baseline, junit, markdown = (tmp_path / f"{NAME}.{kind}" for kind in ("json", "xml", "md"))
    words = ("regress", str(tmp_path), "--baseline", str(baseline))
    files = ("--junit", str(junit), "--markdown", str(markdown))
    first = taction(*words, *files, "--update", "--jobs", "1")
    assert first.exit_code == 0, first.stderr
    second = taction(*words, *files, "--json", "--jobs", "1")
    assert second.exit_code == 0, second.stderr
    assert [scene["file"] for scene in document(second)["scenes"]] == ["board-\\udcff.toml"]
    assert r"board-\udcff" in etree.fromstring(junit.read_bytes()).xpath("//testsuite/@name")[0]
    assert r"board-\udcff" in markdown.read_text(encoding="utf-8")


ODD = "x\n::error file=a::y \x1b]0;t\x07"


def unseen(text: str) -> None:
    """No line is a command, and no character moves a terminal."""
    for line in text.splitlines():
        assert not line.lstrip().startswith("::")
    assert "\x1b" not in text
    assert "\x07" not in text


@pytest.mark.parametrize(
    "words",
    [
        ("verify", "{}.toml"),
        ("verify", "none{}.toml"),
        ("verify", "plain.toml", "--plot", "{}"),
        ("verify", "plain.toml", "--set", "{}=1"),
        ("verify", "plain.toml", "--{}"),
        ("{}",),
        ("diff", "{}.json", "plain.toml"),
        ("regress", ".", "--baseline", "{}.json", "--update"),
        ("models", "import", "{}.lib"),
        ("sweep", "{}.toml", "--over", "C=50p,60p", "--jobs", "1", "-o", "{}.sqlite"),
    ],
    ids=" ".join,
)
def test_names_are_shown_and_never_obeyed(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = SCENE.read_text().replace('engine = "auto"', 'engine = "statespace"')
    for name in (ODD, "plain"):
        (tmp_path / f"{name}.toml").write_text(scene)
    monkeypatch.chdir(tmp_path)
    done = taction(*(word.replace("{}", ODD) for word in words))
    assert done.exit_code in (0, 2)
    unseen(done.stdout)
    unseen(done.stderr)
    assert "Traceback" not in done.output
    for file in tmp_path.glob("*.html"):
        unseen(file.read_text().partition("<style>")[0])


def test_a_name_with_a_command_in_every_medium() -> None:
    from taction.verification.report.blocks import BOTH, Facts, Notes, Page, Section, Table, cell
    from taction.verification.report.junit import (
        JUnitTest,
        annotation_lines,
        junit_suite,
        junit_text,
    )
    from taction.verification.report.renderers.notebook import card
    from taction.verification.report.renderers.page import page_html
    from taction.verification.report.renderers.terminal import markdown, page_text

    blocks = (
        Table(ODD, (ODD,), ((cell(ODD),),), ODD),
        Facts(ODD, ((ODD, ODD),)),
        Notes(ODD, (ODD,)),
    )
    media = f"{BOTH} notebook"
    page = Page(ODD, ODD, "", ODD, (ODD,), (Section(ODD, blocks, ODD, media),), (ODD,))
    suite = junit_suite(ODD, [JUnitTest(ODD, "failure", ODD, ODD)], simulator=ODD)
    document = {"file": ODD, "outcome": ODD, "error": {"message": ODD}}
    text = page_text(page) + markdown(page, "a") + card(page) + junit_text("demo", [suite])
    text += page_html(page).partition("<style>")[0] + page_html(page).rpartition("</header>")[2]
    unseen(text)
    annotations = list(annotation_lines([document]))
    assert all("\n" not in line and "\x1b" not in line for line in annotations)
