"""Yields and corners in a terminal, until the commands call their views."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from rich.console import Console

from taction.verification.report.renderers.terminal import print_page, shown
from taction.verification.report.views import corners as corners_view
from taction.verification.report.views import montecarlo
from taction.verification.studies.tolerance.corners import Corner, CornerStudy
from taction.verification.studies.tolerance.steady_directions import Direction
from taction.verification.studies.tolerance.varied_board import Quantity
from taction.verification.studies.tolerance.yield_report import YieldReport

DIRECTION = ("channel", "sign", "predicted", "solved", "largest", "deviations")  # in JSON


def print_yield(report: YieldReport, seed: int, console: Console) -> None:
    """Print the page of a yield."""
    scene: Any = SimpleNamespace(name=getattr(report, "name", "yield"))
    print_page(montecarlo.view(scene, report, (), seed), console)


def print_corners(
    corners: tuple[Corner, ...], quantities: tuple[Quantity, ...], console: Console
) -> None:
    """Print every corner with its outcome, its failed checks and the components behind them."""
    for block in corners_view.tables(quantities, corners):
        console.print(shown(block))


def print_directions(directions: tuple[Direction, ...], console: Console) -> None:
    """Print the largest worst-case errors at rest, to first order and solved."""
    for block in corners_view.directions(CornerStudy((), directions), corners_view.SHOWN):
        console.print(shown(block))
