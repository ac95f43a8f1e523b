"""Onset of oscillation: the values of one key at which a board becomes stable or unstable.

Poles locate each crossing. Transients that ngspice integrates on both sides, started along the
crossing mode, confirm or contradict the crossing. A disagreement is reported, not corrected.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import Axis, Over, Point, parse_axes, with_values
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import (
    Complaint,
    EngineError,
    InputError,
    SimulatorNotFound,
    SimulatorTooOld,
)
from taction.system.quantities import quantity
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.stability.margin import signal_capacitors
from taction.verification.stability.parameter_loci import trace_loci
from taction.verification.stability.pole_scan import scan
from taction.verification.stability.poles import count_unstable, poles
from taction.verification.stability.port_response import PortResponse
from taction.verification.stability.scan_result import AxisCrossing, Scan
from taction.verification.studies.onset.transient_trial import Confirmation, confirm

AROUND = 30.0  # the default range is from the scene's value / 30 to its value * 30
POINTS = 61  # of the first grid of a scan: 20 per decade in the default range
TIMEOUT = 600.0  # of one transient, s
MOST = 4  # crossings and ranges in a `repr`
BESIDE = 1e-6  # relative distance of values beside a crossing from the crossing

Build = Callable[[float], Circuit]
Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Finding:
    """A crossing and the result of the transients on both sides."""

    crossing: AxisCrossing
    confirmation: Confirmation


@dataclass(frozen=True, slots=True)
class Count:
    """Number of unstable poles at one value between two crossings, by two methods."""

    value: float
    poles: int  # eigenvalues on or right of the imaginary axis
    winding: int | None  # winding number of the loop's determinant; None with a `reason`
    reason: str = ""  # why the winding number could not be computed


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Onset:
    """Every crossing of a scene over one axis."""

    scene: Scene
    axis: Axis
    scan: Scan
    findings: tuple[Finding, ...]
    counts: tuple[Count, ...]

    def __repr__(self) -> str:
        unit = self.axis.key.unit
        places = [quantity(each.crossing.value, unit) for each in self.findings]
        crossings = f"crossings over {self.axis.name}: {', '.join(places[:MOST]) or 'none'}"
        if len(places) > MOST:
            crossings += f" and {len(places) - MOST} more"
        ends = [f"{quantity(a, unit)} to {quantity(b, unit)}" for a, b in self.scan.stable_ranges]
        stable = " and ".join(ends[:MOST]) + (" and more" if len(ends) > MOST else "")
        return f"Onset({self.scene.name!r}, {crossings};\n      stable: {stable or 'nowhere'})"

    @property
    def disagreement(self) -> bool:
        """Whether a transient contradicts a pole, or the two counts of unstable poles differ."""
        trials = any(each.confirmation.confirmed is False for each in self.findings)
        return trials or any(c.winding is not None and c.winding != c.poles for c in self.counts)


def parse_onset_axis(scene: Scene, over: Over) -> Axis:
    """Read ``--over`` of an onset: a key alone means the scene's value / 30 to its value * 30.

    Raises
    ------
    InputError
        See `netlist_gen.scene.axes.parse_axes`; also for more than one key, a key that does not
        vary continuously, or a list of fewer than two values.
    """
    groups = parse_axes(scene, over, points=POINTS, around=AROUND)
    if [len(group) for group in groups] != [1]:
        raise InputError("--over", Complaint("key", repr(over), "onset needs exactly one key"))
    axis = groups[0][0]
    if axis.key.kind != "real":
        accepted = "onset needs a key that varies continuously, such as C or gain"
        raise InputError("--over", Complaint("key", repr(axis.name), accepted))
    if len(set(axis.values)) < 2:
        accepted = f"onset needs a range, such as {axis.name}=LOW:HIGH, or two values"
        raise InputError("--over", Complaint("values", repr(over), accepted))
    return axis


EXACT: dict[str, Point] = {"design.capacitance": {"design.capacitor_series": "exact"}}


def board_over(scene: Scene, axis: Axis) -> Build:
    """Return the board of `scene` as a function of the value on `axis`.

    On an axis of C no series rounds C: a rounded C would cross only between preferred values. The
    function raises InputError for a value that gives no board.
    """
    path = axis.key.path
    problem = None if path.startswith("problem.") else make_problem(scene)

    def build(value: float) -> Circuit:
        changed = with_values(scene, {**EXACT.get(path, {}), path: value})
        return synthesise(changed, problem or make_problem(changed))

    return build


def onset(
    scene: Scene,
    axis: Axis,
    *,
    transients: bool = True,
    progress: Progress = lambda stage: None,
) -> Onset:
    """Find every crossing of `scene` over `axis` and check each crossing by transients.

    Parameters
    ----------
    scene : Scene
        The board and its load; exponential boards are linearised at the equilibrium of each value.
    axis : Axis
        From `parse_onset_axis`.
    transients : bool
        Whether to confirm crossings with ngspice.
    progress : callable, optional
        Receives a line of text at every stage.

    Raises
    ------
    InputError, EngineError
        No value on the axis gives a board with poles.
    """
    build = board_over(scene, axis)
    values = [float(value) for value in axis.values]
    logarithmic = axis.scale != "lin" and min(values) > 0.0
    timeout = scene.analysis.timeout
    located = beside_crossings(build, axis) if logarithmic else []
    scanned = crossings(build, [*values, *located], logarithmic=logarithmic, progress=progress)
    findings = confirmations(
        build, scanned, transients=transients, timeout=timeout, progress=progress
    )
    return Onset(scene, axis, scanned, findings, counts(build, scanned, progress=progress))


def beside_crossings(build: Build, axis: Axis) -> list[float]:
    """Return values on both sides of the crossings that the loci of C show; empty for other keys.

    With these values the scan of C is the search of a margin: no crossing is too narrow for it.
    """
    if axis.key.path != "design.capacitance":
        return []
    low, high = float(min(axis.values)), float(max(axis.values))
    middle = math.sqrt(low * high)
    try:
        board = LinearBoard(build(middle))
        ports = PortResponse(board, signal_capacitors(board.circuit))
        loci = trace_loci(ports, low / middle, high / middle)
    except (EngineError, InputError):
        return []
    shares = [*(crossing.share for crossing in loci.crossings), *loci.near]
    sides = (1.0 - BESIDE, 1.0, 1.0 + BESIDE)
    located = [middle * share * side for share in shares for side in sides]
    return [value for value in located if low < value < high]


def counts(
    build: Build, scanned: Scan, *, progress: Progress = lambda stage: None
) -> tuple[Count, ...]:
    """Count the unstable poles between every two crossings by eigenvalues and by winding number.

    Empty for a board too large for all of its eigenvalues.
    """
    if not scanned.complete:
        return ()
    samples = scanned.samples
    ends = [samples[0].value, *(c.value for c in scanned.crossings), samples[-1].value]
    pairs = [(low, high) for low, high in pairwise(ends) if high > low]
    middles = [math.sqrt(a * b) if scanned.logarithmic else 0.5 * (a + b) for a, b in pairs]
    return tuple(_count(build, value, progress) for value in middles)


def _count(build: Build, value: float, progress: Progress) -> Count:
    progress(f"winding number at {value:.4g}")
    board = LinearBoard(build(value))
    eigenvalues = poles(board).unstable_count
    try:
        return Count(value, eigenvalues, count_unstable(board))
    except EngineError as error:
        return Count(value, eigenvalues, None, str(error))


def crossings(
    build: Build,
    values: Sequence[float],
    *,
    logarithmic: bool = True,
    progress: Progress = lambda stage: None,
) -> Scan:
    """Find every crossing of a board that is a function of one value; see `pole_scan.scan`."""
    progress(f"poles at {len(values)} values and more")
    return scan(lambda value: poles(build(value)), values, logarithmic=logarithmic)


def confirmations(
    build: Build,
    scanned: Scan,
    *,
    transients: bool = True,
    timeout: float = TIMEOUT,
    progress: Progress = lambda stage: None,
) -> tuple[Finding, ...]:
    """Check every crossing of a scan by transients; without ngspice crossings stay unconfirmed."""
    confirmation, simulator = Confirmation(None, "transients were not requested"), None
    if transients and scanned.crossings:
        try:
            simulator = find_simulator()
        except (SimulatorNotFound, SimulatorTooOld) as error:
            reason = f"ngspice is needed to confirm a crossing: {error}"
            confirmation = Confirmation(None, reason)
    findings = []
    for number, crossing in enumerate(scanned.crossings, start=1):
        progress(f"transients beside crossing {number} of {len(scanned.crossings)}")
        if simulator is not None:
            confirmation = confirm(
                build, crossing, simulator, logarithmic=scanned.logarithmic, timeout=timeout
            )
        findings.append(Finding(crossing, confirmation))
    return tuple(findings)
