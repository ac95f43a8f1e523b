"""Run the claims of the paper chapter by chapter and compare the verdicts with the table."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from taction.system.errors import NoVerdictError
from taction.system.progress import Notice, Progress
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

Run = Callable[[bool], Chapter]
CHAPTERS: dict[str, tuple[str, Run]] = {
    "reconstruction": ("Stress from noisy strain", reconstruction),
    "breadboard": ("The seven-channel breadboard", breadboard),
    "console": ("The design step", console),
    "hardware": ("Other hardware", hardware),
    "speed": ("Analog against digital", speed),
    "simnon": ("Simulation", simnon),
    "energy": ("Energy and stability", energy),
    "conditioning": ("Ill-posedness", conditioning),
    "kernels": ("Kernel and load as printed", kernels),
    "equations": ("The network's equations as printed", equations),
    "closed-loops": ("Boards of one loop, after the paper", closed_loops),
}
"""Title and function of every chapter; the function gets whether the run is quick."""
WHOLE, SHORT = 75, 22  # s, of all chapters on one core of 2.5 GHz


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


def reproduce(*, quick: bool = False, progress: Progress = lambda stage: None) -> Reproduction:
    """Test every claim of the paper, and four about boards of one loop.

    Parameters
    ----------
    quick : bool
        Run fewer seeds and sizes, for CI.
    progress : callable, optional
        Receives how long the run takes, then each chapter.

    Returns
    -------
    Reproduction
        The verdict on every claim, with what was found.

    Examples
    --------
    The quick run takes some minutes.

    >>> import taction
    >>> taction.reproduce(quick=True).outcome  # doctest: +SKIP
    'pass'
    """
    began = time.perf_counter()
    claims = load_claims()
    selected = [claim for claim in claims if claim.quick or not quick]
    about = SHORT if quick else WHOLE
    progress(Notice(f"{len(selected)} claims in {len(CHAPTERS)} chapters: about {about} s"))
    sections: list[PaperSection] = []
    for name, (title, function) in CHAPTERS.items():
        start = time.perf_counter()
        progress(Notice(f"{title} ({len(sections) + 1} of {len(CHAPTERS)})"))
        of_chapter = [claim for claim in selected if claim.chapter == name]
        chapter = _run(function, of_chapter, quick=quick)
        findings = {finding.id: finding for finding in chapter.findings}
        judged = tuple(Judged(claim, findings[claim.id]) for claim in of_chapter)
        sections.append(PaperSection(title, judged, chapter.pictures, time.perf_counter() - start))
    return Reproduction(
        tuple(sections),
        tuple(claim for claim in claims if claim not in selected),
        quick,
        time.perf_counter() - began,
    )


def _run(function: Run, claims: list[Claim], *, quick: bool) -> Chapter:
    """Run one chapter; a chapter that gives no verdict has the reason as finding of each claim."""
    try:
        return function(quick)
    except NoVerdictError as error:
        reason = str(error).splitlines()[0]
        return Chapter(
            tuple(Finding(claim.id, "nothing", reason, ClaimOutcome.NOT_RUN) for claim in claims)
        )
