"""Scalings for given op-amps and supply: G0, U0, s and R from the matrix, lambda and the loads.

The matrix sets G0: on the logarithmic scale its resistors lie in the middle of the range that can
be bought. The strain sets s: the constraint plane swings about as far as the outputs,
``s G0 max|eps| = max|u|``, as far as R stays in that range; where the slew rate would keep the
outputs low, s is up to ten times smaller. R and s are values of the scene's series (E24 if it names
none), and G0 takes up the rounding, so that lambda is exact: ``lambda = 1 / (R s G0²)``, and the
like for other amplifiers. At last U0: the loads of the board (`headroom`) are proportional to U0 on
a linear board, and the highest output voltage becomes the wanted share of the swing.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from taction.netlist_gen.board.bill_of_materials import buyable
from taction.netlist_gen.board.part_warnings import (
    LEAST_OHMS,
    MOST_OHMS,
    ROUNDING,
    AcceptedParts,
    part_warnings,
)
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.inverse_problem import make_problem
from taction.netlist_gen.scene.keys import write_scene
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.topology import topology_of
from taction.system.errors import Complaint, EngineError, InputError
from taction.system.progress import Progress
from taction.system.quantities import show
from taction.system.results import Result
from taction.verification.design.trials import (
    Accept,
    Trial,
    Trials,
    accepted_parts,
    at_small_signal,
    broken_at_rest,
    is_good,
    search,
)
from taction.verification.engines.statespace.linearised.linear_board import LinearBoard
from taction.verification.reference.ideal_answer import (
    ideal_answer,
    ideal_network,
    lambda_times_resistance,
)
from taction.verification.reference.lambda_rule import read_scene
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.headroom import FULL, Load, describe
from taction.verification.verdict.simulation import build
from taction.verification.verdict.verify import Verdict, verify

NO_C = "no C that was tried makes the board pass"
"""Beginning of a note that a board which passes contradicts."""
MIDDLE = 1e5  # ohm: geometric mean of the largest and the smallest matrix resistor

SHARE = 0.5  # of the swing, for the highest output voltage
SMALLER = (1.0, 0.3, 0.1)  # times the balanced s, while slopes or currents set U0
ROUNDS = 4  # of U0 on a board whose loads are not proportional to it


def with_resistors(scene: Scene, factor: float, notes: list[str]) -> Scene:
    """Return the scene with other s and G0; R, which follows from lambda, is in the series, too.

    Lambda stays, and the op-amps are at the small-signal level. s is `factor` times the value that
    balances constraint plane and outputs; `notes` receives what could not be reached. `InputError`
    where T or lambda need resistors that cannot be bought.
    """
    problem = make_problem(scene)
    answer = ideal_answer(ideal_network(problem, scene), scene)
    sizes = np.abs(problem.matrix[problem.matrix != 0.0])
    largest = float(sizes.max())
    smallest = float(sizes[sizes >= scene.design.prune * largest].min())
    least, most, ratio = LEAST_OHMS, MOST_OHMS, LEAST_OHMS / MOST_OHMS
    if largest * ratio > smallest:
        text = (
            f"the entries of T differ by the factor {largest / smallest:.3g}, and resistors that"
            f" can be bought by {1 / ratio:.3g}; leave out small entries with design.prune ="
            f" {ratio:.1g} or more"
        )
        raise InputError(scene.file, Complaint("problem", "", text))
    unit = 1.0 / (MIDDLE * math.sqrt(largest * smallest))
    # the rounding of R and s moves G0 by less than this
    slack = min(ROUNDING, math.sqrt(most / least * smallest / largest))
    unit = min(max(unit, slack / (most * smallest)), 1.0 / (slack * least * largest))
    design, lam = scene.design, answer.network.lam
    product = lambda_times_resistance(
        design.amplifier, s=1.0, G0=unit, U0=design.unit_voltage, Ve=design.exponential_slope or 1.0
    )  # lambda R s, ohm²
    strain = float(np.abs(problem.strain).max(initial=0.0))
    drive = float(np.abs(answer.solution.u).max(initial=0.0))
    balanced = drive / (unit * strain) if strain and drive else math.sqrt(product / lam)
    low, high = max(product / lam / most, least), min(product / lam / least, most)
    if low > high:
        text = (
            f"no s and R between {least:g} and {most:g} ohm have this lambda; expected"
            f" about {product / most**2:.1g} to {product / least**2:.1g}"
        )
        raise InputError(scene.file, Complaint("design.lambda", f"{lam:g}", text))
    series = "E24" if design.resistor_series == "exact" else design.resistor_series
    gain = buyable(min(max(factor * balanced, low), high), series)
    resistance = buyable(product / (lam * gain), series)
    if not low <= balanced <= high:
        notes.append("s is not balanced with the outputs: R would be out of its range")
    unit *= math.sqrt(product / (lam * gain * resistance))
    changes = {"design.gain": gain, "design.unit_conductance": unit, "design.lambda": lam}
    return with_values(at_small_signal(scene), changes)


@dataclass(frozen=True, slots=True)
class Scaled(Result):
    """A scene with scalings that were found, and the verdict of its board."""

    VIEW = "taction.verification.report.views.design_view:scaling_view"
    DOCUMENT = (
        "outcome = verdict.outcome",
        "unit_conductance [S] = verdict.circuit.facts.G0.value",
        "unit_voltage [V] = verdict.circuit.facts.U0.value",
        "gain [ohm] = verdict.circuit.facts.gain.value",
        "resistance [ohm] = verdict.circuit.facts.R.value",
        "capacitance [F] = verdict.circuit.facts.C.value",
        "lambda = verdict.circuit.facts.lambda.value",
        "matrix_resistors [ohm] = matrix_ohms",
        *("headroom = verdict.parts.loads", "notes", "verification = verdict"),
    )

    scene: Scene = field(repr=False)
    notes: tuple[str, ...] = field(repr=False)  # what could not be reached, and of the parts
    verdict: Verdict

    @classmethod
    def of(cls, scene: Scene, notes: Iterable[str], verdict: Verdict) -> Scaled:
        """Return scalings with their verdict, without a note that a pass contradicts."""
        wrong = NO_C if verdict.outcome is Outcome.PASS else ()
        return cls(scene, tuple(note for note in notes if not note.startswith(wrong)), verdict)

    @property
    def outcome(self) -> str:
        """The outcome of the verdict."""
        return str(self.verdict.outcome.value)

    @property
    def matrix_ohms(self) -> tuple[float, float]:
        """The smallest and the largest matrix resistor, ohm."""
        ohms = np.concatenate([matrix.ohms.ravel() for matrix in self.verdict.circuit.matrices])
        ohms = ohms[np.isfinite(ohms)]
        return float(ohms.min()), float(ohms.max())


def scale(
    scene: str | Path | Scene,
    *,
    share: float = 0.5,
    opamp: str | None = None,
    supply: str | float | None = None,
    output: str | Path | None = None,
    progress: Progress = lambda stage: None,
) -> Scaled:
    """Propose G0, U0, s and R: outputs that use the swing, resistors that can be bought.

    Lambda, and with it the solution, stays. C changes only where the board would be unstable or
    fail its checks. The state-space engine verifies the result, which decides the exit status.

    Parameters
    ----------
    scene : path or Scene
        The board to begin with.
    share : float
        Highest output voltage of any op-amp, as a share of its swing.
    opamp : str, optional
        Preset in the place of the scene's op-amp.
    supply : str or float, optional
        Supply in the place of the scene's, as ±12V.
    output : path, optional
        Write the scene with the proposed scalings.
    progress : callable, optional
        Receives the name of each stage.

    Returns
    -------
    Scaled
        The `scene` with the scalings, `notes` on them, and the `verdict`.

    Raises
    ------
    InputError
        The scene, the op-amp or the supply cannot be used, or the file cannot be written.
    NoVerdictError
        No scalings are found, or the board has no verdict.

    Examples
    --------
    >>> import taction
    >>> taction.scale("scenes/tuned-breadboard.toml").outcome
    'pass'
    """
    changes = {"design.opamp": opamp, "design.supply": supply}
    asked = with_values(read_scene(scene), {k: v for k, v in changes.items() if v is not None})
    progress("scalings")
    scaled, notes = find_scaling(asked, share)
    verdict = verify(scaled.with_engine("statespace"), progress)
    if output is not None:
        write_scene(scaled, output)
    return Scaled.of(scaled, notes, verdict)


def find_scaling(
    scene: Scene, share: float = SHARE, *, accepted: AcceptedParts | None = None
) -> tuple[Scene, tuple[str, ...]]:
    """Return the scene with scalings that use its op-amps well, and notes on them.

    The solution does not change; lambda is a number. Slopes and currents stay below 90 % of their
    limits. `accepted` are parts beyond the limits of real ones, by default those of the scene; the
    errors are those of `scale`.
    """
    topology = topology_of(scene)
    if "gain" in topology.unused:
        text = (
            f"topology {topology.name!r} has no gain and no R that scalings could set; use"
            f" `taction design tune --over {topology.searched[0].rpartition('.')[2]}`"
        )
        raise InputError(scene.file, Complaint("design.topology", repr(topology.name), text))
    accepted = accepted or accepted_parts(scene)
    found = list[tuple[bool, float, Scene, tuple[Load, ...], list[str]]]()
    for factor in SMALLER:
        notes = list[str]()
        scaled = with_resistors(scene, factor, notes)
        scaled = _with_capacitance(scaled, accepted, notes, _damped) or scaled
        scaled, loads = _with_loads(scaled, share, notes)
        volts = max((load.share for load in loads if load.quantity == "voltage"), default=0.0)
        passing = _with_capacitance(scaled, accepted, notes, is_good)  # this C depends on U0
        found.append((passing is not None, volts, passing or scaled, loads, notes))
        if not loads or volts >= FULL * share:  # U0 has two digits
            break
    _, volts, scaled, loads, notes = max(found, key=lambda one: one[:2])
    if loads and volts < FULL * share:
        notes.append(f"{describe(loads[0])}: it sets U0, not the share of the swing")
    design = scaled.design.model_copy(update={"opamp": scene.design.opamp})
    scaled = scaled.model_copy(update={"design": design})
    circuit = synthesise(scaled)
    if refused := accepted.refused(broken_at_rest(LinearBoard(circuit))):
        text = f"the scalings need {refused}, which the scene does not have"
        raise InputError(scene.file, Complaint("design", "", text))
    return scaled, tuple(dict.fromkeys((*notes, *part_warnings(circuit))))


def _at_voltage(scene: Scene, volts: float) -> Scene:
    """Return the scene with U0 of two digits, rounded down; G0 keeps R and lambda if it must."""
    digit = 10.0 ** (math.floor(math.log10(volts)) - 1)
    rounded = float(f"{digit * math.floor(volts / digit * (1.0 + 1e-9)):.1e}")
    changes = {"design.unit_voltage": rounded}
    if scene.design.amplifier != "linear":
        ratio = scene.design.unit_voltage / rounded
        changes["design.unit_conductance"] = scene.design.unit_conductance * math.sqrt(ratio)
    return with_values(scene, changes)


def _damped(trial: Trial) -> bool:
    """Whether a board is stable, and rings so little that its loads do not set U0."""
    return "stability" not in trial.record.failed and trial.overshoot < 1.0


def _with_capacitance(
    scene: Scene, accepted: AcceptedParts, notes: list[str], accept: Accept
) -> Scene | None:
    """Return the scene with the nearest C that is accepted; None where none is."""
    path, trials = "design.capacitance", Trials(scene, accepted=accepted)
    own = trials.at({path: scene.design.capacitance})
    if accept(own):
        return scene
    rest = own.record.check_values.get("steady_state") or 0.0
    off = accept is is_good and rest > scene.checks.steady_state.tolerance  # no C moves the rest
    found = None if off else search(trials, path, accept=accept)
    if found is None or not found.found:
        notes.append(f"{NO_C}: {own.refused or own.record.reason}")
        return None
    farads = float(found.found[0].values[path])
    notes.append(f"C is another than the scene's, {show(farads, 'F', 3)}: {own.record.reason}")
    return with_values(scene, {path: farads})


def _with_loads(scene: Scene, share: float, notes: list[str]) -> tuple[Scene, tuple[Load, ...]]:
    """Return the scene with the largest U0 that keeps the shares, and its loads."""
    loads: tuple[Load, ...] = ()
    for _ in range(ROUNDS):
        board = build(scene.with_engine("statespace"))
        if not board.poles.known_stable:
            notes.append("the loads of an unstable board are not known: U0 is that of the outputs")
            return scene, ()
        if board.loads.unknown:
            raise EngineError(board.loads.unknown)
        loads = board.loads.loads
        if not loads:
            notes.append("the op-amps have no limits: U0 is that of the scene")
            return scene, ()
        ratio = min(_allowed(load, share) for load in loads)
        if not math.isfinite(ratio):
            notes.append("nothing moves with this strain: U0 is that of the scene")
            return scene, loads
        volts = scene.design.unit_voltage
        after = _at_voltage(scene, volts * ratio)
        if after.design.unit_voltage == volts:
            break
        scene = after
    return scene, loads


def _allowed(load: Load, share: float) -> float:
    """Return the factor by which a load may grow."""
    volts = load.quantity == "voltage"
    limit, error = (share, 0.0) if volts else (FULL * (1.0 - 1e-6), load.error)
    return limit * load.limit / (load.peak + error) if load.peak else math.inf
