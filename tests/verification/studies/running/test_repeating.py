"""A killed simulator is no result of a point; one that is always killed is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from taction.system.errors import Killed
from taction.verification.studies.running.repeating import RUNS, repeated_if_killed


def computation(folder: Path, kills: int) -> tuple[Callable[[], str], list[Path]]:
    """A computation whose simulator is killed `kills` times, and the folders of the runs."""
    runs: list[Path] = []

    def compute() -> str:
        runs.append(folder / str(len(runs)))
        runs[-1].mkdir()
        if len(runs) <= kills:
            raise Killed("a signal ended ngspice", folder=runs[-1])
        return "result"

    return compute, runs


def test_a_killed_run_is_repeated_and_its_folder_goes(tmp_path: Path) -> None:
    compute, runs = computation(tmp_path, RUNS - 1)
    assert repeated_if_killed(compute) == "result"
    assert [run.exists() for run in runs] == [False] * (RUNS - 1) + [True]


def test_the_last_of_many_kills_is_an_error_with_its_folder(tmp_path: Path) -> None:
    compute, runs = computation(tmp_path, 10)
    with pytest.raises(Killed) as killed:
        repeated_if_killed(compute)
    assert len(runs) == RUNS
    assert killed.value.folder == runs[-1]
    assert runs[-1].exists()
