"""Warnings about resistors and capacitors that are hard to buy or do not work as drawn."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from taction.netlist_gen.board.circuit import Circuit, Resistor, Role
from taction.system.array_types import Floats
from taction.system.quantities import show

# An op-amp that drives 2.5 V into less must deliver more than 25 mA, the short-circuit current of
# the common types, and its output resistance (20 to 125 ohm) is no longer small beside the load.
LEAST_OHMS = 100.0
# Above, the leakage of a board without guard rings (about 10 Gohm) passes 0.5 % of the current, the
# bias current of a uA741 (80 nA) makes an offset of volts, and few makers sell 1 % resistors.
MOST_OHMS = 50e6


@dataclass(frozen=True, slots=True)
class _Kind:
    """Resistors that one key of the scene sets."""

    what: str
    less: str  # remedy for values above `MOST_OHMS`
    more: str  # remedy for values below `LEAST_OHMS`


_MATRIX = _Kind(
    "matrix resistors",
    "a larger design.unit_conductance, or design.prune, which leaves out small entries of T",
    "a smaller design.unit_conductance",
)
_FEEDBACK = _Kind(
    "resistors R", "a smaller design.resistance", "a larger design.resistance or a smaller lambda"
)
_GAIN = _Kind("resistors s", "a smaller design.gain", "a larger design.gain")
_INVERTER = _Kind(
    "inverter resistors",
    "a smaller design.inverter_resistance",
    "a larger design.inverter_resistance",
)
_STRAIN = _Kind("strain resistors", _MATRIX.less.partition(",")[0], _MATRIX.more)
_DIVIDER = _Kind(
    "resistors of the antilog stages",
    "a larger design.antilog.reference_current",
    "a larger design.antilog.divider_resistance or emitter_resistance",
)
_KINDS = {
    Role.SIGNAL_RESISTOR: _FEEDBACK,
    Role.BIAS_RESISTOR: _FEEDBACK,
    Role.CONSTRAINT_RESISTOR: _GAIN,
    Role.INVERTER_RESISTOR: _INVERTER,
    Role.STRAIN_RESISTOR: _STRAIN,
    Role.STAGE: _DIVIDER,
}


def part_warnings(circuit: Circuit) -> tuple[str, ...]:
    """Return one warning for each kind of part and limit that parts of `circuit` break.

    Each has the number of parts, the extreme value with the name of its part, and a remedy.

    Examples
    --------
    >>> import taction
    >>> scene = taction.load_scene("scenes/paper-breadboard.toml")
    >>> print(part_warnings(taction.synthesise(scene))[0][:65])
    60 of 74 matrix resistors are above 50 Mohm, up to 247.3 Mohm (Rf
    """
    return tuple(broken.text for broken in broken_limits(circuit).values())


@dataclass(frozen=True, slots=True)
class BrokenLimit:
    """A warning, and the factor by which the extreme part is beyond the limit, above 1."""

    text: str
    factor: float


def broken_limits(circuit: Circuit) -> dict[str, BrokenLimit]:
    """Return the warnings by the kind of part and the limit that it breaks.

    Examples
    --------
    >>> import taction
    >>> scene = taction.load_scene("scenes/paper-breadboard.toml")
    >>> list(broken_limits(taction.synthesise(scene)))
    ['matrix resistors above 50 Mohm']
    """
    found = [pair for parts in _by_kind(circuit) for pair in _resistors(*parts)]
    return dict([*found, *_capacitors(circuit)])


def _by_kind(circuit: Circuit) -> Iterator[tuple[_Kind, Floats, Callable[[int], str]]]:
    """Yield the values of each kind, ohm, infinite where there is no resistor, and their names."""
    yield (
        _MATRIX,
        np.concatenate([matrix.ohms.ravel() for matrix in circuit.matrices]),
        lambda place: _card(circuit, place),
    )
    kinds: dict[_Kind, list[Resistor]] = {}
    for part in circuit.resistors:
        for role, kind in _KINDS.items():
            if part.card in circuit.named(role):
                kinds.setdefault(kind, []).append(part)
    for kind, parts in kinds.items():
        names = [part.card for part in parts]
        yield kind, np.array([part.ohms for part in parts]), names.__getitem__


def _card(circuit: Circuit, place: int) -> str:
    """Return the name of a matrix resistor from its place in all entries of all matrices."""
    for matrix in circuit.matrices:
        if place < matrix.ohms.size:
            k, n = divmod(place, matrix.ohms.shape[1])
            return f"{matrix.name}_{k + 1}_{n + 1}"
        place -= matrix.ohms.size
    raise IndexError(place)


def _resistors(
    kind: _Kind, ohms: Floats, name: Callable[[int], str]
) -> Iterator[tuple[str, BrokenLimit]]:
    present = np.isfinite(ohms)
    factors = np.where(present, ohms, 1.0)
    for factor, limit, way, remedy in (
        (factors / MOST_OHMS, f"above {show(MOST_OHMS, 'ohm')}", "up", kind.less),
        (LEAST_OHMS / factors, f"below {show(LEAST_OHMS, 'ohm')}", "down", kind.more),
    ):
        wrong = present & (factor > 1.0)
        if wrong.any():
            place = int(np.where(wrong, factor, 0.0).argmax())
            text = (
                f"{np.count_nonzero(wrong)} of {np.count_nonzero(present)} {kind.what} are {limit},"
                f" {way} to {show(float(ohms[place]), 'ohm')} ({name(place)}); remedy: {remedy}"
            )
            yield f"{kind.what} {limit}", BrokenLimit(text, float(factor[place]))


def _capacitors(circuit: Circuit) -> Iterator[tuple[str, BrokenLimit]]:
    """Yield a warning if C is below the stray capacitance: then the layout sets the dynamics."""
    strays = [part.farads for part in circuit.capacitors_of(Role.STRAY)]
    signal = {p.card: p.farads for p in circuit.capacitors_of(Role.SIGNAL_CAPACITOR)}
    small = [name for name, value in signal.items() if value < max(strays, default=0.0)]
    if small:
        name = min(small, key=signal.__getitem__)
        text = (
            f"{len(small)} of {len(signal)} capacitors C are below the stray capacitance of"
            f" {show(max(strays), 'F')}, down to {show(signal[name], 'F')} ({name}); remedy: a"
            " larger design.capacitance, or a layout with a smaller design.stray_capacitance"
        )
        factor = max(strays) / signal[name]
        yield "capacitors C below the stray capacitance", BrokenLimit(text, factor)
