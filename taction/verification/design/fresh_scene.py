"""A new scene: with comments, or for a matrix and a strain from files.

For a matrix lambda is chosen, the board is scaled, stable and verified. Entries of T that no
resistor can represent are left out. The limits of the checks follow from the tolerance of the
resistors.
"""

from __future__ import annotations

import math
import os
import textwrap
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from taction.netlist_gen.board.part_warnings import LEAST_OHMS, MOST_OHMS, AcceptedParts
from taction.netlist_gen.scene.axes import with_values
from taction.netlist_gen.scene.inverse_problem import read_problem
from taction.netlist_gen.scene.keys import scene_text
from taction.netlist_gen.scene.open_tables import OPAMPS, refuse_unknown
from taction.netlist_gen.scene.scene import Scene, load_scene, parse_scene
from taction.netlist_gen.topologies.frame.topology import pruned
from taction.system.array_types import Floats
from taction.system.errors import Complaint, InputError
from taction.system.output_files import write_atomically
from taction.system.progress import Progress
from taction.system.quantities import fraction
from taction.system.results import Result
from taction.verification.design.scaling import Scaled, find_scaling
from taction.verification.reference.lambda_rule import TAU, choose
from taction.verification.reference.problem import Problem
from taction.verification.verdict.simulation import build
from taction.verification.verdict.verify import verify

GRADES = (0.01, 1e-3, 1e-4)  # tolerances of resistors that are sold, the cheapest first
WANTED = 0.02  # a better grade is taken where the limit would be above this share of the step
KEPT = 0.98  # share of the boards without a channel beyond the limit
ROUND = (1.0, 2.0, 5.0, 10.0)
LEAST = 1e-3  # the default limit
BAND = 2.0  # the settling band over the limit
WORST = 0.2  # of the step: a limit above says nothing of the answer
SERIES = "E96"

NECESSARY = LEAST_OHMS / MOST_OHMS  # smaller entries have no resistor that can be bought
WIDTH = 98  # of a comment
LOOSE = {"steady_state": {"tolerance": WANTED}, "settling_time": {"band": BAND * WANTED}}
"""Checks while the scalings are searched; the limits of the scene follow from the scaled board."""
TEMPLATE = Path(__file__).parents[2] / "scene_template.toml"
MISSED = 0.01  # relative: how far the residual may be from that of the noise
DEFAULT = 0.01  # lambda without a noise level, in squared spectral norms of T


def with_limits(scene: Scene) -> tuple[Scene, str]:
    """Return the scene with limits that 98 % of its boards keep at rest, and their reason."""
    grade, share, limit = 0.0, math.inf, math.inf
    for finer in GRADES:
        reached = exceeded(with_values(scene, {"tolerances.resistor": finer}))
        if (rounded := max(LEAST, next_round_value(reached))) >= limit:
            break  # input errors or rounded values decide
        grade, share, limit = finer, reached, rounded
        if share <= WANTED:
            break
    if limit > WORST:
        text = (
            f"its input errors and resistors of {100 * grade:g} % move the outputs at rest by"
            f" {100 * share:.2g} % of the step; expected an op-amp with smaller errors, such as"
            " --opamp opa189, or a larger lambda"
        )
        raise InputError(scene.file, Complaint("design.opamp", scene.design.opamp.base, text))
    keys = {
        "tolerances.resistor": grade,
        "checks.steady_state.tolerance": limit,
        "checks.settling_time.band": BAND * limit,
    }
    note = (
        f"resistors of {100 * grade:g} % and the input errors of the op-amps move the outputs at"
        f" rest by up to {100 * share:.2g} % of the step in 98 % of the boards: the limit is"
        f" {100 * limit:g} %"
    )
    return with_values(scene, keys), note


def exceeded(scene: Scene) -> float:
    """Return the distance from the reference that 98 % of the built boards keep, in steps."""
    board = build(scene.with_engine("statespace"))
    spread = board.built_spread(scene.tolerances)
    amplitude, target = board.amplitude, board.ideal.target
    if spread is None or not amplitude:  # without a step nothing is judged
        return 0.0
    drawn = float(np.abs(board.steady.values - target).max())  # all input errors of one sign
    return max(drawn, spread.distance(target, KEPT)[0]) / amplitude


def next_round_value(value: float) -> float:
    """Return the next number of 1, 2, 5 and 10 times a power of ten, not below a value."""
    decade = 10.0 ** math.floor(math.log10(value)) if value > 0.0 else 0.0
    return next((float(f"{m * decade:.1g}") for m in ROUND if m * decade >= value), 0.0)


@dataclass(frozen=True, slots=True)
class NewScene(Result):
    """The file of a new scene, and for a matrix its scalings with the verdict."""

    VIEW = "taction.verification.report.views.design_view:new_view"
    DOCUMENT = "taction.verification.report.documents.plain:NewMatrixDocument.of"

    file: str
    scaled: Scaled | None = None
    rule: str = ""  # how lambda was chosen
    notes: tuple[str, ...] = field(default=(), repr=False)  # on entries left out, and the limits

    @property
    def outcome(self) -> str:
        """The outcome of the verdict; ``pass`` without a matrix."""
        return "pass" if self.scaled is None else self.scaled.outcome


def _for_matrix(
    path: Path,
    arrays: tuple[str | Path, str | Path],
    noise: str | float | None,
    lam: float | None,
    asked: dict[str, Any],
    progress: Progress,
) -> NewScene:
    """Write a scene for the files of a matrix and a strain; `asked` are keys of its design."""
    T, eps = read_problem(*arrays)
    (chosen, rule), notes = _lambda(T, eps, noise, lam), list[str]()
    if "prune" not in asked and (lost := int(np.count_nonzero(pruned(T, NECESSARY) != T))):
        asked["prune"] = NECESSARY
        text = f"design.prune = {NECESSARY:g} leaves out {lost} of the entries of T: no resistor"
        notes.append(f"{text} that can be bought has their conductance")
    data = {
        "name": _name_of(path),
        "problem": {"kind": "matrix", "matrix": T, "strain": eps},
        "design": {
            **{"amplifier": "linear", "strain_input": "voltage", "resistor_series": SERIES},
            **{**asked, "lambda": chosen},
        },
        "checks": LOOSE,
    }
    scaled, found = find_scaling(parse_scene(data, path), accepted=AcceptedParts({}))
    limited, limits = with_limits(scaled)
    rows, columns = T.shape
    head = f"Scaled by taction for a matrix of {rows} rows and {columns} columns; lambda: {rule}."
    remarks = (head, *notes, f"Limits: {limits}.")
    lines = [f"# {line}" for remark in remarks for line in textwrap.wrap(remark, WIDTH)]
    files = (Path(os.path.relpath(file, path.parent)).as_posix() for file in arrays)
    names = dict(zip(("problem.matrix", "problem.strain"), files, strict=True))
    write_atomically(path, "\n".join([*lines, "", scene_text(with_values(limited, names))]))
    if limited.checks.steady_state.tolerance > WANTED:  # else no more than was searched for
        notes.append(limits)
    verdict = verify(load_scene(path).with_engine("statespace"), progress)
    return NewScene(str(path), Scaled.of(scaled, found, verdict), rule, tuple(notes))


def noise_of(noise: str | float, eps: Floats) -> float:
    """Return the standard deviation that `noise` states: a number, or a share as ``"1%"``."""
    try:
        value = fraction(noise)
    except ValueError:
        value = math.nan
    if str(noise).strip().endswith("%"):
        value *= float(np.abs(eps).max(initial=0.0))
    if not 0.0 < value < math.inf:
        accepted = "expected a positive number such as 0.01, or 1% of the largest strain"
        raise InputError("--noise", Complaint("SIGMA", repr(noise), accepted))
    return value


def _unexplained(T: Floats, eps: Floats, noise: float) -> Complaint:
    """Return why a noise does not explain the strain, and between which values one does."""
    rest = eps - T @ np.linalg.lstsq(T, eps, rcond=None)[0]
    least, largest = (float(np.sqrt(np.mean(part**2) / TAU)) for part in (rest, eps))
    text = "every answer leaves more of the strain unexplained"
    if noise >= largest:
        text = "this noise hides the whole strain"
    text += f"; expected a number between {least:.2g} and {largest:.2g}"
    return Complaint("SIGMA", f"{noise:g}", text)


def _lambda(
    T: Floats, eps: Floats, noise: str | float | None, lam: float | None
) -> tuple[float, str]:
    """Return lambda with three digits, and how it was chosen."""
    square = float(np.linalg.norm(T, 2)) ** 2
    if not square:
        raise InputError("matrix", Complaint("problem.matrix", "0", "T is all zeros"))
    if lam is not None:
        return lam, "as given"
    if noise is None:
        return float(f"{DEFAULT * square:.2e}"), f"the default, {DEFAULT:g} |T|²"
    sigma = noise_of(noise, eps)
    choice = choose(Problem(T, eps, 1.0), "discrepancy", variance=sigma**2)
    if choice.at_edge or choice.score > MISSED:
        raise InputError("--noise", _unexplained(T, eps, sigma))
    value = float(f"{choice.solution.lam:.2e}")
    share = f", {noise} of the largest strain" if str(noise).endswith("%") else ""
    return value, f"by the discrepancy rule, noise {sigma:.3g}{share}"


def new(
    file: str | Path = "scene.toml",
    *,
    matrix: str | Path | None = None,
    strain: str | Path | None = None,
    noise: str | float | None = None,
    lam: float | None = None,
    opamp: str = "opa2134",
    supply: str | None = None,
    prune: float | None = None,
    force: bool = False,
    progress: Progress = lambda stage: None,
) -> NewScene:
    """Write a scene to FILE (scene.toml): every key with its default and a comment.

    With --matrix and --strain: a scene for them, scaled for the op-amps, stable, and verified by
    the state-space engine, which decides the exit status.

    Parameters
    ----------
    file : path
        The scene file to write.
    matrix : path, optional
        Matrix T, .csv or .npy: a scene for it, with --strain.
    strain : path, optional
        Strain of the matrix, .csv or .npy.
    noise : str or float, optional
        Standard deviation of the noise of one strain, or 1% of the largest strain: lambda by the
        discrepancy rule.
    lam : float, optional
        Lambda; by default 0.01 times the squared norm of T, or by --noise.
    opamp : str
        Preset.
    supply : str, optional
        Supply as ±12V, with --matrix.
    prune : float, optional
        design.prune.
    force : bool
        Overwrite FILE.
    progress : callable, optional
        Receives the name of each stage.

    Returns
    -------
    NewScene
        The file; with a matrix also the scalings and the verdict.

    Raises
    ------
    InputError
        A file exists or cannot be used, or an argument needs `matrix`.
    NoVerdictError
        No board for the matrix is found.

    Examples
    --------
    >>> import taction, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     made = taction.new(f"{folder}/board.toml")
    ...     taction.load_scene(made.file).name
    'board'
    """
    path = Path(file)
    if (matrix is None) != (strain is None):
        missing = "--matrix" if matrix is None else "--strain"
        raise InputError(missing, Complaint("FILE", "", "--matrix and --strain belong together"))
    given = {"--noise": noise, "--lambda": lam, "--supply": supply, "--prune": prune}
    for option, value in given.items():
        if matrix is None and value is not None:
            raise InputError(option, Complaint("value", repr(value), "needs --matrix"))
    if path.exists() and not force:
        text = "the file exists; give another name, or --force to overwrite it"
        raise InputError(path, Complaint("FILE", "", text))
    refuse_unknown(opamp, "--opamp")
    if matrix is None or strain is None:
        write_atomically(path, _template(opamp).replace("@NAME@", _name_of(path)))
        return NewScene(str(path))
    progress("scalings")
    design = {"opamp": opamp, "supply": supply, "prune": prune}
    asked = {key: value for key, value in design.items() if value is not None}
    return _for_matrix(path, (matrix, strain), noise, lam, asked, progress)


def _name_of(path: Path) -> str:
    """Return the name of a scene by that of its file."""
    stem = "".join(c if c.isascii() and (c.isalnum() or c in "-_.") else "-" for c in path.stem)
    return stem[:64] or "scene"


def _template(opamp: str) -> str:
    """Return the scene with comments for an op-amp, at a supply that it allows."""
    text = TEMPLATE.read_text(encoding="utf-8")
    head, key, tail = text.partition('\nopamp = { base = "')
    text = f"{head}{key}{opamp}{tail[tail.index(chr(34)) :]}"
    if (volts := OPAMPS[opamp].most_supply) < 15.0:
        text = text.replace('\nsupply = "±15V"', f'\nsupply = "±{volts:g}V"')
    return text
