"""The grid of a sweep: what it asks for, and a request that stands for each point of it."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from netlist_gen.overrides.axes import Axis, points
from netlist_gen.overrides.keys import Value
from netlist_gen.scene.scene import Scene
from spice_models.errors import Complaint, InputError
from verification.engines.ngspice.executable import find_simulator
from verification.pipeline.simulation import choose_engine
from verification.studies.running.digests import digest, files_of, own_code
from verification.studies.running.versions import simulator_name

ENGINE = "analysis.engine"
MOST = 1_000_000  # points of one sweep


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """What a sweep is to find out.

    Attributes
    ----------
    scene : Scene
        The scene whose values change.
    groups : sequence of sequences of Axis
        They span a grid; the axes of one group change together.
    engines : tuple of str
        ``"ngspice"``, ``"statespace"`` or both.
    second_look : bool
        As `verification.verify.verify` has it.
    keep_waveforms : bool
        Store the outputs over time.

    Raises
    ------
    InputError
        An axis that changes the engine, or more than `MOST` points.
    """

    scene: Scene
    groups: Sequence[Sequence[Axis]]
    engines: tuple[str, ...]
    second_look: bool = True
    keep_waveforms: bool = False

    def __post_init__(self) -> None:
        if any(axis.key.path == ENGINE for axis in self.axes):
            raise InputError("--over", Complaint(ENGINE, "", "give --engine both instead"))
        if self.total > MOST:
            text = f"at most {MOST} points in one sweep"
            raise InputError("--over", Complaint("points", repr(self.total), text))

    @property
    def axes(self) -> tuple[Axis, ...]:
        """All axes, in the order of the grid."""
        return tuple(axis for group in self.groups for axis in group)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values of each group."""
        return tuple(len(group[0]) for group in self.groups)

    @property
    def total(self) -> int:
        """Number of points, each engine counted."""
        return len(self.engines) * math.prod(self.shape)


def engines_of(scene: Scene, engine: str | None) -> tuple[str, ...]:
    """Return the engines of a sweep: the scene's own, the one asked for, or ``"both"``.

    Raises
    ------
    InputError
        There is no such engine.
    """
    if engine == "both":
        return ("ngspice", "statespace")
    return (choose_engine(scene if engine is None else scene.with_engine(engine)),)


@dataclass(frozen=True, slots=True)
class Point:
    """One point of the grid for one engine; `request` stands for all of it in the store."""

    values: dict[str, Value]
    engine: str
    request: bytes


class Requests:
    """The points of a plan, in the order of the grid, each with its engines.

    Raises
    ------
    SimulatorNotFound, SimulatorTooOld
        ngspice is asked for and there is none that will do.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._digests: dict[str, bytes] = {}
        scene = plan.scene.model_dump(by_alias=True, exclude={"name", "regression", "analysis"})
        analysis = plan.scene.analysis.model_dump(exclude={"engine", "timeout"})
        base = digest(own_code(), scene, analysis, plan.second_look)
        self._bases = {
            engine: digest(base, simulator_of(engine), engine) for engine in plan.engines
        }
        self._files = files_of(plan.scene)

    def __iter__(self) -> Iterator[Point]:
        for values in points(self._plan.groups):
            files = [self._digest(values.get(path, own)) for path, own in self._files.items()]
            for engine, base in self._bases.items():
                yield Point(values, engine, digest(base, values, files))

    def _digest(self, name: object) -> bytes:
        """Digest the content of a file that a scene names; a missing one fails at its point."""
        if not isinstance(name, str):
            return b""
        if name not in self._digests:
            file = self._plan.scene.folder / name
            found = hashlib.sha256(file.read_bytes()).digest() if file.is_file() else b""
            self._digests[name] = found
        return self._digests[name]


def simulator_of(engine: str) -> str:
    """Name what an engine's results depend on beside the circuit."""
    return simulator_name(find_simulator()) if engine == "ngspice" else engine
