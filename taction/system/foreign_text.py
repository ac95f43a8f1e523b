r"""Texts of others as a reader sees them: names of files, titles, logs of a simulator.

A terminal obeys escape sequences, a list is spoilt by a newline, and GitHub takes a line of a log
that begins with ``::`` for a command. Every text that taction did not write itself passes through
here on its way to a terminal, a log, Markdown, HTML or XML. In JSON it stays what it is.
"""

from __future__ import annotations

import re

COMMAND = re.compile(r"^(\s*):(?=:)|#(?=#\[)", re.MULTILINE)
LONGEST = 2000  # characters of a message


def visible(text: str) -> str:
    r"""Return `text` in one line: what cannot be printed is written as in Python.

    Examples
    --------
    >>> print(visible("a\n::error::b\x1b[2J"), visible("::error::"), visible("\udcff"))
    a\n::error::b\x1b[2J \x3a:error:: \udcff
    """
    return COMMAND.sub(_escaped_mark, escaped(text))


def visible_lines(text: str) -> str:
    r"""Return a text of several lines: as `visible`, but its newlines stay.

    Examples
    --------
    >>> print(visible_lines("two\nlines\x07"))
    two
    lines\x07
    """
    return "\n".join(map(visible, text.split("\n")))


def escaped(text: str, keep: str = "") -> str:
    r"""Return `text` with the characters that cannot be printed, but those in `keep`, as in Python.

    Examples
    --------
    >>> escaped("a\tb\u202e", keep="\t") == "a\tb" + "\\" + "u202e"
    True
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in keep else _escape(c) for c in text)


def shortened(text: str, most: int = LONGEST) -> str:
    """Return a text of about `most` characters at most: of a longer one beginning and end.

    Examples
    --------
    >>> shortened("abcdefghij", 4)
    'ab ... ij'
    """
    return text if len(text) <= most else f"{text[: most // 2]} ... {text[-most // 2 :]}"


def _escape(character: str) -> str:
    return character.encode("unicode_escape").decode()


def _escaped_mark(found: re.Match[str]) -> str:
    return found[0][:-1] + f"\\x{ord(found[0][-1]):02x}"
