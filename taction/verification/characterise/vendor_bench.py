"""The test bench of a vendor's subcircuit, and what ngspice measures on it.

The bench holds the operating point of a follower with an open loop: the voltage of the inverting
input is that of a node which follows the output with a time constant of 1e15 s. A coil of 1e12 H
and a capacitor of 1e12 F would be the same, but the rounding of their admittances spoils the output
of a large gain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.analysis import Transient
from taction.netlist_gen.deck.deck import Deck
from taction.spice_models.imported import Subcircuit, instance
from taction.system.array_types import Complexes, Floats
from taction.system.errors import SimulationError, SingularCircuit, StepTooSmall, TimedOut
from taction.system.own_folders import remove_own_folder
from taction.verification.characterise.operating_point import AT_ONCE, DeckPoint
from taction.verification.engines.ngspice.commands import RESULT, run_commands
from taction.verification.engines.ngspice.executable import Simulator
from taction.verification.engines.ngspice.process import simulate

OUT = "out"
DRIVEN = ("vdrive", "vinp", "iload")  # inverting input, other input, output
SERVO = ("gslow", "rslow", "cslow")
PORTS = {OUT: 1e-3, "inn": 1e-3, "of_inn": 1e-9, "of_inp": 1e-9}
"""What is read, and what a smaller value counts as: V, and A into the inputs for 1 V."""
SWITCHED = (
    ".options reltol=1e-4",
    ".options reltol=1e-3 gmin=1e-9",
    ".options reltol=1e-2 method=gear abstol=1e-9 vntol=1e-4",
)
"""Options for large steps, tried in this order: not every model converges with the first."""
CLAMPED = 100.0  # ohm, between the source of a large step and diodes at the input
LOAD = 10e3  # ohm, at the largest output
EDGE = 1e-3  # of the period of large steps: a jump in no time stops many a vendor's model
POINTS = 2000  # of a transient
TIMEOUT = 120.0  # s, of one run of ngspice
SWEEP = f"ac dec 40 1e-3 {1e10 * (1.0 + 1e-9)!r}"  # rounding could leave out the last frequency


@dataclass(frozen=True, slots=True)
class VendorBench:
    """A vendor's subcircuit on its bench."""

    subcircuit: Subcircuit
    pins: tuple[str, ...]  # the role of each port
    supply: float  # of each supply voltage, from the middle, V
    compensation: float = 0.0  # capacitor between the ports `comp`, F
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
            *("Gslow 0 slow out 0 1e-6", "Rslow slow 0 1e6", "Cslow slow 0 1e9"),
            "Eservo inn drive slow 0 1.0",
            "Vdrive drive 0 dc 0.0 ac 0.0",
            "Iload 0 out dc 0.0 ac 0.0",
            *([f"Rload out mid {LOAD!r}", f"Rstep far inp {CLAMPED!r}"] if step else []),
            *("Hof_inn of_inn 0 Vinn 1.0", "Hof_inp of_inp 0 Vinp -1.0", "Hof_vcc of_vcc 0 Vcc -1"),
        ]

    def switched(self, volts: float, period: float, simulator: Simulator) -> tuple[Floats, Floats]:
        """Return instants, s, and the output, V, that is driven to both of its ends.

        The non-inverting input is at +`volts` for a `period` in s, at -`volts` for the next, and at
        +`volts` for a third; all voltages from the middle of the supplies.
        """
        levels = (0.0, volts, -volts, volts)
        points = (
            f"{(k + late) * period!r} {levels[k + bool(late)]!r}"
            for k in range(3)
            for late in (0.0, EDGE)
        )
        plan = Transient(3.0 * period, period / POINTS, initial="rest")
        run = f".tran {plan.max_step!r} {plan.stop!r} 0.0 {plan.max_step!r}"
        cards = ["* bench of an imported op-amp", *self.lines(f"pwl({' '.join(points)})")]
        for options in SWITCHED:
            text = "\n".join([*cards, options, f".save v({OUT})", run, ".end", ""])
            try:
                wave = simulate(Deck(text, (OUT,), plan), simulator, timeout=TIMEOUT)
                return wave.time, wave[OUT] - self.middle
            except (SingularCircuit, StepTooSmall, TimedOut) as error:
                failure = error
                if failure.folder is not None and options != SWITCHED[-1]:
                    remove_own_folder(failure.folder)
        raise failure


@dataclass(frozen=True, slots=True, eq=False)
class Responses:
    """What a vendor's subcircuit shows on its bench."""

    frequencies: Floats  # (P,), Hz
    every: Complexes  # (3, 4, P): `PORTS` for 1 V or 1 A of each of `DRIVEN`
    output: float  # at rest, V from the middle of the supplies, as `inverting`
    inverting: float
    into_inverting: float  # A, as the others
    into_other: float
    supply_current: float

    @property
    def gain(self) -> Complexes:
        """Open-loop gain from the inverting input, (P,)."""
        return np.asarray(-self.every[0, 0] / self.every[0, 1])

    @property
    def admittances(self) -> tuple[Complexes, Complexes, Complexes]:
        """Of the inverting input, S, that of the other, and the other's current for 1 V here."""
        of_inn, of_inp = self.every[0, 2:] / self.every[0, 1]
        return of_inn, self.every[1, 3], of_inp


def respond(bench: VendorBench, point: DeckPoint, simulator: Simulator) -> Responses:
    """Return operating point and small signals of a bench at the `point` that was found of it."""
    commands = [*([AT_ONCE] if point.text else []), "save all", "op", f"write {RESULT}"]
    for source in DRIVEN:  # each from a new start, which the same point follows
        commands += [
            "set appendwrite",
            "reset",
            f"alter {source} acmag=1",
            SWEEP,
            f"write {RESULT}",
        ]
    text = point.text or point.lines
    answers = run_commands(text, commands, simulator, mode=point.mode, seconds=TIMEOUT)
    if len(answers.plots) != 1 + len(DRIVEN):
        raise SimulationError(f"ngspice does not simulate the model: {answers.complaint}")
    rest, *driven = (
        dict(zip(map(str.lower, names), values.T, strict=True)) for names, values in answers.plots
    )
    volts = [float(rest[f"v({node})"][-1].real) for node in (*PORTS, "of_vcc")]
    every = np.array([[each[f"v({port})"] for port in PORTS] for each in driven])
    frequencies = driven[0]["frequency"].real  # as ngspice rounded them
    middle = np.array([bench.middle, bench.middle, 0.0, 0.0, 0.0])
    return Responses(frequencies, every, *(volts - middle).tolist())
