"""The checks of a verdict: a bar to each limit, what decides the outcome, and the margins."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from taction.system.quantities import readable
from taction.verification.report.blocks import Bar
from taction.verification.report.texts import KNOWN, LEAST_SHARE, figure, spaced, with_error
from taction.verification.studies.questions import QUESTIONS
from taction.verification.verdict.cause import band_text, causes, listed, named
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.verify import Verdict

LIMITED = ("settling_time", "rise_time")  # checks that may have a smallest accepted value, too
MARGINS = (
    "The bar is the part of the limit that is used, the thin line on its end the uncertainty. A"
    " check is inconclusive where the uncertainty reaches the limit. Blue and solid: within the"
    " limit. Orange and hatched: beyond it. Dotted: not decided."
    f" {KNOWN}"
)


def decisive_text(checks: Sequence[Check], outcome: str) -> str:
    """Return what decides the outcome of a verdict in a sentence."""
    found = [*causes(checks)]
    if not found:
        nearest = nearest_bar(checks)
        near = (
            "" if nearest is None else f"; {nearest.name} is nearest to its limit ({nearest.used})"
        )
        every = f"All {len(checks)} checks pass" if len(checks) > 1 else "The check passes"
        return f"{every}{near}."
    first, *others = found
    text = readable(first.text)
    if first.follows and outcome == Outcome.FAIL.value:
        text += f"; from this follow {listed(first.follows)}"
    undecided = {check.name for check in checks if check.outcome is Outcome.INCONCLUSIVE}
    failed = [readable(each.title) for each in others if each.check not in undecided]
    open_ = [name for each in others if each.check in undecided for name in named(each)]
    more = [f"{listed(open_)} not decided"] if open_ else []
    return "; ".join((text, *failed, *more))


def nearest_bar(checks: Sequence[Check]) -> Bar | None:
    """Return the check that is nearest to its limit; None where no limit has a distance."""
    bars = [bar for bar in map(check_bar, checks) if bar.share is not None]
    return max(bars, key=lambda bar: bar.share or 0.0, default=None)


def check_bars(verdict: Verdict) -> tuple[Bar, ...]:
    """Return the checks of a verdict as bars, in their order."""
    limits = {name: getattr(verdict.scene.checks, name) for name in LIMITED}
    least = {name: each.min for name, each in limits.items() if each and each.min is not None}
    return tuple(check_bar(check, least.get(check.name)) for check in verdict.checks)


def check_bar(check: Check, smallest: float | None = None) -> Bar:
    """Return a check as a bar; below `smallest`, the bar shows how far.

    Examples
    --------
    >>> from taction.verification.verdict.checks import Outcome
    >>> bar = check_bar(Check("overshoot", Outcome.PASS, 0.1, 0.01, 0.4, None, "step", ""))
    >>> bar.value, bar.limit, bar.used
    ('10 % ± 1 %', 'at most 40 %', '25 % of the limit')
    """
    value, unit = check.value, check.unit
    limit = check.tolerance if check.tolerance is not None else check.expected
    question = QUESTIONS.get(check.name)
    least = question.large if question else check.name == "stability" and unit == "ratio"
    if smallest is not None and value is not None and value < smallest:
        limit, least = smallest, True
    centre = (check.expected or 0.0) if check.tolerance is not None else 0.0
    off = None if value is None else value - centre
    share, doubt = _share(off, limit, check.uncertainty or 0.0, least=least)
    side = "at least" if least else "below" if unit == "1/s" else "at most"
    side = f"{figure(centre, unit)} ±" if centre else side
    band = band_text(check)
    shown = with_error(value, check.uncertainty, unit)
    if value is None and check.outcome is Outcome.PASS:  # the reason says what limits the board
        limit, shown = None, readable(check.reason.partition("; ")[0])
    return Bar(
        name=f"settling {band}" if band else spaced(check.name),
        outcome=check.outcome.value,
        share=share,
        doubt=doubt,
        value=shown,
        limit="" if limit is None else f"{side} {_limit(limit, unit)}",
        reason=readable(check.reason.replace("to ±", "within ±")),
    )


def _limit(limit: float, unit: str) -> str:
    """Return a limit as text: one below a millionth of the step keeps its number."""
    small = unit == "step" and 0.0 < limit < LEAST_SHARE
    return f"{limit:g} of the step" if small else figure(limit, unit)


def _share(
    value: float | None, limit: float | None, error: float, *, least: bool
) -> tuple[float | None, float]:
    """Return the part of the limit that a value uses, and its uncertainty."""
    if value is None or limit is None or not math.isfinite(value) or limit <= 0.0:
        return None, 0.0
    error = error if math.isfinite(error) else 0.0
    if not least:
        return abs(value) / limit, error / limit
    return (limit / value, limit * error / value**2) if value > 0.0 else (None, 0.0)


def margin_lines(document: Mapping[str, Any]) -> Iterator[str]:
    """Yield the stability margins that were asked for."""
    for margin in document.get("stability", {}).get("margins", {}).values():
        doubt = f", but {margin['doubt']}" if margin["doubt"] else ""
        yield f"margin: {margin['text']}{doubt}"
