"""Figures: medians, quartiles and limits; jobs in turns; processes with their cost."""

from __future__ import annotations

import pytest

from benchmarks.measuring import Figure, in_turns, machine, python
from tests.support.paths import ROOT


def test_a_figure_is_the_median_of_its_ratios() -> None:
    figure = Figure("a", "b", [4.0, 1.0, 2.0, 3.0, 5.0], wanted=3.0)
    assert (figure.measured, figure.quartiles) == (3.0, (2.0, 3.0, 4.0))
    assert figure.kept
    assert Figure("a", "b", [7.0]).quartiles == (7.0, 7.0, 7.0)


@pytest.mark.parametrize(
    ("wanted", "least", "kept"),
    [(2.0, False, True), (1.0, False, False), (2.0, True, False), (1.0, True, True)],
)
def test_a_value_of_its_own_keeps_an_upper_or_a_lower_limit(
    wanted: float, least: bool, kept: bool
) -> None:
    figure = Figure("a", "b", [9.0], wanted, value=1.5, unit="s", least=least)
    assert figure.kept is kept
    assert Figure("a", "b", [9.0]).kept  # without a limit


def test_jobs_take_turns() -> None:
    calls: list[str] = []
    jobs = {name: lambda name=name: calls.append(name) or float(len(calls)) for name in "ab"}
    found = in_turns(jobs, 3)
    assert calls[:2] == ["a", "b"]  # the warming up, which is not timed
    assert all(set(calls[k : k + 2]) == {"a", "b"} for k in (2, 4, 6))
    assert sorted(found["a"] + found["b"]) == [3.0, 4.0, 5.0, 6.0, 7.0, 8.0]
    assert [len(times) for times in in_turns(jobs, 1, warm=False).values()] == [1, 1]


def test_a_process_tells_its_cost() -> None:
    cost = python("import time; block = bytearray(100_000_000); time.sleep(0.05)")
    assert cost.wall > 0.05
    assert cost.processor > 0.0
    assert cost.memory > 100.0
    with pytest.raises(RuntimeError, match="oh no"):
        python("raise ValueError('oh no')")


def test_the_machine_has_no_paths(ngspice: str) -> None:
    text = machine()
    assert "Python 3" in text
    assert "BLAS kernel" in text
    assert "/" not in text
    assert str(ROOT) not in text
