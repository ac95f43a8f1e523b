"""What is accepted but looks like a slip: each is a question to the user, no error."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from taction.netlist_gen.scene.axes import SweepAxis, kept_figures, with_value
from taction.netlist_gen.scene.scene import Scene
from taction.system.quantities import show
from taction.system.reading_definitions import EXCURSIONS

PARTS = {"opamp", "gain", "unit_conductance"}
DEFAULT_PARTS = (
    "design.opamp, gain and unit_conductance are not given: the paper's board with a uA741, which"
    " its input errors move by more than most limits; `taction new --matrix T.csv --strain eps.csv`"
    " writes parts that work"
)
USUAL = (1e-14, 1e-4)  # F: from a fraction of a stray capacitance to the largest film capacitors
SHARES = ("resistor", "capacitor", "stray", "opamp_gbw", "opamp_gain")


def questions(scene: Scene) -> tuple[str, ...]:
    """Return what may be a slip in a scene: in the way it is written, and in its values."""
    from taction.netlist_gen.topologies.frame.topology import topology_of  # it loads numpy

    design, topology = scene.design, topology_of(scene)
    found = [*scene.written_questions, *value_questions(scene)]
    if not PARTS & design.model_fields_set:
        found.append(DEFAULT_PARTS)
    unused = sorted(topology.unused & design.model_fields_set)
    found += [f"design.{key} has no effect with topology = {topology.name!r}" for key in unused]
    return tuple(found)


def value_questions(scene: Scene) -> Iterator[str]:
    """Yield the capacitances that no board has, and limits that are no limits."""
    farads = scene.design.capacitance
    if not USUAL[0] <= farads <= USUAL[1]:
        low, high = (show(limit, "F") for limit in USUAL)
        yield (
            f"design.capacitance = {show(farads, 'F')} is not between {low} and {high}; is the"
            " prefix right? 'm' is milli, 'u' micro, 'n' nano, 'p' pico"
        )
    for name in EXCURSIONS:
        check = getattr(scene.checks, name)
        if check is not None and check.max is not None and check.max > 1.0:
            yield (
                f"checks.{name}: max = {check.max:g} is {100.0 * check.max:g} % of the step; is it"
                f" a percentage? {check.max:g} % is {check.max / 100.0:g}"
            )
    ohms = scene.design.gain
    if ohms < 1.0:
        yield (
            f"design.gain = {show(ohms, 'ohm')} is below 1 ohm; is the prefix right? 'm' is milli,"
            " 'M' is mega"
        )
    for name, share in scene.tolerances:
        if name in SHARES and share >= 1.0:
            yield (
                f"tolerances.{name} = {share:g} is {100.0 * share:g} % of the value; is it a"
                f" percentage? {share:g} % is {share / 100.0:g}"
            )


def axis_questions(scene: Scene, groups: Sequence[Sequence[SweepAxis]]) -> Iterator[str]:
    """Yield what may be a slip in axes: falling ranges, odd values, figures that stay."""
    own = set(value_questions(scene))
    yield from kept_figures(scene, [axis.key.path for group in groups for axis in group])
    for axis in (axis for group in groups for axis in group):
        first, last = axis.values[0], axis.values[-1]
        if axis.scale != "list" and float(first) > float(last):
            start, end = (show(float(value), axis.key.unit) for value in (first, last))
            text = f"the range falls from {start} to {end}; are its bounds swapped?"
            yield f"--over {axis.name}: {text}"
        found = [
            text
            for value in dict.fromkeys((first, last))
            for text in value_questions(with_value(scene, axis.key.path, value))
        ]
        yield from (f"--over {axis.name}: {text}" for text in found if text not in own)
