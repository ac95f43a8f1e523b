"""The test bench of a vendor's subcircuit, which holds its operating point with an open loop."""

from __future__ import annotations

from dataclasses import dataclass

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.deck.deck import Deck
from taction.spice_models.imported import Subcircuit, instance

OUT = "out"
DRIVEN = ("vdrive", "vinp", "iload")  # inverting input, other input, output
VENDOR = (
    ".options reltol=1e-6 abstol=1e-15 vntol=1e-9",
    ".options reltol=1e-5 abstol=1e-13 vntol=1e-7",
    ".options reltol=1e-4",
)
"""Options of vendors' models, tried in this order: not every model converges with the first."""
SWITCHED = (
    ".options reltol=1e-4",
    ".options reltol=1e-3 gmin=1e-9",
    ".options reltol=1e-2 method=gear abstol=1e-9 vntol=1e-4",
)
"""Options for the large steps of vendors' models, likewise."""
SERVO = ("Gslow 0 slow out 0 1e-6", "Rslow slow 0 1e6", "Cslow slow 0 1e9")
PROBES = {"of_inn": "Vinn 1.0", "of_inp": "Vinp -1.0", "of_vcc": "Vcc -1.0"}
"""Nodes whose voltage is a current of the op-amp, A: into an input, and the supply's."""
CLAMPED = 100.0  # ohm, between the source of a large step and diodes at the input
LOAD = 10e3  # ohm, of a vendor's op-amp at its largest output


@dataclass(frozen=True, slots=True)
class VendorBench:
    """A vendor's subcircuit at the operating point of a follower, with open loop otherwise.

    The voltage of the inverting input is that of a node which follows the output with a time
    constant of 1e15 s: a follower at rest, and an open loop at every frequency above 1 uHz. A coil
    of 1e12 H and a capacitor of 1e12 F would be the same, but the admittance of that capacitor
    stands in the equations of the op-amp, and its rounding spoils the output of a large gain.
    """

    subcircuit: Subcircuit
    pins: tuple[str, ...]  # the role of each port
    supply: float  # of each supply voltage, from the middle, V
    compensation: float = 0.0  # capacitor between the ports `comp`, F
    options: str = VENDOR[0]
    middle: float = 0.0  # of the supplies: the non-inverting input at rest, V

    @property
    def wired(self) -> tuple[str, ...]:
        """The role of each port, with the node behind the probe of the inverting input."""
        return tuple("pin" if role == "inn" else role for role in self.pins)

    def lines(self, step: str = "") -> list[str]:
        """Return the cards, without those of an analysis.

        With a `step`, the voltage at the non-inverting input over the time, the output has a load,
        to the middle of the supplies. `DRIVEN` are the sources of small signals, which are off.
        """
        return [
            *self.subcircuit.lines,
            f"Vcc vcc 0 dc {self.middle + self.supply!r}",
            f"Vee vee 0 dc {self.middle - self.supply!r}",
            f"Vmid mid 0 dc {self.middle!r}",
            f"Vinp {'far' if step else 'inp'} mid dc 0.0 ac 0.0 {step}".rstrip(),
            instance(self.subcircuit, self.wired, self.compensation),
            "Vinn inn pin dc 0.0",  # its current is that of the pin
            *SERVO,
            "Eservo inn drive slow 0 1.0",
            "Vdrive drive 0 dc 0.0 ac 0.0",
            "Iload 0 out dc 0.0 ac 0.0",
            *([f"Rload out mid {LOAD!r}", f"Rstep far inp {CLAMPED!r}"] if step else []),
            *(f"H{node} {node} 0 {source}" for node, source in PROBES.items()),
        ]

    def deck(self, plan: Transient, step: str) -> Deck:
        """Return the deck of a transient, with its `step`."""
        title, save = "* test bench of an imported op-amp", f".save v({OUT})"
        run = f".tran {plan.max_step!r} {plan.stop!r} 0.0 {plan.max_step!r}"
        cards = [title, *self.lines(step), self.options, save, run, ".end", ""]
        return Deck("\n".join(cards), (OUT,), plan)
