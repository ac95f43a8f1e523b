"""The worst-case direction of every channel at rest, from first-order sensitivities.

The error of channel n is ``e_n + sum_p S_pn z_p`` to first order, with the deviations z in
tolerances. It is largest where every component is at the end of its tolerance that the sign of S_pn
says: ``e_n + sum_p |S_pn|``. That corner is solved, too, and both numbers stand side by side.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from taction.netlist_gen.board.variation import vary
from taction.system.array_types import Floats
from taction.system.documents import HIDDEN
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.studies.tolerance.rest_slopes import largest_parts, rest_slopes
from taction.verification.studies.tolerance.varied_board import VariedBoard

NAMED = 5  # components listed with each direction


@dataclass(frozen=True, slots=True, eq=False)
class Direction:
    """One channel, one sign of its error, and the corner that makes it largest.

    Attributes
    ----------
    channel : int
        From 1.
    sign : int
        1 where the output is above the reference, else -1.
    predicted : float
        Error of the channel at the corner, to first order, in step amplitudes.
    solved : float
        The same from the equilibrium of the board at this corner.
    largest : tuple of str
        The components with the largest slopes, with the signs of their deviations.
    deviations : dict of str to float
        Of the corner, in tolerances, by component.
    slopes : ndarray (components,)
        Change of the error, times `sign`, for a deviation of one tolerance, in step amplitudes.
    """

    channel: int
    sign: int
    predicted: float
    solved: float
    largest: tuple[str, ...]
    deviations: dict[str, float]
    slopes: Annotated[Floats, HIDDEN]

    @property
    def corner(self) -> Floats:
        """The deviations of the corner, in tolerances, (components,)."""
        return np.sign(self.slopes)


def steady_directions(board: VariedBoard) -> tuple[Direction, ...]:
    """Return the directions of all channels and both signs, the largest error first.

    Raises
    ------
    EngineError
        The nominal board, or one at a corner, has no equilibrium.

    Notes
    -----
    Costs what `rest_slopes` costs, and one equilibrium for each direction.
    """
    amplitude = board.step_amplitude
    slopes, centre = rest_slopes(board) / amplitude, _errors(board, np.zeros(len(board.varied)))
    names, found = [parameter.name for parameter in board.varied], []
    for n in range(len(centre)):
        for sign in (1, -1):
            towards = sign * slopes[:, n]
            corner = np.sign(towards)
            found.append(
                Direction(
                    channel=n + 1,
                    sign=sign,
                    predicted=float(centre[n] + sign * np.abs(towards).sum()),
                    solved=float(_errors(board, corner)[n]),
                    largest=largest_parts(towards, board.varied, corner, NAMED),
                    deviations={
                        name: z for name, z in zip(names, corner.tolist(), strict=True) if z
                    },
                    slopes=towards,
                )
            )
    return tuple(sorted(found, key=lambda direction: -direction.sign * direction.solved))


def _errors(board: VariedBoard, z: Floats) -> Floats:
    """Return the error of every channel at rest with deviations `z`, in step amplitudes."""
    rest = LinearBoard(vary(board.nominal, board.scene.tolerances, z)).equilibrium
    outputs = [output.sign * rest[output.node] for output in board.nominal.outputs]
    return (np.array(outputs) - board.ideal.target) / board.step_amplitude
