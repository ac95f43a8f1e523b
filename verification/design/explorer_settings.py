"""The present values of an exploration: the scene that has them, its command line, its file."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from taction.netlist_gen.scene.axes import OPAMP, with_values
from taction.netlist_gen.scene.inverse_problem import InverseProblem, make_problem
from taction.netlist_gen.scene.keys import Value
from taction.netlist_gen.scene.scene import Scene
from taction.netlist_gen.scene.writing import scene_text
from taction.system.errors import Complaint, InputError
from taction.system.quantities import parse
from taction.verification.design.explorer_controls import (
    GAIN,
    LAMBDA,
    VARIANCE,
    Control,
    controls,
)
from taction.verification.reference.ideal_answer import resolve_lambda

SUFFIX = ".toml"


@dataclass(frozen=True, eq=False)
class Start:
    """The scene at the beginning of an exploration.

    Attributes
    ----------
    scene : Scene
        Lambda is a number.
    problem : InverseProblem
        The problem of the scene.
    controls : tuple of Control
        The keys that may change.
    """

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
    """Values that differ from those of the scene.

    Attributes
    ----------
    values : mapping of str to float
        New values by the paths of controls.
    opamp : str
        A preset in the place of the scene's op-amp, or empty.
    """

    values: Mapping[str, float] = field(default_factory=dict)
    opamp: str = ""

    @classmethod
    def of(cls, start: Start, values: Mapping[str, float], opamp: str = "") -> Settings:
        """Keep the values that differ from those of the scene."""
        own = {control.path: control.own for control in start.controls}
        changed = {path: float(v) for path, v in values.items() if float(v) != own[path]}
        return cls(changed, opamp)

    def changes(self, start: Start) -> dict[str, Value]:
        """Return what to change in the scene.

        Lambda stays when the gain moves, and when a rule would choose another one.
        """
        changed: dict[str, Value] = dict(self.values)
        if self.opamp:
            changed[OPAMP] = self.opamp
        if changed and (GAIN in changed or start.scene.lambda_rule):
            changed.setdefault(LAMBDA, start.control(LAMBDA).own)
        return changed

    def scene(self, start: Start) -> Scene:
        """Return the scene with these values.

        Raises
        ------
        InputError
            A value that its key does not accept.
        """
        changed = self.changes(start)
        return with_values(start.scene, changed) if changed else start.scene

    def problem(self, start: Start, scene: Scene) -> InverseProblem:
        """Return the problem of `scene`, made anew only where the noise differs."""
        return make_problem(scene) if VARIANCE in self.values else start.problem

    def command(self, start: Start) -> str:
        """Return the command line that verifies these values.

        Examples
        --------
        >>> from taction.netlist_gen.scene.scene import load_scene
        >>> start = Start.of(load_scene("scenes/paper-breadboard.toml"))
        >>> Settings({"design.capacitance": 2e-11}).command(start)
        'taction verify scenes/paper-breadboard.toml --set design.capacitance=2e-11'
        """
        words = ["taction", "verify", str(start.scene.file)]
        for path, value in self.changes(start).items():
            words += ["--set", f"{path}={value if isinstance(value, str) else repr(value)}"]
        return shlex.join(words)

    def save(self, start: Start, name: str) -> Path:
        """Write the scene with these values beside the scene's own file, and return the new file.

        Raises
        ------
        InputError
            `name` is no plain name that ends with ``.toml``, the file exists, or it cannot be
            written.
        """
        if Path(name).name != name or not name.endswith(SUFFIX) or name == SUFFIX:
            text = f"expected the name of a new file that ends with {SUFFIX!r}, without a folder"
            raise InputError("save", Complaint("file", repr(name), text))
        file = start.scene.folder / name
        try:
            with file.open("x", encoding="utf-8") as stream:
                stream.write(scene_text(self.scene(start), start.scene.folder))
        except FileExistsError:
            text = "the file exists, and stays as it is; expected the name of a new file"
            raise InputError("save", Complaint("file", repr(name), text)) from None
        except (OSError, ValueError) as error:
            raise InputError("save", Complaint("file", repr(name), str(error))) from None
        return file


def read_value(control: Control, text: str) -> float:
    """Return the value that a user typed for a control, in its unit.

    Raises
    ------
    InputError
        The text is no value in the unit of the control.

    Examples
    --------
    >>> read_value(Control("design.capacitance", "F", "C", "", 1e-12, 1e-9, 1e-11), "12 pF")
    1.2e-11
    """
    try:
        return parse(text.strip(), control.unit) if control.unit else _plain(text)
    except ValueError as error:
        raise InputError("explore", Complaint(control.path, repr(text[:40]), str(error))) from None


def _plain(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise ValueError("expected a plain number") from None
    if not abs(value) < float("inf"):
        raise ValueError("expected a finite number")
    return value
