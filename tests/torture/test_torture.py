"""A short session of torture: three kills and one disaster of each kind; six in `make nightly`.

Of both seeds two kills are SIGKILL to a sweep and to a Monte Carlo study, in the middle of a run.
Kills, disasters and commands are tests of their own, so that two processes of pytest share them.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.torture.disasters import possible
from tests.torture.killing import KILLS, Report, plan_kills
from tests.torture.session import is_fault, session, summary, table
from tests.torture.studies import all_studies


@pytest.mark.skipif(sys.platform != "linux", reason="finds processes in /proc")
@pytest.mark.parametrize(
    ("kills", "disasters", "commands", "seed"),
    [
        pytest.param(3, 0, 0, 2623, id="kills"),
        pytest.param(0, 1, 0, 2623, id="disasters"),
        pytest.param(0, 0, 5, 2623, id="commands"),
        pytest.param(6, 1, 14, 10643, marks=pytest.mark.nightly),
    ],
)
def test_nothing_is_lost_and_nothing_stays(
    kills: int, disasters: int, commands: int, seed: int, tmp_path: Path, ngspice: str
) -> None:
    assert ngspice
    counts = {"kills": kills, "disasters": disasters, "commands": commands}
    reports = list(session(tmp_path, **counts, points=3, seed=seed, jobs=2))
    assert len(reports) == kills + commands + disasters * len(possible())
    assert [summary(report) for report in reports if is_fault(report)] == []
    assert sum(report.hit for report in reports) >= 2 * len(reports) / 3


def test_a_plan_takes_every_kind_of_kill_and_is_the_same_again() -> None:
    studies = all_studies(3)
    plan = plan_kills(studies, 200, 1)
    assert plan == plan_kills(studies, 200, 1) != plan_kills(studies, 200, 2)
    kinds = {(kill.study.name, kill.victim, kill.signals) for kill in plan}
    assert {(victim, signals) for _, victim, signals in kinds} == {
        (victim, signals) for victim, choices in KILLS.items() for signals in choices
    }
    assert {study for study, *_ in kinds} == set(studies)
    assert not any(victim == "worker" for study, victim, _ in kinds if study == "verify")


def test_whatever_is_wrong_is_a_fault() -> None:
    assert not is_fault(Report("sweep", "parent", "SIGKILL", -9, hit=False, left_by_kill=2))
    assert is_fault(Report("sweep", "parent", "SIGKILL", equal=False))
    assert is_fault(Report("sweep", "parent", "SIGKILL", orphans=["ngspice"]))
    assert is_fault(Report("sweep", "parent", "SIGKILL", leftovers=["taction-run-a"]))
    assert is_fault(Report("sweep", "parent", "SIGKILL", faults=["Traceback"]))


def test_the_table_counts_by_victim_and_signal() -> None:
    reports = [
        Report("sweep", "parent", "SIGKILL", -9, left_by_kill=1),
        Report("verify", "parent", "SIGKILL", 0, hit=False),
        Report("verify", "tree", "SIGKILL", -9, equal=False, orphans=["ngspice"]),
    ]
    assert table(reports).splitlines()[2:] == [
        "| parent | SIGKILL | 2 | 1 | -9: 1, 0: 1 | 2 | 0 | 1 | 1 | 0 |",
        "| tree | SIGKILL | 1 | 1 | -9: 1 | 0 | 1 | 0 | 0 | 0 |",
    ]
