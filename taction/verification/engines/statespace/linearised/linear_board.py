"""A board and its linearisation; each part is computed once, on first use."""

from __future__ import annotations

import functools
from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.system.array_types import Floats
from taction.system.errors import EngineError
from taction.verification.engines.statespace.equations.descriptor import DenseMatrix, Descriptor
from taction.verification.engines.statespace.equations.stamps import stamp
from taction.verification.engines.statespace.equations.structured_solve import (
    Response,
    Structure,
    coarsen,
    dense_response,
    structured_response,
)
from taction.verification.engines.statespace.linearised.equilibrium import (
    Equilibrium,
    balance,
    newton_step,
    rounding,
    solve_equilibrium,
)
from taction.verification.engines.statespace.linearised.state_space import StateSpace, linearise


@dataclass(frozen=True, eq=False)
class LinearBoard:
    """One board, linearised at its equilibrium with the strain applied.

    Every property may raise `EngineError`: no equilibrium, or no state-space form. `equations`
    replace those of the circuit, and `point` replaces the equilibrium as point of linearisation.
    """

    circuit: Circuit
    equations: Descriptor | None = None
    point: Equilibrium | None = None

    @classmethod
    def of(cls, circuit: Circuit | LinearBoard) -> LinearBoard:
        """Return a `LinearBoard` unchanged, and make one of a circuit."""
        return circuit if isinstance(circuit, LinearBoard) else cls(circuit)

    def reported(self, nodes: Iterable[str] | None) -> tuple[str, ...]:
        """Return the nodes that a transient reports: `nodes`, by default the outputs' nodes."""
        return tuple(o.node for o in self.circuit.outputs) if nodes is None else tuple(nodes)

    @functools.cached_property
    def descriptor(self) -> Descriptor:
        """The descriptor equations."""
        return stamp(self.circuit) if self.equations is None else self.equations

    @functools.cached_property
    def equilibrium(self) -> Equilibrium:
        """The equilibrium with the strain applied."""
        return self.point or self._equilibrium(sources_on=True)

    def at_start(self, initial: Initial) -> LinearBoard:
        """Return the linear board that has the slopes of the amplifiers at the start.

        EngineError: it has no equilibrium.
        """
        z = initial_unknowns(self, initial)
        try:
            rest = z + newton_step(self.descriptor, z, sources_on=True)
        except np.linalg.LinAlgError as error:
            text = "the board with the slopes of its start has no equilibrium"
            raise EngineError(text) from error
        point = Equilibrium(self.descriptor, rest, balance(self.descriptor, z)[0], 0.0)
        return LinearBoard(self.circuit, self.equations, point)

    @functools.cached_property
    def rounding(self) -> Floats:
        """Bound on the rounding error of the equilibrium with the strain applied, V, (size,)."""
        return rounding(self.equilibrium, lambda: self._response)

    @functools.cached_property
    def rest(self) -> Equilibrium:
        """The equilibrium without strain; voltage sources stay on."""
        return self._equilibrium(sources_on=False)

    def _equilibrium(self, *, sources_on: bool) -> Equilibrium:
        start = None
        if self.descriptor.devices.limits.any():
            free = LinearBoard(self.circuit, self.descriptor.without_limits)
            start = free._equilibrium(sources_on=sources_on).values
        return solve_equilibrium(
            self.descriptor, lambda: self._response, start, sources_on=sources_on
        )

    @functools.cached_property
    def _response(self) -> Response:
        if self.descriptor.is_large:
            return structured_response(self._bare)
        return dense_response(self.descriptor)

    @functools.cached_property
    def _bare(self) -> Structure:
        """The structure without the amplifiers' slopes."""
        return Structure(self.descriptor)

    @property
    def operating_point(self) -> Equilibrium | None:
        """The equilibrium if the linearisation depends on it, else None."""
        return self.equilibrium if self.descriptor.devices.count else None

    @functools.cached_property
    def state_space(self) -> StateSpace:
        """``x' = A x + B [on, 1]``, with its modes; dense."""
        return linearise(self.descriptor, self.operating_point)

    @functools.cached_property
    def open_loop(self) -> StateSpace:
        """The state space with the amplifiers' outputs as further inputs."""
        known = self.descriptor
        outputs = np.eye(known.size)[:, known.devices.output]
        return linearise(known, None, np.column_stack([known.switched, known.constant, outputs]))

    @functools.cached_property
    def matrices(self) -> DenseMatrix:
        """M and K, with the slopes of the amplifiers at the point of linearisation; dense."""
        point = self.operating_point
        slopes = np.zeros(0) if point is None else point.slopes
        return DenseMatrix(*self.descriptor.summed(np.asarray, slopes))

    @functools.cached_property
    def structure(self) -> Structure:
        """The equations of a large board, for solves without a dense matrix of all unknowns."""
        point = self.operating_point
        return self._bare if point is None else Structure(self.descriptor, point.slopes)

    @functools.cached_property
    def integrations(self) -> dict[Hashable, Any]:
        """Transients by steps, which one verification uses several times; see `stepped`."""
        return {}

    @functools.cached_property
    def coarse(self) -> LinearBoard:
        """A coarse board in place of a large one; see `structured_solve`."""
        return LinearBoard(self.circuit, coarsen(self.descriptor))


Initial = Literal["zero", "rest"]


def initial_unknowns(
    board: LinearBoard, initial: Initial, voltages: Mapping[str, float] | None = None
) -> Floats:
    """Return every unknown just before the strain step, V, shape (size,).

    ``"rest"`` is the equilibrium with the current sources off. With ``"zero"`` all capacitors and
    op-amps are discharged, except those that `voltages` (V, by node or op-amp state) charge.

    EngineError: the circuit has no name of `voltages`, or no equilibrium.
    """
    if initial == "rest":
        return board.rest.values
    z = np.zeros(board.descriptor.size)
    for name, volts in (voltages or {}).items():
        z[board.descriptor.place(name)] = volts
    return z
