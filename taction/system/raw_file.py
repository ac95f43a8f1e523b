"""Raw files: ngspice's binary ones, read through a memory map and written, and those of others.

Only unpadded vectors in double precision are accepted, real or complex as they were asked for. Any
other content (text, more plots, too few bytes) is refused with a message that names the reason,
because a reader that guesses turns a truncated file into a plausible waveform.

Of waveforms that LTspice, Xyce or QSPICE stored, raw files in text, and those with single precision
or a header in UTF-16, are read by spicelib.
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

from taction.system.array_types import Floats
from taction.system.errors import BadEvidence, Complaint, InputError, OutOfDisk
from taction.system.foreign_files import MEGABYTE, UnusableFileError, open_regular
from taction.system.waveforms import Cost, Waveforms

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

    `path`: a binary raw file.
    `partial`: true for the file of an interrupted run: the header's number of points (0 until
      ngspice has finished) is ignored, and every complete point on the disk is read.
    `flags`: ``"real"`` or ``"complex"``, as the plot must be.
    BadEvidence: the file does not exist, is not a raw file, has text or padded values or those of
      another kind, several plots or no points.
    OutOfDisk: the file was not written to its end: its header is cut, or lacks the number of
      points, or there are fewer bytes than its values take.
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


LARGEST = 512 * MEGABYTE
HEADER = 65_536  # bytes in which the form shows
LEAST = 2  # instants of a transient
DIALECTS = ("ltspice", "qspice", "xyce", "ngspice")
TRANSIENT = "transient"  # begins the name of the plot, in every dialect
PACKAGE = "this form of raw file needs spicelib: pip install 'taction[raw]'"
ACCEPTED = "expected the raw file of one transient, as `ngspice -b -r FILE` writes it"


def read_transient(file: str | Path) -> Waveforms:
    """Read the node voltages of the one transient of a raw file, by names in lower case."""
    path = Path(file)
    try:
        vectors, table = _columns(path)
    except (UnusableFileError, BadEvidence, OutOfDisk) as error:
        raise _refused(path, "", f"{error}; {ACCEPTED}") from None
    if vectors[:1] != ["time"]:
        raise _refused(
            path, repr(vectors[0] if vectors else ""), f"the axis is no time; {ACCEPTED}"
        )
    places = [k for k, name in enumerate(vectors) if name.startswith("v(")]
    if not places:
        raise _refused(path, "", "the file has no node voltage, such as v(out)")
    time = table[:, 0]
    if not np.isfinite(table).all():
        raise _refused(path, "", "a value is not finite")
    if (np.diff(time) < 0.0).any():
        raise _refused(path, "", f"time decreases: several runs in one file; {ACCEPTED}")
    last = np.append(np.diff(time) > 0.0, True)  # of equal instants: after a jump
    if int(last.sum()) < LEAST:
        raise _refused(path, "", f"fewer than {LEAST} instants; {ACCEPTED}")
    values = table[last][:, places]
    return Waveforms(
        time[last],
        tuple(vectors[k][2:-1] for k in places),
        values,
        path.name,
        Cost(0.0, int(last.sum())),
    )


def _refused(path: Path, value: str, text: str) -> InputError:
    return InputError(path, Complaint("raw file", value, text))


def _columns(path: Path) -> tuple[list[str], Floats]:
    """Return the vectors and their values, the axis first."""
    with open_regular(path) as file:
        head = file.read(HEADER)
        size = file.seek(0, 2)
        if size > LARGEST:
            raise UnusableFileError(
                f"over {LARGEST / MEGABYTE:g} MB, the largest size that is read"
            )
        file.seek(max(size - 1, 0))
        ended = file.read(1) == b"\n"
    narrow = head.startswith(b"Title:")
    header = head.decode("latin-1" if narrow else "utf-16-le", "replace")
    if not header.lstrip("\ufeff").startswith("Title:"):
        raise UnusableFileError("it does not begin with 'Title:'")
    if narrow and "\nBinary:\n" in header and " forward" not in header.partition("Binary:")[0]:
        found = [p for p in read_plots(path) if p.name.lower().startswith(TRANSIENT)]
        if len(found) != 1:
            raise UnusableFileError(f"it has {len(found)} transients")
        return list(found[0].vectors), np.array(found[0].data)
    if narrow and "\nValues:" in header and not ended:
        raise UnusableFileError("its last line is cut off")
    command = "".join(re.findall(r"^Command:(.*)$", header, re.M)).lower()
    named = (name for name in DIALECTS if name in command)
    return _by_spicelib(path, next(named, "ngspice" if narrow else "ltspice"))


def _by_spicelib(path: Path, dialect: str) -> tuple[list[str], Floats]:
    try:
        from spicelib import RawRead
    except ImportError:
        raise InputError(path, Complaint("raw file", "", PACKAGE)) from None
    try:
        found = RawRead(path, "*", dialect, verbose=False)
        plots = [p for p in found.plots if p.get_plot_name().lower().startswith(TRANSIENT)]
        if len(plots) != 1:
            raise UnusableFileError(f"it has {len(plots)} transients")
        names = plots[0].get_trace_names()
        columns = [np.abs(plots[0].get_axis()), *(plots[0].get_wave(name) for name in names[1:])]
        promised = int(plots[0].get_raw_property("No. Points"))
    except UnusableFileError:
        raise
    except Exception as error:
        raise UnusableFileError(f"spicelib does not read it: {error}") from None
    if {len(column) for column in columns} != {promised}:
        raise UnusableFileError(f"it has fewer points than the {promised} of its header")
    return [name.lower() for name in names], np.column_stack(columns).astype(float)
