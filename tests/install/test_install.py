"""The package as users install it, by pip and uv, outside the checkout.

Environments have taction and nothing else, made with the package sources of this machine's pip.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.support.packages import build_archives
from tests.support.paths import ROOT, SCENES

# What pip is told by its files and variables, as uv is told the same.
UV_NAMES = {
    "index-url": "UV_DEFAULT_INDEX",
    "extra-index-url": "UV_INDEX",
    "find-links": "UV_FIND_LINKS",
    "cert": "SSL_CERT_FILE",
}
OURS = ("PYTEST", "PYTHON", "TACTION", "VIRTUAL_ENV", "COLUMNS")


def outside() -> dict[str, str]:
    """Return the environment variables of a user who has no checkout."""
    return {name: value for name, value in os.environ.items() if not name.startswith(OURS)}


def uv_sources() -> dict[str, str]:
    """Return the package sources of pip's configuration as variables of uv."""
    words = [sys.executable, "-m", "pip", "config", "list"]
    listed = subprocess.run(words, check=True, capture_output=True, text=True).stdout
    found = {}
    for line in listed.splitlines():
        name, _, value = line.partition("=")
        if variable := UV_NAMES.get(name.rpartition(".")[2].strip()):
            found[variable] = value.strip("'")
    # Of two indexes uv takes a package from the first that has it, pip takes the newest of all.
    return found | {"UV_INDEX_STRATEGY": "unsafe-best-match"}


@dataclass(frozen=True)
class Environment:
    """An environment with taction: its programs, and an empty folder outside the checkout."""

    programs: Path
    folder: Path

    def run(self, *words: str, program: str = "taction") -> subprocess.CompletedProcess[str]:
        """Run a program of the environment in the folder."""
        return subprocess.run(
            [self.programs / program, *words],
            cwd=self.folder,
            env=outside(),
            capture_output=True,
            text=True,
            stdin=subprocess.DEVNULL,
            timeout=300,
        )


def uv(*words: str) -> str:
    """Run uv with the package sources of pip; return what it says."""
    run = subprocess.run(
        [sys.executable, "-m", "uv", *words],
        env=outside() | uv_sources(),
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert run.returncode == 0, run.stderr
    return run.stdout + run.stderr


@pytest.fixture(scope="session")
def archives(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The wheel and the source archive."""
    return build_archives(tmp_path_factory.mktemp("checkout"), tmp_path_factory.mktemp("dist"))


@pytest.fixture(scope="session")
def by_pip(archives: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Environment:
    """The wheel by pip, without extras.

    Matplotlib goes: PySpice depends on it, and what taction uses of PySpice does not.
    """
    place = tmp_path_factory.mktemp("pip")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", place], check=True)
    pip = (sys.executable, "-m", "pip", "--python", place / "bin" / "python", "--quiet")
    for words in (
        ("install", "--no-compile", str(archives[0])),
        ("uninstall", "--yes", "matplotlib"),
    ):
        subprocess.run([*pip, *words], check=True, env=outside())
    return Environment(place / "bin", tmp_path_factory.mktemp("empty"))


@pytest.fixture(scope="session")
def by_uv(archives: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Environment:
    """The source archive by uv, with the extras `plot` and `report`."""
    place = tmp_path_factory.mktemp("uv")
    uv("venv", "--quiet", "--clear", "--python", sys.executable, str(place))
    python = str(place / "bin" / "python")
    uv("pip", "install", "--quiet", "--python", python, f"{archives[1]}[plot,report]")
    return Environment(place / "bin", tmp_path_factory.mktemp("empty"))


BOARD = "paper-breadboard.toml"
LIGHT = ("--engine", "statespace")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = {
    name: [re.split(r"[<>=]", need)[0] for need in needs]
    for name, needs in PROJECT["optional-dependencies"].items()
    if name != "dev"
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
    code = "from importlib.metadata import distributions as d; print(*[x.name for x in d()])"
    there = {name.lower() for name in by_pip.run("-c", code, program="python").stdout.split()}
    assert {"taction", "numpy", "scipy"} <= there
    assert not there & {name for names in EXTRAS.values() for name in names}


def test_extras_bring_what_their_options_need(by_uv: Environment) -> None:
    shutil.copy(SCENES / BOARD, by_uv.folder)
    run = by_uv.run("verify", BOARD, "--plot", "a.png", "--report", "a.html", *LIGHT)
    assert run.returncode == 0, run.stderr
    assert (by_uv.folder / "a.png").read_bytes()[1:4] == b"PNG"
    report = (by_uv.folder / "a.html").read_text(encoding="utf-8")
    assert "plotly" in report.lower()
    assert "<svg" in report


def test_all_extras_can_be_resolved(archives: tuple[Path, Path], by_uv: Environment) -> None:
    """Together, beside the core, on this Python: what would be installed has every package."""
    wanted = f"{archives[0]}[{','.join(EXTRAS)}]"
    empty = by_uv.folder / "packages"
    words = ("--dry-run", "--target", str(empty), "--python", sys.executable, wanted)
    said = uv("pip", "install", *words)
    assert "does not have an extra" not in said
    planned = set(re.findall(r"^ \+ ([\w-]+)==", said, re.MULTILINE))
    assert {"numpy", "scipy", *(name for names in EXTRAS.values() for name in names)} <= planned
