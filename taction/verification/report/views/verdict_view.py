"""A verdict: checks, channels, waveforms, stability, error budget, headroom, board and deck."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from taction.netlist_gen.board.circuit import Circuit, Role
from taction.system.errors import SolverError
from taction.system.quantities import banded, quantity, readable
from taction.system.reading_definitions import EXCURSIONS, READINGS, TIMES
from taction.verification.reference.problem import Solution
from taction.verification.report import blocks
from taction.verification.report.blocks import Bars, Content, Notes, Page, Section, Table
from taction.verification.report.texts import Cell, Column, fields, figure, number_cell, rounded_up
from taction.verification.report.views import answer_view as answers
from taction.verification.report.views import board_view as boards
from taction.verification.report.views import waveforms_view as waveforms
from taction.verification.report.views.opamp_view import counts_text, packages_text
from taction.verification.report.views.stability_view import stability_blocks
from taction.verification.verdict.answer_error import ErrorPart, worst_channel
from taction.verification.verdict.board_files import KICAD, OWN, REPORT, BuiltBoard
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.headroom import Load
from taction.verification.verdict.record import Channel, Record
from taction.verification.verdict.verify import Verdict

LOADS = 16  # of op-amps that are shown
SHOWN = dict.fromkeys((blocks.PAGE, blocks.TERMINAL), 8)  # parts that move the rest
ROUNDING = 16.0 * float(np.finfo(np.float64).eps)  # of the step: a smaller part is rounding
LEAST = 1e-9  # of the largest stress: a smaller part has no number
REACH = "What the outputs of the op-amps reach, as parts of the limits of the data sheet."
LIMITED = (
    " The simulated op-amps have these limits. A bar beyond its limit is what the same op-amp"
    " without limits would have to do."
)


def view(
    verdict: Verdict,
    command: str = "taction verify",
    changes: str = "",
    *,
    notes: Sequence[str] = (),
    verbose: bool = False,
) -> Page:
    """Return what a verdict shows; a `verbose` terminal has the error budget and the cost, too.

    `changes` are lines about what can mend it, of which the first introduces the others; `notes`
    stand below the checks, such as the margins.
    """
    circuit, waves, scene = verdict.circuit, verdict.waveforms, verdict.scene
    engine = tuple((name, getattr(waves, name) or "–") for name in ("engine", "solver", "method"))
    detailed = "terminal page" if verbose else "page"
    first, *mends = [readable(line.strip()) for line in changes.splitlines()] or [""]
    lead = first.removesuffix(":").removeprefix("what to change").strip()
    records = (waveforms.outputs_chart, waveforms.deviation_chart, waveforms.difference_chart)
    return Page(
        title=scene.name,
        command=command,
        outcome=verdict.outcome.value,
        summary=answers.decisive_text(verdict.checks, verdict.outcome.value),
        lines=boards.board_lines(verdict),
        sections=(
            Section("Checks", lambda: _checks(verdict, notes), media="terminal page notebook"),
            Section(
                "What to change",
                mends,
                f"The nearest changes that mend the verdict {lead}".rstrip() + ".",
            ),
            Section("Waveforms", lambda: [f(verdict) for f in records], media="page picture"),
            Section("Waveforms", lambda: _channels(verdict)),
            Section("Stability", lambda: stability_blocks(circuit, verdict.poles), media="page"),
            Section(
                "Recovered stress", lambda: waveforms.stress_chart(verdict), media="page picture"
            ),
            Section("Checks", lambda: Bars("", answers.check_bars(verdict)), media="picture"),
            Section("Error budget", lambda: budget_table(verdict), media=detailed),
            Section("Error budget", lambda: _rest_parts(verdict), media=detailed),
            Section("Headroom", lambda: _headroom(verdict)),
            Section("Error and run time", lambda: _effort(verdict), media=detailed),
            Section("Board", lambda: boards.board_blocks(circuit, scene), media="page"),
            Section("Left out", lambda: boards.omissions(circuit), media="page"),
            Section("Parts list", lambda: boards.parts_blocks(circuit, scene), media="page"),
            Section("Deck", lambda: boards.deck_blocks(verdict), media="page"),
            answers.origin_section(scene, engine),
        ),
        foot=(_cost(verdict),),
    )


def _cost(verdict: Verdict) -> str:
    """Return the engine, the error that it reached, and the run time."""
    accuracy, waves = verdict.accuracy, verdict.waveforms
    error = "error unknown"
    if accuracy.achieved is not None:
        error = f"error {figure(accuracy.achieved, 'step', 2)} of the step"
    allowed = ""
    if accuracy.asked:
        missed = "" if accuracy.reached else ", NOT reached"
        allowed = f", {figure(accuracy.wanted, 'step')} allowed{missed}"
    seconds = quantity(verdict.timing["total"], "s", 3)
    return f"simulated by {waves.simulator}: {error}{allowed}; {seconds} in all"


def _checks(verdict: Verdict, notes: Sequence[str]) -> Iterator[Content]:
    yield Bars("", answers.check_bars(verdict), answers.MARGINS)
    if verdict.outcome is Outcome.PASS:
        yield answers.yield_text(verdict.answer)
    yield answers.answer_text(verdict.answer)
    yield from map(readable, notes)
    yield Notes("Warnings", tuple(map(readable, verdict.warnings)))


def _channels(verdict: Verdict) -> Table:
    noise = () if verdict.noise is None or verdict.noise.unknown else verdict.noise.rms
    return channel_table(Record.of(verdict).channels, verdict.measurements.band, noise)


def channel_table(channels: Sequence[Channel], band: float, noise: Sequence[float] = ()) -> Table:
    """Return every channel from 1, settled to `band`; `noise` (N,), V, has a column."""
    columns: dict[str, Column] = {
        "channel": lambda each: Cell(f"u{each.index}", each.index),
        **fields("target = figures.reference V"),
    }
    if any(each.figures["equilibrium"] is not None for each in channels):
        columns["at rest"] = lambda each: number_cell(each.figures.get("equilibrium"), "V")
    columns |= fields("end = figures.final V")
    for name, known in READINGS.items():
        title = banded(known.short, band) if name in TIMES else name
        columns[title] = partial(_reading, name)
    if noise:
        columns["output noise, rms"] = lambda each: number_cell(noise[each.index - 1], "V", 3)
    columns["state"] = "state"
    note = f"{' and '.join(EXCURSIONS).capitalize()} are in % of the step of the network."
    return Table.of("Channels", channels, columns, note)


def _reading(name: str, channel: Channel) -> Cell | None:
    reading = channel.figure(name)
    value, error = reading.value, reading.uncertainty
    if value is None:
        return None
    if name in EXCURSIONS:
        if error is not None and 0.0 < abs(value) <= error < 1.0:  # only the bound is known
            return Cell(f"<{100 * rounded_up(2.0 * error):.1g} %", value)
        return number_cell(value, "step", 3)
    text = quantity(value, "s")
    if reading.fragile and reading.alternative is not None:
        text += f" (fragile: or {quantity(reading.alternative, 's')})"
    return Cell(text, value)


def _headroom(verdict: Verdict) -> Content:
    """Return what the op-amps have to do beside their limits, the largest share first."""
    loads = (*verdict.parts.simulated, *verdict.parts.loads)
    if not loads:
        return "No op-amp of this board has a limit of slew rate, swing or current in its model."
    limited = not verdict.circuit.is_small_signal
    more = len(loads) - LOADS
    note = REACH + LIMITED * limited + f" {more} smaller loads are not shown." * (more > 0)
    return load_bars(loads, note, limited=limited)


def load_bars(loads: Iterable[Load], note: str = "", *, limited: bool = False) -> Bars:
    """Return loads of op-amps, the largest share first; `limited` ones decide nothing."""
    bars = []
    for load in sorted(loads, key=lambda load: -load.share)[:LOADS]:
        at = "at rest" if math.isinf(load.at) else f"at {figure(load.at, 's', 3)}"
        error = load.error if math.isfinite(load.error) else 0.0
        bar = blocks.Bar(
            name=f"{load.quantity} of {load.part}",
            outcome="" if limited else "fail" if load.share > 1.0 else "pass",
            share=load.share,
            doubt=error / load.limit,
            value=f"{figure(load.peak, load.unit, 3)} {at}",
            limit=f"at most {figure(load.limit, load.unit, 3)}",
        )
        bars.append(bar)
    return Bars("", tuple(bars), note)


def _volts(value: float | None, verdict: Verdict) -> Cell:
    """Return a part of the error, V; one too small to matter has no number, and sorts as none."""
    if value is None or not math.isfinite(value):
        return Cell("unknown")
    if _is_rounding(value, verdict):
        return Cell("below rounding")
    known = not value or abs(value) > LEAST * verdict.answer.unit
    return Cell(quantity(value, "V", 3) if known else "under 1 ppb", value)


def _is_rounding(value: float, verdict: Verdict) -> bool:
    """Whether a part of the error, V, is no more than rounding."""
    known = verdict.ideal.error if math.isfinite(verdict.ideal.error) else 0.0
    return 0.0 < abs(value) <= max(known, ROUNDING) * verdict.measurements.amplitude


def budget_table(verdict: Verdict) -> Table | None:
    """Return the error budget as a table; the signed column is that of the worst channel."""
    budget, unit = verdict.budget, verdict.answer.unit
    parts, total = list(budget), budget.total

    def share(part: ErrorPart) -> Cell | None:
        value = part.value
        known = value is not None and math.isfinite(value) and unit
        if value is None or not known or _is_rounding(value, verdict):
            return None
        return Cell(figure(value / unit, "step", 3), value)

    columns: dict[str, Column] = {
        "error": "name words",
        "largest of any channel": lambda part: _volts(part.value, verdict),
        "of the largest stress": share,
    }
    note = f"% {answers.of_unit(verdict.answer)}."
    if total is not None:
        sums, worst = tuple(budget.summed), worst_channel(np.array(total.channels))
        parts.append(ErrorPart("sum of the parts", max(map(abs, sums)), "", channels=sums))
        parts.append(ErrorPart("whole", total.value, total.how, channels=total.channels))
        columns[f"channel {worst + 1}"] = lambda part: (
            _volts(part.channels[worst], verdict) if part.channels else None
        )
    else:
        note += " The parts do not add up: a solution between them is not known."
    columns["how it was found"] = lambda part: readable(part.how)
    return Table.of("Parts of the error", parts, columns, note) if parts else None


def _rest_parts(verdict: Verdict) -> Table | None:
    """Return the parts whose deviations move the rest of built boards most; None without any."""
    built, board = verdict.answer.built, verdict.board
    if built is None or not built.known:
        return None
    spread = board.built_spread(board.scene.tolerances)
    if spread is None or not spread.sigma.any():
        return None
    worst = worst_channel(spread.sigma)
    moves, sigma = spread.rows[:, worst], float(spread.sigma[worst])
    order = np.argsort(-np.round(np.abs(moves) / sigma, 9), kind="stable").tolist()
    columns: dict[str, Column] = {
        "part": lambda k: spread.names[k],
        f"moves u{worst + 1} by": lambda k: number_cell(float(moves[k]), "V", 3),
        "of the variance": lambda k: number_cell(float(moves[k] / sigma) ** 2, "step", 3),
    }
    note = f"One standard deviation of each; {quantity(sigma, 'V', 3)} with all ({built.varies})."
    more = "{} others move it by no more."
    return Table.of("What moves the rest most", order, columns, note, SHOWN, more)


def _effort(verdict: Verdict) -> dict[str, str]:
    """Return the requested and the reached error of the run, and its cost."""
    accuracy, waves, solution = verdict.accuracy, verdict.waveforms, verdict.ideal.solution
    reached = accuracy.achieved
    facts = {
        "requested error": f"{figure(accuracy.wanted, 'step')} of the step",
        "reached error": "unknown" if reached is None else f"{figure(reached, 'step')} of the step",
        "how it is known": f"{accuracy.method} ({accuracy.how})",
        "simulation": f"{quantity(accuracy.seconds, 's', 3)}, tries: {accuracy.tries}",
        "points": f"{waves.cost.points} up to {quantity(verdict.transient.stop, 's')}",
        "largest step": quantity(waves.spacing, "s", 3),
        "reference": f"{solution.certificate_kind} {solution.certificate:.2g}, bound"
        f" {solution.bound:.2g}",
    }
    if plane := _constraint_plane(verdict.circuit):
        facts["constraint plane"] = plane
    if verdict.ideal.network.RC:  # without capacitors it is at rest at once
        facts |= _ideal_flow(verdict)
    stages = (f"{name} {seconds:.2f} s" for name, seconds in verdict.timing.items())
    return facts | {"run time": ", ".join(stages)}


def _ideal_flow(verdict: Verdict) -> dict[str, str]:
    """Return when the ideal network settles, and how far the energy of the record rises."""
    from taction.verification.evidence.paper import ideal_flow as flow

    band = verdict.measurements.band
    title = f"the ideal network {banded('settles', band)} in"
    try:
        when = flow.settling_time(*flow.ideal_record(verdict.ideal), band)
        found = {title: quantity(when, "s", 3)}
    except SolverError as error:
        found = {title: f"unknown: {error}"}
    rise = flow.energy_rise(verdict.ideal.network, verdict.waveforms.time, verdict.u)
    if rise is None:
        return found
    share = f"rises by {figure(rise[0], 'step', 2)} of its fall, at {quantity(rise[1], 's')}"
    return found | {"energy": f"{share}; that of the ideal network never rises"}


def _constraint_plane(circuit: Circuit) -> str:
    """Return the steps of a constraint amplifier; empty without one, or if one follows at once."""
    models = circuit.models.values()
    known = all(m.imported is None and math.isfinite(m.gbw * m.dc_gain) for m in models)
    if not (known and circuit.named(Role.CONSTRAINT_RESISTOR)):
        return ""
    from taction.verification.evidence.paper.boards import stage_step

    (alone, _), (rise, overshoot) = (stage_step(circuit, loaded=by) for by in (False, True))
    stage = "oscillates by itself"
    if math.isfinite(rise):
        over = figure(overshoot, "step", 2)
        stage = f"rises in {quantity(rise, 's')} with {over} overshoot"
    text = f"amplifier alone rises in {quantity(alone, 's')}"
    return f"{text}; its stage with the capacitance of the node {stage}"


def on_screen(page: Page, verdict: Verdict) -> tuple[Section, ...]:
    """Return the sections of a verdict's page, for a terminal those of `screen` in their place."""
    media = ((each, each.media.replace("terminal", "")) for each in page.sections)
    return (
        *answers.screen(verdict).sections,
        *(replace(each, media=names) for each, names in media),
    )


def built_view(found: BuiltBoard) -> Page:
    """Return the verdict of a board, with what is in the folder and what a builder should know."""
    lines = [counts_text(found.parts), packages_text(found.parts)]
    if found.not_standard:
        nearest = "values are nominal; parts.csv has the nearest standard value beside each"
        lines.insert(1, nearest)
    lines += (f"not included: {what}" for what in found.parts.not_listed)
    sections = (
        Section("Files", blocks.Facts("Files", tuple(_files(found)))),
        Section("Parts", Notes("Parts", tuple(lines))),
    )
    if found.verdict is None:
        text = f"no verdict: {found.refused}"
        return Page(found.scene.name, "taction build", found.outcome, text, (), sections)
    page = view(found.verdict, "taction build")
    return replace(page, sections=(*on_screen(page, found.verdict), *sections))


def _files(found: BuiltBoard) -> Iterator[tuple[str, str]]:
    known = OWN if found.verdict is not None else OWN | {REPORT: "why there is no verdict"}
    yield from ((name, known[name]) for name in found.files if name in known)
    sheets = sum(name.endswith(".kicad_sch") for name in found.files)
    yield f"{KICAD}/{found.scene.name}.kicad_pro", f"the whole board for KiCad, {sheets} sheets"


def solution_view(result: Solution) -> Page:
    """Return the page of a numerical solution and its certificate."""
    lines = (
        *(f"u_{n} = {value!r}" for n, value in enumerate(result.u.tolist(), 1)),
        f"lambda = {result.lam!r}, objective = {result.objective!r}",
        f"{result.certificate_kind} {result.certificate:.3g} (bound {result.bound:.3g});"
        f" error in u at most {result.error_bound:.2g}; condition {result.condition:.3g};"
        f" {result.iterations} iterations, {1e3 * result.seconds:.2f} ms",
        "" if result.trusted else f"inconclusive: {result.reason}",
    )
    section = Section("Solution", lines, media="terminal page notebook")
    return Page("numerical solution", "taction solve", sections=(section,))
