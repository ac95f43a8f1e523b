"""The scan for crossings, on poles that are known functions of the value."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from taction.system.errors import EngineError
from taction.verification.stability import scan as scans
from taction.verification.stability.edges import Scan
from taction.verification.stability.poles import Poles, or_error, summarise
from tests.support.poles import rounded_poles

GRID = np.geomspace(0.1, 10.0, 31).tolist()
Law = Callable[[float], Poles]


def scan(read: Law, values: Sequence[float], **how: Any) -> Scan:
    """Scan poles, or errors, of a law."""
    return scans.scan(values, lambda value: or_error(read, value), **how)


def poles_of(*laws: Callable[[float], complex]) -> Callable[[float], Poles]:
    """Poles, rightmost first, from laws in the logarithm of the value; pairs are completed."""

    def read(value: float) -> Poles:
        x = float(np.log(value))
        listed = [complex(law(x)) for law in laws]
        listed += [p.conjugate() for p in listed if p.imag]
        found = np.array(listed)
        return rounded_poles(found)

    return read


def pair(pole: complex) -> Poles:
    return rounded_poles(np.array([pole, np.conj(pole)]))


def places(found: Scan) -> list[float]:
    return [float(np.log(crossing.value)) for crossing in found.edges]


def test_both_ends_of_a_window_far_narrower_than_the_grid_are_found() -> None:
    for half in (1e-2, 1e-3):
        found = scan(poles_of(lambda x, h=half: h**2 - (x - 0.123) ** 2 + 2j), GRID)  # type: ignore[misc]
        assert places(found) == pytest.approx([0.123 - half, 0.123 + half], rel=1e-6)
        assert [c.unstable_above for c in found.edges] == [True, False]
        assert [(c.below, c.above) for c in found.edges] == [(0, 2), (2, 0)]
        assert found.edges[0].frequency == pytest.approx(1.0 / np.pi)
        (low, first), (second, high) = found.stable_ranges
        assert (low, high) == (0.1, 10.0)
        assert (first, second) == tuple(c.value for c in found.edges)


@pytest.mark.parametrize("start", [GRID[0], GRID[-1]])
def test_from_a_stable_end_nothing_is_read_far_behind_the_first_edge(start: float) -> None:
    """Unstable from 1/e to e, but for a gap near 1 that nobody asks for."""
    seen = list[float]()
    inner = poles_of(lambda x: min(1.0 - x**2, x**2 - 1e-4) + 2j)

    def read(value: float) -> Poles:
        seen.append(value)
        return inner(value)

    sign = 1.0 if start > 1.0 else -1.0
    found = scan(read, GRID, start=start)
    assert places(found) == pytest.approx([sign], rel=1e-6)
    reach = np.log(GRID[1] / GRID[0])
    assert all(sign * np.log(value) >= 1.0 - reach for value in seen)
    whole = scan(inner, GRID)
    assert len(whole.edges) == 4
    assert found.edges[0].value in [pytest.approx(edge.value, rel=1e-7) for edge in whole.edges]


def test_a_stable_gap_inside_an_unstable_range_is_found() -> None:
    found = scan(poles_of(lambda x: (x + 0.4) ** 2 - 1e-6 + 1j), GRID)
    assert places(found) == pytest.approx([-0.401, -0.399], rel=1e-6)
    assert found.stable_ranges == (tuple(c.value for c in found.edges),)


def test_a_mode_that_comes_near_and_turns_back_does_not_cross() -> None:
    found = scan(poles_of(lambda x: -1e-9 - (x - 0.123) ** 2 + 2j), GRID)
    assert found.edges == ()
    assert found.stable_ranges == ((0.1, 10.0),)


def test_crossings_within_one_grid_interval_are_told_apart() -> None:
    found = scan(
        poles_of(
            lambda x: x - 0.01 + 1j,
            lambda x: x - 0.0101 + 2j,
            lambda x: 0.02 - x,
            lambda x: x - 0.03,
        ),
        GRID,
    )
    assert places(found) == pytest.approx([0.01, 0.0101, 0.02, 0.03], rel=1e-6)
    assert [c.unstable_above for c in found.edges] == [True, True, False, True]
    assert [c.frequency > 0.0 for c in found.edges] == [True, True, False, False]
    assert [c.below for c in found.edges] == [1, 3, 5, 4]
    assert [c.changes_stability for c in found.edges] == [False] * 4
    assert found.stable_ranges == ()


def test_a_linear_scan_reaches_zero() -> None:
    found = scan(
        lambda v: rounded_poles(np.array([0.3 - v, -5.0], dtype=complex)),
        [0.0, 0.5, 1.0],
        logarithmic=False,
    )
    assert found.edges[0].value == pytest.approx(0.3, rel=1e-8)
    assert found.stable_ranges == ((found.edges[0].value, 1.0),)


def test_values_without_poles_are_kept_with_their_reason() -> None:
    def read(value: float) -> Poles:
        if value > 2.0:
            raise EngineError("no equilibrium")
        return pair(np.log(value) + 1j)

    found = scan(read, GRID)
    assert places(found) == pytest.approx([0.0], abs=1e-8)
    assert {s.failure for s in found.samples if s.value > 2.0} == {"no equilibrium"}
    with pytest.raises(EngineError, match="no equilibrium"):
        scan(read, [3.0, 4.0])


def test_of_incomplete_poles_only_the_rightmost_one_counts() -> None:
    laws = poles_of(lambda x: x - 0.3 + 1j, lambda x: x - 0.4 + 2j, lambda x: x - 0.5)
    found = scan(lambda v: summarise(laws(v).poles[:3], complete=False), GRID)
    assert places(found) == pytest.approx([0.3], rel=1e-6)
    assert not found.complete
    assert (found.edges[0].below, found.edges[0].above) == (0, 1)
    assert found.stable_ranges == ((0.1, found.edges[0].value),)


def test_a_window_hidden_behind_a_slower_mode_is_found() -> None:
    """Only between two samples the mode lies right of the mode that is the rightmost at both."""
    window = poles_of(lambda x: 1e-4 - (x - 0.123) ** 2 + 2j, lambda x: -1e-4)
    found = scan(window, GRID)
    assert places(found) == pytest.approx([0.113, 0.133], rel=1e-6)
    assert [(c.below, c.above) for c in found.edges] == [(0, 2), (2, 0)]


def test_a_pole_on_the_axis_to_within_rounding_is_no_crossing_and_no_stable_range(
    rng: np.random.Generator,
) -> None:
    """A pole at 1e6 /s leaves 1.4e-8 /s of rounding to all others."""

    def read(value: float) -> Poles:
        noise = 1e-9 * float(rng.standard_normal())
        drift = 0.0 if value < 1.0 else 1.0 - value
        return rounded_poles(np.array([noise + drift, -1e6], dtype=complex))

    found = scan(read, GRID)
    assert found.edges == ()
    ((low, high),) = found.stable_ranges
    assert low == pytest.approx(1.0, abs=0.1)
    assert high == 10.0
    ((low, high),) = found.unresolved
    assert (low, high) == (0.1, pytest.approx(1.0, abs=0.1))
