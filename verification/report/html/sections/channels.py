"""The names of channels, and the table of their readings."""

from __future__ import annotations

from collections.abc import Iterable

from taction.system.reading_definitions import EXCURSIONS, READINGS, TIMES
from taction.verification.readings.measurements import ChannelMeasure
from taction.verification.report.html.blocks import Cell, Table
from taction.verification.report.html.texts import number_cell, quantity
from taction.verification.verdict.verify import Verdict


def channel_names(places: Iterable[int]) -> str:
    """Return the names of channels, of three and more in a row the first and the last.

    Examples
    --------
    >>> channel_names([0, 6]), channel_names([4, 1, 2, 3])
    ('u1, u7', 'u2 to u5')
    """
    runs: list[list[int]] = []
    for n in sorted(places):
        if runs and n == runs[-1][-1] + 1:
            runs[-1].append(n)
        else:
            runs.append([n])
    parts = [
        f"u{run[0] + 1} to u{run[-1] + 1}" if len(run) > 2 else ", ".join(f"u{n + 1}" for n in run)
        for run in runs
    ]
    return ", ".join(parts)


def channel_table(verdict: Verdict) -> Table:
    """Return target, end, times and excursions of every channel."""
    noise = () if verdict.noise is None or verdict.noise.unknown else verdict.noise.rms
    titles = ("channel", "target", "at rest", "end", *map(_title, READINGS))
    rows = []
    for channel in verdict.measurements.channels:
        rms = [number_cell(noise[channel.index], "V", 3)] if noise else []
        rows.append(
            (
                Cell(f"u{channel.index + 1}", channel.index + 1),
                number_cell(channel.target, "V"),
                number_cell(float(verdict.steady.values[channel.index]), "V"),
                number_cell(channel.final, "V"),
                *(_cell(channel, name) for name in READINGS),
                *rms,
                Cell(channel.state.value),
            )
        )
    names = (*titles, *(["noise, rms"] if noise else []), "state")
    words = " and ".join(EXCURSIONS).capitalize()
    note = f"{words} are in % of the step of the network."
    return Table("Channels", names, tuple(rows), note)


def _title(name: str) -> str:
    return READINGS[name].short if name in TIMES else name


def _cell(channel: ChannelMeasure, name: str) -> Cell:
    reading = channel.readings[name]
    if reading is None:
        return Cell("–", None)
    if name in EXCURSIONS:
        return number_cell(reading.value, "step")
    text = quantity(reading.value, "s")
    if reading.fragile and reading.alternative is not None:
        text += f" (fragile: or {quantity(reading.alternative, 's')})"
    return Cell(text, reading.value)
