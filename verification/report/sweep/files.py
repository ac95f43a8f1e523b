"""Write a sweep to CSV, Parquet or netCDF, by the ending of the file; SI base units."""

from __future__ import annotations

import csv
import itertools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from taction.system.atomic_files import replacing
from taction.verification.report.output_checks import check_file
from taction.verification.report.sweep.records import all_records, records
from taction.verification.studies.store import Store
from taction.verification.studies.sweep.plan import Plan
from taction.verification.verdict.record import FIGURES

PACKAGES = {  # by ending: the package and how to install it
    ".parquet": ("pyarrow", "Parquet needs pyarrow: pip install 'taction[parquet]'"),
    ".nc": ("xarray", "netCDF needs xarray: pip install 'taction[netcdf]'"),
}
TEXT_COLUMNS = ("outcome", "failure", "state", "simulator", "reason")
COMPARED = ("agreement", "chosen", "disagreement")  # columns of a sweep by two engines
OUTCOMES = ("pass", "fail", "inconclusive", "error")
BATCH = 5000  # rows in memory at a time
UNITS = {"step": "1", "": "1"}  # the unit of a plain number in the conventions of netCDF


def check_sweep_export(path: str) -> None:
    """Refuse a file that could not be written, before any work is done.

    Raises
    ------
    InputError
        An unknown ending, a missing folder, or a package that is not installed.
    """
    check_file(path, "--export", WRITERS, PACKAGES)


def export_sweep(plan: Plan, store: Store, path: str) -> None:
    """Write every stored point of `plan` to `path`.

    CSV and Parquet have one row for each point and engine; netCDF has one dimension for each group
    of axes and one for the engine, the axes as coordinates, and a unit for every variable.

    Raises
    ------
    InputError
        See `check_sweep_export`; or the file cannot be written.
    """
    check_sweep_export(path)
    with replacing(path) as temporary:
        WRITERS[Path(path).suffix.lower()](plan, store, temporary)


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


def _rows(plan: Plan, store: Store) -> Iterator[dict[str, Any]]:
    kept = _titles(plan)[len(plan.axes) :]
    for record in records(plan, store):
        yield record["values"] | {name: record[name] for name in kept}


def _csv(plan: Plan, store: Store, path: Path) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(_titles(plan))
        for row in _rows(plan, store):
            writer.writerow(
                repr(v) if isinstance(v, float) else "" if v is None else v for v in row.values()
            )


def _parquet(plan: Plan, store: Store, path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

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
        rows = _rows(plan, store)
        while batch := list(itertools.islice(rows, BATCH)):
            for row in batch:
                row.update({name: str(row[name]) for name in choices})
            writer.write_table(pa.Table.from_pylist(batch, schema=schema))


def grids(plan: Plan, store: Store) -> dict[str, np.ndarray[Any, Any]]:
    """Return the numbers of a sweep as arrays over the grid, the engine last.

    Every name of `FIGURES`, and ``difference`` for two engines (NaN for a missing number);
    ``outcome`` and ``agreement``, places in `OUTCOMES` (-1 for a point without this engine, or
    without both). Shape ``(*plan.shape, len(plan.engines))``.
    """
    shape = (*plan.shape, len(plan.engines))
    arrays = {name: np.full(shape, np.nan) for name in {**FIGURES, **_numbers(plan)}}
    words = {name: np.full(shape, -1, dtype=np.int8) for name in ("outcome", "agreement")}
    for place, record in zip(np.ndindex(*shape), all_records(plan, store), strict=True):
        if record is None:
            continue
        for name, codes in words.items():
            if record[name] is not None:
                codes[place] = OUTCOMES.index(record[name])
        for name, array in arrays.items():
            if record[name] is not None:
                array[place] = record[name]
    return arrays | words


def frame(plan: Plan, store: Store) -> Any:
    """Return the stored points as a pandas DataFrame: the rows of a CSV file."""
    import pandas as pd

    return pd.DataFrame(_rows(plan, store), columns=_titles(plan))


def dataset(plan: Plan, store: Store) -> Any:
    """Return the grid as an xarray Dataset: the dimensions of netCDF."""
    import xarray as xr

    dimensions = [group[0].name for group in plan.groups]
    coordinates: dict[str, Any] = {"engine": ("engine", list(plan.engines))}
    for group, dimension in zip(plan.groups, dimensions, strict=True):
        for axis in group:
            values = axis.values if axis.key.kind != "choice" else [str(v) for v in axis.values]
            about = {"long_name": axis.key.path, "units": axis.key.unit or "1"}
            coordinates[axis.name] = (dimension, list(values), about)
    everything = (*dimensions, "engine")
    arrays = grids(plan, store)
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


def _netcdf(plan: Plan, store: Store, path: Path) -> None:
    dataset(plan, store).to_netcdf(path, engine="scipy", format="NETCDF3_64BIT")


WRITERS: dict[str, Callable[[Plan, Store, Path], None]] = {
    ".csv": _csv,
    ".parquet": _parquet,
    ".nc": _netcdf,
}
