"""What ngspice measures of a vendor's subcircuit on its bench."""

from __future__ import annotations

from dataclasses import dataclass, replace

from taction.netlist_gen.analysis import Transient
from taction.system.array_types import Complexes, Floats
from taction.system.errors import SimulationError, SingularCircuit, StepTooSmall, TimedOut
from taction.system.own_folders import remove_own_folder
from taction.verification.characterise.bench import (
    DRIVEN,
    OUT,
    PROBES,
    SWITCHED,
    VENDOR,
    VendorBench,
)
from taction.verification.engines.ngspice.commands import RESULT, run_commands
from taction.verification.engines.ngspice.executable import Simulator
from taction.verification.engines.ngspice.process import simulate

EDGE = 1e-3  # of the period of large steps: a jump in no time stops many a vendor's model
POINTS = 2000  # of a transient
TIMEOUT = 120.0  # s, of one run of ngspice
SWEEP = f"ac dec 40 1e-3 {1e10 * (1.0 + 1e-9)!r}"  # rounding could leave out the last frequency


@dataclass(frozen=True, slots=True, eq=False)
class Responses:
    """What a vendor's subcircuit shows on its `bench`.

    `frequencies` (P,), Hz; `gain`, `impedance` and `admittance` (P,): open-loop gain from the
    inverting input, output impedance, ohm, and the admittance of the inverting input, S;
    `mutual_admittance` is the current into the other input for a voltage at the inverting one;
    `other_gain` and `other_admittance` are those of the non-inverting input. At the operating
    point: `output` and `inverting`, V from the middle of the supplies; the
    currents into both inputs, and the `supply_current`, A.
    """

    bench: VendorBench
    frequencies: Floats
    gain: Complexes
    impedance: Complexes
    admittance: Complexes
    mutual_admittance: Complexes
    other_gain: Complexes
    other_admittance: Complexes
    output: float
    inverting: float
    into_inverting: float
    into_other: float
    supply_current: float


class Simulation:
    """ngspice on the bench of a vendor's subcircuit."""

    def __init__(self, simulator: Simulator) -> None:
        self.simulator = simulator

    def responses(self, bench: VendorBench) -> Responses:
        """Return operating point and small signals of a vendor's subcircuit.

        Raises
        ------
        SimulationError
            No run, with any of the options `VENDOR`.
        """
        commands = ["save all", "op", f"write {RESULT}", "set appendwrite"]
        for source in DRIVEN:  # each from a new start, which the same point follows
            commands += ["reset", f"alter {source} acmag=1", SWEEP, f"write {RESULT}"]
        for options in VENDOR:
            cards = [*bench.lines(), options]
            answers = run_commands(cards, commands, self.simulator, seconds=TIMEOUT)
            if len(answers.plots) == 1 + len(DRIVEN):
                break
        else:
            raise SimulationError(f"ngspice does not simulate the model: {answers.complaint}")
        rest, one, other, loaded = (
            dict(zip(map(str.lower, names), values.T, strict=True))
            for names, values in answers.plots
        )
        output, inverting, into_inverting, into_other, supply = (
            float(rest[f"v({node})"][-1].real) for node in (OUT, "inn", *PROBES)
        )
        inn = one["v(inn)"]
        return Responses(
            bench=replace(bench, options=options),
            frequencies=one["frequency"].real,  # as ngspice rounded them
            gain=-one["v(out)"] / inn,
            impedance=loaded["v(out)"],
            admittance=one["v(of_inn)"] / inn,
            mutual_admittance=one["v(of_inp)"] / inn,
            other_gain=other["v(out)"],
            other_admittance=other["v(of_inp)"],
            output=output - bench.middle,
            inverting=inverting - bench.middle,
            into_inverting=into_inverting,
            into_other=into_other,
            supply_current=supply,
        )

    def switched(self, bench: VendorBench, volts: float, period: float) -> tuple[Floats, Floats]:
        """Return instants, s, and the output, V, that is driven to both of its ends.

        The non-inverting input is at +`volts` for a `period` in s, at -`volts` for the next, and at
        +`volts` for a third; all voltages from the middle of the supplies.
        """
        turns = (0.0, period, 2.0 * period)
        points = (
            f"{turn + delay!r} {value!r}"
            for turn, before, after in zip(turns, (0.0, 1, -1), (1, -1, 1), strict=True)
            for delay, value in ((0.0, before * volts), (EDGE * period, after * volts))
        )
        step = f"pwl({' '.join(points)})"
        plan = Transient(3.0 * period, period / POINTS, initial="rest")

        for options in SWITCHED:
            deck = replace(bench, options=options).deck(plan, step)
            try:
                wave = simulate(deck, self.simulator, timeout=TIMEOUT)
                return wave.time, wave[OUT] - bench.middle
            except (SingularCircuit, StepTooSmall, TimedOut) as error:
                failure = error
                if failure.folder is not None and options != SWITCHED[-1]:
                    remove_own_folder(failure.folder)
        raise failure
