"""The verdict on the present values: what `verify` says, with its record.

It takes longer than a movement of the hand, so it runs in a process of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.errors import TactionError
from taction.verification.design.board_view import Curves
from taction.verification.design.trials import BARE
from taction.verification.verdict.checks import Check
from taction.verification.verdict.record import ERROR, Record
from taction.verification.verdict.verify import Verdict, verify

WINDOW = 10.0  # times the longest rise time: the window of the first rise


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """A verdict without what the page does not show.

    Attributes
    ----------
    record : Record
        Of the verdict, or why there is none.
    warnings : tuple of str
        Remarks of the verdict.
    engine : str
        The simulator of the record.
    curves : Curves or None
        The record.
    difference : float or None
        Largest difference of the two engines, fraction of the step; None if only one ran.
    """

    record: Record
    warnings: tuple[str, ...] = ()
    engine: str = ""
    curves: Curves | None = None
    difference: float | None = None

    @classmethod
    def without_verdict(cls, error: Exception) -> Judgement:
        """Return why there is no verdict."""
        return cls(Record.without_verdict(type(error).__name__, str(error), ""))

    @property
    def outcome(self) -> str:
        """The outcome of the verdict, or ``"error"`` without one."""
        return self.record.outcome

    @property
    def error(self) -> str:
        """Why there is no verdict."""
        return self.record.reason if self.outcome == ERROR else ""

    @property
    def checks(self) -> tuple[Check, ...]:
        """All checks with values, limits and reasons."""
        return self.record.checks

    @property
    def settling(self) -> float | None:
        """Settling time of the network, s."""
        return self.record.value("settling_time")

    @property
    def rise(self) -> float | None:
        """Rise time of the network, s."""
        return self.record.value("rise_time")

    @property
    def overshoot(self) -> float | None:
        """Largest overshoot, fraction of the step; None for a board that is not stable."""
        return self.record.value("overshoot") if self.record.stable else None

    @property
    def seconds(self) -> float | None:
        """Wall time, s."""
        return self.record.value("seconds")


def judge(scene: Scene, engine: str, budget: int) -> Judgement:
    """Verify a scene with an engine.

    Parameters
    ----------
    engine : str
        ``"statespace"`` or ``"ngspice"``.
    budget : int
        Points of a curve, about.

    Examples
    --------
    >>> from taction.netlist_gen.scene.scene import load_scene
    >>> found = judge(load_scene("scenes/paper-breadboard.toml"), "statespace", 500)
    >>> found.outcome, f"{found.settling:.3g}"
    ('pass', '0.00242')
    """
    try:
        verdict = verify(scene.with_engine(engine), effort=BARE)
    except TactionError as error:
        return Judgement.without_verdict(error)
    amplitude, difference = verdict.measurements.amplitude, None
    agreement = verdict.agreement
    if agreement is not None and not agreement.reason and amplitude > 0.0:
        difference = agreement.difference / amplitude
    record = Record.of(verdict, channels=False)
    engine, curves = verdict.waveforms.simulator, _curves(verdict, budget)
    return Judgement(record, verdict.warnings, engine, curves, difference)


def _curves(verdict: Verdict, budget: int) -> Curves:
    """Return the record with at least `budget` points in the first rise and in all of it."""
    time, outputs = verdict.waveforms.time, verdict.u
    stop = float(time[-1])
    rises = [c.rise_time.value for c in verdict.measurements.channels if c.rise_time is not None]
    rise = min(WINDOW * max(rises, default=stop), stop)
    return Curves(*_kept(time, outputs, rise, budget), rise, stop)


def _kept(time: Floats, outputs: Floats, rise: float, budget: int) -> tuple[Floats, Floats]:
    """Return instants at which any channel has an extreme within a part of its window."""
    early = int(np.searchsorted(time, rise, side="right"))
    places = [np.array([0, len(time) - 1])]
    for first, last in ((0, early), (0, len(time))):
        parts = np.linspace(first, last, budget // 2 + 1).astype(np.int64)
        for begin, end in zip(parts[:-1].tolist(), parts[1:].tolist(), strict=True):
            if end - begin <= 2:
                places.append(np.arange(begin, end))
            else:
                part = outputs[begin:end]
                places += [begin + part.argmin(axis=0), begin + part.argmax(axis=0)]
    kept = np.unique(np.concatenate(places))
    return time[kept], outputs[kept]
