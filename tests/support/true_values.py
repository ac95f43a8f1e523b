"""The true readings of a scene, from its deck's text and its problem, as the catalogue stores them.

Linear boards: modes in Arb (`exact_readings`). Boards with behavioural sources:
equilibrium and poles in Arb, times and peaks from two runs by collocation, one with long steps
and one with shorter steps of a lower order, whose difference is the error.

`crossings` has every stability crossing of a board with one channel, over all C: the determinant of
``s Q + G`` over ``det G`` is linear in C, ``D(s) = P(s) + C Q(s)``. A pole is on the axis where
``C = -P/Q`` at ``s = j omega`` is real, so the frequencies are the real roots of one polynomial: no
crossing can be missed.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from flint import acb, acb_poly, arb, arb_mat, arb_poly, ctx

from taction.netlist_gen.analysis import OperatingPoint
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.deck.deck import write_deck
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.scene import DEFAULT_RESISTANCE, Scene
from taction.system.errors import InputError, NoVerdictError
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.evidence.stress.catalogue import Case, TrueValues
from taction.verification.reference.lambda_rule import resolve_lambda
from taction.verification.reference.problem import Problem
from taction.verification.reference.solve import solve
from taction.verification.verdict.board_files import deck_of
from taction.verification.verdict.simulation import has_large_signal
from tests.support.deck_equations import DeckText, StateEquations, parse_deck, state_equations
from tests.support.exact_readings import Signal, UnreadableError, exact_modes
from tests.support.nonlinear_response import Board, DivergenceError, integrate
from tests.support.oracle import AMPLIFIERS, exact_solution
from tests.support.readings import AnySignal, Samples, read

BITS = 320
EXACT = 1e-13  # error of a reading in Arb, whose modes are right to 30 digits
RUNS = ((10, 1e-11), (8, 1e-10))  # order and tolerance of the two runs
LINEAR = "modes of the deck in Arb, 320 bits; suprema and crossings by interval bounds"
NONLINEAR = "equilibrium and poles in Arb; transient by two runs of collocation, which differ by"
LAST = 1e-5  # of A: what is left of the slowest mode at the end of an integration
RATE = 1e6  # 1/s: unit of s, so that the coefficients are of one size
MARGIN_BITS = 600


def board_of(scene: Scene) -> Circuit:
    """Return the board that taction simulates: at the level of its op-amps' model."""
    circuit = synthesise(scene, make_problem(scene))
    if not has_large_signal(LinearBoard(circuit)):
        return circuit
    try:
        return deck_of(scene).circuit
    except NoVerdictError:
        return circuit


def true_values(scene: Scene) -> TrueValues:
    """Return the true readings of the board that `scene` describes."""
    asked = scene.checks.stability.margin > 1.0
    scene = resolve_lambda(scene)
    problem, circuit = make_problem(scene), board_of(scene)
    with _precision(BITS):
        deck = parse_deck(write_deck(circuit, OperatingPoint()).text)
        parts = state_equations(deck)
        if circuit.is_linear:
            found = _linear(scene, problem, parts)
        else:
            found = _nonlinear(scene, problem, deck, parts)
    return replace(
        found,
        margin=true_margin(scene) if asked and len(found.channels) == 1 else None,
        by=LINEAR if circuit.is_linear else f"{NONLINEAR} {found.error:.1g}",
    )


def deck_digest(case: Case) -> str | None:
    """Return a digest of the deck's parts, for which the true values hold; None: no deck.

    The last digits of the values are left out: they differ between processors.
    """
    try:
        text = write_deck(board_of(resolve_lambda(case.scene())), OperatingPoint()).text
    except InputError:
        return None
    deck = parse_deck(text)
    lines = [f"{part.kind} {part.nodes} {_rounded(part.value)}" for part in deck.parts]
    return hashlib.sha256("\n".join([*lines, str(deck.outputs)]).encode()).hexdigest()[:16]


def _rounded(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.11g}"


@contextmanager
def _precision(bits: int) -> Iterator[None]:
    before = ctx.prec
    ctx.prec = bits
    try:
        yield
    finally:
        ctx.prec = before


def true_lambda(scene: Scene) -> arb:
    """Return lambda: given, or ``1/(R s G0^2)``, with amplifiers ``2 Ve / (R s G0^2 U0)``.

    Boards that solve without regularisation have none.
    """
    design = scene.design
    if design.topology in ("inv", "pinv"):
        return arb(0)
    if isinstance(design.lam, float):
        return arb(design.lam)
    R = DEFAULT_RESISTANCE if design.resistance is None else design.resistance
    lam = 1 / (arb(R) * arb(design.gain) * arb(design.unit_conductance) ** 2)
    if design.amplifier == "linear":
        return lam
    return lam * 2 * arb(design.exponential_slope or 1.0) / arb(design.unit_voltage)


def _linear_solution(scene: Scene, problem: InverseProblem) -> list[arb]:
    """Return u of ``(T'T + lambda) u = T' eps``, dimensionless."""
    T, eps = arb_mat(problem.matrix.tolist()), arb_mat([[e] for e in problem.strain.tolist()])
    left = T.transpose() * T
    for n in range(left.nrows()):
        left[n, n] += true_lambda(scene)
    u = left.solve(T.transpose() * eps)
    return [u[n, 0] for n in range(left.nrows())]


def _linear(scene: Scene, problem: InverseProblem, parts: list[StateEquations]) -> TrueValues:
    targets = [arb(scene.design.unit_voltage) * u for u in _linear_solution(scene, problem)]
    amplitude = max(map(abs, targets), key=float)
    modes = exact_modes(parts, len(targets))
    signals = [Signal(modes, n, target, amplitude) for n, target in enumerate(targets)]
    moves = bool(amplitude > 0) and all(bool(p.real < 0) for p in modes.poles)
    steps = [(arb(0), target) for target in targets]
    values = partial(_values, amplitude, steps, modes.final, _rightmost(modes.poles))
    try:
        return values(_channels(scene, steps, amplitude, signals if moves else []))
    except UnreadableError:
        return values((), readable=False)


def _nonlinear(
    scene: Scene, problem: InverseProblem, deck: DeckText, parts: list[StateEquations]
) -> TrueValues:
    unit, count = arb(scene.design.unit_voltage), len(deck.outputs)
    rests = scene.analysis.initial == "rest"
    if scene.design.amplifier == "linear":  # op-amps with limits, whose inputs rest near 0
        v = v0 = [0.0] * len(deck.of("B"))
        steps = [(arb(0), unit * u) for u in _linear_solution(scene, problem)]
    else:
        v, targets = _amplified_solution(scene, problem.matrix, problem.strain)
        v0, start = [0.0] * count, [AMPLIFIERS[scene.design.amplifier][0](0)] * count
        if rests:
            v0, start = _amplified_solution(scene, problem.matrix, 0.0 * problem.strain)
        pairs = zip(start, targets, strict=True)
        steps = [(unit * arb(str(a)), unit * arb(str(b))) for a, b in pairs]
    v, v0 = (list(each) + [0.0] * (len(deck.of("B")) - len(each)) for each in (v, v0))
    amplitude = max((abs(b - a) for a, b in steps), key=float)
    final, poles = [arb(0)] * count, list[acb]()
    begun = []
    for board in map(Board, parts):
        places = [deck.of("B").index(source) for source in board.equations.sources]
        try:
            rest, outputs, slopes = board.equilibrium(1, [v[k] for k in places])
        except AssertionError:
            rest, outputs, slopes = board.equilibrium_by_steps()
        first = arb_mat(rest.nrows(), 1)
        if rests:
            first = board.equilibrium(0, [v0[k] for k in places])[0]
        begun.append((board, first, rest))
        poles += board.poles(slopes)
        for row, k in enumerate(board.equations.outputs):
            final[k] = outputs[row, 0]
    lead = _rightmost(poles)
    values = partial(_values, amplitude, steps, final, lead)
    if lead.real >= 0.0:
        return values(())

    def run_of(settings: tuple[int, float]) -> list[dict[str, float]]:
        signals: list[Samples | None] = [None] * count
        for board, first, rest in begun:
            run = integrate(board, first, rest, np.log(LAST) / lead.real, *settings)
            own = board.equations.outputs
            ends = [(float(steps[k][1]), float(final[k] - steps[k][1])) for k in own]
            for k, samples in zip(own, run.samples(ends), strict=True):
                signals[k] = samples
        return _channels(scene, steps, amplitude, signals)

    try:
        channels, others = map(run_of, RUNS)
    except DivergenceError:
        return values((), arrives=False)
    return values(channels, error=_apart(channels, others))


def _amplified_solution(
    scene: Scene, T: np.ndarray, eps: np.ndarray
) -> tuple[list[Any], list[Any]]:
    """Return the reference solution's v and u, dimensionless; u as mpmath's numbers."""
    design = scene.design
    lam, share = float(true_lambda(scene)), design.ridge_share
    problem = Problem(T, eps, lam, design.amplifier, design.biased, ridge_share=share)
    guess = solve(problem).v
    assert guess is not None
    found = exact_solution(problem, guess)
    assert found is not None
    return [float(v) for v in found[1]], found[0]


def _rightmost(poles: list[acb] | tuple[acb, ...]) -> complex:
    return max(map(complex, poles), key=lambda p: (p.real, p.imag))


def _apart(a: list[dict[str, float]], b: list[dict[str, float]]) -> float:
    """Return the largest difference of two sets of readings: relative, or of A."""
    worst = EXACT
    for one, other in zip(a, b, strict=True):
        assert one.keys() == other.keys(), "the integrators disagree on what there is"
        for name, x in one.items():
            size = max(x, 1e-300) if "time" in name else 1.0
            worst = max(worst, abs(x - other[name]) / size)
    return worst


def _values(
    amplitude: arb,
    steps: list[tuple[arb, arb]],
    final: Sequence[arb],
    rightmost: complex,
    channels: Sequence[dict[str, float]],
    error: float = EXACT,
    **states: bool,
) -> TrueValues:
    """Return the values of channels that end at `final`; without readings for no `channels`."""
    ends = [float(end) for end in final]
    off = max(abs(end - float(target)) for end, (_, target) in zip(ends, steps, strict=True))
    step = float(amplitude)
    return TrueValues(
        amplitude=step,
        rightmost=(rightmost.real, rightmost.imag),
        steady_state=off / step if step else 0.0,
        channels=tuple(
            {**readings, "final": end}
            for readings, end in zip(channels or [{}] * len(ends), ends, strict=True)
        ),
        error=error,
        by="",
        **states,
    )


def _channels(
    scene: Scene, steps: list[tuple[arb, arb]], amplitude: arb, signals: Sequence[AnySignal | None]
) -> list[dict[str, float]]:
    """Read every channel, which steps from its start to its target; none without `signals`."""
    band = amplitude * arb(scene.checks.settling_time.band)
    return [
        read(signal, target - start, amplitude, band)
        for (start, target), signal in zip(steps, signals, strict=bool(signals))
        if signal is not None
    ]


def crossings(scene: Scene) -> list[float]:
    """Return every C at which a pole of the one-channel board crosses the axis, F, increasing."""
    before, ctx.prec = ctx.prec, MARGIN_BITS
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
