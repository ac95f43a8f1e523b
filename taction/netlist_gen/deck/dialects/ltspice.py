"""The dialect of LTspice: ``B`` sources and braces as ngspice has them, other options."""

from __future__ import annotations

import re

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.deck.dialects.dialect import (
    DialectRequest,
    ForeignSpice,
    starts_from_rest,
    temperature_of,
)

_RESULT = re.compile(r"^(\.meas .* )param='([^']*)'$")


class LTspice(ForeignSpice):
    """LTspice XVII and newer."""

    name = "ltspice"
    checked = (
        "written for LTspice; checked with ngspice in its LTspice mode (waveforms) and spicelib",
        "(names and values); not run by LTspice itself: plotwinsize, numdgt (no compression) and",
        ".meas PARAM are from its manual, and unchecked",
    )

    def behavioural(self, name: str, node: str, other: str, value: str) -> str:
        """Return a ``B`` source."""
        return f"B{name} {node} {other} V={value}"

    def _card(self, line: str) -> str:
        return _RESULT.sub(r"\1PARAM \2", super()._card(line))

    def _transient(self, request: DialectRequest, transient: Transient) -> list[str]:
        limits, celsius = request.limits, temperature_of(request.circuit)
        rest = starts_from_rest(request.circuit, transient)
        return [
            f".options reltol={limits.relative!r} abstol={limits.current!r}"
            f" vntol={limits.voltage!r} chgtol={limits.charge!r} gmin={limits.junction!r}",
            ".options method=trap plotwinsize=0 numdgt=15",
            *([f".options temp={celsius} tnom={celsius}"] if celsius else []),
            ".save " + " ".join(f"V({node})" for node in request.saved),
            f".tran {transient.begin!r} {transient.stop!r} 0 {transient.max_step!r}"
            + ("" if rest else " uic"),
        ]
