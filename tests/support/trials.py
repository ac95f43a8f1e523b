"""Trials of designs, made by hand."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from taction.netlist_gen.scene.keys import Value
from taction.verification.design.trials import Trial
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.record import Record


def make_trial(
    values: Mapping[str, Value],
    settling: float = math.inf,
    overshoot: float = math.inf,
    left: Sequence[str] = (),
    refused: str = "",
) -> Trial:
    """Return the trial of a stable board (without an overshoot: an unstable one)."""
    none = Record.without_verdict("", "", "statespace")
    names = dict.fromkeys(("made", *left), Outcome.PASS) | dict.fromkeys(left, Outcome.FAIL)
    checks = tuple(Check(n, o, None, None, None, None, "ratio", "") for n, o in names.items())
    record = replace(
        none,
        outcome="fail" if left else "pass",
        failure=None,
        stable=math.isfinite(overshoot),
        figures=none.figures
        | {
            "settling_time": settling if math.isfinite(settling) else None,
            "overshoot": overshoot if math.isfinite(overshoot) else None,
        },
        checks=checks,
    )
    return Trial(dict(values), record, refused)
