"""Run the claims of the paper chapter by chapter and compare the verdicts with the table."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from spice_models.errors import NoVerdictError
from verification.studies.paper.breadboard import breadboard
from verification.studies.paper.conditioning import conditioning
from verification.studies.paper.console import console
from verification.studies.paper.energy import energy
from verification.studies.paper.equations import equations
from verification.studies.paper.findings import Chapter, Claim, ClaimOutcome, Finding, load_claims
from verification.studies.paper.hardware import hardware
from verification.studies.paper.kernels import kernels
from verification.studies.paper.pictures import Picture
from verification.studies.paper.reconstruction import reconstruction
from verification.studies.paper.simnon import simnon
from verification.studies.paper.speed import speed

CHAPTERS: dict[str, tuple[str, Callable[[bool], Chapter]]] = {
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
}


@dataclass(frozen=True, slots=True)
class Judged:
    """A claim with its finding."""

    claim: Claim
    finding: Finding

    @property
    def as_expected(self) -> bool:
        """Whether the verdict is the one in the table."""
        return self.finding.outcome is self.claim.expected


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """One chapter of the report; `seconds` is its wall time."""

    title: str
    judged: tuple[Judged, ...]
    pictures: tuple[Picture, ...]
    seconds: float


@dataclass(frozen=True, slots=True, eq=False)
class Reproduction:
    """The result of all chapters; `left_out` are the claims that only a full run judges."""

    sections: tuple[Section, ...]
    left_out: tuple[Claim, ...]
    quick: bool
    seconds: float

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
    """Run every claim; `progress` receives the title of each chapter before the chapter runs.

    A quick run uses fewer seeds and sizes, and leaves out the claims that are not `quick`.
    """
    began = time.perf_counter()
    claims = load_claims()
    selected = [claim for claim in claims if claim.quick or not quick]
    sections = []
    for name, (title, function) in CHAPTERS.items():
        progress(title)
        start = time.perf_counter()
        of_chapter = [claim for claim in selected if claim.chapter == name]
        chapter = _run(function, of_chapter, quick=quick)
        findings = {finding.id: finding for finding in chapter.findings}
        judged = tuple(Judged(claim, findings[claim.id]) for claim in of_chapter)
        sections.append(Section(title, judged, chapter.pictures, time.perf_counter() - start))
    return Reproduction(
        tuple(sections),
        tuple(claim for claim in claims if claim not in selected),
        quick,
        time.perf_counter() - began,
    )


def _run(function: Callable[[bool], Chapter], claims: list[Claim], *, quick: bool) -> Chapter:
    """Run one chapter; a chapter that gives no verdict has the reason as finding of each claim."""
    try:
        return function(quick)
    except NoVerdictError as error:
        reason = str(error).splitlines()[0]
        return Chapter(
            tuple(Finding(claim.id, "nothing", reason, ClaimOutcome.NOT_RUN) for claim in claims)
        )
