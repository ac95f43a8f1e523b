"""What every result of a public function can do: a picture, a report and a card of its view.

A view is above the results, so that a class names it by its place.

The report draws the pictures; its rooms are loaded when a picture is wanted.
"""

from __future__ import annotations

import importlib
import operator
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.figure import Figure


RENDERERS = "taction.verification.report.renderers"


def load(place: str) -> Callable[..., Any]:
    """Return a function by its place, imported now: ``taction.system.results:load``."""
    module, name = place.split(":")
    function: Callable[..., Any] = operator.attrgetter(name)(importlib.import_module(module))
    return function


class Result:
    """A result that is shown by a view.

    Attributes
    ----------
    VIEW : str
        Place of the function that takes the result and returns its page.
    CARD : str
        Word beside the title of the card; by default the command of the page.
    """

    __slots__ = ()
    VIEW: ClassVar[str]
    CARD: ClassVar[str] = ""

    def page(self) -> Any:
        """Return what is shown: a `verification.report.blocks.Page`."""
        return load(self.VIEW)(self)

    def plot(self, path: str | Path | None = None) -> Figure:
        """Return the picture of the command's ``--plot``.

        Parameters
        ----------
        path : path, optional
            Write the picture into this file: ``.png``, ``.svg`` or ``.pdf``.

        Raises
        ------
        InputError
            The picture cannot be drawn or written, or matplotlib is missing (``taction[plot]``).
        """
        figure: Figure = load(f"{RENDERERS}.picture:draw_page")(self.page(), path)
        return figure

    def report(self, path: str | Path) -> None:
        """Write a report as one HTML file, with pictures, that needs no network.

        Raises
        ------
        InputError
            The name does not end in ``.html``, the file cannot be written, or a package of
            ``taction[report]`` is missing.

        Examples
        --------
        >>> import taction, tempfile
        >>> verdict = taction.verify("scenes/custom-matrix.toml", engine="statespace")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     verdict.report(f"{folder}/board.html")
        """
        load(f"{RENDERERS}.page:write_page")(self.page(), str(path))

    def __repr__(self) -> str:
        page = self.page()
        said = filter(None, (repr(page.title), page.summary.removesuffix(".")))
        return f"{type(self).__name__}({', '.join(said)})"

    def _repr_html_(self) -> str:
        """Return the result as a card for a notebook."""
        card: str = load(f"{RENDERERS}.terminal:card")(self.page(), self.CARD)
        return card
