"""Appendix A: how ill-conditioned the discretised problem is."""

from __future__ import annotations

import numpy as np

from verification.studies.paper.condition_number import asymptotic, condition_number
from verification.studies.paper.findings import (
    Chapter,
    Finding,
    Panel,
    Picture,
    curve,
    listed,
    weigh,
)
from verification.studies.paper.tactile import Geometry

RATIOS = (2.0, 4.0, 8.0, 10.0, 20.0)
SPAN = 20.0  # depths: wide enough that the ends of the range matter little
QUICK = 3  # of them in a quick run
NARROW = 6.0
CLOSE = 0.1


def conditioning(quick: bool) -> Chapter:
    """Judge how the condition number grows with the number of channels."""
    ratios = RATIOS[:QUICK] if quick else RATIOS
    found = [condition_number(ratio, SPAN) for ratio in ratios]
    formula = [asymptotic(ratio) for ratio in ratios]
    off = [abs(a / b - 1.0) for a, b in zip(found, formula, strict=True)]
    narrow = [condition_number(ratio, NARROW) for ratio in ratios]
    in_double = [
        float(np.linalg.cond(Geometry("", round(NARROW * ratio) + 1, NARROW).matrix))
        for ratio in RATIOS
    ]
    grows = all(np.diff(found) > 0.0) and all(np.diff(narrow) > 0.0)
    finding = Finding(
        "ill-conditioned",
        f"cond(T) in double-double arithmetic at depth / spacing = {listed(ratios)},"
        f" over {SPAN:g} depths (answers up to 1e28)",
        f"{listed(found)}; exp(pi r) / (2 e pi r) with r = depth / spacing is within"
        f" {100 * max(off):.2g} %; at r = 20 a double-precision cond says {in_double[-1]:.1g}",
        weigh(grows and max(off) <= CLOSE),
        {f"cond_{ratio:g}": value for ratio, value in zip(ratios, found, strict=True)},
    )
    lines = (
        curve(ratios, found, f"range of {SPAN:g} depths", "C0o"),
        curve(ratios, narrow, f"range of {NARROW:g} depths", "C1s"),
        curve(RATIOS, in_double, f"{NARROW:g} depths, in double precision", "C3x"),
        curve(np.linspace(2, 20, 50), [asymptotic(r) for r in np.linspace(2, 20, 50).tolist()],
              "exp(pi r) / (2 e pi r)", "k-"),
    )  # fmt: skip
    panel = Panel("condition number of T", "r = depth / spacing", "cond(T)", lines, logs="y")
    text = "A finer grid on the same range: the condition number grows exponentially."
    return Chapter((finding,), (Picture("condition", text, (panel,)),))
