"""What a verdict says about imported op-amps."""

from __future__ import annotations

from collections.abc import Iterator

from taction.netlist_gen.board.circuit import Circuit
from taction.spice_models.imported import ImportedOpAmp
from taction.system.quantities import show


def missing_witness(circuit: Circuit, engine: str) -> str:
    """Return which of the two witnesses a board with imported op-amps lacks; empty for none.

    Without a linear model the state-space engine has the two poles of the measured figures, which
    is an estimate and confirms nothing. Without ngspice nothing has the limits of the netlist.
    """
    for name, imported in _imported(circuit):
        if imported.linear is None:
            return f"op-amp {name} has no state-space witness: {imported.missing}"
        if engine != "ngspice":
            return f"the slew rate and limits of op-amp {name} are in its netlist: run ngspice"
    return ""


def notes(circuit: Circuit) -> tuple[str, ...]:
    """Return one remark about the linear model of each imported op-amp."""
    return tuple(
        f"op-amp {name} is imported: the state-space engine has its linear model, within"
        f" {100.0 * imported.linear.error:.2g} % of its simulated response up to"
        f" {show(imported.linear.band[1], 'Hz', 3)}"
        for name, imported in _imported(circuit)
        if imported.linear is not None
    )


def _imported(circuit: Circuit) -> Iterator[tuple[str, ImportedOpAmp]]:
    for name, model in circuit.models.items():
        if model.imported is not None:
            yield name, model.imported
