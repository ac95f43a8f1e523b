"""Names of files as text."""

from __future__ import annotations


def printable(text: str) -> str:
    r"""Return `text` so that every encoding and every format can hold it.

    Python reads a byte of a file name that is not UTF-8 as half of a surrogate pair, which strict
    readers of JSON and XML refuse; here it becomes six plain characters.

    >>> print(printable("board-\udcff.toml"))
    board-\udcff.toml
    """
    return text.encode(errors="backslashreplace").decode()
