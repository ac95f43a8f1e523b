"""The style and the colours of all pictures."""

from __future__ import annotations

from typing import Any

BLUE, ORANGE, GREY, PURPLE = "#0072b2", "#d55e00", "#7f7f7f", "#cc79a7"
"""Colours that stay apart for every kind of colour vision (Okabe and Ito)."""
CYCLE = [BLUE, ORANGE, "#009e73", PURPLE, "#e69f00", "#56b4e9"]
STYLE: dict[Any, Any] = {
    "axes.grid": True,
    "grid.alpha": 0.3,
    "axes.prop_cycle": f"cycler('color', {CYCLE})",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "hatch.linewidth": 0.6,
    "svg.hashsalt": "taction",  # the same picture gives the same bytes
}
