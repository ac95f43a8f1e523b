"""A board whose parts differ from their nominal values, verified as a sample of its kind.

Monte Carlo and corners both judge samples; what they share, the problem, its answer and the
nominal board, is prepared once.
"""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache

from netlist_gen.board.circuit import Circuit
from netlist_gen.board.scalings import make_scalings
from netlist_gen.board.synthesis import synthesise
from netlist_gen.board.variation import Parameter, parameters, vary
from netlist_gen.problem.inverse_problem import InverseProblem, make_problem
from netlist_gen.scene.scene import Scene
from spice_models.array_types import Floats
from spice_models.errors import Complaint, InputError, TactionError
from verification.ideal.ideal_answer import IdealAnswer, ideal_answer, ideal_network
from verification.pipeline.effort import Effort
from verification.pipeline.simulation import choose_engine
from verification.studies.figures import FIGURES, figures_of, finite, signed_errors
from verification.studies.running.collecting import collected
from verification.studies.running.executors import Workers
from verification.studies.running.versions import Versions, own_versions
from verification.verify import Verdict, verify

SAMPLE = Effort(second_look=False, details=False, full_margin=False, session=True)


@dataclass(frozen=True, slots=True)
class Sample:
    """One board that was judged.

    Attributes
    ----------
    number : int
        Its place in the study; with the study's seed it draws the sample again.
    outcome : str
        As a verdict's; inconclusive where there is no verdict at all.
    failed : tuple of str
        Checks that did not pass.
    settling_time, rise_time : float or None
        s; None: there is none, or (rise time) no check asks for it.
    overshoot, steady_state : float or None
        Fractions of the step amplitude.
    growth_rate : float or None
        Real part of the rightmost pole, 1/s.
    margin : float or None
        Factor by which C may shrink, where the scene checks it; not above the reach of the scan.
    errors : tuple of float
        Final value minus reference of every channel, fractions of the step amplitude; the largest
        magnitude is `steady_state`.
    reason : str
        Why there is no verdict; empty if there is one.
    """

    number: int
    outcome: str
    failed: tuple[str, ...] = ()
    settling_time: float | None = None
    rise_time: float | None = None
    overshoot: float | None = None
    steady_state: float | None = None
    growth_rate: float | None = None
    margin: float | None = None
    errors: tuple[float, ...] = ()
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Quantity:
    """What is reported of samples, its unit, and what is worse (1: larger, -1: smaller)."""

    name: str
    unit: str
    worse: float = 1.0


def quantities(scene: Scene) -> tuple[Quantity, ...]:
    """Return what the samples of `scene` have figures of."""
    found = [Quantity("settling_time", "s"), Quantity("overshoot", "step")]
    found += [Quantity("steady_state", "step"), Quantity("growth_rate", "1/s")]
    if scene.checks.rise_time is not None:
        found.append(Quantity("rise_time", "s"))
    if scene.checks.stability.margin > 1:
        found.append(Quantity("margin", "ratio", -1.0))
    return tuple(found)


@dataclass(frozen=True, eq=False)
class VariedBoard:
    """A nominal board, what varies of it, and what else all its samples share.

    The workers get it with each sample. It is packed once, and a worker unpacks it once: that takes
    as long as varying the board.

    Attributes
    ----------
    nominal : Circuit
        Every part at its value.
    varied : tuple of Parameter
        What varies, in the order of z.
    ideal : IdealAnswer
        Of the problem, which the parts do not change.
    full_margin : bool
        Whether margins are followed beyond what the check wants.
    versions : Versions
        Of who asks.
    """

    scene: Scene
    problem: InverseProblem
    nominal: Circuit
    varied: tuple[Parameter, ...]
    ideal: IdealAnswer
    full_margin: bool
    versions: Versions

    @cached_property
    def _packed(self) -> bytes:
        return pickle.dumps(tuple(getattr(self, field.name) for field in fields(self)))

    def __reduce__(self) -> tuple[Callable[[bytes], VariedBoard], tuple[bytes]]:
        return _unpacked, (self._packed,)


@lru_cache(maxsize=2)
def _unpacked(packed: bytes) -> VariedBoard:
    return VariedBoard(*pickle.loads(packed))  # noqa: S301 - came inside a pickle


def prepare(scene: Scene, *, full_margin: bool = False) -> VariedBoard:
    """Build the nominal board of `scene` and solve its problem.

    Raises
    ------
    InputError
        The scene cannot be built, or none of its tolerances is above zero.
    NoVerdictError
        Its problem has no answer, or there is no ngspice where it asks for one.
    """
    problem = make_problem(scene)
    nominal = synthesise(scene, problem)
    varied = parameters(nominal, scene.tolerances)
    if not varied:
        text = "every tolerance is zero: nothing varies"
        raise InputError(scene.file, Complaint("tolerances", "", text))
    ideal = ideal_answer(ideal_network(problem, make_scalings(scene), scene), scene)
    versions = own_versions(choose_engine(scene) == "ngspice")
    return VariedBoard(scene, problem, nominal, varied, ideal, full_margin, versions)


def evaluate(study: VariedBoard, number: int, z: Floats) -> Sample:
    """Judge the board whose parts deviate by `z`; no verdict is a result, not an exception.

    Raises
    ------
    OtherVersionsError
        This is no process that should judge it.
    """
    study.versions.check_here()
    try:
        verdict = verify(
            study.scene,
            problem=study.problem,
            circuit=vary(study.nominal, study.scene.tolerances, z),
            ideal=study.ideal,
            effort=replace(SAMPLE, full_margin=study.full_margin),
        )
    except TactionError as error:
        return Sample(number, "inconclusive", reason=str(error).splitlines()[0])
    except Exception as error:  # a bug at one sample must not be the end of ten thousand
        return Sample(number, "inconclusive", reason=f"unforeseen: {type(error).__name__}: {error}")
    return sample_of(verdict, number)


def sample_of(verdict: Verdict, number: int) -> Sample:
    """Return what a verdict says of its sample."""
    figures, errors = figures_of(verdict, FIGURES), signed_errors(verdict)
    return Sample(
        number=number,
        outcome=verdict.outcome.value,
        failed=tuple(c.name for c in verdict.checks if c.outcome.value != "pass"),
        settling_time=figures["settling_time"],
        rise_time=next((finite(c.value) for c in verdict.checks if c.name == "rise_time"), None),
        overshoot=figures["overshoot"],
        steady_state=figures["steady_state_error"],
        growth_rate=figures["growth_rate"],
        margin=figures["margin"],
        errors=errors if all(map(math.isfinite, errors)) else (),
    )


def run(
    study: VariedBoard,
    requests: Iterable[tuple[int, Floats]],
    workers: Workers,
    stopped: Callable[[], bool] = lambda: False,
) -> Iterator[Sample]:
    """Yield the samples asked for as they end, in any order, until they are `stopped`.

    A sample whose worker died again and again, or that went wrong in a way nobody foresaw, is one
    without verdict.

    Raises
    ------
    InputError, NoVerdictError
        As `verification.studies.running.collecting.collected`.
    """
    calls = ((number, (study, number, z)) for number, z in requests)
    for number, found in collected(workers, evaluate, calls, stopped):
        if isinstance(found, BaseException):
            found = Sample(number, "inconclusive", reason=f"its worker was killed: {found}")
        yield found
