"""A deck against the regularised optimum of a matrix and a strain."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import taction
from taction.system.errors import InputError
from tests.support.running import taction as command

pytestmark = pytest.mark.usefixtures("ngspice")
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


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"outputs": "o1"}, ("T.csv", "2 columns", "--output")),
        ({"strain": None}, ("--strain", "belong together")),
        ({"matrix": None}, ("--matrix", "belong together")),
        ({"unit": "1A"}, ("--unit", "'1A'", "V")),
        ({"accept": "much"}, ("--accept", "'much'", "5%")),
    ],
)
def test_mistakes(change: dict[str, object], words: tuple[str, ...], place: Path) -> None:
    with pytest.raises(InputError) as error:
        taction.check(place / "deck.cir", **options(place, **change))  # type: ignore[arg-type]
    for word in words:
        assert word in str(error.value)


def test_an_uncertain_optimum_is_refused(place: Path) -> None:
    np.savetxt(place / "T.csv", np.ones((3, 2)), delimiter=",")
    with pytest.raises(InputError, match="larger --lambda"):
        taction.check(place / "deck.cir", **options(place, lam=0.0))  # type: ignore[arg-type]


def test_the_command_shows_the_expected_value_with_its_tolerance(place: Path) -> None:
    call = ["check", str(place / "deck.cir"), "--output", "o1", "--output", "o2", "--matrix",
            str(place / "T.csv"), "--strain", str(place / "eps.csv"), "--no-ngspice"]  # fmt: skip
    result = command(*call, "--lambda", "0.5", "--unit=-1mV")
    assert result.exit_code == 0, result.output
    assert "±" in result.output
    result = command(*call, "--unit=-1mV")
    assert result.exit_code == 1
    assert "expected: " in result.output
