"""The linear circuit of a vendor's op-amp: its cards on the bench, each measured where it rests.

Nothing is fitted. ngspice's own small signal of the bench is the witness, from three sources.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import scipy.linalg

from taction.netlist_gen.analysis import OperatingPoint
from taction.netlist_gen.board.branches import Source
from taction.netlist_gen.board.linear_models import record_of
from taction.netlist_gen.board.parts import Branch, Capacitor, Resistor
from taction.netlist_gen.deck.flat_cards import CardError, Flat, circuit_of, read_cards
from taction.spice_models.imported import LinearModel, LinearPart
from taction.system.array_types import Complexes, Floats
from taction.system.errors import EngineError, SimulationError, one_line
from taction.system.quantities import show_rate
from taction.verification.characterise.bench import OUT, PROBES, VendorBench
from taction.verification.characterise.element_bench import measured
from taction.verification.characterise.element_parts import add_measured
from taction.verification.characterise.operating_point import find_point
from taction.verification.characterise.witnesses import Responses
from taction.verification.engines.ngspice.executable import Simulator
from taction.verification.engines.statespace.linearised.board import LinearBoard

GOOD = 1e-4  # largest relative difference from ngspice of a linear model that serves as a witness
REACH = 30.0  # the highest compared frequency, in unity-gain bandwidths
LEAST_OHMS = 1e-3  # an output impedance counts at least as this
PIN_FARADS, PIN_SIEMENS = 1e-12, 1e-9  # what a pin and its trace add to an input anyway
HELD = 1e-9  # 1/s: the servo of the bench is slower, every pole of an op-amp is faster
BENCH = ("Vinp", "Vinn", "Vmid", "Vdrive", "Eservo", "Iload", "Gslow", "Rslow", "Cslow")
EXCITED = {"inn": "Vdrive", "inp": "Vinp", "out": "Iload"}


def linear_model(
    measured_by_ngspice: Responses, unity: float, simulator: Simulator
) -> tuple[LinearModel | None, str]:
    """Return the linear circuit of an op-amp, or None and the reason.

    Parameters
    ----------
    measured_by_ngspice : Responses
        What the circuit is compared with.
    unity : float
        Unity-gain bandwidth, Hz.
    """
    bench = measured_by_ngspice.bench
    try:
        flat = _linear_bench(bench, simulator)
        parts = _parts(flat)
        found = _responses(flat, measured_by_ngspice.frequencies)
        pole = _unstable(flat)
    except (CardError, EngineError, SimulationError, np.linalg.LinAlgError) as error:
        return None, f"no linear model: {one_line(error)}"
    f = measured_by_ngspice.frequencies
    used = f <= REACH * unity
    if pole:
        return None, f"no linear model: the netlist itself has a pole at {show_rate(pole.real)}"
    errors = _errors(measured_by_ngspice, found, used)
    worst = max(errors, key=errors.__getitem__)
    if not errors[worst] <= GOOD:
        return None, (
            f"no linear model: its {worst} is {100.0 * errors[worst]:.2g} % from the small signal"
            f" of ngspice, more than {100.0 * GOOD:g} %"
        )
    band = (float(f[0]), float(f[used][-1]))
    return LinearModel(parts, errors[worst], band), ""


def _linear_bench(bench: VendorBench, simulator: Simulator) -> Flat:
    """Return the linear parts of the bench at its operating point, in ngspice's own mode."""
    lines = [
        line
        for line in bench.deck(OperatingPoint()).text.splitlines()[1:]
        if not line.startswith((".save", ".op", ".end", "*")) or line.startswith(".ends")
    ]
    point = find_point(lines, "", simulator, modes=("",))
    flat = read_cards(point.found.linear)
    add_measured(flat, measured(point.found, point.volts, point.options, simulator))
    return flat


def _parts(flat: Flat) -> tuple[LinearPart, ...]:
    """Return the parts of the op-amp with its supplies: the bench without what drives it."""
    outside = {name.lower() for name in (*BENCH, *(f"H{node}" for node in PROBES))}
    every: list[Resistor | Capacitor | Branch] = [
        *flat.resistors, *flat.capacitors, *flat.branches
    ]  # fmt: skip
    records = [record_of(part) for part in every if part.card.lower() not in outside]

    def port(node: str) -> str:
        return "inn" if node == "pin" else node

    return tuple(
        record if record.letter == "K" else replace(
            record,
            a=port(record.a),
            b=port(record.b),
            control=tuple(map(port, record.control)),
        )
        for record in records
    )  # fmt: skip


def _responses(flat: Flat, frequencies: Floats) -> dict[str, Complexes]:
    """Return what `Responses` has of a small signal: the bench's circuit at all frequencies."""
    saved = (OUT, "inn", *PROBES)
    found = {}
    for place, card in EXCITED.items():
        branches = [
            replace(part, value=float(part.card.lower() == card.lower()), before=0.0)
            if isinstance(part, Source)
            else part
            for part in flat.branches
        ]
        board = LinearBoard(circuit_of(replace(flat, branches=branches), "bench", saved))
        descriptor = board.descriptor
        M, K = descriptor.dense.mass, descriptor.dense.stiffness
        places = [descriptor.place(node) for node in saved]
        s = 2j * math.pi * frequencies
        found[place] = np.array([_solved(x * M - K, descriptor.switched)[places] for x in s])
    one, other, loaded = (found[place] for place in ("inn", "inp", "out"))
    return {
        "gain": -one[:, 0] / one[:, 1],
        "impedance": loaded[:, 0],
        "admittance": one[:, 2] / one[:, 1],
        "other_admittance": other[:, 3],
    }


def _solved(A: Complexes, b: Floats) -> Complexes:
    """Solve with rows and columns scaled, and refine once."""
    rows = 1.0 / np.maximum(np.abs(A).max(axis=1), 1e-300)
    B = A * rows[:, None]
    columns = 1.0 / np.maximum(np.abs(B).max(axis=0), 1e-300)
    factors = scipy.linalg.lu_factor(B * columns)
    wanted = rows * b
    x = scipy.linalg.lu_solve(factors, wanted)
    x = x + scipy.linalg.lu_solve(factors, wanted - (B * columns) @ x)
    return np.asarray(x * columns)


def _unstable(flat: Flat) -> complex:
    """Return the fastest growing pole of the op-amp with its inputs held; 0 without one."""
    space = LinearBoard(circuit_of(flat, "bench", (OUT,))).state_space
    grown = [pole for pole in np.linalg.eigvals(space.A).tolist() if pole.real > HELD]
    return max(grown, key=lambda pole: pole.real, default=0j)


def _errors(theirs: Responses, ours: dict[str, Complexes], used: object) -> dict[str, float]:
    """Return the largest relative differences up to the highest frequency that counts."""
    s = 2j * np.pi * theirs.frequencies
    pin = PIN_SIEMENS + np.abs(s) * PIN_FARADS
    floors = {"gain": 0.0, "impedance": LEAST_OHMS, "admittance": pin, "other_admittance": pin}
    names = {
        "gain": "gain",
        "impedance": "output impedance",
        "admittance": "inverting input",
        "other_admittance": "other input",
    }
    found = {}
    for key, floor in floors.items():
        wanted = getattr(theirs, key)
        off = np.abs(ours[key] - wanted) / (np.abs(wanted) + floor)
        found[names[key]] = float(np.max(off[used]))
    return found
