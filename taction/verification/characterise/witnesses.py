"""What ngspice measures of a vendor's subcircuit on its bench."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from taction.netlist_gen.analysis import NoiseBand, OperatingPoint, SmallSignal, Transient
from taction.system.array_types import Complexes, Floats
from taction.system.errors import SingularCircuit, StepTooSmall, TimedOut
from taction.system.own_folders import remove_own_folder
from taction.verification.characterise.bench import OUT, SWITCHED, VENDOR, VendorBench
from taction.verification.engines.ngspice.executable import Simulator
from taction.verification.engines.ngspice.process import simulate, start

Found = TypeVar("Found")
EDGE = 1e-3  # of the period of large steps: a jump in no time stops many a vendor's model
POINTS = 2000  # of a transient
TIMEOUT = 120.0  # s, of one run of ngspice
WIDE = NoiseBand(start=1e-3, steps=520, density=40)  # 1 mHz to 10 GHz: of a vendor's model


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
        return self._with_options(bench, VENDOR, self._responses)

    def _with_options(
        self, bench: VendorBench, all_options: Sequence[str], run: Callable[[VendorBench], Found]
    ) -> Found:
        """Return what a run gives with the first options with which it ends well."""
        for options in all_options:
            try:
                return run(replace(bench, options=options))
            except (SingularCircuit, StepTooSmall, TimedOut) as error:
                failure = error
                if failure.folder is not None and options != all_options[-1]:
                    remove_own_folder(failure.folder)
        raise failure

    def _responses(self, bench: VendorBench) -> Responses:
        with start(bench.deck(OperatingPoint()), self.simulator, timeout=TIMEOUT) as run:
            output, inverting, *amps = map(float, run.result().values[-1])
            output, inverting = output - bench.middle, inverting - bench.middle
        f, one = self._respond(bench, "inn")
        other, loaded = (self._respond(bench, place)[1] for place in ("inp", "out"))
        return Responses(
            bench=bench,
            frequencies=f,  # as ngspice rounded them
            gain=-one[:, 0] / one[:, 1],
            impedance=loaded[:, 0],
            admittance=one[:, 2] / one[:, 1],
            mutual_admittance=one[:, 3] / one[:, 1],
            other_gain=other[:, 0],
            other_admittance=other[:, 3],
            output=output,
            inverting=inverting,
            into_inverting=amps[0],
            into_other=amps[1],
            supply_current=amps[2],
        )

    def _respond(self, bench: VendorBench, excited: str) -> tuple[Floats, Complexes]:
        deck = bench.deck(SmallSignal(WIDE), excited)
        with start(deck, self.simulator, timeout=TIMEOUT) as run:
            f, values = run.response()
        return np.asarray(f), values

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

        def run(bench: VendorBench) -> tuple[Floats, Floats]:
            wave = simulate(bench.deck(plan, step=step), self.simulator, timeout=TIMEOUT)
            return wave.time, wave[OUT] - bench.middle

        return self._with_options(bench, SWITCHED, run)
