"""The values that keys of a scene take in a study: axes, fixed keys, and other single values.

    C=1pF:1nF:31        31 points, logarithmic          C=1p,2p,5p    these three
    C=1pF:1nF:31:lin    31 points, linear               C             the study's own range
    gain=1M,2M C=2p,1p  zipped: both change together (one ``--over``, a blank between)

In Python: ``{"C": ("1pF", "1nF", 31), "opamp.base": ["ua741", "lf353"]}``. A key is a dotted path,
the end of one (``opamp.gbw``), or a symbol of the paper (`SYMBOLS`).

What is accepted but looks like a slip, in a scene or in axes, is a question to the user.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from taction.netlist_gen.scene.keys import Key, Value, find_key, own_value, read_value
from taction.netlist_gen.scene.scene import Scene, own_figures, parse_scene
from taction.system.errors import Complaint, InputError
from taction.system.reading_definitions import EXCURSIONS

MAX_POINTS = 100_000  # on one axis
ENGINE = "analysis.engine"
POINTS = 31  # of a range without a number of points
# Keys that exclude each other: a value of the first removes the second.
REPLACES = {
    "design.resistance": "design.lambda",
    "design.lambda": "design.resistance",
    "design.opamp.second_pole": "design.opamp.phase_margin",
    "design.opamp.phase_margin": "design.opamp.second_pole",
}
_NEXT_KEY = re.compile(r"\s+(?=[A-Za-z_][A-Za-z0-9_.]*=)")

Scale = Literal["log", "lin", "list"]
Point = Mapping[str, Value]
Over = str | Iterable[str] | Mapping[str, str | Iterable[Value]]


@dataclass(frozen=True, slots=True)
class SweepAxis:
    """The values of one key."""

    DOCUMENT = ("name", "key = key.path", "unit = key.unit", "scale", "group", "values")

    key: Key
    name: str  # the key as the user wrote it
    values: tuple[Value, ...]  # base units, in the order of the study
    scale: Scale  # spacing of the values
    default: bool = False  # the range follows from the scene's own value
    group: int = 0  # of axes that change together, in the order of the study

    def __len__(self) -> int:
        return len(self.values)


def parse_axes(
    scene: Scene, over: Over, *, points: int = POINTS, around: float | None = None
) -> list[list[SweepAxis]]:
    """Return the axes of a study: each item spans the grid and is a list of zipped axes."""
    if isinstance(over, Mapping):
        texts: Iterable[str] = [_as_text(name, values) for name, values in over.items()]
    else:
        texts = [over] if isinstance(over, str) else over
    groups = list[list[SweepAxis]]()
    for text in texts:
        parts = _NEXT_KEY.split(text.strip())
        read = (parse_axis(scene, one, points=points, around=around) for one in parts)
        group = [replace(axis, group=len(groups)) for axis in read]
        if len({len(axis) for axis in group}) > 1:
            lengths = ", ".join(f"{axis.name} has {len(axis)}" for axis in group)
            raise _wrong(text, f"keys that change together need the same length; {lengths}")
        groups.append(group)
    paths = [axis.key.path for group in groups for axis in group]
    for path in paths:
        if paths.count(path) > 1:
            raise _wrong(path, "the key occurs twice; give all its values at once")
    return groups


def _as_text(name: str, values: str | Iterable[Value]) -> str:
    """Return an axis in the form of ``--over``."""
    if isinstance(values, str):
        return f"{name}={values}"
    between = ":" if isinstance(values, tuple) else ","
    words = [str(value).lower() if isinstance(value, bool) else str(value) for value in values]
    wrong = next((word for word in words if set(word) & set(":,=")), None)
    if wrong is not None:
        raise _wrong(wrong, "a value of an axis must not contain ':', ',' or '='")
    return f"{name}={between.join(words)}"


def parse_axis(
    scene: Scene, text: str, *, points: int = POINTS, around: float | None = None
) -> SweepAxis:
    """Return the axis ``KEY=VALUES`` (see the head of this file); its values are tried on `scene`.

    With `around`, ``KEY`` alone is a range from the scene's own value over it to the value times
    it.
    """
    name, equals, body = (part.strip() for part in text.partition("="))
    key = find_key(scene, name)
    if not body and around is not None and not equals and key.kind == "real":
        return _default_axis(scene, key, name, around, points)
    if not body:
        ranges = "=1pF:1nF:31 or =1pF,2pF" if key.unit == "F" else "=LOW:HIGH:POINTS or =A,B,C"
        example = "=A,B,C" if key.kind == "choice" else ranges
        raise _wrong(text, f"expected values, {name}{example}")
    values, scale = range_values(key, text, body, points)
    for value in values if scale == "list" else (values[0], values[-1]):
        tried(scene, {key.path: value}, "--over")
    return SweepAxis(key, name, values, scale)


@contextmanager
def mistakes_of(option: str) -> Iterator[None]:
    """Raise what is wrong within as a mistake of an option, not of the file."""
    try:
        yield
    except InputError as error:
        raise InputError(option, *error.complaints) from None


def tried(scene: Scene, changes: Point, option: str) -> Scene:
    """Return the scene with other values; a mistake is one of the option, not of the file."""
    with mistakes_of(option):
        return with_values(scene, changes)


def read_ends(scene: Scene, path: str, body: str, option: str = "--over") -> tuple[float, float]:
    """Return the ends of ``"LOW:HIGH"`` above zero; an option may have one value for both."""
    key, (first, colon, last) = find_key(scene, path), body.partition(":")
    over = option == "--over"
    with mistakes_of(option):
        low, high = (float(read_value(key, end)) for end in (first, last if colon else first))
    if not 0.0 < low <= high or (over and low == high):
        shown = f"{path}=LOW:HIGH" if over else f"{option} LOW:HIGH"
        swapped = "; are the two swapped?" if low > high > 0.0 else ""
        text = f"expected a range above zero, LOW below HIGH: {shown}{swapped}"
        raise InputError(option, Complaint(path, repr(body), text))
    return low, high


LIMITS = {  # options of a choice that stand for a value of the scene, and its key
    "settling": "checks.settling_time.max",
    "rise": "checks.rise_time.max",
    "overshoot": "checks.overshoot.max",
    "noise": "checks.noise.max",
    "margin": "checks.stability.margin",
    "supply": "design.supply",
}


def range_values(key: Key, text: str, body: str, points: int) -> tuple[tuple[Value, ...], Scale]:
    """Return the values of ``LOW:HIGH:POINTS`` or ``A,B,C`` in base units, and their spacing."""
    if key.kind == "choice" or ":" not in body:
        try:
            return tuple(read_value(key, part.strip()) for part in body.split(",")), "list"
        except InputError as error:
            if key.kind == "choice":
                raise
            name = text.partition("=")[0].strip()
            text = f"{error.complaints[0].accepted}; a range has colons: {name}=LOW:HIGH:31"
            raise InputError("--over", replace(error.complaints[0], accepted=text)) from None
    parts = [part.strip() for part in body.split(":")]
    scale: Scale = "lin" if parts[-1] == "lin" else "log"
    if parts[-1] in ("lin", "log"):
        parts.pop()
    if len(parts) not in (2, 3):
        raise _wrong(text, "expected LOW:HIGH:POINTS, or LOW:HIGH:POINTS:lin for linear spacing")
    low, high = (float(read_value(key, part)) for part in parts[:2])
    if len(parts) == 3:
        # Python converts at most 4,300 digits.
        points = int(parts[2]) if parts[2].isdecimal() and len(parts[2]) < 9 else 0
        if not 2 <= points <= MAX_POINTS:
            accepted = f"expected a whole number from 2 to {MAX_POINTS}"
            raise _wrong(text, f"{parts[2]!r} points; {accepted}")
    if scale == "log" and min(low, high) <= 0.0:
        raise _wrong(text, "a logarithmic range must be above zero; append :lin for a linear one")
    if low == high:
        raise _wrong(text, f"both ends are {low!r}; expected one value, or two different ends")
    spaced = np.geomspace if scale == "log" else np.linspace
    grid = spaced(low, high, points).tolist()
    grid[0], grid[-1] = low, high
    if key.kind == "integer":
        return tuple(dict.fromkeys(round(value) for value in grid)), scale
    return tuple(grid), scale


def _default_axis(scene: Scene, key: Key, name: str, around: float, points: int) -> SweepAxis:
    value = own_value(scene, key)
    if value is None or not (math.isfinite(value) and value > 0.0):
        text = f"no range follows from the scene's value {value!r}; give {name}=LOW:HIGH"
        raise _wrong(name, text)
    values = []
    for each in np.geomspace(value / around, value * around, points).tolist():
        with suppress(InputError):  # what the key does not accept
            with_values(scene, {key.path: each})
            values.append(each)
    return SweepAxis(key, name, tuple(values), "log", default=True)


def with_values(scene: Scene, changes: Point) -> Scene:
    """Return `scene` with other values at dotted paths, validated like a scene from a file."""
    tables = {path for path in changes if any(other.startswith(f"{path}.") for other in changes)}
    if tables:
        scene = with_values(scene, {path: changes[path] for path in tables})
        changes = {path: value for path, value in changes.items() if path not in tables}
    data: dict[str, Any] = scene.model_dump(by_alias=True, exclude_unset=True)
    for path, value in changes.items():
        if path in REPLACES and REPLACES[path] not in changes:
            section, last = _section(data, REPLACES[path])
            section.pop(last, None)
        section, last = _section(data, path)
        section[last] = value
    asked = (*scene.written_questions, *kept_figures(scene, changes))
    return parse_scene(data, scene.file, asked=tuple(dict.fromkeys(asked)))


def kept_figures(scene: Scene, paths: Iterable[str]) -> Iterator[str]:
    """Yield which figures the op-amp keeps where the base is one of the changed `paths`, if any."""
    changed = {path.removeprefix(f"{OPAMP}.") for path in paths}
    kept = own_figures(scene.design.opamp) - changed
    if kept and "base" in changed:
        yield (
            f"another base of the op-amp: it keeps the scene's own {', '.join(sorted(kept))};"
            f" without them, as by --set {OPAMP}=NAME, every figure is the part's"
        )


def _section(data: dict[str, Any], path: str) -> tuple[dict[str, Any], str]:
    *sections, last = path.split(".")
    for name in sections:
        data = data.setdefault(name, {})
    return data, last


def _wrong(value: str, accepted: str) -> InputError:
    return InputError("--over", Complaint("values", repr(value), accepted))


Fixed = str | Iterable[str] | Mapping[str, Value | None]


def fixed_values(scene: Scene, fixed: Fixed) -> dict[str, Value]:
    """Return the fixed values by the dotted paths of their keys, or refuse a key or a value."""
    if isinstance(fixed, Mapping):
        texts = [name if value is None else f"{name}={value}" for name, value in fixed.items()]
    else:
        texts = [fixed] if isinstance(fixed, str) else list(fixed)
    with mistakes_of("--fix"):
        return dict(_fixed_value(scene, text) for text in texts)


def check_axes(groups: Sequence[Sequence[SweepAxis]], fixed: Mapping[str, Value]) -> None:
    """Refuse an axis that changes the engine, or a fixed key, or that replaces it."""
    for axis in (axis for group in groups for axis in group):
        path, text = axis.key.path, ""
        if path == ENGINE:
            raise InputError(
                "--over", Complaint(path, "", "give --engine, or sweep once with each")
            )
        if path in fixed:
            text = "the key has one value by --fix; leave out --over or --fix"
        elif (replaced := REPLACES.get(path)) in fixed:
            text = f"a value of this key replaces {replaced}, which --fix holds; leave out one"
        if text:
            raise InputError("--over", Complaint("key", repr(axis.name), text))


def _fixed_value(scene: Scene, text: str) -> tuple[str, Value]:
    name, equals, body = (part.strip() for part in text.partition("="))
    key = find_key(scene, name)
    value = read_value(key, body) if equals else own_value(scene, key)
    if value is None:
        complaint = Complaint("key", repr(name), f"the scene has no number here; give {name}=VALUE")
        raise InputError("--fix", complaint)
    return key.path, value


OPAMP = "design.opamp"  # a preset in the place of the table has its own figures alone


def with_settings(scene: Scene, settings: Iterable[str]) -> Scene:
    """Return `scene` with the values of texts ``KEY=VALUE``; the last one of a key wins.

    ``design.opamp=NAME`` replaces the whole op-amp by a preset, ``opamp=NAME`` only its base.
    """
    changes: dict[str, Value] = {}
    for text in settings:
        name, _, body = (part.strip() for part in text.partition("="))
        if not (name and body):
            accepted = "expected KEY=VALUE, such as C=12pF or lambda=0.5"
            raise InputError("--set", Complaint("setting", repr(text), accepted))
        if name == OPAMP:
            changes[OPAMP] = body
            continue
        with mistakes_of("--set"):
            key = find_key(scene, name)
            changes[key.path] = read_value(key, body)
    return tried(scene, changes, "--set")


PARTS = {"opamp", "gain", "unit_conductance"}
DEFAULT_PARTS = (
    "design.opamp, gain and unit_conductance are not given: the paper's board with a uA741, which"
    " its input errors move by more than most limits; `taction new --matrix T.csv --strain eps.csv`"
    " writes parts that work"
)


def questions(scene: Scene) -> tuple[str, ...]:
    """Return what may be a slip in a scene: in the way it is written, and in its values."""
    from taction.netlist_gen.topologies.frame.topology import topology_of  # it loads numpy

    design, topology = scene.design, topology_of(scene)
    found = [*scene.written_questions]
    for name in EXCURSIONS:
        check = getattr(scene.checks, name)
        if check is not None and check.max > 1.0:  # of the step: a percentage without its sign
            found.append(
                f"checks.{name}: max = {check.max:g} is {100.0 * check.max:g} % of the step; is it"
                f" a percentage? {check.max:g} % is {check.max / 100.0:g}"
            )
    if not PARTS & design.model_fields_set:
        found.append(DEFAULT_PARTS)
    unused = sorted(topology.unused & design.model_fields_set)
    found += [f"design.{key} has no effect with topology = {topology.name!r}" for key in unused]
    return tuple(found)
