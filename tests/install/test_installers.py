"""The package as users install it: by pip and uv, used outside the checkout."""

from __future__ import annotations

import json
import re
import shutil
import sys
import tomllib
from pathlib import Path

import pytest

from tests.install.conftest import Environment, uv
from tests.support.paths import ROOT, SCENES

BOARD = "paper-breadboard.toml"
LIGHT = ("--engine", "statespace")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = {
    name: [re.split(r"[<>=]", need)[0] for need in needs]
    for name, needs in PROJECT["optional-dependencies"].items()
    if name != "dev"
}
# Command lines that need an extra, and the extra that the message names.
REFUSED = {
    ("verify", BOARD, "--plot=a.png", *LIGHT): "plot",
    ("verify", BOARD, "--report=a.html", *LIGHT): "report",
    ("explore", BOARD, "--no-browser"): "explore",
}


@pytest.fixture(params=["by_pip", "by_uv"])
def environment(request: pytest.FixtureRequest) -> Environment:
    made: Environment = request.getfixturevalue(request.param)
    shutil.copy(SCENES / BOARD, made.folder)
    return made


def test_the_papers_board_is_verified(environment: Environment, ngspice: str) -> None:
    run = environment.run("verify", BOARD, "--json")
    assert run.returncode == 0, run.stdout + run.stderr
    verdict = json.loads(run.stdout)
    assert verdict["outcome"] == "pass"
    assert verdict["taction"]["version"] == PROJECT["version"]
    assert len(verdict["checks"]) >= 3
    assert verdict["taction"]["simulator"]


def test_nothing_comes_from_the_checkout(by_pip: Environment, by_uv: Environment) -> None:
    for environment in (by_pip, by_uv):
        code = "import taction; print(taction.__file__, taction.verify.__module__)"
        run = environment.run("-c", code, program="python")
        file, module = run.stdout.split()
        assert Path(file).is_relative_to(environment.programs.parent)
        assert module == "taction.transients"
        assert run.stderr == ""


def test_the_core_brings_no_extra(by_pip: Environment) -> None:
    run = by_pip.run("-m", "pip", "list", "--format", "json", program="python")
    there = {each["name"].lower() for each in json.loads(run.stdout)}
    assert {"taction", "numpy", "scipy"} <= there
    assert not there & {name for names in EXTRAS.values() for name in names}


def test_doctor_names_the_extra_of_everything_that_is_missing(by_pip: Environment) -> None:
    run = by_pip.run("doctor", "--json")
    missing = [each["found"] for each in json.loads(run.stdout)["findings"] if not each["ok"]]
    named = set(re.findall(r"taction\[(\w+)\]", " ".join(missing)))
    assert named == set(EXTRAS)


@pytest.mark.parametrize(("words", "extra"), REFUSED.items(), ids=REFUSED.values())
def test_a_missing_extra_is_named_before_any_work(
    by_pip: Environment, words: tuple[str, ...], extra: str
) -> None:
    shutil.copy(SCENES / BOARD, by_pip.folder)
    run = by_pip.run(*words)
    assert run.returncode == 2
    assert f"pip install 'taction[{extra}]'" in run.stderr
    assert "Traceback" not in run.stderr


def test_extras_bring_what_their_options_need(by_uv: Environment) -> None:
    shutil.copy(SCENES / BOARD, by_uv.folder)
    run = by_uv.run("verify", BOARD, "--plot", "a.png", "--report", "a.html", *LIGHT)
    assert run.returncode == 0, run.stderr
    assert (by_uv.folder / "a.png").read_bytes()[1:4] == b"PNG"
    report = (by_uv.folder / "a.html").read_text(encoding="utf-8")
    assert "plotly" in report.lower()
    assert "<svg" in report


@pytest.mark.parametrize("extra", EXTRAS)
def test_every_extra_can_be_resolved(
    archives: tuple[Path, Path], by_uv: Environment, extra: str
) -> None:
    """Beside the core, on this Python: what would be installed has every package of the extra."""
    wanted = f"{archives[0]}[{extra}]"
    empty = by_uv.folder / "packages"
    words = ("--dry-run", "--target", str(empty), "--python", sys.executable, wanted)
    planned = set(re.findall(r"^ \+ ([\w-]+)==", uv("pip", "install", *words), re.MULTILINE))
    assert {"numpy", "scipy", *EXTRAS[extra]} <= planned
