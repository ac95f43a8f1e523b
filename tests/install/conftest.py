"""Environments with taction and nothing else, made with the package sources of this machine's pip.

Without ``TACTION_INSTALL`` (``make test-install`` sets it) nothing here is collected.
"""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.support.archives import build_archives

collect_ignore_glob = [] if os.environ.get("TACTION_INSTALL") else ["test_*.py"]
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
    subprocess.run([sys.executable, "-m", "venv", place], check=True)
    for words in (
        ("install", "--no-compile", str(archives[0])),
        ("uninstall", "--yes", "matplotlib"),
    ):
        pip = [place / "bin" / "pip", "--quiet", *words]
        subprocess.run(pip, check=True, env=outside())
    return Environment(place / "bin", tmp_path_factory.mktemp("empty"))


@pytest.fixture(scope="session")
def by_uv(archives: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Environment:
    """The source archive by uv, with the extras `plot` and `report`."""
    place = tmp_path_factory.mktemp("uv")
    uv("venv", "--quiet", "--clear", "--python", sys.executable, str(place))
    python = str(place / "bin" / "python")
    uv("pip", "install", "--quiet", "--python", python, f"{archives[1]}[plot,report]")
    return Environment(place / "bin", tmp_path_factory.mktemp("empty"))
