"""Where a mistake stands in the text of a scene file, and mistakes of TOML in plain words."""

from __future__ import annotations

import re
from dataclasses import replace

from taction.system.errors import Complaint, InputError

_TABLE = re.compile(r"\s*\[\[?\s*([^\[\]=#]+?)\s*\]")
_KEY = re.compile(r"\s*([\w\-.\"' ]+?)\s*=")
_AT = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")
LONGEST_LINE = 76  # characters of a line that a message shows
WORDS = {  # beginnings of tomllib's texts, and what to write instead
    "Expected newline": 'text and quantities need quotes on both sides, as "10pF"; a number is'
    " 1.5, with a point; one 'key = value' a line",
    "Invalid value": "expected a value: a number such as 1.5, true or false, or text and quantities"
    ' in straight quotes, as "10pF"',
    "Unterminated string": 'a quote is missing at the end of the text; expected "10pF"',
    "Illegal character '\\n'": 'a quote is missing at the end of the text; expected "10pF"',
    'Expected "\'"': "a quote is missing at the end of the text; expected '10pF'",
    "Cannot overwrite": "the key is given twice; keep one of the two",
    "Duplicate inline": "the key is given twice; keep one of the two",
    "Cannot declare": "the table is given twice; put all its keys below one header",
    "Expected '='": "expected 'key = value'",
    "Invalid statement": "expected 'key = value', or a table such as [design]",
    "Expected ']'": "the bracket ']' of a table is missing; expected a table such as [design]",
    "Unclosed array": "the bracket ']' of a list is missing",
    "Unclosed inline": "the brace '}' of a table is missing",
}


def shown(text: str, row: int, column: int, width: int = 1) -> str:
    r"""Return a line of `text`, counted from 1, with its number and a caret below a column.

    Examples
    --------
    >>> print(shown('[design]\ngain = 10', 2, 8, 2))
    line 2, column 8
      gain = 10
             ^^
    """
    line = text.split("\n")[row - 1].replace("\t", " ").rstrip("\r")
    first = max(0, column - LONGEST_LINE // 2) if len(line) > LONGEST_LINE else 0
    part = line[first : first + LONGEST_LINE]
    caret = " " * (column - 1 - first) + "^" * max(1, min(width, LONGEST_LINE // 2))
    return f"line {row}, column {column}\n  {part}\n  {caret}"


def place(text: str, key: str) -> str:
    r"""Return where `text` gives `key`, or the table that lacks it; empty if nowhere.

    Examples
    --------
    >>> print(place('[checks]\nrise_time = { channel = 8 }', "checks.rise_time.channel"))
    line 2, column 15
      rise_time = { channel = 8 }
                    ^^^^^^^
    """
    wanted, table = key.split("."), list[str]()
    best, depth, inside = (0, 0, 0), 0, False
    for row, line in enumerate(text.split("\n"), 1):
        quoted = (line.count('"""') + line.count("'''")) % 2 == 1
        if inside or quoted:
            inside = inside != quoted
            continue
        header = _TABLE.match(line)
        match = header or _KEY.match(line)
        if match is None:
            continue
        table = _parts(match[1]) if header else table
        found = table if header else table + _parts(match[1])
        common = min(len(found), len(wanted))  # `found` may be a key below `wanted`
        if found[:common] != wanted[:common] or common <= depth:
            continue
        depth, start, end = common, match.start(1), match.end(1)
        for part in wanted[depth:] if header is None else ():
            inner = re.compile(rf"[{{,]\s*({re.escape(part)})\s*=").search(line, end)
            if inner is None:
                break
            depth, start, end = depth + 1, inner.start(1), inner.end(1)
        best = (row, start + 1, end - start)
    return shown(text, *best) if depth else ""


def _parts(key: str) -> list[str]:
    return [part.strip().strip("\"'") for part in key.split(".")]


def with_places(error: InputError, text: str) -> InputError:
    """Return `error` about the scene file `text` with the line of each mistake."""
    placed = (replace(each, place=place(text, each.key)) for each in error.complaints)
    return InputError(error.file, *placed)


def toml_complaint(text: str, error: ValueError, accepted: str) -> Complaint:
    """Return what is wrong in a `text` that is not TOML: where, and what to write instead."""
    message = str(error)
    at = _AT.search(message)
    if at is None:
        return Complaint("TOML", "", f"{message}; expected {accepted}")
    text = text.replace("\r\n", "\n").rstrip("\n")  # tomllib counts these lines
    rows = text.split("\n")
    row = min(int(at[1] or len(rows)), len(rows))
    column = min(int(at[2] or 10**9), len(rows[row - 1]) + 1)
    reason = message[: at.start()]
    if reason.startswith("Cannot overwrite"):  # reported behind the value
        column = len(rows[row - 1]) - len(rows[row - 1].lstrip()) + 1
    words = next((w for begin, w in WORDS.items() if reason.startswith(begin)), None)
    told = words or f"{reason}; expected {accepted}"
    if row == 1 and reason.startswith("Expected '='"):
        told = f"{told}; expected {accepted}"
    match = _KEY.match(rows[row - 1])
    key = match[1] if match else "TOML"
    value = repr(rows[row - 1][match.end() :].strip()) if match else ""
    return Complaint(key, value, f"line {row}: {told}", shown(text, row, column))
