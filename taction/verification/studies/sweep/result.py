"""The result of a sweep: its points as records, how far two engines agree, tables and files."""

from __future__ import annotations

import csv
import importlib.util
import itertools
import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np

from taction.netlist_gen.scene.axes import SweepAxis
from taction.netlist_gen.scene.keys import Value
from taction.netlist_gen.scene.questions import axis_questions
from taction.system.atomic_files import replacing
from taction.system.documents import INLINE, Note, Number
from taction.system.errors import Complaint, InputError
from taction.system.results import Result
from taction.verification.studies.store import Store
from taction.verification.studies.sweep.export_file import check_sweep_export
from taction.verification.studies.sweep.hybrid import (
    BOUNDARY,
    EXTREME,
    SAMPLE,
    compare_point,
    confirmed_points,
)
from taction.verification.studies.sweep.plan import Plan, Requests
from taction.verification.studies.sweep.run import SweepCounts
from taction.verification.verdict.checks import Outcome
from taction.verification.verdict.record import FIGURES, Record

LINES = 20  # points that are listed
WORDS = {
    BOUNDARY: "next to the stability boundary",
    EXTREME: "with an extreme reading",
    SAMPLE: "of the random sample",
}
TEXT_COLUMNS = ("outcome", "failure", "state", "simulator", "reason")
COMPARED = ("agreement", "chosen", "disagreement")  # columns of a sweep by two engines
OUTCOMES = ("pass", "fail", "inconclusive", "error")
BATCH = 5000  # rows in memory at a time
UNITS = {"step": "1", "": "1"}  # the unit of a plain number in the conventions of netCDF


def records(plan: Plan, store: Store) -> Iterator[dict[str, Any]]:
    """Yield the record of every stored point of `plan`, in the order of the grid.

    ``values`` holds the values on the axes by name. A point with results of both engines has
    ``agreement`` (pass, fail or inconclusive), ``difference`` and ``disagreement``, see
    `verification.studies.sweep.hybrid`; a point that a hybrid sweep confirms by ngspice has
    ``chosen``, the reason. The other keys are those of a `Record`.
    """
    return (record for record in all_records(plan, store) if record is not None)


def all_records(plan: Plan, store: Store) -> Iterator[dict[str, Any] | None]:
    """Yield as `records` does, with None for a point that has no result of an engine."""
    names = {axis.key.path: axis.name for axis in plan.axes}
    confirmed = confirmed_points(plan, store) if plan.hybrid else {}
    requests = iter(Requests(plan))
    while points := list(itertools.islice(requests, len(plan.engines))):
        found = {point.engine: store.record_of(point.request) for point in points}
        place, why = points[0].place, None
        if plan.hybrid:
            why = confirmed.get(place)
            found["ngspice"] = found["ngspice"] if place in confirmed else None
        rest = {
            "values": {names[path]: value for path, value in points[0].values.items()},
            "chosen": why,
            **_comparison(*found.values()),
        }
        for engine, record in found.items():
            yield record and {**rest, **record, "engine": engine, "rightmost_pole": _pole(record)}


def _comparison(*found: dict[str, Any] | None) -> dict[str, Any]:
    """Return the comparison of two engines at a point as plain data, None where only one ran."""
    names = ("agreement", "difference", "disagreement")
    if len(found) < 2 or found[0] is None or found[1] is None:
        return dict.fromkeys(names)
    result = compare_point(*(Record.from_plain(each) for each in found))
    return dict(zip(names, (result.outcome.value, result.difference, result.reason), strict=True))


def _pole(record: dict[str, Any]) -> list[float] | None:
    if record["growth_rate"] is None:
        return None
    return [record["growth_rate"], 2.0 * math.pi * record["frequency"]]


@dataclass(frozen=True, slots=True)
class SweepPoint:
    """A point of a sweep on one engine; `values` by the names of the axes."""

    values: dict[str, Value]
    record: Annotated[Record, INLINE]
    rightmost_pole: Annotated[tuple[float, ...] | None, "1/s"]
    chosen: Annotated[str | None, Note("why a hybrid sweep confirms the point by ngspice")]
    agreement: Annotated[Outcome | None, Note("of both engines")]
    difference: Number
    disagreement: str | None


@dataclass(frozen=True, slots=True)
class AgreementSummary:
    """How many points have results of both engines, and how far these agree.

    Attributes
    ----------
    points, agree, disagree, undecided : int
        Points with results of both engines, and how many of them have which agreement.
    chosen : mapping of str to int
        Points that a hybrid sweep confirms, by the reason.
    largest_difference : float or None
        Largest difference of any output at any time and point, divided by the error that the run of
        ngspice was allowed.
    at : dict of str to float, int, str or bool, or None
        The values of that point, by the names of the axes.
    listed : list of dict
        Records of ngspice at points without agreement, disagreements first, at most `LINES`.
    """

    DOCUMENT = (
        *("points", "agree", "disagree", "undecided", "chosen", "largest_difference", "at"),
        "listed = listed_points",
    )

    points: int
    agree: int
    disagree: int
    undecided: int
    chosen: Mapping[str, int]
    largest_difference: float | None
    at: dict[str, Value] | None
    listed: list[dict[str, Any]] = field(repr=False)

    @property
    def listed_points(self) -> list[SweepPoint]:
        """`listed`, which is plain data already."""
        return cast(list[SweepPoint], self.listed)


def summarise(plan: Plan, store: Store) -> AgreementSummary:
    """Return the agreement of the stored points of `plan`."""
    outcomes: Counter[str] = Counter()
    chosen: Counter[str] = Counter()
    listed: dict[str, list[dict[str, Any]]] = {"fail": [], "inconclusive": []}
    largest, at = None, None
    for record in records(plan, store):
        outcome = record["agreement"]
        if outcome is None or record["engine"] != "ngspice":
            continue
        outcomes[outcome] += 1
        if record["chosen"] is not None:
            chosen[record["chosen"]] += 1
        if outcome in listed and len(listed[outcome]) < LINES:
            listed[outcome].append(record)
        difference = record["difference"]
        if difference is not None and (largest is None or difference > largest):
            largest, at = difference, record["values"]
    return AgreementSummary(
        points=outcomes.total(),
        agree=outcomes[Outcome.PASS.value],
        disagree=outcomes[Outcome.FAIL.value],
        undecided=outcomes[Outcome.INCONCLUSIVE.value],
        chosen=dict(chosen),
        largest_difference=largest,
        at=at,
        listed=[*listed["fail"], *listed["inconclusive"]][:LINES],
    )


@dataclass(frozen=True, slots=True)
class GridAxis:
    """An axis of a grid; axes of one `group` change together."""

    DOCUMENT = (
        *("name = axis.name", "key = axis.key.path", "unit = axis.key.unit"),
        *("scale = axis.scale", "group", "values = axis.values"),
    )

    axis: SweepAxis
    group: int


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SweepResult(Result):
    """Every point of a sweep.

    Attributes
    ----------
    plan : Plan
        The grid: the axes, their values, the engines.
    store : Store
        A database in a file or in memory, open as long as the result exists.
    count : SweepCounts
        Numbers of all points, of the points computed now, and of each outcome.
    agreement : AgreementSummary or None
        How far two engines agree; None for a sweep by one engine.
    seconds : float
        Wall time, s.
    strict : bool
        Whether a point that fails makes the outcome fail.
    """

    VIEW = "taction.verification.report.views.sweep:view"
    CARD = "Sweep"
    DOCUMENT = (
        *("scene = plan.scene.name", "file = plan.scene.file", "database", "axes"),
        *("engines = plan.engines", "total = count.total", "done = count.done"),
        *("ran = count.ran", "outcomes", "agreement", "seconds [s]"),
        "notes # what may be a slip in the axes, and the figures that every op-amp keeps",
        *("estimated_seconds [s] = count.estimate", "points"),
    )

    plan: Plan
    store: Store
    count: SweepCounts
    agreement: AgreementSummary | None
    seconds: float = 0.0
    strict: bool = False

    @property
    def database(self) -> str:
        """The file of the store."""
        return self.store.path

    @property
    def axes(self) -> tuple[GridAxis, ...]:
        """The axes, with the groups that change together."""
        return tuple(GridAxis(a, k) for k, group in enumerate(self.plan.groups) for a in group)

    @property
    def notes(self) -> tuple[str, ...]:
        """What may be a slip in the axes, and which figures of the scene every op-amp keeps."""
        scene = self.plan.scene
        return (*scene.written_questions, *axis_questions(scene, self.plan.groups))

    @property
    def outcomes(self) -> dict[str, int]:
        """How many points have each outcome."""
        return dict(self.count.outcomes)

    @property
    def points(self) -> tuple[SweepPoint, ...]:
        """None: they may be many, and `records` yields them one by one."""
        return ()

    @classmethod
    def of(
        cls,
        plan: Plan,
        store: Store,
        count: SweepCounts,
        seconds: float = 0.0,
        *,
        strict: bool = False,
    ) -> SweepResult:
        """Return the result of a sweep that has ended."""
        agreement = summarise(plan, store) if len(plan.engines) > 1 else None
        return cls(plan, store, count, agreement, seconds, strict)

    @property
    def outcome(self) -> str:
        """``fail`` if the engines disagree, or, if `strict`, a point fails.

        ``inconclusive`` if no point has a verdict.
        """
        if self._disagree or (self.strict and self.count.outcomes["fail"]):
            return "fail"
        outcomes = self.count.outcomes
        return "pass" if outcomes["pass"] + outcomes["fail"] else "inconclusive"

    def __repr__(self) -> str:
        plan, counts = self.plan, sorted(self.count.outcomes.items())
        outcomes = ", ".join(f"{number} {name}" for name, number in counts)
        if self._disagree:
            outcomes += f"; the engines disagree at {self._disagree}"
        names = " x ".join(axis.name for axis in plan.axes)
        return f"SweepResult({plan.scene.name!r}, {names}: {plan.total} points, {outcomes})"

    @property
    def _disagree(self) -> int:
        return 0 if self.agreement is None else self.agreement.disagree

    def records(self) -> Iterator[dict[str, Any]]:
        """Yield every point as plain data in SI base units, in the order of the grid."""
        return records(self.plan, self.store)

    def to_pandas(self) -> Any:
        """Return a ``pandas.DataFrame``: a row for each point and engine, a column for each figure.

        Raises
        ------
        InputError
            pandas is not installed.
        """
        _need("pandas")
        import pandas as pd

        return pd.DataFrame(_rows(self), columns=_titles(self.plan))

    def to_xarray(self) -> Any:
        """Return an ``xarray.Dataset``: the axes and the engine are its coordinates.

        Raises
        ------
        InputError
            xarray is not installed.
        """
        _need("xarray")
        return dataset(self)


def _need(package: str) -> None:
    if importlib.util.find_spec(package) is None:
        text = f"needs {package}: pip install 'taction[data]'"
        raise InputError(f"to_{package}", Complaint("package", repr(package), text))


def export_sweep(result: SweepResult, path: str) -> None:
    """Write every point of a sweep to `path`.

    CSV and Parquet have one row for each point and engine; netCDF has one dimension for each group
    of axes and one for the engine, the axes as coordinates, and a unit for every variable.

    Raises
    ------
    InputError
        See `check_sweep_export`; or the file cannot be written.
    """
    check_sweep_export(path)
    with replacing(path) as temporary:
        WRITERS[Path(path).suffix.lower()](result, temporary)


def _numbers(plan: Plan) -> dict[str, str]:
    """Return the units of the numbers by name, without figures that are an axis, such as lambda."""
    names = {axis.name for axis in plan.axes}
    units = {name: figure.unit for name, figure in FIGURES.items() if name not in names}
    return units | ({"difference": ""} if len(plan.engines) > 1 else {})


def _text_columns(plan: Plan) -> tuple[str, ...]:
    return TEXT_COLUMNS + (COMPARED if len(plan.engines) > 1 else ())


def _titles(plan: Plan) -> list[str]:
    names = (axis.name for axis in plan.axes)
    return [*names, "engine", "stable", *_numbers(plan), *_text_columns(plan)]


def _rows(result: SweepResult) -> Iterator[dict[str, Any]]:
    kept = _titles(result.plan)[len(result.plan.axes) :]
    for record in result.records():
        yield record["values"] | {name: record[name] for name in kept}


def _csv(result: SweepResult, path: Path) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(_titles(result.plan))
        for row in _rows(result):
            writer.writerow(
                repr(v) if isinstance(v, float) else "" if v is None else v for v in row.values()
            )


def _parquet(result: SweepResult, path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    plan = result.plan
    kinds = {"real": pa.float64(), "integer": pa.int64(), "choice": pa.string()}

    def column(name: str, kind: Any, unit: str) -> Any:
        return pa.field(name, kind, metadata={"unit": unit} if unit else None)

    schema = pa.schema(
        [
            *(column(axis.name, kinds[axis.key.kind], axis.key.unit) for axis in plan.axes),
            column("engine", pa.string(), ""),
            column("stable", pa.bool_(), ""),
            *(column(name, pa.float64(), unit) for name, unit in _numbers(plan).items()),
            *(column(name, pa.string(), "") for name in _text_columns(plan)),
        ]
    )
    choices = [axis.name for axis in plan.axes if axis.key.kind == "choice"]
    with pq.ParquetWriter(path, schema) as writer:
        rows = _rows(result)
        while batch := list(itertools.islice(rows, BATCH)):
            for row in batch:
                row.update({name: str(row[name]) for name in choices})
            writer.write_table(pa.Table.from_pylist(batch, schema=schema))


def grids(result: SweepResult) -> dict[str, np.ndarray[Any, Any]]:
    """Return the numbers of a sweep as arrays over the grid, the engine last.

    Every name of `FIGURES`, and ``difference`` for two engines (NaN for a missing number);
    ``outcome`` and ``agreement``, places in `OUTCOMES` (-1 for a point without this engine, or
    without both). Shape ``(*plan.shape, len(plan.engines))``.
    """
    plan = result.plan
    shape = (*plan.shape, len(plan.engines))
    arrays = {name: np.full(shape, np.nan) for name in {**FIGURES, **_numbers(plan)}}
    words = {name: np.full(shape, -1, dtype=np.int8) for name in ("outcome", "agreement")}
    for place, record in zip(np.ndindex(*shape), all_records(plan, result.store), strict=True):
        if record is None:
            continue
        for name, codes in words.items():
            if record[name] is not None:
                codes[place] = OUTCOMES.index(record[name])
        for name, array in arrays.items():
            if record[name] is not None:
                array[place] = record[name]
    return arrays | words


def dataset(result: SweepResult) -> Any:
    """Return the grid as an xarray Dataset: the dimensions of netCDF."""
    import xarray as xr

    plan = result.plan
    dimensions = [group[0].name for group in plan.groups]
    coordinates: dict[str, Any] = {"engine": ("engine", list(plan.engines))}
    for group, dimension in zip(plan.groups, dimensions, strict=True):
        for axis in group:
            values = axis.values if axis.key.kind != "choice" else [str(v) for v in axis.values]
            about = {"long_name": axis.key.path, "units": axis.key.unit or "1"}
            coordinates[axis.name] = (dimension, list(values), about)
    everything = (*dimensions, "engine")
    arrays = grids(result)
    variables: dict[str, Any] = {
        name: (everything, arrays[name], {"units": UNITS.get(unit, unit)})
        for name, unit in _numbers(plan).items()
    }
    flags = {
        "flag_values": np.arange(len(OUTCOMES), dtype=np.int8),
        "flag_meanings": " ".join(OUTCOMES),
    }
    for name in ("outcome", "agreement") if len(plan.engines) > 1 else ("outcome",):
        variables[name] = (everything, arrays[name], flags)
    about = {"scene": plan.scene.name, "Conventions": "CF-1.8", "source": "taction sweep"}
    return xr.Dataset(variables, coordinates, about)


def _netcdf(result: SweepResult, path: Path) -> None:
    dataset(result).to_netcdf(path, engine="scipy", format="NETCDF3_64BIT")


WRITERS: dict[str, Callable[[SweepResult, Path], None]] = {
    ".csv": _csv,
    ".parquet": _parquet,
    ".nc": _netcdf,
}
