"""A short session of torture: kills, disasters, commands on a bad machine; all in `make nightly`.

A full disk, a lost ngspice and workers of another version also have tests of their own in
`tests/verification/studies`.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.torture.disasters import possible
from tests.torture.session import is_fault, session, summary, table


@pytest.mark.skipif(sys.platform != "linux", reason="finds processes in /proc")
@pytest.mark.parametrize(
    ("kills", "kinds", "commands", "seed"),
    [
        pytest.param(2, (), 0, 2623, id="kills"),
        pytest.param(0, ("power cut", "two at once"), 0, 2623, id="disasters"),
        pytest.param(0, (), 4, 2623, id="commands"),
        pytest.param(6, tuple(possible()), 14, 10643, marks=pytest.mark.nightly, id="nightly"),
    ],
)
def test_nothing_is_lost_and_nothing_stays(
    kills: int, kinds: tuple[str, ...], commands: int, seed: int, tmp_path: Path, ngspice: str
) -> None:
    assert ngspice
    counts = {"kills": kills, "disasters": int(bool(kinds)), "commands": commands}
    reports = list(session(tmp_path, **counts, kinds=kinds, points=3, seed=seed, jobs=2))
    assert len(reports) == kills + commands + len(kinds)
    assert [summary(report) for report in reports if is_fault(report)] == []
    assert sum(report.hit for report in reports) >= len(reports) / 2
    assert len(table(reports).splitlines()) > 2
