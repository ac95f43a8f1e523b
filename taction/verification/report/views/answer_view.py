"""What many pages show: the answer's error, checks with bars to their limits, origins.

`screen` is a verdict on one screen of a terminal.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from taction.netlist_gen.scene.keys import files_of
from taction.netlist_gen.scene.scene import Scene
from taction.system.quantities import counted, percent, quantity, readable, spaced
from taction.verification.report.blocks import Bar, Bars, Content, Page, Section
from taction.verification.report.texts import KNOWN, LEAST_SHARE, figure, rounded_up, with_error
from taction.verification.studies.running.versions import describe_machine, digest, own_code
from taction.verification.verdict.answer_error import AnswerError
from taction.verification.verdict.checks import Check, Outcome, band_text, cause, causes, listed
from taction.verification.verdict.input_spread import SHARE
from taction.verification.verdict.run_checks import CHECKS
from taction.verification.verdict.verify import Verdict


def answer_text(answer: AnswerError) -> str:
    """Return in a sentence how far the board is from the answer, and the answer from the truth.

    The board is measured in shares of the step, rounded up. The sentence is empty for a board that
    does not come to rest at the answer, and where the answer cannot be trusted.
    """
    if answer.board is None or not answer.unit:
        return ""
    built, near = answer.built, _within(answer.board + answer.board_error, answer.step)
    text = f"The board as drawn finds the regularised answer {near} of the step"
    if built is not None and built.known:
        wide = _within(built.distance + built.error, answer.step)
        text += f", {100 * SHARE:g} % of built boards {wide} ({built.covers})"
    return f"{text}; {_truth(answer, 'that answer')}."


def yield_text(answer: AnswerError) -> str:
    """Return what a board that passes as drawn says of built ones; empty if most pass."""
    built = answer.built
    if built is None or (built.known and built.most >= SHARE):
        return ""
    if not built.known:
        return (
            "passes as drawn; how many built boards pass is not known for so many parts"
            f" ({built.covers}): 'taction yield montecarlo' draws some"
        )
    at_most = percent(rounded_up(built.most, 2)) if built.most else "0 %"
    return (
        f"passes as drawn; at most {at_most} of built boards pass: the others rest beyond"
        f" {percent(built.limit)} of the step ({built.covers})"
    )


def true_error_text(answer: AnswerError) -> str:
    """Return in a sentence how far the answer is from the true stress, and why."""
    text = _truth(answer, "the regularised answer")
    return f"{text[:1].upper()}{text[1:]}."


def of_unit(answer: AnswerError) -> str:
    """Return what every share of an answer's error is a fraction of."""
    known = answer.stress is not None and answer.stress.any()
    return f"of the largest {'true ' * bool(known)}stress, {quantity(answer.unit, 'V', 3)}"


def _within(volts: float, unit: float) -> str:
    """Return a bound as a fraction of `unit`, rounded up."""
    share = volts / unit
    up = "1 ppm" if share <= LEAST_SHARE else figure(rounded_up(share, 2), "step")
    return f"within {up}"


def _truth(answer: AnswerError, subject: str) -> str:
    """Return how far the answer is from the true stress, and why."""
    stress, far, n = answer.stress, answer.true_error, answer.channel
    if stress is None:
        return "the true stress is not known"
    if not stress.any():
        return "the true stress is zero"
    if far is None or n is None:
        return f"{subject} cannot be trusted"
    off = far * answer.unit + answer.target_error
    if off <= max(2.0 * answer.target_error, LEAST_SHARE * answer.unit):
        return f"{subject} is the true stress {_within(off, answer.unit)}"
    unit = f"(of the largest, {quantity(answer.unit, 'V', 3)})"
    text = f"{subject} is {figure(far, 'step', 3)} {unit} from the true stress"
    place = f" in channel {n}" if len(stress) > 1 else ""
    return f"{text}{place}, because of {_causes(answer)}{_lambda(answer)}"


def _lambda(answer: AnswerError) -> str:
    """Return what another lambda does to an error; empty where lambda is 0 or a cause unknown."""
    if not answer.regularisation or answer.noise is None:
        return ""
    if abs(answer.regularisation) >= abs(answer.noise):
        return "; a smaller lambda regularises less, but lets more noise through"
    return "; a larger lambda lets less noise through, but regularises more"


def _causes(answer: AnswerError) -> str:
    """Return the causes with their shares, the larger one first; they add up to the error."""
    if answer.regularisation is None or answer.noise is None:
        return "regularisation and strain noise (their shares are not known)"
    shares = {"regularisation": answer.regularisation, "strain noise": answer.noise}
    first, second = sorted(shares, key=lambda name: -shares[name])
    if not shares[second]:
        return f"{first} alone"
    joint = " and" if shares[second] > 0.0 else ", partly cancelled by"
    large, small = (figure(abs(shares[name]), "step", 3) for name in (first, second))
    return f"{first} ({large}){joint} {second} ({small})"


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
        text = f"All {len(checks)} checks pass" if len(checks) > 1 else "The check passes"
        if (nearest := nearest_bar(checks)) is not None:
            text += f"; {nearest.name} is nearest to its limit ({nearest.used})"
        return f"{text}."
    first, *others = found
    text = readable(first.text)
    if first.follows and outcome == Outcome.FAIL.value:
        text += f"; from this follow {listed(first.follows)}"
    undecided = {check.name for check in checks if check.outcome is Outcome.INCONCLUSIVE}
    failed = [readable(each.title) for each in others if each.check not in undecided]
    same = (each for each in others if each.check in undecided)
    open_ = [name for each in same for name in (each.check, *each.follows)]
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
    """Return a check as a bar; below `smallest`, the bar shows how far."""
    value, unit = check.value, check.unit
    limit = check.tolerance if check.tolerance is not None else check.expected
    least = check.name == "stability" and unit == "ratio"
    if check.name not in CHECKS:  # of a deck
        from taction.verification.studies.decks.questions import QUESTIONS

        least = check.name in QUESTIONS and QUESTIONS[check.name].large
    if smallest is not None and value is not None and value < smallest:
        limit, least = smallest, True
    centre = (check.expected or 0.0) if check.tolerance is not None else 0.0
    off = None if value is None else value - centre
    share, doubt = _share(off, limit, check.uncertainty or 0.0, least=least)
    side = "at least" if least else "below" if unit == "1/s" else "at most"
    side = f"{figure(centre, unit)} ±" if centre else side
    band = band_text(check)
    shown = with_error(value, check.uncertainty, unit)
    if least and check.uncertainty is None and check.outcome is Outcome.PASS:
        shown = f"{figure(value, unit)} or more"  # the search of the margin ends there
    small = unit == "step" and limit is not None and 0.0 < limit < LEAST_SHARE  # it has a number
    words = f"{limit:g} of the step" if small else figure(limit, unit)
    if value is None and check.outcome is Outcome.PASS:  # the reason says what limits the board
        limit, shown = None, readable(check.reason.partition("; ")[0])
    return Bar(
        name=f"settling {band}" if band else spaced(check.name),
        outcome=check.outcome.value,
        share=share,
        doubt=doubt,
        value=shown,
        limit="" if limit is None else f"{side} {words}",
        reason=readable(check.reason.replace("to ±", "within ±")),
    )


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


Rows = tuple[tuple[str, str], ...]
SHOWN = ("date", "taction", "python", "numpy", "scipy", "ngspice", "system", "processor", "cores")


def origin_section(scene: Scene | None, more: Rows = ()) -> Section:
    """Return the versions and hashes behind a page, after the rows `more`; None: many scenes."""
    return Section("Versions and hashes", lambda: dict(_rows(scene, more)), media="page")


def _rows(scene: Scene | None, more: Rows) -> Iterator[tuple[str, str]]:
    """Yield versions, machine, and the SHA-256 of every file that the scene was read from."""
    if scene is not None:
        yield "scene file", str(scene.file)
    yield from more
    machine = describe_machine()
    yield from ((name, "none" if machine[name] is None else str(machine[name])) for name in SHOWN)
    if scene is None:
        return
    yield "SHA-256 of taction's source", own_code().hex()
    for key, value in {"": str(scene.file), **files_of(scene)}.items():
        if isinstance(value, str | Path):
            file = scene.folder / value if key else Path(value)
            if file.is_file():  # it may be gone since the run
                yield f"SHA-256 of {value}", hashlib.sha256(file.read_bytes()).hexdigest()
        elif value is not None:
            yield f"SHA-256 of {key}, an array", digest(value).hex()


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
    # The first clauses of the warnings, those with numbers first.
    short = [f"warning: {text.partition('; ')[0]}" for text in map(readable, verdict.warnings)]
    contents: tuple[Content, ...] = (
        Bars("", tuple(bar for check, bar in pairs if check.name not in known), brief=True),
        yield_text(verdict.answer) if verdict.outcome is Outcome.PASS else "",
        _distance(verdict, margins),
        answer_text(verdict.answer),
        *sorted(short, key=lambda text: not any(map(str.isdigit, text)))[:WARNINGS],
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
