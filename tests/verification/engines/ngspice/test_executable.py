"""Finding ngspice: versions, KLU, and what is said when it is not there."""

from __future__ import annotations

from pathlib import Path

import pytest

from taction.system.errors import SimulatorNotFound
from taction.verification.engines.ngspice.executable import environment, find_simulator


def fake(folder: Path, answer: str) -> str:
    path = folder / "ngspice"
    path.write_text(f"#!/bin/sh\necho x >> {folder}/calls\necho '{answer}'\n")
    path.chmod(0o755)
    return str(path)


def test_the_real_one(ngspice: str) -> None:
    simulator = find_simulator(ngspice)
    assert simulator.version >= 39
    assert simulator.solver_option == ("klu" if simulator.klu else "noopiter")


@pytest.mark.parametrize(
    ("answer", "version", "option"),
    [
        ("** ngspice-39.3 : Circuit level simulation program", 39, "noopiter"),
        ("** ngspice-46 : x\n** Compiled with KLU Direct Linear Solver", 46, "klu"),
        ("** ngspice-46+ : x", 46, "noopiter"),
    ],
)
def test_version_and_solver(answer: str, version: int, option: str, tmp_path: Path) -> None:
    simulator = find_simulator(fake(tmp_path, answer))
    assert (simulator.version, simulator.solver_option) == (version, option)
    for asked in ("klu", "noopiter"):
        right = "KLU" if asked == option == "klu" else "Sparse"
        assert simulator.solver_of(f"* title\n.options {asked}\n.end\n") == right


def test_it_is_asked_once(tmp_path: Path) -> None:
    path = fake(tmp_path, "** ngspice-45 : x")
    assert find_simulator(path) is find_simulator(path)
    assert (tmp_path / "calls").read_text() == "x\n"


def test_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("TACTION_NGSPICE", raising=False)
    with pytest.raises(SimulatorNotFound, match="TACTION_NGSPICE"):
        find_simulator()


def test_variable_overrides_the_path_and_an_argument_overrides_both(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for version in (41, 42):
        (tmp_path / str(version)).mkdir()
    named = fake(tmp_path / "41", "** ngspice-41 : x")
    given = fake(tmp_path / "42", "** ngspice-42 : x")
    monkeypatch.setenv("TACTION_NGSPICE", named)
    assert find_simulator().version == 41
    assert find_simulator(given).version == 42


def test_environment_inherits_only_the_loaders_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LD_LIBRARY_PATH", "/opt/lib")
    monkeypatch.setenv("SPICE_LIB_DIR", "/elsewhere")
    assert environment(tmp_path) == {
        "LC_ALL": "C",
        "HOME": str(tmp_path),
        "SPICE_SCRIPTS": ".",
        "OMP_NUM_THREADS": "1",
        "LD_LIBRARY_PATH": "/opt/lib",
    }
