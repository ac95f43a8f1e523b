"""A choice: every design of a grid of op-amps, C and gains, ranked by checks and headroom.

Lambda is held, and the limits are checks. The designs are ranked by the checks that pass, then by
their worst share. The share of a check is its value over its limit: 0.4 of the settling time that
is allowed, 0.7 of 90 % of the slew rate, the required margin over the margin.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

from taction.netlist_gen.board.opamp_choice import choose_opamp
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import LIMITS, Point, SweepAxis, tried, with_values
from taction.netlist_gen.scene.check_keys import LONG
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.keys import Value, find_key, write_scene
from taction.netlist_gen.scene.open_tables import OPAMPS, refuse_unknown
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.topology import topology_of
from taction.system.errors import (
    Complaint,
    InputError,
    NoVerdictError,
    SimulatorNotFound,
    SimulatorTooOld,
)
from taction.system.output_files import check_own_folder, make_folder
from taction.system.progress import Progress
from taction.system.quantities import fraction, number
from taction.system.reading_definitions import READINGS
from taction.system.results import Result
from taction.verification.design.trials import (
    LAMBDA,
    Trial,
    accepted_parts,
    at_small_signal,
    broken_at_rest,
    preset,
    search_range,
)
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.reference.ideal_answer import ideal_network
from taction.verification.reference.lambda_rule import read_scene
from taction.verification.studies.running.store import Store
from taction.verification.studies.sweep import Plan, computed, grid_points
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.record import ERROR, Record
from taction.verification.verdict.run_checks import CHECKS
from taction.verification.verdict.verify import Verdict, verify

BEST = 3  # designs that ngspice confirms
ERRORS = "design.opamp.input_errors"
OPAMP, CAPACITANCE, GAIN = "design.opamp.base", "design.capacitance", "design.gain"
G0, FEEDBACK = "design.unit_conductance", "design.feedback_conductance"
NAMES = {OPAMP: "opamp", G0: "G0", CAPACITANCE: "C", GAIN: "gain", FEEDBACK: "gf"}
"""The keys that may be searched, with their names in a table."""
AROUND = 10.0  # C and gain go from the scene's value divided by it to the value times it
OPTIONS = {CAPACITANCE: "--c-range", GAIN: "--gain-range"}
SHARED = ("steady_state", *READINGS, "noise", "headroom")  # checks of a value below a limit
MOST_POINTS = 101
POINTS = 9  # of C and of the gain


def choice_plan(
    scene: Scene,
    opamps: Sequence[str] = (),
    ranges: Mapping[str, str] = MappingProxyType({}),
    points: int = POINTS,
    limits: Point = MappingProxyType({}),
) -> Plan:
    """Return the sweep of a choice by the state-space engine; lambda of `scene` is a number.

    `opamps` are presets, by default all; `ranges` have ``"LOW:HIGH"`` by the paths of C and gain,
    of which there are `points` before they are rounded to their series; `limits` are values of the
    scene: limits of the checks, and the supply. Op-amps are at the small-signal level: a design
    above 90 % of a limit of its parts is inconclusive, so that no design without headroom is
    chosen. `InputError` for a wrong request.
    """
    if not 1 <= points <= MOST_POINTS:
        text = f"expected 1 to {MOST_POINTS}"
        raise InputError("--points", Complaint("points", repr(points), text))
    names = opamps or [name for name, o in OPAMPS.items() if math.isfinite(o.gbw)]
    base = _base(scene, limits, names)
    found: dict[str, tuple[Value, ...]] = {OPAMP: tuple(dict.fromkeys(names))}
    for path in topology_of(base).searched:
        option = OPTIONS.get(path, "--points")
        around = search_range(base, path, ranges.get(path, ""), AROUND, option)
        found[path] = around.values(points)
    axes = [SweepAxis(find_key(base, p), NAMES[p], each, "list") for p, each in found.items()]
    return Plan(at_small_signal(base), [[axis] for axis in axes], "statespace")


def _base(scene: Scene, limits: Point, names: Sequence[str]) -> Scene:
    """Return the scene with the limits, a number for lambda, and the first op-amp that works."""
    for option, path in LIMITS.items():
        if path in limits:
            tried(scene, {path: limits[path]}, f"--{option}")
    for name in names:
        refuse_unknown(name, "--opamps")
    lam = ideal_network(make_problem(scene), scene).lam
    changed = {**limits, ERRORS: scene.design.opamp.input_errors}
    if lam > 0.0:
        changed[LAMBDA] = lam
        if GAIN in topology_of(scene).searched and "gain" not in scene.design.model_fields_set:
            changed[GAIN] = 1.0 / (math.sqrt(lam) * scene.design.unit_conductance)  # R is the same
    refused = list[InputError]()
    for name in names:
        base = with_values(scene, {**changed, "design.opamp": name})
        try:
            choose_opamp(base)
        except InputError as error:
            refused.append(error)
        else:
            return base
    raise refused[0]


@dataclass(frozen=True, slots=True)
class ChosenDesign(Trial):
    """The trial of one design of a choice: op-amp, C and gain."""

    DOCUMENT = (
        *("place", "values", "outcome = record.outcome", "left = record.failed"),
        *("shares", "settling_time [s]", "overshoot [step]"),
        *("headroom = record.check_values.headroom", "noise_rms [V] = record.check_values.noise"),
        *("reason = record.reason", "refused", "worst_share = worst"),
    )

    place: int = 0  # of the grid
    keys: tuple[str, str] = (CAPACITANCE, GAIN)  # that its topology searches

    @property
    def shares(self) -> dict[str, float]:
        """Value over limit by check; of an unstable board none."""
        found = {}
        for check in self.record.checks if self.record.stable else ():
            limit = check.tolerance or check.expected
            if check.value is None or not limit:
                continue
            if check.name in SHARED:
                found[check.name] = check.value / limit
            elif check.name == "stability" and limit > 1.0 and check.value > 0.0:
                found[check.name] = limit / check.value
        return found

    @property
    def worst(self) -> float:
        """The largest share; infinite without any, and where a failure shows in none of them."""
        left = (self.shares.get(name, 0.0) for name in self.record.failed)
        hidden = self.record.outcome != Outcome.PASS.value and min(left, default=0.0) < 1.0
        return math.inf if hidden else max(self.shares.values(), default=math.inf)

    @property
    def opamp(self) -> str:
        """The preset."""
        return str(self.values[OPAMP])

    @property
    def rank(self) -> tuple[bool, bool, int, float, float]:
        """Sort key: good designs, then those with the fewest checks left, then the share."""
        record = self.record
        left = len(record.failed) if record.outcome != ERROR else len(CHECKS)
        return not self.good, record.outcome != "pass", left, self.worst, self.settling_time


@dataclass(frozen=True, slots=True)
class BestDesign:
    """One of the best designs, with what ngspice says."""

    DOCUMENT = (
        *("* = design", "ngspice = outcome"),
        "ngspice_settling_time [s] = verdict.measurements.settling_time.value",
        *("ngspice_reason = reason", "file"),
    )

    design: ChosenDesign
    scene: Scene  # to be written, with the op-amp's level of the original scene
    outcome: Outcome | None  # of ngspice; None without ngspice, then with a reason
    reason: str = ""
    verdict: Verdict | None = None
    file: str | None = None  # that was written

    @classmethod
    def of(cls, design: ChosenDesign, scene: Scene, file: str | None = None) -> BestDesign:
        """Return a design with what ngspice says about its scene."""
        try:
            verdict = verify(scene.with_engine("ngspice"))
        except NoVerdictError as error:
            missing = isinstance(error, SimulatorNotFound | SimulatorTooOld)
            outcome = None if missing else Outcome.INCONCLUSIVE
            return cls(design, scene, outcome, str(error), file=file)
        reason = Record.of(verdict, channels=False).reason
        return cls(design, scene, verdict.outcome, reason, verdict, file)


@dataclass(frozen=True, slots=True)
class Choice(Result):
    """The best designs of a grid, and what ngspice says about them."""

    VIEW = "taction.verification.report.views.design_view:choice_view"
    DOCUMENT = ("designs", "best")

    scene: Scene = field(repr=False)  # as it was
    designs: Sequence[ChosenDesign] = field(repr=False)  # all of the grid, the best first
    best: Sequence[BestDesign] = field(repr=False)  # those that ngspice has verified

    @property
    def outcome(self) -> str:
        """``pass`` if ngspice contradicts not every one of the best, else ``fail``."""
        outcomes = {"pass" if one.outcome is None else one.outcome.value for one in self.best}
        return next((name for name in ("pass", "inconclusive") if name in outcomes), "fail")


def designs(plan: Plan, store: Store) -> list[ChosenDesign]:
    """Return the stored designs of a choice, the best first."""
    found, accepted = list[ChosenDesign](), accepted_parts(plan.scene)
    keys = topology_of(plan.scene).searched
    for place, values, key in grid_points(plan):
        record, refused = store.record_of(key, Record), ""
        if record is None:
            continue
        if record.outcome == "pass":
            board = LinearBoard(synthesise(with_values(plan.scene, values)))
            refused = accepted.refused(broken_at_rest(board))
        found.append(ChosenDesign(values, record, refused, place, keys))
    return sorted(found, key=lambda design: design.rank)


def design_scene(plan: Plan, original: Scene, design: ChosenDesign, rank: int) -> Scene:
    """Return the scene of a design, to be written: the op-amp's level is that of `original`."""
    keys = {path: value for path, value in design.values.items() if path != OPAMP}
    scene = with_values(plan.scene, {**keys, **preset(original, design.opamp)})
    name = f"{original.name[:48]}-{rank}-{design.opamp}"[:64]
    return scene.model_copy(update={"name": name, "analysis": original.analysis})


def first_of_each(ranked: Iterable[ChosenDesign]) -> list[ChosenDesign]:
    """Return the best design of every op-amp, the best first."""
    first: dict[str, ChosenDesign] = {}
    for design in ranked:
        first.setdefault(design.opamp, design)
    return list(first.values())


def best_designs(ranked: list[ChosenDesign]) -> list[ChosenDesign]:
    """Return the best good designs, each of another op-amp while there are any."""
    good = [design for design in ranked if design.good]
    chosen = first_of_each(good)[:BEST]
    return chosen + [design for design in good if design not in chosen][: BEST - len(chosen)]


def choose(
    scene: str | Path | Scene,
    *,
    settling: str | float | None = None,
    rise: str | float | None = None,
    overshoot: str | float | None = None,
    noise: str | float | None = None,
    margin: str | float | None = None,
    supply: str | float | None = None,
    opamps: str | Sequence[str] = (),
    c_range: str = "",
    gain_range: str = "",
    points: int = 9,
    output: str | Path | None = None,
    store: str | Path | None = None,
    jobs: int | None = None,
    cluster: str | None = None,
    progress: Progress = lambda stage: None,
) -> Choice:
    """Choose op-amp, C and gain of SCENE: all designs of a grid, ranked by checks and headroom.

    Lambda, and with it the solution, stays; C and gain take values that can be bought. The
    state-space engine verifies every design, and ngspice the best three. The same command continues
    an interrupted one.

    Parameters
    ----------
    scene : path or Scene
        The board to begin with.
    settling : str or float, optional
        Largest settling time: 10us.
    rise : str or float, optional
        Largest rise time of any channel.
    overshoot : str or float, optional
        Largest overshoot: 5% or 0.05.
    noise : str or float, optional
        Largest output noise of a channel: 1mV.
    margin : str or float, optional
        Factor by which C must be able to shrink.
    supply : str or float, optional
        Supply of the op-amps: 15V.
    opamps : str or sequence of str
        Presets; by default all of them.
    c_range : str
        By default the scene's C from a tenth to ten times its value.
    gain_range : str
        By default the scene's gain from a tenth to ten times its value.
    points : int
        Values of C and of gain.
    output : path, optional
        Write the best three designs as scene files into FOLDER.
    store : path, optional
        Database of the results; by default the scene's name with -choose.sqlite.

        In Python the results stay in memory by default.
    jobs : int, optional
        Number of processes; by default one per core.
    cluster : str, optional
        Address of a Dask scheduler that runs the points.

        ``"tcp://host:port"``.
    progress : callable, optional
        Receives the number of finished designs.

    Returns
    -------
    Choice
        All designs, the best of them, and what ngspice says about these.

    Raises
    ------
    InputError
        The scene, a limit, an op-amp or a range cannot be used, or the folder is not empty.
    NoVerdictError
        The cluster is gone.
    Interrupted
        Ctrl-C; the text says what is stored.

    Examples
    --------
    >>> import taction
    >>> found = taction.choose(
    ...     "scenes/tuned-breadboard.toml", settling="1ms", opamps=["tl084"], points=2, jobs=1
    ... )
    >>> len(found.designs)
    4
    """
    if output is not None:
        check_own_folder(output)
    original = read_scene(scene)
    limits = {
        "settling": _time("--settling", settling), "rise": _time("--rise", rise),
        "overshoot": _number("--overshoot", overshoot), "margin": _number("--margin", margin),
        "noise": noise, "supply": supply,
    }  # fmt: skip
    named = {LIMITS[name]: value for name, value in limits.items() if value is not None}
    given = opamps.split(",") if isinstance(opamps, str) else opamps
    names = [name.strip() for name in given if name.strip()]
    plan = choice_plan(original, names, {CAPACITANCE: c_range, GAIN: gain_range}, points, named)
    with Store(":memory:" if store is None else str(store)) as results:
        computed(plan, results, jobs=jobs, cluster=cluster, progress=progress)
        ranked = designs(plan, results)
    best = []
    for rank, design in enumerate(best_designs(ranked), 1):
        one = design_scene(plan, original, design, rank)
        file = None if output is None else str(Path(output) / f"{one.name}.toml")
        best.append(BestDesign.of(design, one, file))
    if output is not None:
        make_folder(output)
        for each in best:
            write_scene(each.scene, str(each.file))
    return Choice(original, ranked, best)


def _time(option: str, given: str | float | None) -> str | float | None:
    """Return a limit as it is; refuse a text without a unit that is long for a board."""
    with suppress(ValueError):
        if isinstance(given, str) and (value := float(given)) >= LONG:
            text = f"it has no unit and is {value:g} s; expected such as '5ms', or '{value:g}s'"
            raise InputError(option, Complaint("value", repr(given), text))
    return given


def _number(option: str, given: str | float | None) -> float | None:
    """Read a number; of the overshoot also a share in percent."""
    if given is None:
        return None
    text = str(given).strip()
    with suppress(ValueError):
        value = fraction(text) if option == "--overshoot" else number(text)
        if option != "--overshoot" or value <= 1.0:
            return value
    complaint = Complaint("value", repr(given), "expected a number, such as 0.05 or 5%")
    raise InputError(option, complaint)
