"""Yield of a board whose components differ: samples, confidence interval, ranked sensitivities.

Every sample is a verification of its own, with a random stream of its own: sample 17 of seed 1 is
the same board on any machine, whatever ran before it. A sample without verdict is no pass, and it
counts in the denominator.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass

import numpy as np

from netlist_gen.circuit import Floats
from netlist_gen.problem import InverseProblem, make_problem
from netlist_gen.scene import Scene
from netlist_gen.synthesis import synthesise
from netlist_gen.variation import draw, parameters, vary
from spice_models.errors import TactionError
from verification.studies.executors import Workers
from verification.verify import Verdict, verify

CONFIDENCE = 0.95
QUANTITIES = ("settling_time", "overshoot", "steady_state", "growth_rate")
LEAST_SAMPLES = 30  # before a yield is called narrow enough, and before sensitivities are given
SIGNIFICANT = 3.0  # standard errors of a correlation that is told


@dataclass(frozen=True, slots=True)
class Sample:
    """One sample.

    Attributes
    ----------
    number, seed : int
        What draws it again.
    outcome : str
        As a verdict's.
    failed : tuple of str
        Checks that did not pass.
    settling_time, overshoot, steady_state, growth_rate : float or None
        s, fraction, fraction of the step, and the rightmost pole's real part in 1/s.
    reason : str
        Why there is no verdict; empty if there is one.
    """

    number: int
    seed: int
    outcome: str
    failed: tuple[str, ...] = ()
    settling_time: float | None = None
    overshoot: float | None = None
    steady_state: float | None = None
    growth_rate: float | None = None
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """How a quantity moves with a component.

    `correlation` is between the component's deviation and the quantity over the samples (the
    settling time's logarithm); its square is the share of the variance that it explains.
    """

    parameter: str
    kind: str
    quantity: str
    correlation: float
    standard_error: float


@dataclass(frozen=True, slots=True)
class YieldReport:
    """What the samples say."""

    samples: int
    passed: int
    without_verdict: int
    fraction: float
    low: float
    high: float
    failures: dict[str, int]
    sensitivities: tuple[Sensitivity, ...]


def evaluate(scene: Scene, problem: InverseProblem, seed: int, number: int) -> Sample:
    """Verify one sample; what goes wrong with it is its reason, never an exception."""
    try:
        nominal = synthesise(scene, problem)
        count = len(parameters(nominal, scene.tolerances))
        board = vary(nominal, scene.tolerances, draw(scene.tolerances, count, seed, number))
        verdict = verify(scene, problem=problem, circuit=board, second_look=False, details=False)
    except TactionError as error:
        return Sample(number, seed, "inconclusive", reason=str(error).splitlines()[0])
    return sample_of(verdict, number, seed)


def run_samples(
    scene: Scene,
    numbers: Iterable[int],
    seed: int,
    workers: Workers,
    enough: Callable[[Sample], bool],
) -> Iterator[Sample]:
    """Yield samples as they end, in any order, until `enough` says so or there are no more.

    Raises
    ------
    InputError
        The scene itself cannot be built.
    """
    problem = make_problem(scene)
    synthesise(scene, problem)
    left = iter(numbers)
    running: dict[Future[Sample], int] = {}
    stopped = False
    while True:
        while not stopped and len(running) < workers.window():
            number = next(left, None)
            if number is None:
                break
            future = workers.executor.submit(evaluate, scene, problem, seed, number)
            running[future] = number
        if not running:
            return
        done, _ = wait(running, timeout=1.0, return_when=FIRST_COMPLETED)
        for future in done:
            sample = _collected(future, running.pop(future), seed, workers)
            stopped = enough(sample) or stopped
            yield sample
        if stopped:
            for future in running:
                future.cancel()
            return


def _collected(future: Future[Sample], number: int, seed: int, workers: Workers) -> Sample:
    try:
        return future.result()
    except workers.lost as error:
        return Sample(number, seed, "inconclusive", reason=f"its worker was lost: {error}")


def report(scene: Scene, samples: Iterable[Sample]) -> YieldReport:
    """Sum up samples: yield with its interval, what failed, and ranked sensitivities."""
    collected = sorted(samples, key=lambda sample: sample.number)
    passed = sum(sample.outcome == "pass" for sample in collected)
    low, high = interval(passed, len(collected))
    failures: dict[str, int] = {}
    for sample in collected:
        for name in sample.failed:
            failures[name] = failures.get(name, 0) + 1
    return YieldReport(
        samples=len(collected),
        passed=passed,
        without_verdict=sum(sample.outcome == "inconclusive" for sample in collected),
        fraction=passed / len(collected) if collected else math.nan,
        low=low,
        high=high,
        failures=dict(sorted(failures.items(), key=lambda item: -item[1])),
        sensitivities=tuple(_sensitivities(scene, collected)),
    )


def interval(passed: int, samples: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Return Clopper and Pearson's exact interval of a yield."""
    from scipy.special import betaincinv

    tail = 0.5 * (1.0 - confidence)
    low = 0.0 if passed == 0 else float(betaincinv(passed, samples - passed + 1, tail))
    high = 1.0
    if passed < samples:
        high = float(betaincinv(passed + 1, samples - passed, 1.0 - tail))
    return low, high


def sample_of(verdict: Verdict, number: int, seed: int) -> Sample:
    """Return what a verdict says of its sample."""
    measures = verdict.measurements
    settling = measures.settling_time
    amplitude = measures.amplitude or 1.0
    return Sample(
        number=number,
        seed=seed,
        outcome=verdict.outcome.value,
        failed=tuple(c.name for c in verdict.checks if c.outcome.value != "pass"),
        settling_time=None if settling is None else settling.value,
        overshoot=max(channel.overshoot or 0.0 for channel in measures.channels),
        steady_state=max(abs(c.final - c.target) for c in measures.channels) / amplitude,
        growth_rate=verdict.poles.rightmost.real,
    )


def _sensitivities(scene: Scene, samples: list[Sample]) -> Iterator[Sensitivity]:
    """Yield the correlations beyond `SIGNIFICANT` standard errors, the strongest first."""
    if len(samples) < LEAST_SAMPLES:
        return
    varied = parameters(synthesise(scene, make_problem(scene)), scene.tolerances)
    found = []
    for quantity in QUANTITIES:
        pairs = [(s, getattr(s, quantity)) for s in samples]
        usable = [(s, v) for s, v in pairs if v is not None and math.isfinite(v)]
        if len(usable) < LEAST_SAMPLES:
            continue
        values = np.array([v for _, v in usable])
        if quantity == "settling_time":
            values = np.log(np.maximum(values, 1e-300))
        z = np.array([draw(scene.tolerances, len(varied), s.seed, s.number) for s, _ in usable])
        correlation = _correlation(z, values)
        error = 1.0 / math.sqrt(len(usable))
        found += [
            Sensitivity(parameter.name, parameter.kind, quantity, float(r), error)
            for parameter, r in zip(varied, correlation, strict=True)
            if abs(r) > SIGNIFICANT * error
        ]
    yield from sorted(found, key=lambda s: -abs(s.correlation))


def _correlation(z: Floats, values: Floats) -> Floats:
    z, values = z - z.mean(axis=0), values - values.mean()
    scale = np.sqrt((z**2).sum(axis=0) * (values**2).sum())
    return np.asarray((z * values[:, None]).sum(axis=0) / np.where(scale > 0, scale, np.inf))
