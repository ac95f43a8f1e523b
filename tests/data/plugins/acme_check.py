"""A check from another package: the largest voltage of any output, over the whole record."""

import numpy as np

from taction.netlist_gen.scene.checks import UpperLimit
from taction.netlist_gen.scene.fields import Volts
from taction.verification.verdict.checks import Check, CheckKind, Evidence, at_most, undecided


class SwingKeys(UpperLimit):
    """The scene's table: ``[checks.swing]`` with `max`, or ``checks.swing = "2V"``."""

    max: Volts


def judge(evidence: Evidence) -> Check | None:
    """Compare the largest voltage, known to the error of the record, with the limit."""
    limits = evidence.checks.swing
    if limits is None:
        return None
    recording = evidence.recording
    if recording.accuracy.achieved is None:
        return undecided("swing", "V", "the error of the record is unknown", limits.max)
    value = float(np.abs(recording.u).max())
    error = recording.accuracy.achieved * evidence.measurements.amplitude
    outcome, reason = at_most(value, error, limits.max), "largest voltage of any output"
    return Check("swing", outcome, value, error, limits.max, None, "V", reason)


SWING = CheckKind(judge, SwingKeys)
