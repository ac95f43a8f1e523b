"""The report of a verdict."""

from __future__ import annotations

from typing import Any

from taction.system.quantities import readable
from taction.verification.report.html.blocks import Notes, Report, Section
from taction.verification.report.html.file import write_report
from taction.verification.report.html.sections.board import (
    board_lines,
    board_section,
    omissions_section,
    parts_section,
)
from taction.verification.report.html.sections.checks import (
    check_bar,
    checks_section,
    headroom_section,
)
from taction.verification.report.html.sections.errors import (
    budget_section,
    effort_section,
    stress_section,
)
from taction.verification.report.html.sections.origin import deck_section, origin_section, run_rows
from taction.verification.report.html.sections.stability import stability_section
from taction.verification.report.html.sections.waveforms import waveforms_section
from taction.verification.report.html.texts import figure, quantity
from taction.verification.report.tables import spaced
from taction.verification.report.verdict.json_document import verdict_document
from taction.verification.verdict.verify import Verdict


def write_verdict_report(verdict: Verdict, path: str) -> None:
    """Write the report of `verdict` to `path`.

    Raises
    ------
    InputError
        See `taction.verification.report.html.file.write_report`.
    """
    write_report(verdict_report(verdict), path)


def verdict_report(verdict: Verdict, command: str = "taction verify", changes: str = "") -> Report:
    """Return the report of a verdict; `changes` says in lines what can mend it."""
    document = verdict_document(verdict)
    return Report(
        title=verdict.scene.name,
        command=command,
        outcome=verdict.outcome.value,
        summary=_summary(document),
        lines=(*board_lines(verdict), _cost(document)),
        sections=verdict_sections(verdict, document, changes),
    )


def verdict_sections(
    verdict: Verdict, document: dict[str, Any], changes: str
) -> tuple[Section, ...]:
    """Return the sections of a verdict; `document` is its JSON document."""
    sections = (
        checks_section(document, _least(verdict)),
        _changes(changes),
        waveforms_section(verdict),
        stability_section(verdict.circuit, verdict.poles),
        stress_section(verdict),
        budget_section(document),
        headroom_section(document["headroom"], limited=not verdict.circuit.is_small_signal),
        effort_section(document),
        board_section(verdict),
        omissions_section(document),
        parts_section(verdict.circuit, verdict.scene),
        deck_section(verdict),
        origin_section(verdict.scene, run_rows(document)),
    )
    return tuple(section for section in sections if section.blocks)


def _changes(text: str) -> Section:
    """Return what can mend the verdict; the first line of the text is above the others."""
    first, *lines = [readable(line.strip()) for line in text.splitlines()] or [""]
    detail = first.removesuffix(":").removeprefix("what to change").strip()
    lead = f"The nearest changes that mend the verdict {detail}".rstrip() + "."
    return Section("What to change", (Notes("", tuple(lines)),) if lines else (), lead)


def _least(verdict: Verdict) -> dict[str, float]:
    """Return the smallest accepted times of the checks that have one."""
    limits = {name: getattr(verdict.scene.checks, name) for name in ("settling_time", "rise_time")}
    return {name: each.min for name, each in limits.items() if each and each.min is not None}


def _cost(document: dict[str, Any]) -> str:
    """Return the engine, the error that it reached, and the run time."""
    engine = ", ".join(str(document[n]) for n in ("simulator", "solver", "method") if document[n])
    engine = engine.replace("statespace", "the state-space engine")
    reached, total = document["accuracy"]["achieved"], document["timing"]["total"]
    known = "unknown" if reached is None else f"{figure(reached, 'step', 3)} of the step"
    return f"Simulated by {engine}; error of the record {known}; {quantity(total, 's', 3)} in all."


def _nearest(document: dict[str, Any]) -> str:
    """Return which check is nearest to its limit."""
    bars = [check_bar(check) for check in document["checks"]]
    measured = [bar for bar in bars if bar.share is not None]
    if not measured:
        return ""
    nearest = max(measured, key=lambda bar: bar.share or 0.0)
    return f"; {nearest.name} is nearest to its limit ({nearest.used})"


def _summary(document: dict[str, Any]) -> str:
    """Return what decides the outcome in a sentence."""
    checks = document["checks"]
    decisive = [check for check in checks if check["outcome"] == document["outcome"]]
    if document["outcome"] == "pass":
        return f"All {len(checks)} checks pass{_nearest(document)}."
    verb = "fail" if document["outcome"] == "fail" else "are not decided"
    names = ", ".join(spaced(check["name"]) for check in decisive)
    if len(decisive) == 1:
        return readable(f"{names}: {decisive[0]['reason']}")
    return f"{len(decisive)} of {len(checks)} checks {verb}: {names}."
