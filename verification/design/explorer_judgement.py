"""The verdict on the present values: what `verify` says, with its record.

It takes longer than a movement of the hand, so it runs in a process of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Floats
from taction.system.errors import TactionError
from taction.verification.design.explorer_curves import Curves
from taction.verification.verdict.checks import Check
from taction.verification.verdict.progress import Effort
from taction.verification.verdict.verify import Verdict, verify

BARE = Effort(details=False, full_margin=False)
WINDOW = 10.0  # times the longest rise time: the window of the first rise


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """A verdict without what the page does not show.

    Attributes
    ----------
    outcome : str
        Of the verdict, or ``"error"`` if there is none, for the reason `error`.
    checks : tuple of Check
        All checks with values, limits and reasons.
    warnings : tuple of str
        Remarks of the verdict.
    settling, rise : float or None
        Of the network, s.
    overshoot : float or None
        Largest of all channels, fraction of the step; None for a board that is not stable.
    engine : str
        The simulator of the record.
    curves : Curves or None
        The record.
    amplitude : float
        Step amplitude, V.
    difference : float or None
        Largest difference of the two engines, fraction of the step; None if only one ran.
    seconds : float
        Wall time, s.
    """

    outcome: str
    checks: tuple[Check, ...] = ()
    warnings: tuple[str, ...] = ()
    settling: float | None = None
    rise: float | None = None
    overshoot: float | None = None
    engine: str = ""
    curves: Curves | None = None
    amplitude: float = 0.0
    difference: float | None = None
    seconds: float = 0.0
    error: str = ""


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
    ('pass', '0.00243')
    """
    try:
        verdict = verify(scene.with_engine(engine), effort=BARE)
    except TactionError as error:
        return Judgement("error", error=str(error))
    measured = verdict.measurements
    settling, rise = measured.settling_time, measured.rise_time
    overshoots = [channel.overshoot for channel in measured.channels]
    difference, agreement = None, verdict.agreement
    if agreement is not None and not agreement.reason and measured.amplitude > 0.0:
        difference = agreement.difference / measured.amplitude
    return Judgement(
        outcome=verdict.outcome.value,
        checks=verdict.checks,
        warnings=verdict.warnings,
        settling=None if settling is None else settling.value,
        rise=None if rise is None else rise.value,
        overshoot=max(overshoots, default=None) if verdict.poles.stable else None,
        engine=verdict.waveforms.simulator,
        curves=_curves(verdict, budget),
        amplitude=measured.amplitude,
        difference=difference,
        seconds=verdict.timing["total"],
    )


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
