"""Worst cases within the design tolerances: from the signs of the sensitivities, or a list.

The sensitivity of each quantity to each component is a difference of two verifications by the
state-space engine. The corner that moves a quantity most is where every component stands at the
end of its tolerance with that sign: exact for a quantity that moves monotonically with each.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from netlist_gen.circuit import Floats
from netlist_gen.scene import Scene
from netlist_gen.variation import Parameter
from spice_models.errors import Complaint, InputError
from verification.studies.executors import Workers
from verification.studies.varied import Quantity, Sample, Study, evaluate, prepare, quantities, run

PROBE = 0.25  # of the tolerance: far enough for a clean difference, near enough to be local
TOLD = 5  # components of each corner that are named
NOMINAL = -1  # number of the probe without deviation


@dataclass(frozen=True, slots=True)
class Corner:
    """One corner.

    Attributes
    ----------
    name : str
        ``"nominal"``, ``"worst overshoot"``, or the user's words.
    quantity : str
        What it was made for, or empty.
    result : Sample
        What came out.
    largest : tuple of str
        The components that matter most, with their signs.
    deviations : dict of str to float
        Of every component that is not at its nominal value, in tolerances.
    """

    name: str
    quantity: str
    result: Sample
    largest: tuple[str, ...]
    deviations: dict[str, float]


def worst_corners(
    scene: Scene, workers: Workers, progress: Callable[[str], None] = lambda stage: None
) -> tuple[Corner, ...]:
    """Return the nominal board and, for every quantity, the corner that makes it worst.

    Parameters
    ----------
    workers : Workers
        Run the probes, one for each component.

    Raises
    ------
    InputError
        The scene cannot be built, or nothing varies.
    NoVerdictError
        The problem has no answer, or the workers are gone.
    """
    study = prepare(scene, full_margin=True)
    told = quantities(scene)
    gradient = _gradient(replace(study, scene=_with_engine(scene, "statespace")), workers, progress)
    corners = [_corner(study, "nominal", np.zeros(len(study.varied)))]
    for row, quantity in enumerate(told):
        progress(f"corner: {quantity.name}")
        corner = _corner(study, f"worst {quantity.name}", np.sign(gradient[row]))
        largest = _top(gradient[row], study.varied)
        corners.append(replace(corner, quantity=quantity.name, largest=largest))
    return tuple(corners)


def named_corner(study: Study, name: str, ends: Mapping[str, float]) -> Corner:
    """Verify one corner of a user's own.

    Parameters
    ----------
    ends : dict of str to float
        Deviation in tolerances (1 and -1 are the ends), by component or by kind (``capacitor``);
        a component's own goes before that of its kind.

    Raises
    ------
    InputError
        A name that is neither.
    """
    known = {p.name for p in study.varied} | {p.kind for p in study.varied}
    for key in ends:
        if key not in known:
            kinds = ", ".join(sorted({p.kind for p in study.varied}))
            text = f"neither a component that varies nor one of {kinds}"
            raise InputError("--corner", Complaint(key, "", text))
    z = [ends.get(p.name, ends.get(p.kind, 0.0)) for p in study.varied]
    return _corner(study, name, np.array(z))


def _corner(study: Study, name: str, z: Floats) -> Corner:
    moved = zip(study.varied, z.tolist(), strict=True)
    deviations = {parameter.name: value for parameter, value in moved if value}
    return Corner(name, "", evaluate(study, 0, z), (), deviations)


def _gradient(study: Study, workers: Workers, progress: Callable[[str], None]) -> Floats:
    """Return how each quantity becomes worse with each component, (quantities, components)."""
    count = len(study.varied)
    probes = [(NOMINAL, np.zeros(count)), *enumerate(PROBE * np.eye(count))]
    samples: dict[int, Sample] = {}
    for sample in run(study, probes, workers):
        samples[sample.number] = sample
        progress(f"sensitivities: {len(samples)} of {len(probes)} boards")
    centre, told = samples[NOMINAL], quantities(study.scene)
    moved = [[_worse(q, samples[index], centre) for index in range(count)] for q in told]
    return np.array(moved, dtype=np.float64)


def _worse(quantity: Quantity, moved: Sample, centre: Sample) -> float:
    """Return how much worse a quantity became; losing it (no settling time) is worst of all."""
    after, before = getattr(moved, quantity.name), getattr(centre, quantity.name)
    if after is None or before is None:
        return float(before is not None) - float(after is not None)
    return quantity.worse * float(after - before)


def _with_engine(scene: Scene, engine: str) -> Scene:
    analysis = scene.analysis.model_copy(update={"engine": engine})
    return scene.model_copy(update={"analysis": analysis})


def _top(gradient: Floats, varied: tuple[Parameter, ...]) -> tuple[str, ...]:
    order = np.argsort(-np.abs(gradient), kind="stable")[:TOLD].tolist()
    shown = [index for index in order if gradient[index]]
    return tuple(f"{'+' if gradient[i] > 0 else '-'}{varied[i].name}" for i in shown)
