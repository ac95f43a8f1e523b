"""The paper's story on three boards, in plain words: what ``taction demo`` runs and tells."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.keys import Value
from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import InputError, NoVerdictError
from taction.system.output_files import check_file
from taction.system.progress import Notice, Progress
from taction.system.quantities import banded, percent, quantity
from taction.system.results import Result
from taction.verification.evidence.paper.findings import paper_scene
from taction.verification.reference.ideal_answer import ideal_network
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.record import FIGURES
from taction.verification.verdict.verify import Verdict, verify

SMALL = 8.2e-12  # F, the next smaller capacitor of the paper's bench
QUIET = 2.45e6  # ohm, a gain with the least settling time (taction reproduce, chapter console)
EXPECTED = (Outcome.PASS, Outcome.FAIL, Outcome.PASS)
TITLES = ("The board of the paper", "C = 8.2 pF instead of 10 pF", "A gain of 2.45 MΩ")


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

    VIEW = "taction.verification.report.views.evidence_view:demonstration_view"

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
        check_file(str(output), "-o", {".html": ""})
    start = time.perf_counter()
    scene = paper_scene("paper-breadboard")
    # The limits of the rise time are what the paper measured on the first board alone.
    loose = scene.model_copy(update={"checks": scene.checks.model_copy(update={"rise_time": None})})
    lam = ideal_network(make_problem(scene), scene).lam  # the same solution: R follows
    boards: tuple[tuple[str, Scene, dict[str, Value]], ...] = (
        ("the paper's board", scene, {}),
        ("a smaller capacitor", loose, {"design.capacitance": SMALL}),
        ("another gain", loose, {"design.gain": QUIET, "design.lambda": lam}),
    )
    verdicts = []
    for number, (what, board, changes) in enumerate(boards, 1):
        stage = f"{number} of {len(boards)}: {what}"
        progress(stage)
        named = partial(lambda stage, part: progress(f"{stage}, {part}"), stage)
        verdicts.append(verify(with_values(board, changes), named))
    steps = tuple(map(DemonstrationStep, TITLES, EXPECTED, verdicts, _texts(*verdicts)))
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


def _texts(works: Verdict, oscillates: Verdict, settles: Verdict) -> tuple[str, str, str]:
    """Return what each board shows, with the numbers of its verdict."""
    circuit, band = works.circuit, works.measurements.band
    first, after = (quantity(_figure(each, "settling_time"), "s") for each in (works, settles))
    frequency = quantity(_figure(oscillates, "frequency"), "Hz")
    overshoot, less = (_figure(each, "overshoot") for each in (works, settles))
    return (
        f"{len(circuit.outputs)} sensors lie below a skin. A cylinder presses on it, and each"
        " sensor feels a mixture of all places. To find the pressures is an inverse problem that"
        f" noise makes unstable; a board of {len(circuit.opamps)} op-amps solves it with a"
        f" regulariser. Its outputs {banded('settle', band)} of the step in {first}, where a"
        f" numerical solver says, and overshoot by {percent(overshoot)}.",
        f"The same board with the next smaller capacitor of the shelf oscillates at {frequency},"
        " as the authors saw on their bench. The poles say so before anything is built.",
        "With the first capacitor, less gain and R for the same solution the board"
        f" {banded('settles', settles.measurements.band)} in {after} instead of {first}, and"
        f" overshoots by {percent(less, 2)}. `taction design tune` finds such gains.",
    )


def _figure(verdict: Verdict, name: str) -> float:
    value = FIGURES[name].figure(verdict).value
    if value is None:
        raise NoVerdictError(f"{verdict.scene.name} has no {name.replace('_', ' ')}")
    return value
