"""The settings of an exploration: the keys that the page changes, and their present values.

The settings give the scene that has them, its command line, and its file.
"""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from taction.netlist_gen.scene.axes import OPAMP, with_values
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.keys import Value, find_key, own_value, scene_text
from taction.netlist_gen.scene.problem_keys import MOST_NAME, NAME_PATTERN
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.topologies.frame.topology import topology_of
from taction.system.errors import Complaint, InputError
from taction.system.quantities import EXAMPLES, number, parse
from taction.verification.design.trials import moves_lambda
from taction.verification.reference.lambda_rule import resolve_lambda

LAMBDA, STRAY, VARIANCE = "design.lambda", "design.stray_capacitance", "problem.noise.variance"
AROUND, AROUND_LAMBDA = 30.0, 1000.0  # times and divided by the scene's value
LEAST_STRAY, MOST_STRAY = 1e-14, 1e-10  # F
LEAST_NOISE, MOST_NOISE = 1e-8, 1.0  # variance, of the mean square of the strain
STEPS, DIGITS = 1000, 4  # places of a slider, and digits of their values
ZERO_PART = 0.04  # of a slider whose value may be zero: its lower end

SUFFIX = ".toml"


@dataclass(frozen=True, slots=True)
class Control:
    """A key with a logarithmic slider; all values are in `unit`, which a plain number has not."""

    path: str
    unit: str
    symbol: str  # on the page, as the name
    name: str
    low: float  # ends of the slider
    high: float
    own: float  # the scene's value
    has_zero: bool = False  # the lower end of the slider is zero

    def chosen(self, place: float) -> float:
        """Return the value that a hand means at a place: of four digits, or the scene's own."""
        if abs(place - self.place(self.own)) < 0.5 / STEPS:
            return self.own
        return float(f"{self.value(place):.{DIGITS}g}")

    def value(self, place: float) -> float:
        """Return the value at a place of the slider from 0 to 1."""
        start = ZERO_PART if self.has_zero else 0.0
        if place < start or (self.has_zero and place == 0.0):
            return 0.0
        share = min((place - start) / (1.0 - start), 1.0)
        return self.high if share == 1.0 else self.low * (self.high / self.low) ** share

    def place(self, value: float) -> float:
        """Return the place of a value on the slider, from 0 to 1; the nearest end outside of it."""
        if value <= 0.0:
            return 0.0
        start = ZERO_PART if self.has_zero else 0.0
        share = math.log(value / self.low) / math.log(self.high / self.low)
        return round(start + (1.0 - start) * min(max(share, 0.0), 1.0), 12)


def controls(scene: Scene, problem: InverseProblem) -> tuple[Control, ...]:
    """Return the controls of a scene whose lambda is a number."""
    topology = topology_of(scene)
    facts = topology.facts(scene)
    found = []
    for knob in (knob for knob in topology.knobs(scene) if knob.margin):
        name = knob.key.rpartition(".")[2].replace("_", " ")
        found.append(_control(scene, knob.key, facts[knob.name].symbol, name, AROUND))
    if facts["lambda"].value > 0.0:
        found.append(_control(scene, LAMBDA, "λ", "regularisation", AROUND_LAMBDA))
    strain = float(np.mean(problem.strain**2)) or 1.0
    for path, symbol, name, low, high in (
        (STRAY, "stray", "capacitance", LEAST_STRAY, MOST_STRAY),
        (VARIANCE, "σ²", "strain noise variance", LEAST_NOISE * strain, MOST_NOISE * strain),
    ):
        control = _control(scene, path, symbol, name, 10.0)
        if control.own > 0.0:
            low, high = min(low, control.low), max(high, control.high)
        found.append(replace(control, low=low, high=high, has_zero=True))
    return tuple(found)


def _control(scene: Scene, path: str, symbol: str, name: str, around: float) -> Control:
    key = find_key(scene, path)
    own = float(own_value(scene, key) or 0.0)
    return Control(path, key.unit, symbol, name, own / around, own * around, own)


@dataclass(frozen=True, eq=False)
class Start:
    """The scene at the beginning of an exploration, lambda a number, and the keys that change."""

    scene: Scene
    problem: InverseProblem
    controls: tuple[Control, ...]

    @classmethod
    def of(cls, scene: Scene) -> Start:
        """Begin with a scene; raises `InputError` and `SolverError` as `resolve_lambda`."""
        scene = resolve_lambda(scene)
        problem = make_problem(scene)
        return cls(scene, problem, controls(scene, problem))

    def control(self, path: str) -> Control:
        """Return the control of a key; raises `InputError` for a key without one."""
        known = {control.path: control for control in self.controls}
        if path not in known:
            text = f"expected one of {', '.join(known)}"
            raise InputError("explore", Complaint("key", repr(path), text))
        return known[path]


@dataclass(frozen=True, slots=True)
class Settings:
    """Values that differ from those of the scene, by the paths of controls, and a preset."""

    values: Mapping[str, float] = field(default_factory=dict)
    opamp: str = ""  # empty: the scene's op-amp

    @classmethod
    def of(cls, start: Start, values: Mapping[str, float], opamp: str = "") -> Settings:
        """Keep the values that differ from those of the scene."""
        own = {control.path: control.own for control in start.controls}
        changed = {path: float(v) for path, v in values.items() if float(v) != own[path]}
        return cls(changed, opamp)

    def changes(self, start: Start) -> dict[str, Value]:
        """Return what to change in the scene.

        Lambda stays when a knob would change it, and when a rule would choose another one.
        """
        changed: dict[str, Value] = dict(self.values)
        if self.opamp:
            changed[OPAMP] = self.opamp
        if changed and (moves_lambda(start.scene, changed) or start.scene.lambda_rule):
            changed.setdefault(LAMBDA, start.control(LAMBDA).own)
        return changed

    def scene(self, start: Start) -> Scene:
        """Return the scene with these values; raises `InputError` for one that its key refuses."""
        changed = self.changes(start)
        return with_values(start.scene, changed) if changed else start.scene

    def problem(self, start: Start, scene: Scene) -> InverseProblem:
        """Return the problem of `scene`, made anew only where the noise differs."""
        return make_problem(scene) if VARIANCE in self.values else start.problem

    def command(self, start: Start) -> str:
        """Return the command line that verifies these values."""
        words = ["taction", "verify", str(start.scene.file)]
        for path, value in self.changes(start).items():
            words += ["--set", f"{path}={value if isinstance(value, str) else repr(value)}"]
        return shlex.join(words)

    def save(self, start: Start, name: str) -> Path:
        """Write the scene with these values beside the scene's own file, and return the new file.

        InputError: `name` is no plain name that ends with ``.toml``, the file exists, or it cannot
          be written.
        """

        def refused(reason: str) -> InputError:
            return InputError("save", Complaint("file", repr(name), reason))

        stem = name.removesuffix(SUFFIX)
        plain = re.fullmatch(NAME_PATTERN, stem) and len(stem) <= MOST_NAME
        if not name.endswith(SUFFIX) or not plain:
            raise refused(
                f"expected the name of a new file that ends with {SUFFIX!r}, without a folder, as"
                f" scenes have it: letters, digits, '.', '_' and '-', {MOST_NAME} at most"
            )
        file = start.scene.folder / name
        try:
            with file.open("x", encoding="utf-8") as stream:
                stream.write(scene_text(self.scene(start), start.scene.folder))
        except FileExistsError:
            text = "the file exists, and stays as it is; expected the name of a new file"
            raise refused(text) from None
        except (OSError, ValueError) as error:
            raise refused(str(error)) from None
        return file


def read_value(control: Control, text: str) -> float:
    """Return the value that a user typed for a control, in its unit.

    InputError: the text is no value in the unit of the control, or a number without a unit: of a
      field that shows pF, nobody can say what 10 means.

    Examples
    --------
    >>> read_value(Control("design.capacitance", "F", "C", "", 1e-12, 1e-9, 1e-11), "12 pF")
    1.2e-11
    """
    try:
        value = parse(text.strip(), control.unit) if control.unit else _plain(text)
        if control.unit and value != 0.0 and text.strip()[-1] in "0123456789.":
            like = EXAMPLES[control.unit]
            raise ValueError(
                f"the unit is missing; expected a value with its unit, such as {like!r}"
            )
        return value
    except ValueError as error:
        raise InputError("explore", Complaint(control.path, repr(text[:40]), str(error))) from None


def _plain(text: str) -> float:
    with suppress(ValueError):
        if math.isfinite(value := number(text)):
            return value
    raise ValueError("expected a plain, finite number")
