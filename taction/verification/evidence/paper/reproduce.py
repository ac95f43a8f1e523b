"""Run the claims of the paper chapter by chapter and compare the verdicts with the table."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from taction.system.errors import NoVerdictError
from taction.system.progress import Notice, Progress
from taction.system.results import Result
from taction.verification.evidence.paper.boards import breadboard, console, hardware
from taction.verification.evidence.paper.findings import Chapter, ClaimOutcome, Finding, load_claims
from taction.verification.evidence.paper.network import conditioning, energy, simnon, speed
from taction.verification.evidence.paper.sensing import equations, kernels, reconstruction
from taction.verification.studies.running.versions import describe_machine

Run = Callable[[], Chapter]
CHAPTERS: dict[str, tuple[str, Run]] = {  # title and function of every chapter
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
ABOUT = 45  # s, of all chapters on one core of 2.5 GHz


@dataclass(frozen=True, slots=True, eq=False)
class Reproduction(Result):
    """The result of all chapters."""

    VIEW = "taction.verification.report.views.evidence_view:paper_view"
    DOCUMENT = (*("outcome", "seconds [s]", "machine", "claims = findings", "chapters = sections"),)

    sections: tuple[Chapter, ...]
    seconds: float

    @property
    def machine(self) -> dict[str, str | int | float | None]:
        """Versions, processor, load and threads."""
        return describe_machine()

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was found of every claim, in the order of the table."""
        return tuple(each for section in self.sections for each in section.findings)

    @property
    def outcome(self) -> str:
        """``fail`` where a verdict is not the expected one, else ``inconclusive`` or ``pass``."""
        ran = [each for each in self.findings if each.outcome is not ClaimOutcome.NOT_RUN]
        if not all(each.as_expected for each in ran):
            return "fail"
        return "pass" if len(ran) == len(self.findings) else "inconclusive"


def reproduce(*, progress: Progress = lambda stage: None) -> Reproduction:
    """Test every claim of the paper.

    Parameters
    ----------
    progress : callable, optional
        Receives how long the run takes, then each chapter.

    Returns
    -------
    Reproduction
        The verdict on every claim, with what was found.

    Examples
    --------
    It takes a minute.

    >>> import taction
    >>> taction.reproduce().outcome  # doctest: +SKIP
    'pass'
    """
    began = time.perf_counter()
    claims = load_claims()
    progress(Notice(f"{len(claims)} claims in {len(CHAPTERS)} chapters: about {ABOUT} s"))
    sections = list[Chapter]()
    for name, (title, run) in CHAPTERS.items():
        start = time.perf_counter()
        progress(Notice(f"{title} ({len(sections) + 1} of {len(CHAPTERS)})"))
        try:
            chapter = run()
        except NoVerdictError as error:
            reason, left = str(error).splitlines()[0], [c for c in claims if c.chapter == name]
            not_run = (Finding(c, "nothing", reason, ClaimOutcome.NOT_RUN) for c in left)
            chapter = Chapter(tuple(not_run))
        findings = tuple(sorted(chapter.findings, key=lambda each: claims.index(each.claim)))
        sections.append(Chapter(findings, chapter.charts, title, time.perf_counter() - start))
    return Reproduction(tuple(sections), time.perf_counter() - began)
