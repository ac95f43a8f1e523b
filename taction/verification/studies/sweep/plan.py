"""The grid of a sweep, and the digest under which the store finds each of its points."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
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
from taction.system.errors import Complaint, InputError, SimulatorNotFound, SimulatorTooOld
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
    engines: tuple[str, ...]  # "ngspice", "statespace" or both
    keep_waveforms: bool = False  # store the outputs over time
    hybrid: bool = (
        False  # ngspice only at the points of `taction.verification.studies.sweep.hybrid`
    )

    def __post_init__(self) -> None:
        if self.total > MAX_POINTS:
            text = f"at most {MAX_POINTS} points in one sweep"
            raise InputError("--over", Complaint("points", repr(self.total), text))

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
    def total(self) -> int:
        """Number of verifications, each engine counts; a hybrid sweep adds those of ngspice."""
        return self.points * (1 if self.hybrid else len(self.engines))

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


def engines_of(scene: Scene, engine: str | None) -> tuple[str, ...]:
    """Return the engines of a sweep: the requested engine, or by default the scene's.

    ``"both"`` and ``"hybrid"`` stand for ngspice and the state-space engine.

    Raises
    ------
    InputError
        There is no such engine.
    SimulatorNotFound, SimulatorTooOld
        ``"hybrid"``, and no ngspice was found or the ngspice is too old.
    """
    if engine == "hybrid":
        _require_ngspice()
    if engine in ("both", "hybrid"):
        return ("ngspice", "statespace")
    return (choose_engine(scene if engine is None else scene.with_engine(engine)),)


def _require_ngspice() -> None:
    try:
        find_simulator()
    except (SimulatorNotFound, SimulatorTooOld) as error:
        text = "the hybrid engine confirms points by ngspice; without ngspice: --engine statespace"
        raise type(error)(f"{text}. {error}") from None


@dataclass(frozen=True, slots=True)
class GridPoint:
    """One point of the grid for one engine; `request` is the digest of the scene at the point."""

    place: int  # in the order of the grid, from 0
    values: dict[str, Value]
    engine: str
    request: bytes


class Requests:
    """Points of a plan, each with its engines.

    Parameters
    ----------
    engines : tuple of str, optional
        By default all engines of the plan.
    places : ndarray (P,), optional
        Places of the grid; by default all, in its order.

    Raises
    ------
    SimulatorNotFound, SimulatorTooOld
        The plan needs ngspice, and no ngspice was found or the ngspice is too old.
    """

    def __init__(
        self, plan: Plan, engines: tuple[str, ...] | None = None, places: Ints | None = None
    ) -> None:
        self._plan, self._places = plan, places
        self._file_digests: dict[str, bytes] = {}
        scene = plan.scene.model_dump(by_alias=True, exclude={"name", "regression", "analysis"})
        analysis = plan.scene.analysis.model_dump(exclude={"engine", "timeout"})
        base = digest(own_code(), scene, analysis)
        self._bases = {
            engine: digest(base, simulator_of(engine), engine) for engine in engines or plan.engines
        }
        self._files = files_of(plan.scene)

    def __iter__(self) -> Iterator[GridPoint]:
        every = range(self._plan.points) if self._places is None else map(int, self._places)
        for place in every:
            values = self._plan.values_at(place)
            files = [self._digest(values.get(path, name)) for path, name in self._files.items()]
            for engine, base in self._bases.items():
                yield GridPoint(place, values, engine, digest(base, values, files))

    def _digest(self, name: object) -> bytes:
        """Digest a file that a scene names; a missing file raises its error at the point."""
        if not isinstance(name, str):
            return b""
        if name not in self._file_digests:
            file = self._plan.scene.folder / name
            content = b""
            with suppress(UnusableFileError):
                content = hashlib.sha256(read_bounded(file, LARGEST)).digest()
            self._file_digests[name] = content
        return self._file_digests[name]


def simulator_of(engine: str) -> str:
    """Return the name and version of the program on which an engine's results depend."""
    return simulator_name(find_simulator()) if engine == "ngspice" else engine


def plan_sweep(
    scene: str | Path | Scene,
    over: Over,
    engine: str | None,
    *,
    fix: Fixed = (),
    keep_waveforms: bool,
) -> Plan:
    """Return the grid of a sweep; arguments and errors are those of `sweep`."""
    scene = read_scene(scene)
    fixed = fixed_values(scene, fix)
    scene = with_values(scene, fixed) if fixed else scene
    axes, engines = parse_axes(scene, over), engines_of(scene, engine)
    check_axes(axes, fixed)
    hybrid = engine == "hybrid"
    return Plan(scene, axes, engines, keep_waveforms=keep_waveforms, hybrid=hybrid)
