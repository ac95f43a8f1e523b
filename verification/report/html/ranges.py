"""The spread of a quantity beside its limits, as places on a line."""

from __future__ import annotations

from collections.abc import Mapping

from taction.verification.report.html.blocks import Range
from taction.verification.report.html.texts import figure
from taction.verification.report.tables import spaced

MARGIN = 1.15  # of the largest value or limit: the width of the line
Limits = tuple[float | None, float | None]  # the least and the largest accepted value


def is_beyond(value: float, limits: Limits) -> bool:
    """Whether a value is outside its limits."""
    least, most = limits
    return (least is not None and value < least) or (most is not None and value > most)


def value_range(
    name: str, unit: str, values: Mapping[str, float], limits: Limits, missing: str = ""
) -> Range:
    """Return the spread of a quantity.

    Parameters
    ----------
    values : mapping of str to float
        The least, the typical and the largest value, finite, by their names in the report.
    missing : str
        Which values the quantity lacks, in words; they do not pass.

    Examples
    --------
    >>> found = value_range("rise_time", "s", {"least": 1.0, "mid": 2.0, "most": 4.0}, (None, 3.0))
    >>> found.outcome, found.texts[-1], round(4 * found.high / found.limits[0], 3)
    ('fail', 'limit 3 s', 5.333)
    """
    known = [limit for limit in limits if limit is not None]
    low, middle, high = values.values()
    bottom = min(0.0, low, *known)
    top = MARGIN * max(0.0, high, *known)
    width = (top - bottom) or 1.0
    fails = is_beyond(low, limits) or is_beyond(high, limits) or bool(missing)
    texts = [f"{title} {figure(value, unit)}" for title, value in values.items()]
    texts += [f"limit {figure(limit, unit)}" for limit in known]
    return Range(
        name=spaced(name),
        low=(low - bottom) / width,
        middle=(middle - bottom) / width,
        high=(high - bottom) / width,
        limits=tuple((limit - bottom) / width for limit in known),
        outcome=("fail" if fails else "pass") if known else "",
        texts=(*texts, missing) if missing else tuple(texts),
    )
