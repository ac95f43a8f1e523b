"""The documents of commands that are no document of one verdict, in SI base units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal, cast

from taction.netlist_gen.board.opamp_choice import OpAmpFigures, StoredOpAmp
from taction.spice_models.opamp import OpAmp
from taction.spice_models.presets import Origin
from taction.system.documents import INLINE, OPTIONAL, Failure, Number, taken
from taction.verification.design.fresh_scene import NewScene
from taction.verification.design.scaling import Scaled
from taction.verification.report.documents.verdict import VerdictBody
from taction.verification.report.views.opamp_view import TITLES, stated_figures
from taction.verification.studies.decks.vendor_model import ImportedModel
from taction.verification.studies.scene_files import VerifiedFiles


@dataclass(frozen=True, slots=True)
class ExploreDocument:
    """``taction explore``: where the page is, with its secret."""

    address: str


ModelsDocument = dict[str, OpAmp]
"""``taction parts``: the figures of each preset, by its name; null or 0: the part has none."""


@dataclass(frozen=True, slots=True)
class StatedFigure:
    """A figure of a data sheet."""

    value: Number
    unit: str
    note: Annotated[str, {"note": "what the sheet says beside it, or how it was derived"}]
    source: Annotated[str, {"note": "title and revision of a document, derived, or assumed"}]
    guaranteed: Annotated[Number, {"note": "its limit at 25 degrees; null: none is known"}]
    guaranteed_source: str


@dataclass(frozen=True, slots=True)
class ShowDocument:
    """``taction parts show``: one op-amp."""

    name: str
    source: str
    external_part: str
    figures: dict[str, StatedFigure]

    @classmethod
    def of(cls, found: OpAmpFigures) -> ShowDocument:
        """Return the figures with their sources."""
        opamp, origins = found.opamp, found.origins
        limits, unknown = dict(opamp.guaranteed), Origin("", "", "")
        figures = {
            name: StatedFigure(
                value, TITLES[name][1], from_.note, from_.document, limits.get(name), from_.limit
            )
            for name, value in stated_figures(opamp).items()
            for from_ in (origins.get(name, unknown),)
        }
        return taken(cls, opamp, figures=figures)


@dataclass(frozen=True, slots=True)
class ImportDocument:
    """``taction parts import``: `file` is the file that was written.

    Of the figures the phase margin is in degrees and the rejection in dB; null: the netlist has no
    such limit, or `doubts` says why it was not measured.
    """

    DOCUMENT = (
        *("file", "taction_opamp = model.taction_opamp # version of the format of the file"),
        *("name = model.name", "subcircuit = model.subcircuit", "pins = model.pins"),
        "supply [V] = model.supply",
        "compensation [F] = model.compensation # capacitor between the two ports `comp`",
        *("figures = model.figures", "linear = model.linear"),
        "missing = model.missing # why there is no linear model",
        "doubts = model.doubts # why a figure was not measured",
    )

    file: str
    model: StoredOpAmp

    @staticmethod
    def of(found: ImportedModel) -> dict[str, Any]:
        """Return an imported model, without its netlist."""
        return {"file": found.file, **{k: v for k, v in found.model.items() if k != "netlist"}}


@dataclass(frozen=True, slots=True)
class WithoutVerdict:
    """A file without a verdict."""

    file: str
    outcome: Literal["bad input", "inconclusive", "not run"]
    error: Annotated[Failure | None, OPTIONAL] = None


@dataclass(frozen=True, slots=True)
class VerifyFilesDocument:
    """``taction verify`` with several scenes or a folder."""

    DOCUMENT = (
        *("outcome = files.outcome # the worst", "exit_status = files.exit_status"),
        *("interrupted = files.interrupted", "counts = files.count", "verdicts"),
    )

    files: VerifiedFiles

    @property
    def verdicts(self) -> tuple[VerdictBody | WithoutVerdict, ...]:
        """The documents, which are plain data already."""
        return cast(tuple[VerdictBody | WithoutVerdict, ...], self.files.documents)


@dataclass(frozen=True, slots=True)
class NewMatrixDocument:
    """``taction new FILE --matrix``: the scene, its scalings and its verdict."""

    file: str
    lambda_rule: str
    recognised: tuple[str, ...]
    scaling: Annotated[Scaled, INLINE]

    @classmethod
    def of(cls, found: NewScene) -> NewMatrixDocument | NewDocument:
        """Return a new scene, for a matrix with its verdict."""
        if found.scaled is None:
            return NewDocument(found.file)
        return cls(found.file, found.rule, found.notes, found.scaled)


@dataclass(frozen=True, slots=True)
class NewDocument:
    """``taction new FILE``."""

    file: str
