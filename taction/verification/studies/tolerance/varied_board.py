"""The boards of a scene whose components deviate, for Monte Carlo and for corners.

All samples share the problem, its ideal answer and the nominal board, which are prepared once.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.board.variation import parameters
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError
from taction.system.reading_definitions import EXCURSIONS
from taction.system.results import Result
from taction.verification.reference.ideal_answer import IdealAnswer, ideal_answer, ideal_network
from taction.verification.reference.lambda_rule import read_scene
from taction.verification.studies.running.versions import own_version
from taction.verification.studies.tolerance.samples import BoardSample, Quantity, Varied, evaluate
from taction.verification.verdict.record import Record, signed_errors
from taction.verification.verdict.simulation import choose_engine
from taction.verification.verdict.verify import Request, Verdict, verify, verify_together


@dataclass(frozen=True, slots=True)
class VerifiedSample(Result):
    """One sample of a Monte Carlo study in full: the verdict, and the sample as the study has it.

    Attributes
    ----------
    deviations : mapping of str to float
        Of each part, in units of its tolerance.
    """

    VIEW = "taction.verification.report.views.verdict_view:sample_view"
    DOCUMENT = ("seed", "sample", "deviations", "* = verdict")

    verdict: Verdict
    sample: BoardSample
    seed: int
    deviations: Mapping[str, float] = field(repr=False)

    @property
    def outcome(self) -> str:
        """The outcome of the verdict."""
        return str(self.verdict.outcome.value)


def quantities(scene: Scene) -> tuple[Quantity, ...]:
    """Return the quantities that are reported of the samples of `scene`, with their limits."""
    checks = scene.checks
    steady = Quantity("steady_state", "step", at_most=checks.steady_state.tolerance)
    reported = [
        _limited(scene, Quantity("settling_time", "s", band=checks.settling_time.band)),
        *(_limited(scene, Quantity(name, "step")) for name in EXCURSIONS),
        steady,
        Quantity("growth_rate", "1/s", at_most=0.0),
    ]
    if checks.rise_time is not None:
        reported.append(_limited(scene, Quantity("rise_time", "s")))
    if checks.stability.margin > 1:
        reported.append(Quantity("margin", "ratio", -1.0, at_least=checks.stability.margin))
    if checks.noise is not None:
        reported.append(_limited(scene, Quantity("noise", "V")))
    return tuple(reported)


def _limited(scene: Scene, quantity: Quantity) -> Quantity:
    """Return a quantity with the limits of the scene's check of its name."""
    check = getattr(scene.checks, quantity.name, None)
    least, most = getattr(check, "min", None), getattr(check, "max", None)
    return replace(quantity, at_least=least, at_most=most)


@dataclass(frozen=True, eq=False)
class VariedBoard(Varied):
    """The nominal board of a scene, its varied parameters, and what all its samples share."""

    scene: Scene
    problem: InverseProblem
    ideal: IdealAnswer  # independent of the components
    full_margin: bool  # see `taction.verification.verdict.verify.verify`

    def by_statespace(self) -> VariedBoard:
        """Return the same board with samples by the state-space engine."""
        return replace(self, scene=self.scene.with_engine("statespace"), engine="statespace")

    def request(self, z: Floats) -> Request:
        """Return what `verify` gets for the board with deviations `z`."""
        return Request(self.scene, self.problem, self.at(z), self.ideal, self.full_margin)

    def measured(self, number: int, z: Floats) -> BoardSample:
        """Return the sample with deviations `z`; errors as `verify`."""
        return sample_of(self.request(z).verdict(), number)

    def measured_together(self, requests: Sequence[tuple[int, Floats]]) -> list[BoardSample | None]:
        """Return several samples, None for each one that needs a call of its own."""
        asked = [self.request(z) for _, z in requests]
        found = {k: sample_of(verdict, requests[k][0]) for k, verdict in verify_together(asked)}
        return [found.get(k) for k in range(len(requests))]


def prepare(scene: Scene, *, full_margin: bool = False) -> VariedBoard:
    """Build the nominal board of `scene` and solve its problem.

    InputError: the scene cannot be built, or none of its tolerances is above zero.
    NoVerdictError: the problem has no answer, or the scene needs ngspice and no ngspice was found.
    """
    problem = make_problem(scene)
    nominal = synthesise(scene, problem)
    varied = parameters(nominal, scene.tolerances)
    if not varied:
        text = "every tolerance is zero: nothing varies"
        raise InputError(scene.file, Complaint("tolerances", "", text))
    ideal = ideal_answer(ideal_network(problem, scene), scene)
    return VariedBoard(
        name=scene.name,
        engine=choose_engine(scene),
        nominal=nominal,
        varied=varied,
        tolerances=scene.tolerances,
        quantities=quantities(scene),
        target=ideal.target,
        step_amplitude=float(np.abs(ideal.target - ideal.start).max()) or math.nan,
        version=own_version(choose_engine(scene) == "ngspice"),
        scene=scene,
        problem=problem,
        ideal=ideal,
        full_margin=full_margin,
    )


def verify_sample(
    scene: str | Path | Scene,
    *,
    sample: int,
    engine: str | None = "statespace",
    seed: int = 1,
) -> VerifiedSample:
    """Verify one sample of a Monte Carlo study in full.

    Parameters
    ----------
    scene : path or Scene
        The board, with its table ``[tolerances]``.
    sample : int
        Verify only the sample with this number.
    engine : str, optional
        Engine of all samples.

        ``"auto"``, ``"ngspice"`` or ``"statespace"``; None for the scene's own engine.
    seed : int
        Seed of the samples.

    Returns
    -------
    VerifiedSample
        The verdict, the sample as the study has it, and the deviation of each part.

    Raises
    ------
    InputError
        The scene or the tolerances cannot be used.
    NoVerdictError
        The sample has no verdict.

    Examples
    --------
    >>> import taction
    >>> found = taction.verify_sample("scenes/tuned-breadboard.toml", sample=2)
    >>> found.outcome == found.sample.outcome
    True
    """
    study = prepare(read_scene(scene, engine))
    z = study.drawn(seed, sample)
    verdict = verify(study.scene, problem=study.problem, circuit=study.at(z), ideal=study.ideal)
    deviations = {p.name: float(v) for p, v in zip(study.varied, z, strict=True)}
    return VerifiedSample(verdict, evaluate(study, sample, z), seed, deviations)


def sample_of(verdict: Verdict, number: int) -> BoardSample:
    """Return the sample with the figures of a verdict."""
    errors = signed_errors(verdict)
    known = errors if all(map(math.isfinite, errors)) else ()
    record = Record.of(verdict, channels=False).without_run_time()
    return BoardSample(number, record, known)
