"""The grid of a sweep, and the key under which the store finds each of its points."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from taction.netlist_gen.scene.axes import (
    Fixed,
    Over,
    SweepAxis,
    check_axes,
    fixed_values,
    parse_axes,
    with_values,
)
from taction.netlist_gen.scene.keys import Value, files_of
from taction.netlist_gen.scene.scene import Scene
from taction.system.array_types import Ints
from taction.system.errors import Complaint, InputError
from taction.system.foreign_files import LARGEST, UnusableFileError, read_bounded
from taction.verification.engines.ngspice.executable import find_simulator
from taction.verification.reference.lambda_rule import read_scene
from taction.verification.studies.running.versions import digest, own_code, simulator_name
from taction.verification.verdict.simulation import choose_engine

MAX_POINTS = 1_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Everything that defines a sweep.

    Raises
    ------
    InputError
        There are more than `MAX_POINTS` points.
    """

    scene: Scene
    groups: Sequence[Sequence[SweepAxis]]  # they span the grid; the axes of a group change together
    engine: str

    def __post_init__(self) -> None:
        if self.points > MAX_POINTS:
            text = f"at most {MAX_POINTS} points in one sweep"
            raise InputError("--over", Complaint("points", repr(self.points), text))

    @property
    def axes(self) -> tuple[SweepAxis, ...]:
        """All axes, in the order of the grid."""
        return tuple(axis for group in self.groups for axis in group)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values of each group."""
        return tuple(len(group[0]) for group in self.groups)

    @property
    def points(self) -> int:
        """Number of points of the grid."""
        return math.prod(self.shape)

    @property
    def order(self) -> Ints:
        """Places of the grid in the order of computing, (P,): capacitances change fastest.

        Points of one call then have the same resistances, and more of them one kind of board: where
        op-amps slew depends on gains more than on capacitances.
        """
        fast = [all(axis.key.unit == "F" for axis in group) for group in self.groups]
        axes = sorted(range(len(fast)), key=lambda k: fast[k])
        return np.arange(self.points).reshape(self.shape).transpose(axes).ravel()

    def values_at(self, place: int) -> dict[str, Value]:
        """Return the values at a place of the grid, in its order from 0, by their paths."""
        at = zip(self.groups, np.unravel_index(place, self.shape), strict=True)
        return {axis.key.path: axis.values[k] for group, k in at for axis in group}


@dataclass(frozen=True, slots=True)
class GridPoint:
    """One point of the grid."""

    place: int  # in the order of the grid, from 0
    values: dict[str, Value]
    key: bytes  # digest of the scene at the point, and of all else that its result depends on


def grid_points(plan: Plan, places: Iterable[int] | None = None) -> Iterator[GridPoint]:
    """Yield points of a plan, by default all, in the order of the grid.

    A file that a scene names and that is missing raises its error at the point.

    Raises
    ------
    SimulatorNotFound, SimulatorTooOld
        The plan needs ngspice, and no ngspice was found or the ngspice is too old.
    """
    scene = plan.scene.model_dump(by_alias=True, exclude={"name", "regression", "analysis"})
    analysis = plan.scene.analysis.model_dump(exclude={"engine", "timeout"})
    simulator = simulator_name(find_simulator()) if plan.engine == "ngspice" else ""
    base = digest(own_code(), scene, analysis, simulator, plan.engine)
    named = files_of(plan.scene)

    @cache
    def content(name: str) -> bytes:
        with suppress(UnusableFileError):
            return hashlib.sha256(read_bounded(plan.scene.folder / name, LARGEST)).digest()
        return b""

    for place in range(plan.points) if places is None else map(int, places):
        values = plan.values_at(place)
        names = [values.get(path, name) for path, name in named.items()]
        files = [content(name) if isinstance(name, str) else b"" for name in names]
        yield GridPoint(place, values, digest(base, values, files))


def plan_sweep(
    scene: str | Path | Scene, over: Over, engine: str | None, *, fix: Fixed = ()
) -> Plan:
    """Return the grid of a sweep; arguments and errors are those of `sweep`."""
    scene = read_scene(scene)
    fixed = fixed_values(scene, fix)
    scene = with_values(scene, fixed) if fixed else scene
    axes = parse_axes(scene, over)
    check_axes(axes, fixed)
    return Plan(scene, axes, choose_engine(scene if engine is None else scene.with_engine(engine)))
