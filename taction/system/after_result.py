"""What follows a result: a step that fails costs that step, never the result.

A verdict is complete before changes are searched, warnings collected, pictures drawn and reports
written. Each of these is optional, so each runs here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from taction.system.foreign_text import shortened, visible

T = TypeVar("T")
LONGEST = 400  # characters of what went wrong
FAILURES: tuple[type[Exception], ...] = (Exception,)
"""What costs a step alone; the tests empty it, so that no mistake stays unseen."""


def attempt(
    what: str,
    step: Callable[[], T],
    otherwise: T,
    tell: Callable[[str], object],
    passes: Callable[[Exception], bool] = lambda error: False,
) -> T:
    """Return what a step returns; if it fails, tell it in one line and return `otherwise`.

    Parameters
    ----------
    what : str
        What the step makes: "the search for changes".
    tell : callable
        Receives the line.
    passes : callable
        Whether an error is not that of the step, such as a reader of stdout who has gone. Ctrl-C
        always passes through.

    Examples
    --------
    >>> attempt("the number", lambda: float("1V"), None, print)
    the number failed, the result stands: ValueError: could not convert string to float: '1V'
    """
    try:
        return step()
    except FAILURES as error:
        if passes(error):
            raise
        text = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        tell(f"{what} failed, the result stands: {shortened(visible(text), LONGEST)}")
        return otherwise
