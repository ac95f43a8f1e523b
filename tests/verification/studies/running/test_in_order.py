"""Calls for files: their order, killed processes, and Ctrl-C."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from taction.verification.studies.running.in_order import for_each_file

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
