"""Pictures of the reproduction as plain data; `verification.report.views.paper` draws them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from taction.system.array_types import Floats


@dataclass(frozen=True, slots=True, eq=False)
class PaperCurve:
    """One line of a picture; `style` is a format string of matplotlib."""

    x: Floats
    y: Floats
    label: str = ""
    style: str = "-"


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """One set of axes; `marks` are labelled horizontal lines, `logs` names axes (``"xy"``)."""

    title: str
    x: str
    y: str
    curves: tuple[PaperCurve, ...]
    logs: str = ""
    limits: tuple[float, float] | None = None
    marks: tuple[tuple[float, str], ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A picture: `name` is the stem of its file, `caption` says what the picture shows."""

    name: str
    caption: str
    panels: tuple[Panel, ...]


def curve(x: ArrayLike, y: ArrayLike, label: str = "", style: str = "-") -> PaperCurve:
    """Return a `PaperCurve` of any two array-like values."""
    return PaperCurve(
        np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64), label, style
    )
