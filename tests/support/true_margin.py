"""Every stability crossing of a board with one channel, over all C, from two decks' texts.

The determinant of ``s Q + G`` over ``det G`` is linear in C: ``D(s) = P(s) + C Q(s)``. A pole is on
the axis where ``C = -P/Q`` at ``s = j omega`` is real, so the frequencies are the real roots of one
polynomial: no crossing can be missed.
"""

from __future__ import annotations

from flint import acb, acb_poly, arb, arb_poly, ctx

from taction.netlist_gen.analysis import OperatingPoint
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.scene import Scene
from tests.support.deck_equations import parse_deck, state_equations

RATE = 1e6  # 1/s: unit of s, so that the coefficients are of one size
BITS = 600


def crossings(scene: Scene) -> list[float]:
    """Return every C at which a pole of the one-channel board crosses the axis, F, increasing."""
    before, ctx.prec = ctx.prec, BITS
    try:
        C = scene.design.capacitance
        one, half = _determinant(scene, C), _determinant(scene, C / 2)
        Q = (one - half) * (2 / arb(C))
        P = one - Q * arb(C)
        (p_real, p_imag), (q_real, q_imag) = _parts(P), _parts(Q)
        equation = p_imag * q_real - p_real * q_imag
        squares = [_refined(equation, root.real.mid()) for root in _real_roots(equation)]
        found = []
        for square in (arb(0), *squares):
            s = acb(0, square.sqrt())
            value = -acb_poly(P)(s) / acb_poly(Q)(s)
            if bool(value.real > 0):
                found.append(float(value.real))
        return sorted(found)
    finally:
        ctx.prec = before


def true_margin(scene: Scene) -> float | None:
    """Return the least factor above 1 by which C shrinks to a crossing; None without one."""
    C = scene.design.capacitance
    return min((C / at for at in crossings(scene) if at < C), default=None)


def _determinant(scene: Scene, C: float) -> arb_poly:
    """Return ``det(s I - A) / det(-A)``, s in `RATE`."""
    design = scene.design.model_copy(update={"capacitance": C})
    circuit = synthesise(scene.model_copy(update={"design": design}))
    (part,) = state_equations(parse_deck(write_deck(circuit, OperatingPoint()).text))
    polynomial = (part.A * (1 / arb(RATE))).charpoly()
    return polynomial * (1 / polynomial[0])


def _real_roots(polynomial: arb_poly) -> list[acb]:
    """Return the positive roots; an isolated root whose ball meets the real axis is real."""
    roots = acb_poly(polynomial).roots()
    return [root for root in roots if root.imag.contains(0) and bool(root.real > 0)]


def _refined(polynomial: arb_poly, root: arb) -> arb:
    """Return the root near `root` by Newton's method."""
    slope = polynomial.derivative()
    for _ in range(8):
        root = (root - polynomial(root) / slope(root)).mid()
    return root


def _parts(polynomial: arb_poly) -> tuple[arb_poly, arb_poly]:
    """Return real part and imaginary part over omega at ``s = j omega``, in omega squared."""
    signs = (1, -1)
    even = [signs[k % 2] * c for k, c in enumerate(polynomial.coeffs()[0::2])]
    odd = [signs[k % 2] * c for k, c in enumerate(polynomial.coeffs()[1::2])]
    return arb_poly(even), arb_poly(odd)
