"""The dialect of Xyce: ``B`` sources with braces, options by package, ``.print``."""

from __future__ import annotations

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.deck.dialects.dialect import (
    DialectRequest,
    ForeignSpice,
    starts_from_rest,
    temperature_of,
)


class Xyce(ForeignSpice):
    """Xyce 7."""

    name = "xyce"
    checked = (
        "written for Xyce; its parts were checked with ngspice and, on linear boards, with gnucap;",
        "not run by Xyce itself: .options and .print are from its manual, and unchecked",
    )
    measures = False

    def behavioural(self, name: str, node: str, other: str, value: str) -> str:
        """Return a ``B`` source with its expression in braces."""
        return f"B{name} {node} {other} V={{{value}}}"

    def _transient(self, request: DialectRequest, transient: Transient) -> list[str]:
        limits, celsius = request.limits, temperature_of(request.circuit)
        device = f" temp={celsius} tnom={celsius}" if celsius else ""
        rest = starts_from_rest(request.circuit, transient)
        return [
            f".options device gmin={limits.junction!r}{device}",
            f".options nonlin-tran reltol={limits.relative!r} abstol={limits.voltage!r}",
            f".options timeint method=trap reltol={limits.relative!r} abstol={limits.voltage!r}",
            ".print tran " + " ".join(f"v({node})" for node in request.saved),
            f".tran {transient.begin!r} {transient.stop!r} 0 {transient.max_step!r}"
            + ("" if rest else " uic"),
        ]
