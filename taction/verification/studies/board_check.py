"""Check any linear board, with or without a scene: what `taction check` says.

Poles, stability, readings and noise are those of the state-space engine, by the functions that
verify a scene; ngspice's own transient is the other witness. Worst cases and the yield are those of
`verification.studies.tolerance`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.deck.part_tolerances import DeckTolerances
from taction.system.documents import Hertz, Note, Number, Rate, Seconds, Steps, Volts
from taction.system.results import Result
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.readings.measurements import Measurements
from taction.verification.stability.poles import Poles
from taction.verification.studies.ac_witness import AcWitness
from taction.verification.studies.board_sweep import Sweep, sweep_board
from taction.verification.studies.board_witness import Witness, witnessed
from taction.verification.studies.measured_board import MeasuredBoard, Start, measure_board
from taction.verification.studies.part_influence import PartRow, influences
from taction.verification.studies.swept_values import SweptValue
from taction.verification.studies.tolerance.corners import CornerStudy
from taction.verification.studies.tolerance.yield_report import YieldReport
from taction.verification.studies.varied_deck import Parametric, Samples, varied_outcomes
from taction.verification.studies.wanted_checks import Wanted
from taction.verification.verdict.checks import Check, Outcome, overall, undecided
from taction.verification.verdict.companion import Agreement
from taction.verification.verdict.output_noise import OutputNoise
from taction.verification.verdict.record import finite

Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class PoleRow:
    """A pole with its bound."""

    real: Rate
    frequency: Hertz
    damping: Number
    bound: Rate
    hidden: Annotated[bool, Note("no output shows it: it does not decide")]


@dataclass(frozen=True, slots=True)
class OutputRow:
    """An output: rest before and after the step, readings with bounds, and noise."""

    name: str
    before: Volts
    rest: Volts
    rest_bound: Volts
    settling_time: Seconds
    settling_bound: Seconds
    rise_time: Seconds
    rise_bound: Seconds
    overshoot: Steps
    undershoot: Steps
    noise: Volts
    noise_bound: Volts
    state: str


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BoardCheck(Result):
    """All that `taction check` says of a board; `outcome` is that of its checks."""

    VIEW = "taction.verification.report.views.board_check:view"
    DOCUMENT = (
        *("name", "outcome", "initial", "notes", "stable = poles.stable"),
        *("poles = pole_rows", "parts", "band = measurements.band", "amplitude [V]", "outputs"),
        *("noise_unknown", "agreement", "checks", "sweeps", "corners", "yields"),
    )

    measured: MeasuredBoard
    notes: tuple[str, ...]
    parts: tuple[PartRow, ...]
    noise: OutputNoise
    record: Agreement | None
    unwitnessed: str
    checks: tuple[Check, ...]
    sweeps: tuple[Sweep, ...]
    seconds: Mapping[str, float]
    corners: CornerStudy | None = None
    yields: YieldReport | None = None

    @property
    def outcome(self) -> Outcome:
        """Of the checks, at the worst corners, too."""
        judged = [overall(self.checks)]
        if self.corners is not None:
            judged.append(Outcome(self.corners.outcome))
        return max(judged, key=_WORSE.index)

    @property
    def circuit(self) -> Circuit:
        """The board."""
        return self.measured.board.circuit

    @property
    def name(self) -> str:
        """Of the board."""
        return self.circuit.name

    @property
    def initial(self) -> Start:
        """How the step begins."""
        return self.measured.initial

    @property
    def poles(self) -> Poles:
        """Of the board."""
        return self.measured.poles

    @property
    def measurements(self) -> Measurements:
        """Of the outputs."""
        return self.measured.measurements

    @property
    def noise_unknown(self) -> str:
        """Why the noise is not known, or empty."""
        return self.noise.unknown

    @property
    def amplitude(self) -> float:
        """Largest step of an output, V."""
        return self.measurements.amplitude

    @property
    def pole_rows(self) -> tuple[PoleRow, ...]:
        """Poles with Im >= 0, rightmost first; those that no output shows come last."""
        apart = self.measured.apart
        return tuple(
            PoleRow(p.real, p.imag / math.tau, -p.real / abs(p) if p else 0.0, bound, hidden)
            for values, errors, hidden in (
                (self.poles.poles, self.poles.errors, False),
                (apart.hidden, apart.hidden_errors, True),
            )
            for p, bound in zip(values.tolist(), errors.tolist(), strict=True)
            if p.imag >= 0.0
        )

    @property
    def outputs(self) -> tuple[OutputRow, ...]:
        """The outputs with their readings."""
        return tuple(self._output(n) for n in range(len(self.circuit.outputs)))

    def _output(self, n: int) -> OutputRow:
        found, channel = self.measured, self.measurements.channels[n]
        settling, rise = channel.settling_time, channel.rise_time
        over, under = (channel.readings[name] for name in ("overshoot", "undershoot"))
        return OutputRow(
            name=self.circuit.outputs[n].node,
            before=float(found.before[n]),
            rest=float(found.rest[n]),
            rest_bound=found.rest_error,
            settling_time=None if settling is None else settling.value,
            settling_bound=None if settling is None else settling.uncertainty,
            rise_time=None if rise is None else rise.value,
            rise_bound=None if rise is None else rise.uncertainty,
            overshoot=None if over is None else over.value,
            undershoot=None if under is None else under.value,
            noise=finite(self.noise.rms[n]) if self.noise.rms else None,
            noise_bound=finite(self.noise.error[n]) if self.noise.error else None,
            state=channel.state.value,
        )

    @property
    def agreement(self) -> Steps:
        """Largest difference of the two engines over the record, in step amplitudes."""
        if self.record is None or not self.amplitude:
            return None
        return self.record.difference / self.amplitude

    def __repr__(self) -> str:
        said = f"stable: {self.poles.stable}, {len(self.parts)} parts"
        return f"BoardCheck({self.name!r}, {self.outcome.value}; {said})"


_WORSE = (Outcome.PASS, Outcome.INCONCLUSIVE, Outcome.FAIL)


def check_board(
    circuit: Circuit,
    asked: Wanted,
    *,
    initial: Start = "rest",
    witness: Witness | None = None,
    ac: AcWitness | None = None,
    over: Iterable[SweptValue] = (),
    deck: Parametric | None = None,
    tolerances: DeckTolerances | None = None,
    samples: Samples | None = None,
    notes: tuple[str, ...] = (),
    progress: Progress = lambda stage: None,
) -> BoardCheck:
    """Check a linear board.

    Parameters
    ----------
    circuit : Circuit
        The board; its knobs are the parts that are listed.
    asked : Wanted
        Limits and expected values.
    initial : str
        Whether the step begins at rest, or with no charge.
    witness : callable, optional
        Returns ngspice's deck of a transient for a solver; without it there is one witness.
    ac : AcWitness, optional
        ngspice's own small signal, for a circuit that is linear about its operating point.
    over : iterable of SweptValue
        Values to sweep, one after the other.
    deck : Parametric, optional
        Builds the board at other values of its ``.param`` cards.
    tolerances : DeckTolerances, optional
        Of its parts and parameters: then the worst corners and the yield are found, too.
    samples : Samples, optional
        How many boards are drawn.
    notes : tuple of str
        What is to be said with the result.
    progress : callable, optional
        Receives the name of each stage.

    Raises
    ------
    EngineError
        No equilibrium, or no state-space form.
    """
    clock = time.process_time
    began = clock()
    progress("poles")
    board, band = LinearBoard(circuit), asked.limits.settling_time.band
    found = measure_board(board, initial, band)
    progress("parts")
    margin, rows = influences(board, found.poles, asked.limits.stability.margin > 1.0)
    noise = found.noise(asked.lowest)
    middle = clock()
    progress("ngspice")
    agreement, why = None, "" if ac is not None else "without ngspice"
    if witness is not None and not found.apart.beyond:
        agreement, why = witnessed(found, witness, asked.limits.engines_agree.tolerance)
    checks = list(found.checks(asked, noise, margin, agreement))
    if agreement is None and "engines_agree" in asked.names:
        checks.append(undecided("engines_agree", "step", why, asked.limits.engines_agree.limit))
    if ac is not None:
        checks.append(ac.check(board, np.append(found.poles.poles, found.apart.hidden)))
    progress("sweeps")
    sweeps = tuple(
        sweep_board(board, each, initial, band, None if deck is None else deck.at) for each in over
    )
    corners, yields = None, None
    if tolerances is not None:
        corners, yields = varied_outcomes(
            found, tolerances, asked, samples or Samples(), deck, progress
        )
    return BoardCheck(
        found,
        (*found.apart.sentences, *notes, *([why] if why else ())),
        rows,
        noise,
        agreement,
        why,
        tuple(checks),
        sweeps,
        {"statespace": middle - began},
        corners,
        yields,
    )
