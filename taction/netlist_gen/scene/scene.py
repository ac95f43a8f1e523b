"""`Scene`: problem, design, analysis and checks as frozen, validated values; `load_scene`."""

from __future__ import annotations

import functools
import re
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, PrivateAttr, model_validator

from taction.netlist_gen.scene.check_keys import Checks, Regression, Tolerances, unitless_times
from taction.netlist_gen.scene.design import Design, DevicesTable, OpAmpChoice, WiresTable
from taction.netlist_gen.scene.fields import Model, Positive, Real, Seconds, SecondsOrAuto, entry
from taction.netlist_gen.scene.mistakes import place, placed, toml_complaint, validated
from taction.netlist_gen.scene.open_tables import NAMES, plugged, with_tables
from taction.netlist_gen.scene.problem_keys import StatedProblem, in_memory
from taction.system.errors import Complaint, InputError, listed
from taction.system.foreign_files import MEGABYTE, UnusableFileError, read_text
from taction.system.quantities import number, quantity
from taction.system.results import Result

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

DEFAULT_RESISTANCE = 1.786e6
ENGINES = NAMES["engine"]
IN_MEMORY = "Scene.from_arrays"  # instead of the name of a file
MAX_BYTES = MEGABYTE
DEEPEST = 50  # parts of a dotted key
_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+"""
_DEEP = re.compile(rf"(?<![\w-])(?:{_PART}\.[ \t]*+){{{DEEPEST}}}")


class AnalysisChoice(Model):
    """How the board is analysed."""

    engine: Annotated[str, ENGINES] = "auto"
    stop: SecondsOrAuto = "auto"
    initial: Literal["zero", "rest"] = "zero"
    points_per_period: Annotated[Real, Field(ge=8, le=10_000)] | None = entry(
        None, "even steps of the fastest ringing; by default as many as 'error' needs"
    )
    error: Annotated[Positive, Field(lt=1)] | Literal["auto"] = entry(
        "auto", "of the transient, fraction of the step; auto: a quarter of the tightest limit"
    )
    timeout: Seconds = 600.0

    @model_validator(mode="after")
    def _one_resolution(self) -> Self:
        if self.error != "auto" and self.points_per_period is not None:
            text = "'error' excludes 'points_per_period', which follows from it"
            raise ValueError(text)
        return self


class Scene(StatedProblem, Result):
    """Problem, design, analysis and checks; file names are relative to `folder`."""

    # Its picture: the matrix with its signs, the strain, and the truth.
    VIEW: ClassVar[str] = "taction.verification.report.views.board_view:scene_view"
    CARD: ClassVar[str] = "Scene"

    design: Design = Design()
    wires: WiresTable = WiresTable()
    devices: DevicesTable = DevicesTable()
    analysis: AnalysisChoice = AnalysisChoice()
    checks: Checks = Checks()
    tolerances: Tolerances = Tolerances()
    regression: Regression = Regression()
    _lambda_rule: str = PrivateAttr("")
    _questions: tuple[str, ...] = PrivateAttr(())

    def __repr__(self) -> str:
        design, file = self.design, str(self.file)
        parts = (
            self.problem.size,
            f"C = {quantity(design.capacitance, 'F')}",
            f"gain = {quantity(design.gain, 'ohm')}",
            f"op-amp {opamp_words(design.opamp)}",
        )
        return f"Scene({self.name!r}, {', '.join(parts)}; {file!r})"

    def __str__(self) -> str:
        return repr(self)

    @classmethod
    def from_arrays(
        cls, T: ArrayLike, eps: ArrayLike, *, stress: ArrayLike | None = None, **values: Any
    ) -> Scene:
        """Make a scene from copies of a matrix and a strain in memory.

        Parameters
        ----------
        T : array_like (M, N)
            The matrix of ``eps = T u + noise``, dimensionless.
        eps : array_like (M,)
            The strain, dimensionless.
        stress : array_like (N,), optional
            The true u, if known.
        **values
            Keys of any table of the scene, with values as in a scene file: ``capacitance="10pF"``,
            ``opamp="lf353"``, ``variance=1e-4``; ``lam`` is the key ``lambda``. A table is a dict:
            ``settling_time={"max": "1ms"}``.

        Returns
        -------
        Scene
            Its `file` is ``Scene.from_arrays``.

        Raises
        ------
        InputError
            An unknown key (with the nearest known key), a value that its key does not accept, an
            array of a wrong shape, or an entry that is not finite.

        Examples
        --------
        >>> import taction
        >>> scene = taction.Scene.from_arrays([[1.0, 0.5], [0.5, 1.0]], [0.2, 0.1], gain="1M")
        >>> scene.design.gain
        1000000.0
        >>> try:
        ...     taction.Scene.from_arrays([[1.0]], [0.2], capacitanc="10pF")
        ... except taction.InputError as error:
        ...     print(error)
        Scene.from_arrays: capacitanc = '10pF': unknown key; did you mean 'capacitance'?
        """
        problem = {"kind": "matrix", "matrix": in_memory(T), "strain": in_memory(eps)}
        if stress is not None:
            problem["stress"] = in_memory(stress)
        data: dict[str, Any] = {"problem": problem}
        if complaints := placed(scene_type(), data, values):
            raise InputError(IN_MEMORY, *complaints)
        return parse_scene(data, IN_MEMORY)

    @property
    def agreement_limit(self) -> float:
        """Largest accepted difference of the two engines, fraction of the step amplitude."""
        check, error = self.checks.engines_agree, self.analysis.error
        if check.tolerance is not None or error == "auto":
            return check.limit
        return max(check.limit, error)

    @property
    def written_questions(self) -> tuple[str, ...]:
        """What may be a slip in the way that values are written; see `questions`."""
        return self._questions

    @property
    def lambda_rule(self) -> str:
        """The rule that chose lambda; empty if the scene has a number."""
        return self._lambda_rule

    def with_engine(self, engine: str) -> Scene:
        """Return the scene with another engine; InputError lists the known engines."""
        known = ENGINES.names
        if engine not in known:
            text = f"expected one of {listed(known)}"
            raise InputError(self.file, Complaint("analysis.engine", repr(engine), text))
        analysis = self.analysis.model_copy(update={"engine": engine})
        return self.model_copy(update={"analysis": analysis})

    def with_lambda(self, lam: float, rule: str) -> Scene:
        """Return the scene with the lambda that `rule` chose."""
        design = self.design.model_copy(update={"lam": lam})
        chosen = self.model_copy(update={"design": design})
        chosen._lambda_rule = rule
        return chosen


def scene_type() -> type[Scene]:
    """Return the type of scenes with the tables of installed plug-ins; `Scene` without any."""
    return _types().get("PluggedScene", Scene)  # type: ignore[return-value]


def scene_schema() -> dict[str, Any]:
    """Return the JSON schema of scene files.

    Returns
    -------
    dict
        All keys with their types, defaults and descriptions.

    Examples
    --------
    >>> import taction
    >>> "capacitance" in taction.scene_schema()["$defs"]["Design"]["properties"]
    True
    """
    return scene_type().model_json_schema(by_alias=True)


@functools.cache
def _types() -> dict[str, type[Model]]:
    """Return `Scene`, `Design` and `Checks` with the tables of plug-ins, those that have any."""
    parts: dict[str, type[Model]] = {
        "design": with_tables(Design, "taction.topologies", __name__),
        "checks": with_tables(Checks, "taction.checks", __name__),
    }
    if parts["design"] is Design and parts["checks"] is Checks:
        return {}
    fields = {name: (made, made()) for name, made in parts.items()}
    return {made.__qualname__: made for made in (plugged(Scene, __name__, fields), *parts.values())}


def __getattr__(name: str) -> type[Model]:
    """Return a type of `_types`, for pickle."""
    if name.startswith("Plugged") and name in (found := _types()):
        return found[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def parse_scene(
    data: Mapping[str, Any], file: str | Path, *, asked: tuple[str, ...] | None = None
) -> Scene:
    """Return the `data` of `file` as a scene; `asked`: its questions, if not as written."""
    scene = validated(scene_type(), data, file, written=asked is None)
    scene._file = Path(file)
    scene._questions = tuple(unitless_times(data)) if asked is None else asked
    return scene


def load_scene(path: str | Path) -> Scene:
    """Read and validate the scene at `path`.

    Raises
    ------
    InputError
        The file cannot be read, is not TOML, or is not a scene; `complaints` lists all mistakes.

    Examples
    --------
    >>> import taction
    >>> scene = taction.load_scene("scenes/paper-breadboard.toml")
    >>> scene.design.capacitance, scene.problem.channels
    (1e-11, 7)
    """
    path = Path(path)
    data, text = read_toml(path, "a scene file in TOML; `taction new` writes one")
    try:
        return parse_scene(data, path)
    except InputError as error:
        found = (replace(each, place=place(text, each.key)) for each in error.complaints)
        raise InputError(error.file, *found) from None


def read_toml(path: Path, accepted: str) -> tuple[dict[str, Any], str]:
    """Return the data of a file, and its text, or refuse it with what would be `accepted`."""
    try:
        text = read_text(path, MAX_BYTES)
        if _DEEP.search(text):  # tomllib takes quadratic time
            raise ValueError(f"a key of over {DEEPEST} parts")
        data = tomllib.loads(text, parse_float=lambda part: number(part.replace("_", "")))
        return data, text
    except UnusableFileError as error:
        raise InputError(path, Complaint("file", "", f"{error}; expected {accepted}")) from None
    except ValueError as error:  # no TOML, or an integer of over 4300 digits
        raise InputError(path, toml_complaint(text, error, accepted)) from None
    except RecursionError:
        text = f"nested too deeply; expected {accepted}"
        raise InputError(path, Complaint("TOML", "", text)) from None


def opamp_words(choice: OpAmpChoice) -> str:
    """Return the op-amp's name, and whether its figures are those of the preset."""
    return f"{choice.file or choice.base}{' (changed)' if own_figures(choice) else ''}"


def own_figures(choice: OpAmpChoice) -> set[str]:
    """Return the figures of an op-amp that are not those of its preset."""
    return choice.model_fields_set - {"base", "file", "model", "level", "input_errors"}
