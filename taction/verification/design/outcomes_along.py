"""The outcome of the checks at some values along each slider of the explorer, nearest first."""

from __future__ import annotations

from dataclasses import dataclass, replace

from taction.netlist_gen.scene.scene import Scene
from taction.system.errors import TactionError
from taction.system.quantities import spaced
from taction.verification.design.explorer_settings import Control, Settings, Start
from taction.verification.design.trials import BARE
from taction.verification.verdict.record import ERROR
from taction.verification.verdict.verify import verify

CELLS = 9  # of a slider: one verdict in the middle of each


@dataclass(frozen=True, slots=True)
class Spot:
    """A value of one slider; all others are as they stand."""

    control: Control
    cell: int
    settings: Settings

    @property
    def value(self) -> float:
        """Of the slider, in its unit."""
        return self.settings.values.get(self.control.path, self.control.own)


def others(control: Control, settings: Settings) -> Settings:
    """Return what the outcomes along a slider depend on: all values but its own."""
    values = {path: v for path, v in settings.values.items() if path != control.path}
    return replace(settings, values=values)


def spots(start: Start, settings: Settings) -> list[Spot]:
    """Return the middles of the cells of all sliders, those nearest to the present values first.

    Examples
    --------
    >>> from taction.netlist_gen.scene.loading import load_scene
    >>> start = Start.of(load_scene("scenes/paper-breadboard.toml"))
    >>> found = spots(start, Settings())
    >>> len(found), [(spot.control.symbol, spot.cell) for spot in found[:3]]
    (45, [('C', 4), ('s', 4), ('λ', 4)])
    """
    found = []
    for control in start.controls:
        here = control.place(settings.values.get(control.path, control.own))
        for cell in range(CELLS):
            place = (cell + 0.5) / CELLS
            values = {**settings.values, control.path: control.chosen(place)}
            spot = Spot(control, cell, Settings.of(start, values, settings.opamp))
            found.append((round(CELLS * abs(place - here)), spot))
    return [spot for _, spot in sorted(found, key=lambda each: each[0])]


def outcome_of(scene: Scene) -> tuple[str, str]:
    """Return the outcome of a verdict by the state-space engine, and why it is no pass.

    Examples
    --------
    >>> from taction.netlist_gen.scene.axes import with_value
    >>> from taction.netlist_gen.scene.loading import load_scene
    >>> scene = load_scene("scenes/paper-breadboard.toml")
    >>> outcome_of(with_value(scene, "design.capacitance", 2e-11))
    ('fail', 'rise time')
    """
    try:
        verdict = verify(scene.with_engine("statespace"), effort=BARE)
    except TactionError as error:
        return ERROR, str(error).partition("\n")[0]
    outcome = verdict.outcome
    names = [spaced(check.name) for check in verdict.checks if check.outcome is outcome]
    return outcome.value, "" if outcome.value == "pass" else ", ".join(names)
