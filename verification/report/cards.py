"""Cards of results for notebooks, from what the results hold: nothing is computed or read."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.card import Card
from taction.system.quantities import counted, quantity, sizes
from taction.verification.report.tables import spaced
from taction.verification.report.texts import figure
from taction.verification.studies.tolerance.yield_report import Spread, YieldReport

ORDER = ("pass", "fail", "inconclusive", "error")
CULPRITS = 4


def circuit_card(circuit: Circuit) -> Card:
    """Return the size of a board, the facts that its topology states, and its parts."""
    entries = sum(int(np.isfinite(matrix.ohms).sum()) for matrix in circuit.matrices)
    parts = (
        counted(len(circuit.opamps), "op-amp"),
        counted(entries, "matrix resistor"),
        counted(len(circuit.resistors), "other resistor"),
        counted(len(circuit.capacitors), "capacitor"),
    )
    facts = (
        ("size", sizes(len(circuit.outputs), len(circuit.constraint_nodes))),
        ("board", f"{circuit.topology}, {circuit.amplifier} amplifiers"),
        ("op-amps", f"{', '.join(circuit.models)}, supply ±{quantity(circuit.supply, 'V')}"),
        *((fact.label, fact.text) for fact in circuit.facts.values()),
        ("parts", ", ".join(parts)),
        ("left out", counted(len(circuit.omissions), "kind") + " of parts that it does not need"),
    )
    return Card("Circuit", circuit.name, facts=facts)


def _ordered(outcomes: Mapping[str, int]) -> list[tuple[str, int]]:
    return [(name, outcomes[name]) for name in ORDER if outcomes.get(name)]


def yield_card(name: str, report: YieldReport) -> Card:
    """Return the yield with its interval, the failed checks, the spreads and the culprits."""
    if not report.samples:
        return Card("Yield", name, summary="no sample: no yield")
    low, high = (f"{100 * share:.3g}" for share in (report.low, report.high))
    failed = report.samples - report.passed - report.without_verdict
    facts = [
        (spaced(check), f"{counted(number, 'sample')} of {report.samples} do not pass")
        for check, number in report.failures.items()
    ]
    if culprits := ", ".join(
        f"{each.parameter} ({spaced(each.quantity)} {each.correlation:+.2f})"
        for each in report.sensitivities[:CULPRITS]
    ):
        facts.append(("largest influence", culprits))
    if report.remedy is not None and report.remedy.what:
        share = f"{100 * report.remedy.fraction:.4g} %"
        facts.append(("what to buy better", f"{report.remedy.what}: yield {share}"))
    return Card(
        "Yield",
        name,
        summary=(
            f"yield {100 * report.fraction:.4g} % ({report.passed} of {report.samples}), 95 %"
            f" interval {low} to {high} %"
        ),
        shares=_ordered(
            {"pass": report.passed, "fail": failed, "inconclusive": report.without_verdict}
        ),
        facts=facts,
        titles=("quantity", "limit", "5 %", "median", "95 %"),
        rows=[_spread(spread) for spread in report.quantities],
    )


def _spread(spread: Spread) -> tuple[str, ...]:
    limits = ", ".join(
        f"{sign} {figure(value, spread.unit, 3)}"
        for sign, value in (("≥", spread.at_least), ("≤", spread.at_most))
        if value is not None
    )
    quantiles = (
        figure(value, spread.unit, 3) for value in (spread.low, spread.median, spread.high)
    )
    return (spaced(spread.name), limits, *quantiles)
