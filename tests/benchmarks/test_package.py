"""What an installation brings, from the metadata of the packages."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

import pytest

from benchmarks.package import closure, size


def test_an_extra_adds_its_packages_to_the_core() -> None:
    core = closure("taction", frozenset())
    assert {"taction", "numpy", "scipy", "pydantic-core", "ply"} <= core
    assert not {"plotly", "distributed", "pytest", "nicegui"} & core
    assert {"plotly", "narwhals", "markupsafe"} <= closure("taction", frozenset({"report"})) - core


def test_a_size_is_that_of_the_files_that_an_installer_wrote() -> None:
    files = [Path(str(file.locate())) for file in metadata.files("click") or ()]
    written = [file for file in files if file.suffix != ".pyc"]
    assert size("click") == pytest.approx(sum(file.stat().st_size for file in written))
    assert 2e5 < size("click") < 2e6
