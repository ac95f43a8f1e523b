"""The public names: light, lazy, typed, and what they hand back."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import taction
from scripts.rooms import below, short
from tests.project.test_imports import reached
from tests.support.entries import write_fast
from tests.support.paths import ROOT, SCENES
from tests.support.running import taction as command
from tests.support.studying import scene_file

HEAVY = ("numpy", "scipy", "pydantic", "click", "rich", "PySpice")
JOBS = ("taction.designs", "taction.transients", "taction.decks")


def loaded_by(script: str) -> set[str]:
    """Run a script in a fresh Python and return the modules that it has loaded."""
    text = f"{script}\nimport sys; print(); print(*sys.modules)"
    run = subprocess.run(
        [sys.executable, "-c", text], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return set(run.stdout.splitlines()[-1].split())


def command_line(*words: str) -> str:
    """A script that runs a command; click's own runner would load a debugger, and asyncio."""
    run = f"from taction.cli.main import main\ntry:\n    main({list(words)!r})\n"
    return f"{run}except SystemExit as end:\n    assert not end.code\n"


@pytest.mark.parametrize("use", ["dir(taction)", "taction.netlist, taction.verify"])
def test_import_taction_and_its_jobs_load_nothing_heavy(use: str) -> None:
    assert not loaded_by(f"import taction; {use}") & set(HEAVY)


def test_help_and_a_deck_load_no_study_and_no_terminal(tmp_path: Path) -> None:
    shown = loaded_by(command_line("--help"))
    assert not [name for name in shown if name.startswith(("taction.cli.boards", "numpy", "rich"))]
    scene = str(SCENES / "tuned-breadboard.toml")
    made = loaded_by(command_line("netlist", scene, "-o", str(tmp_path / "a.cir")))
    assert (tmp_path / "a.cir").exists()
    unused = ("rich", "asyncio", "taction.cli.studies", "taction.verification.verdict.verify")
    assert not made & {*unused, "taction.verification.report.blocks"}


def test_every_public_name_is_listed_and_found() -> None:
    assert set(taction.__all__) <= set(dir(taction))
    assert sorted(taction.__all__) == taction.__all__
    assert all(getattr(taction, name) is not None for name in taction.__all__)


def test_a_name_that_is_not_public_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'verfy'"):
        getattr(taction, "verfy")  # noqa: B009 - mypy knows that there is none


@pytest.mark.parametrize("module", ["taction", *JOBS])
def test_nothing_behind_the_public_names_imports_the_command_line(module: str) -> None:
    assert not [name for name in reached(short(module)) if below(name, ("cli",))]


def without_times(text: str) -> list[str]:
    """The screen up to the line that states how long everything took."""
    *lines, last, _ = text.splitlines()
    assert "; more: -v" in last
    return lines


@pytest.mark.parametrize("name", ["paper-breadboard", "custom-matrix"])
def test_print_shows_the_screen_of_the_command(name: str) -> None:
    file = SCENES / f"{name}.toml"
    shown = command("verify", str(file), "--engine", "statespace")
    verdict = taction.verify(file, engine="statespace")
    assert without_times(str(verdict)) == without_times(shown.stdout)
    assert str(verdict).splitlines()[-1] == verdict.outcome.value.upper() == "PASS"


def test_progress_receives_lines_of_text(tmp_path: Path) -> None:
    file, lines = write_fast(tmp_path / "a.toml"), list[str]()
    taction.verify(file, progress=lines.append)
    taction.sweep(file, over={"C": ["10pF"]}, jobs=1, progress=lines.append)
    taction.montecarlo(scene_file(tmp_path), samples=1, jobs=1, progress=lines.append)
    assert "synthesis" in lines
    assert any(line.startswith("1 of 1 points") for line in lines)
    assert any(line.startswith("yield: 1 of 1 samples") for line in lines)


def test_samples_in_a_file_are_not_drawn_again(tmp_path: Path) -> None:
    scene, kept, lines = scene_file(tmp_path), tmp_path / "s.jsonl", list[str]()
    first = taction.montecarlo(scene, samples=3, output=kept, jobs=1)
    again = taction.montecarlo(scene, samples=3, output=kept, jobs=1, progress=lines.append)
    assert again == first
    assert lines == []
