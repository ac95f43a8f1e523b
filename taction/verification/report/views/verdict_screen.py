"""A verdict on one screen: its cause, a bar to each limit, and what limits the board."""

from __future__ import annotations

from collections.abc import Sequence

from taction.system.quantities import counted, quantity, readable
from taction.verification.report.blocks import Bars, Content, Page, Section
from taction.verification.report.views.answer_view import (
    answer_text,
    check_bars,
    decisive_text,
    nearest_bar,
    yield_text,
)
from taction.verification.verdict.checks import Outcome, cause
from taction.verification.verdict.verify import Verdict

CHANGES = 4  # lines of the changes that mend a failed verdict, on one screen
WARNINGS = 2  # on one screen; the others are counted


def screen(verdict: Verdict, margins: Sequence[str] = ()) -> Page:
    """Return a verdict on one screen, with the stability `margins` that were asked for.

    It has the outcome and its cause, a bar to each limit, and what limits the board. Checks that
    follow from the verdict's cause are named in the headline alone.
    """
    found = cause(verdict.checks)
    known = () if found is None else found.follows
    pairs = zip(verdict.checks, check_bars(verdict), strict=True)
    contents: tuple[Content, ...] = (
        Bars("", tuple(bar for check, bar in pairs if check.name not in known), brief=True),
        yield_text(verdict.answer) if verdict.outcome is Outcome.PASS else "",
        _distance(verdict, margins),
        answer_text(verdict.answer),
        *_warnings(verdict.warnings),
    )
    seconds = quantity(verdict.timing["total"], "s", 3)
    count = len(verdict.warnings)
    more = f"-v ({counted(count, 'warning')})" if count else "-v"
    return Page(
        title=_headline(verdict),
        command="taction verify",
        outcome=verdict.outcome.value,
        sections=(Section("", contents, media="terminal"),),
        foot=(f"{verdict.waveforms.simulator}: {seconds}; more: {more}, --report FILE",),
    )


def _headline(verdict: Verdict) -> str:
    """Return the outcome with its cause, or of a pass with the limit that is nearest."""
    outcome, name, checks = verdict.outcome.value, verdict.scene.name, verdict.checks
    if outcome != Outcome.PASS.value:
        return f"{outcome.upper()}: {name}: {decisive_text(checks, outcome)}"
    text, nearest = f"PASS: {name}, {counted(len(checks), 'check')}", nearest_bar(checks)
    if nearest is None:
        return text
    used = nearest.used.replace(" of the limit", "")
    return f"{text}; nearest to its limit: {nearest.name} ({used})"


def _distance(verdict: Verdict, margins: Sequence[str]) -> str:
    """Return how far a stable board is from oscillation; of any other one the `margins`."""
    poles = verdict.poles
    if not poles.known_stable:
        return readable("; ".join(margins))
    known = [*margins] or ([] if verdict.margin is None else [verdict.margin.text])
    more, ringing = "" if known else "; more by --margins", "no mode rings"
    if poles.frequency:
        at = quantity(poles.frequency, "Hz", 3)
        ringing = f"damping ratio {poles.damping_ratio:.2g} at {at}"
    return f"Distance to oscillation: {readable('; '.join((*known, ringing)))}{more}"


def _warnings(warnings: Sequence[str]) -> list[str]:
    """Return the first clauses of some warnings, those with numbers first."""
    short = [f"warning: {text.partition('; ')[0]}" for text in map(readable, warnings)]
    return sorted(short, key=lambda text: not any(map(str.isdigit, text)))[:WARNINGS]
