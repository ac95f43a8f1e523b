"""The wheel and the source archive hold every module and every data file."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

from tests.support.paths import ROOT

PACKAGES = ("spice_models", "netlist_gen", "verification", "cli", "taction")
SHIPPED = (".py", ".toml", ".json")

BUILD = """
import sys
from setuptools import build_meta

out = sys.argv[1]  # each build changes sys.argv
print(build_meta.build_wheel(out), build_meta.build_sdist(out))
"""


@pytest.fixture(scope="module")
def archives(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A wheel and a source archive, built from a copy so that the checkout stays clean."""
    copy = tmp_path_factory.mktemp("checkout")
    for package in PACKAGES:
        shutil.copytree(ROOT / package, copy / package, symlinks=True)
    shutil.copytree(ROOT / "scenes", copy / "scenes")
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    out = tmp_path_factory.mktemp("dist")
    run = subprocess.run(
        [sys.executable, "-c", BUILD, str(out)], cwd=copy, capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr
    wheel, sdist = run.stdout.splitlines()[-1].split()
    return out / wheel, out / sdist


def sources() -> set[str]:
    scenes = [path for path in (ROOT / "scenes").rglob("*") if path.suffix in {".toml", ".csv"}]
    assert scenes
    return {f"verification/{path.relative_to(ROOT).as_posix()}" for path in scenes} | {
        path.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.suffix in SHIPPED
    }


def test_the_wheel_holds_every_module_and_data_file(archives: tuple[Path, Path]) -> None:
    with zipfile.ZipFile(archives[0]) as wheel:
        names = set(wheel.namelist())
    assert sources() - names == set()
    assert any(name.endswith("licenses/LICENSE") for name in names)


def test_the_source_archive_holds_every_module_and_data_file(archives: tuple[Path, Path]) -> None:
    with tarfile.open(archives[1]) as sdist:
        names = {name.partition("/")[2] for name in sdist.getnames()}
    assert (sources() | {"pyproject.toml", "README.md", "LICENSE"}) - names == set()


def test_the_wheel_declares_the_command(archives: tuple[Path, Path]) -> None:
    with zipfile.ZipFile(archives[0]) as wheel:
        (entry,) = (name for name in wheel.namelist() if name.endswith("entry_points.txt"))
        assert "taction = cli.main:main" in wheel.read(entry).decode()
