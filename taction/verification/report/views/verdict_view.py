"""A verdict: checks, channels, waveforms, stability, error budget, headroom, board and deck."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np

from taction.system.charts import Axis, Chart, Columns, Limit
from taction.system.quantities import readable
from taction.system.reading_definitions import EXCURSIONS, READINGS, TIMES
from taction.verification.report.blocks import (
    BOTH,
    DRAWN,
    EVERYWHERE,
    PAGE,
    PICTURE,
    Bar,
    Bars,
    Block,
    Cell,
    Facts,
    Notes,
    Page,
    Section,
    Table,
)
from taction.verification.report.texts import (
    banded,
    figure,
    number_cell,
    quantity,
    rounded_up,
    spaced,
)
from taction.verification.report.views.answer_view import (
    MARGINS,
    answer_text,
    check_bars,
    decisive_text,
    of_unit,
    yield_text,
)
from taction.verification.report.views.board_view import (
    board_blocks,
    board_lines,
    deck_blocks,
    omission_blocks,
    parts_blocks,
)
from taction.verification.report.views.origin_view import origin_section
from taction.verification.report.views.stability_view import active_set_blocks, stability_blocks
from taction.verification.report.views.waveforms_view import (
    deviation_chart,
    difference_chart,
    outputs_chart,
    stress_chart,
)
from taction.verification.studies.tolerance.varied_board import VerifiedSample
from taction.verification.verdict.answer_error import worst_channel
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.error_budget import ErrorPart
from taction.verification.verdict.headroom import Load
from taction.verification.verdict.record import Channel, Record
from taction.verification.verdict.verify import Verdict

LOADS = 16  # of op-amps that are shown
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
    circuit, waves = verdict.circuit, verdict.waveforms
    engine = tuple((name, getattr(waves, name) or "–") for name in ("engine", "solver", "method"))
    detailed = BOTH if verbose else (PAGE,)
    return Page(
        title=verdict.scene.name,
        command=command,
        outcome=verdict.outcome.value,
        summary=decisive_text(verdict.checks, verdict.outcome.value),
        lines=board_lines(verdict),
        sections=(
            Section("Checks", lambda: _checks(verdict, notes), media=EVERYWHERE),
            _changes(changes),
            Section("Waveforms", lambda: _records(verdict), media=DRAWN),
            Section("Waveforms", lambda: (_channels(verdict),), media=BOTH),
            Section("Stability", lambda: stability_blocks(circuit, verdict.poles)),
            Section("Active sets", lambda: active_set_blocks(verdict), media=detailed),
            Section("Recovered stress", lambda: (stress_chart(verdict),), media=DRAWN),
            Section("Checks", lambda: (Bars("", check_bars(verdict)),), media=(PICTURE,)),
            Section("Error budget", lambda: _budget_chart(verdict)),
            Section("Error budget", lambda: budget_blocks(verdict), media=detailed),
            Section("Headroom", lambda: headroom_blocks(verdict), media=BOTH),
            Section("Error and run time", lambda: (_effort(verdict),), media=detailed),
            Section("Board", lambda: board_blocks(circuit)),
            Section("Left out", lambda: omission_blocks(circuit)),
            Section("Parts list", lambda: parts_blocks(circuit, verdict.scene)),
            Section("Deck", lambda: deck_blocks(verdict)),
            origin_section(verdict.scene, engine),
        ),
        foot=(_cost(verdict),),
    )


def sample_view(found: VerifiedSample) -> Page:
    """Return what the verdict of one sample shows."""
    return view(found.verdict, f"taction yield montecarlo --sample {found.sample.number}")


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


def _changes(text: str) -> Section:
    """Return what can mend the verdict; the first line of the text is above the others."""
    first, *lines = [readable(line.strip()) for line in text.splitlines()] or [""]
    detail = first.removesuffix(":").removeprefix("what to change").strip()
    lead = f"The nearest changes that mend the verdict {detail}".rstrip() + "."
    return Section("What to change", (Notes("", tuple(lines)),), lead, BOTH)


def _checks(verdict: Verdict, notes: Sequence[str]) -> tuple[Block, ...]:
    passing = [yield_text(verdict.answer)] if verdict.outcome is Outcome.PASS else []
    return (
        Bars("", check_bars(verdict), MARGINS),
        Notes("", tuple(filter(None, [*passing, answer_text(verdict.answer)]))),
        Notes("", tuple(map(readable, notes))),
        Notes("Warnings", tuple(map(readable, verdict.warnings))),
    )


def _records(verdict: Verdict) -> tuple[Chart, Chart, Chart | None]:
    return outputs_chart(verdict), deviation_chart(verdict), difference_chart(verdict)


def _channels(verdict: Verdict) -> Table:
    noise = () if verdict.noise is None or verdict.noise.unknown else verdict.noise.rms
    return channel_table(Record.of(verdict).channels, verdict.measurements.band, noise)


def channel_table(channels: Sequence[Channel], band: float, noise: Sequence[float] = ()) -> Table:
    """Return target, end, times and excursions of every channel, numbered from 1.

    What is known at rest, and `noise` (N,), V, have a column; `band` is that of the settling.
    """

    def volts(name: str) -> Callable[[Channel], Cell]:
        return lambda each: number_cell(each.figures.get(name), "V")

    columns: dict[str, Callable[[Channel], Any]] = {
        "channel": lambda each: Cell(f"u{each.index}", each.index),
        "target": volts("reference"),
    }
    if any(each.figures["equilibrium"] is not None for each in channels):
        columns["at rest"] = volts("equilibrium")
    columns["end"] = volts("final")
    for name, known in READINGS.items():
        title = banded(known.short, band) if name in TIMES else name
        columns[title] = partial(_reading, name)
    if noise:
        columns["output noise, rms"] = lambda each: number_cell(noise[each.index - 1], "V", 3)
    columns["state"] = lambda each: each.state
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


def headroom_blocks(verdict: Verdict) -> tuple[Block, ...]:
    """Return what the op-amps have to do beside their limits, the largest share first."""
    loads = (*verdict.parts.simulated, *verdict.parts.loads)
    if not loads:
        text = "No op-amp of this board has a limit of slew rate, swing or current in its model."
        return (Notes("", (text,)),)
    limited = not verdict.circuit.is_small_signal
    note = REACH + LIMITED * limited
    more = len(loads) - LOADS
    note += f" {more} smaller loads are not shown." if more > 0 else ""
    return (load_bars(loads, note, limited=limited),)


def load_bars(loads: Iterable[Load], note: str = "", *, limited: bool = False) -> Bars:
    """Return loads of op-amps, the largest share first.

    `limited` says whether the simulated op-amps have the limits, so that a load above them decides
    nothing.
    """

    def value(load: Load) -> str:
        at = "at rest" if math.isinf(load.at) else f"at {figure(load.at, 's', 3)}"
        slews = f", slews for {figure(load.slewing, 's', 2)}" if load.slewing else ""
        return f"{figure(load.peak, load.unit, 3)} {at}{slews}"

    rows = tuple(
        Bar(
            name=f"{load.quantity} of {load.part}",
            outcome="" if limited else "fail" if load.share > 1.0 else "pass",
            share=load.share,
            doubt=(load.error if math.isfinite(load.error) else 0.0) / load.limit,
            value=value(load),
            limit=f"at most {figure(load.limit, load.unit, 3)}",
        )
        for load in sorted(loads, key=lambda load: -load.share)[:LOADS]
    )
    return Bars("", rows, note)


def _least(verdict: Verdict) -> float:
    """Return the size below which a part of the budget is rounding, V."""
    known = verdict.ideal.error if math.isfinite(verdict.ideal.error) else 0.0
    return max(known, ROUNDING) * verdict.measurements.amplitude


def _volts(value: float | None, verdict: Verdict) -> Cell:
    """Return a part of the error, V; one too small to matter has no number, and sorts as none."""
    if value is None or not math.isfinite(value):
        return Cell("unknown")
    if 0.0 < abs(value) <= _least(verdict):
        return Cell("below rounding")
    known = not value or abs(value) > LEAST * verdict.answer.unit
    return Cell(quantity(value, "V", 3) if known else "under 1 ppb", value)


def budget_blocks(verdict: Verdict) -> tuple[Block, ...]:
    """Return the error budget as a table; the signed column is that of the worst channel."""
    budget, unit = verdict.budget, verdict.answer.unit
    parts, total = list(budget), budget.total
    if not parts:
        return ()
    columns: dict[str, Callable[[ErrorPart], Any]] = {
        "error": lambda part: spaced(part.name),
        "largest of any channel": lambda part: _volts(part.value, verdict),
        "of the largest stress": lambda part: _share_of(part, unit, _least(verdict)),
    }
    note = f"% {of_unit(verdict.answer)}."
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
    return (Table.of("Parts of the error", parts, columns, note),)


def _share_of(part: ErrorPart, unit: float, least: float) -> Cell | None:
    value = part.value
    if value is None or not math.isfinite(value) or not unit or 0.0 < abs(value) <= least:
        return None
    return Cell(figure(value / unit, "step", 3), value)


def _budget_chart(verdict: Verdict) -> tuple[Block, ...]:
    """Return the signed parts of the worst channel, and their sum."""
    budget, total = verdict.budget, verdict.budget.total
    if total is None:
        return ()
    worst = worst_channel(np.array(total.channels))
    parts = {spaced(part.name): part.channels[worst] for part in budget if part.channels}
    shown = parts | {"whole": total.channels[worst]}
    looks = tuple("fail" if size < 0.0 else "pass" for size in parts.values())
    bars = Columns(np.arange(len(shown)), [*shown.values()], "y", looks=(*looks, "band"))
    names = tuple(f"{name}: {_volts(size, verdict).text}" for name, size in shown.items())
    unknown = [spaced(p.name) for p in budget if p.value is None or not math.isfinite(p.value)]
    size, largest = quantity(shown["whole"], "V", 3), max(parts, key=lambda name: abs(parts[name]))
    summary = (
        f"The parts of channel {worst + 1}, which has the largest whole error, {size}, add up to"
        " it. Solid blue bars raise the output, hatched orange bars lower it."
        + f" Not known: {', '.join(unknown)}."
        * bool(unknown)
    )
    return (
        Chart(
            "Parts of the error",
            Axis(f"error of channel {worst + 1}", "V"),
            Axis(scale="names", names=names, reverse=True),
            (bars, Limit(0.0, line="solid")),
            f"{size} in channel {worst + 1}, most of it {largest}",
            summary,
        ),
    )


def _effort(verdict: Verdict) -> Facts:
    """Return the requested and the reached error of the run, and its cost."""
    accuracy, waves, ideal = verdict.accuracy, verdict.waveforms, verdict.ideal
    solution, energy = ideal.solution, verdict.energy
    reached = "unknown"
    if accuracy.achieved is not None:
        reached = f"{figure(accuracy.achieved, 'step')} of the step"
    stop, band = quantity(verdict.transient.stop, "s"), verdict.measurements.band
    certificate = f"{solution.certificate_kind} {solution.certificate:.2g}"
    rows = [
        ("requested error", f"{figure(accuracy.wanted, 'step')} of the step"),
        ("reached error", reached),
        ("how it is known", f"{accuracy.method} ({accuracy.how})"),
        ("simulation", f"{quantity(accuracy.seconds, 's', 3)}, tries: {accuracy.tries}"),
        ("points", f"{waves.cost.points} up to {stop}"),
        ("largest step", quantity(waves.spacing, "s", 3)),
        ("reference", f"{certificate}, bound {solution.bound:.2g}"),
        (
            f"{banded('settling_time', band)} of the ideal network",
            quantity(ideal.settling_time, "s"),
        ),
    ]
    if energy is not None:
        text = f"rises by {100 * energy.rise:.2g} % of its fall, at {quantity(energy.time, 's')}"
        rows.append(("energy", f"{text}; that of an ideal network never rises"))
    stages = (f"{name} {seconds:.2f} s" for name, seconds in verdict.timing.items())
    return Facts("", (*rows, ("run time", ", ".join(stages))))
