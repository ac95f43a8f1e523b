"""The documents of commands that hold a verdict, with every key of the scene, in SI base units."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Any

import numpy as np

from taction.netlist_gen.board.opamp_choice import choose_opamp
from taction.netlist_gen.scene.keys import Key, all_keys, files_of, own_value
from taction.netlist_gen.scene.scene import Scene
from taction.system.documents import plain
from taction.system.errors import TactionError
from taction.system.output_files import printable
from taction.verification.design.remedies import Remedies
from taction.verification.stability.margin import Margin
from taction.verification.studies.regression.difference import StoredKey
from taction.verification.studies.running.versions import file_content
from taction.verification.verdict.answer_error import ErrorBudget, ErrorPart, difference
from taction.verification.verdict.headroom import Load
from taction.verification.verdict.record import Record, finite
from taction.verification.verdict.verify import Verdict


def scene_keys(scene: Scene) -> dict[str, StoredKey]:
    """Return the value and the unit of each key by its path, as a scene file has it.

    A file has the SHA-256 of its content beside its name, so that two scenes with the same name in
    two folders can be told apart.
    """
    files = files_of(scene)
    found = {}
    for key in all_keys(scene):
        file = files.get(key.path)
        content = None if file is None else _content(scene, file)
        found[key.path] = StoredKey(_value(scene, key), key.unit or None, content)
    return found


def _value(scene: Scene, key: Key) -> Any:
    """Return the value of a key; an infinite number is None, as in JSON."""
    try:
        number = own_value(scene, key) if key.kind == "real" else None
    except TactionError:  # what cannot be derived, such as lambda of a rule
        number = None
    value = _written(scene, key.path) if number is None else number
    if value is None and key.path.startswith("design.opamp."):
        value = getattr(choose_opamp(scene), key.path.rpartition(".")[2], None)
    if isinstance(value, np.ndarray):
        return f"array {' x '.join(map(str, value.shape))}"
    if isinstance(value, float):
        return finite(value)
    return printable(value) if isinstance(value, str) else value


def _written(scene: Scene, path: str) -> Any:
    table, _, last = path.rpartition(".")
    model = attrgetter(table)(scene) if table else scene
    fields = type(model).model_fields
    return getattr(model, next(n for n, field in fields.items() if last in (n, field.alias)))


def _content(scene: Scene, name: Any) -> str | None:
    if isinstance(name, np.ndarray):
        return hashlib.sha256(np.ascontiguousarray(name, dtype="<f8").tobytes()).hexdigest()
    return file_content(scene, str(name)).hex() or None  # it may be gone since the run


@dataclass(frozen=True, slots=True)
class BudgetPart:
    """One part of the error budget, V; the total has `sum`, too.

    `ill_posedness` is the sum of `regularisation` and `strain_noise`.
    """

    DOCUMENT = (
        *("value = part.value", "unit", "how = part.how", "bound = part.bound"),
        *("channels = part.channels", "sum"),
    )

    part: ErrorPart
    sum: tuple[float, ...] = ()
    unit: str = "V"


@dataclass(frozen=True, slots=True)
class VerdictBody:
    """A verdict."""

    DOCUMENT = (
        *("scene = verdict.scene.name", "file = verdict.scene.file", "outcome = verdict.outcome"),
        *("checks = verdict.checks", "channels = record.channels"),
        "steady_state.equilibrium [step] = record.figures.steady_state_error # from the reference",
        "steady_state.record_end [step] = record.figures.end_error # from the reference",
        "step_amplitude [V] = record.figures.step_amplitude",
        "step_amplitude_uncertainty [V] = record.uncertainties.step_amplitude",
        "settling_time [s] = record.figures.settling_time",
        "stability.stable = verdict.poles.stable",
        "stability.rightmost_pole [1/s] = verdict.poles.rightmost # real and imaginary part",
        "stability.rightmost_pole_uncertainty [1/s] = verdict.poles.resolution",
        "stability.damping_ratio = record.figures.damping_ratio # of the rightmost pole",
        "stability.frequency [Hz] = verdict.poles.frequency # of the rightmost pole",
        *("stability.states = states", "stability.margin = record.figures.margin"),
        "stability.margins? = margins # with --margins: of C and of the gain",
        *("answer = verdict.answer", "error_budget", "opamp_level", "headroom"),
        "noise = verdict.noise",
        "simulation_error [step] = verdict.end_error # bound on the error of the record's end",
        *("accuracy = verdict.accuracy", "lambda = record.figures.lambda"),
        "lambda_rule = verdict.scene.lambda_rule or null",
        "resistance [ohm] = record.figures.resistance",
        "certificate.kind = verdict.ideal.solution.certificate_kind",
        "certificate.value = verdict.ideal.solution.certificate",
        "certificate.bound = verdict.ideal.solution.bound",
        *("engine = record.engine", "simulator = verdict.waveforms.engine"),
        "solver = verdict.waveforms.solver or null",
        "method = verdict.waveforms.method or null",
        "simulation.stop [s] = verdict.transient.stop",
        "simulation.max_step [s] = verdict.waveforms.spacing",
        "simulation.points = verdict.waveforms.cost.points",
        "simulation.seconds [s] = verdict.waveforms.cost.seconds",
        *("keys", "omissions = verdict.circuit.omissions", "warnings = verdict.warnings"),
        "timing [s] = verdict.timing",
        "cause = record.reason # why it is no pass, with value and limit; empty of a pass",
        "what_to_change? = remedies # of a failed verdict: changes that mend it",
    )

    verdict: Verdict
    record: Record
    margins: dict[str, Margin] | None = None
    remedies: Remedies | None = None

    @classmethod
    def of(cls, verdict: Verdict) -> VerdictBody:
        """Return the document of a verdict."""
        return cls(verdict, Record.of(verdict))

    @property
    def states(self) -> int | None:
        """Number of states; None where not all poles are known."""
        poles = self.verdict.poles
        return len(poles.poles) if poles.complete else None

    @property
    def keys(self) -> dict[str, StoredKey]:
        """Every key of the scene."""
        return scene_keys(self.verdict.scene)

    @property
    def error_budget(self) -> dict[str, BudgetPart]:
        """The parts of the error budget."""
        return budget_parts(self.verdict.budget)

    @property
    def opamp_level(self) -> str:
        """Level of the models of the op-amps."""
        return "small-signal" if self.verdict.circuit.is_small_signal else "large-signal"

    @property
    def headroom(self) -> tuple[Load, ...]:
        """What the op-amps have to do."""
        return (*self.verdict.parts.simulated, *self.verdict.parts.loads)

    def with_margins(self) -> VerdictBody:
        """Return the document with the stability margins, which cost a search of their own."""
        from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
        from taction.verification.stability.margin import margins

        verdict = self.verdict
        return replace(self, margins=margins(LinearBoard(verdict.circuit), verdict.poles))


def verdict_document(verdict: Verdict) -> dict[str, Any]:
    """Return `verdict` as plain data: dicts, lists, numbers, strings (see the guide's section)."""
    made: dict[str, Any] = plain(VerdictBody.of(verdict))
    return made


def verdict_document_with_margins(verdict: Verdict) -> dict[str, Any]:
    """Return `verdict_document` with the stability margins."""
    made: dict[str, Any] = plain(VerdictBody.of(verdict).with_margins())
    return made


def budget_parts(budget: ErrorBudget) -> dict[str, BudgetPart]:
    """Return the parts of an error budget by name, their sum up to the answer, and ``total``."""
    parts = {part.name: part for part in budget}
    if "regularisation" in parts:
        both = np.array([parts[name].channels for name in ("regularisation", "strain_noise")])
        how = "regularised answer against the true stress: regularisation and strain_noise"
        whole = difference("ill_posedness", how, -both[0], both[1])
        parts = {whole.name: whole} | parts
    found = {name: BudgetPart(part) for name, part in parts.items()}
    if budget.total is not None:
        found["total"] = BudgetPart(budget.total, budget.summed)
    return found
