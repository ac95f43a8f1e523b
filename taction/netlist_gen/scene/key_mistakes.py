"""The mistakes in single keys of a scene file, found from the table of all keys without pydantic.

pydantic and the models of a scene take 0.3 s to load. A file that is refused here does not wait for
them, and no file is accepted here: the models decide (`taction.netlist_gen.scene.mistakes`), and a
test compares the complaints of both. `known_keys.json` is the table, which
``scripts/write_schemas.py`` writes from the models.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from taction.netlist_gen.scene.field_values import Rule, TemperatureRange, Unit, in_range
from taction.netlist_gen.scene.open_tables import AMPLIFIERS, NAMES
from taction.spice_models.transistor import pair_names
from taction.system.errors import Complaint, listed, nearest_question
from taction.system.plugins import names
from taction.system.quantities import parse, show

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

KEYS = Path(__file__).with_name("known_keys.json")
TABLES_OF_OTHERS = ("taction.checks", "taction.topologies")  # groups of plug-ins with keys
TWO_RESOLUTIONS = "'error' excludes 'points_per_period', which follows from it"


def above_max(least: float | None, most: float | None) -> str:
    """Return why nothing passes between these limits of a time, s; empty if something does."""
    if least is None or most is None or least <= most:
        return ""
    text = f"above max = {show(most, 's')}, so nothing passes"
    return f"{text}; expected at most {show(most, 's')}, or are they swapped?"


def unknown_pair(name: str) -> str:
    """Return what is wrong with the name of a matched pair of transistors; empty if nothing."""
    if name in pair_names():
        return ""
    return f"transistors = {name!r}: unknown pair; one of {', '.join(map(repr, pair_names()))}"


def file_with_others(given: Collection[str]) -> str:
    """Return which of the keys that are given excludes the file of an op-amp; empty if none."""
    others = sorted(set(given) - {"file"})
    return f"'file' excludes {others[0]!r}: an imported op-amp is as measured" if others else ""


class UndecidedError(Exception):
    """A value that only the models can judge: an array, or a number or a word."""


def key_mistakes(data: Mapping[str, Any]) -> list[Complaint]:
    """Return the mistakes of a scene file; empty if there are none, or if the models must judge.

    Examples
    --------
    >>> data = {"problem": {"kind": "tactile"}, "design": {"capacitence": "10pF"}}
    >>> key_mistakes(data)[0].key
    'design.capacitence'
    """
    look = KeyMistakes()
    try:
        look.table(json.loads(KEYS.read_text("utf-8")), data, "")
        if look.found and any(names(group) for group in TABLES_OF_OTHERS):
            return []  # other packages add keys
    except UndecidedError:
        return []
    further = [*design_mistakes(data), *impossible(data)]
    return [*look.found, *further]


@dataclass(slots=True)
class KeyMistakes:
    """The mistakes that were found so far; each entry of the table of keys is a dict."""

    found: list[Complaint] = field(default_factory=list)

    def table(self, entry: Mapping[str, Any], data: Any, path: str) -> None:
        """Look at a table: its keys, then unknown keys, then what contradicts itself."""
        if not isinstance(data, Mapping):
            plain = entry.get("plain")
            kinds = (str,) if plain in ("base", "stage") else (str, int, float)
            if plain is None or not isinstance(data, kinds):
                self.complain(path, data, "model_type", {})
                return
            self.value(entry["keys"][plain], data, path)
            return
        before, inside = len(self.found), f"{path}." if path else ""
        for key, each in entry["keys"].items():
            if key in data:
                right = len(self.found)
                self.value(each, data[key], inside + key)
                if key == "min" and len(self.found) == right:
                    self.order(entry["keys"], data, inside + key)
            elif "required" in each:
                self.found.append(Complaint(inside + key, "", f"required; {each['required']}"))
        for key in data:
            if key not in entry["keys"]:
                text = unknown_key(inside + key, list(entry["keys"]))
                self.found.append(Complaint(inside + key, quoted_value(data[key]), text))
        if len(self.found) == before and (reason := _contradiction(path, data)):
            self.found.append(Complaint(path, quoted_value(data), reason))

    def order(self, keys: Mapping[str, Any], data: Mapping[str, Any], path: str) -> None:
        """Compare the least value of a check, which is a quantity, with the largest one."""
        try:
            least, most = (parse(data[key], keys[key]["unit"]["unit"]) for key in ("min", "max"))
        except (KeyError, ValueError):  # it has no `max`, or one that was complained about
            return
        if reason := above_max(least, most):
            self.found.append(Complaint(path, quoted_value(data["min"]), reason))

    def value(self, entry: Mapping[str, Any], value: Any, path: str) -> None:
        """Look at the value of one key."""
        form = entry["form"]
        if form == "table":
            self.table(entry, value, path)
        elif form == "kinds":
            self.kinds(entry, value, path)
        elif form == "numbers":
            if not isinstance(value, Mapping):
                self.complain(path, value, "dict_type", {})
            else:
                for key, number in value.items():
                    self.value(entry["each"], number, f"{path}.{key}")
        elif form in CHECKS:
            try:
                CHECKS[form](entry, value)
            except ValueError as error:
                self.found.append(
                    Complaint(path, quoted_value(value), f"{error}{share(value, '')}")
                )
        else:
            kind, context = PLAIN_FORMS[form](entry, value)
            if form == "number" and kind not in TYPES and (reason := _out_of_range(value)):
                self.found.append(Complaint(path, quoted_value(value), reason))
            elif kind:
                self.complain(path, value, kind, context)

    def kinds(self, entry: Mapping[str, Any], value: Any, path: str) -> None:
        """Look at a table whose key `kind` says which keys it has."""
        if not isinstance(value, Mapping):
            self.complain(path, value, "model_type", {})
            return
        kind = value.get("kind", entry["default"])
        if kind is None:
            text = f"required; {' or '.join(map(repr, entry['of']))}"
            self.found.append(Complaint(f"{path}.kind", "", text))
        elif isinstance(kind, str) and kind in entry["of"]:
            self.table(entry["of"][kind], value, path)
        else:
            text = f"{nearest_question(str(kind), entry['of'])}one of {listed(entry['of'])}"
            self.found.append(Complaint(f"{path}.kind", quoted_value(str(kind)), text))

    def complain(self, path: str, value: Any, kind: str, context: Mapping[str, Any]) -> None:
        """Add a complaint in the words of `TEXTS`."""
        text = TEXTS[kind].format(**context) + share(value, kind)
        self.found.append(Complaint(path, quoted_value(value), text))


def _number(entry: Mapping[str, Any], value: Any) -> tuple[str, Mapping[str, Any]]:
    """Return pydantic's name for what is wrong with a plain number, and what its text needs."""
    whole = entry["form"] == "whole"
    if isinstance(value, bool) or not isinstance(value, int if whole else int | float):
        return ("int_type" if whole else "float_type"), {}
    if isinstance(value, float) and not math.isfinite(value):
        return "finite_number", {}
    for name, (kind, fails) in LIMITS.items():
        if name in entry and fails(value, entry[name]):
            return kind, {name: entry[name]}
    return "", {}


Form = Callable[[Mapping[str, Any], Any], tuple[str, Mapping[str, Any]]]
LIMITS: dict[str, tuple[str, Callable[[float, float], bool]]] = {
    "le": ("less_than_equal", lambda value, limit: value > limit),
    "lt": ("less_than", lambda value, limit: value >= limit),
    "ge": ("greater_than_equal", lambda value, limit: value < limit),
    "gt": ("greater_than", lambda value, limit: value <= limit),
}


TYPES = ("float_type", "int_type", "finite_number")  # mistakes that leave no number to compare


def _out_of_range(value: float) -> str:
    try:
        in_range(value)
    except ValueError as error:
        return str(error)
    return ""


def _text(entry: Mapping[str, Any], value: Any) -> tuple[str, Mapping[str, Any]]:
    if not isinstance(value, str):
        return "string_type", {}
    if len(value) < entry.get("least", 0):
        return "string_too_short", {}
    if len(value) > entry.get("most", math.inf):
        return "string_too_long", {"max_length": entry["most"]}
    if "pattern" in entry and not re.search(entry["pattern"].replace("$", r"\Z"), value):
        return "string_pattern_mismatch", {}
    return "", {}


def _choice(entry: Mapping[str, Any], value: Any) -> tuple[str, Mapping[str, Any]]:
    known = [repr(name) for name in entry["names"]]
    if isinstance(value, str) and value in entry["names"]:
        return "", {}
    if isinstance(value, bool) and entry.get("truth"):
        return "", {}
    return "literal_error", {"expected": f"{', '.join(known[:-1])} or {known[-1]}"}


def _truth(entry: Mapping[str, Any], value: Any) -> tuple[str, Mapping[str, Any]]:
    return ("" if isinstance(value, bool) else "bool_type"), {}


def _word_or_number(entry: Mapping[str, Any], value: Any) -> tuple[str, Mapping[str, Any]]:
    """Leave all but a known word and a number within the limits to the models."""
    if value not in entry["names"] and (_number(entry, value)[0] or _out_of_range(value)):
        raise UndecidedError
    return "", {}


def _else(entry: Mapping[str, Any], value: Any) -> tuple[str, Mapping[str, Any]]:
    """Leave all but a name of a file to the models."""
    if isinstance(value, str) and value:
        return "", {}
    raise UndecidedError


PLAIN_FORMS: dict[str, Form] = {
    "number": _number,
    "whole": _number,
    "text": _text,
    "choice": _choice,
    "truth": _truth,
    "word or number": _word_or_number,
    "else": _else,
}
CHECKS: dict[str, Callable[[Mapping[str, Any], Any], object]] = {
    "quantity": lambda entry, value: Unit(**entry["unit"]).check(value),
    "rule": lambda entry, value: Rule(tuple(entry["names"])).check(value),
    "temperatures": lambda entry, value: TemperatureRange().check(value),
    "name": lambda entry, value: NAMES[entry["of"]].check(value),
}


def _contradiction(path: str, data: Mapping[str, Any]) -> str:
    """Return what contradicts itself in a table whose keys are right."""
    if path == "design.antilog":
        return unknown_pair(data.get("transistors", pair_names()[0]))
    if path == "design.opamp" and "file" in data:
        return file_with_others(data)
    if path == "analysis" and data.get("error", "auto") != "auto" and "points_per_period" in data:
        return TWO_RESOLUTIONS
    return ""


def contradictions(design: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield each key of a design that contradicts another key, with the reason."""
    if design.get("lambda") is not None and design.get("resistance") is not None:
        yield "lambda", "excludes 'resistance': give one of the two"
    if design.get("amplifier", "linear") == "linear":
        for key in ("exponential_slope", "bias"):
            if design.get(key) is not None:
                yield key, "needs a nonlinear amplifier, such as 'exponential'"
    if design.get("ridge_share", 1.0) != 1.0:
        kind = AMPLIFIERS.get(str(design.get("amplifier", "linear")))
        if not (kind and kind.ridge):
            accepted = listed(name for name, each in AMPLIFIERS.items() if each.ridge)
            yield "ridge_share", f"needs an amplifier whose ridge term can be removed: {accepted}"
    if design.get("temperature_coefficient") and design.get("temperature") is None:
        yield "temperature_coefficient", "needs temperature, such as '0..70degC'"
    for name, keys in design.items():
        other = isinstance(keys, Mapping) and name != design.get("topology")
        if other and name in names("taction.topologies"):
            yield name, f"needs topology = {name!r}"
    antilog = design.get("antilog")
    stage = antilog.get("stage", "ideal") if isinstance(antilog, Mapping) else antilog
    if stage == "device" and design.get("amplifier", "linear") != "exponential":
        yield "antilog", "'device' needs amplifier = 'exponential'"


def design_mistakes(data: Mapping[str, Any]) -> Iterator[Complaint]:
    """Yield the contradictions of the design, also if a model stops at other mistakes."""
    design = data.get("design")
    if isinstance(design, Mapping):
        for key, reason in contradictions(design):
            yield Complaint(f"design.{key}", quoted_value(design[key]), reason)
    yield from _no_such_channel(data)


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
        try:
            value = parse(design[key], unit)
        except (TypeError, ValueError):
            continue  # the key's own check has it
        if 0.0 < value < least or value > most:
            text = f"{show(value, unit)} is what no board has; is the prefix right? {instead}"
            yield Complaint(f"design.{key}", quoted_value(design[key]), text)


def _no_such_channel(data: Mapping[str, Any]) -> Iterator[Complaint]:
    """Yield the channel of the rise time if the problem, as far as it is stated, has fewer."""
    problem, check = data.get("problem"), _table(data.get("checks")).get("rise_time")
    channel, most = _table(check).get("channel"), _table(problem).get("channels", 7)
    if _table(problem).get("kind") != "tactile":
        rows = _table(problem).get("matrix")
        most = (
            len(rows[0]) if isinstance(rows, list) and rows and isinstance(rows[0], list) else None
        )
    if isinstance(channel, int) and isinstance(most, int) and 0 < most < channel:
        text = f"the problem has {most} channels; expected 1 to {most}"
        yield Complaint("checks.rise_time.channel", quoted_value(channel), text)


def _table(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def share(value: object, kind: str) -> str:
    """Return how to write a percentage: ``"; 5 % is 0.05"``; empty for any other value."""
    if kind == "less_than" and isinstance(value, int | float) and 1 <= value <= 100:
        return f"; it is a fraction: {value:g} % is {value / 100.0:g}"
    number = value.strip().removesuffix("%").strip() if isinstance(value, str) else ""
    if not str(value).strip().endswith("%") or not PLAIN.fullmatch(number):
        return ""
    return f"; {number} % is {float(number) / 100.0:g}"


WITHDRAWN = {
    **dict.fromkeys(
        ("devices.file", "wires.file"),
        "withdrawn: give the numbers of the file; docs/devices.md says which key has which",
    ),
}
"""What to do in the place of a key that is no more, by its path."""


def unknown_key(path: str, known: Sequence[str]) -> str:
    """Return what is wrong with a key that no table has, and what would be accepted."""
    if path in WITHDRAWN:
        return WITHDRAWN[path]
    key = path.rpartition(".")[2]
    return f"unknown key; {nearest_question(key, known)}known here: {listed(known)}"


def quoted_value(value: object) -> str:
    """Return a value as a complaint has it."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
