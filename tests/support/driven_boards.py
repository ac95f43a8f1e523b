"""Strongly driven boards of all amplifiers, every reading beside their deck's text.

The truth is an integration of the deck's equations by collocation, once with long steps and once
with shorter ones of a lower order; their difference is its doubt.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial

import numpy as np

from taction.netlist_gen.scene.scene import Scene
from taction.verification.evidence.stress.compare import compare, wrong_checks
from taction.verification.evidence.stress.true_values import TrueValues
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.verify import verify
from tests.support.collocation import UnsettledError, integrate
from tests.support.piecewise_boards import NotComparableError
from tests.support.true_values import true_values

KINDS = (
    ("saturation", "small-signal"),
    ("deadzone", "small-signal"),
    ("rectifier", "small-signal"),
    ("exponential", "small-signal"),
    ("sinh", "small-signal"),
    ("linear", "large-signal"),
    ("saturation", "large-signal"),
    ("exponential", "large-signal"),
)
OPAMPS = ("tl084", "opa2134", "ua741")
PATIENCE = 60.0  # s of processor time for the truth of a board
RUNS = (partial(integrate, order=10, tolerance=1e-11), partial(integrate, order=8, tolerance=1e-10))


def driven(seed: int) -> Scene:
    """Draw a board of one to three channels whose amplifiers or op-amps are driven far."""
    rng, (amplifier, level) = np.random.default_rng(10_000 + seed), KINDS[seed % len(KINDS)]
    count = int(rng.integers(1, 4))
    return Scene.from_arrays(
        rng.normal(size=(count, count)),
        10.0 ** rng.uniform(-0.5, 1.5) * rng.normal(size=count),
        amplifier=amplifier,
        lam=10.0 ** rng.uniform(-2.0, 0.0),
        capacitance=10.0 ** rng.uniform(-11.5, -9.5),
        gain=10.0 ** rng.uniform(4.5, 6.0),
        unit_conductance=10.0 ** rng.uniform(-6.0, -5.0),
        stray_capacitance=2e-12,
        opamp={
            "base": OPAMPS[int(rng.integers(len(OPAMPS)))],
            "input_errors": "none",
            "level": level,
        },
        engine="statespace",
        overshoot={"max": float(10.0 ** rng.uniform(-3.0, -0.5))},
        undershoot={"max": float(10.0 ** rng.uniform(-3.0, -0.5))},
    )


def driven_truth(scene: Scene) -> TrueValues:
    """Return the true readings of a board."""
    return true_values(scene, RUNS)


@dataclass(frozen=True)
class DrivenComparison:
    """A board whose verdict stands beside its truth; `outside` if a number or a check is wrong."""

    kind: str
    outcome: str
    numbers: int
    undecided: tuple[str, ...]  # checks with their reasons
    faults: tuple[str, ...]

    @property
    def outside(self) -> bool:
        return bool(self.faults)

    @property
    def counts(self) -> dict[str, float]:
        """What a study adds up."""
        return {self.kind: 1, f"{self.kind}: {self.outcome}": 1, "numbers": self.numbers}


def compare_board(seed: int) -> DrivenComparison:
    """Compare every number and check of a drawn board with its deck's text.

    Raises
    ------
    NotComparableError
        The truth is not found within `PATIENCE`; the message says why, and what the verdict is.
    """
    scene, kind = driven(seed), " ".join(KINDS[seed % len(KINDS)])
    try:
        with _limited():
            truth = driven_truth(scene)
    except (AssertionError, ArithmeticError, UnsettledError, TimeoutError) as error:
        raise NotComparableError(f"{kind}: {error} ({verify(scene).outcome.value})") from error
    verdict = verify(scene)
    found = compare(verdict, truth)
    outside = [f"{n.name} {n.value!r}: {n.ratio:.3g} bounds off" for n in found if n.outside]
    undecided = [c for c in verdict.checks if c.outcome is Outcome.INCONCLUSIVE]
    return DrivenComparison(
        kind,
        verdict.outcome.value,
        len(found),
        tuple(f"{check.name}: {check.reason}" for check in undecided),
        (*outside, *wrong_checks(verdict, truth)),
    )


@contextmanager
def _limited() -> Iterator[None]:
    """Raise TimeoutError after `PATIENCE` s of this process's own time."""

    def stop(*_: object) -> None:
        raise TimeoutError(f"over {PATIENCE:g} s")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, PATIENCE)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
