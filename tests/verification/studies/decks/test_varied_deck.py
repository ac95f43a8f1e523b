"""Worst cases, yield and a reference of decks, against closed forms and the regularised optimum."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import taction
from taction.system.errors import InputError
from taction.verification.studies.decks.board_check import BoardCheck
from tests.support.running import taction as command

pytestmark = pytest.mark.usefixtures("ngspice")
RC = "RC\nV1 in 0 PULSE(0 1)\nR1 in out 1k\nC1 out 0 1n\n.end\n"
DIVIDER = "divider\nV1 in 0 PULSE(0 2)\nR1 in out 1k\nR2 out 0 1k\nC1 out 0 1n\n.end\n"
TAU = 1e-6


def checked(folder: Path, deck: str, spread: str, **more: object) -> BoardCheck:
    (folder / "deck.cir").write_text(deck)
    (folder / "parts.toml").write_text(spread)
    return taction.check(
        folder / "deck.cir",
        tolerances=folder / "parts.toml",
        ngspice=False,
        **more,  # type: ignore[arg-type]
    )


def worst(found: BoardCheck, quantity: str) -> float:
    assert found.corners is not None
    (corner,) = (each for each in found.corners.corners if each.quantity == quantity)
    value = corner.result.value(quantity)
    assert value is not None
    return value


def test_the_corners_of_an_rc_are_its_slowest_and_fastest(tmp_path: Path) -> None:
    """With R and C at their upper ends tau is 1.01 * 1.05 times its value."""
    found = checked(tmp_path, RC, "resistor = 0.01\ncapacitor = 0.05\n", samples=1)
    slow = 1.01 * 1.05 * TAU
    assert worst(found, "growth_rate") == pytest.approx(-1.0 / slow, rel=1e-9)
    assert worst(found, "settling_time") == pytest.approx(slow * math.log(100.0), rel=1e-5)
    assert worst(found, "rise_time") == pytest.approx(slow * math.log(9.0), rel=1e-5)


def test_a_divider_rests_where_its_worst_resistors_say(tmp_path: Path) -> None:
    found = checked(tmp_path, DIVIDER, 'resistor = "1%"\n', samples=1)
    above = 1.01 / (1.01 + 1.0 / 1.01) - 0.5  # of 2 V, in steps of 1 V: twice this
    assert worst(found, "steady_state") == pytest.approx(2.0 * above, rel=1e-6)
    assert found.corners is not None
    solved = sorted(direction.solved for direction in found.corners.directions)
    assert solved == pytest.approx([-2.0 * above, 2.0 * above], rel=1e-6)


def test_the_yield_is_the_share_of_slow_capacitors(tmp_path: Path) -> None:
    """C is C0 1.05^z with z from -1 to 1: it is below 1.02 C0 in (1 + ln 1.02 / ln 1.05) / 2."""
    limit = 1.02 * TAU * math.log(100.0)
    found = checked(
        tmp_path,
        RC,
        'capacitor = 0.05\ndistribution = "uniform"\n',
        samples=100,
        checks=f"settling={limit!r}@1%",
    )
    assert found.yields is not None
    share = 0.5 * (1.0 + math.log(1.02) / math.log(1.05))
    assert found.yields.low <= share <= found.yields.high
    assert found.yields.samples == 100
    assert found.corners is not None
    (settling,) = (each for each in found.corners.quantities if each.name == "settling_time")
    assert settling.limits == (None, limit)
    assert found.outcome.value == "fail"  # a corner is beyond the limit, though the board passes
    assert {check.outcome.value for check in found.checks} == {"pass"}


def test_the_command_says_worst_cases_and_yield(tmp_path: Path) -> None:
    (tmp_path / "deck.cir").write_text(RC)
    (tmp_path / "parts.toml").write_text("capacitor = 0.05\n")
    call = ["check", str(tmp_path / "deck.cir"), "--tolerances", str(tmp_path / "parts.toml")]
    result = command(*call, "-n", "40", "--no-ngspice")
    assert result.exit_code == 0, result.output
    assert "worst settling time" in result.output
    assert "40 of 40 boards pass" in result.output
    result = command(*call, "--check", "settling=4.7us@1%", "--no-ngspice")
    assert result.exit_code == 1
    assert "settling time not kept" in result.output


def test_a_parameter_moves_all_that_depends_on_it(tmp_path: Path) -> None:
    """R1 = rv and R2 = 2 half both follow half: with C exact tau is 1.02 times its value."""
    deck = (
        "RC\n.param rv={2*half} half=500\nV1 in 0 PULSE(0 1)\nR1 in a {rv/2}\nR2 a out {half}\n"
        "C1 out 0 1n\n"
    )
    found = checked(tmp_path, deck, '[params]\nHALF = "2%"\n', samples=40)
    assert worst(found, "growth_rate") == pytest.approx(-1.0 / (1.02 * TAU), rel=1e-9)
    assert worst(found, "settling_time") == pytest.approx(1.02 * TAU * math.log(100.0), rel=1e-5)
    assert found.yields is not None
    assert (found.yields.samples, found.yields.passed) == (40, 40)


def test_a_coupling_moves_the_leakage_of_a_transformer(tmp_path: Path) -> None:
    """Behind R1 the leakage L (1 - k^2) of equal coils decays through R2 + R1 fastest."""
    deck = (
        "transformer\nV1 in 0 PULSE(0 1)\nR1 in a 1k\nL1 a 0 1m\nL2 out 0 1m\nK1 L1 L2 0.9\n"
        "R2 out 0 1k\n.end\n"
    )
    found = checked(tmp_path, deck, "coupling = 0.05\n", samples=20)
    # (R1 + s L)(R2 + s L) = (s M)^2 with R1 = R2: s = -R / (L (1 + k)), the slower one
    k = 0.9 * 1.05
    assert worst(found, "growth_rate") == pytest.approx(-1e6 / (1.0 + k), rel=1e-9)


@pytest.mark.parametrize(
    ("spread", "reason"),
    [
        ("coupling = 0.2\n", "K1 = 0.9 ± 20 %: reaches 1 within its tolerance"),
        ('[params]\nnone = "1%"\n', "no .param of the deck has this name; the nearest is 'k'"),
        ('params = "1%"\n', "expected a table"),
        ('[params]\nk = "1%"\n', "a number other than 0"),
    ],
)
def test_a_tolerance_that_cannot_be_is_refused(tmp_path: Path, spread: str, reason: str) -> None:
    deck = (
        "transformer\n.param k=0\nV1 in 0 PULSE(0 1)\nR1 in a 1k\nL1 a 0 1m\nL2 out 0 1m\n"
        "K1 L1 L2 0.9\nR2 out 0 {1k+k}\n.end\n"
    )
    with pytest.raises(InputError, match=reason):
        checked(tmp_path, deck, spread, samples=1)


T, EPS = np.array([[2.0, 1.0], [1.0, 3.0], [0.0, 1.0]]), np.array([3.0, 4.0, 2.0])


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """Return a deck that rests at the optimum for lambda = 0.5 by the normal equations, in mV."""
    u = np.linalg.solve(T.T @ T + 0.5 * np.eye(2), T.T @ EPS)
    cards = [f"V{k} i{k} 0 PULSE(0 {-1e-3 * v!r})\nR{k} i{k} o{k} 1k\nC{k} o{k} 0 1n"
             for k, v in enumerate(u.tolist(), 1)]  # fmt: skip
    (tmp_path / "deck.cir").write_text("\n".join(["inverted outputs", *cards, ".end", ""]))
    np.savetxt(tmp_path / "T.csv", T, delimiter=",")
    np.savetxt(tmp_path / "eps.csv", EPS)
    return tmp_path


def options(place: Path, **more: object) -> dict[str, object]:
    known = {"outputs": ["o1", "o2"], "matrix": place / "T.csv", "strain": place / "eps.csv"}
    return {**known, "lam": 0.5, "unit": "-1mV", "ngspice": False, **more}


def test_a_deck_at_the_optimum_passes(place: Path) -> None:
    found = taction.check(place / "deck.cir", **options(place))  # type: ignore[arg-type]
    assert [check.name for check in found.checks] == ["v(o1)", "v(o2)", "stability"]
    assert found.outcome.value == "pass"


@pytest.mark.parametrize("change", [{"lam": 0.0}, {"unit": "1mV"}, {"outputs": ["o2", "o1"]}])
def test_another_problem_fails(change: dict[str, object], place: Path) -> None:
    found = taction.check(place / "deck.cir", **options(place, **change))  # type: ignore[arg-type]
    assert found.outcome.value == "fail"


def test_an_uncertain_optimum_is_refused(place: Path) -> None:
    np.savetxt(place / "T.csv", np.ones((3, 2)), delimiter=",")
    with pytest.raises(InputError, match="larger --lambda"):
        taction.check(place / "deck.cir", **options(place, lam=0.0))  # type: ignore[arg-type]
