"""Stability of a board linearised at its equilibrium: poles, damping and frequency."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
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

    # 1/s, rightmost first; all of them for a small board, the rightmost for a large one.
    poles: Complexes
    # The pole with the largest real part (of a pair, the one with positive frequency).
    rightmost: complex
    # ``-Re p / |p|`` of the rightmost oscillating pole; 1 if no pole oscillates.
    damping_ratio: float
    # ``|Im p| / 2 pi`` of the rightmost oscillating pole, Hz; 0 if no pole oscillates.
    frequency: float
    complete: bool  # whether `poles` are all poles
    errors: Floats  # rounding error of each pole, 1/s
    doubt: str = ""  # why poles left of the axis do not make the board stable; empty if they do

    @property
    def resolution(self) -> float:
        """Rounding error of the rightmost pole, 1/s."""
        return float(self.errors[0]) if len(self.errors) else 0.0

    @cached_property
    def certain(self) -> bool:
        """Whether there is no doubt that the board is stable, or that it is unstable."""
        return self.stable is not None

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
        return summarise(found.poles, complete=False, errors=found.errors)
    space = board.state_space
    small = summarise(space.modes.poles, complete=True, errors=space.modes.pole_errors)
    return replace(small, doubt=LOST) if space.lost else small


def summarise(values: Complexes, *, complete: bool, errors: Floats) -> Poles:
    """Sort poles with their errors, and name the rightmost ones; without states it is stable."""
    order = np.lexsort((-values.imag, -values.real))
    values, errors = values[order], errors[order]
    rightmost = complex(values[0].real, abs(values[0].imag)) if len(values) else complex(-math.inf)
    oscillating = values[values.imag > 0.0]
    lead = complex(oscillating[0]) if len(oscillating) else complex(-1.0, 0.0)
    return Poles(
        poles=values,
        rightmost=rightmost,
        damping_ratio=-lead.real / abs(lead),
        frequency=lead.imag / (2.0 * math.pi),
        complete=complete,
        errors=errors,
    )
