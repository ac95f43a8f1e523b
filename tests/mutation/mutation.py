"""Planted faults, one function for each station of the pipeline."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from taction.netlist_gen.scene.scene import Scene
from taction.verification.reference import IdealNetwork
from taction.verification.reference.ideal_answer import IdealAnswer
from taction.verification.verdict.checks import Outcome
from tests.mutation import planting
from tests.mutation.faults import (
    CircuitChange,
    ProblemChange,
    WaveformsChange,
)
from tests.mutation.planting import Plant

MATRIX, ELEVEN, TUNED = "custom-matrix", "eleven-channel", "tuned-breadboard"
KNOWN = "known-readings"
PAPER, ENTROPY, SKEW = "paper-breadboard", "paper-exponential", "tangential-exponential"
STATE_SPACE, NGSPICE = "statespace", "ngspice"
STEADY, SETTLES, RISES = "steady_state", "settling_time", "rise_time"
OVERSHOOTS, STABLE, AGREE, SAME = "overshoot", "stability", "engines_agree", "same_problem"


@dataclass(frozen=True)
class Mutation:
    """One planted fault."""

    fault: str  # what is wrong, in words
    where: str  # the station of the pipeline that hands on the wrong value
    plant: Plant
    scene: str  # shipped scene that is verified
    engine: str
    caught_by: tuple[str, ...]  # checks with this outcome
    outcome: Outcome = Outcome.FAIL


def of_problem(fault: str, change: ProblemChange, scene: str) -> Mutation:
    """Build a board of another problem than the reference's."""
    plant = planting.in_the_problem_of_the_board(change)
    return Mutation(fault, "synthesis", plant, scene, STATE_SPACE, (STEADY,))


def of_facts(fault: str, changes: Mapping[str, float], scene: str, *caught_by: str) -> Mutation:
    """Give the synthesis other numbers of the design: factors of facts by name."""
    plant = planting.in_the_facts(changes)
    engine = NGSPICE if scene == ENTROPY else STATE_SPACE  # the faster one
    return Mutation(fault, "facts of the synthesis", plant, scene, engine, caught_by)


def of_board(fault: str, change: CircuitChange, scene: str, caught_by: str) -> Mutation:
    """Give both engines another circuit."""
    plant = planting.in_the_circuit(change)
    return Mutation(fault, "circuit (both engines)", plant, scene, STATE_SPACE, (caught_by,))


def of_deck(fault: str, change: CircuitChange, scene: str) -> Mutation:
    """Give ngspice alone another circuit."""
    return Mutation(fault, "deck", planting.in_the_deck(change), scene, NGSPICE, (AGREE,))


def of_text(fault: str, old: str, new: str, *caught_by: str) -> Mutation:
    """Replace a text in the deck."""
    plant = planting.in_the_text_of_the_deck(lambda text: text.replace(old, new))
    return Mutation(fault, "text of the deck", plant, MATRIX, NGSPICE, caught_by)


def of_run(fault: str, changes: dict[str, float | str], scene: str, *caught_by: str) -> Mutation:
    """Let ngspice run another transient."""
    plant = planting.in_the_run(changes)
    return Mutation(fault, "plan of ngspice", plant, scene, NGSPICE, caught_by)


def of_record(fault: str, change: WaveformsChange) -> Mutation:
    """Change what ngspice returns."""
    plant = planting.in_the_record(change)
    return Mutation(fault, "record of ngspice", plant, MATRIX, NGSPICE, (AGREE,))


def of_reference(
    fault: str, change: Callable[[IdealNetwork], IdealNetwork], scene: str, *caught_by: str
) -> Mutation:
    """Let the reference solve another problem."""
    plant = planting.in_the_reference(change)
    return Mutation(fault, "reference", plant, scene, STATE_SPACE, caught_by)


def of_answer(
    fault: str, change: Callable[[IdealAnswer, Scene], IdealAnswer], scene: str, caught_by: str
) -> Mutation:
    """Change the answer of the reference."""
    plant = planting.in_the_answer(change)
    return Mutation(fault, "answer of the reference", plant, scene, STATE_SPACE, (caught_by,))


def of_equations(fault: str, change: CircuitChange, scene: str) -> Mutation:
    """Give the state-space engine alone another circuit."""
    plant = planting.in_the_equations(change)
    return Mutation(fault, "equations of the state space", plant, scene, NGSPICE, (AGREE,))


def of_readings(fault: str, plant: Plant) -> Mutation:
    """Change what the measures read with."""
    return Mutation(fault, "measures", plant, MATRIX, STATE_SPACE, (SETTLES,))
