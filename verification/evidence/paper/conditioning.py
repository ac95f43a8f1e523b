"""Appendix A: how ill-conditioned the discretised problem is."""

from __future__ import annotations

import numpy as np

from taction.verification.evidence.paper.condition_number import asymptotic, condition_number
from taction.verification.evidence.paper.findings import Chapter, finding, weigh
from taction.verification.evidence.paper.pictures import Panel, Picture, curve
from taction.verification.evidence.paper.tactile import Geometry

RATIOS = (2.0, 4.0, 8.0, 10.0, 20.0)  # depth / spacing
QUICK = 2  # of `RATIOS` in a quick run
WIDE = 20.0  # depths: wide enough that the ends of the range matter little
NARROW = 6.0  # depths
CLOSE = 0.1


def conditioning(quick: bool) -> Chapter:
    """Judge how the condition number grows with the number of channels."""
    ratios = RATIOS[:QUICK] if quick else RATIOS
    wide, narrow = ([condition_number(r, span) for r in ratios] for span in (WIDE, NARROW))
    off = [abs(a / asymptotic(ratio) - 1.0) for a, ratio in zip(wide, ratios, strict=True)]
    in_double = [
        float(np.linalg.cond(Geometry(round(NARROW * ratio) + 1, NARROW).matrix))
        for ratio in RATIOS
    ]
    grows = bool(np.all(np.diff([wide, narrow]) > 0.0))
    result = finding(
        "ill-conditioned",
        {f"cond_{ratio:g}": value for ratio, value in zip(ratios, wide, strict=True)},
        weigh(grows and max(off) <= CLOSE),
        ratios=ratios,
        span=WIDE,
        conditions=wide,
        off=max(off),
        in_double=in_double[-1],
    )
    dense = np.linspace(2.0, 20.0, 50).tolist()
    lines = (
        curve(ratios, wide, f"range of {WIDE:g} depths", "C0o"),
        curve(ratios, narrow, f"range of {NARROW:g} depths", "C1s"),
        curve(RATIOS, in_double, f"{NARROW:g} depths, in double precision", "C3x"),
        curve(dense, [asymptotic(r) for r in dense], "exp(pi r) / (2 e pi r)", "k-"),
    )
    panel = Panel("condition number of T", "r = depth / spacing", "cond(T)", lines, logs="y")
    text = "A finer grid on the same range: the condition number grows exponentially."
    return Chapter((result,), (Picture("condition", text, (panel,)),))
