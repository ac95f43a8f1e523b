"""What the op-amps of a board have to do, beside the limits of their data sheets."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, cast

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.parts import OpAmpCell
from taction.system.array_types import Bools, Floats
from taction.system.errors import EngineError
from taction.system.quantities import show
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.transients import stepped
from taction.verification.engines.statespace.transients.exact import combinations, is_exact
from taction.verification.readings.exact_measures import ExactTrace

FULL = 0.9  # of a limit: above it the small-signal solution is not taken for true
PRECISION = 0.01  # of a limit: error of a peak
DETAIL = 1e-4  # of a limit: smaller modes need no points of their own
TOLERANCE = 1e-3  # of a board without exact solution, in step amplitudes
INSTANTS = 1000  # of such a board, in geometric progression
EARLIEST = 1e-6  # of the record: the first of them

Quantity = Literal["voltage", "slope", "current"]
UNITS: dict[Quantity, str] = {"voltage": "V", "slope": "V/s", "current": "A"}


@dataclass(frozen=True, slots=True)
class Load:
    """What one op-amp has to do."""

    DOCUMENT = (
        *("part", "quantity", "peak", "limit", "rest", "error"),
        *("time [s] = at # of the peak; null at rest", "share", "unit"),
    )

    part: str  # name of the op-amp in the circuit
    quantity: Quantity  # of the output
    peak: float  # largest size over all time, in the quantity's unit
    limit: float  # of the part, in the quantity's unit
    at: float  # instant of the peak, s; infinite at rest
    rest: float  # size at the equilibrium, in the quantity's unit
    error: float  # bound on the error of `peak`, in the quantity's unit

    @property
    def share(self) -> float:
        """``peak / limit``."""
        return self.peak / self.limit

    @property
    def is_above(self) -> bool:
        """Whether the load may be above `FULL` of its limit, within its error."""
        return self.peak + self.error > FULL * self.limit

    @property
    def unit(self) -> str:
        """Unit of the quantity."""
        return UNITS[self.quantity]


_Row = tuple[str, Quantity, float, dict[str, float]]
"""Part, quantity, limit, and weights of node voltages (or of their slopes), in parts of it."""


def _rows(circuit: Circuit) -> Iterator[_Row]:
    """Yield what the op-amps have to do; limits that they have in their model are no loads."""
    for cell in circuit.opamps:
        model, out = circuit.models[cell.model], cell.output
        limits: dict[Quantity, float] = {
            "voltage": model.swing(circuit.supply),
            "slope": model.slew_rate,
        }
        for quantity, limit in limits.items():
            if math.isfinite(limit) and not model.large_signal:
                yield cell.name, quantity, limit, {out: 1.0 / limit}
        if model.has_largest_current and not model.is_current_limited:
            weight = 1.0 / (model.output_resistance * model.output_current)
            across = {node: weight * gain for node, gain in _behind_the_output(circuit, cell)}
            across[out] = across.get(out, 0.0) - weight
            yield cell.name, "current", model.output_current, across


def _behind_the_output(circuit: Circuit, cell: OpAmpCell) -> Iterator[tuple[str, float]]:
    """Yield nodes and gains of the voltage behind the output resistance."""
    model = circuit.models[cell.model]
    for number, pole in ((2, model.second_pole), (1, model.gbw)):
        if math.isfinite(pole):
            yield f"x{cell.name}.p{number}", 1.0
            return
    yield cell.noninverting, model.dc_gain
    yield cell.inverting, -model.dc_gain


def watched_nodes(circuit: Circuit) -> tuple[str, ...]:
    """Return the nodes whose voltages give the loads of a circuit."""
    return tuple(dict.fromkeys(node for *_, weights in _rows(circuit) for node in weights))


def _loads(board: LinearBoard, transient: Transient, tolerance: float) -> tuple[Load, ...]:
    """Return the loads of a board, the largest first; `EngineError` where they are not known."""
    rows, nodes = tuple(_rows(board.circuit)), watched_nodes(board.circuit)
    if not rows:
        return ()
    from scipy.sparse import csr_array

    number = {node: k for k, node in enumerate(nodes)}
    entries = [(w, k, number[n]) for k, row in enumerate(rows) for n, w in row[3].items()]
    values, *places = zip(*entries, strict=True)
    weights = csr_array((values, places), shape=(len(rows), len(nodes)))
    slopes = np.array([row[1] == "slope" for row in rows])
    if is_exact(board):
        dense = weights.toarray()
        of_volts = np.where(slopes[:, None], 0.0, dense)
        solution = combinations(board, nodes, of_volts, dense - of_volts, initial=transient.initial)
        ones = np.ones(len(rows))
        trace = ExactTrace(solution, ones, 0.0 * ones, PRECISION, DETAIL)
        found = np.array(trace.peaks)
        peaks, errors, at = np.where(found[0, 0] > found[0, 1], found[:, 0], found[:, 1])
    else:
        time, volts = _record(board, nodes, transient, tolerance)
        loaded = np.asarray(weights @ volts.T)
        fine = _sizes(time, loaded, slopes)
        peaks, at = fine.max(axis=1), time[fine.argmax(axis=1)]
        coarse = _sizes(time[::2], loaded[:, ::2], slopes).max(axis=1)
        errors = np.abs(peaks - coarse) + PRECISION
    rest = np.abs(weights @ np.array([board.equilibrium[node] for node in nodes]))
    rest[slopes] = 0.0
    loads = (
        Load(part, quantity, peak * limit, limit, when, still * limit, error * limit)
        for (part, quantity, limit, _), peak, when, error, still in zip(
            rows, *(each.tolist() for each in (peaks, at, errors, rest)), strict=True
        )
    )
    return tuple(sorted(loads, key=lambda load: (-load.share, load.part, load.quantity)))


def _record(
    board: LinearBoard, nodes: tuple[str, ...], transient: Transient, tolerance: float
) -> tuple[Floats, Floats]:
    """Return instants, s, and voltages of nodes, V, of a board that has no exact solution."""
    stop = transient.stop
    times = np.concatenate([[0.0], np.geomspace(EARLIEST * stop, stop, INSTANTS)])
    if board.circuit.is_linear:
        wave = stepped.simulate(board, transient, nodes=nodes, times=times)
        return wave.time, wave.values
    ends = np.array([0.0, stop])
    wave = stepped.integrate(board, transient, times=ends, tolerance=tolerance, beside=nodes)
    curve = cast(stepped.SteppedCurve, wave.curve)
    times = np.union1d(times, curve.points())
    times = times[times <= stop]
    return times, curve.at(times)[:, -len(nodes) :]


def _sizes(time: Floats, values: Floats, slopes: Bools) -> Floats:
    """Return the sizes of values (K, P) at instants, of some those of their slopes."""
    sizes = values.copy()
    if slopes.any():
        sizes[slopes] = np.gradient(values[slopes], time, axis=1)
    return np.abs(sizes)


@dataclass(frozen=True, slots=True)
class PartLoads:
    """The loads of the op-amps of a board; an unstable board has none."""

    # The largest load of each quantity, and all others above `FULL` of their limit, largest first.
    loads: tuple[Load, ...] = ()
    unknown: str = ""  # why the loads are not known, or empty
    simulated: tuple[Load, ...] = ()  # of the small-signal board, where the simulated op-amps limit

    @classmethod
    def of(
        cls, board: LinearBoard, transient: Transient, tolerance: float = TOLERANCE
    ) -> PartLoads:
        """Find the loads of a stable board; an exact solution is searched for all time.

        `tolerance`: of the steps of another solution, in step amplitudes.
        """
        try:
            loads = _loads(board, transient, tolerance)
        except EngineError as error:
            return cls((), f"the loads of the op-amps are not known: {error}")
        first = {load.quantity: load for load in reversed(loads)}
        chosen = (load for load in loads if load.is_above or first[load.quantity] is load)
        return cls(tuple(chosen))

    @property
    def impossible(self) -> tuple[Load, ...]:
        """The loads that are above their limit at rest, the largest first."""
        above = (load for load in self.loads if load.rest > load.limit + load.error)
        return tuple(sorted(above, key=lambda load: -load.rest / load.limit))


NOT_LIMITED = PartLoads()


def describe(load: Load) -> str:
    """Return what a part has to do, and its limit."""
    when = " at rest" if math.isinf(load.at) else f" at {show(load.at, 's', 3)}"
    peak, limit = (show(value, load.unit, 3) for value in (load.peak, load.limit))
    return (
        f"the output {load.quantity} of op-amp {load.part} reaches {peak}{when};"
        f" the limit is {limit}"
    )
