"""The logical lines of a foreign netlist: comments cut off, continuations joined, in lower case.

A line of the file ends at a line feed (or carriage return and line feed) and nowhere else, and a
logical line has only the characters of `ALLOWED`: no other separator, quote or backslash reaches
ngspice, which reads a line after any newline as a command.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

ALLOWED = re.compile(r"[a-z0-9_ .,+\-*/(){}=:^<>!?&|]*")
LONGEST = 20_000  # characters of a logical line
_COMMENT = re.compile(r"\s*(?:;|//|(?:^|(?<=\s))\$).*")


class RefusedError(ValueError):
    """A line of a foreign netlist that is not accepted; the text has its number and the reason."""

    def __init__(self, number: int, reason: str, text: str = "") -> None:
        shown = f" {text[:60]!r}" if text else ""
        super().__init__(f"line {number}{shown}: {reason}")
        self.number = number


@dataclass(frozen=True, slots=True)
class Line:
    """A logical line: `number` is the line of the file where it begins, from 1."""

    number: int
    text: str

    def refused(self, reason: str) -> RefusedError:
        """Return the error for this line."""
        return RefusedError(self.number, reason, self.text)


def logical_lines(content: bytes) -> list[Line]:
    r"""Return the logical lines of a file, without empty ones.

    Raises
    ------
    RefusedError
        A character that is not accepted outside of comments, a continuation of nothing, or a line
        over `LONGEST`.

    Examples
    --------
    >>> logical_lines(b"* title\nR1 a b 1K ; load\n+ tc1=0\n")
    [Line(number=2, text='r1 a b 1k tc1=0')]
    """
    found: list[Line] = []
    text = content.decode("latin-1")  # of comments only: the rest is ASCII
    for number, raw in enumerate(text.split("\n"), 1):
        line = raw.removesuffix("\r").replace("\t", " ").strip(" ").lower()
        if line.startswith("*"):
            continue
        line = _COMMENT.sub("", line)
        if wrong := ALLOWED.sub("", line, count=1):
            raise RefusedError(number, f"the character {wrong[0]!r} is not accepted")
        line = " ".join(line.split())
        if line.startswith("+"):
            if not found:
                raise RefusedError(number, "a continuation of no line")
            line, begin = f"{found[-1].text} {line[1:].strip()}", found.pop().number
        else:
            begin = number
        if len(line) > LONGEST:
            raise RefusedError(begin, f"over {LONGEST} characters")
        if line:
            found.append(Line(begin, line))
    return found
