"""New scalings of a board, and the scene that is made for a matrix."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from taction.system.quantities import show
from taction.verification.design.fresh_scene import NewScene
from taction.verification.design.scaling import Scaled
from taction.verification.report.blocks import EVERYWHERE, Notes, Page, Section
from taction.verification.verdict.headroom import describe


def view(result: Scaled) -> Page:
    """Return the page of the scalings, the loads, and what the checks say."""
    scaling = result.scaling
    return Page(
        title=scaling.scene.name,
        command="taction new --from",
        outcome=result.verdict.outcome.value,
        sections=(Section("Scalings", (Notes("", tuple(_lines(result))),), media=EVERYWHERE),),
        foot=("verified by the state-space engine",),
    )


def _lines(result: Scaled) -> Iterator[str]:
    scaling, facts = result.scaling, result.scaling.circuit.facts
    shown = (facts[name] for name in ("G0", "U0", "gain", "R", "C"))
    yield ", ".join(f"{fact.symbol} = {show(fact.value, fact.unit)}" for fact in shown)
    low, high = (show(ohms, "ohm") for ohms in scaling.matrix_ohms)
    yield f"matrix resistors from {low} to {high}; lambda stays {facts['lambda'].value:.4g}"
    yield from (f"{describe(load)} ({load.share:.0%})" for load in scaling.loads)
    yield from (f"note: {note}" for note in scaling.notes)
    for check in result.verdict.checks:
        if check.outcome.value != "pass":
            yield f"{check.name}: {check.outcome.value}: {check.reason}"


def new_view(result: NewScene) -> Page:
    """Return the page of a new scene: what was recognised, how lambda was chosen, the scalings."""
    if result.fresh is None or result.scaled is None:
        return Page(result.file, "taction new", "", "", (), ())
    found = (*result.fresh.notes, f"lambda {result.fresh.rule}")
    return replace(view(result.scaled), title=result.file, command="taction new", lines=found)
