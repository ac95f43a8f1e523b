"""A verdict on one screen: the outcome and its cause, a bar to each limit, and what limits it.

At `COLUMNS` columns it has at most `MOST` lines with its last one, the outcome. What does not fit
is counted, and ``-v`` shows it.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Sequence
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

COLUMNS, MOST = 80, 14
CHANGES = 5  # lines that are kept for the changes that mend a failed verdict
LAST = 2  # lines: where more is shown, and the outcome


def screen(verdict: Verdict, margins: Sequence[str] = (), *, searched: bool = False) -> Page:
    """Return what a terminal shows of a verdict, with the stability `margins` that were asked for.

    `searched`: changes that mend the verdict follow, which need lines, too.
    """
    headline = _headline(verdict)
    built = yield_text(verdict.answer) if verdict.outcome is Outcome.PASS else ""
    answer = answer_text(verdict.answer, short=True, covers=not built)
    said = (built, _distance(verdict, margins), answer)
    notes = tuple(filter(None, said))
    room = MOST - LAST - (CHANGES if searched else 0)
    room -= sum(map(height, (headline, *notes)))
    rows, left = _rows(verdict, room)
    room -= len(rows) + sum(map(height, left))
    blocks = (
        Bars("", rows, drawn=True),
        Notes("", left),
        Notes("", notes),
        Notes("", tuple(_warnings(verdict.warnings, room))),
    )
    seconds = quantity(verdict.timing["total"], "s", 3)
    count = len(verdict.warnings)
    more = f"-v ({counted(count, 'warning')})" if count else "-v"
    return Page(
        title=headline,
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


def height(text: str) -> int:
    """Return how many lines a text has at `COLUMNS`."""
    return len(textwrap.wrap(text.replace("Ω", "ohm"), COLUMNS))


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


def _rows(verdict: Verdict, room: int) -> tuple[tuple[Bar, ...], tuple[str, ...]]:
    """Return the bars that fit into so many lines, and what is said of the other checks.

    Checks with the verdict's cause are named in the headline. Of the others those that pass give
    way, the farthest from its limit first.
    """
    found = cause(verdict.checks)
    known = () if found is None else found.follows
    pairs = zip(verdict.checks, check_bars(verdict), strict=True)
    bars = [bar for check, bar in pairs if check.name not in known]
    if len(bars) <= room:
        return tuple(bars), ()
    kept = sorted(bars, key=lambda bar: (bar.outcome != Outcome.PASS.value, bar.share or 0.0))
    kept = kept[len(bars) - max(room - 1, 1) :]
    out = [bar for bar in bars if bar not in kept and bar.outcome == Outcome.PASS.value]
    most = math.ceil(100.0 * max((bar.share or 0.0 for bar in out), default=0.0))
    used = f", with at most {most} % of the limit" if most > 1 else ""
    names = ", ".join(bar.name for bar in out)
    texts = (f"{names}: pass{used}", f"{names}: pass") if out else ()
    left = next((text for text in texts if height(text) <= room - len(kept)), "")
    return tuple(bar for bar in bars if bar in kept), tuple(filter(None, [left]))


def _used(bar: Bar) -> str:
    return bar.used.replace(" of the limit", "")


def _warnings(warnings: Sequence[str], room: int) -> Iterator[str]:
    """Yield the first clauses of the warnings that fit into so many lines, with numbers first."""
    short = [f"warning: {text.partition('; ')[0]}" for text in map(readable, warnings)]
    for text in sorted(short, key=lambda text: not any(map(str.isdigit, text))):
        if height(text) <= room:
            room -= height(text)
            yield text
