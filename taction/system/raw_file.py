"""Raw files: ngspice's binary ones, read through a memory map and written, and those of others.

Only unpadded vectors in double precision are accepted, real or complex as they were asked for. Any
other content (text, more plots, too few bytes) is refused with a message that names the reason,
because a reader that guesses turns a truncated file into a plausible waveform.

Waveforms of LTspice, whose header is in UTF-16, are read by spicelib.
"""

from __future__ import annotations

import mmap
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taction.system.array_types import Cost, Floats, Waveforms
from taction.system.errors import BadEvidence, Complaint, InputError, OutOfDisk
from taction.system.foreign_files import MEGABYTE, UnusableFileError, open_regular
from taction.system.output_files import check_extra

KINDS = {"real": np.dtype("<f8"), "complex": np.dtype("<c16")}
_LONGEST_HEADER = 1 << 24
_END = b"\nBinary:\n"  # of the header
_BEGIN = b"Title:"  # of a plot


@dataclass(frozen=True, slots=True, eq=False)
class Plot:
    """One plot of a raw file.

    `name` is ``"Transient Analysis"``, ``"Operating Point"`` and so on; `vectors` are in lower
    case, ``time`` and ``v(node)``. `data` (P, K), real or complex, is a read-only map of the file
    with one column for each vector. The map stays valid after the file is deleted; it is not
    aligned to 8 bytes, since the header has any length: copy it before computations.
    """

    name: str
    vectors: tuple[str, ...]
    data: NDArray[Any]


def read_raw(path: Path, *, partial: bool = False) -> Plot:
    """Map the one plot of a raw file; errors as of `read_plots`, or several plots."""
    plots = read_plots(path, partial=partial)
    if len(plots) > 1:
        raise BadEvidence(f"{path.name} holds several plots; a deck may have one analysis")
    return plots[0]


def read_plots(
    path: Path, *, partial: bool = False, flags: tuple[str, ...] = ("real",)
) -> list[Plot]:
    """Map all plots of a raw file, in the order of the file, of the kinds `flags`.

    `partial`: true for the file of an interrupted run: the header's number of points (0 until
      ngspice has finished) is ignored, and every complete point of the one plot is read.
    BadEvidence: the file does not exist, is not a raw file, has text or padded values or those of
      another kind, or no points.
    OutOfDisk: the file was not written to its end: its header is cut, or lacks the number of
      points, or there are fewer bytes than its values take.
    """
    try:
        with open_regular(path) as file:
            length = os.fstat(file.fileno()).st_size  # an empty file cannot be mapped
            content = mmap.mmap(file.fileno(), length, access=mmap.ACCESS_READ) if length else b""
    except UnusableFileError as error:
        raise BadEvidence(f"{path.name} was never written: {error}") from None
    start, plots = 0, list[Plot]()
    try:
        while start < length or not plots:
            fields, vectors, begin = _header(content, start)
            flag = fields.get("flags", "").lower()
            if flag not in flags:
                only = " or ".join(map(repr, flags))
                raise BadEvidence(
                    f"flags are {flag or 'missing'!r}; only {only} is read (no padded vectors)"
                )
            kind, promised = KINDS[flag], _count(fields, "no. points")
            width, left = len(vectors) * kind.itemsize, length - begin
            points = left // width if partial else promised
            if not partial:
                _check_size(content, begin, points * width)
            data = np.frombuffer(content, kind, points * len(vectors), begin)
            table = data.reshape(points, len(vectors))
            plots.append(Plot(fields.get("plotname", ""), vectors, table))
            start = length if partial else begin + points * width
    except (BadEvidence, OutOfDisk) as error:
        raise type(error)(f"{path.name}: {error}") from None
    return plots


def _header(content: mmap.mmap | bytes, start: int) -> tuple[dict[str, str], tuple[str, ...], int]:
    """Return the fields and vectors of the header that begins at `start`, and where it ends."""
    end = content.find(_END, start, start + _LONGEST_HEADER)
    last = end if end >= 0 else start + _LONGEST_HEADER
    head = content[start:last].decode("utf-8", "replace").removesuffix("\n")
    fields, vectors = dict[str, str](), list[str]()
    lines = head.split("\n")
    for line in lines if end >= 0 else lines[:-1] or [""]:  # the last line may be cut, too
        key, colon, value = line.partition(":")
        if line.startswith("\t"):
            columns = line.split()
            if len(columns) < 3 or columns[0] != str(len(vectors)):
                raise BadEvidence(f"bad vector line {line.strip()!r}")
            vectors.append(columns[1])
        elif colon and key == "Values":
            raise BadEvidence("values are text; a binary raw file is needed")
        elif colon:
            fields[key.lower()] = value.strip()
        elif line:
            raise BadEvidence(f"not a raw file; found {line[:60]!r} in its header")
    if end < 0:
        raise _cut(f"the header has no end ({len(vectors)} vectors were named)")
    count = _count(fields, "no. variables")
    if count != len(vectors) or count == 0:
        raise BadEvidence(f"{count} vectors are announced and {len(vectors)} are named")
    return fields, tuple(vectors), end + len(_END)


def _count(fields: dict[str, str], key: str) -> int:
    value = fields.get(key, "")
    if not re.fullmatch("[0-9]{1,18}", value):
        raise BadEvidence(f"{key!r} is {value[:60]!r}; a count is needed")
    return int(value)


def _check_size(content: mmap.mmap | bytes, start: int, expected: int) -> None:
    """Compare the number of bytes after `start` with `expected`; another plot may follow."""
    size, end = len(content) - start, start + expected
    another = content[end : end + len(_BEGIN)] == _BEGIN
    if size < expected:
        raise _cut(f"holds {size} of {expected} bytes")
    if size > expected == 0 and not another:
        raise _cut(f"holds {size} bytes of values, but their number was never written")
    if size > expected and not another:
        raise BadEvidence(f"holds {size} bytes of values, but its header says {expected}")
    if expected == 0:
        raise BadEvidence("holds no points")


def _cut(found: str) -> OutOfDisk:
    remedy = "Free space where runs are kept (TMPDIR), or save fewer nodes"
    return OutOfDisk(f"{found}: it could not be written in full. {remedy}")


def write_raw(path: Path, waveforms: Waveforms, title: str = "taction") -> None:
    """Write `waveforms` as a binary raw file that ngspice's ``load`` and waveform viewers read.

    The same waveforms give the same bytes: no date is written.
    """
    points, count = waveforms.values.shape
    names = [("time", "time"), *((f"v({node})", "voltage") for node in waveforms.nodes)]
    lines = [
        f"Title: {title}",
        "Plotname: Transient Analysis",
        "Flags: real",
        f"No. Variables: {count + 1}",
        f"No. Points: {points}",
        "Variables:",
        *(f"\t{index}\t{name}\t{kind}" for index, (name, kind) in enumerate(names)),
    ]
    data = np.column_stack([waveforms.time, waveforms.values]).astype(KINDS["real"], order="C")
    with path.open("wb") as stream:
        stream.write("\n".join(lines).encode() + _END)
        stream.write(data.data)


LARGEST = 512 * MEGABYTE
HEADER = 4096  # bytes in which the form shows
LEAST = 2  # instants of a transient
TRANSIENT = "transient"  # begins the name of the plot, in every dialect
ACCEPTED = (
    "expected the binary raw file of one transient, as LTspice or `ngspice -b -r FILE` writes it"
)


def read_transient(file: str | Path) -> Waveforms:
    """Read the node voltages of the one transient of a raw file, by names in lower case."""
    path = Path(file)
    try:
        vectors, table = _columns(path)
        if vectors[:1] != ["time"]:
            raise UnusableFileError("the axis is no time")
        places = [k for k, name in enumerate(vectors) if name.startswith("v(")]
        if not places:
            raise UnusableFileError("the file has no node voltage, such as v(out)")
        if not np.isfinite(table).all():
            raise UnusableFileError("a value is not finite")
        steps = np.diff(table[:, 0])
        if (steps < 0.0).any():
            raise UnusableFileError("time decreases: several runs in one file")
        table = table[np.append(steps > 0.0, True)]  # of equal instants the one after a jump
        if len(table) < LEAST:
            raise UnusableFileError(f"fewer than {LEAST} instants")
    except (UnusableFileError, BadEvidence, OutOfDisk) as error:
        raise InputError(path, Complaint("raw file", "", f"{error}; {ACCEPTED}")) from None
    nodes = tuple(vectors[k][2:-1] for k in places)
    return Waveforms(table[:, 0], nodes, table[:, places], path.name, Cost(0.0, len(table)))


def _columns(path: Path) -> tuple[list[str], Floats]:
    """Return the vectors and their values, the axis first."""
    with open_regular(path) as file:
        head, size = file.read(HEADER), file.seek(0, 2)
    if size > LARGEST:
        raise UnusableFileError(f"over {LARGEST / MEGABYTE:g} MB, the largest size that is read")
    if head.startswith(_BEGIN):
        plots = [p for p in read_plots(path) if p.name.lower().startswith(TRANSIENT)]
        if len(plots) != 1:
            raise UnusableFileError(f"it has {len(plots)} transients")
        return [name.lower() for name in plots[0].vectors], np.array(plots[0].data)
    if not head.decode("utf-16-le", "replace").lstrip("\ufeff").startswith("Title:"):
        raise UnusableFileError("it does not begin with 'Title:'")
    check_extra("raw", str(path))
    from spicelib import RawRead

    try:
        found = RawRead(path, "*", "ltspice", verbose=False)
        traced = [p for p in found.plots if p.get_plot_name().lower().startswith(TRANSIENT)]
        if len(traced) != 1:
            raise UnusableFileError(f"it has {len(traced)} transients")
        names = traced[0].get_trace_names()
        columns = [np.abs(traced[0].get_axis()), *(traced[0].get_wave(name) for name in names[1:])]
        promised = int(traced[0].get_raw_property("No. Points"))
    except UnusableFileError:
        raise
    except Exception as error:
        raise UnusableFileError(f"spicelib does not read it: {error}") from None
    if {len(column) for column in columns} != {promised}:
        raise UnusableFileError(f"it has fewer points than the {promised} of its header")
    return [name.lower() for name in names], np.column_stack(columns).astype(float)
