"""Waveforms that another program stored: raw files of ngspice, LTspice, Xyce and QSPICE.

ngspice's binary form is read by `raw_file`. Raw files in text, and those with single precision or a
header in UTF-16, are read by spicelib.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from taction.system.array_types import Floats
from taction.system.errors import BadEvidence, Complaint, InputError, OutOfDisk
from taction.system.foreign_files import MEGABYTE, UnusableFileError, open_regular
from taction.system.raw_file import read_plots
from taction.system.waveforms import Cost, Waveforms

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
