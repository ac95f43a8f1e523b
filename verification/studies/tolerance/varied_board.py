"""Boards whose components deviate from their nominal values, for Monte Carlo and for corners.

All samples share the problem, its ideal answer and the nominal board, which are prepared once.
"""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, lru_cache, partial
from typing import Annotated, Any

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.board.variation import Parameter, parameters, vary
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.documents import INLINE
from taction.system.errors import MACHINE_FAILURES, Complaint, InputError, TactionError
from taction.system.reading_definitions import EXCURSIONS
from taction.system.results import Result
from taction.verification.reference.ideal_answer import IdealAnswer, ideal_answer, ideal_network
from taction.verification.studies.running.collecting import (
    collected_together,
    repeated_if_killed,
    together,
)
from taction.verification.studies.running.versions import Versions, own_versions
from taction.verification.studies.running.worker import Workers
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.progress import Effort
from taction.verification.verdict.record import ERROR, Record, finite, signed_errors
from taction.verification.verdict.simulation import choose_engine
from taction.verification.verdict.verify import Request, Verdict, verify, verify_together

SAMPLE_EFFORT = Effort(details=False, full_margin=False)


@dataclass(frozen=True, slots=True)
class BoardSample:
    """One board with deviating components, and the record of its verdict.

    Attributes
    ----------
    number : int
        In the study; number and seed determine the deviations.
    record : Record
        Of the whole board.
    errors : tuple of float
        Equilibrium minus reference by channel, fractions of the step amplitude; empty where they
        are not known.
    """

    number: int
    record: Annotated[Record, INLINE]
    errors: Annotated[tuple[float, ...], "step"] = ()

    @property
    def outcome(self) -> str:
        """Outcome of the record."""
        return self.record.outcome

    @property
    def failed(self) -> tuple[str, ...]:
        """Checks that do not pass."""
        return self.record.failed

    @property
    def undecided(self) -> bool:
        """Whether the checks decide nothing, or no verdict was reached."""
        return self.record.outcome in (Outcome.INCONCLUSIVE.value, ERROR)

    @property
    def lost(self) -> str:
        """Why no verdict was reached, in one line; empty of a verdict."""
        return self.record.reason.partition("\n")[0] if self.record.failure else ""

    def value(self, name: str) -> float | None:
        """Return a `Quantity` of the board, by its name; None where the board lacks it."""
        if name == "rise_time":  # of the channel that the scene checks
            check = self.record.check(name)
            return None if check is None else finite(check.value)
        return self.record.value("steady_state_error" if name == "steady_state" else name)


@dataclass(frozen=True, slots=True)
class VerifiedSample(Result):
    """One sample of a Monte Carlo study in full: the verdict, and the sample as the study has it.

    Attributes
    ----------
    deviations : mapping of str to float
        Of each part, in units of its tolerance.
    """

    VIEW = "taction.verification.report.views.verdict:sample_view"
    DOCUMENT = ("seed", "sample", "deviations", "* = verdict")

    verdict: Verdict
    sample: BoardSample
    seed: int
    deviations: Mapping[str, float] = field(repr=False)

    @property
    def outcome(self) -> str:
        """The outcome of the verdict."""
        return str(self.verdict.outcome.value)


@dataclass(frozen=True, slots=True)
class Quantity:
    """A reported quantity, its unit, and the direction that is worse (1: larger, -1: smaller)."""

    name: str
    unit: str
    worse: float = 1.0


def quantities(scene: Scene) -> tuple[Quantity, ...]:
    """Return the quantities that are reported of the samples of `scene`."""
    reported = [Quantity("settling_time", "s")]
    reported += [Quantity(name, "step") for name in (*EXCURSIONS, "steady_state")]
    reported.append(Quantity("growth_rate", "1/s"))
    if scene.checks.rise_time is not None:
        reported.append(Quantity("rise_time", "s"))
    if scene.checks.stability.margin > 1:
        reported.append(Quantity("margin", "ratio", -1.0))
    if scene.checks.noise is not None:
        reported.append(Quantity("noise", "V"))
    return tuple(reported)


@dataclass(frozen=True, eq=False)
class VariedBoard:
    """A nominal board, its varied parameters, and the data that all its samples share.

    Every call to a worker sends it. It is pickled once and each worker unpickles it once, because
    pickling takes as long as varying the board.
    """

    scene: Scene
    problem: InverseProblem
    nominal: Circuit
    varied: tuple[Parameter, ...]  # in the order of the deviations z
    ideal: IdealAnswer  # independent of the components
    full_margin: bool  # see `taction.verification.verdict.progress.Effort`
    versions: Versions  # of the process that runs the study

    @property
    def step_amplitude(self) -> float:
        """Largest step of any output of the ideal network, V; not a number without a step."""
        return float(np.abs(self.ideal.target - self.ideal.start).max()) or math.nan

    def request(self, z: Floats) -> dict[str, Any]:
        """Return the arguments of `verify` for the board with deviations `z`."""
        return {
            "scene": self.scene,
            "problem": self.problem,
            "circuit": vary(self.nominal, self.scene.tolerances, z),
            "ideal": self.ideal,
            "effort": replace(SAMPLE_EFFORT, full_margin=self.full_margin),
        }

    @cached_property
    def _packed(self) -> bytes:
        return pickle.dumps(tuple(getattr(self, field.name) for field in fields(self)))

    def __reduce__(self) -> tuple[Callable[[bytes], VariedBoard], tuple[bytes]]:
        return _unpickled, (self._packed,)


@lru_cache(maxsize=2)
def _unpickled(packed: bytes) -> VariedBoard:
    return VariedBoard(*pickle.loads(packed))  # noqa: S301 - part of a pickle


def prepare(scene: Scene, *, full_margin: bool = False) -> VariedBoard:
    """Build the nominal board of `scene` and solve its problem.

    Raises
    ------
    InputError
        The scene cannot be built, or none of its tolerances is above zero.
    NoVerdictError
        The problem has no answer, or the scene needs ngspice and no ngspice was found.
    """
    problem = make_problem(scene)
    nominal = synthesise(scene, problem)
    varied = parameters(nominal, scene.tolerances)
    if not varied:
        text = "every tolerance is zero: nothing varies"
        raise InputError(scene.file, Complaint("tolerances", "", text))
    ideal = ideal_answer(ideal_network(problem, scene), scene)
    versions = own_versions(choose_engine(scene) == "ngspice")
    return VariedBoard(scene, problem, nominal, varied, ideal, full_margin, versions)


def evaluate_together(
    *requests: tuple[VariedBoard, int, Floats],
) -> list[BoardSample | None]:
    """Evaluate several boards; None for each one that needs a call of its own.

    Raises
    ------
    OtherVersionsError, SimulatorNotFound, SimulatorTooOld, OutOfDisk
        As `evaluate`.
    """
    if len(requests) == 1:
        return [evaluate(*requests[0])]
    requests[0][0].versions.check_here()
    asked = [Request(**board.request(z)) for board, _, z in requests]
    found = {k: sample_of(verdict, requests[k][1]) for k, verdict in verify_together(asked)}
    return [found.get(k) for k in range(len(requests))]


def evaluate(board: VariedBoard, number: int, z: Floats) -> BoardSample:
    """Verify the board with deviations `z`; a verification that fails gives a sample, too.

    Raises
    ------
    OtherVersionsError
        This process has other versions of taction or ngspice than `board`.
    SimulatorNotFound, SimulatorTooOld, OutOfDisk
        This machine can compute no sample; the sample itself may be right.
    """
    board.versions.check_here()
    try:
        verdict = repeated_if_killed(partial(verify, **board.request(z)))
    except MACHINE_FAILURES:
        raise
    except TactionError as error:
        return without_verdict(number, error, str(error), board)
    except Exception as error:  # a defect at one sample must not end a study of ten thousand
        reason = f"unforeseen: {type(error).__name__}: {error}"
        return without_verdict(number, error, reason, board)
    return sample_of(verdict, number)


def sample_of(verdict: Verdict, number: int) -> BoardSample:
    """Return the sample with the figures of a verdict."""
    errors = signed_errors(verdict)
    known = errors if all(map(math.isfinite, errors)) else ()
    record = Record.of(verdict, channels=False).without_run_time()
    return BoardSample(number, record, known)


def without_verdict(
    number: int, error: BaseException, reason: str, board: VariedBoard
) -> BoardSample:
    """Return the sample of a verification that `error` ended."""
    engine = board.scene.analysis.engine
    return BoardSample(number, Record.without_verdict(type(error).__name__, reason, engine))


def evaluate_all(
    board: VariedBoard,
    requests: Iterable[tuple[int, Floats]],
    workers: Workers,
    count: int,
    stopped: Callable[[], bool] = lambda: False,
) -> Iterator[BoardSample]:
    """Yield the samples of `requests`, (number, z) each, as they end, until `stopped` is true.

    There are at most `count` of them.

    A sample whose worker was killed several times has no verdict.

    Raises
    ------
    InputError, NoVerdictError
        As `taction.verification.studies.running.collecting.collected`.
    """
    calls = ((number, (board, number, z)) for number, z in requests)
    size = 1 if choose_engine(board.scene) == "ngspice" else together(count, workers)
    for number, sample in collected_together(workers, evaluate_together, calls, size, stopped):
        if isinstance(sample, BaseException):
            reason = f"its worker was killed: {sample}"
            sample = without_verdict(number, sample, reason, board)
        yield sample
