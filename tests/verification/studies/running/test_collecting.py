"""Calls of a study: their order, their progress, and those whose simulator was killed."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from taction.system.errors import Killed
from taction.verification.studies.running.collecting import RUNS, for_each_file, repeated_if_killed

FILES = [Path(f"{name}.toml") for name in "abcd"]


def killed_at_b(path: Path, number: int) -> str:
    if path.stem == "b":
        os.kill(os.getpid(), signal.SIGKILL)
    return f"{path.stem}{number}"


@pytest.mark.parametrize("jobs", [1, 3])
def test_results_stand_in_the_order_of_the_files(jobs: int) -> None:
    assert for_each_file(named, FILES, [(k,) for k in range(4)], jobs=jobs) == [
        "a0",
        "b1",
        "c2",
        "d3",
    ]


def named(path: Path, number: int) -> str:
    return f"{path.stem}{number}"


def test_a_killed_process_costs_only_its_own_file() -> None:
    first, second, *others = for_each_file(killed_at_b, FILES, [(0,)] * 4, jobs=2)
    assert (first, others) == ("a0", ["c0", "d0"])
    assert isinstance(second, BaseException)


def test_ctrl_c_leaves_none_for_what_did_not_run() -> None:
    def interrupted(path: Path) -> str:
        if path.stem == "c":
            raise KeyboardInterrupt
        return path.stem

    assert for_each_file(interrupted, FILES, [()] * 4, jobs=1) == ["a", "b", None, None]


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
