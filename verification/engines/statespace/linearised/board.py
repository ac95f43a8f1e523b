"""A board and its linearisation; each part is computed once, on first use."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from dataclasses import dataclass

from taction.netlist_gen.board.circuit import Circuit
from taction.system.array_types import Floats
from taction.verification.engines.statespace.equations.coarse_board import coarsen
from taction.verification.engines.statespace.equations.dc_solve import (
    Response,
    dense_response,
    structured_response,
)
from taction.verification.engines.statespace.equations.descriptor import Descriptor
from taction.verification.engines.statespace.equations.stamps import stamp
from taction.verification.engines.statespace.equations.structured_solve import Structure
from taction.verification.engines.statespace.linearised.equilibrium import (
    Equilibrium,
    equilibrium_near,
    rounding,
    solve_equilibrium,
)
from taction.verification.engines.statespace.linearised.settling import settled
from taction.verification.engines.statespace.linearised.state_space import (
    StateSpace,
    linearise,
    open_loop,
)


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

    @functools.cached_property
    def rounding(self) -> Floats:
        """Bound on the rounding error of the equilibrium with the strain applied, V, (size,)."""
        return rounding(self.equilibrium)

    @functools.cached_property
    def rest(self) -> Equilibrium:
        """The equilibrium without strain; voltage sources stay on."""
        return self._equilibrium(sources_on=False)

    def _equilibrium(self, *, sources_on: bool) -> Equilibrium:
        if self.descriptor.has_limits:
            free = LinearBoard(self.circuit, self.descriptor.without_limits)
            start = free._equilibrium(sources_on=sources_on)
            near = equilibrium_near(self.descriptor, start.values, sources_on=sources_on)
            if near is None and not self.descriptor.is_large:  # it rests beyond a limit
                drive = self.descriptor.drive(sources_on=sources_on)
                there = settled(self.descriptor, drive)
                near = equilibrium_near(self.descriptor, there, sources_on=sources_on)
            if near is not None:
                return near
        return solve_equilibrium(self.descriptor, self._response, sources_on=sources_on)

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
        """The state space with the amplifiers' outputs as inputs."""
        return open_loop(self.descriptor)

    @functools.cached_property
    def structure(self) -> Structure:
        """The equations of a large board, for solves without a dense matrix of all unknowns."""
        point = self.operating_point
        return self._bare if point is None else Structure(self.descriptor, point.slopes)

    @functools.cached_property
    def coarse(self) -> LinearBoard:
        """A coarse board in place of a large one; see `coarse_board`."""
        return LinearBoard(self.circuit, coarsen(self.descriptor))
