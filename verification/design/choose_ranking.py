"""The designs of a choice in their order: by the checks that pass, then by their worst share.

The share of a check is its value over its limit: 0.4 of the settling time that is allowed, 0.7 of
90 % of the slew rate, the required margin over the margin. A design is as good as its worst share.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from taction.netlist_gen.board.part_warnings import broken_limits
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.checks import Checks
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.keys import Value
from taction.netlist_gen.scene.opamp_choice import OpAmpChoice
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import InputError, NoVerdictError, SimulatorNotFound, SimulatorTooOld
from taction.system.reading_definitions import READINGS
from taction.verification.design.choose_request import OPAMP
from taction.verification.studies.store import Store
from taction.verification.studies.sweep.plan import Plan, Requests
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.headroom import FULL
from taction.verification.verdict.run_checks import CHECKS
from taction.verification.verdict.verify import Verdict, verify

BEST = 3  # designs that ngspice confirms
SAME = 1.0 + 1e-9  # ratio of values that count as equal


@dataclass(frozen=True, slots=True)
class Design:
    """One design of a choice.

    Attributes
    ----------
    place : int
        Of the grid, from 0.
    values : dict
        Op-amp, C and gain by dotted paths.
    outcome : str
        Of the state-space verdict: pass, fail, inconclusive or error.
    left : tuple of str
        Checks that do not pass.
    shares : dict
        Value over limit of each check that has a limit.
    settling_time, overshoot, headroom, noise : float or None
        s, fraction of the step, share of the worst limit of an op-amp, V.
    reason : str
        Why it does not pass.
    refused : str
        Which of its parts cannot be bought, or the layout undoes; only of a design that passes.
    """

    place: int
    values: dict[str, Value]
    outcome: str
    left: tuple[str, ...]
    shares: dict[str, float]
    settling_time: float | None
    overshoot: float | None
    headroom: float | None
    noise: float | None
    reason: str
    refused: str = ""

    @property
    def good(self) -> bool:
        """Whether it passes with parts that can be bought."""
        return self.outcome == "pass" and not self.refused

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
        settling = math.inf if self.settling_time is None else self.settling_time
        left = len(self.left) if self.outcome != "error" else len(CHECKS)
        return not self.good, self.outcome != "pass", left, self.worst, settling


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
        record = store.record_of(point.request)
        if record is None:
            continue
        design = _design(point.place, point.values, record, plan.scene.checks)
        if design.outcome == "pass":
            broken = _broken(with_values(plan.scene, design.values), problem)
            worse = [n for n in broken if broken[n] > accepted.get(n, 0.0) * SAME]
            design = replace(design, refused=", ".join(worse))
        found.append(design)
    return sorted(found, key=lambda design: design.rank)


def _design(
    place: int, values: Mapping[str, Value], record: Mapping[str, Any], checks: Checks
) -> Design:
    outcomes = {check["name"]: check for check in record["checks"]}
    read = {name: check["value"] for name, check in outcomes.items()}
    left = tuple(n for n, check in outcomes.items() if check["outcome"] != "pass")
    shares = dict(_shares(read, checks)) if record["stable"] else {}
    return Design(
        place=place,
        values=dict(values),
        outcome=record["outcome"],
        left=left,
        shares=shares,
        settling_time=record["settling_time"] if record["stable"] else None,
        overshoot=record["overshoot"] if record["stable"] else None,
        headroom=read.get("headroom"),
        noise=read.get("noise"),
        reason=record["reason"],
    )


def _shares(read: Mapping[str, float | None], checks: Checks) -> Iterator[tuple[str, float]]:
    """Yield the share of every limit that the scene has."""
    limits = {
        "steady_state": checks.steady_state.tolerance,
        **{name: getattr(getattr(checks, name), "max", None) for name in (*READINGS, "noise")},
        "headroom": FULL,
    }
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


def _broken(scene: Scene, problem: InverseProblem) -> dict[str, float]:
    try:
        circuit = synthesise(scene, problem)
    except InputError:
        return {}
    return {name: broken.factor for name, broken in broken_limits(circuit).items()}


def confirmed(scene: Scene) -> Confirmation:
    """Return what ngspice says about a scene."""
    try:
        verdict = verify(scene.with_engine("ngspice"))
    except (SimulatorNotFound, SimulatorTooOld) as error:
        return Confirmation(None, None, str(error))
    except NoVerdictError as error:
        return Confirmation(Outcome.INCONCLUSIVE, None, str(error))
    decisive = next((c for c in verdict.checks if c.outcome is verdict.outcome), None)
    reading = verdict.measurements.settling_time
    passed = verdict.outcome is Outcome.PASS
    reason = "" if passed or decisive is None else f"{decisive.name}: {decisive.reason}"
    settling = None if reading is None else reading.value
    return Confirmation(verdict.outcome, settling, reason, verdict)
