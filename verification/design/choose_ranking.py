"""The designs of a choice in their order: by the checks that pass, then by their worst share.

The share of a check is its value over its limit: 0.4 of the settling time that is allowed, 0.7 of
90 % of the slew rate, the required margin over the margin. A design is as good as its worst share.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from taction.netlist_gen.board.part_warnings import BrokenLimit, broken_limits
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.checks import Checks
from taction.netlist_gen.scene.design import OpAmpChoice
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import InputError, NoVerdictError, SimulatorNotFound, SimulatorTooOld
from taction.system.reading_definitions import READINGS
from taction.verification.design.choose_request import OPAMP
from taction.verification.design.trials import Trial, worse_parts
from taction.verification.studies.store import Store
from taction.verification.studies.sweep.plan import Plan, Requests
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.headroom import FULL
from taction.verification.verdict.record import ERROR, Record, decisive_reason
from taction.verification.verdict.run_checks import CHECKS
from taction.verification.verdict.verify import Verdict, verify

BEST = 3  # designs that ngspice confirms


@dataclass(frozen=True, slots=True)
class Design(Trial):
    """The trial of one design of a choice: op-amp, C and gain.

    Attributes
    ----------
    place : int
        Of the grid, from 0.
    shares : dict
        Value over limit of each check that has a limit; empty for an unstable board.
    """

    place: int = 0
    shares: dict[str, float] = field(default_factory=dict)

    @property
    def headroom(self) -> float | None:
        """Share of the worst limit of an op-amp."""
        return self.reading("headroom")

    @property
    def noise(self) -> float | None:
        """Output noise, V."""
        return self.reading("noise")

    @property
    def worst(self) -> float:
        """The largest share; infinite without any."""
        return max(self.shares.values(), default=math.inf)

    @property
    def opamp(self) -> str:
        """The preset."""
        return str(self.values[OPAMP])

    @property
    def rank(self) -> tuple[bool, bool, int, float, float]:
        """Sort key: good designs, then those with the fewest checks left, then the share."""
        left = len(self.left) if self.outcome != ERROR else len(CHECKS)
        return not self.good, self.outcome != "pass", left, self.worst, self.settling_time

    def plain(self) -> dict[str, Any]:
        """Return the design and what counts of its verdict as plain data."""
        names = ("place", "outcome", "reason", "shares", "headroom")
        more = {"noise_rms": self.noise, "worst_share": self.worst if self.shares else None}
        return self.summary() | {name: getattr(self, name) for name in names} | more


@dataclass(frozen=True, slots=True)
class Confirmation:
    """What ngspice says about a design; `outcome` is None without ngspice, then with `reason`."""

    outcome: Outcome | None
    settling_time: float | None
    reason: str
    verdict: Verdict | None = None


def designs(plan: Plan, store: Store) -> list[Design]:
    """Return the stored designs of a choice, the best first.

    Parts that cannot be bought count only where they are worse than those of the scene.
    """
    found, problem = [], make_problem(plan.scene)
    accepted = _broken(plan.scene, problem)
    for point in Requests(plan):
        data = store.record_of(point.request)
        if data is None:
            continue
        record, refused = Record.from_plain(data), ""
        if record.outcome == "pass":
            broken = _broken(with_values(plan.scene, point.values), problem)
            refused = worse_parts(broken, accepted)
        shares = dict(_shares(record, plan.scene.checks)) if record.stable else {}
        found.append(Design(dict(point.values), record, refused, point.place, shares))
    return sorted(found, key=lambda design: design.rank)


def _shares(record: Record, checks: Checks) -> Iterator[tuple[str, float]]:
    """Yield the share of every limit that the scene has."""
    limits = {
        "steady_state": checks.steady_state.tolerance,
        **{name: getattr(getattr(checks, name), "max", None) for name in (*READINGS, "noise")},
        "headroom": FULL,
    }
    read = {check.name: check.value for check in record.checks}
    for name, limit in limits.items():
        value = read.get(name)
        if value is not None and limit:
            yield name, value / limit
    required, margin = checks.stability.margin, read.get("stability")
    if required > 1.0 and margin is not None and margin > 0.0:
        yield "stability", required / margin


def design_scene(plan: Plan, original: Scene, design: Design, rank: int) -> Scene:
    """Return the scene of a design, to be written: the op-amp's level is that of `original`."""
    scene = with_values(plan.scene, design.values)
    level = original.design.opamp.level
    opamp = OpAmpChoice.model_validate(
        {"base": design.opamp} | ({"level": level} if level != "auto" else {})
    )
    name = f"{original.name[:48]}-{rank}-{design.opamp}"[:64]
    table = scene.design.model_copy(update={"opamp": opamp})
    return scene.model_copy(update={"design": table, "name": name, "analysis": original.analysis})


def best_designs(ranked: list[Design], count: int = BEST) -> list[Design]:
    """Return the best good designs, each of another op-amp while there are any."""
    good = [design for design in ranked if design.good]
    first: dict[str, Design] = {}
    for design in good:
        first.setdefault(design.opamp, design)
    chosen = list(first.values())[:count]
    chosen += [design for design in good if design not in chosen][: count - len(chosen)]
    return chosen


def _broken(scene: Scene, problem: InverseProblem) -> Mapping[str, BrokenLimit]:
    try:
        return broken_limits(synthesise(scene, problem))
    except InputError:
        return {}


def confirmed(scene: Scene) -> Confirmation:
    """Return what ngspice says about a scene."""
    try:
        verdict = verify(scene.with_engine("ngspice"))
    except (SimulatorNotFound, SimulatorTooOld) as error:
        return Confirmation(None, None, str(error))
    except NoVerdictError as error:
        return Confirmation(Outcome.INCONCLUSIVE, None, str(error))
    reading = verdict.measurements.settling_time
    settling = None if reading is None else reading.value
    return Confirmation(verdict.outcome, settling, decisive_reason(verdict), verdict)
