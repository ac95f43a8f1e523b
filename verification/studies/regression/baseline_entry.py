"""From a verdict to what a baseline keeps of it."""

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

from netlist_gen.scene.scene import Scene
from spice_models.array_types import Floats
from verification.measures.measurements import ChannelMeasure
from verification.measures.readings import Reading
from verification.studies.figures import CHANNEL_FIGURES, FIGURES, finite
from verification.studies.regression.baseline import Entry
from verification.studies.running.digests import files_of
from verification.verify import Verdict

T = TypeVar("T")

POLES = ("growth_rate", "frequency", "margin")
INSTANTS = 256  # samples of each output that a baseline keeps


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """A scene's entry, with the waveforms that it was sampled from.

    Attributes
    ----------
    entry : Entry
        What a baseline keeps.
    time, u : ndarray (P,) and (P, N)
        Every point, s and V.
    """

    entry: Entry
    time: Floats
    u: Floats


def observe(verdict: Verdict, revision: str) -> Observation:
    """Return what a baseline keeps of `verdict`; `revision` is the commit it was made at."""
    m, poles = verdict.measurements, verdict.poles
    channels = m.channels if poles.stable else ()
    time, u = np.asarray(verdict.waveforms.time), verdict.u
    shown = _instants(time, u) if poles.stable and np.all(np.isfinite(u)) else np.zeros(0, int)
    times: dict[str, list[float | None]] = {}
    if poles.stable:
        times = {"record": [verdict.transient.stop], "settling_time": _values(m.settling_time)}
    times |= _of(channels, _values, "rise_time", "settling_time")
    entry = Entry(
        name=verdict.scene.name,
        fingerprint=fingerprint(verdict.scene),
        revision=revision,
        taction=metadata.version("taction"),
        simulator=verdict.waveforms.engine,
        outcome=verdict.outcome.value,
        checks={check.name: check.outcome.value for check in verdict.checks},
        amplitude=m.amplitude,
        speed=abs(poles.rightmost),
        levels=_of(m.channels, _number, "target") | _of(channels, _number, "final", "overshoot"),
        times=(times if poles.stable else {})
        | _of(channels, _values, "rise_time", "settling_time"),
        poles={name: value for name in POLES if (value := FIGURES[name].of(verdict)) is not None},
        states={f"u_{c.index + 1}": c.state.value for c in m.channels},
        time=time[shown].tolist(),
        outputs=_samples(u[shown]) if shown.size else {},
    )
    return Observation(entry, time, u)


def fingerprint(scene: Scene) -> str:
    """Return the SHA-256 of what a scene's author wrote, but for tolerances, and of its files."""
    asked = scene.model_dump(mode="json", exclude_unset=True, exclude={"regression"}, by_alias=True)
    digest = hashlib.sha256(json.dumps(asked, sort_keys=True).encode())
    for name in files_of(scene).values():
        if name is not None:
            digest.update((scene.folder / str(name)).read_bytes())
    return digest.hexdigest()


def _of(
    channels: tuple[ChannelMeasure, ...], keep: Callable[[Reading | float | None], T], *names: str
) -> dict[str, T]:
    """Return the named figures of every channel in the form that `keep` gives them."""
    return {
        f"u_{channel.index + 1}.{name}": keep(CHANNEL_FIGURES[name].read(channel))
        for channel in channels
        for name in names
    }


def _number(found: Reading | float | None) -> float:
    value = finite(found)
    return math.nan if value is None else value


def _values(reading: Reading | float | None) -> list[float | None]:
    """Return a reading's value, and the other value that it may have where it is fragile."""
    if not isinstance(reading, Reading) or not math.isfinite(reading.value):
        return [None]
    return [reading.value, reading.alternative] if reading.fragile else [reading.value]


def _instants(time: Floats, u: Floats) -> NDArray[np.intp]:
    """Return indices of `INSTANTS` points: a third each follow the outputs, time, and log time."""
    steps = np.diff(time)
    travelled = np.abs(np.diff(u, axis=0)).sum(axis=1)
    early = np.diff(np.log(time - time[0] + (time[-1] - time[0]) / 1e4))
    share = sum(part / (part.sum() or 1.0) for part in (travelled, steps, early))
    along = np.concatenate([[0.0], np.cumsum(share)])
    return np.unique(np.searchsorted(along, np.linspace(0.0, along[-1], INSTANTS)))


def _samples(u: Floats) -> dict[str, list[float]]:
    """Round to nine digits: a millionth of any tolerance, and half the length of the file."""
    return {f"u_{n}": [float(f"{x:.9g}") for x in column] for n, column in enumerate(u.T, 1)}
