"""Read ngspice's binary raw files through a memory map, and write them.

Only unpadded vectors in double precision are accepted, real or complex as they were asked for. Any
other content (text, more plots, too few bytes) is refused with a message that names the reason,
because a reader that guesses turns a truncated file into a plausible waveform.
"""

from __future__ import annotations

import mmap
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taction.system.errors import BadEvidence, OutOfDisk
from taction.system.foreign_files import UnusableFileError, open_regular
from taction.system.waveforms import Waveforms

KINDS = {"real": np.dtype("<f8"), "complex": np.dtype("<c16")}
DOUBLE = KINDS["real"]
_LONGEST_HEADER = 1 << 24
_LONGEST_START = 1 << 20  # bytes that are read of a file that is still written
_MOST_DIGITS = 18  # of a count
_END = b"\nBinary:\n"  # of the header
_BEGIN = b"Title:"  # of a plot


@dataclass(frozen=True, slots=True, eq=False)
class Plot:
    """One plot of a raw file.

    `name` is ``"Transient Analysis"``, ``"Operating Point"`` and so on; `vectors` are in lower
    case, ``time`` and ``v(node)``; `promised` is the number of points in the header, 0 after an
    interrupted run. `data` (P, K), real or complex, is a read-only map of the file with one column
    for each vector. The map stays valid after the file is deleted; it is not aligned to 8 bytes,
    since the header has any length: copy it before computations.
    """

    title: str
    name: str
    vectors: tuple[str, ...]
    promised: int
    data: NDArray[Any]


@dataclass(frozen=True, slots=True)
class _Header:
    fields: dict[str, str]
    vectors: tuple[str, ...]
    size: int  # bytes of the file up to the end of the header
    kind: np.dtype[Any]

    @property
    def width(self) -> int:
        """Bytes of one point."""
        return len(self.vectors) * self.kind.itemsize


def read_raw(path: Path, *, partial: bool = False, flags: str = "real") -> Plot:
    """Map the one plot of a raw file.

    Parameters
    ----------
    path : Path
        A binary raw file.
    partial : bool
        True for the file of an interrupted run: the header's number of points (0 until ngspice
        has finished) is ignored, and every complete point on the disk is read.
    flags : str
        ``"real"`` or ``"complex"``, as the plot must be.

    Raises
    ------
    BadEvidence
        The file does not exist, is not a raw file, has text or padded values or those of another
        kind, several plots or no points.
    OutOfDisk
        The file was not written to its end: its header is cut, or lacks the number of points, or
        there are fewer bytes than its values take.
    """
    plots = read_plots(path, partial=partial, flags=(flags,))
    if len(plots) > 1:
        raise BadEvidence(f"{path.name} holds several plots; a deck may have one analysis")
    return plots[0]


def read_plots(
    path: Path, *, partial: bool = False, flags: tuple[str, ...] = ("real",)
) -> list[Plot]:
    """Map all plots of a raw file, in the order of the file, of the kinds `flags`.

    `partial` and the errors are those of `read_raw`; a partial plot is the file's only one.
    """
    content, start, plots = _map(path), 0, list[Plot]()
    while start < len(content) or not plots:
        header = _read_header(content, path, start, flags)
        promised = _number(header.fields, "no. points", path)
        points = (len(content) - header.size) // header.width if partial else promised
        size = points * header.width
        if not partial:
            _check_size(path, content, header.size, size)
        data = np.frombuffer(content, header.kind, size // header.kind.itemsize, header.size)
        title, name = (header.fields.get(key, "") for key in ("title", "plotname"))
        table = data.reshape(points, len(header.vectors))
        plots.append(Plot(title, name, header.vectors, promised, table))
        start = len(content) if partial else header.size + size
    return plots


def last_instant(path: Path) -> float | None:
    """Return the first value of the last whole point of a file that ngspice still writes, or None.

    No memory map: the writer may cut the file at any time.
    """
    try:
        with open_regular(path) as file:
            header = _read_header(file.read(_LONGEST_START), path)
            points = (os.fstat(file.fileno()).st_size - header.size) // header.width
            if points < 1:
                return None
            file.seek(header.size + (points - 1) * header.width)
            return float(np.frombuffer(file.read(DOUBLE.itemsize), DOUBLE)[0])
    except (BadEvidence, OutOfDisk, UnusableFileError, OSError, ValueError):
        return None


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
        "Binary:",
    ]
    data = np.empty((points, count + 1), dtype=DOUBLE)
    data[:, 0], data[:, 1:] = waveforms.time, waveforms.values
    with path.open("wb") as stream:
        stream.write(("\n".join(lines) + "\n").encode())
        stream.write(data.data)


def _map(path: Path) -> mmap.mmap | bytes:
    """Map the file's content; an empty file cannot be mapped and has no content."""
    try:
        with open_regular(path) as file:
            size = os.fstat(file.fileno()).st_size
            return mmap.mmap(file.fileno(), size, access=mmap.ACCESS_READ) if size else b""
    except UnusableFileError as error:
        raise BadEvidence(f"{path.name} was never written: {error}") from None


def _read_header(
    content: mmap.mmap | bytes, path: Path, start: int = 0, flags: tuple[str, ...] = ("real",)
) -> _Header:
    """Read the header that begins at `start`, including the ``Binary:`` line."""
    end = content.find(_END, start, start + _LONGEST_HEADER)
    fields: dict[str, str] = {}
    vectors: list[str] = []
    last = end if end >= 0 else start + _LONGEST_HEADER
    head = content[start:last].decode("utf-8", "replace")
    if end < 0 and "\n" in head:
        head = head[: head.rindex("\n")]  # the last line may be cut, too
    for text in head.removesuffix("\n").split("\n") if head else ():
        if text.startswith("\t"):
            columns = text.split()
            if len(columns) < 3 or columns[0] != str(len(vectors)):
                raise BadEvidence(f"{path.name}: bad vector line {text.strip()!r}")
            vectors.append(columns[1])
            continue
        key, colon, value = text.partition(":")
        if not colon:
            raise BadEvidence(f"{path.name}: not a raw file; found {text[:60]!r} in its header")
        if key == "Values":
            raise BadEvidence(f"{path.name}: values are text; a binary raw file is needed")
        fields[key.lower()] = value.strip()
    if end < 0:
        raise _cut(f"{path.name}: the header has no end ({len(vectors)} vectors were named)")
    found = fields.get("flags", "").lower()
    if found not in flags:
        raise BadEvidence(
            f"{path.name}: flags are {found or 'missing'!r}; only"
            f" {' or '.join(map(repr, flags))} is read (no padded vectors)"
        )
    count = _number(fields, "no. variables", path)
    if count != len(vectors) or count == 0:
        raise BadEvidence(
            f"{path.name}: {count} vectors are announced and {len(vectors)} are named"
        )
    return _Header(fields, tuple(vectors), end + len(_END), KINDS[found])


def _number(fields: dict[str, str], key: str, path: Path) -> int:
    value = fields.get(key, "")
    if not value.isdecimal() or len(value) > _MOST_DIGITS:
        raise BadEvidence(f"{path.name}: {key!r} is {value[:60]!r}; a count is needed")
    return int(value)


def _check_size(path: Path, content: mmap.mmap | bytes, start: int, expected: int) -> None:
    """Compare the number of bytes after `start` with `expected`; another plot may follow."""
    size, end = len(content) - start, start + expected
    another = content[end : end + len(_BEGIN)] == _BEGIN
    if size < expected:
        raise _cut(f"{path.name} holds {size} of {expected} bytes")
    if size > expected == 0 and not another:
        raise _cut(f"{path.name} holds {size} bytes of values, but their number was never written")
    if size > expected and not another:
        raise BadEvidence(
            f"{path.name} holds {size} bytes of values, but its header says {expected}"
        )
    if expected == 0:
        raise BadEvidence(f"{path.name} holds no points")


def _cut(found: str) -> OutOfDisk:
    return OutOfDisk(
        f"{found}: it could not be written in full. Free space where runs are kept (TMPDIR), or"
        " save fewer nodes"
    )
