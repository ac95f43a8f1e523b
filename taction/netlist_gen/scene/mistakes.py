"""The mistakes in a scene: each with its place, its key, its value and the accepted values.

`root` is the model of a scene, an argument because this module must not import it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from taction.netlist_gen.scene.design import contradictions
from taction.system.errors import Complaint, InputError, listed, nearest_question
from taction.system.quantities import parse, show

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
    """Return a line of `text`, counted from 1, with its number and a caret below a column."""
    line = text.split("\n")[row - 1].replace("\t", " ").rstrip("\r")
    first = max(0, column - LONGEST_LINE // 2) if len(line) > LONGEST_LINE else 0
    part = line[first : first + LONGEST_LINE]
    caret = " " * (column - 1 - first) + "^" * max(1, min(width, LONGEST_LINE // 2))
    return f"line {row}, column {column}\n  {part}\n  {caret}"


def place(text: str, key: str) -> str:
    """Return where `text` gives `key`, or the table that lacks it; empty if nowhere."""
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


Root = TypeVar("Root", bound=BaseModel)
TEXTS = {  # by pydantic's name of the mistake; its own texts name types of Python
    "model_type": "expected a table",
    "model_attributes_type": "expected a table",
    "float_type": "expected a plain number, without quotes or unit",
    "int_type": "expected a plain whole number, without quotes or unit",
    "greater_than": "must be above {gt:g}",
    "greater_than_equal": "must be {ge:g} or more",
    "less_than": "must be below {lt:g}",
    "less_than_equal": "must be {le:g} or less",
    "bool_type": "expected true or false",
    "string_type": "expected text in quotes",
    "string_too_short": "expected text that is not empty",
    "string_too_long": "expected at most {max_length} characters",
    "literal_error": "expected one of {expected}",
    "int_from_float": "expected a plain whole number, without quotes or unit",
    "finite_number": "expected a finite number",
    "dict_type": "expected a table",
    "string_pattern_mismatch": "letters, digits, '-', '_' and '.' only",
}
PLAIN = re.compile(r"[0-9]{1,9}(\.[0-9]{1,9})?")


def validated(
    root: type[Root], data: Mapping[str, Any], file: str | Path, *, written: bool = True
) -> Root:
    """Return the `data` of `file` as a `root`; InputError lists all mistakes."""
    complaints = [*design_mistakes(data), *(impossible(data) if written else ())]
    try:
        model = root.model_validate(dict(data))
    except ValidationError as error:
        complaints = [*_complaints(root, error, data), *complaints]
    if complaints:
        raise InputError(file, *complaints)
    return model


def placed(
    root: type[BaseModel], data: dict[str, Any], values: Mapping[str, Any]
) -> list[Complaint]:
    """Put `values` by name or path into the tables of `data`; return what is unknown."""
    paths: dict[str, list[str]] = {}
    for above, name, field in _keys(root, data):
        key = field.alias or name
        for spelling in {name, key, f"{above}{key}"}:
            paths.setdefault(spelling, []).append(f"{above}{key}")
    complaints = []
    for name, value in values.items():
        matches = paths.get(name, [])
        if len(matches) != 1:
            several = f"several keys have this name; one of {listed(matches)}"
            text = several if matches else f"unknown key; {nearest_question(name, list(paths))}"
            complaints.append(Complaint(name, quoted_value(value), text.rstrip()))
            continue
        *tables, last = matches[0].split(".")
        table = data
        for key in tables:
            table = table.setdefault(key, {})
        table[last] = value
    return complaints


def _keys(
    model: type[BaseModel], data: Any, table: str = ""
) -> Iterator[tuple[str, str, FieldInfo]]:
    """Yield every key below `model`: its table with a dot, its name, its field."""
    for name, field in model.model_fields.items():
        yield table, name, field
        key = field.alias or name
        inside = _table(data).get(key)
        if (found := _pick(field.annotation, _table(inside).get("kind"))) is not None:
            yield from _keys(found, inside, f"{table}{key}.")


def _complaints(
    root: type[BaseModel], error: ValidationError, data: Mapping[str, Any]
) -> Iterator[Complaint]:
    for item in error.errors(include_url=False):
        kind, context = item["type"], item.get("ctx", {})
        missing = kind == "missing"
        keys = _real_path(item["loc"], data, missing=missing)
        key, above = ".".join(keys) or "scene", "".join(f"{name}." for name in keys[:-1])
        beside = {f.alias or name: f for table, name, f in _keys(root, data) if table == above}
        if missing:
            yield Complaint(key, "", f"required; {beside[keys[-1]].description}")
        elif kind == "extra_forbidden":
            hint = nearest_question(keys[-1], list(beside))
            text = f"unknown key; {hint}known here: {listed(beside)}"
            yield Complaint(key, quoted_value(item["input"]), text)
        elif kind == "union_tag_invalid":
            tag = str(context["tag"])
            known = [name.strip("' ") for name in context["expected_tags"].split(",")]
            text = f"{nearest_question(tag, known)}one of {listed(known)}"
            yield Complaint(f"{key}.kind", quoted_value(tag), text)
        elif kind == "union_tag_not_found":
            yield Complaint(f"{key}.kind", "", "required; 'tactile' or 'matrix'")
        else:
            text = item["msg"].removeprefix("Value error, ").replace("Input should be", "expected")
            text = TEXTS[kind].format(**context) if kind in TEXTS else text
            yield Complaint(key, quoted_value(item["input"]), text + share(item["input"], kind))


def _real_path(location: Sequence[int | str], data: Any, *, missing: bool) -> list[str]:
    """Return the keys of a location, without the tags of unions that pydantic adds."""
    keys: list[str] = []
    tag: object = None  # of the table of the previous key
    for place, part in enumerate(location):
        if part == tag:
            tag = None
            continue
        inside = isinstance(data, Mapping) and part in data
        if inside or (missing and place == len(location) - 1):
            keys.append(str(part))
        if inside:
            data = data[part]
            tag = data.get("kind") if isinstance(data, Mapping) else None
    return keys


def _pick(annotation: Any, kind: object) -> type[BaseModel] | None:
    """Return the model in an annotation, in a union that of `kind`; None without a model."""
    options = getattr(annotation, "__args__", (annotation,))
    models = [each for each in options if isinstance(each, type) and issubclass(each, BaseModel)]
    for each in models:
        field = each.model_fields.get("kind")
        if field is not None and get_args(field.annotation)[0] == kind:
            return each
    return models[0] if models else None


def design_mistakes(data: Mapping[str, Any]) -> Iterator[Complaint]:
    """Yield the contradictions of the design, also if a model stops at other mistakes."""
    design = _table(data.get("design"))
    for key, reason in contradictions(design):
        yield Complaint(f"design.{key}", quoted_value(design[key]), reason)
    # The channel of the rise time, if the problem, as far as it is stated, has fewer.
    problem, check = data.get("problem"), _table(data.get("checks")).get("rise_time")
    channel, most = _table(check).get("channel"), _table(problem).get("channels", 7)
    if _table(problem).get("kind") != "tactile":
        rows = _table(problem).get("matrix")
        first = rows[0] if isinstance(rows, list) and rows else None
        most = len(first) if isinstance(first, list) else None
    if isinstance(channel, int) and isinstance(most, int) and 0 < most < channel:
        text = f"the problem has {most} channels; expected 1 to {most}"
        yield Complaint("checks.rise_time.channel", quoted_value(channel), text)


IMPOSSIBLE = (  # key, unit, type, least and largest value; no board has others of this type
    ("capacitance", "F", (int, float), 0.0, 1.0, "'10pF' is 10 picofarad; a number is in F"),
    ("gain", "ohm", str, 1.0, math.inf, "'m' is milli, 'M' is mega: '6.25Mohm'"),
)
"""A capacitance of 10 without a unit is a slip, ``"10F"`` may be meant; so may a gain of 1e-3, but
not one with the prefix m. What may be meant is asked about (`questions`)."""


def impossible(data: Mapping[str, Any]) -> Iterator[Complaint]:
    """Yield the values of a design that are a slip beyond doubt."""
    design = _table(data.get("design"))
    for key, unit, kind, least, most, instead in IMPOSSIBLE:
        if not isinstance(design.get(key), kind):
            continue
        with suppress(TypeError, ValueError):  # the key's own check has it
            value = parse(design[key], unit)
            if 0.0 < value < least or value > most:
                text = f"{show(value, unit)} is what no board has; is the prefix right? {instead}"
                yield Complaint(f"design.{key}", quoted_value(design[key]), text)


def _table(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def share(value: object, kind: str) -> str:
    """Return how to write a percentage: ``"; 5 % is 0.05"``; empty for any other value."""
    if kind == "less_than" and isinstance(value, int | float) and 1 <= value <= 100:
        return f"; it is a fraction: {value:g} % is {value / 100.0:g}"
    found = percentage(value)
    return "" if found is None else f"; {100.0 * found:g} % is {found:g}"


def percentage(value: object) -> float | None:
    """Return a text such as ``"5%"`` as a fraction; None of anything else."""
    text = value.strip() if isinstance(value, str) else ""
    number = text.removesuffix("%").strip()
    return float(number) / 100.0 if text.endswith("%") and PLAIN.fullmatch(number) else None


def quoted_value(value: object) -> str:
    """Return a value as a complaint has it."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
