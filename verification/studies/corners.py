"""Worst cases within the design tolerances: from the signs of the sensitivities, or a list.

The sensitivity of each quantity to each component is a difference of two verifications by the
state-space engine. The corner that moves a quantity most is where every component stands at the
end of its tolerance with that sign: exact for a quantity that moves monotonically, which is said.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from netlist_gen.circuit import Circuit, Floats
from netlist_gen.problem import InverseProblem, make_problem
from netlist_gen.scene import Scene
from netlist_gen.synthesis import synthesise
from netlist_gen.variation import Parameter, parameters, vary
from spice_models.errors import Complaint, InputError, TactionError
from verification.studies.montecarlo import QUANTITIES, Sample, sample_of
from verification.verify import verify

PROBE = 0.25  # of the tolerance: far enough for a clean difference, near enough to be local


@dataclass(frozen=True, slots=True)
class Corner:
    """One corner: its name, the quantity it was made for (or empty), and what came out."""

    name: str
    quantity: str
    result: Sample
    largest: tuple[str, ...]


def worst_corners(
    scene: Scene, progress: Callable[[str], None] = lambda stage: None
) -> tuple[Corner, ...]:
    """Return the nominal board and, for every quantity, the corner that makes it worst.

    Raises
    ------
    InputError
        The scene cannot be built, or nothing varies.
    """
    problem = make_problem(scene)
    nominal = synthesise(scene, problem)
    varied = parameters(nominal, scene.tolerances)
    if not varied:
        text = "every tolerance is zero: there are no corners"
        raise InputError(scene.file, Complaint("tolerances", "", text))
    progress("nominal")
    rapid = _with_engine(scene, "statespace")
    centre = _judged(rapid, problem, nominal)
    gradient = np.full((len(QUANTITIES), len(varied)), 0.0)
    for index, parameter in enumerate(varied):
        progress(f"sensitivity {index + 1} of {len(varied)}: {parameter.name}")
        z = np.zeros(len(varied))
        z[index] = PROBE
        moved = _judged(rapid, problem, vary(nominal, scene.tolerances, z))
        gradient[:, index] = _difference(moved, centre)
    corners = [Corner("nominal", "", _judged(scene, problem, nominal), ())]
    for row, quantity in enumerate(QUANTITIES):
        progress(f"corner: {quantity}")
        board = vary(nominal, scene.tolerances, np.sign(gradient[row]))
        result = _judged(scene, problem, board)
        corners.append(Corner(f"worst {quantity}", quantity, result, _top(gradient[row], varied)))
    return tuple(corners)


def named_corner(scene: Scene, name: str, ends: Mapping[str, float]) -> Corner:
    """Verify one corner of a user's own.

    Parameters
    ----------
    ends : dict of str to float
        Deviation in tolerances (1 and -1 are the ends), by component or by kind (``capacitor``).

    Raises
    ------
    InputError
        A name that is neither.
    """
    problem = make_problem(scene)
    nominal = synthesise(scene, problem)
    varied = parameters(nominal, scene.tolerances)
    known = {p.name for p in varied} | {p.kind for p in varied}
    for key in ends:
        if key not in known:
            kinds = ", ".join(sorted({p.kind for p in varied}))
            text = f"neither a component that varies nor one of {kinds}"
            raise InputError("--corner", Complaint(key, "", text))
    z = np.array([ends.get(p.name, ends.get(p.kind, 0.0)) for p in varied])
    return Corner(name, "", _judged(scene, problem, vary(nominal, scene.tolerances, z)), ())


def _with_engine(scene: Scene, engine: str) -> Scene:
    analysis = scene.analysis.model_copy(update={"engine": engine})
    return scene.model_copy(update={"analysis": analysis})


def _judged(scene: Scene, problem: InverseProblem, board: Circuit) -> Sample:
    try:
        verdict = verify(scene, problem=problem, circuit=board, second_look=False, details=False)
    except TactionError as error:
        return Sample(0, 0, "inconclusive", reason=str(error).splitlines()[0])
    return sample_of(verdict, 0, 0)


def _difference(moved: Sample, centre: Sample) -> Floats:
    """Return how each quantity moved; one that is missing (no settling time) moved upwards."""
    pairs = [(getattr(moved, q), getattr(centre, q)) for q in QUANTITIES]
    return np.array([1.0 if a is None else 0.0 if b is None else a - b for a, b in pairs])


def _top(gradient: Floats, varied: tuple[Parameter, ...], count: int = 5) -> tuple[str, ...]:
    order = np.argsort(-np.abs(gradient))[:count]
    return tuple(f"{'+' if gradient[i] > 0 else '-'}{varied[i].name}" for i in order)
