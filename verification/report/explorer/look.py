"""What is known of one set of values, and the parts of the page that show it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from taction.netlist_gen.scene.scene import Scene
from taction.verification.design.board_view import Curves, PoleView, RestView, view_poles, view_rest
from taction.verification.design.explorer_judgement import Judgement
from taction.verification.design.explorer_settings import Settings, Start
from taction.verification.report.explorer.charts import Part, chart_part, outputs_chart
from taction.verification.report.explorer.payload import poles_part, rest_part


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """Everything that is known so far of one set of values.

    Attributes
    ----------
    part : dict
        What the page is told first.
    poles : PoleView or None
        None as long as they are not known.
    limits : tuple of str
        What the op-amps cannot do.
    verdict, other : Judgement or None
        Of the state-space engine, and of ngspice.
    """

    settings: Settings
    scene: Scene
    rest: RestView
    part: Part = field(default_factory=dict)
    poles: PoleView | None = None
    limits: tuple[str, ...] = ()
    verdict: Judgement | None = None
    other: Judgement | None = None

    def with_poles(self, window: str) -> tuple[Look, Part]:
        """Add the poles and, of a small linear board, the curves."""
        found = view_poles(self.rest)
        look = replace(self, poles=found)
        return look, poles_part(found) | look.outputs_part(window)

    def limited(self, limits: tuple[str, ...]) -> Look:
        """Add what the op-amps cannot do."""
        return replace(self, limits=limits)

    def judged(self, found: Judgement) -> Look:
        """Add the verdict."""
        return replace(self, verdict=found)

    def simulated(self, found: Judgement) -> Look:
        """Add the verdict of ngspice."""
        return replace(self, other=found)

    def curves(self, window: str) -> Curves | None:
        """Return the best curves that are known.

        Those of the verdict where the linear board has no closed form, or is not the board.
        """
        response = None if self.poles is None else self.poles.response
        if response is None or self.limits:
            judged = None if self.verdict is None else self.verdict.curves
            if judged is not None or response is None:
                return judged
        return response.curves(response.rise if window == "rise" else response.stop)

    def outputs_part(self, window: str) -> Part:
        """Return the part of the page with the outputs, as far as they are known."""
        curves = self.curves(window)
        if curves is None:
            return {}
        other = None if self.other is None else self.other.curves
        return {"outputs": chart_part(outputs_chart(curves, other, self.rest, window))}

    def later_outputs(self, window: str) -> Part:
        """Return the curves that came with the verdict, if they are better than the first."""
        has_first = self.poles is not None and self.poles.response is not None
        return {} if has_first and not self.limits else self.outputs_part(window)


def look_at(start: Start, settings: Settings, window: str) -> Look:
    """Return what is fast: the board at rest and, of a small linear board, poles and curves.

    Raises
    ------
    InputError, NoVerdictError
        As `view_rest` and `view_poles`.
    """
    scene = settings.scene(start)
    rest = view_rest(scene, settings.problem(start, scene))
    look, part = Look(settings, scene, rest), rest_part(rest)
    if not rest.is_large:  # the poles of a large board take longer than a movement of the hand
        look, more = look.with_poles(window)
        part |= more
    return replace(look, part=part)
