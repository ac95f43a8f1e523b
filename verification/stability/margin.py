"""Stability margins: the factor by which C can shrink, or the gain grow, on a stable board.

The loci of the capacitors, or of the gain's resistors, give every crossing of the imaginary axis
and the winding number between two crossings (`parameter_loci`). Poles on both sides confirm the
crossing that sets the margin. With behavioural amplifiers the gain moves the equilibrium: then the
scan of `onset` finds the crossings, and winding numbers between them confirm it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from taction.netlist_gen.board.circuit import Capacitor, Circuit, Resistor
from taction.system.errors import EngineError
from taction.system.quantities import show
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.stability.parameter_loci import trace_loci
from taction.verification.stability.pole_scan import scan
from taction.verification.stability.poles import Poles, count_unstable, poles
from taction.verification.stability.port_response import PortResponse

REACH = 100.0  # the largest factor
CLOSE, DECADES = 1e-6, 4  # relative distance of the poles that confirm a crossing, and farther
SAME = 1e-12  # relative distance of crossings that count as one
PER_DECADE = 20  # values of the first grid where the scan of `onset` finds the crossings


@dataclass(frozen=True, slots=True)
class Margin:
    """A stability margin in C or in the gain.

    Attributes
    ----------
    factor : float
        The least factor, above 1, at which a pole crosses the imaginary axis; the largest factor
        of the search if no pole crosses up to there; 0 for an unstable board.
    uncertainty : float
        Bound on the error of `factor`; 0 if no pole crosses.
    text : str
        The same in words.
    doubt : str
        Why the margin may be smaller; empty if that is excluded.
    """

    factor: float
    uncertainty: float
    text: str
    doubt: str = ""


def both_margins(board: LinearBoard, found: Poles) -> dict[str, Margin]:
    """Return the margins in the capacitance and in the gain of a board with its poles."""
    capacitance = capacitance_margin(board, found=found)
    return {"capacitance": capacitance, "gain": gain_margin(board, found=found)}


def with_capacitance(circuit: Circuit, farads: float) -> Circuit:
    """Return `circuit` with another C; all signal-plane capacitors scale by one factor."""
    signal, factor = set(signal_capacitors(circuit)), farads / circuit.scalings.capacitance
    capacitors = tuple(
        replace(part, farads=part.farads * factor) if part in signal else part
        for part in circuit.capacitors
    )
    scalings = replace(circuit.scalings, capacitance=farads)
    return replace(circuit, capacitors=capacitors, scalings=scalings)


def with_gain(circuit: Circuit, ohms: float) -> Circuit:
    """Return `circuit` with another gain s and the same R; all resistors s scale by one factor."""
    before = circuit.scalings
    gains, factor = set(gain_resistors(circuit)), ohms / before.gain
    resistors = tuple(
        replace(part, ohms=part.ohms * factor) if part in gains else part
        for part in circuit.resistors
    )
    scalings = replace(before, gain=ohms, lam=before.lam * before.gain / ohms)
    return replace(circuit, resistors=resistors, scalings=scalings)


def signal_capacitors(circuit: Circuit) -> tuple[Capacitor, ...]:
    """Return the capacitors C, one for each signal node."""
    names = {f"c_{node.removeprefix('v_')}" for node in circuit.signal_nodes}
    return tuple(part for part in circuit.capacitors if part.name in names)


def gain_resistors(circuit: Circuit) -> tuple[Resistor, ...]:
    """Return the feedback resistors s, one for each constraint node."""
    names = {f"s_{node.removeprefix('w_')}" for node in circuit.constraint_nodes}
    return tuple(part for part in circuit.resistors if part.name in names)


def capacitance_margin(
    circuit: Circuit | LinearBoard, reach: float = REACH, found: Poles | None = None
) -> Margin:
    """Find the factor by which C can shrink.

    Parameters
    ----------
    reach : float
        The largest factor of interest.
    found : Poles, optional
        Poles of the board, if they have been computed before.

    Raises
    ------
    EngineError
        As `taction.verification.stability.poles.poles`.

    Notes
    -----
    Costs the loci (`trace_loci`), and the poles of one or two boards.
    """
    board = LinearBoard.of(circuit)
    circuit, capacitance = board.circuit, board.circuit.scalings.capacitance

    def read(by: float) -> Poles:
        shrunk = with_capacitance(circuit, capacitance / by)
        return poles(LinearBoard(shrunk, point=board.operating_point))  # it does not depend on C

    def words(factor: float) -> str:
        return f"C can shrink by the factor {factor:.4g}, to {show(capacitance / factor, 'F')}"

    search = _Search(read, reach, words, f"C/{reach:g}")
    return search.by_loci(PortResponse(board, signal_capacitors(circuit)), found)


def gain_margin(
    circuit: Circuit | LinearBoard, reach: float = REACH, found: Poles | None = None
) -> Margin:
    """Find the factor by which the gain s can grow; parameters as `capacitance_margin`.

    R keeps its value, so lambda falls as s grows.

    Raises
    ------
    EngineError
        As `taction.verification.stability.poles.poles`.

    Notes
    -----
    The cost is that of `capacitance_margin`; with behavioural amplifiers, that of a scan.
    """
    board = LinearBoard.of(circuit)
    circuit, gain = board.circuit, board.circuit.scalings.gain

    def built(by: float) -> LinearBoard:
        return LinearBoard(with_gain(circuit, gain * by))

    def words(factor: float) -> str:
        return f"the gain can grow by the factor {factor:.4g}, to {show(gain * factor, 'ohm')}"

    search = _Search(lambda by: poles(built(by)), reach, words, f"{reach:g} times the gain")
    if circuit.has_nonlinear_amplifiers:
        return search.by_scan(lambda by: count_unstable(built(by)), found)
    return search.by_loci(PortResponse(board, gain_resistors(circuit)), found)


@dataclass(frozen=True, slots=True)
class _Search:
    """Search for the least factor at which a stable board becomes unstable.

    `read` returns the poles at a factor, `words` describes a margin, `last` the largest factor.
    """

    read: Callable[[float], Poles]
    reach: float
    words: Callable[[float], str]
    last: str

    @property
    def end(self) -> float:
        """End of the search: a crossing at `reach` is found with certainty, or certainly beyond."""
        return self.reach * (1.0 + 2.0 * CLOSE)

    def by_loci(self, ports: PortResponse, found: Poles | None) -> Margin:
        """Find the margin from the loci of the parts."""
        own = poles(ports.board) if found is None else found
        if not own.known_stable:
            return _without(own)
        try:
            loci = trace_loci(ports, 1.0 / self.end)
        except EngineError as error:
            return Margin(1.0, 0.0, "no margin is known", str(error))
        factors = [1.0 / crossing.share for crossing in loci.crossings]
        near = [1.0 / share for share in loci.near]
        return self._confirmed(factors, near, lambda by: loci.unstable_at(1.0 / by))

    def by_scan(self, winding: Callable[[float], int], found: Poles | None) -> Margin:
        """Find the margin by the scan of `onset`; `winding` counts the poles at a factor."""
        own = self.read(1.0) if found is None else found
        if not own.known_stable:
            return _without(own)
        count = 2 + math.ceil(PER_DECADE * math.log10(self.end))
        scanned = scan(self.read, np.geomspace(1.0, self.end, count).tolist())
        failed = [sample.value for sample in scanned.samples if sample.failure]
        return self._confirmed([c.value for c in scanned.crossings], failed, winding)

    def _confirmed(
        self, factors: Sequence[float], near: Sequence[float], winding: Callable[[float], int]
    ) -> Margin:
        """Confirm the first crossing, or that there is none, by the poles beside it.

        `factors` are those of all crossings, `near` those at which poles come close to the axis,
        and `winding` counts the unstable poles at a factor.
        """
        factor, distance = min(factors, default=self.reach), 0.0
        text = self.words(factor) if factors else f"no crossing up to {self.last}"
        doubts = [self._doubt(by, winding) for by in near if by < factor]
        if not factors:
            doubts.append(self._doubt(factor, winding))
        else:
            others = [by / factor - 1.0 for by in factors if by > factor * (1.0 + SAME)]
            room = 0.5 * min([factor - 1.0, *others])
            for decade in range(DECADES):
                distance = min(CLOSE * 10.0**decade, room)
                above = factor * (1.0 + distance)
                beside = [self._doubt(by, winding) for by in (factor / (1.0 + distance), above)]
                if not any(beside):
                    break
            doubts += beside
        doubt = next(filter(None, doubts), "")
        return Margin(factor, distance * factor, text, doubt)

    def _doubt(self, by: float, winding: Callable[[float], int]) -> str:
        """Return why poles and winding number at a factor do not agree; empty if they do."""
        where = f"at the factor {by:.6g}"
        try:
            found, wound = self.read(by), winding(by)
        except EngineError as error:
            return f"{where} there are no poles: {error}"
        if not found.certain:
            return f"{where} a pole is on the imaginary axis to within rounding"
        counted = found.unstable_count
        if counted == wound or (not found.complete and bool(counted) == bool(wound)):
            return ""
        return f"{where} {counted} poles are unstable and the winding number is {wound}"


def _without(own: Poles) -> Margin:
    """Return the margin of a board that is not known to be stable."""
    if own.certain:
        return Margin(0.0, 0.0, "the board is unstable")
    text = "the board itself may be stable or unstable"
    return Margin(0.0, 0.0, text, text)
