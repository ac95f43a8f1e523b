"""Pictures of results, which the report draws: its rooms are loaded when a picture is wanted."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taction.system.output_files import check_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MATPLOTLIB = ("matplotlib", "needs matplotlib: pip install 'taction[plot]'")
PACKAGES = dict.fromkeys((".png", ".svg", ".pdf"), MATPLOTLIB)
REPORT = "taction.verification.report"


def check_plot_file(path: str | Path) -> None:
    """Refuse a picture that could not be drawn, before any work is done.

    Raises
    ------
    InputError
        The ending is not in `PACKAGES`, the folder is missing, or matplotlib is not installed.
    """
    check_file(str(path), "--plot", PACKAGES, PACKAGES)


def plot(view: str, path: str | Path | None, *shown: Any) -> Figure:
    """Draw what a function of the report's views makes of a result.

    Parameters
    ----------
    view : str
        ``"module:function"`` of ``report/views``; the function returns a `Page`.
    path : path or None
        The figure is written to this file.
    *shown : object
        Arguments of the function.

    Raises
    ------
    InputError
        See `check_plot_file`; or matplotlib is not installed.
    """
    module, _, name = view.partition(":")
    made = getattr(import_module(f"{REPORT}.views.{module}"), name)(*shown)
    figure: Figure = import_module(f"{REPORT}.renderers.picture").draw_page(made, path)
    return figure
