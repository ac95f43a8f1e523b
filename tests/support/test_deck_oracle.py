"""The oracle of the stress cases against closed forms and against figures found elsewhere."""

from __future__ import annotations

import math

import numpy as np
import pytest
from flint import acb, arb, arb_mat, ctx

from tests.support.deck_equations import parse_deck, state_equations
from tests.support.exact_readings import Modes, Signal, eigen, exact_modes
from tests.support.nonlinear_response import Board, integrate

HEAD = ".title taction board\n* outputs: u_1 = -v(y)\n"
TAIL = ".options klu\n.save v(y)\n.op\n.end\n"
# A current of -2 A into 3 ohm and 5 F, a copy of the voltage at gain 10, a divider without state.
LAG = """R1 x 0 3.0
C1 x 0 5.0
I1 0 x -2.0
Eb z 0 x 0 10.0
Ra z y 1.0
Rb y 0 4.0
"""


@pytest.fixture(autouse=True)
def precision() -> object:
    before, ctx.prec = ctx.prec, 300
    yield
    ctx.prec = before


def modes_of(board: str) -> Modes:
    return exact_modes(state_equations(parse_deck(HEAD + board + TAIL)), 1)


def ringing(zeta: float) -> Signal:
    """The step response of ``1 / (s^2 + 2 zeta s + 1)``, channel by channel with target 1."""
    root = (1 - arb(zeta) ** 2).sqrt()
    pole = acb(-arb(zeta), root)
    share = -(1 + acb(0, 1) * (-arb(zeta)) / root) / 2
    pairs = ((pole, share), (pole.conjugate(), share.conjugate()))
    return Signal(Modes((pole,), (arb(1),), (pairs,)), 0, arb(1), arb(1))


def test_a_lag_behind_a_divider() -> None:
    modes = modes_of(LAG)
    final = 10.0 * 0.8 * 6.0  # -v(y)
    assert float(modes.final[0]) == pytest.approx(final, rel=1e-15)
    assert complex(modes.poles[0]) == pytest.approx(-1 / 15, rel=1e-15)
    at = float(modes.at(0, arb(7.0)))
    assert at == pytest.approx(final * -math.expm1(-7 / 15), rel=1e-15)


def test_eigenvalues_of_a_badly_scaled_matrix_and_of_equal_ones() -> None:
    rng = np.random.default_rng(3)
    basis = arb_mat(rng.normal(size=(16, 16)).tolist())
    wanted = [-(10.0**k) for k in range(-6, 6)] + [-2.5, -2.5, -2.5, -7.0]
    diagonal = arb_mat(16, 16)
    for k, value in enumerate(wanted):
        diagonal[k, k] = arb(value)
    values, V = eigen(basis * diagonal * basis.inv())
    found = sorted(float(value.real) for value in values)
    assert found == pytest.approx(sorted(wanted), rel=1e-25)
    assert max(abs(float(x.imag)) for x in values) < 1e-25
    assert V.nrows() == 16


@pytest.mark.parametrize("zeta", [0.001, 0.5])
def test_the_overshoot_of_a_second_order_system(zeta: float) -> None:
    expected = math.exp(-math.pi * zeta / math.sqrt(1 - zeta**2))
    assert float(ringing(zeta).highest(1)) == pytest.approx(expected, rel=1e-14)
    assert float(ringing(zeta).highest(-1)) == 1.0  # at the start


def test_a_transient_with_a_closed_form() -> None:
    # x' = exp(-x) - 1/2 from 0: x = ln(2 - exp(-t/2)); the second source gives -y = x
    board = "Ba a 0 V=exp(-V(x))\nG1 0 x a 0 1.0\nI1 x 0 0.5\nC1 x 0 1.0\nEy y 0 x 0 -1.0\n"
    (part,) = state_equations(parse_deck(HEAD + board + TAIL))
    run = integrate(Board(part), arb_mat(1, 1), arb_mat([[math.log(2.0)]]), 8.0, 10, 1e-11)
    times = np.array([0.3, 1.0, 4.0])
    assert run.outputs(times)[:, 0] == pytest.approx(np.log(2.0 - np.exp(-times / 2)), rel=1e-10)
    (samples,) = run.samples([(math.log(2.0), 0.0)])
    settled = samples.last_outside(arb(0.5))
    assert settled == pytest.approx(-2.0 * math.log(2.0 - 2.0 * math.exp(-0.5)), rel=1e-9)


def test_a_break_and_a_source_that_reads_itself_at_once_by_collocation() -> None:
    # a = min((x + a) / 2, 1) = min(x, 1); x' = 2 - x below 1 and 3 - 2 x above
    board = "Ba a 0 V=min(0.5*V(s),1)\nEs s 0 d 0 1.0\nEd d a x 0 1.0\n"
    board += "I1 0 x 2.0\nG1 x 0 a 0 1.0\nG2 x 0 l 0 1.0\nC1 x 0 1.0\n"
    board += "Bl l 0 V=2*max(V(x)-1,0)\nEy y 0 x 0 -1.0\n"
    (part,) = state_equations(parse_deck(HEAD + board + TAIL))
    run = integrate(Board(part), arb_mat(1, 1), arb_mat([[1.5]]), 8.0, 10, 1e-11)
    times = np.array([0.2, 0.6, 0.8, 1.5, 4.0])
    late = times - math.log(2.0)
    expected = np.where(late < 0.0, 2.0 - 2.0 * np.exp(-times), 1.5 - 0.5 * np.exp(-2.0 * late))
    assert run.outputs(times)[:, 0] == pytest.approx(expected, rel=1e-10)
