"""Run the claims of the paper chapter by chapter and compare the verdicts with the table."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from taction.system.errors import NoVerdictError
from taction.system.results import Result
from taction.verification.evidence.paper.breadboard import breadboard
from taction.verification.evidence.paper.closed_loops import closed_loops
from taction.verification.evidence.paper.conditioning import conditioning
from taction.verification.evidence.paper.console import console
from taction.verification.evidence.paper.energy import energy
from taction.verification.evidence.paper.equations import equations
from taction.verification.evidence.paper.findings import (
    Chapter,
    Claim,
    ClaimOutcome,
    Finding,
    load_claims,
)
from taction.verification.evidence.paper.hardware import hardware
from taction.verification.evidence.paper.kernels import kernels
from taction.verification.evidence.paper.pictures import Picture
from taction.verification.evidence.paper.reconstruction import reconstruction
from taction.verification.evidence.paper.simnon import simnon
from taction.verification.evidence.paper.speed import speed
from taction.verification.studies.running.versions import describe_machine


@dataclass(frozen=True, slots=True)
class PaperTask:
    """One chapter: what runs, and its processor time on one core of 2.5 GHz, s."""

    title: str
    run: Callable[[bool], Chapter]
    seconds: float
    quick_seconds: float

    def expected(self, *, quick: bool) -> float:
        """Return the expected time of the chapter, s."""
        return self.quick_seconds if quick else self.seconds


CHAPTERS: dict[str, PaperTask] = {
    "reconstruction": PaperTask("Stress from noisy strain", reconstruction, 43.0, 3.1),
    "breadboard": PaperTask("The seven-channel breadboard", breadboard, 5.9, 5.1),
    "console": PaperTask("The design step", console, 3.2, 0.2),
    "hardware": PaperTask("Other hardware", hardware, 2.2, 2.0),
    "speed": PaperTask("Analog against digital", speed, 3.3, 2.5),
    "simnon": PaperTask("Simulation", simnon, 10.0, 2.5),
    "energy": PaperTask("Energy and stability", energy, 8.0, 3.8),
    "conditioning": PaperTask("Ill-posedness", conditioning, 25.0, 1.5),
    "kernels": PaperTask("Kernel and load as printed", kernels, 0.1, 0.1),
    "equations": PaperTask("The network's equations as printed", equations, 0.1, 0.1),
    "closed-loops": PaperTask("Boards of one loop, after the paper", closed_loops, 1.3, 1.0),
}


@dataclass(frozen=True, slots=True)
class Judged:
    """A claim with its finding."""

    DOCUMENT = (
        *("id = claim.id", "claim = claim.claim", "place = claim.place", "run = finding.run"),
        *("printed = claim.printed", "ours = finding.ours", "verdict = finding.outcome"),
        *("expected = claim.expected", "as_expected"),
        "values = finding.values # behind `ours`, in SI base units",
    )

    claim: Claim
    finding: Finding

    @property
    def as_expected(self) -> bool:
        """Whether the verdict is the one in the table."""
        return self.finding.outcome is self.claim.expected


@dataclass(frozen=True, slots=True, eq=False)
class PaperSection:
    """One chapter of the report; `seconds` is its wall time."""

    DOCUMENT = ("title", "seconds [s]")

    title: str
    judged: tuple[Judged, ...]
    pictures: tuple[Picture, ...]
    seconds: float


@dataclass(frozen=True, slots=True, eq=False)
class Reproduction(Result):
    """The result of all chapters; `left_out` are the claims that only a full run judges."""

    VIEW = "taction.verification.report.views.paper:view"
    DOCUMENT = (
        *("outcome", "quick", "seconds [s]", "machine", "claims = judged"),
        *("left_out = omitted", "chapters = sections"),
    )

    sections: tuple[PaperSection, ...]
    left_out: tuple[Claim, ...]
    quick: bool
    seconds: float

    @property
    def machine(self) -> dict[str, str | int | float | None]:
        """Versions, processor, load and threads."""
        return describe_machine()

    @property
    def omitted(self) -> tuple[str, ...]:
        """The names of the claims that were left out."""
        return tuple(claim.id for claim in self.left_out)

    @property
    def judged(self) -> tuple[Judged, ...]:
        """Every claim that was judged, in the order of the table."""
        return tuple(each for section in self.sections for each in section.judged)

    @property
    def outcome(self) -> str:
        """``fail`` where a verdict is not the expected one, else ``inconclusive`` or ``pass``."""
        ran = [each for each in self.judged if each.finding.outcome is not ClaimOutcome.NOT_RUN]
        if not all(each.as_expected for each in ran):
            return "fail"
        return "pass" if len(ran) == len(self.judged) else "inconclusive"


def reproduce(
    *, quick: bool = False, progress: Callable[[str], None] = lambda stage: None
) -> Reproduction:
    """Run every claim; `progress` receives a line before the run and before each chapter.

    The first line says how long the run takes, the others which chapter runs and what is left. A
    quick run uses fewer seeds and sizes, and leaves out the claims that are not `quick`.
    """
    began = time.perf_counter()
    claims = load_claims()
    selected = [claim for claim in claims if claim.quick or not quick]
    expected = {name: task.expected(quick=quick) for name, task in CHAPTERS.items()}
    total = sum(expected.values())
    progress(f"{len(selected)} claims in {len(CHAPTERS)} chapters: about {total:.0f} s")
    sections: list[PaperSection] = []
    for name, task in CHAPTERS.items():
        start = time.perf_counter()
        left = remaining(list(expected.values()), start - began, len(sections))
        progress(f"{task.title} ({len(sections) + 1} of {len(CHAPTERS)}), about {left:.0f} s left")
        of_chapter = [claim for claim in selected if claim.chapter == name]
        chapter = _run(task.run, of_chapter, quick=quick)
        findings = {finding.id: finding for finding in chapter.findings}
        judged = tuple(Judged(claim, findings[claim.id]) for claim in of_chapter)
        sections.append(
            PaperSection(task.title, judged, chapter.pictures, time.perf_counter() - start)
        )
    return Reproduction(
        tuple(sections),
        tuple(claim for claim in claims if claim not in selected),
        quick,
        time.perf_counter() - began,
    )


def remaining(expected: list[float], elapsed: float, done: int) -> float:
    """Return the time that is left after the first `done` chapters took `elapsed`, s.

    The chapters that are left are as slow, compared with the expected times, as those done.

    Examples
    --------
    >>> remaining([10.0, 30.0, 5.0], 20.0, 1)
    70.0
    >>> remaining([10.0, 30.0, 5.0], 0.0, 0)
    45.0
    """
    slower = elapsed / sum(expected[:done]) if done else 1.0
    return slower * sum(expected[done:])


def _run(function: Callable[[bool], Chapter], claims: list[Claim], *, quick: bool) -> Chapter:
    """Run one chapter; a chapter that gives no verdict has the reason as finding of each claim."""
    try:
        return function(quick)
    except NoVerdictError as error:
        reason = str(error).splitlines()[0]
        return Chapter(
            tuple(Finding(claim.id, "nothing", reason, ClaimOutcome.NOT_RUN) for claim in claims)
        )
