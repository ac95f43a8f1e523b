"""What a choice tries: op-amps, C and gains, the limits, and the points of the grid.

An op-amp whose input errors miss the limit of the steady state with the scene's own resistors gets
a G0, a U0 and a range of gains of its own (`scaling.rescaled`), and a range of C that keeps R C.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from operator import attrgetter

from taction.netlist_gen.board.opamp_choice import choose_opamp
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import LIMITS, Point, SweepAxis, read_ends, tried, with_values
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.keys import Value, find_key, own_value
from taction.netlist_gen.scene.open_tables import OPAMPS, refuse_unknown
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.topology import topology_of
from taction.system.errors import Complaint, InputError, NoVerdictError
from taction.verification.design.nearest import SearchRange
from taction.verification.design.scaling import SHARE, SMALLER, rescaled
from taction.verification.design.trials import at_small_signal, rest_distance
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.reference.ideal_answer import IdealAnswer, ideal_answer, ideal_network
from taction.verification.studies.sweep.plan import Plan

ERRORS = "design.opamp.input_errors"
OPAMP, CAPACITANCE, GAIN = "design.opamp.base", "design.capacitance", "design.gain"
G0, U0 = "design.unit_conductance", "design.unit_voltage"
FEEDBACK = "design.feedback_conductance"
NAMES = {
    OPAMP: "opamp", G0: "G0", U0: "U0", CAPACITANCE: "C", GAIN: "gain",
    FEEDBACK: "gf",
}  # fmt: skip
"""The keys that may move, with their names in a table."""
AROUND = 10.0  # C and gain go from the scene's value divided by it to the value times it
MOST_POINTS = 101
POINTS = 9  # of C and of the gain


@dataclass(frozen=True, slots=True)
class ChoiceRequest:
    """What is asked for."""

    opamps: Sequence[str] = ()  # presets; empty for all of them
    capacitances: str = ""  # ranges "LOW:HIGH", or empty
    gains: str = ""
    points: int = POINTS  # of C and of the gain, before they are rounded to their series
    limits: Point | None = None  # values of the scene: limits of the checks, and the supply

    @property
    def names(self) -> Sequence[str]:
        """The presets."""
        return self.opamps or [name for name, o in OPAMPS.items() if math.isfinite(o.gbw)]


def choice_plan(scene: Scene, request: ChoiceRequest) -> Plan:
    """Return the sweep of a choice by the state-space engine.

    Op-amps are at the small-signal level: a design above 90 % of a limit of its parts is
    inconclusive, so that no design without headroom is chosen.

    `scene`: lambda is a number.
    InputError: an op-amp is unknown, a range is none, or a limit is no value of its key.

    Examples
    --------
    >>> import taction
    >>> scene = taction.load_scene("scenes/tuned-breadboard.toml")
    >>> plan = choice_plan(scene, ChoiceRequest(["tl084", "ne5534"], "10pF:40pF", "1M:2M", 3))
    >>> plan.shape, sorted(set(plan.axes[1].values))
    ((18,), [1e-11, 2e-11, 4e-11])
    """
    base = _base(scene, request)
    rows: list[dict[str, Value]] = []
    for opamp in dict.fromkeys(request.names):
        rows += _rows(with_values(base, {OPAMP: opamp}), request)
    own = {path: _own(base, path) for path in NAMES}
    axes = []
    for path, name in NAMES.items():
        values = tuple(row.get(path, own[path]) for row in rows)
        if path in (OPAMP, *topology_of(base).searched) or any(
            value != own[path] for value in values
        ):
            axes.append(SweepAxis(find_key(base, path), name, values, "list"))
    return Plan(at_small_signal(base), [axes], "statespace")


def _own(scene: Scene, path: str) -> Value:
    key = find_key(scene, path)
    value = own_value(scene, key) if key.kind == "real" else attrgetter(path)(scene)
    return scene.design.unit_conductance if value is None else value


def _base(scene: Scene, request: ChoiceRequest) -> Scene:
    """Return the scene with the limits, a number for lambda, and an op-amp for its supply.

    The op-amp is the first of the request that works at the supply.
    """
    limits = dict(request.limits or {})
    for option, path in LIMITS.items():
        if path in limits:
            tried(scene, {path: limits[path]}, f"--{option}")
    for name in request.opamps:
        refuse_unknown(name, "--opamps")
    lam = ideal_network(make_problem(scene), scene).lam
    held = {"design.lambda": lam} if lam > 0.0 else {}
    changed = {**limits, **held, ERRORS: scene.design.opamp.input_errors}
    refused = list[InputError]()
    for name in request.names:
        base = with_values(scene, {**changed, "design.opamp": name})
        try:
            choose_opamp(base)
        except InputError as error:
            refused.append(error)
        else:
            return base
    raise refused[0]


def _rows(start: Scene, request: ChoiceRequest) -> Iterator[dict[str, Value]]:
    """Yield the designs of one op-amp: every pair of the two keys that it searches."""
    paths, lam = topology_of(start).searched, start.design.lam
    if GAIN in paths:
        if "gain" not in start.design.model_fields_set and isinstance(lam, int | float):
            gain = 1.0 / (math.sqrt(lam) * start.design.unit_conductance)  # R has the same value
            start = with_values(start, {GAIN: gain})
        start = start if request.gains else _with_own_scale(start)
    design = start.design
    own: dict[str, Value] = {
        OPAMP: design.opamp.base, G0: design.unit_conductance, U0: design.unit_voltage,
        GAIN: design.gain, CAPACITANCE: design.capacitance,
    }  # fmt: skip
    for pair in product(*(_values(start, path, request) for path in paths)):
        yield {**own, **dict(zip(paths, pair, strict=True))}


def _values(scene: Scene, path: str, request: ChoiceRequest) -> tuple[float, ...]:
    option = {CAPACITANCE: "--c-range", GAIN: "--gain-range"}.get(path, "--points")
    text = {CAPACITANCE: request.capacitances, GAIN: request.gains}.get(path, "")
    found = SearchRange.around(scene, path, AROUND)
    if text and found is not None:
        low, high = read_ends(scene, path, text, option)
        found = replace(found, low=low, high=high)
    usable = found is not None and 0.0 < found.low <= found.high
    if found is None or not (usable and 1 <= request.points <= MOST_POINTS):
        accepted = f"expected LOW:HIGH above zero, and 1 to {MOST_POINTS} points"
        raise InputError(option, Complaint(path, repr(text), accepted))
    return found.values(request.points)


def _with_own_scale(scene: Scene) -> Scene:
    """Return the scene with another G0, U0, s and C if its op-amp rests too far with its own."""
    problem = make_problem(scene)
    answer = ideal_answer(ideal_network(problem, scene), scene)
    least, best = _distance(scene, problem, answer), scene
    if least <= scene.checks.steady_state.tolerance:
        return scene
    for factor in SMALLER:
        with suppress(InputError, NoVerdictError):
            scaled = rescaled(scene, problem, answer, SHARE, factor)
            distance = _distance(scaled, problem, answer)
            least, best = min((least, best), (distance, scaled), key=lambda pair: pair[0])
    return best


def _distance(scene: Scene, problem: InverseProblem, answer: IdealAnswer) -> float:
    """Return `rest_distance` of a scene; infinite where it has no board."""
    try:
        return rest_distance(LinearBoard(synthesise(scene, problem)), answer)
    except InputError:
        return math.inf
