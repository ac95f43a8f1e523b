"""The wheel: every file, one top-level name, and no harm to anybody else's packages."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from pathlib import Path

import pytest

from taction.verification.studies.running.versions import own_code
from tests.support.entries import write_fast
from tests.support.packages import FILES, LINKS, build_archives
from tests.support.paths import ROOT

FOLDERS = ("cli", "netlist_gen", "spice_models", "system", "verification")
SHIPPED = (".py", ".toml", ".json", ".typed", ".html", ".css", ".js")
RIVAL_TEST = """
import sys
from pathlib import Path

LOADED = set(sys.modules)

def test_the_plugin_is_there_and_light():
    assert "taction.pytest_plugin" in LOADED
    assert not LOADED & {"numpy", "pydantic", "taction.cli", "taction.netlist_gen"}

def test_our_own_packages_are_found():
    import cli, netlist_gen, spice_models, system, verification
    for package in (cli, netlist_gen, spice_models, system, verification):
        assert package.OWNER == "somebody else"
        assert Path(package.__file__).is_relative_to(Path(__file__).parent)
"""


@pytest.fixture(scope="module")
def archives(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A wheel and a source archive."""
    return build_archives(tmp_path_factory.mktemp("checkout"), tmp_path_factory.mktemp("dist"))


@pytest.fixture(scope="module")
def site(archives: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel installed and nothing else."""
    target = tmp_path_factory.mktemp("site")
    words = ["--no-deps", "--no-index", "--quiet", "--target", str(target), str(archives[0])]
    subprocess.run([sys.executable, "-m", "pip", "install", *words], check=True)
    return target


def installed(site: Path, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run Python in `folder` with the wheel and its dependencies, but without the checkout.

    ``-S`` leaves out the ``.pth`` file by which the checkout is on the path of this Python.
    """
    paths = dict.fromkeys((str(site), *map(sysconfig.get_path, ("purelib", "platlib"))))
    environment = {name: value for name, value in os.environ.items() if "PYTEST" not in name}
    return subprocess.run(
        [sys.executable, "-S", *words],
        cwd=folder,
        env=environment | {"PYTHONPATH": os.pathsep.join(paths)},
        capture_output=True,
        text=True,
        timeout=300,
    )


def sources() -> dict[str, Path]:
    """The files of a wheel: their names in it, and where they are in the checkout."""
    place = ROOT / "taction"
    scenes = [path for path in (place / "scenes").rglob("*") if path.suffix in {".toml", ".csv"}]
    files = [path for path in place.rglob("*") if path.suffix in SHIPPED]
    files = [path for path in files if place / "scenes" not in path.parents]
    assert files
    assert scenes
    files += scenes
    return {path.relative_to(ROOT).as_posix(): path for path in files}


def names(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


def read(wheel: Path, ending: str) -> str:
    (name,) = (name for name in names(wheel) if name.endswith(ending))
    with zipfile.ZipFile(wheel) as archive:
        return archive.read(name).decode()


def test_the_wheel_holds_every_file_as_it_is_in_the_checkout(archives: tuple[Path, Path]) -> None:
    expected = sources()
    found = names(archives[0])
    about = {name for name in found if ".dist-info/" in name}
    assert found - about == set(expected)
    assert any(name.endswith("licenses/LICENSE") for name in about)
    with zipfile.ZipFile(archives[0]) as wheel:
        changed = [name for name, path in expected.items() if wheel.read(name) != path.read_bytes()]
    assert not changed


def test_the_names_at_the_top_level_are_links_into_the_package() -> None:
    """The archives are built from a copy without these links."""
    links = {path.name: path for path in ROOT.iterdir() if path.is_symlink() and path.is_dir()}
    assert links.keys() == set(LINKS)
    assert all(str(path.readlink()) == f"taction/{name}" for name, path in links.items())
    assert not [path for path in (ROOT / "taction").rglob("*") if path.is_symlink()]


def test_wheel_and_checkout_have_the_same_digest(site: Path, tmp_path: Path) -> None:
    """So a cluster whose workers have the wheel takes the work of a checkout."""
    script = (
        "from taction.verification.studies.running.versions import own_code as f; print(f().hex())"
    )
    run = installed(site, tmp_path, "-c", script)
    assert run.returncode == 0, run.stderr
    assert run.stdout.strip() == own_code().hex()


def test_the_source_archive_holds_every_module_and_data_file(archives: tuple[Path, Path]) -> None:
    with tarfile.open(archives[1]) as sdist:
        found = {name.partition("/")[2] for name in sdist.getnames()}
    local = {path.relative_to(ROOT).as_posix() for path in sources().values()}
    assert (local | set(FILES)) - found == set()
    assert not [name for name in found if name.startswith(("tests/", "docs/", "benchmarks/"))]


def test_packages_of_the_same_names_beside_the_tests_are_left_alone(
    site: Path, tmp_path: Path
) -> None:
    for name in FOLDERS:
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text('OWNER = "somebody else"\n')
    (tmp_path / "test_rival.py").write_text(RIVAL_TEST)
    write_fast(tmp_path / "z.scene.toml")
    run = installed(site, tmp_path, "-m", "pytest", "-v", "-p", "no:cacheprovider")
    assert run.returncode == 0, run.stdout + run.stderr
    assert "z.scene.toml" in run.stdout
    assert "3 passed" in run.stdout
