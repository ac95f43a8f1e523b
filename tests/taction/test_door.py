"""The public names: light, lazy, typed, and what they hand back."""

from __future__ import annotations

import subprocess
import sys

import pytest

import taction
from scripts.rooms import below, short
from tests.project.test_imports import reached
from tests.support.paths import ROOT, SCENES
from tests.support.running import taction as command

HEAVY = ("numpy", "scipy", "pydantic", "click", "rich", "PySpice")
JOBS = ("taction.designs", "taction.transients", "taction.tools")


def loaded_by(script: str) -> set[str]:
    """Run a script in a fresh Python and return the modules that it has loaded."""
    text = f"{script}\nimport sys; print(); print(*sys.modules)"
    run = subprocess.run(
        [sys.executable, "-c", text], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return set(run.stdout.splitlines()[-1].split())


@pytest.mark.parametrize("use", ["dir(taction)", "taction.netlist, taction.verify"])
def test_import_taction_and_its_jobs_load_nothing_heavy(use: str) -> None:
    assert not loaded_by(f"import taction; {use}") & set(HEAVY)


def test_every_public_name_is_listed_and_found() -> None:
    assert set(taction.__all__) <= set(dir(taction))
    assert sorted(taction.__all__) == taction.__all__
    assert all(getattr(taction, name) is not None for name in taction.__all__)


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
