"""Worst cases within the design tolerances: from the signs of the sensitivities, or a list.

The sensitivity of each quantity to each component is a difference of two verifications by the
state-space engine. The corner that moves a quantity most is where every component stands at the
end of its tolerance with that sign: exact for a quantity that moves monotonically with each. The
steady-state error is not one, it has its least value near the nominal board: the corner is that of
the channel whose signed error, which is one, goes furthest. Where a corner that was made for one
quantity turns out worse in another than that one's own, that corner is reported instead.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from netlist_gen.board.variation import Parameter, vary
from netlist_gen.scene.scene import Scene
from spice_models.array_types import Floats
from spice_models.errors import Complaint, InputError
from verification.engines.statespace.linearised.board import LinearBoard
from verification.studies.running.executors import Workers
from verification.studies.tolerance.varied_board import (
    Quantity,
    Sample,
    VariedBoard,
    evaluate,
    prepare,
    quantities,
    run,
)

PROBE = 0.25  # of the tolerance: far enough for a clean difference, near enough to be local
NAMED = 5  # components of each corner that are named
CHANNELS = 8  # corners of the steady state that are tried
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
    gradient = _gradient(replace(study, scene=scene.with_engine("statespace")), workers, progress)
    progress("sensitivities of the steady state")
    gradient["steady_state"], *others = _steady_gradients(study)
    corners = [_corner(study, "nominal", np.zeros(len(study.varied)))]
    for quantity in told:
        progress(f"corner: {quantity.name}")
        corners.append(_corner(study, quantity.name, np.sign(gradient[quantity.name])))
    corners += [_corner(study, "", np.sign(each)) for each in others]
    nominal, *tried = corners
    # A corner made for one quantity may turn out worse in another than that one's own.
    worst = [min(tried, key=lambda c: _goodness(c.result, q, c.name)) for q in told]
    named = [
        replace(
            corner,
            name=f"worst {quantity.name}",
            quantity=quantity.name,
            largest=_top(gradient[quantity.name], study.varied, corner.deviations),
        )
        for quantity, corner in zip(told, worst, strict=True)
    ]
    return (nominal, *named)


def named_corner(study: VariedBoard, name: str, ends: Mapping[str, float]) -> Corner:
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


def _corner(study: VariedBoard, name: str, z: Floats) -> Corner:
    moved = zip(study.varied, z.tolist(), strict=True)
    deviations = {parameter.name: value for parameter, value in moved if value}
    return Corner(name, "", evaluate(study, 0, z), (), deviations)


def _gradient(
    study: VariedBoard, workers: Workers, progress: Callable[[str], None]
) -> dict[str, Floats]:
    """Return how much worse each quantity becomes with each component, (components,) each."""
    count = len(study.varied)
    probes = [(NOMINAL, np.zeros(count)), *enumerate(PROBE * np.eye(count))]
    samples: dict[int, Sample] = {}
    for sample in run(study, probes, workers):
        samples[sample.number] = sample
        progress(f"sensitivities: {len(samples)} of {len(probes)} boards")
    return {
        quantity.name: np.array(
            [_worse(quantity, samples[index], samples[NOMINAL]) for index in range(count)]
        )
        for quantity in quantities(study.scene)
    }


def _steady_gradients(study: VariedBoard) -> list[Floats]:
    """Return how the signed errors of channels move, upwards and downwards, the furthest first.

    An overshoot that is none at the nominal board has no sensitivity there either; the corners of
    the channels that go furthest beyond their targets stand in for it.
    """
    count = len(study.varied)

    def error(z: Floats) -> Floats:
        rest = LinearBoard(vary(study.nominal, study.scene.tolerances, z)).equilibrium
        found = [output.sign * rest[output.node] for output in study.nominal.outputs]
        return np.array(found) - study.ideal.target

    centre = error(np.zeros(count))
    slopes = np.array([error(PROBE * each) - centre for each in np.eye(count)]).T / PROBE
    ways = [(sign * centre[n], sign * slopes[n]) for n in range(len(centre)) for sign in (1, -1)]
    furthest = sorted(ways, key=lambda way: -float(way[0] + np.abs(way[1]).sum()))
    return [slope for _, slope in furthest[:CHANNELS]]


def _goodness(sample: Sample, quantity: Quantity, own: str) -> tuple[float, bool]:
    """Return what is least for the worst sample; among equals the quantity's own corner is."""
    value = getattr(sample, quantity.name)
    lost = math.inf if sample.reason else -math.inf
    return lost if value is None else -quantity.worse * value, own != quantity.name


def _worse(quantity: Quantity, moved: Sample, centre: Sample) -> float:
    """Return how much worse a quantity became; losing it (no settling time) is worst of all."""
    after, before = getattr(moved, quantity.name), getattr(centre, quantity.name)
    if after is None or before is None:
        return float(before is not None) - float(after is not None)
    return quantity.worse * float(after - before)


def _top(
    gradient: Floats, varied: tuple[Parameter, ...], deviations: Mapping[str, float]
) -> tuple[str, ...]:
    order = np.argsort(-np.abs(gradient), kind="stable")[:NAMED].tolist()
    names = [varied[index].name for index in order if varied[index].name in deviations]
    return tuple(f"{'+' if deviations[name] > 0 else '-'}{name}" for name in names)
