"""ngspice's binary raw files, read through a memory map and written.

Only what one batch run writes is accepted: one plot of real, unpadded double-precision vectors.
Anything else (text, complex, several plots, fewer bytes than promised) is refused by name,
because a reader that guesses turns a truncated file into a plausible waveform.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from spice_models.errors import BadEvidence, OutOfDisk
from verification.waveforms import Floats, Waveforms

DOUBLE = np.dtype("<f8")
_LONGEST_LINE = 65536


@dataclass(frozen=True, slots=True, eq=False)
class Plot:
    """One plot of a raw file.

    Attributes
    ----------
    title, name : str
        The deck's title line; ``"Transient Analysis"``, ``"Operating Point"`` and so on.
    vectors : tuple of str
        As ngspice spells them, in lower case: ``time``, ``v(node)``.
    promised : int
        The number of points in the header; 0 when the writer did not come to its end.
    data : ndarray (P, K)
        One column a vector; a read-only map of the file. It stays valid when the file is
        unlinked. Not aligned to 8 bytes, since the header has any length.
    """

    title: str
    name: str
    vectors: tuple[str, ...]
    promised: int
    data: Floats


@dataclass(frozen=True, slots=True)
class _Header:
    fields: dict[str, str]
    vectors: tuple[str, ...]
    size: int


def read_raw(path: Path, *, partial: bool = False) -> Plot:
    """Map the one plot of a raw file.

    Parameters
    ----------
    path : Path
        A binary raw file.
    partial : bool
        True for the file of a run that was cut short: the header's number of points (0 until
        ngspice has finished) is ignored and every complete point that reached the disk is taken.

    Raises
    ------
    BadEvidence
        No such file, not a raw file, text, complex or padded values, several plots, no points.
    OutOfDisk
        Fewer bytes than points x vectors x 8.
    """
    try:
        with path.open("rb") as stream:
            header = _read_header(stream, path)
    except FileNotFoundError:
        raise BadEvidence(f"{path.name} was never written") from None
    promised = _number(header, "no. points", path)
    width = len(header.vectors) * DOUBLE.itemsize
    found = path.stat().st_size - header.size
    points = found // width if partial else promised
    if not partial:
        _check_size(path, header, expected=promised * width, found=found)
    data = _map(path, header.size, points, len(header.vectors))
    return Plot(
        title=header.fields.get("title", ""),
        name=header.fields.get("plotname", ""),
        vectors=header.vectors,
        promised=promised,
        data=data,
    )


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
    data[:, 0] = waveforms.time
    data[:, 1:] = waveforms.values
    with path.open("wb") as stream:
        stream.write(("\n".join(lines) + "\n").encode())
        stream.write(data.data)


def _read_header(stream: BinaryIO, path: Path) -> _Header:
    """Read up to and with the ``Binary:`` line."""
    fields: dict[str, str] = {}
    vectors: list[str] = []
    while line := stream.readline(_LONGEST_LINE):
        text = line.decode("utf-8", "replace")
        if text.startswith("\t"):
            columns = text.split()
            if len(columns) < 3 or columns[0] != str(len(vectors)):
                raise BadEvidence(f"{path.name}: strange vector line {text.strip()!r}")
            vectors.append(columns[1])
            continue
        key, colon, value = text.partition(":")
        if not colon:
            raise BadEvidence(f"{path.name}: not a raw file; found {text[:60]!r} in its header")
        if key == "Values":
            raise BadEvidence(f"{path.name}: values are text; a binary raw file is needed")
        if key == "Binary":
            header = _Header(fields, tuple(vectors), stream.tell())
            _check_header(header, path)
            return header
        fields[key.lower()] = value.strip()
    raise BadEvidence(f"{path.name}: the header has no end ({len(vectors)} vectors were named)")


def _check_header(header: _Header, path: Path) -> None:
    flags = header.fields.get("flags", "").lower().split()
    if flags != ["real"]:
        raise BadEvidence(
            f"{path.name}: flags are {' '.join(flags) or 'missing'!r}; only 'real' is read"
            " (no complex or padded vectors)"
        )
    count = _number(header, "no. variables", path)
    if count != len(header.vectors) or count == 0:
        raise BadEvidence(
            f"{path.name}: {count} vectors are announced and {len(header.vectors)} are named"
        )


def _number(header: _Header, key: str, path: Path) -> int:
    value = header.fields.get(key, "")
    if not value.isdecimal():
        raise BadEvidence(f"{path.name}: {key!r} is {value!r}; a count is needed")
    return int(value)


def _check_size(path: Path, header: _Header, *, expected: int, found: int) -> None:
    """Hold the file's size against its header; see `read_raw` for what is raised."""
    if found < expected:
        raise OutOfDisk(
            f"{path.name} holds {found} of {expected} bytes: it could not be written in full."
            " Free space where runs are kept (TMPDIR), or save fewer nodes"
        )
    if found > expected:
        with path.open("rb") as stream:
            stream.seek(header.size + expected)
            more = stream.read(6)
        if more == b"Title:":
            raise BadEvidence(f"{path.name} holds several plots; one analysis a deck is accepted")
        raise BadEvidence(
            f"{path.name} holds {found} bytes of values where its header says {expected}"
        )
    if expected == 0:
        raise BadEvidence(f"{path.name} holds no points")


def _map(path: Path, offset: int, points: int, count: int) -> Floats:
    if points == 0:  # an empty range cannot be mapped
        return np.empty((0, count))
    mapped = np.memmap(path, dtype=DOUBLE, mode="r", offset=offset, shape=(points, count))
    return np.asarray(mapped)
