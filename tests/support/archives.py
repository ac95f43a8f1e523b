"""The wheel and the source archive of taction, built from a copy: the checkout stays clean."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

from tests.support.paths import ROOT

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
