"""The dialect of HSPICE: ``E`` sources with ``VOL=``, expressions in quotes, ``.option``."""

from __future__ import annotations

import re

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.deck.dialects.dialect import (
    DialectRequest,
    ForeignSpice,
    starts_from_rest,
    temperature_of,
)

_LOGARITHM = re.compile(r"\bln\(")  # HSPICE's natural logarithm is log


class HSPICE(ForeignSpice):
    """HSPICE with its classic step control (``runlvl=0``)."""

    name = "hspice"
    checked = (
        "written for HSPICE; checked with ngspice in its HSPICE mode (waveforms); not run by",
        "HSPICE itself: runlvl, delmax, post and probe are from its manual",
    )

    def behavioural(self, name: str, node: str, other: str, value: str) -> str:
        """Return an ``E`` source: ``B`` is a buffer of IBIS in HSPICE."""
        return f"E_{name} {node} {other} VOL='{_LOGARITHM.sub('log(', value)}'"

    def expression(self, text: str) -> str:
        """Return the expression in single quotes."""
        return f"'{text}'"

    def _card(self, line: str) -> str:
        if line.startswith(".include "):
            return f".include '{line.split()[1]}'"
        return super()._card(line)

    def _transient(self, request: DialectRequest, transient: Transient) -> list[str]:
        limits, celsius = request.limits, temperature_of(request.circuit)
        rest = starts_from_rest(request.circuit, transient)
        step = repr(transient.max_step)
        return [
            f".option reltol={limits.relative!r} abstol={limits.current!r}"
            f" vntol={limits.voltage!r} chgtol={limits.charge!r} gmin={limits.junction!r}",
            f".option method=trap runlvl=0 delmax={step} post=2 probe",
            *([f".temp {celsius}", f".option tnom={celsius}"] if celsius else []),
            ".probe tran " + " ".join(f"v({node})" for node in request.saved),
            f".tran {step} {transient.stop!r}" + ("" if rest else " uic"),
        ]
