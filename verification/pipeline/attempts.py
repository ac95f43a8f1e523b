"""A transient measured, and once more with a smaller step where it missed the wanted error."""

from __future__ import annotations

from dataclasses import dataclass

from verification.ideal.ideal_answer import IdealAnswer
from verification.pipeline.attained_accuracy import Accuracy, attained, both_tries, finer
from verification.pipeline.clock import Clock
from verification.pipeline.design import Design
from verification.pipeline.effort import Effort
from verification.pipeline.recording import Recording, watch
from verification.pipeline.simulation import Pending, begin


@dataclass(frozen=True, slots=True, eq=False)
class Attempt:
    """A recorded transient, the design with its step, and the error where the scene asks for it."""

    design: Design
    seen: Recording
    accuracy: Accuracy | None


def attempt(
    design: Design, ideal: IdealAnswer, pending: Pending, clock: Clock, effort: Effort
) -> Attempt:
    """Wait for a simulation under way and measure it; simulate again if it missed its error.

    Raises
    ------
    SimulationError
        As `verification.pipeline.simulation.Pending.result`.
    """
    seen = watch(design, ideal, pending, clock, effort)
    accuracy = attained(design, seen.simulation, seen.measurements.amplitude)
    better = finer(design, accuracy)
    if accuracy is None or better is None:
        return Attempt(design, seen, accuracy)
    clock.begin("simulation")
    pending = begin(better.scene, better.board, better.transient, better.engine, effort)
    seen = watch(better, ideal, pending, clock, effort)
    second = attained(better, seen.simulation, seen.measurements.amplitude)
    return Attempt(better, seen, both_tries(accuracy, second))
