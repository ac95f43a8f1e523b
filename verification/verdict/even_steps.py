"""Transients of even steps, and of longer steps than those of another transient."""

from __future__ import annotations

import math
from dataclasses import replace

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.scene.scene import Scene
from taction.verification.engines.statespace.linearised.time_scales import TimeScales


def even_transient(scene: Scene, scales: TimeScales, points: float, stop: float) -> Transient:
    """Return a transient of even steps, `points` on the period of the fastest ringing."""
    step = scales.max_step_for(points)
    return Transient(stop, step, truncation_for(points), initial=scene.analysis.initial)


def truncation_for(points: float) -> float:
    """Return twice the local error ``(omega h)³ / 12`` of a mode with `points` on its period.

    A mode that is faster than the mode that sets the maximum step then gets nearly as many points
    on its period, and half the maximum step halves every step.
    """
    return (2 * math.pi / points) ** 3 / 6


def coarser(transient: Transient, ratio: float) -> Transient:
    """Return the same transient with every step `ratio` times as long (trapezoidal rule)."""
    return replace(
        transient,
        max_step=ratio * transient.max_step,
        truncation=ratio**3 * transient.truncation,
        first_step=ratio * transient.begin,
    )
