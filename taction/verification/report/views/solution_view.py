"""Numbers without a verdict: a numerical solution, and the measurements of a transient."""

from __future__ import annotations

from collections.abc import Iterator

from taction.verification.reference.problem import Solution
from taction.verification.report.blocks import EVERYWHERE, Notes, Page, Section
from taction.verification.report.views.verdict_view import channel_table
from taction.verification.verdict.record import channels_of
from taction.verification.verdict.recording import MeasuredTransient


def view(result: Solution) -> Page:
    """Return the page of a solution and its certificate."""
    return Page(
        title="numerical solution",
        command="taction verify --solve",
        sections=(Section("Solution", (Notes("", tuple(_lines(result))),), media=EVERYWHERE),),
    )


def _lines(solution: Solution) -> Iterator[str]:
    for n, value in enumerate(solution.u.tolist(), 1):
        yield f"u_{n} = {value!r}"
    yield f"lambda = {solution.lam!r}, objective = {solution.objective!r}"
    yield (
        f"{solution.certificate_kind} {solution.certificate:.3g} (bound {solution.bound:.3g});"
        f" error in u at most {solution.error_bound:.2g}; condition {solution.condition:.3g};"
        f" {solution.iterations} iterations, {1e3 * solution.seconds:.2f} ms"
    )
    if not solution.trusted:
        yield f"inconclusive: {solution.reason}"


def transient_view(result: MeasuredTransient) -> Page:
    """Return the page of the measurements of a transient, and what it cost."""
    cost, channels = result.waveforms.cost, channels_of(result.measurements)
    table = channel_table(channels, result.measurements.band)
    return Page(
        title=result.circuit.name,
        command="taction export waveforms",
        sections=(Section("Channels", (table,), media=EVERYWHERE),),
        foot=(f"{result.waveforms.simulator}: {cost.points} points, {cost.seconds:.3g} s",),
    )
