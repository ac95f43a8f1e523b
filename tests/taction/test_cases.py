"""Decks that went wrong once: the pole of their cards, by closed forms, or why they are refused."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import taction
from taction.system.errors import InputError
from tests.support.paths import CASES

pytestmark = pytest.mark.usefixtures("ngspice")
A, TAU = 1e5, 1.0 / 62.8
POLES: dict[str, tuple[float, float | None]] = {
    # 1 TH and 1 TF: s^2 + s R/L + 1/(LC) of what the amplifier's DC gain of 1e6 leaves
    "lc-open-loop-slow.cir": (-1.875e-10, None),
    "refused-hspice-opamp.sp": (-1.0 / (10e3 * 1e-9), 0.0),
    "refused-laplace.cir": (-(1.0 + A / 11.0) / TAU, 0.0),
}


@pytest.mark.parametrize("name", POLES)
def test_the_rightmost_pole_is_that_of_the_cards(name: str) -> None:
    found = taction.check(CASES / name)
    real, hertz = POLES[name]
    assert found.poles.rightmost.real == pytest.approx(real, rel=1e-4)
    if hertz is not None:
        assert found.poles.rightmost.imag == pytest.approx(math.tau * hertz)
    (witness,) = [check for check in found.checks if check.name == "ac_agrees"]
    assert witness.outcome.value == "pass"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("refused-coax.cir", ("line 9", "a device 'T' is not accepted")),
        ("refused-model-name.net", ("line 3", "no subcircuit '{model_name}'")),
        ("refused-qspice.cir", ("line 5", "the character")),
        ("refused-space.cir", ("r1 in m 6.8 k", "unknown parameter (k)")),
    ],
)
def test_a_fair_refusal_names_line_and_reason(name: str, words: tuple[str, ...]) -> None:
    with pytest.raises(InputError) as error:
        taction.check(CASES / name)
    assert [word for word in words if word not in str(error.value)] == []


FUNCTIONS = {
    "a product": ("E1 o 0 in 0 Laplace=10*(1+s/300)/((1+s/100)*(1+ s/1k))", [-1000.0, -100.0]),
    "PSpice": ("E1 o 0 LAPLACE {V(in)} = {2/(1+1m*s+1u*s^2)}", np.roots([1e-6, 1e-3, 1.0])),
    "parameters": (
        ".param w=2k q=0.5\nE1 o 0 in 0 laplace={w^2/(s**2+s*w/q+w*w)}", [-2000.0, -2000.0]
    ),
    "an integrator": ("E1 o 0 in o laplace=1k/s", [-1000.0]),
    "a current": ("G1 0 o LAPLACE {V(in)} {1/(1+s*sqrt(4))}\nR1 o 0 1", [-0.5]),
    "an expression": ("B1 o 0 V=V(in) Laplace=1/(1+s*3)", [-1.0 / 3.0]),
}  # fmt: skip


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_transfer_function_becomes_states(name: str, tmp_path: Path) -> None:
    """Its poles are the roots of its denominator, and no part of it is a knob."""
    card, wanted = FUNCTIONS[name]
    place = tmp_path / "deck.cir"
    place.write_text(f"t\nV1 in 0 DC 0 AC 1\n{card}\n.end\n")
    found = taction.check(place, ngspice=False)
    poles = np.sort_complex(found.poles.poles)
    assert poles == pytest.approx(np.sort_complex(np.array(wanted, complex)), rel=1e-6, abs=1e-9)
    assert not any("taction" in part.name for part in found.parts)


@pytest.mark.parametrize(
    ("card", "words"),
    [
        ("E1 o 0 in 0 Laplace=exp(-s*1u)", "no quotient of polynomials"),
        ("E1 o 0 in 0 Laplace=s/(1+s)*s", "order of the numerator is 2"),
        ("E1 o 0 in 0 Laplace=(1+s", "cannot be read"),
        ("E1 o 0 in 0 Laplace=1/(1+s)^40", "no quotient of polynomials"),
        ("E1 o 0 in 0 Laplace=1/(s-s)", "a denominator of 0"),
    ],
)
def test_what_is_no_rational_function_is_refused(card: str, words: str, tmp_path: Path) -> None:
    place = tmp_path / "deck.cir"
    place.write_text(f"t\nV1 in 0 DC 0 AC 1\n{card}\nR1 o 0 1\n.end\n")
    with pytest.raises(InputError) as error:
        taction.check(place, ngspice=False)
    assert words in str(error.value)
