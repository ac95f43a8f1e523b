"""Onset of oscillation: the values of one key at which a board becomes stable or unstable.

Poles locate each crossing of the imaginary axis. Transients that ngspice integrates on both sides,
started along the crossing mode, confirm or contradict it. A disagreement is reported, not
corrected.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import Over, SweepAxis, parse_axes, with_values
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.keys import own_value
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import (
    Complaint,
    InputError,
    SimulatorNotFound,
    SimulatorTooOld,
)
from taction.system.progress import Progress
from taction.system.results import Result
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.reference.lambda_rule import read_scene
from taction.verification.stability.edges import Sample, Scan
from taction.verification.stability.families import Family, unrounded
from taction.verification.studies.onset.transient_trial import CheckedEdge, confirm

NOT_ASKED = "transients were not requested"
AROUND = 30.0  # the default range is from the scene's value / 30 to its value * 30
POINTS = 61  # of the first grid of a scan: 20 per decade in the default range
TIMEOUT = 600.0  # of one transient, s


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Onset(Result):
    """Every crossing of a scene over one axis; `plot` draws the pole map and the root locus."""

    VIEW = "taction.verification.report.views.stability_view:onset_view"
    DOCUMENT = (
        *("scene = scene.name", "file = scene.file", "over = axis.key.path"),
        *("unit = axis.key.unit", "own_value", "scanned.from = scan.low", "scanned.to = scan.high"),
        *("scanned.points = scan.points", "scanned.scale = scan.scale"),
        *("scanned.default = axis.default", "complete = scan.complete"),
        *("crossings = findings", "stable_ranges = scan.stable_ranges"),
        *("unresolved = scan.unresolved", "failures"),
    )

    scene: Scene
    axis: SweepAxis
    scan: Scan
    findings: tuple[CheckedEdge, ...]

    @property
    def disagreement(self) -> bool:
        """Whether a transient contradicts a pole."""
        return any(each.confirmed is False for each in self.findings)

    @property
    def own_value(self) -> float | None:
        """The scene's value of the key."""
        return own_value(self.scene, self.axis.key)

    @property
    def failures(self) -> tuple[Sample, ...]:
        """The values whose poles could not be computed."""
        return tuple(sample for sample in self.scan.samples if sample.failure)

    @property
    def outcome(self) -> str:
        """``pass``, or ``inconclusive`` if a transient contradicts a crossing."""
        return "inconclusive" if self.disagreement else "pass"


def parse_onset_axis(scene: Scene, over: Over) -> SweepAxis:
    """Read ``--over`` of an onset: a key alone means the scene's value / 30 to its value * 30."""
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


def board_over(scene: Scene, axis: SweepAxis) -> Callable[[float], Circuit]:
    """Return the board of `scene` as a function of the value on `axis`.

    No series rounds a knob: a rounded C would cross only between preferred values.
    """
    path = axis.key.path
    problem = None if path.startswith("problem.") else make_problem(scene)
    exact = unrounded(scene, path)

    def build(value: float) -> Circuit:
        changed = with_values(scene, {**exact, path: value})
        return synthesise(changed, problem or make_problem(changed))

    return build


def onset(
    scene: str | Path | Scene,
    *,
    over: Over,
    transients: bool = True,
    progress: Progress = lambda stage: None,
) -> Onset:
    """Find every value of a key at which the board of SCENE begins or ceases to oscillate.

    Parameters
    ----------
    scene : path or Scene
        The board.
    over : mapping, str or iterable of str
        Key to change: C, gain, stray_capacitance or any other number of the scene. Without a range:
        from 1/30 to 30 times the scene's own value.

        ``{"C": ("2pF", "20pF", 13)}`` (lowest, highest, number of points), as on the command line
        (``"C=2pF:20pF:13"``), or a key alone.
    transients : bool
        Run ngspice on both sides of each crossing.
    progress : callable, optional
        Receives the name of each stage.

    Returns
    -------
    Onset
        `findings` holds the crossings of the poles, each with its frequency and its confirmation;
        `plot` draws the poles.

    Raises
    ------
    InputError
        The scene or the axis cannot be used.
    NoVerdictError
        No value on the axis gives a board whose poles can be computed.

    Examples
    --------
    >>> import taction
    >>> onset = taction.onset(
    ...     "scenes/paper-breadboard.toml", over={"C": ("5pF", "20pF", 13)}, transients=False
    ... )
    >>> print(f"stable from {onset.findings[-1].crossing.value:.3g} F")
    stable from 9.02e-12 F
    """
    scene = read_scene(scene)
    axis = parse_onset_axis(scene, over)
    values = [float(value) for value in axis.values]
    logarithmic = axis.scale != "lin" and min(values) > 0.0
    middle = math.sqrt(min(values) * max(values)) if logarithmic else None
    boards = Family.over(board_over(scene, axis), axis.key.path, middle)
    progress(f"poles at {len(values)} values and more")
    scanned = boards.scan(values, logarithmic=logarithmic)
    timeout = scene.analysis.timeout if transients else None
    findings = confirmations(boards, scanned, timeout=timeout, progress=progress)
    return Onset(scene, axis, scanned, findings)


def confirmations(
    boards: Family,
    scanned: Scan,
    *,
    timeout: float | None = TIMEOUT,
    progress: Progress = lambda stage: None,
) -> tuple[CheckedEdge, ...]:
    """Check every crossing by transients of `timeout`, s; without ngspice they stay unconfirmed."""
    reason = NOT_ASKED
    if timeout is not None and scanned.edges:
        try:
            simulator = find_simulator()
        except (SimulatorNotFound, SimulatorTooOld) as error:
            reason, timeout = f"ngspice is needed to confirm a crossing: {error}", None
    findings = []
    for number, edge in enumerate(scanned.edges, start=1):
        progress(f"transients beside crossing {number} of {len(scanned.edges)}")
        found = CheckedEdge(edge, None, reason)
        if timeout is not None:
            way = scanned.logarithmic
            found = confirm(boards.board, edge, simulator, logarithmic=way, timeout=timeout)
        findings.append(replace(found, complete=scanned.complete))
    return tuple(findings)
