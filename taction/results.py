"""What the public functions return, where this is more than the result of one study.

The pictures and pages are reports, and the studies that make the results must not import reports.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taction.netlist_gen.board.bill_of_materials import BillOfMaterials
from taction.netlist_gen.deck.deck import Deck
from taction.netlist_gen.kicad.project import Project
from taction.verification.studies.onset import onset
from taction.verification.studies.sweep import result
from taction.verification.studies.tolerance import corners, yield_report
from taction.verification.studies.tolerance.varied_board import BoardSample
from taction.verification.verdict import recording
from taction.verification.verdict.board_power import BoardPower

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from taction.netlist_gen.board.circuit import Circuit
    from taction.netlist_gen.scene.scene import Scene
    from taction.spice_models.opamp import OpAmp
    from taction.verdict import Verdict
    from taction.verification.characterise.witnesses import Witness
    from taction.verification.design.choose import Confirmation, Design
    from taction.verification.design.fresh_scene import FreshScene
    from taction.verification.design.scaling import Scaling
    from taction.verification.design.tune import Tuning
    from taction.verification.verdict.pruning import Pruning


@dataclass(frozen=True, slots=True)
class Netlist(Deck):
    """The deck of a scene, with its board.

    Attributes
    ----------
    circuit : Circuit
        The board; `omissions` are the parts that the scene does not need.
    warnings : tuple of str
        Values that cannot be bought, or that the layout undoes.
    pruning : Pruning or None
        What pruning changes and saves; None unless asked for, or without pruning.
    written : tuple of str
        The files that were written.
    """

    circuit: Circuit = field(kw_only=True, repr=False)
    warnings: tuple[str, ...] = field(default=(), repr=False)
    pruning: Pruning | None = field(default=None, repr=False)
    written: tuple[str, ...] = field(default=(), repr=False)

    @classmethod
    def of(cls, deck: Deck, **more: Any) -> Netlist:
        """Return `deck` with the other attributes `more`."""
        return cls(**{each.name: getattr(deck, each.name) for each in fields(deck)}, **more)


@dataclass(frozen=True, slots=True)
class PartsList:
    """The parts of a board to buy, and its power at rest."""

    scene: Scene = field(repr=False)
    parts: BillOfMaterials = field(repr=False)
    power: BoardPower


@dataclass(frozen=True, slots=True)
class KicadProject:
    """The drawing of a channel, and the files that were written."""

    scene: Scene = field(repr=False)
    project: Project = field(repr=False)
    written: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Simulated(recording.MeasuredTransient):
    """The results of `taction.simulate`: waveforms, measurements, and the file, if there is one."""

    output: str | None = None

    @classmethod
    def of(cls, record: recording.MeasuredTransient, output: str | Path | None) -> Simulated:
        """Return `record` with the file of its waveforms."""
        values = {each.name: getattr(record, each.name) for each in fields(record)}
        return cls(**values, output=None if output is None else str(output))


class Onset(onset.Onset):
    """The results of `taction.onset`: every crossing of a scene over one axis."""

    __slots__ = ()

    @classmethod
    def of(cls, found: onset.Onset) -> Onset:
        """Return `found` with its picture."""
        return cls(*(getattr(found, each.name) for each in fields(found)))

    @property
    def outcome(self) -> str:
        """``pass``, or ``inconclusive`` if a transient contradicts a crossing."""
        return "inconclusive" if self.disagreement else "pass"

    def plot(self, path: str | Path | None = None) -> Figure:
        """Return the picture of ``onset --plot``: the pole map and the root locus.

        Parameters
        ----------
        path : path, optional
            Write the picture into this file: ``.png``, ``.svg`` or ``.pdf``.

        Raises
        ------
        InputError
            The picture cannot be written, or matplotlib is missing (``taction[plot]``).
        """
        from taction.verification.report.renderers.picture import draw_page
        from taction.verification.report.views.onset import view

        return draw_page(view(self), path)


@dataclass(frozen=True, slots=True, repr=False)
class YieldReport(yield_report.YieldReport):
    """The results of `taction.montecarlo`: the yield, its interval, and what is behind it.

    Attributes
    ----------
    scene : Scene
        The board.
    boards : tuple of BoardSample
        The samples, in the order of their numbers.
    seed : int
        Of the samples.
    min_yield : float or None
        Smallest yield that passes.
    complete : bool
        Whether all samples were drawn; False after Ctrl-C.
    """

    scene: Scene = field(kw_only=True, compare=False)
    boards: tuple[BoardSample, ...] = field(default=(), compare=False)
    seed: int = 1
    min_yield: float | None = None
    complete: bool = True

    @classmethod
    def of(cls, report: yield_report.YieldReport, **more: Any) -> YieldReport:
        """Return `report` with the other attributes `more`."""
        values = {each.name: getattr(report, each.name) for each in fields(report)}
        return cls(**values | more)

    @property
    def study(self) -> yield_report.YieldReport:
        """The figures alone."""
        known = fields(yield_report.YieldReport)
        return yield_report.YieldReport(**{each.name: getattr(self, each.name) for each in known})

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self.scene.name

    @property
    def outcome(self) -> str:
        """Whether the whole interval of the yield lies above `min_yield`, or below it."""
        if self.min_yield is None or self.low >= self.min_yield:
            return "pass"
        return "fail" if self.high < self.min_yield else "inconclusive"

    def _repr_html_(self) -> str:
        """Return the yield as a card for a notebook."""
        from taction.verification.report.renderers.notebook import card
        from taction.verification.report.views.montecarlo import view

        return card(view(self.scene, self, self.boards, self.seed), "Yield")

    def plot(self, path: str | Path | None = None) -> Figure:
        """Return the picture of ``montecarlo --plot``: histograms with limits, and culprits.

        Parameters
        ----------
        path : path, optional
            Write the picture into this file: ``.png``, ``.svg`` or ``.pdf``.

        Raises
        ------
        InputError
            The picture cannot be written, or matplotlib is missing (``taction[plot]``).
        """
        from taction.verification.report.renderers.picture import draw_page
        from taction.verification.report.views.montecarlo import view

        return draw_page(view(self.scene, self, self.boards, self.seed), path)


class SweepResult(result.SweepResult):
    """The results of `taction.sweep`: every point, with its pictures and its report."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        """Return the sweep as a card for a notebook."""
        from taction.verification.report.renderers.notebook import card
        from taction.verification.report.views.sweep import view

        return card(view(self), "Sweep")

    def plot(self, path: str | Path | None = None) -> Figure:
        """Return maps over two axes, curves over one, or small maps over three.

        Parameters
        ----------
        path : path, optional
            Write the picture into this file: ``.png``, ``.svg`` or ``.pdf``.

        Raises
        ------
        InputError
            More than three axes, the picture cannot be written, or matplotlib is missing
            (``taction[plot]``).
        """
        from taction.verification.report.renderers.picture import draw_page
        from taction.verification.report.views.sweep import view

        return draw_page(view(self), path)

    def report(self, path: str | Path) -> None:
        """Write a report as one HTML file: outcomes, maps or curves, and the points.

        Raises
        ------
        InputError
            The name does not end in ``.html``, the file cannot be written, or a package of
            ``taction[report]`` is missing.
        """
        from taction.verification.report.renderers.page import write_page
        from taction.verification.report.views.sweep import view

        write_page(view(self), str(path))


@dataclass(frozen=True, slots=True)
class VerifiedSample:
    """One sample of a Monte Carlo study in full: the verdict, and the sample as the study has it.

    Attributes
    ----------
    deviations : mapping of str to float
        Of each part, in units of its tolerance.
    """

    verdict: Verdict
    sample: BoardSample
    seed: int
    deviations: Mapping[str, float] = field(repr=False)

    @property
    def outcome(self) -> str:
        """The outcome of the verdict."""
        return str(self.verdict.outcome.value)


@dataclass(frozen=True, slots=True, repr=False)
class CornerStudy(corners.CornerStudy):
    """The results of `taction.corners`: verified corners of a scene, and worst directions."""

    scene: Scene = field(kw_only=True)

    @property
    def outcome(self) -> str:
        """``fail`` if a corner fails, else ``inconclusive`` if one has no verdict."""
        outcomes = {corner.result.outcome for corner in self.corners}
        bad = "fail" if "fail" in outcomes else "inconclusive"
        return "pass" if outcomes == {"pass"} else bad


@dataclass(frozen=True, slots=True)
class Tuned:
    """The results of `taction.tune`: the search, and the verdict of the best design."""

    tuning: Tuning = field(repr=False)
    verdict: Verdict
    reach: float

    @property
    def outcome(self) -> str:
        """The outcome of the verdict."""
        return str(self.verdict.outcome.value)


@dataclass(frozen=True, slots=True)
class Scaled:
    """The results of `taction.scale`: the scalings, and the verdict of the board with them."""

    scaling: Scaling = field(repr=False)
    verdict: Verdict

    @property
    def outcome(self) -> str:
        """The outcome of the verdict."""
        return str(self.verdict.outcome.value)


@dataclass(frozen=True, slots=True)
class Choice:
    """The results of `taction.choose`.

    Attributes
    ----------
    scene : Scene
        The scene as it was.
    designs : sequence of Design
        All designs of the grid, the best first.
    best : sequence of Design
        Those that ngspice has verified.
    confirmations : sequence of Confirmation
        What ngspice says about each of them.
    scenes : sequence of Scene
        The scene of each of them.
    written : mapping of int to str
        Their files by place of the grid.
    """

    scene: Scene = field(repr=False)
    designs: Sequence[Design] = field(repr=False)
    best: Sequence[Design] = field(repr=False)
    confirmations: Sequence[Confirmation] = field(repr=False)
    scenes: Sequence[Scene] = field(repr=False)
    written: Mapping[int, str]

    @property
    def outcome(self) -> str:
        """``pass`` if ngspice contradicts not every one of the best, else ``fail``."""
        said = self.confirmations
        outcomes = {"pass" if c.outcome is None else c.outcome.value for c in said}
        return next((name for name in ("pass", "inconclusive") if name in outcomes), "fail")


@dataclass(frozen=True, slots=True)
class NewScene:
    """The results of `taction.new`: the files, and for a matrix the scaling and the verdict."""

    file: str
    written: tuple[str, ...]
    fresh: FreshScene | None = field(default=None, repr=False)
    scaled: Scaled | None = None

    @property
    def outcome(self) -> str:
        """The outcome of the verdict; ``pass`` without a matrix."""
        return "pass" if self.scaled is None else self.scaled.outcome


@dataclass(frozen=True, slots=True)
class OpAmpFigures:
    """The results of `taction.opamp`: an op-amp, measured on test benches.

    Attributes
    ----------
    notes : mapping of str to str
        Where a stated figure comes from.
    witnesses : mapping of str to Witness
        What solves the test benches.
    results : mapping of str to sequence of Figure
        Stated and measured figures of each of them.
    """

    opamp: OpAmp = field(repr=False)
    notes: Mapping[str, str] = field(repr=False)
    witnesses: Mapping[str, Witness] = field(repr=False)
    results: Mapping[str, Any] = field(repr=False)

    def plot(self, path: str | Path | None = None) -> Figure:
        """Return the Bode diagram and the steps of a follower; write it to `path`, if given."""
        from taction.verification.report.renderers.picture import draw_page
        from taction.verification.report.views.opamp import measure_curves, view

        curves = {name: measure_curves(self.opamp, each) for name, each in self.witnesses.items()}
        return draw_page(view(self.opamp, self.notes, self.results, curves), path)


@dataclass(frozen=True, slots=True)
class ImportedModel:
    """The results of `taction.import_model`: the file, and what it holds."""

    file: str
    model: Mapping[str, Any] = field(repr=False)


@dataclass(frozen=True, slots=True)
class Installation:
    """The results of `taction.doctor`: what is installed, and what it is needed for."""

    findings: tuple[Mapping[str, Any], ...]

    @property
    def outcome(self) -> str:
        """``inconclusive`` if ngspice is missing."""
        simulator = next(each for each in self.findings if each["what"] == "ngspice")
        return "pass" if simulator["ok"] else "inconclusive"
