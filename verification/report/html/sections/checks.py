"""The checks of a verdict with their margins, and what the op-amps have to do."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from taction.system.quantities import readable
from taction.verification.report.html.blocks import Bar, Bars, Block, Notes, Section
from taction.verification.report.html.texts import figure, with_error
from taction.verification.report.tables import spaced

AT_LEAST = ("stability",)  # checks with a smallest value
SHOWN = 16  # loads of op-amps
MARGINS = (
    "The bar is the part of the limit that is used, the thin line on its end the uncertainty. A"
    " check is inconclusive where the uncertainty reaches the limit."
)
SHAPES = "Blue and solid: within the limit. Orange and hatched: beyond it. Dotted: not decided."


def checks_section(document: Mapping[str, Any], least: Mapping[str, float]) -> Section:
    """Return the checks of the JSON document of a verdict, and its warnings.

    `least` are the smallest accepted values of the checks that have a largest one, too.
    """
    rows = [check_bar(check, least.get(check["name"])) for check in document["checks"]]
    bars = Bars("", tuple(rows), f"{MARGINS} {SHAPES}")
    warnings = tuple(map(readable, document["warnings"]))
    more: tuple[Block, ...] = (Notes("Warnings", warnings),) if warnings else ()
    return Section("Checks", (bars, *more))


def check_bar(check: Mapping[str, Any], smallest: float | None = None) -> Bar:
    """Return a check as a bar; below `smallest`, the bar shows how far.

    Examples
    --------
    >>> bar = check_bar({"name": "overshoot", "outcome": "pass", "value": 0.1, "uncertainty": 0.01,
    ...                  "expected": 0.4, "tolerance": None, "unit": "step", "reason": ""})
    >>> bar.value, bar.limit, bar.used
    ('10 % ± 1 %', 'at most 40 %', '25 % of the limit')
    """
    value, unit, name = check["value"], check["unit"], check["name"]
    limit = check["tolerance"] if check["tolerance"] is not None else check["expected"]
    least = name in AT_LEAST and unit == "ratio"
    if smallest is not None and value is not None and value < smallest:
        limit, least = smallest, True
    share, doubt = _share(value, limit, check["uncertainty"] or 0.0, least=least)
    side = "at least" if least else "below" if unit == "1/s" else "at most"
    return Bar(
        name=spaced(name),
        outcome=check["outcome"],
        share=share,
        doubt=doubt,
        value=with_error(value, check["uncertainty"], unit),
        limit="" if limit is None else f"{side} {figure(limit, unit)}",
        reason=readable(check["reason"]),
    )


def _share(
    value: float | None, limit: float | None, error: float, *, least: bool
) -> tuple[float | None, float]:
    """Return the part of the limit that a value uses, and its uncertainty."""
    if value is None or limit is None or not math.isfinite(value) or limit <= 0.0:
        return None, 0.0
    error = error if math.isfinite(error) else 0.0
    if not least:
        return abs(value) / limit, error / limit
    return (limit / value, limit * error / value**2) if value > 0.0 else (None, 0.0)


def headroom_section(loads: Iterable[Mapping[str, Any]], *, limited: bool) -> Section:
    """Return what the op-amps have to do beside their limits, the largest share first.

    `limited` says whether the simulated op-amps have the limits, so that a load above them decides
    nothing.
    """
    ordered = sorted(loads, key=lambda load: -load["share"])
    if not ordered:
        text = "No op-amp of this board has a limit of slew rate, swing or current in its model."
        return Section("Headroom", (Notes("", (text,)),))
    note = f"{len(ordered) - SHOWN} smaller loads are not shown." if len(ordered) > SHOWN else ""
    rows = tuple(_load_bar(load, limited=limited) for load in ordered[:SHOWN])
    bars = Bars("", rows, note)
    lead = "What the outputs of the op-amps reach, as parts of the limits of the data sheet."
    if limited:
        lead += (
            " The simulated op-amps have these limits. A bar beyond its limit is what the same"
            " op-amp without limits would have to do."
        )
    return Section("Headroom", (bars,), lead)


def _load_bar(load: Mapping[str, Any], *, limited: bool) -> Bar:
    outcome = "fail" if load["share"] > 1.0 else "pass"
    when = "at rest" if load["time"] is None else f"at {figure(load['time'], 's', 3)}"
    return Bar(
        name=f"{load['quantity']} of {load['part']}",
        outcome="" if limited else outcome,
        share=load["share"],
        doubt=(load["error"] or 0.0) / load["limit"],
        value=f"{_amount(load['peak'], load['unit'])} {when}",
        limit=f"at most {_amount(load['limit'], load['unit'])}",
        reason="",
    )


def _amount(value: float, unit: str) -> str:
    return figure(value, unit, 3)
