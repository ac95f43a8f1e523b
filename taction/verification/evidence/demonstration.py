"""The paper's story on three boards, in plain words: what ``taction demo`` runs and tells."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.keys import Value
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import InputError, NoVerdictError
from taction.system.output_files import check_file
from taction.system.progress import Notice, Progress
from taction.system.quantities import banded, percent, readable, show
from taction.system.results import Result
from taction.verification.evidence.paper.findings import paper_scene
from taction.verification.reference.ideal_answer import ideal_network
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.record import FIGURES
from taction.verification.verdict.verify import Verdict, verify

SMALL = 8.2e-12  # F, the next smaller capacitor of the paper's bench
QUIET = 2.45e6  # ohm, a gain with the least settling time (taction reproduce, chapter console)


@dataclass(frozen=True, slots=True, eq=False)
class DemonstrationStep:
    """One board: what it shows, in words, and its verdict."""

    DOCUMENT = ("title", "text", "outcome = verdict.outcome", "expected")

    title: str  # what was changed
    expected: Outcome  # that the story tells
    verdict: Verdict
    text: str  # two or three sentences with the numbers of the verdict


@dataclass(frozen=True, slots=True, eq=False)
class Demonstration(Result):
    """The boards of the demonstration, in their order; `file` is the report, None without one."""

    VIEW = "taction.verification.report.views.demonstration:view"

    DOCUMENT = ("outcome", "seconds [s]", "file", "steps")

    steps: tuple[DemonstrationStep, ...]
    seconds: float
    file: str | None = None

    @property
    def outcome(self) -> str:
        """``pass`` where every board has the outcome that the story tells."""
        told = all(step.verdict.outcome is step.expected for step in self.steps)
        return "pass" if told else "fail"


def demo(
    output: str | Path | None = "taction-demo.html", *, progress: Progress = lambda stage: None
) -> Demonstration:
    """Tell the paper's story on three boards, and write it as a report.

    No scene is needed: the board of the paper works, oscillates with a smaller capacitor, and
    settles sooner with another gain.

    Parameters
    ----------
    output : path or None
        The report; an existing one is replaced.

        None writes none. Without ``taction[report]`` there is none, and `progress` says so.
    progress : callable, optional
        Receives the name of each stage.

    Returns
    -------
    Demonstration
        The three boards with their verdicts; its outcome is ``pass`` if they are as told.

    Raises
    ------
    InputError
        The report cannot be written.

    Examples
    --------
    >>> import taction
    >>> told = taction.demo(None)
    >>> [step.verdict.outcome.value for step in told.steps]
    ['pass', 'fail', 'pass']
    """
    if output is not None:
        check_file(str(output), "-o", (".html",), {})
    start = time.perf_counter()
    scene = paper_scene("paper-breadboard")
    # The limits of the rise time are what the paper measured on the first board alone.
    free = scene.checks.model_copy(update={"rise_time": None})
    loose = scene.model_copy(update={"checks": free})
    first = _verified(scene, {}, "1 of 3: the paper's board", progress)
    second = _verified(
        loose, {"design.capacitance": SMALL}, "2 of 3: a smaller capacitor", progress
    )
    lam = ideal_network(make_problem(scene), scene).lam  # the same solution: R follows
    changes: dict[str, Value] = {"design.gain": QUIET, "design.lambda": lam}
    third = _verified(loose, changes, "3 of 3: another gain", progress)
    steps = (
        DemonstrationStep("The board of the paper", Outcome.PASS, first, _works(first)),
        DemonstrationStep(
            f"C = {_text(SMALL, 'F')} instead of 10 pF", Outcome.FAIL, second, _oscillates(second)
        ),
        DemonstrationStep(
            f"A gain of {_text(QUIET, 'ohm')}", Outcome.PASS, third, _settles(third, first)
        ),
    )
    found = Demonstration(steps, time.perf_counter() - start)
    if output is None:
        return found
    told = replace(found, file=str(output))
    try:
        told.report(output)
    except InputError as error:  # the story has been told
        progress(Notice(f"no report: {error}"))
        return found
    return told


def _verified(scene: Scene, changes: dict[str, Value], stage: str, progress: Progress) -> Verdict:
    progress(stage)
    return verify(with_values(scene, changes), lambda part: progress(f"{stage}, {part}"))


def _text(value: float, unit: str) -> str:
    return readable(show(value, unit))


def _figure(verdict: Verdict, name: str) -> float:
    value = FIGURES[name].figure(verdict).value
    if value is None:
        raise NoVerdictError(f"{verdict.scene.name} has no {name.replace('_', ' ')}")
    return value


def _works(verdict: Verdict) -> str:
    circuit = verdict.circuit
    return (
        f"{len(circuit.outputs)} sensors lie below a skin. A cylinder presses on it, and each"
        " sensor feels a mixture of all places. To find the pressures is an inverse problem that"
        f" noise makes unstable; a board of {len(circuit.opamps)} op-amps solves it with a"
        f" regulariser. Its outputs {banded('settle', verdict.measurements.band)} of the step in"
        f" {_text(_figure(verdict, 'settling_time'), 's')},"
        " where a numerical solver says, and overshoot by"
        f" {percent(_figure(verdict, 'overshoot'))}."
    )


def _oscillates(verdict: Verdict) -> str:
    frequency = _text(_figure(verdict, "frequency"), "Hz")
    return (
        f"The same board with the next smaller capacitor of the shelf oscillates at {frequency},"
        " as the authors saw on their bench. The poles say so before anything is built."
    )


def _settles(verdict: Verdict, before: Verdict) -> str:
    after, first = (_figure(each, "settling_time") for each in (verdict, before))
    return (
        "With the first capacitor, less gain and R for the same solution the board"
        f" {banded('settles', verdict.measurements.band)} in {_text(after, 's')} instead of"
        f" {_text(first, 's')}, and overshoots by"
        f" {percent(_figure(verdict, 'overshoot'), 2)}. `taction design tune` finds such gains."
    )
