"""Appendix A: how ill-conditioned the discretised problem is.

The transform of kernel (19), ``3/2 x |w| exp(-x |w|)``, is positive, so T is positive definite. A
condition number in double precision means something up to about 1e16; beyond, the formula counts.
"""

from __future__ import annotations

import math

import numpy as np

from taction.system.charts import SERIES, Axis, Curve
from taction.verification.evidence.paper.findings import Chapter, finding, weigh
from taction.verification.evidence.paper.pictures import panel, picture
from taction.verification.evidence.paper.tactile import Geometry

RATIOS = (2.0, 4.0, 8.0, 10.0)  # depth / spacing; at the last one cond(T) is 3e11
QUICK = 2  # of `RATIOS` in a quick run
BEYOND = 20.0  # a ratio whose condition number double precision cannot hold
WIDE = 20.0  # depths: wide enough that the ends of the range matter little
NARROW = 6.0  # depths
CLOSE = 0.1


def conditioning(quick: bool) -> Chapter:
    """Judge how the condition number grows with the number of channels."""
    ratios = RATIOS[:QUICK] if quick else RATIOS
    wide, narrow = ([condition_number(r, span) for r in ratios] for span in (WIDE, NARROW))
    off = [abs(a / asymptotic(ratio) - 1.0) for a, ratio in zip(wide, ratios, strict=True)]
    grows = bool(np.all(np.diff([wide, narrow]) > 0.0))
    result = finding(
        "ill-conditioned",
        {f"cond_{ratio:g}": value for ratio, value in zip(ratios, wide, strict=True)},
        weigh(grows and max(off) <= CLOSE),
        ratios=ratios,
        span=WIDE,
        conditions=wide,
        off=max(off),
        beyond=asymptotic(BEYOND),
        in_double=condition_number(BEYOND, NARROW),
    )
    dense = np.linspace(2.0, BEYOND, 50).tolist()
    chart = panel(
        "condition number of T",
        Axis("r = depth / spacing"),
        Axis("cond(T)", scale="log"),
        Curve(ratios, wide, f"range of {WIDE:g} depths", line="", mark="circle"),
        Curve(ratios, narrow, f"range of {NARROW:g} depths", SERIES[1], "", "square"),
        Curve(dense, [asymptotic(r) for r in dense], "exp(pi r) / (2 e pi r)", "ink"),
    )
    text = "A finer grid on the same range: the condition number grows exponentially."
    return Chapter((result,), (picture(text, chart),))


def asymptotic(ratio: float) -> float:
    """Return the condition number for a wide range of y and `ratio` = depth over spacing.

    The largest value of the sampled kernel's spectrum is at ``w = 1/x``, the smallest at the
    Nyquist frequency ``pi/dy``, where two aliases meet.
    """
    return math.exp(math.pi * ratio) / (2.0 * math.e * math.pi * ratio)


def condition_number(ratio: float, span: float) -> float:
    """Return the condition number of T at `ratio` = depth over spacing, over `span` depths."""
    return float(np.linalg.cond(Geometry(round(span * ratio) + 1, span).matrix))
