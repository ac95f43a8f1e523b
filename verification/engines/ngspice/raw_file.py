"""ngspice's binary raw files, read through a memory map and written.

Only what one batch run writes is accepted: one plot of real, unpadded double-precision vectors.
Anything else (text, complex, several plots, fewer bytes than promised) is refused by name,
because a reader that guesses turns a truncated file into a plausible waveform.
"""

from __future__ import annotations

import mmap
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spice_models.array_types import Floats
from spice_models.errors import BadEvidence, OutOfDisk
from verification.waveforms import Waveforms

DOUBLE = np.dtype("<f8")
_LONGEST_HEADER = 1 << 24
_END = b"\nBinary:\n"  # of the header


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
        unlinked. Not aligned to 8 bytes, since the header has any length: to compute with it,
        copy it.
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
    content = _map(path)
    header = _read_header(content, path)
    promised = _number(header, "no. points", path)
    count = len(header.vectors)
    width = count * DOUBLE.itemsize
    found = len(content) - header.size
    points = found // width if partial else promised
    if not partial:
        _check_size(path, content, header.size, promised * width)
    data = np.frombuffer(content, DOUBLE, points * count, header.size).reshape(points, count)
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


def _map(path: Path) -> mmap.mmap | bytes:
    """Map the file's content; one that is empty, or no regular file, cannot be and has none."""
    try:
        file = os.open(path, os.O_RDONLY)
    except FileNotFoundError:
        raise BadEvidence(f"{path.name} was never written") from None
    try:
        size = os.fstat(file).st_size
        return mmap.mmap(file, size, access=mmap.ACCESS_READ) if size else b""
    finally:
        os.close(file)


def _read_header(content: mmap.mmap | bytes, path: Path) -> _Header:
    """Read up to and with the ``Binary:`` line."""
    end = content.find(_END, 0, _LONGEST_HEADER)
    fields: dict[str, str] = {}
    vectors: list[str] = []
    head = content[: end if end >= 0 else _LONGEST_HEADER].decode("utf-8", "replace")
    for text in head.removesuffix("\n").split("\n") if head else ():
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
        fields[key.lower()] = value.strip()
    if end < 0:
        raise BadEvidence(f"{path.name}: the header has no end ({len(vectors)} vectors were named)")
    header = _Header(fields, tuple(vectors), end + len(_END))
    _check_header(header, path)
    return header


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


def _check_size(path: Path, content: mmap.mmap | bytes, start: int, expected: int) -> None:
    """Hold the bytes from `start` on against `expected`; `read_raw` says what is raised."""
    found = len(content) - start
    if found < expected:
        raise OutOfDisk(
            f"{path.name} holds {found} of {expected} bytes: it could not be written in full."
            " Free space where runs are kept (TMPDIR), or save fewer nodes"
        )
    if found > expected:
        if content[start + expected : start + expected + 6] == b"Title:":
            raise BadEvidence(f"{path.name} holds several plots; one analysis a deck is accepted")
        raise BadEvidence(
            f"{path.name} holds {found} bytes of values where its header says {expected}"
        )
    if expected == 0:
        raise BadEvidence(f"{path.name} holds no points")
