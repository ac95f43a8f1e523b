"""The problem of a scene: a tactile sensor, or a given matrix and strain."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BeforeValidator,
    Field,
    PrivateAttr,
    StrictBool,
    ValidationInfo,
    field_validator,
)

from taction.netlist_gen.scene.arrays import ArrayOrFile, fitted
from taction.netlist_gen.scene.fields import (
    Count,
    FileName,
    Model,
    NonNegative,
    Positive,
    Real,
    Seed,
)

NAME_PATTERN = r"^[A-Za-z0-9_.-]+$"


class CylinderLoad(Model):
    """Stress under a cylinder, eq (18): ``p/(pi a²) sqrt(a² - y²)`` as printed."""

    kind: Literal["cylinder"] = "cylinder"
    force: NonNegative = Field(3.0, description="p, force per unit length")
    half_width: Positive = Field(1.0, description="a, half width of the contact")
    centre: Real = Field(0.0, description="y of the contact's middle")
    normalised: StrictBool = Field(False, description="true: Hertz, 2p/(pi a²), integrates to p")


class CsvLoad(Model):
    """Stress profile from a CSV file beside the scene: columns y and stress."""

    kind: Literal["csv"]
    file: FileName = Field(description="CSV with two columns, y and stress; y increasing")


class Noise(Model):
    """Gaussian noise added to the strain."""

    variance: NonNegative = 0.0
    seed: Seed = 1


def _cylinder_by_default(value: object) -> object:
    """Add the default kind to a load without a kind."""
    return {"kind": "cylinder", **value} if isinstance(value, dict) else value


AnyLoad = Annotated[CylinderLoad | CsvLoad, Field(discriminator="kind")]


class TactileProblem(Model):
    """Strain under an elastic layer, eqs (1) to (4), with the corrected kernels."""

    kind: Literal["tactile"]
    channels: Count = Field(7, description="N, points where stress is reconstructed")
    sensors: Count | None = Field(None, description="M, where it differs from N")
    span: Positive = Field(6.0, description="y_max - y_min, in the unit of depth")
    depth: Positive = Field(1.0, description="x")
    modulus: Positive = Field(1.0, description="E")
    poisson: Annotated[Real, Field(ge=-1.0, le=0.5)] = Field(0.5, description="nu")
    kernel: Literal["normal", "tangential"] = "normal"
    quadrature: Literal["none", "rectangle"] = Field(
        "none", description="none: as eq (4) is printed; rectangle: times the spacing"
    )
    load: Annotated[AnyLoad, BeforeValidator(_cylinder_by_default)] = CylinderLoad()
    noise: Noise = Noise()


class MatrixProblem(Model):
    """A matrix and a strain vector: names of files beside the scene, or arrays of numbers."""

    kind: Literal["matrix"]
    matrix: ArrayOrFile = Field(
        description="M rows, N columns: [[1.0, 0.2], [0.2, 1.0]], or a file .csv or .npy"
    )
    strain: ArrayOrFile = Field(description="M values: [1.0, 0.5], or a file .csv or .npy")
    stress: ArrayOrFile | None = Field(None, description="N values, the truth, where it is known")
    noise: Noise = Noise()

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


class StatedProblem(Model):
    """The part of a scene that states its problem; file names are relative to `folder`."""

    name: Annotated[str, Field(pattern=NAME_PATTERN, max_length=64)] = "scene"
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
