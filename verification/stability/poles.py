"""Stability of a board linearised at its equilibrium: poles, damping and frequency."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.system.array_types import Complexes, Floats
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.count_unstable import count_right
from taction.verification.engines.statespace.linearised.rightmost_poles import rightmost_poles
from taction.verification.engines.statespace.linearised.time_scales import TimeScales

SEARCHED = 1e-9  # times the fastest pole: error of the rightmost poles that a search finds


@dataclass(frozen=True, eq=False)
class Poles:
    """Natural frequencies of a board.

    Attributes
    ----------
    poles : ndarray
        1/s, rightmost first; all of them for a small board, the rightmost for a large one.
    rightmost : complex
        The pole with the largest real part (of a pair, the one with positive frequency).
    stable : bool
        Whether every pole is left of the imaginary axis.
    damping_ratio : float
        ``-Re p / |p|`` of the rightmost oscillating pole; 1 if no pole oscillates.
    frequency : float
        ``|Im p| / 2 pi`` of the rightmost oscillating pole, Hz; 0 if no pole oscillates.
    complete : bool
        Whether `poles` are all poles.
    errors : ndarray
        Rounding error of each pole, 1/s.
    """

    poles: Complexes
    rightmost: complex
    stable: bool
    damping_ratio: float
    frequency: float
    complete: bool
    errors: Floats

    @property
    def resolution(self) -> float:
        """Rounding error of the rightmost pole, 1/s."""
        return float(self.errors[0]) if len(self.errors) else 0.0

    @cached_property
    def certain(self) -> bool:
        """Whether rounding leaves no doubt that the board is stable, or that it is unstable."""
        real = self.poles.real
        return bool(np.any(real > self.errors) or np.all(real < -self.errors))

    @property
    def known_stable(self) -> bool:
        """Whether the board is stable, beyond the rounding of the poles."""
        return self.stable and self.certain

    @property
    def known_unstable(self) -> bool:
        """Whether the board is unstable, beyond the rounding of the poles."""
        return self.certain and not self.stable

    @property
    def unstable_count(self) -> int:
        """Number of poles on or right of the imaginary axis."""
        return int(np.sum(self.poles.real >= 0.0))


def poles(circuit: Circuit | LinearBoard) -> Poles:
    """Find the poles of a board at its equilibrium with the strain applied.

    Raises
    ------
    EngineError
        No state-space form, or no equilibrium.

    Notes
    -----
    The cost is that of the modes, about 30 n³ flops (n = 91: 5 ms; 2 ms for a board with mirror
    symmetry). For a large board Arnoldi's method computes only the rightmost poles (500 channels:
    2 s).
    """
    board = LinearBoard.of(circuit)
    if board.descriptor.is_large:
        found = rightmost_poles(board)
        return summarise(found.poles, complete=False, errors=found.errors)
    return _of_modes(board)


def coarse_poles(circuit: Circuit | LinearBoard) -> Poles:
    """Find the poles of a board to `SEARCHED`, or as `poles` where that leaves a side open.

    For a count beside a witness of its own, such as a winding number: bounds of (nearly) defective
    poles need the modes. The cost is a third.

    Raises
    ------
    EngineError
        As `poles`.
    """
    board = LinearBoard.of(circuit)
    if board.descriptor.is_large:
        return poles(board)
    values = [np.linalg.eigvals(block.A) for block in board.state_space.blocks]
    found = summarise(np.concatenate(values).astype(np.complex128), complete=True)
    return found if found.certain else poles(board)


def poles_behind(board: LinearBoard, scales: TimeScales) -> Poles:
    """Return the poles of the time scales, or the rightmost poles of a large board.

    Raises
    ------
    EngineError
        As `poles`.
    """
    if not scales.complete:
        return poles(board)
    return _of_modes(board)


def _of_modes(board: LinearBoard) -> Poles:
    modes = board.state_space.modes
    return summarise(modes.poles, complete=True, errors=modes.pole_errors)


def count_unstable(circuit: Circuit | LinearBoard) -> int:
    """Count the poles right of the imaginary axis by a winding number, without computing poles.

    A cross-check of `poles`: the two share only the equations of the board.

    Raises
    ------
    EngineError
        A pole lies on the axis to working precision, or the board has no equilibrium.

    Notes
    -----
    See `verification.engines.statespace.linearised.count_unstable.count_right` (N = 7: 0.15 s,
    N = 128: 2.5 s).
    """
    return count_right(LinearBoard.of(circuit).structure)


def summarise(values: Complexes, *, complete: bool, errors: Floats | None = None) -> Poles:
    """Sort poles and name the rightmost ones; a board without states is stable.

    `errors` are those of the values, by default `SEARCHED`.
    """
    if errors is None:
        errors = np.full(len(values), SEARCHED * float(np.abs(values).max(initial=0.0)))
    order = np.lexsort((-values.imag, -values.real))
    values, errors = values[order], errors[order]
    rightmost = complex(values[0].real, abs(values[0].imag)) if len(values) else complex(-math.inf)
    oscillating = values[values.imag > 0.0]
    lead = complex(oscillating[0]) if len(oscillating) else complex(-1.0, 0.0)
    return Poles(
        poles=values,
        rightmost=rightmost,
        stable=rightmost.real < 0.0,
        damping_ratio=-lead.real / abs(lead),
        frequency=lead.imag / (2.0 * math.pi),
        complete=complete,
        errors=errors,
    )
