"""From a verdict to what a baseline keeps of it."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from netlist_gen.scene.problem import CsvLoad, MatrixProblem
from netlist_gen.scene.scene import Scene
from spice_models.array_types import Floats
from verification.measures.measure import ChannelMeasure
from verification.measures.times import Reading
from verification.studies.regression.baseline import Entry
from verification.verify import Verdict

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
    times = {"record": [verdict.transient.stop], "settling_time": _values(m.settling_time)}
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
        levels={f"u_{c.index + 1}.target": c.target for c in m.channels} | _levels(channels),
        times=(times if poles.stable else {}) | _times(channels),
        poles=_poles(verdict),
        states={f"u_{c.index + 1}": c.state.value for c in m.channels},
        time=time[shown].tolist(),
        outputs=_samples(u[shown]) if shown.size else {},
    )
    return Observation(entry, time, u)


def fingerprint(scene: Scene) -> str:
    """Return the SHA-256 of what a scene's author wrote, but for tolerances, and of its files."""
    asked = scene.model_dump(mode="json", exclude_unset=True, exclude={"regression"}, by_alias=True)
    digest = hashlib.sha256(json.dumps(asked, sort_keys=True).encode())
    for name in _input_files(scene):
        digest.update((scene.folder / name).read_bytes())
    return digest.hexdigest()


def _input_files(scene: Scene) -> list[Path]:
    problem = scene.problem
    if isinstance(problem, MatrixProblem):
        names = [problem.matrix, problem.strain, problem.stress]
    else:
        names = [problem.load.file if isinstance(problem.load, CsvLoad) else None]
    return [Path(name) for name in names if name is not None]


def _levels(channels: tuple[ChannelMeasure, ...]) -> dict[str, float]:
    found = {}
    for channel in channels:
        found[f"u_{channel.index + 1}.final"] = channel.final
        found[f"u_{channel.index + 1}.overshoot"] = channel.overshoot
    return found


def _times(channels: tuple[ChannelMeasure, ...]) -> dict[str, list[float | None]]:
    found = {}
    for channel in channels:
        found[f"u_{channel.index + 1}.rise_time"] = _values(channel.rise_time)
        found[f"u_{channel.index + 1}.settling_time"] = _values(channel.settling_time)
    return found


def _values(reading: Reading | None) -> list[float | None]:
    """Return a reading's value, and what a hair would make of it where it is fragile."""
    if reading is None or not math.isfinite(reading.value):
        return [None]
    return [reading.value, reading.alternative] if reading.fragile else [reading.value]


def _poles(verdict: Verdict) -> dict[str, float]:
    pole = verdict.poles.rightmost
    found = {"growth_rate": pole.real, "frequency": abs(pole.imag) / (2 * math.pi)}
    return found if verdict.margin is None else found | {"margin": verdict.margin.factor}


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
