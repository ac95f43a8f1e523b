"""What is judged of a measured deck: expected voltages, the questions that are asked, stability."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from taction.system.array_types import EPS
from taction.system.quantities import show_rate
from taction.verification.stability.margin import Margin
from taction.verification.stability.poles import Poles
from taction.verification.studies.decks.measured_board import LATCH, WANTED, MeasuredBoard
from taction.verification.studies.decks.questions import QUESTIONS, Expected, Wanted
from taction.verification.verdict.board import SteadyState
from taction.verification.verdict.cause import cause
from taction.verification.verdict.checks import Check, Evidence, Outcome, at_most, doubtful, overall
from taction.verification.verdict.record import (
    STATES,
    Channel,
    Figure,
    FigureRule,
    Record,
    finite,
    three,
)
from taction.verification.verdict.run import StepError
from taction.verification.verdict.run_checks import run_checks

NOTHING_ASKED = Wanted()


def judge(
    found: MeasuredBoard,
    asked: Wanted,
    margin: Margin | None = None,
) -> Iterator[Check]:
    """Yield the expected values, then the limits that were asked for."""
    yield from (_expected(found, each) for each in asked.expected)
    evidence = Evidence(
        limits=asked.limits,
        measurements=found.measurements,
        error=StepError.of(found.measurements, 0.0),
        steady=SteadyState.of(found.board, found.scales),
        end=math.inf,
        forever=True,
        wanted=WANTED,
        agreement=None,
        poles=found.poles,
        margin=margin if asked.margin else None,
        reference_error=0.0,
        reference_problem="",
        noise=found.noise if asked.limits.noise is not None else None,
    )
    for check in run_checks(evidence):
        if check.name == "stability" and evidence.growth:
            check = replace(check, reason=f"{check.reason}; {found.remedy}")
        if check.name in asked.names:
            yield check
    yield from (QUESTIONS[name].check(found, limit) for name, limit in asked.own.items())
    if asked.oscillates:
        yield _oscillates(found.poles)


def _expected(found: MeasuredBoard, wanted: Expected) -> Check:
    """Compare the equilibrium of a node with an expected value."""
    name, place = f"v({wanted.node})", found.board.descriptor.place(wanted.node)
    value = float(found.board.equilibrium.values[place])
    error = max(float(found.board.rounding[place]), EPS * abs(value))
    outcome, reason = at_most(abs(value - wanted.volts), error, wanted.tolerance), "equilibrium"
    if not found.poles.known_stable:
        reason = "the board is not stable: it does not come to rest there"
        outcome = Outcome.FAIL if found.poles.known_unstable else Outcome.INCONCLUSIVE
    return Check(name, outcome, value, error, wanted.volts, wanted.tolerance, "V", reason)


def _oscillates(found: Poles) -> Check:
    """Pass a board in which a complex pair grows, and no real pole.

    The value is the frequency of the fastest growing pair; how far the board swings, and how much
    this moves the frequency, its linear model does not say.
    """

    def check(outcome: Outcome, reason: str, pole: complex = 0.0, error: float = 0.0) -> Check:
        value, bound = (abs(pole.imag) / math.tau, error / math.tau) if pole else (None, None)
        return Check("oscillates", outcome, value, bound, None, None, "Hz", reason)

    p, errors = found.poles, found.errors
    growing, may_grow = p.real > errors, p.real >= -errors
    pairs, real = np.abs(p.imag) > errors, p.imag == 0.0
    if np.any(growing & real):
        return check(Outcome.FAIL, f"runs away, a real pole grows: {LATCH}")
    if np.any(may_grow & ~pairs) or (np.any(may_grow) and not np.any(growing)):
        return check(Outcome.INCONCLUSIVE, doubtful(found))
    if not np.any(growing):
        return check(Outcome.FAIL, "every mode decays")
    first = int(np.argmax(growing))
    reason = f"grows with {show_rate(p.real[first])}; of its start, before anything limits it"
    return check(Outcome.PASS, reason, complex(p[first]), float(errors[first]))


def record_of(
    found: MeasuredBoard,
    checks: Iterable[Check] = (),
    asked: Wanted = NOTHING_ASKED,
    margin: Margin | None = None,
) -> Record:
    """Return what is known of a board as a record; its outcome is that of the checks."""
    judged, poles = tuple(checks), found.poles
    decisive, lead = cause(judged), poles.rightmost if len(poles.poles) else None
    figures = {
        each.name: FigureRule(each.unit, each.worst).figure(found)
        if each.over or each.name in asked.names
        else Figure(None, each.unit)
        for each in QUESTIONS.values()
    }
    bound = finite(poles.resolution)
    figures |= {
        "growth_rate": Figure(None if lead is None else lead.real, "1/s", bound),
        "frequency": Figure(
            None if lead is None else abs(lead.imag) / math.tau,
            "Hz",
            None if bound is None else bound / math.tau,
        ),
        "step_amplitude": Figure(found.measurements.amplitude, "V", 2.0 * found.rest_error),
        "margin": Figure(None if margin is None else margin.factor),
    }
    channels = found.measurements.channels
    rests = [{"equilibrium": Figure(v, "V", found.rest_error)} for v in found.rest.tolist()]
    return Record(
        overall(judged).value if judged else Outcome.PASS.value,
        "statespace",
        "statespace",
        None,
        "" if decisive is None else decisive.text,
        max((each.state for each in channels), key=STATES.index).value,
        poles.stable,
        *three(figures),
        judged,
        tuple(map(Channel.of, channels, rests)),
    )
