"""Noise of the outputs at rest, over a band of frequencies, by the Lyapunov equation.

``x' = A x + B w`` with white noise w of covariance W has the covariance P of its states with
``A P + P A^T = -B W B^T``, and an output ``c x`` the variance ``c P c^T``.

What the numerical P leaves, ``R = A P + P A^T + B W B^T``, changes the variance by ``sum R Y``,
with the adjoint solution Y of ``A^T Y + Y A = -c^T c``. R includes the rounding of A, P and W,
element by element. One Y of all outputs, ``C^T C`` in the place of ``c^T c``, bounds the elements
of each: ``|Y_ij|² <= Y_ii Y_jj``. ``sum B W B^T Y`` is the sum of all variances, too: the
difference of the two is added to the bound.

Above a lowest frequency w (rad/s) the modes of A weight P. The spectrum of an output is
``2 Re c (jf - A)^-1 P c^T``, and its integrals have the logarithm ``L = log(1 + j A / w)``. The
variance is ``Re c H P c^T``, for white noise with ``H = (2/pi) j L``, and for noise of the density
``W / f`` with ``H = -4 A^-1 L``; without a lowest frequency that one has no end. H is computed
twice, by the modes of A and of its transpose: their difference is added to the bound.

The sources: a resistor has the thermal current ``4 k T / R`` (A²/Hz). An op-amp has a voltage
noise behind its input impedances, which have none of their own, with a 1/f part below a corner, and
a current noise into each input that is not on ground. A transistor has the shot noise ``2 q I`` of
collector and base current, and the thermal noise of its bulk resistance.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from taction.netlist_gen.board.circuit import GROUND, Circuit, joined_resistors
from taction.spice_models.opamp import THERMAL
from taction.spice_models.transistor import ELECTRON, NOMINAL
from taction.system.array_types import EPS, Complexes, Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.descriptor import Descriptor
from taction.verification.engines.statespace.equations.stamps import gain_stage, transistor_currents
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.modes import Modes
from taction.verification.engines.statespace.linearised.reduction import ROUNDED, STEPS
from taction.verification.engines.statespace.linearised.state_space import linearise


def noise_intensities(
    circuit: Circuit, descriptor: Descriptor, point: Floats
) -> tuple[Floats, Floats]:
    """Return the covariance of the noise in each pair of rows, over positive and negative f.

    Half of the density over positive frequencies, (size, size), in A²/Hz for current balances,
    V²/s²/Hz for states of op-amps, V²/Hz for rows that state a voltage; and the 1/f noise of each
    row times the frequency, (size,). `point` (size,) is the equilibrium, which sets the currents of
    transistors.
    """
    size, places = descriptor.size, {GROUND: descriptor.size} | descriptor.places
    density = np.zeros((size + 1, size + 1))  # the last row is ground

    def add(one: str, other: str, current: float) -> None:
        """Add the noise of a current between two nodes, A²/Hz."""
        p, q = places[one], places[other]
        for row, column, sign in ((p, p, 1.0), (q, q, 1.0), (p, q, -1.0), (q, p, -1.0)):
            density[row, column] += sign * current

    for one, other, ohms in joined_resistors(circuit):
        add(one, other, THERMAL / ohms)
    for cell in circuit.opamps:
        for pin in (cell.noninverting, cell.inverting):
            add(pin, GROUND, circuit.models[cell.model].current_noise ** 2)
    for source in circuit.noises:
        add(source.node, GROUND, source.density**2)
    if circuit.transistors:  # shot noise, and that of the bulk resistance
        currents = np.abs(transistor_currents(circuit, descriptor, point))
        for q, (collector, base) in zip(circuit.transistors, currents.T.tolist(), strict=True):
            inner, model = f"q{q.name}.e", circuit.transistor_models[q.model]
            add(q.collector, inner, 2.0 * ELECTRON * collector)
            add(q.base, inner, 2.0 * ELECTRON * base)
            add(q.emitter, inner, THERMAL / model.emitter_resistance)
    moved = np.zeros_like(density)  # currents go to the rows that take them
    moved[descriptor.balance_rows, np.arange(size + 1)] = 1.0
    density, flicker = moved @ density @ moved.T, np.zeros(size)
    for cell in circuit.opamps:
        opamp = circuit.models[cell.model]
        row, gain = gain_stage(opamp, cell, descriptor)
        density[row, row] += (gain * opamp.voltage_noise) ** 2
        flicker[row] += gain**2 * opamp.flicker_noise
    return 0.5 * density[:size, :size], 0.5 * flicker


HIDDEN = "rounding hides the noise: the poles of the board are too far apart"
DIRECT = 1e-9  # of the variance: direct noise in the band of the board that counts as rounding
MOST = 1200  # unknowns: some seconds, in which the dense matrices are decomposed


def output_noise(board: LinearBoard, lowest: float = 0.0) -> tuple[Floats, Floats]:
    """Return the noise of every output of a stable board, rms, V, and bounds on the errors, (N,).

    `lowest`: the lowest frequency that counts, Hz.
    EngineError: a large or unstable board, noise of unlimited bandwidth at an output, 1/f noise
      without a lowest frequency, or rounding as large as the noise; also as `linearise`.
    """
    descriptor, outputs = board.descriptor, board.circuit.outputs
    if descriptor.size > MOST:
        text = f"the board has {descriptor.size} unknowns; the noise of up to {MOST} is computed"
        raise EngineError(text)
    if board.circuit.transistors and board.circuit.temperature != NOMINAL:
        raise EngineError(f"the noise of transistors is computed at {NOMINAL:g} degrees C only")
    if board.circuit.has_imported:
        raise EngineError("the noise of an imported op-amp is not known to the state-space engine")
    density, flicker = noise_intensities(board.circuit, descriptor, board.equilibrium.values)
    if flicker.any() and not lowest > 0.0:
        raise EngineError("1/f noise has no end at 0 Hz: a lowest frequency is needed")
    live = np.flatnonzero(density.diagonal())
    inputs = np.zeros((descriptor.size, STEPS + len(live)))
    inputs[live, STEPS + np.arange(len(live))] = 1.0
    space = linearise(descriptor, board.operating_point, inputs)
    modes = board.state_space.modes
    poles = modes.poles
    if not len(poles):
        raise EngineError("a board without poles does not limit the bandwidth of its noise")
    lead = float(poles.real.max(initial=-1.0))
    if lead > len(poles) * EPS * float(np.abs(poles).max(initial=0.0)):
        raise EngineError("the board is not stable")
    if not lead < 0.0:  # the eigensolver cannot tell the sign
        raise EngineError(HIDDEN)
    W = density[np.ix_(live, live)]
    C, D = space.rows([out.node for out in outputs])
    B, D = space.B[:, STEPS:], D[:, STEPS:]
    w, fastest = math.tau * lowest, float(np.abs(poles).max(initial=0.0))
    # Sizes of the terms of A, and of the charges that a unit of ``x'`` moves.
    L, seen = np.abs(space.left), np.abs(space.seen)
    sizes = np.stack([L @ size @ seen for size in (space.pencil.pull, space.pencil.mass)])
    equation = Covariance(space.A, modes, sizes)
    variance, error = equation.variance(B @ W @ B.T, C, _white(w) if w else None)
    direct = np.einsum("ki,ij,kj->k", D, W, D) * fastest
    if flicker.any():
        V = flicker[live]
        more, doubt = equation.variance((B * V) @ B.T, C, _flicker(w))
        variance, error = variance + more, error + doubt
        direct += 2.0 * math.log1p(fastest / w) * (D**2 @ V)
    if (endless := np.flatnonzero(direct > DIRECT * np.abs(variance))).size:
        raise EngineError(
            f"the noise of output {outputs[endless[0]].node} has no limit of its bandwidth: no"
            " capacitance is at that node of the model"
        )
    silent = ~(C.any(axis=1) | D.any(axis=1))  # behind amplifiers whose output cannot move
    errors = np.where(silent, 0.0, error + direct)
    if not (silent | (errors < variance)).all():
        raise EngineError(HIDDEN)
    rms = np.sqrt(variance)
    return rms, rms - np.sqrt(variance - errors)


Weight = Callable[[Complexes], Complexes]


def _white(w: float) -> Weight:
    """Return the share of each mode in white noise above w, rad/s."""
    return lambda poles: (2j / math.pi) * np.log1p(1j * poles / w)


def _flicker(w: float) -> Weight:
    """Return the share of each mode in noise of the density ``W / f`` above w, rad/s, in s."""
    return lambda poles: -4.0 / poles * np.log1p(1j * poles / w)


class Covariance:
    """Solver of ``A P + P A^T = -Q`` by the modes of A, in units (n,) that balance A.

    `sizes` (2, n, n) are those to which the rounding of A is relative. Groups of modes are taken
    apart again.
    """

    def __init__(self, A: Floats, modes: Modes, sizes: Floats) -> None:
        from scipy.linalg import matrix_balance

        balanced: Any = matrix_balance(A, permute=False, separate=True)
        self.A: Floats = balanced[0]
        self.scale: Floats = balanced[1][0]
        self.sizes, self.poles = sizes * self.scale / self.scale[:, None], modes.poles
        self.right: Complexes = modes.right / self.scale[:, None]
        self.left: Complexes = modes.left * self.scale
        if not modes.alone.all():
            poles, right = np.linalg.eig(self.A)
            self.poles, self.right = poles.astype(np.complex128), right.astype(np.complex128)
            self.left = np.asarray(np.linalg.inv(self.right), np.complex128)

    def solve(self, Q: Floats, *, adjoint: bool = False) -> Floats:
        """Return P; with `adjoint` that of ``A^T P + P A = -Q``."""
        V, W = (self.left.T, self.right.T) if adjoint else (self.right, self.left)
        X = (W @ Q @ W.conj().T) / -(self.poles[:, None] + self.poles.conj())
        P = (V @ X @ V.conj().T).real
        return 0.5 * (P + P.T)

    def variance(self, Q: Floats, C: Floats, weight: Weight | None = None) -> tuple[Floats, float]:
        """Return ``C P C^T`` by rows of C, and a bound on each error.

        With a `weight`, P is weighted with this function of A.
        """
        Q, C = Q / np.outer(self.scale, self.scale), C * self.scale
        doubt, P, Y = 0.0, self.solve(Q), self.solve(C.T @ C, adjoint=True)
        remainder = self.remainder(P, Q)
        if weight is not None:
            first, second = _weights(self.A, weight), _weights(self.A.T.copy(), weight).T
            off = np.einsum("ki,ij,kj->k", C, (first - second) @ P, C)
            doubt = float(np.abs(off).max(initial=0.0))
            P, Y = first @ P, Y @ first
        variance = np.einsum("ki,ij,kj->k", C, P, C)
        reach = np.sqrt(np.maximum(Y.diagonal(), 0.0))
        doubt += abs(float(variance.sum() - np.sum(Q * Y)))
        return variance, float(reach @ remainder @ reach + doubt)

    def remainder(self, P: Floats, Q: Floats) -> Floats:
        """Bound the elements of ``A P + P A^T + Q``, with the rounding of A, P and Q."""
        A, product, size = self.A, self.A @ P, np.abs(self.A) @ np.abs(P)
        rounding = len(A) * EPS * (size + size.T + np.abs(Q))
        stamped = ROUNDED * (self.sizes[0] @ np.abs(P) + self.sizes[1] @ np.abs(product))
        return np.asarray(np.abs(product + product.T + Q) + rounding + stamped + stamped.T)


def _weights(A: Floats, weight: Weight) -> Floats:
    """Return the real part of a function of A, by its modes."""
    poles, right = np.linalg.eig(A)
    weighted = np.linalg.solve(right.T, (right * weight(poles)).T).T
    return np.asarray(weighted.real)
