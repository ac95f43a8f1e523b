"""Stability of a board linearised at its equilibrium: poles, damping and frequency."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.system.array_types import Complexes, Floats
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.rightmost_poles import rightmost_poles

LOST = "some poles are so far away that rounding hides them, and on which side of the axis they are"


@dataclass(frozen=True, eq=False)
class Poles:
    """Natural frequencies of a board."""

    poles: Complexes  # 1/s, rightmost first; all of a small board, the rightmost of a large one
    errors: Floats  # rounding error of each pole, 1/s
    complete: bool  # whether `poles` are all poles
    doubt: str = ""  # why poles left of the axis do not make the board stable; empty if they do

    @cached_property
    def rightmost(self) -> complex:
        """The pole with the largest real part (of a pair, the one with positive frequency)."""
        first = self.poles[:1].tolist() or [complex(-math.inf)]
        return complex(first[0].real, abs(first[0].imag))

    @cached_property
    def _ringing(self) -> complex:
        """The rightmost oscillating pole, 1/s; -1 if no pole oscillates."""
        return next((pole for pole in self.poles.tolist() if pole.imag > 0.0), complex(-1.0))

    @property
    def damping_ratio(self) -> float:
        """``-Re p / |p|`` of the rightmost oscillating pole; 1 if no pole oscillates."""
        return -self._ringing.real / abs(self._ringing)

    @property
    def frequency(self) -> float:
        """``|Im p| / 2 pi`` of the rightmost oscillating pole, Hz; 0 if no pole oscillates."""
        return self._ringing.imag / (2.0 * math.pi)

    @property
    def resolution(self) -> float:
        """Rounding error of the rightmost pole, 1/s."""
        return float(self.errors[0]) if len(self.errors) else 0.0

    @cached_property
    def stable(self) -> bool | None:
        """Whether every pole is left of the imaginary axis; None where rounding hides it."""
        real = self.poles.real
        if np.any(real > self.errors):
            return False
        return True if np.all(real < -self.errors) and not self.doubt else None

    @property
    def known_stable(self) -> bool:
        """Whether the board is stable, beyond the rounding of the poles."""
        return self.stable is True

    @property
    def known_unstable(self) -> bool:
        """Whether the board is unstable, beyond the rounding of the poles."""
        return self.stable is False

    @property
    def unstable_count(self) -> int:
        """Number of poles on or right of the imaginary axis."""
        return int(np.sum(self.poles.real >= 0.0))


def poles(circuit: Circuit | LinearBoard) -> Poles:
    """Find the poles of a board at its equilibrium with the strain applied.

    Of a large board Arnoldi's method finds only the rightmost ones.

    EngineError: no state-space form, or no equilibrium.
    """
    board = LinearBoard.of(circuit)
    if board.descriptor.is_large:
        found = rightmost_poles(board)
        return Poles(found.poles, found.errors, complete=False)
    space = board.state_space
    doubt = LOST if space.lost else ""
    return Poles(space.modes.poles, space.modes.pole_errors, complete=True, doubt=doubt)
