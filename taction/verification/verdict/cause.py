"""Why a verdict is no pass: the one cause, with value and limit, and what follows from it.

A board that oscillates never settles, never rests, and has no largest overshoot: four checks fail,
for one cause.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal

from taction.system.quantities import show, spaced
from taction.verification.verdict.checks import SPREAD, Check, Outcome

FIRST = ("same_problem", "stability", "steady_state")
"""Checks whose failure explains others; of several failures the first of these is named."""
SAYING = {
    "steady_state": "rests {} off the reference",
    "settling_time": "settles in {}",  # with its band
    "rise_time": "rises in {}",
    "overshoot": "overshoots by {}",
    "undershoot": "undershoots by {}",
    "stability": "has a stability margin of {}",
    "noise": "has an output noise of {}",
    "engines_agree": "differs by {} between two engines",
}
"""What a failed check says of the board; for another one, or without a value, its reason does."""
VALUELESS = ("headroom",)  # the reason has the value and the limit of the op-amp


@dataclass(frozen=True, slots=True)
class Cause:
    """Why a verdict is no pass."""

    check: str  # the check that names the cause
    title: str  # the cause in a few words; of a failed check with value and limit
    text: str  # the same in full
    follows: tuple[str, ...] = ()  # the checks that fail, or are not decided, for the same cause


def cause(checks: Sequence[Check]) -> Cause | None:
    """Return the first of `causes`; None if all checks pass."""
    return next(causes(checks), None)


def causes(checks: Sequence[Check]) -> Iterator[Cause]:
    """Yield every cause for which checks are no pass, those of failures first."""
    follows = following(checks)
    own = [check for check in checks if check.name not in follows]
    failed = [check for check in own if check.outcome is Outcome.FAIL]
    failed.sort(key=lambda check: FIRST.index(check.name) if check.name in FIRST else len(FIRST))
    for number, check in enumerate(failed):
        text = said(check)
        yield Cause(check.name, text, text, () if number else follows)
    alike: dict[str, list[str]] = {}
    for check in own:
        if check.outcome is Outcome.INCONCLUSIVE:
            alike.setdefault(check.reason, []).append(check.name)
    for reason, (name, *others) in alike.items():
        title = f"{listed((name, *others))} not decided"
        yield Cause(name, title, f"{title}: {reason}", tuple(others))
    if not checks:
        yield Cause("", "no check was made", "no check was made")


def named(found: Cause) -> tuple[str, ...]:
    """Return the checks of a cause."""
    return (found.check, *found.follows)


def following(checks: Sequence[Check]) -> tuple[str, ...]:
    """Return the checks that fail, or are not decided, only because another one fails."""
    failed = {check.name: check for check in checks if check.outcome is Outcome.FAIL}
    stability, steady = failed.get("stability"), failed.get("steady_state")
    if stability is not None and is_unstable(stability):
        lost = (check.name for check in checks if check.outcome is not Outcome.PASS)
        return tuple(name for name in lost if name not in FIRST[:2])
    if steady is None:
        return ()
    lost = (name for name, check in failed.items() if check.value is None and check.unit == "s")
    if _keeps_limit(steady):
        lost = (name for name, check in failed.items() if _keeps_limit(check) or not check.value)
    return tuple(name for name in lost if name not in FIRST)


def is_unstable(stability: Check) -> bool:
    """Whether a failed check of the stability is that of an unstable board."""
    return stability.unit == "1/s" or not stability.value


def said(check: Check) -> str:
    """Return what a failed check says of the board, with value and limit."""
    unstable = check.name == "stability" and is_unstable(check)
    if unstable or check.value is None or _keeps_limit(check) or check.name in VALUELESS:
        text = check.reason.partition("; ")[0]
        return f"{text} (limit: below 0 /s)" if unstable else text
    text = SAYING.get(check.name, f"{spaced(check.name)}: {{}}")
    text = text.replace("settles", f"settles {band_text(check)}".rstrip(), 1)
    if SPREAD in check.reason:
        text = f"{text.replace('rests', 'rests up to')} in {SPREAD}"
    return f"{text.format(amount(check.value, check.unit))}{_missed(check, check.value)}"


def band_text(check: Check) -> str:
    """Return the band of a settling time: ``"to ±1 %"``; empty for another check."""
    return "" if check.band is None else f"to ±{100.0 * check.band:g} %"


def boards_text(check: Check) -> str:
    """Return which boards rest as a check of the steady state says; empty for another check."""
    if check.name != "steady_state" or check.value is None:
        return ""
    return f"in {SPREAD}" if SPREAD in check.reason else "as drawn"


def _missed(check: Check, value: float) -> str:
    """Return the limit that a value misses: the upper one, or for a small one the least."""
    limit, least = _limit(check), check.reason.rpartition("; ")[2]
    if limit is not None and check.tolerance is not None and check.expected:
        wanted = amount(check.expected, check.unit)
        return f" (expected: {wanted} ± {amount(limit, check.unit)})"
    if limit is None or value < limit:
        if least.startswith("at least "):  # the scene has a smallest time, too
            return f" (limit: {least})"
        return "" if limit is None else f" (limit: at least {amount(limit, check.unit)})"
    return f" (limit: at most {amount(limit, check.unit)})"


def _limit(check: Check) -> float | None:
    return check.expected if check.tolerance is None else check.tolerance


def _keeps_limit(check: Check) -> bool:
    """Whether the value alone keeps the limit: the outputs do not come to rest."""
    limit = _limit(check)
    known = check.unit == "step" and check.value is not None and limit is not None
    return known and abs(check.value or 0.0) <= (limit or 0.0)


def amount(value: float, unit: str) -> str:
    """Return a value of a check with its unit."""
    if unit == "step":
        return f"{Decimal(f'{100.0 * value:.3g}'):f} %"
    return f"{value:.4g}" if unit in ("", "ratio") else show(value, unit)


def listed(names: Sequence[str]) -> str:
    """Return names of checks in words: ``"steady state, overshoot"``."""
    return ", ".join(map(spaced, names))
