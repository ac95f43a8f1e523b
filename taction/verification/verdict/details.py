"""What a verdict says beside its checks: warnings, what limits it, and active sets.

While the amplifiers of a piecewise linear board keep their straight pieces it is linear. A set that
is visited on the way may be less stable than the one at rest, so it has a margin of its own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.part_warnings import part_warnings, stuck_cells
from taction.netlist_gen.scene.axes import questions
from taction.spice_models.imported import ImportedOpAmp
from taction.spice_models.input_errors import not_known
from taction.system.array_types import Floats, Ints
from taction.system.quantities import show, spaced
from taction.system.reading_definitions import EXCURSIONS, READINGS
from taction.verification.engines.statespace.equations.amplifier_gains import GAINS
from taction.verification.engines.statespace.equations.descriptor import Devices
from taction.verification.engines.statespace.linearised.equilibrium import Equilibrium
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.engines.statespace.transients.stepped import SteppedCurve, simulate
from taction.verification.reference.ideal_answer import IdealAnswer
from taction.verification.stability.margin import find_margin, first_knob
from taction.verification.stability.poles import poles
from taction.verification.verdict.checks import Evidence
from taction.verification.verdict.run import Run

WELL_ABOVE = 10.0  # a tolerance should be this many times the error of the simulation


IMPORTED = (
    "op-amp {} is imported: the state-space engine has its cards, linear about their rest, within"
    " {:.2g} % of ngspice's small signal up to {}"
)


def all_warnings(evidence: Evidence) -> tuple[str, ...]:
    """Return the warnings of the scene, the parts, the plan, the engine and the readings."""
    run = evidence.run
    board, notes = (None, ()) if run is None else (run.board, run.ends.flags)
    if board is not None:
        circuit = board.circuit
        notes = (
            *questions(board.scene),
            *notes,
            *board.plan.notes,
            *part_warnings(circuit, board.rest),
            *stuck_cells(circuit),
            *(
                IMPORTED.format(name, 100.0 * linear.error, show(linear.band[1], "Hz", 3))
                for name, imported in _imported(circuit)
                if (linear := imported.linear) is not None
            ),
            *not_known(circuit.models.values()),
        )
    return (*notes, *(_of_readings(evidence) if evidence.poles.known_stable else ()))


def _of_readings(evidence: Evidence) -> Iterator[str]:
    """Yield tolerances too close to the error of the simulation, and fragile readings."""
    errors, checks = evidence.reading_errors, evidence.limits
    limits = {"steady_state": ("tolerance", checks.steady_state.tolerance, evidence.end_error)}
    for name in EXCURSIONS:
        if (check := getattr(checks, name)) is not None:
            limits[name] = "limit", check.max, errors[name]
    for name, (kind, limit, off) in limits.items():
        if limit < WELL_ABOVE * off:
            yield (
                f"{name}: the {kind} {limit:g} is not well above the error {off:.2g} of the"
                " simulation; set a smaller analysis.error or a larger analysis.points_per_period"
            )
    if evidence.poles.damping_ratio < 1e-3:
        yield (
            f"damping ratio {evidence.poles.damping_ratio:.2g}: the board nearly oscillates;"
            " component tolerances can make it oscillate"
        )
    for channel in evidence.measurements.channels:
        for name, reading in channel.fragile.items():
            if reading.alternative is not None:
                unit, shifted = READINGS[name].unit, READINGS[name].shifted
                yield (
                    f"channel {channel.index + 1}: {spaced(name)} {show(reading.value, unit)} is"
                    f" fragile: {show(reading.alternative, unit)} with {shifted}"
                )


def missing_witness(circuit: Circuit, engine: str) -> str:
    """Return which of the two witnesses a board with imported op-amps lacks; empty for none."""
    for name, imported in _imported(circuit):
        if imported.linear is None:
            return f"op-amp {name} has no state-space witness: {imported.missing}"
        if engine != "ngspice":
            return f"the slew rate and limits of op-amp {name} are in its netlist: run ngspice"
    return ""


def _imported(circuit: Circuit) -> Iterator[tuple[str, ImportedOpAmp]]:
    for name, model in circuit.models.items():
        if model.imported is not None:
            yield name, model.imported


ROUNDED = 1e-9  # relative difference of two formulas for one number; rounding is far below
START = 0.1  # of the step amplitude: rounded resistors move the rest of a board by less
UNSEEN = 1e-12  # V: far below the noise of any board, and above the rounding of a start at 0 V


def find_contradiction(circuit: Circuit, ideal: IdealAnswer, start: Floats) -> str:
    """Return how the board, or the `start` (N,) of its record, V, contradicts the reference.

    Where they differ they are not of the same problem, and the verdict is worth nothing. The starts
    are compared only with a reference whose error is smaller than the step.
    """
    network = ideal.network
    wanted_facts = {"lambda": network.lam, "U0": network.U0, "Ve": network.Ve}
    for name, wanted in wanted_facts.items():
        if name not in circuit.facts:
            continue  # Ve: a linear board has none
        stated = circuit.value(name)
        if not math.isclose(stated, wanted, rel_tol=ROUNDED):
            key = circuit.facts[name].key.rpartition(".")[2]
            return f"the board states {key} = {stated!r}, the reference uses {wanted!r}"
    if ideal.problem or ideal.error >= 1.0:
        return ""
    away = np.abs(start - ideal.start)
    n = int(np.argmax(away))
    if away[n] > max(START * np.abs(ideal.target - ideal.start).max(), UNSEEN):
        here, there = (show(float(u[n]), "V") for u in (start, ideal.start))
        return f"channel {n + 1} starts at {here}, in the reference at {there}"
    return ""


ROUNDS, PARTS = 3, 16  # of the search for where a stretch begins, and parts of a step in each
AT_BREAK = 1e-8  # of the scale of an input: closer to a break it counts as at it
MOST = 12  # active sets, those of the longest stay


@dataclass(frozen=True, slots=True)
class VisitedSet:
    """An active set that a transient visits."""

    active: str  # the straight piece of each channel's amplifier, counted from the left: ``"0110"``
    begin: Annotated[float, "s"]  # when it is first entered, s
    stay: Annotated[float, "s"]  # how long the board is in it, in all, s
    visits: int  # how often it is entered
    rightmost: Annotated[float, "1/s"]  # real part of its rightmost pole, 1/s
    margin: float  # by what the first knob with a margin can move to instability; 0: is unstable
    words: str  # the margin in words


def visited_sets(run: Run) -> tuple[VisitedSet, ...]:
    """Return the active sets of a transient, at most `MOST`, in the order of their entry."""
    board, transient = run.board.linear, run.board.transient
    if board.circuit.is_linear or board.descriptor.is_large or not all(board.broken):
        return ()
    curve = run.waveforms.curve
    if not isinstance(curve, SteppedCurve):
        curve = simulate(board, transient, times=np.array([0.0, transient.stop])).curve
    if not isinstance(curve, SteppedCurve):
        return ()
    begins, keys = _entered(curve)
    lengths = np.diff(np.append(begins, min(curve.dense.ends[-1], curve.task.stop)))
    stays = {key: float(lengths[[k == key for k in keys]].sum()) for key in keys}
    kept = sorted(stays, key=stays.__getitem__, reverse=True)[:MOST]
    name, found = first_knob(board.circuit), list[VisitedSet]()
    devices = board.descriptor.devices
    for key in (key for key in stays if key in kept):
        rises = [GAINS[kind].rises[k] for kind, k in zip(devices.kinds, key, strict=True)]
        slopes = np.asarray(-devices.u_scale / devices.v_scale * rises)
        point = Equilibrium(board.descriptor, np.zeros(board.descriptor.size), slopes, 0.0)
        alone = LinearBoard(board.circuit, point=point)
        own, margin = poles(alone), None
        if name and own.known_stable:
            margin = find_margin(alone, name, found=own)
        words = "unstable" if not own.known_stable else margin.text if margin else ""
        factor = 0.0 if margin is None else margin.factor
        begin, visits = float(begins[keys.index(key)]), keys.count(key)
        text, lead = "".join(map(str, key)), own.rightmost.real
        found.append(VisitedSet(text, begin, stays[key], visits, lead, factor, words))
    return tuple(found)


def _entered(curve: SteppedCurve) -> tuple[Floats, list[tuple[int, ...]]]:
    """Return when each stretch on straight pieces begins, s, and the pieces of the inputs in it."""
    devices, times = curve.task.board.descriptor.devices, curve.points()
    for _ in range(ROUNDS):
        keys = _pieces(devices, curve.dense.at(times)[:, : devices.count])
        left = np.flatnonzero((keys[1:] != keys[:-1]).any(axis=1))
        times = np.union1d(times, np.linspace(times[left], times[left + 1], PARTS + 1))
    keys = _pieces(devices, curve.dense.at(times)[:, : devices.count])
    first = np.append(0, 1 + np.flatnonzero((keys[1:] != keys[:-1]).any(axis=1)))
    return times[first], [tuple(key) for key in keys[first].tolist()]


def _pieces(devices: Devices, inputs: Floats) -> Ints:
    """Return the straight piece of each input, (P, m), V, counted from the left.

    An input that is at a break, as far as steps tell, is still on the piece from which it comes.
    """
    found = np.zeros(inputs.shape, np.int64)
    for k, kind in enumerate(devices.kinds):
        breaks = np.array(GAINS[kind].breaks or (-np.inf,))
        y = inputs[:, k] / devices.v_scale[k]
        clear = np.abs(y[:, None] - breaks).min(axis=1) > AT_BREAK
        last = np.maximum.accumulate(np.where(clear, np.arange(len(y)), 0))
        found[:, k] = np.searchsorted(breaks, y[last] + AT_BREAK, side="right")
    return found
