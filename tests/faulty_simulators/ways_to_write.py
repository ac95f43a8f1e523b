"""Ways to write a wrong result, or a right one in an unusual form."""

from __future__ import annotations

import math
import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path

from tests.faulty_simulators.correct import (
    POINTS,
    Rows,
    good,
    header,
    packed,
    raw_file,
    requested,
    straight_lines,
    write,
)
from tests.faulty_simulators.ways_to_end import waits

Way = Callable[[], None]


def rows_after(change: Callable[[Rows], Rows]) -> Way:
    """Return a way: the rows of a good result after `change`."""

    def way() -> None:
        vectors, stop = requested()
        write(raw_file(vectors, change(straight_lines(len(vectors), stop))))

    return way


def bytes_after(change: Callable[[bytes], bytes]) -> Way:
    """Return a way: the bytes of a good result after `change`."""
    return lambda: write(change(good()))


def replaced(old: bytes, new: bytes) -> Way:
    """Return a way: a good result with other bytes in one place."""
    return bytes_after(lambda content: content.replace(old, new, 1))


def value(voltage: float) -> Way:
    """Return a way: one voltage in the middle of the record is `voltage`."""
    middle = POINTS // 2
    return rows_after(
        lambda rows: [*rows[:middle], [*rows[middle][:-1], voltage], *rows[middle + 1 :]]
    )


def vectors_after(change: Callable[[list[str]], list[str]]) -> Way:
    """Return a way: the result of other vectors than the saved ones."""

    def way() -> None:
        vectors, stop = requested()
        found = change(vectors)
        write(raw_file(found, straight_lines(len(found), stop)))

    return way


def permuted() -> None:
    """Write the right vectors in another order."""
    vectors, stop = requested()
    rows = straight_lines(len(vectors), stop)
    write(raw_file(vectors[::-1], [[row[0], *row[:0:-1]] for row in rows]))


def in_text() -> None:
    """Write values as text."""
    vectors, stop = requested()
    rows = straight_lines(len(vectors), stop)
    lines = [f"{number}\t" + "\n\t".join(map(repr, row)) for number, row in enumerate(rows)]
    head = header(vectors, len(rows)).replace(b"Binary:\n", b"Values:\n")
    write(head + "\n".join(lines).encode())


def big_endian() -> None:
    """Write values with their bytes in the other order."""
    vectors, stop = requested()
    rows = straight_lines(len(vectors), stop)
    write(header(vectors, len(rows)) + packed(rows, ">"))


def slowly() -> None:
    """Write half of the points, as ngspice does during a run, and go on for ever."""
    head, mark, data = good().partition(b"Binary:\n")
    write(head.replace(b"Points: 500", b"Points: 0") + mark + data[: len(data) // 2])
    waits()


def by_a_child() -> None:
    """End with half of the result, which a child completes later."""
    content = good()
    write(content[: len(content) // 2])
    if os.fork() == 0:
        time.sleep(0.3)
        write(content)


def elsewhere() -> None:
    """Write the result in another folder."""
    Path("results").mkdir()
    write(good(), "results/out.raw")


def without(name: str) -> Way:
    """Return a way: the right result, and no file or pipe where the run has a file."""

    def way() -> None:
        write(good())
        Path(name).unlink()
        if name == "stderr.txt":
            os.mkfifo(name)

    return way


def in_no_folder() -> None:
    """Remove the run folder."""
    shutil.rmtree(Path.cwd())


def linked(target: str) -> Way:
    """Return a way: the result is a symbolic link."""
    return lambda: Path("out.raw").symlink_to(target)


def unreadable() -> None:
    """Write a result that nobody may read."""
    write(good())
    Path("out.raw").chmod(0)


WRITES: dict[str, Way] = {
    "slow": slowly,
    "result completed by a child": by_a_child,
    "result elsewhere": elsewhere,
    "header cut": bytes_after(lambda content: content[: content.index(b"No. Points")]),
    "vector table cut": bytes_after(lambda content: content[: content.index(b"\t2\t")]),
    "data cut": bytes_after(lambda content: content[:-13]),
    "empty result": lambda: write(b""),
    "any bytes": lambda: write(bytes(range(256)) * 40),
    "more points announced": replaced(b"Points: 500", b"Points: 501"),
    "fewer points announced": replaced(b"Points: 500", b"Points: 499"),
    "more vectors announced": replaced(b"Variables: 3", b"Variables: 4"),
    "a number of 5,000 digits": replaced(b"Points: 500", b"Points: 5" + b"0" * 5000),
    "no points": rows_after(lambda rows: []),
    "two plots": bytes_after(lambda content: content * 2),
    "another analysis": replaced(b"Transient Analysis", b"AC Analysis"),
    "not a number": value(math.nan),
    "infinity": value(-math.inf),
    "overflow": value(1e99),
    "rows swapped": rows_after(lambda rows: [*rows[:9], rows[10], rows[9], *rows[11:]]),
    "a time twice": rows_after(lambda rows: [*rows[:9], rows[9], *rows[9:]]),
    "a time that is no number": rows_after(lambda rows: [*rows[:9], [math.nan] * 3, *rows[9:]]),
    "stops early": rows_after(lambda rows: rows[:-1]),
    "starts late": rows_after(lambda rows: rows[5:]),
    "goes beyond the stop time": rows_after(
        lambda rows: [[row[0] * (1.0 + 1e-6), *row[1:]] for row in rows]
    ),
    "missing vector": vectors_after(lambda names: names[:1]),
    "additional vector": vectors_after(lambda names: [*names, "v(more)"]),
    "wrong name": vectors_after(lambda names: ["v(wrong)", *names[1:]]),
    "a name twice": vectors_after(lambda names: [names[0], names[0]]),
    "another order": permuted,
    "values as text": in_text,
    "complex values": replaced(b"Flags: real", b"Flags: complex"),
    "padded values": replaced(b"Flags: real", b"Flags: real padded"),
    "big-endian values": big_endian,
    "the deck is removed": without("deck.cir"),
    "the error stream becomes a pipe": without("stderr.txt"),
    "the folder is removed": in_no_folder,
    "result is a pipe": lambda: os.mkfifo("out.raw"),
    "result is a folder": lambda: Path("out.raw").mkdir(),
    "result is a device": linked("/dev/zero"),
    "result is a loop of links": linked("out.raw"),
    "result cannot be read": unreadable,
}
