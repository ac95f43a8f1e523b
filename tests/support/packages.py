"""Packages: the wheel and the source archive of taction, and packages that a test installs.

::

    folder = install(tmp_path / "site", "acme", {"taction.opamps": {"acme1": "ACME1"}}, SOURCE)
    with installed(folder):  # this process, and every process that it starts
        ...

The fixture `plugin` (`tests/conftest.py`) does both until the test ends.
"""

from __future__ import annotations

import importlib
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from tests.support.paths import ROOT

Groups = Mapping[str, Mapping[str, str]]


def install(
    folder: Path, package: str, groups: Groups, source: str, *, version: str = "1.0"
) -> Path:
    """Write a distribution with the one module `package` into `folder`, as an installer would.

    `groups` has the attribute of the module by group and name of the entry point.
    """
    metadata = folder / f"{package}-{version}.dist-info"
    metadata.mkdir(parents=True, exist_ok=True)
    (folder / f"{package}.py").write_text(source, "utf-8")
    lines = [
        line
        for group, names in groups.items()
        for line in (f"[{group}]", *(f"{name} = {package}:{at}" for name, at in names.items()))
    ]
    (metadata / "entry_points.txt").write_text("\n".join(lines) + "\n", "utf-8")
    text = f"Metadata-Version: 2.1\nName: {package}\nVersion: {version}\n"
    (metadata / "METADATA").write_text(text, "utf-8")
    return folder


def recipe(title: str) -> tuple[str, dict[str, dict[str, str]], str]:
    """Package, entry points and source of the example below a heading of ``docs/extending.md``.

    They are the arguments of `install` and of the fixture `plugin`.
    """
    text = (ROOT / "docs" / "extending.md").read_text("utf-8").partition(f"\n## {title}\n")[2]
    text = text.partition("\n## ")[0]
    blocks = dict(re.findall(r"```(python|toml)\n(.*?)```", text, re.DOTALL))
    groups = tomllib.loads(blocks["toml"])["project"]["entry-points"]
    (package,) = {at.partition(":")[0] for names in groups.values() for at in names.values()}
    short = {g: {n: at.partition(":")[2] for n, at in names.items()} for g, names in groups.items()}
    return package, short, blocks["python"]


def environment(*folders: Path) -> dict[str, str]:
    """The environment of a new process that finds what is installed in `folders`."""
    before = os.environ.get("PYTHONPATH")
    paths = [*map(str, folders), *([before] if before else [])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}


@contextmanager
def installed(*folders: Path) -> Iterator[None]:
    """Let this process and its children find what is installed in `folders`."""
    before, path, modules = os.environ.get("PYTHONPATH"), list(sys.path), set(sys.modules)
    os.environ["PYTHONPATH"] = environment(*folders)["PYTHONPATH"]
    sys.path[:0] = map(str, folders)
    _look_again()
    try:
        yield
    finally:
        sys.path[:] = path
        del os.environ["PYTHONPATH"]
        if before is not None:
            os.environ["PYTHONPATH"] = before
        for name in set(sys.modules) - modules:
            file = getattr(sys.modules[name], "__file__", None)  # None for a namespace
            places = [file] if file else list(getattr(sys.modules[name], "__path__", ()))
            if any(Path(place).is_relative_to(folder) for place in places for folder in folders):
                del sys.modules[name]
        _look_again()


def _look_again() -> None:
    importlib.invalidate_caches()
    for name, module in [*sys.modules.items()]:
        for value in vars(module).values() if name.startswith("taction.") else ():
            if callable(clear := getattr(value, "cache_clear", None)):
                clear()


# The top level shows these folders of the package as links.
LINKS = ("cli", "netlist_gen", "spice_models", "scenes")
FILES = ("pyproject.toml", "README.md", "LICENSE")

BUILD = """
import sys
from setuptools import build_meta

out = sys.argv[1]  # each build changes sys.argv
print(build_meta.build_wheel(out), build_meta.build_sdist(out))
"""


def build_archives(copy: Path, out: Path) -> tuple[Path, Path]:
    """Copy the sources into the folder `copy`; build wheel and source archive into `out`."""
    shutil.copytree(ROOT / "taction", copy / "taction")
    for name in LINKS:
        (copy / name).write_text(f"taction/{name}")  # as git writes a link where there can be none
    for name in FILES:
        shutil.copy(ROOT / name, copy)
    run = subprocess.run(
        [sys.executable, "-c", BUILD, str(out)], cwd=copy, capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr
    wheel, sdist = run.stdout.splitlines()[-1].split()
    return out / wheel, out / sdist
