"""A correct simulator: decks with ``.tran`` and ``.save`` give straight lines over time.

The modules of this folder import nothing of taction, so that the programs start in milliseconds.
"""

from __future__ import annotations

import os
import re
import struct
import sys
from collections.abc import Sequence
from pathlib import Path

POINTS = 500
Rows = list[list[float]]


def requested() -> tuple[list[str], float]:
    """Return the saved vectors and the stop time, s, of the deck in this folder."""
    text = Path("deck.cir").read_text()
    vectors = re.search(r"^\.save (.*)$", text, re.MULTILINE)
    stop = re.search(r"^\.tran \S+ (\S+)", text, re.MULTILINE)
    if vectors is None or stop is None:
        sys.exit("this deck asks for nothing that the program understands")
    return vectors[1].split(), float(stop[1])


def straight_lines(count: int, stop: float) -> Rows:
    """Return `POINTS` rows of time (s) and `count` voltages, the k-th ``k + time / stop``."""
    parts = [index / (POINTS - 1) for index in range(POINTS)]
    return [[part * stop, *(k + part for k in range(count))] for part in parts]


def header(vectors: Sequence[str], points: int) -> bytes:
    """Return the head of a raw file."""
    names = [("time", "time"), *((name, "voltage") for name in vectors)]
    lines = [
        "Title: board",
        "Plotname: Transient Analysis",
        "Flags: real",
        f"No. Variables: {len(names)}",
        f"No. Points: {points}",
        "Variables:",
        *(f"\t{index}\t{name}\t{kind}" for index, (name, kind) in enumerate(names)),
        "Binary:",
    ]
    return ("\n".join(lines) + "\n").encode()


def raw_file(vectors: Sequence[str], rows: Rows) -> bytes:
    """Return the raw file of `rows`."""
    return header(vectors, len(rows)) + b"".join(struct.pack(f"<{len(r)}d", *r) for r in rows)


def good() -> bytes:
    """Return the right result for the deck in this folder."""
    vectors, stop = requested()
    return raw_file(vectors, straight_lines(len(vectors), stop))


def write(content: bytes, name: str = "out.raw") -> None:
    """Write a file of this folder in one go."""
    with os.fdopen(os.open(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644), "wb") as file:
        file.write(content)
