"""Test benches of an imported op-amp in ngspice: operating point, gain, inputs, output.

A coil of 1e12 H from the output to the inverting input is a follower for the operating point and
open for every other frequency; a capacitor of 1e12 F then holds that input on the source.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from taction.netlist_gen.analysis import Analysis, Band, OperatingPoint, SmallSignal
from taction.spice_models.foreign_netlist import Subcircuit
from taction.spice_models.imported import instance
from taction.system.array_types import Complexes, Floats
from taction.verification.engines.ngspice.process import find_simulator, start

BAND = Band(start=1e-3, steps=520, density=40)  # 1 mHz to 10 GHz
TIMEOUT = 120.0  # s
SAVED = ("out", "inn", "amps")


@dataclass(frozen=True, slots=True)
class _BenchDeck:
    text: str
    analysis: Analysis
    saved: tuple[str, ...] = SAVED
    files: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """What the benches show.

    `frequencies` (P,), Hz; `gain`, `impedance` and `admittance` (P,): open-loop gain, output
    impedance, ohm, and the admittance of the inverting input, S. `output`, `inverting`, V, and
    `bias_current` into the inverting input, A, at the operating point, and the `supply_current`, A.
    """

    frequencies: Floats
    gain: Complexes
    impedance: Complexes
    admittance: Complexes
    output: float
    inverting: float
    bias_current: float
    supply_current: float


def measure(subcircuit: Subcircuit, pins: tuple[str, ...], supply: float) -> Measured:
    """Run the benches.

    Raises
    ------
    SimulationError
        ngspice is missing, or a run does not show all its evidence.
    """
    wired = tuple("pin" if role == "inn" else role for role in pins)
    powered = [
        "* test bench of an imported op-amp",
        *subcircuit.lines,
        f"Vcc vcc 0 dc {supply!r}",
        f"Vee vee 0 dc {-supply!r}",
        "Vinp inp 0 dc 0.0",
        instance(subcircuit, wired),
        "Vinn inn pin dc 0.0",  # its current is that of the pin
        ".options reltol=1e-6 abstol=1e-15 vntol=1e-9",
        ".save " + " ".join(f"v({node})" for node in SAVED),
    ]
    servo = [*powered, "Lservo out inn 1e12", "Cdrive drive inn 1e12"]
    pin, supplied = "Hamps amps 0 Vinn 1.0", "Hamps amps 0 Vcc -1.0"
    rest = _rest([*servo, "Vdrive drive 0 dc 0.0", pin])
    power = _rest([*servo, "Vdrive drive 0 dc 0.0", supplied])
    frequencies, driven = _respond([*servo, "Vdrive drive 0 dc 0.0 ac 1.0", pin])
    loaded = _respond([*servo, "Vdrive drive 0 dc 0.0", "Iload 0 out dc 0.0 ac 1.0", pin])[1]
    # The servo's capacitor would bury the current of the pin in rounding.
    held = _respond([*powered, f"Vdrive inn 0 dc {float(rest[1])!r} ac 1.0", pin])[1]
    return Measured(
        frequencies=frequencies,
        gain=-driven[:, 0] / driven[:, 1],
        impedance=loaded[:, 0],
        admittance=held[:, 2] / held[:, 1],
        output=float(rest[0]),
        inverting=float(rest[1]),
        bias_current=float(rest[2]),
        supply_current=float(power[2]),
    )


def _rest(cards: list[str]) -> Floats:
    deck = _BenchDeck("\n".join([*cards, ".op", ".end", ""]), OperatingPoint())
    with start(deck, find_simulator(), timeout=TIMEOUT) as run:
        return np.asarray(run.result().values[-1])


def _respond(cards: list[str]) -> tuple[Floats, Complexes]:
    card = f".ac dec {BAND.density} {BAND.start!r} {BAND.stop!r}"
    deck = _BenchDeck("\n".join([*cards, card, ".end", ""]), SmallSignal(BAND))
    with start(deck, find_simulator(), timeout=TIMEOUT) as run:
        frequencies, values = run.response()
    return np.asarray(frequencies), values
