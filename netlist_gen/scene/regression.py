"""The scene's table ``[regression]``: how far a result may move from the stored one.

A difference is accepted up to ``absolute + relative |baseline|``. The defaults are far above what
two versions of ngspice differ in (2e-6 of the step on the project's own scenes) and above what
ngspice and the state-space engine differ in, and far below what a change of a component does.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from netlist_gen.scene.fields import Model, NonNegative, Unit

SecondsOrZero = Annotated[float, Unit("s", zero=True)]


class LevelTolerance(Model):
    """Targets, final values and overshoot; `absolute` is a fraction of the step amplitude."""

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
    """What `taction regress` lets pass as the same."""

    levels: LevelTolerance = LevelTolerance()
    times: TimeTolerance = TimeTolerance()
    poles: PoleTolerance = PoleTolerance()
    waveforms: WaveformTolerance = WaveformTolerance()
