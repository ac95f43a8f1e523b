"""How far components move the outputs at rest, and the worst direction of every channel.

The error of channel n is ``e_n + sum_p S_pn z_p`` to first order, with the deviations z in
tolerances. It is largest where every component is at the end of its tolerance that the sign of S_pn
says: ``e_n + sum_p |S_pn|``. That corner is solved, too, and both numbers stand side by side.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.variation import Parameter
from taction.system.array_types import Floats
from taction.system.documents import HIDDEN
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.linearised.rest_sensitivity import RestSensitivity
from taction.verification.studies.tolerance.samples import Varied
from taction.verification.verdict.input_spread import tolerance_slopes


def rest_slopes(board: Varied) -> Floats:
    """Return the change of each output for a deviation of one tolerance, V, (components, N).

    EngineError: the nominal board has no equilibrium.

    Notes
    -----
    Costs one factorisation of all unknowns, and two sets of equations for each part without an
    analytic slope.
    """
    names = [parameter.name for parameter in board.varied]

    def at(name: str, deviation: float) -> Circuit:
        z = np.zeros(len(names))
        z[names.index(name)] = deviation
        return board.at(z)

    return tolerance_slopes(RestSensitivity.of(LinearBoard(board.nominal)), board.varied, at)


NAMED = 5  # components listed with each direction, and with each corner


def largest_parts(
    slopes: Floats, varied: Sequence[Parameter], deviations: Mapping[str, float]
) -> tuple[str, ...]:
    """Return the components with the largest `slopes` (components,), and where they deviate to."""
    order = np.argsort(-np.abs(slopes), kind="stable")[:NAMED].tolist()
    moved = [(varied[k].name, deviations.get(varied[k].name, 0.0)) for k in order]
    return tuple(f"{'+' if z > 0 else '-'}{name}" for name, z in moved if z)


@dataclass(frozen=True, slots=True, eq=False)
class Direction:
    """One channel, one sign of its error, and the corner that makes it largest."""

    channel: int  # from 1
    sign: int  # 1 where the output is above the reference, else -1
    predicted: float  # error of the channel at the corner, to first order, in step amplitudes
    solved: float  # the same from the equilibrium of the board at this corner
    # The components with the largest slopes, with the signs of their deviations.
    largest: tuple[str, ...]
    deviations: dict[str, float]  # of the corner, in tolerances, by component
    # Change of the error, times `sign`, for a deviation of one tolerance, in step amplitudes.
    slopes: Annotated[Floats, HIDDEN]

    @property
    def corner(self) -> Floats:
        """The deviations of the corner, in tolerances, (components,)."""
        return np.sign(self.slopes)


def steady_directions(board: Varied) -> tuple[Direction, ...]:
    """Return the directions of all channels and both signs, the largest error first.

    There are none where no output has to move: errors are fractions of the largest step.

    EngineError: the nominal board, or one at a corner, has no equilibrium.

    Notes
    -----
    Costs what `rest_slopes` costs, and one equilibrium for each direction.
    """
    amplitude = board.step_amplitude
    if math.isnan(amplitude):
        return ()
    slopes, centre = rest_slopes(board) / amplitude, _errors(board, np.zeros(len(board.varied)))
    found = []
    for n, sign in itertools.product(range(len(centre)), (1, -1)):
        towards = sign * slopes[:, n]
        corner = np.sign(towards)
        moved = {p.name: z for p, z in zip(board.varied, corner.tolist(), strict=True) if z}
        found.append(
            Direction(
                channel=n + 1,
                sign=sign,
                predicted=float(centre[n] + sign * np.abs(towards).sum()),
                solved=float(_errors(board, corner)[n]),
                largest=largest_parts(towards, board.varied, moved),
                deviations=moved,
                slopes=towards,
            )
        )
    return tuple(sorted(found, key=lambda direction: -direction.sign * direction.solved))


def _errors(board: Varied, z: Floats) -> Floats:
    """Return the error of every channel at rest with deviations `z`, in step amplitudes."""
    rest = LinearBoard(board.at(z)).equilibrium
    outputs = [output.sign * rest[output.node] for output in board.nominal.outputs]
    return (np.array(outputs) - board.target) / board.step_amplitude
