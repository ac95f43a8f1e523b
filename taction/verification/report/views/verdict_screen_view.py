"""A verdict on one screen: the outcome and its cause, a bar to each limit, and what limits it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from taction.system.quantities import counted, readable
from taction.verification.report.blocks import TERMINAL, Bar, Bars, Notes, Page, Section
from taction.verification.report.texts import quantity
from taction.verification.report.views.answer_view import (
    answer_text,
    check_bars,
    decisive_text,
    nearest_bar,
    yield_text,
)
from taction.verification.verdict.cause import cause
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.verify import Verdict

CHANGES = 4  # lines of the changes that mend a failed verdict
WARNINGS = 2  # the others are counted


def screen(verdict: Verdict, margins: Sequence[str] = ()) -> Page:
    """Return what a terminal shows of a verdict, with the stability `margins` that were asked for.

    Checks that follow from the verdict's cause are named in the headline alone.
    """
    found = cause(verdict.checks)
    known = () if found is None else found.follows
    pairs = zip(verdict.checks, check_bars(verdict), strict=True)
    built = yield_text(verdict.answer) if verdict.outcome is Outcome.PASS else ""
    notes = (built, _distance(verdict, margins), answer_text(verdict.answer))
    blocks = (
        Bars("", tuple(bar for check, bar in pairs if check.name not in known), drawn=True),
        Notes("", tuple(filter(None, notes))),
        Notes("", _warnings(verdict.warnings)),
    )
    seconds = quantity(verdict.timing["total"], "s", 3)
    count = len(verdict.warnings)
    more = f"-v ({counted(count, 'warning')})" if count else "-v"
    return Page(
        title=_headline(verdict),
        command="taction verify",
        outcome=verdict.outcome.value,
        sections=(Section("", blocks, media=(TERMINAL,)),),
        foot=(f"{verdict.waveforms.simulator}: {seconds}; more: {more}, --report FILE",),
    )


def on_screen(page: Page, verdict: Verdict) -> tuple[Section, ...]:
    """Return the sections of a verdict's page, for a terminal those of `screen` in their place."""
    media = (tuple(name for name in each.media if name != TERMINAL) for each in page.sections)
    left = (replace(each, media=names) for each, names in zip(page.sections, media, strict=True))
    return (*screen(verdict).sections, *left)


def _headline(verdict: Verdict) -> str:
    """Return the outcome with its cause, or of a pass with the limit that is nearest."""
    outcome, name, checks = verdict.outcome.value, verdict.scene.name, verdict.checks
    if outcome != Outcome.PASS.value:
        return f"{outcome.upper()}: {name}: {decisive_text(checks, outcome)}"
    nearest, text = (
        nearest_bar(checks),
        f"{outcome.upper()}: {name}, {counted(len(checks), 'check')}",
    )
    if nearest is None:
        return text
    return f"{text}; nearest to its limit: {nearest.name} ({_used(nearest)})"


def _distance(verdict: Verdict, margins: Sequence[str]) -> str:
    """Return how far a stable board is from oscillation; of any other one the `margins`."""
    poles = verdict.poles
    if not poles.known_stable:
        return readable("; ".join(margins))
    known = [*margins] or ([] if verdict.margin is None else [verdict.margin.text])
    more = "" if known else "; more by --margins"
    known.append(
        f"damping ratio {poles.damping_ratio:.2g} at {quantity(poles.frequency, 'Hz', 3)}"
        if poles.frequency
        else "no mode rings"
    )
    return f"Distance to oscillation: {readable('; '.join(known))}{more}"


def _used(bar: Bar) -> str:
    return bar.used.replace(" of the limit", "")


def _warnings(warnings: Sequence[str]) -> tuple[str, ...]:
    """Return the first clauses of some warnings, those with numbers first."""
    short = [f"warning: {text.partition('; ')[0]}" for text in map(readable, warnings)]
    return tuple(sorted(short, key=lambda text: not any(map(str.isdigit, text)))[:WARNINGS])
