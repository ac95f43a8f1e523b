"""What the options of a refinement say; a mistake is found before anything that computes."""

from __future__ import annotations

import math
from collections.abc import Sequence

from taction.system.errors import Complaint, InputError


def condition_numbers(given: str | Sequence[float]) -> list[float]:
    """Return condition numbers from a sequence, or from a text with commas.

    Raises
    ------
    InputError
        One of them is no number of 1 or more.

    Examples
    --------
    >>> condition_numbers("3,8,30")
    [3.0, 8.0, 30.0]
    """
    words = given.split(",") if isinstance(given, str) else list(map(str, given))
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = [math.nan]
    if not all(1.0 <= number < math.inf for number in numbers):
        text = "expected numbers of 1 or more, by commas: 3,8,30"
        raise InputError("--conditions", Complaint("A,B,C", repr(",".join(words)), text))
    return numbers
