"""The documents of commands that hold a verdict, in SI base units."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np

from taction.netlist_gen.board.circuit import Omission
from taction.netlist_gen.scene.keys import Value
from taction.system.documents import (
    INLINE,
    OPTIONAL,
    Farads,
    Inline,
    Key,
    Note,
    Number,
    Ohms,
    Rate,
    Seconds,
    Siemens,
    Steps,
    Volts,
    plain,
    taken,
)
from taction.system.error_document import Failure
from taction.system.reading_definitions import READINGS
from taction.verification.report.documents.scene_keys import KeyValue, scene_keys
from taction.verification.stability.margin import Margin
from taction.verification.verdict.answer_error import AnswerError
from taction.verification.verdict.checks import Check, Outcome
from taction.verification.verdict.constraint_stage import ConstraintPlane
from taction.verification.verdict.error_budget import ErrorBudget, difference
from taction.verification.verdict.headroom import Load
from taction.verification.verdict.output_noise import OutputNoise
from taction.verification.verdict.record import Channel, Record, finite
from taction.verification.verdict.recording import Accuracy
from taction.verification.verdict.verify import Verdict

if TYPE_CHECKING:
    from taction.verification.design.fresh_scene import NewScene
    from taction.verification.design.remedies import Remedies
    from taction.verification.design.scaling import Scaled
    from taction.verification.design.stable_ranges import StableRange
    from taction.verification.design.trials import Trial
    from taction.verification.design.tune import Tuned
    from taction.verification.studies.verify_files import VerifiedFiles
    from taction.verification.verdict.recording import MeasuredTransient


@dataclass(frozen=True, slots=True)
class RangePart:
    """The stable range of a key that is nearest to the scene's value; `own` is that value."""

    path: str
    unit: str
    own: Number
    least: Annotated[Number, Note("the search began here")]
    most: Annotated[Number, Note("and ended here")]
    low: Number
    high: Number
    found: bool
    reason: str
    edge: Number
    factor: Annotated[Number, Note("from the own value to the edge")]
    text: str
    doubt: str

    @classmethod
    def of(cls, found: StableRange) -> RangePart:
        """Return the range in numbers and in words."""
        from taction.verification.report.views.remedies import distance_text

        return taken(cls, found, text=distance_text(found), doubt="")


@dataclass(frozen=True, slots=True)
class ChangePart:
    """A change with what the state-space verdict says of it; `values` by dotted paths."""

    values: dict[str, Value]
    mends: tuple[str, ...]
    left: Annotated[tuple[str, ...], Note("checks that do not pass with the change")]
    resistance: Ohms
    verified: bool
    engine: str = "statespace"


@dataclass(frozen=True, slots=True)
class WithoutChange:
    """A search without a change that mends."""

    keys: tuple[str, ...]
    low: Annotated[Number, Key("from")]
    high: Annotated[Number, Key("to")]


@dataclass(frozen=True, slots=True)
class WhatToChange:
    """The changes that mend a failed verdict; values are for the scene, in base units."""

    failed: tuple[str, ...]
    stable_ranges: dict[str, RangePart]
    stable_opamps: tuple[str, ...]
    changes: tuple[ChangePart, ...]
    without: tuple[WithoutChange, ...]
    not_searched: Annotated[
        tuple[tuple[str, ...], ...], Note("the time limit ended these searches")
    ]
    unmendable: tuple[str, ...]
    trials: int
    time_limit: Seconds

    @classmethod
    def of(cls, remedies: Remedies) -> WhatToChange:
        """Return the changes of a search."""
        return taken(
            cls,
            remedies,
            stable_ranges={each.path: RangePart.of(each) for each in remedies.stability},
            stable_opamps=remedies.opamps,
            changes=tuple(taken(ChangePart, c, verified=not c.left) for c in remedies.changes),
            without=tuple(WithoutChange(s.paths, s.least, s.most) for s in remedies.without),
            not_searched=remedies.cut,
            time_limit=remedies.limit,
        )


@dataclass(frozen=True, slots=True)
class SimulationErrors:
    """Bounds on the errors of the record's end and of the readings of the network."""

    steady_state: Steps
    readings: Annotated[
        dict[str, float | None], Inline({name: kind.unit for name, kind in READINGS.items()})
    ]


@dataclass(frozen=True, slots=True)
class SteadyState:
    """Distance from the reference, fractions of the step amplitude."""

    equilibrium: Steps
    record_end: Steps


@dataclass(frozen=True, slots=True)
class Stability:
    """The rightmost pole: real and imaginary part, 1/s, and what follows from it."""

    stable: bool
    rightmost_pole: Annotated[complex, "1/s"]
    rightmost_pole_uncertainty: Rate
    damping_ratio: Number
    frequency: Annotated[float | None, "Hz"]
    states: int | None
    margin: Number
    margins: Annotated[
        dict[str, Margin | RangePart] | None,
        OPTIONAL,
        Note(
            "with --margins: of C and of the gain; of an unstable board the nearest stable ranges"
        ),
    ] = None


@dataclass(frozen=True, slots=True)
class Energy:
    """The energy of the network."""

    identity_residual: Number
    rise: Number
    rise_time: Seconds


OfUnit = Annotated[float | None, "stress"]  # a fraction of the largest stress


@dataclass(frozen=True, slots=True)
class AnswerPart:
    """How far the board is from the regularised answer, and that answer from the true stress.

    The largest error of any channel, as fractions of `largest_stress`. In `channel`, counted from
    1, the shares `regularisation` and `noise` add up to `true_error`; one below 0 lowers it.
    """

    board_error: OfUnit
    board_error_uncertainty: OfUnit
    boards: Annotated[Number, Note("share of the boards that keep it; null: the one simulated")]
    true_error: OfUnit
    true_error_uncertainty: OfUnit
    regularisation: OfUnit
    noise: OfUnit
    channel: int | None
    largest_stress: Annotated[Volts, Note("the true one; if it is not known, that of the answer")]
    text: str

    @classmethod
    def of(cls, answer: AnswerError) -> AnswerPart:
        """Return the errors in numbers and in words."""
        from taction.verification.report.views.answer import answer_text

        unit, board, n = answer.unit or math.inf, answer.board, answer.channel
        return cls(
            board_error=None if board is None else board / unit,
            board_error_uncertainty=None if board is None else answer.board_error / unit,
            boards=answer.boards,
            true_error=answer.true_error,
            true_error_uncertainty=None if n is None else answer.target_error / unit,
            regularisation=answer.regularisation,
            noise=answer.noise,
            channel=None if n is None else n + 1,
            largest_stress=answer.unit,
            text=answer_text(answer),
        )


@dataclass(frozen=True, slots=True)
class BudgetPart:
    """One part of the error budget, V; the total has `sum` and `solves`, too.

    `ill_posedness` is the sum of `regularisation` and `strain_noise`.
    """

    value: Number
    unit: str
    how: str
    bound: Number
    channels: tuple[float, ...] = ()
    predicted: tuple[float, ...] = ()
    sum: tuple[float, ...] = ()
    solves: int = 0


@dataclass(frozen=True, slots=True)
class LoadPart:
    """What an op-amp has to do, beside its limit; `time` is null at rest."""

    part: str
    quantity: str
    peak: Number
    limit: Number
    rest: Number
    error: Number
    time: Seconds
    share: Number
    unit: str

    @classmethod
    def of(cls, load: Load) -> LoadPart:
        """Return the load."""
        known = load.peak, load.limit, load.rest, load.error
        return cls(load.part, load.quantity, *known, load.at, load.share, load.unit)


@dataclass(frozen=True, slots=True)
class NoisePart:
    """Noise of the outputs, one value for each channel."""

    rms: tuple[float, ...]
    uncertainties: tuple[float, ...]
    unit: str
    ngspice: Number
    reason: str
    lowest: Annotated[float, "Hz"]

    @classmethod
    def of(cls, noise: OutputNoise) -> NoisePart:
        """Return the noise."""
        known = noise.rms, noise.error, "V", noise.simulated, noise.unknown
        return cls(*known, noise.lowest)


@dataclass(frozen=True, slots=True)
class Certificate:
    """The certificate of a numerical solution."""

    kind: str
    value: Number
    bound: Number


@dataclass(frozen=True, slots=True)
class RecordMade:
    """The record of the simulation."""

    stop: Seconds
    max_step: Seconds
    points: int
    seconds: Seconds


@dataclass(frozen=True, slots=True)
class VerdictBody:
    """A verdict."""

    scene: str
    file: str
    outcome: Outcome
    checks: tuple[Check, ...]
    channels: tuple[Channel, ...]
    steady_state: SteadyState
    step_amplitude: Volts
    step_amplitude_uncertainty: Volts
    settling_time: Seconds
    settling_time_ideal: Seconds
    stability: Stability
    energy: Energy
    constraint_plane: ConstraintPlane | None
    answer: AnswerPart
    error_budget: dict[str, BudgetPart]
    opamp_level: str
    headroom: tuple[LoadPart, ...]
    noise: NoisePart | None
    simulation_error: SimulationErrors
    accuracy: Accuracy
    lam: Annotated[Number, Key("lambda")]
    lambda_rule: str | None
    resistance: Ohms
    certificate: Certificate
    engine: str
    simulator: str
    solver: str | None
    method: str | None
    simulation: RecordMade
    keys: dict[str, KeyValue]
    omissions: tuple[Omission, ...]
    warnings: tuple[str, ...]
    timing: Annotated[dict[str, float], "s"]
    cause: Annotated[str, Note("why it is no pass, with value and limit; empty of a pass")] = ""
    what_to_change: Annotated[
        WhatToChange | None, OPTIONAL, Note("of a failed verdict: changes that mend it")
    ] = None

    @classmethod
    def of(cls, verdict: Verdict) -> VerdictBody:
        """Return the document of a verdict."""
        record, wave, poles = Record.of(verdict), verdict.waveforms, verdict.poles
        figure, solution = record.value, verdict.ideal.solution
        energy, ideal = verdict.energy, verdict.ideal.transient
        rise = (None, None) if energy is None else (energy.rise, energy.time)
        return cls(
            scene=verdict.scene.name,
            file=str(verdict.scene.file),
            outcome=verdict.outcome,
            checks=verdict.checks,
            channels=record.channels,
            steady_state=SteadyState(figure("steady_state_error"), figure("end_error")),
            step_amplitude=figure("step_amplitude"),
            step_amplitude_uncertainty=record.figure("step_amplitude").uncertainty,
            settling_time=figure("settling_time"),
            settling_time_ideal=ideal.settling_time,
            stability=Stability(
                stable=poles.stable,
                rightmost_pole=poles.rightmost,
                rightmost_pole_uncertainty=poles.resolution,
                damping_ratio=figure("damping_ratio"),
                frequency=poles.frequency,
                states=len(poles.poles) if poles.complete else None,
                margin=figure("margin"),
            ),
            energy=Energy(ideal.energy_residual, *rise),
            constraint_plane=verdict.constraint,
            answer=AnswerPart.of(verdict.answer),
            error_budget=budget_parts(verdict.budget),
            opamp_level="small-signal" if verdict.circuit.is_small_signal else "large-signal",
            headroom=tuple(
                LoadPart.of(load) for load in (*verdict.parts.simulated, *verdict.parts.worst)
            ),
            noise=None if verdict.noise is None else NoisePart.of(verdict.noise),
            simulation_error=SimulationErrors(
                verdict.error.steady_state, {**verdict.error.readings}
            ),
            accuracy=verdict.accuracy,
            lam=figure("lambda"),
            lambda_rule=verdict.scene.lambda_rule or None,
            resistance=figure("resistance"),
            certificate=Certificate(
                solution.certificate_kind, solution.certificate, solution.bound
            ),
            engine=record.engine,
            simulator=wave.engine,
            solver=wave.solver or None,
            method=wave.method or None,
            simulation=RecordMade(
                verdict.transient.stop, wave.spacing, wave.cost.points, wave.cost.seconds
            ),
            keys=scene_keys(verdict.scene),
            omissions=verdict.circuit.omissions,
            warnings=verdict.warnings,
            timing=verdict.timing,
            cause=record.reason,
        )

    def with_margins(self, verdict: Verdict) -> VerdictBody:
        """Return the document with the stability margins, which cost a search of their own.

        An unstable board has the nearest stable range of each key, too.
        """
        from taction.verification.design.stable_ranges import stable_ranges
        from taction.verification.design.trials import Trials
        from taction.verification.engines.statespace.linearised.board import LinearBoard
        from taction.verification.stability.margin import margins

        found: dict[str, Margin | RangePart] = {
            **margins(LinearBoard(verdict.circuit), verdict.poles)
        }
        if verdict.poles.known_unstable:
            ranges = stable_ranges(Trials(verdict.scene))
            found |= {each.path: RangePart.of(each) for each in ranges}
        return replace(self, stability=replace(self.stability, margins=found))


def verdict_document(verdict: Verdict) -> dict[str, Any]:
    """Return `verdict` as plain data: dicts, lists, numbers, strings (see the guide's section)."""
    made: dict[str, Any] = plain(VerdictBody.of(verdict))
    return made


def verdict_document_with_margins(verdict: Verdict) -> dict[str, Any]:
    """Return `verdict_document` with the stability margins."""
    made: dict[str, Any] = plain(VerdictBody.of(verdict).with_margins(verdict))
    return made


def budget_parts(budget: ErrorBudget) -> dict[str, BudgetPart]:
    """Return the parts of an error budget by name, their sum up to the answer, and ``total``."""
    parts = {part.name: part for part in budget}
    if "regularisation" in parts:
        both = np.array([parts[name].channels for name in ("regularisation", "strain_noise")])
        how = "regularised answer against the true stress: regularisation and strain_noise"
        whole = difference("ill_posedness", how, -both[0], both[1])
        parts = {whole.name: whole} | parts
    parts |= {} if budget.total is None else {"total": budget.total}
    return {
        name: BudgetPart(
            part.value, "V", part.how, part.bound, part.channels, part.predicted,
            *((tuple(budget.summed), budget.solves) if part is budget.total else ()),
        )
        for name, part in parts.items()
    }  # fmt: skip


@dataclass(frozen=True, slots=True)
class WithoutVerdict:
    """A file without a verdict."""

    file: str
    outcome: Literal["bad input", "inconclusive", "not run"]
    error: Annotated[Failure | None, OPTIONAL] = None


@dataclass(frozen=True, slots=True)
class VerifyFilesDocument:
    """``taction verify`` with several scenes or a folder."""

    outcome: Annotated[str, Note("the worst")]
    exit_status: int
    interrupted: bool
    counts: dict[str, int]
    verdicts: tuple[VerdictBody | WithoutVerdict, ...]

    @classmethod
    def of(cls, files: VerifiedFiles) -> VerifyFilesDocument:
        """Return the verdicts of files, which are plain data already."""
        return taken(cls, files, counts=files.count(), verdicts=files.documents)


@dataclass(frozen=True, slots=True)
class Candidate:
    """A design and its readings; `left` are the checks that do not pass."""

    values: dict[str, Value]
    settling_time: Seconds
    overshoot: Steps
    left: tuple[str, ...]
    refused: str

    @classmethod
    def of(cls, trial: Trial) -> Candidate:
        """Return a trial."""
        return taken(cls, trial)


@dataclass(frozen=True, slots=True)
class TuneDocument:
    """``taction design tune``."""

    outcome: Outcome
    before: Candidate
    after: Candidate
    resistance: Ohms
    lam: Annotated[Number, Key("lambda")]
    overshoot_limit: Steps
    margin: Number
    tried: int
    ranges: dict[str, tuple[float, ...]]
    at_edges: dict[str, float]
    frontier: tuple[Candidate, ...]
    verification: VerdictBody

    @classmethod
    def of(cls, found: Tuned) -> TuneDocument:
        """Return a tuned design with its verdict."""
        tuning, verdict = found.tuning, found.verdict
        return taken(
            cls,
            tuning,
            outcome=verdict.outcome,
            before=Candidate.of(tuning.before),
            after=Candidate.of(tuning.after),
            resistance=verdict.circuit.value("R"),
            lam=verdict.circuit.value("lambda"),
            ranges={each.path: (each.low, each.high) for each in tuning.ranges},
            frontier=tuple(map(Candidate.of, tuning.frontier)),
            verification=VerdictBody.of(verdict),
        )


@dataclass(frozen=True, slots=True)
class ScaleDocument:
    """``taction scale``."""

    outcome: Outcome
    unit_conductance: Siemens
    unit_voltage: Volts
    gain: Ohms
    resistance: Ohms
    capacitance: Farads
    lam: Annotated[Number, Key("lambda")]
    matrix_resistors: Annotated[tuple[float, ...], "ohm"]
    headroom: tuple[LoadPart, ...]
    notes: tuple[str, ...]
    verification: VerdictBody

    @classmethod
    def of(cls, found: Scaled) -> ScaleDocument:
        """Return the scalings and the verdict."""
        scaling, verdict = found.scaling, found.verdict
        return taken(
            cls,
            scaling,
            outcome=verdict.outcome,
            matrix_resistors=scaling.matrix_ohms,
            headroom=tuple(map(LoadPart.of, scaling.loads)),
            verification=VerdictBody.of(verdict),
        )


@dataclass(frozen=True, slots=True)
class NewMatrixDocument:
    """``taction new FILE --matrix``: the scene, its scalings and its verdict."""

    file: str
    lambda_rule: str
    recognised: tuple[str, ...]
    scaling: Annotated[ScaleDocument, INLINE]

    @classmethod
    def of(cls, found: NewScene) -> NewMatrixDocument | NewDocument:
        """Return a new scene, for a matrix with its verdict."""
        if found.fresh is None or found.scaled is None:
            return NewDocument(found.file)
        scaling = ScaleDocument.of(found.scaled)
        return cls(found.file, found.fresh.rule, tuple(found.fresh.notes), scaling)


@dataclass(frozen=True, slots=True)
class NewDocument:
    """``taction new FILE``."""

    file: str


@dataclass(frozen=True, slots=True)
class SimulateDocument:
    """``taction export waveforms``."""

    scene: str
    simulator: str
    solver: str | None
    method: str | None
    points: int
    seconds: Seconds
    stop: Seconds
    step_amplitude: Volts
    settling_time: Seconds
    channels: tuple[Channel, ...]
    output: str | None

    @classmethod
    def of(cls, found: MeasuredTransient) -> SimulateDocument:
        """Return what was measured of a transient."""
        waveforms, measured = found.waveforms, found.measurements
        return cls(
            scene=found.circuit.name,
            simulator=waveforms.engine,
            solver=waveforms.solver or None,
            method=waveforms.method or None,
            points=waveforms.cost.points,
            seconds=waveforms.cost.seconds,
            stop=float(waveforms.time[-1]),
            step_amplitude=measured.amplitude,
            settling_time=finite(measured.settling_time),
            channels=tuple(map(Channel.of, measured.channels)),
            output=found.output,
        )
