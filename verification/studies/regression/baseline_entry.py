"""From a verdict to its entry in a baseline."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.foreign_files import LARGEST, read_bounded
from taction.system.reading_definitions import EXCURSIONS, TIMES
from taction.verification.readings.measurements import ChannelMeasure
from taction.verification.readings.readings import Reading
from taction.verification.studies.figures import CHANNEL_FIGURES, FIGURES, finite
from taction.verification.studies.regression.baseline import Entry
from taction.verification.studies.running.digests import files_of
from taction.verification.verdict.verify import Verdict

T = TypeVar("T")

POLES = ("growth_rate", "frequency", "margin")
INSTANTS = 256  # samples of each output in a baseline


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """A scene's entry, with the full record from which its samples were taken."""

    entry: Entry
    time: Floats  # (P,), s
    u: Floats  # (P, N), V


def observe(verdict: Verdict, revision: str) -> Observation:
    """Return the entry of `verdict` with its record; `revision` is the commit checked out."""
    m, poles = verdict.measurements, verdict.poles
    channels = m.channels if poles.known_stable else ()
    time, u = np.asarray(verdict.waveforms.time), verdict.u
    steady = poles.known_stable and bool(np.all(np.isfinite(u)))
    sampled = _instants(time, u) if steady else np.zeros(0, int)
    times: dict[str, list[float | None]] = {}
    if poles.known_stable:
        times = {"record": [verdict.transient.stop], "settling_time": _values(m.settling_time)}
    times |= _by_channel(channels, _values, *TIMES)
    entry = Entry(
        name=verdict.scene.name,
        fingerprint=fingerprint(verdict.scene),
        revision=revision,
        taction=metadata.version("taction"),
        simulator=verdict.waveforms.simulator,
        outcome=verdict.outcome.value,
        checks={check.name: check.outcome.value for check in verdict.checks},
        amplitude=m.amplitude,
        speed=abs(poles.rightmost),
        levels=_by_channel(m.channels, _number, "target")
        | _by_channel(channels, _number, "final", *EXCURSIONS),
        times=times,
        poles={name: value for name in POLES if (value := FIGURES[name].of(verdict)) is not None},
        states={f"u_{c.index + 1}": c.state.value for c in m.channels},
        time=time[sampled].tolist(),
        outputs=_samples(u[sampled]) if sampled.size else {},
    )
    return Observation(entry, time, u)


def fingerprint(scene: Scene) -> str:
    """Return the SHA-256 of a scene as written, without its tolerances, and of its files."""
    written = scene.model_dump(
        mode="json", exclude_unset=True, exclude={"regression"}, by_alias=True
    )
    digest = hashlib.sha256(json.dumps(written, sort_keys=True).encode())
    for name in files_of(scene).values():
        if isinstance(name, str):  # an array is in what was written
            digest.update(read_bounded(scene.folder / name, LARGEST))
    return digest.hexdigest()


def _by_channel(
    channels: tuple[ChannelMeasure, ...],
    convert: Callable[[Reading | float | None], T],
    *names: str,
) -> dict[str, T]:
    """Return the named figures of every channel, converted by `convert`."""
    return {
        f"u_{channel.index + 1}.{name}": convert(CHANNEL_FIGURES[name].read(channel))
        for channel in channels
        for name in names
    }


def _number(figure: Reading | float | None) -> float:
    value = finite(figure)
    return math.nan if value is None else value


def _values(reading: Reading | float | None) -> list[float | None]:
    """Return a reading's value, and the alternative value of a fragile reading."""
    if not isinstance(reading, Reading) or not math.isfinite(reading.value):
        return [None]
    return [reading.value, reading.alternative] if reading.fragile else [reading.value]


def _instants(time: Floats, u: Floats) -> NDArray[np.intp]:
    """Return indices of `INSTANTS` points: a third each by path of u, time, and log time."""
    steps = np.diff(time)
    path = np.abs(np.diff(u, axis=0)).sum(axis=1)
    log_steps = np.diff(np.log(time - time[0] + (time[-1] - time[0]) / 1e4))
    density = sum(part / (part.sum() or 1.0) for part in (path, steps, log_steps))
    cumulative = np.concatenate([[0.0], np.cumsum(density)])
    return np.unique(np.searchsorted(cumulative, np.linspace(0.0, cumulative[-1], INSTANTS)))


def _samples(u: Floats) -> dict[str, list[float]]:
    """Round to nine digits: errors of a millionth of any tolerance, half the size of the file."""
    return {f"u_{n}": [float(f"{x:.9g}") for x in column] for n, column in enumerate(u.T, 1)}
