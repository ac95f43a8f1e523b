"""The transient of a piecewise linear board by matrix exponentials over even steps.

It shares the state-space equations with the engine, and neither modes nor the search for switches:
each step is a matrix exponential, by a Taylor series and squaring in long doubles, and a step in
which an input passes a break is divided by halves. ``exp(A h) - 1`` is squared, which keeps the
digits of the slow modes of a stiff board.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.system.array_types import Floats
from taction.verification.engines.statespace.equations.amplifier_gains import gain_of
from taction.verification.engines.statespace.linearised.board import LinearBoard, initial_unknowns

HALVES = 45  # of a step in which an amplifier switches
TERMS = 20  # of the series
WIDE = np.longdouble
FINER = 4  # times as many steps, whose change is the doubt


class KinkedBoard:
    """A board as ``x' = A x + b + F a(v)``, with the outputs a of piecewise linear amplifiers."""

    def __init__(self, board: LinearBoard, nodes: tuple[str, ...]) -> None:
        space, devices = board.open_loop, board.descriptor.devices
        inputs = [board.descriptor.names[k] for k in devices.input.tolist()]
        self.A, self.b, self.F = space.A, space.B[:, :2].sum(axis=1), space.B[:, 2:]
        C, D = space.rows((*inputs, *nodes))
        self.C, self.d, self.E = C, D[:, :2].sum(axis=1), D[:, 2:]
        self.m, self.devices, self.gain = devices.count, devices, gain_of(devices.kinds)
        self._steps: dict[tuple[bytes, float], tuple[Any, list[Any]]] = {}
        assert not self.E[: self.m].any(), "an amplifier drives its own input at once"

    def inputs(self, x: Any) -> Any:
        """Return the amplifiers' inputs, V, (m,)."""
        return self.C[: self.m] @ x + self.d[: self.m]

    def outputs(self, x: Any) -> Any:
        """Return the amplifiers' outputs, V, (m,)."""
        return -self.devices.u_scale * self.gain.value(self.inputs(x) / self.devices.v_scale)

    def seen(self, x: Any) -> Any:
        """Return the voltages of the nodes, V."""
        rows = slice(self.m, None)
        return self.C[rows] @ x + self.d[rows] + self.E[rows] @ self.outputs(x)

    def slopes(self, x: Any) -> Floats:
        """Return the slopes of the amplifiers at x, V/V, (m,)."""
        y = self.inputs(x) / self.devices.v_scale
        return np.asarray(-self.devices.u_scale / self.devices.v_scale * self.gain.slope(y))

    def _linear(self, x: Any) -> tuple[Any, Any]:
        """Return A and b of ``x' = A x + b`` on the pieces of x, where g is ``slope y + shift``."""
        slopes, y = self.slopes(x).astype(WIDE), self.inputs(x)
        shift = self.outputs(x) - slopes * y
        F = self.F.astype(WIDE) * slopes
        A = self.A + F @ self.C[: self.m].astype(WIDE)
        return A, self.b + self.F @ shift + F @ self.d[: self.m].astype(WIDE)

    def rest(self, x: Any) -> Any:
        """Return where the board on the pieces of x comes to rest."""
        A, c = self._linear(x)
        scale = np.abs(A).max(axis=1)
        inverse = np.linalg.inv((A / scale[:, None]).astype(np.float64))
        rest = np.zeros(len(c), dtype=WIDE)
        for _ in range(4):
            rest = rest - inverse @ ((A @ rest + c) / scale)
        return rest

    def powers(self, x: Any, length: float) -> tuple[Any, list[Any]]:
        """Return the rest on the pieces of x, and ``exp(A length / 2^j) - 1`` for j from 0."""
        breaks = self.gain.breaks or ()
        pieces = np.searchsorted(breaks, (self.inputs(x) / self.devices.v_scale).astype(float))
        key = (self.slopes(x).tobytes() + pieces.tobytes(), length)
        if key not in self._steps:
            A, _ = self._linear(x)
            A = A * WIDE(length)
            halves = max(HALVES, int(np.ceil(np.log2(float(np.abs(A).sum(axis=1).max())))) + 3)
            small = A / WIDE(2.0) ** halves
            term = made = small
            for k in range(2, TERMS):
                term = term @ small / k
                made = made + term
            chain = [made]
            for _ in range(halves):
                chain.append(2.0 * chain[-1] + chain[-1] @ chain[-1])
            self._steps[key] = self.rest(x), chain[::-1]
        return self._steps[key]

    def over(self, x: Any, length: float) -> Any:
        """Return x after a time in which amplifiers may switch."""
        left, total = 1 << HALVES, 1 << HALVES  # in shares of the step
        while left:
            rest, grown = self.powers(x, length)
            here, begun = self.slopes(x), left
            for j in range(HALVES + 1):
                share = total >> j
                while share <= left:
                    after = x + grown[j] @ (x - rest)
                    if not np.array_equal(self.slopes(after), here):
                        if j == HALVES:  # the switch itself
                            x, left = after, left - share
                        break
                    x, left = after, left - share
                if not np.array_equal(self.slopes(x), here):
                    break
            assert left < begun
        return x


def _record(kinked: KinkedBoard, x: Any, spacing: float, count: int, parts: int) -> tuple[Any, Any]:
    values = [kinked.seen(x)]
    for _ in range(count - 1):
        for _ in range(parts):
            x = kinked.over(x, spacing / parts)
        values.append(kinked.seen(x))
    return np.array(values), kinked.seen(kinked.rest(x))


def kinked_transient(
    board: LinearBoard, transient: Transient, times: Floats, nodes: tuple[str, ...]
) -> tuple[Floats, Floats, Floats]:
    """Return the voltages of nodes at even `times` (P,), V, (P, K), their doubt, and those at rest.

    The doubt is the change with more steps: rounding, and switches to and fro within a step.
    """
    kinked = KinkedBoard(board, nodes)
    x = board.open_loop.state_of(initial_unknowns(board, transient.initial)).astype(WIDE)
    spacing = float(times[1] - times[0])
    coarse, _ = _record(kinked, x, spacing, len(times), 1)
    fine, rest = _record(kinked, x, spacing, len(times), FINER)
    return fine.astype(float), np.abs(fine - coarse).astype(float), rest.astype(float)
