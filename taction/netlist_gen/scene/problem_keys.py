"""The problem of a scene: a tactile sensor, or a matrix and strain as arrays or names of files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BeforeValidator, Field, PrivateAttr, ValidationInfo, field_validator
from pydantic_core import CoreSchema, core_schema

from taction.netlist_gen.scene import fields
from taction.netlist_gen.scene.fields import entry
from taction.system.quantities import sizes

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from taction.system.array_types import Floats


EXPECTED = "expected the name of a file, or an array of real numbers: rows of one length"


def in_memory(values: ArrayLike) -> Any:
    """Return `values` as an array, if possible, for a field `ArrayOrFile`."""
    import numpy as np

    try:
        return np.asarray(values)
    except ValueError:  # rows of different lengths
        return values


def fitted(values: Floats, shape: tuple[int | None, ...]) -> Floats:
    """Return `values` with the dimensions of `shape`, where None stands for any length.

    A vector may be a row or a column. ValueError: another shape, no entry, or one that is not
    finite.
    """
    import numpy as np

    if len(shape) == 1 and values.ndim == 2 and 1 in values.shape:
        values = values.ravel()
    if len(shape) == 2 and values.ndim == 1:
        values = values[None, :]
    if values.size == 0:
        shown = " x ".join(map(str, values.shape))
        raise ValueError(f"no numbers (shape {shown}); expected {_words(shape)}")
    fits = values.ndim == len(shape) and all(
        expected in (None, length) for expected, length in zip(shape, values.shape, strict=True)
    )
    if not fits:
        raise ValueError(f"shape {' x '.join(map(str, values.shape))}; expected {_words(shape)}")
    bad = np.argwhere(~np.isfinite(values))
    if bad.size:
        place = ", ".join(str(i + 1) for i in bad[0])
        raise ValueError(f"entry ({place}) is not finite")
    return values


def _words(shape: tuple[int | None, ...]) -> str:
    """Return the expected shape: its lengths, or what it is where these may be any."""
    if all(length is None for length in shape):
        return "rows of numbers" if len(shape) > 1 else "a column of numbers"
    return " x ".join("any" if length is None else str(length) for length in shape)


class _NameOrArray(fields.Checked):
    """Annotation of a field: the name of a file, or an array of real numbers."""

    def check(self, value: object) -> Any:
        """Return the name, or a read-only copy of the array."""
        if isinstance(value, str) and value:
            return value
        if isinstance(value, list):  # in a TOML file
            value = _from_lists(value)
        if getattr(getattr(value, "dtype", None), "kind", "") in ("i", "u", "f"):
            import numpy as np

            copy = np.array(value, dtype=np.float64, order="C")
            copy.setflags(write=False)
            return copy
        raise ValueError(EXPECTED)

    def __get_pydantic_core_schema__(self, source: object, handler: object) -> CoreSchema:
        written = core_schema.plain_serializer_function_ser_schema(
            lambda value: value if isinstance(value, str) else value.tolist(), when_used="json"
        )
        return core_schema.no_info_plain_validator_function(self.check, serialization=written)

    def described(self) -> dict[str, Any]:
        """Return the schema of both."""
        numbers = {"type": "array", "items": {"type": "number"}, "minItems": 1}
        rows = {"type": "array", "items": numbers, "minItems": 1}
        return {"anyOf": [{"type": "string", "minLength": 1}, numbers, rows]}


def _from_lists(values: list[Any]) -> Any:
    """Return numbers, or rows of numbers of one length, as an array; ValueError for others."""
    import numpy as np

    rows = values if all(isinstance(row, list) for row in values) else [values]
    flat = [number for row in rows for number in row]
    numbers = all(isinstance(x, (int, float)) and not isinstance(x, bool) for x in flat)
    if not numbers or len({len(row) for row in rows}) != 1:
        raise ValueError(EXPECTED)
    try:
        return np.array(values, dtype=np.float64)
    except OverflowError:
        raise ValueError(f"a number is out of range; {EXPECTED}") from None


ArrayOrFile = Annotated[Any, _NameOrArray()]


NAME_PATTERN = r"^[A-Za-z0-9_.-]+$"
MOST_NAME = 64  # characters


class CylinderLoad(fields.Model):
    """Stress under a cylinder, eq (18): ``p/(pi a²) sqrt(a² - y²)`` as printed."""

    kind: Literal["cylinder"] = "cylinder"
    force: fields.NonNegative = entry(3.0, "p, force per unit length")
    half_width: fields.Positive = entry(1.0, "a, half width of the contact")
    centre: fields.Real = entry(0.0, "y of the contact's middle")
    normalised: fields.Flag = entry(False, "true: Hertz, 2p/(pi a²), integrates to p")


class CsvLoad(fields.Model):
    """Stress profile from a CSV file beside the scene: columns y and stress."""

    kind: Literal["csv"]
    file: fields.FileName = Field(description="CSV with two columns, y and stress; y increasing")


class Noise(fields.Model):
    """Gaussian noise added to the strain."""

    variance: fields.NonNegative = 0.0
    seed: fields.Seed = 1


def _cylinder_by_default(value: object) -> object:
    return {"kind": "cylinder", **value} if isinstance(value, dict) else value


AnyLoad = Annotated[CylinderLoad | CsvLoad, Field(discriminator="kind")]


class TactileProblem(fields.Model):
    """Strain under an elastic layer, eqs (1) to (4), with the corrected kernels."""

    kind: Literal["tactile"]
    channels: fields.Count = entry(7, "N, points where stress is reconstructed")
    sensors: fields.Count | None = entry(None, "M, where it differs from N")
    span: fields.Positive = entry(6.0, "y_max - y_min, in the unit of depth")
    depth: fields.Positive = entry(1.0, "x")
    modulus: fields.Positive = entry(1.0, "E")
    poisson: Annotated[fields.Real, Field(ge=-1.0, le=0.5)] = entry(0.5, "nu")
    kernel: Literal["normal", "tangential"] = "normal"
    quadrature: Literal["none", "rectangle"] = entry("none", "rectangle: times the spacing")
    load: Annotated[AnyLoad, BeforeValidator(_cylinder_by_default)] = CylinderLoad()
    noise: Noise = Noise()

    @property
    def size(self) -> str:
        """Channels and sensors in words."""
        return sizes(self.channels, self.sensors or self.channels)


class MatrixProblem(fields.Model):
    """A matrix and a strain vector: names of files beside the scene, or arrays of numbers."""

    kind: Literal["matrix"]
    matrix: ArrayOrFile = Field(
        description="M rows, N columns: [[1.0, 0.2], [0.2, 1.0]], or a file .csv or .npy"
    )
    strain: ArrayOrFile = Field(description="M values: [1.0, 0.5], or a file .csv or .npy")
    stress: ArrayOrFile | None = entry(None, "N values, the truth, where it is known")
    noise: Noise = Noise()

    @property
    def size(self) -> str:
        """Channels and sensors in words, or the name of the file that has them."""
        in_file = isinstance(self.matrix, str)
        return f"matrix {self.matrix!r}" if in_file else sizes(*reversed(self.matrix.shape))

    @field_validator("matrix", "strain", "stress")
    @classmethod
    def _fits(cls, value: Any, info: ValidationInfo) -> Any:
        """Check arrays in memory; arrays in files are checked when they are read."""
        if value is None or isinstance(value, str):
            return value
        matrix = info.data.get("matrix")
        rows, columns = (None, None) if matrix is None or isinstance(matrix, str) else matrix.shape
        shapes = {"matrix": (None, None), "strain": (rows,), "stress": (columns,)}
        return fitted(value, shapes[str(info.field_name)])

    def __eq__(self, other: object) -> bool:
        return isinstance(other, MatrixProblem) and self._content() == other._content()

    def __hash__(self) -> int:
        return hash(self._content())

    def _content(self) -> tuple[object, ...]:
        arrays = (self.matrix, self.strain, self.stress)
        plain = (a if a is None or isinstance(a, str) else (a.shape, a.tobytes()) for a in arrays)
        return (*plain, self.noise)


class StatedProblem(fields.Model):
    """The part of a scene that states its problem; file names are relative to `folder`."""

    name: Annotated[str, Field(pattern=NAME_PATTERN, max_length=MOST_NAME)] = "scene"
    problem: Annotated[TactileProblem | MatrixProblem, Field(discriminator="kind")] = Field(
        description="a table with kind = 'tactile' or 'matrix'"
    )
    _file: Path = PrivateAttr(Path("scene.toml"))

    @property
    def file(self) -> Path:
        """File of the scene."""
        return self._file

    @property
    def folder(self) -> Path:
        """Folder of the scene file."""
        return self._file.parent
