"""The scene's table ``[regression]``: the largest accepted difference from the stored result.

A difference is accepted up to ``absolute + relative |baseline|``. The defaults are far above the
differences between versions of ngspice (2e-6 of the step on the project's own scenes) and between
the engines, and far below the effect of a changed component.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from taction.netlist_gen.scene.fields import Model, NonNegative, Unit

SecondsOrZero = Annotated[float, Unit("s", zero=True)]


class LevelTolerance(Model):
    """Targets, finals, over- and undershoot; `absolute` is a fraction of the step amplitude."""

    relative: NonNegative = 1e-3
    absolute: NonNegative = 1e-4


class TimeTolerance(Model):
    """Rise times, settling times and the record's length."""

    relative: NonNegative = 0.02
    absolute: SecondsOrZero = 0.0


class PoleTolerance(Model):
    """Growth rate (1/s) and frequency (Hz) of the rightmost pole, and the stability margin.

    `absolute` is a fraction of the pole's magnitude: a double pole splits by half the digits.
    """

    relative: NonNegative = 1e-3
    absolute: NonNegative = 1e-6


class WaveformTolerance(Model):
    """Each output over time: the norm of its difference, against the norm of its baseline."""

    norm: Literal["max", "rms"] = Field("max", description="rms: weighted by time")
    relative: NonNegative = 0.01
    absolute: NonNegative = Field(1e-3, description="fraction of the step amplitude")


class Regression(Model):
    """Differences that `taction regress` accepts."""

    levels: LevelTolerance = LevelTolerance()
    times: TimeTolerance = TimeTolerance()
    poles: PoleTolerance = PoleTolerance()
    waveforms: WaveformTolerance = WaveformTolerance()
