"""Boards between the ideal network and the board as built, for the links of the error budget.

The first board has ideal op-amps, so that only its resistors are as built. Each link gives the
op-amps some more figures, and the last board is the one that is simulated. Beside them stand two
deviations by themselves: of antilog stages of transistors from the ideal function, and of resistors
from their exact values, predicted to first order.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from taction.netlist_gen.board.circuit import Circuit
from taction.netlist_gen.board.synthesis import synthesise
from taction.netlist_gen.topologies.frame.antilog import with_ideal_stages
from taction.spice_models.opamp import OpAmp
from taction.system.array_types import Floats
from taction.system.quantities import show
from taction.verification.engines.statespace.linearised.board import LinearBoard
from taction.verification.engines.statespace.linearised.equilibrium import Equilibrium
from taction.verification.engines.statespace.linearised.rest_sensitivity import RestSensitivity
from taction.verification.verdict.planned_board import PlannedBoard


@dataclass(frozen=True, slots=True)
class StageDeviation:
    """Deviation of the stages at both ends of their working range, with and without strain.

    Attributes
    ----------
    largest : float
        ``|u / (U0 exp(v / Ve)) - 1|`` of any channel.
    lowest, highest : float
        Smallest and largest u there, V.
    """

    largest: float
    lowest: float
    highest: float

    def __str__(self) -> str:
        return (
            f"up to {100.0 * self.largest:.2g} % from U0 exp(v/Ve), measured at u from"
            f" {show(self.lowest, 'V', 3)} to {show(self.highest, 'V', 3)}"
        )


def stage_deviation(board: LinearBoard) -> StageDeviation:
    """Measure the stages of a board at its two equilibria.

    Raises
    ------
    EngineError
        The board has no equilibrium.
    """
    circuit = board.circuit
    points = (board.rest, board.equilibrium)
    u = np.array([_outputs(board, point) for point in points])
    v = np.array([[point[node] for node in circuit.signal_nodes] for point in points])
    wanted = circuit.value("U0") * np.exp(v / circuit.value("Ve"))
    largest = float(np.max(np.abs(u / wanted - 1.0)))
    return StageDeviation(largest, float(u.min()), float(u.max()))


def _outputs(board: LinearBoard, point: Equilibrium) -> Floats:
    return np.array([out.sign * point[out.node] for out in board.circuit.outputs])


IDEAL_GAIN = 1e15  # the gain error of a whole board is then at the rounding of its equilibrium


@dataclass(frozen=True, slots=True)
class OpAmpLink:
    """Figures of an op-amp that make one part of the error budget.

    Attributes
    ----------
    name : str
        Of the part.
    figures : tuple of str
        Fields of `OpAmp`; without these a field has its default, the gain `IDEAL_GAIN`.
    how : str
        The comparison that gives the part.
    switch : str
        Field that has to be true for these figures to be in the macromodel, or empty.
    """

    name: str
    figures: tuple[str, ...]
    how: str
    switch: str = ""

    @property
    def fields(self) -> set[str]:
        """All fields that the link sets."""
        return {*self.figures, *filter(None, [self.switch])}

    def acts_on(self, model: OpAmp) -> bool:
        """Whether the macromodel of `model` has any of the figures."""
        on = not self.switch or getattr(model, self.switch)
        return on and any(getattr(model, name) != _NEUTRAL[name] for name in self.figures)


LINKS = (
    OpAmpLink(
        "opamps",
        ("dc_gain", "gbw", "second_pole", "input_resistance", "output_resistance", "imported"),
        "finite gain and impedances of the op-amps: equilibrium with against without",
    ),
    OpAmpLink(
        "offset_voltage",
        ("offset_voltage",),
        "offset voltage of the op-amps: equilibrium with against without",
        switch="input_errors",
    ),
    OpAmpLink(
        "input_currents",
        ("bias_current", "offset_current"),
        "bias and offset current of the op-amps: equilibrium with against without",
        switch="input_errors",
    ),
    OpAmpLink(
        "common_mode",
        ("common_mode_rejection",),
        "common-mode rejection of the op-amps: equilibrium with against without",
        switch="input_errors",
    ),
    OpAmpLink(
        "limits",
        ("slew_rate", "saturation", "output_current", "limits_current"),
        "limits of the op-amps: equilibrium with against without",
        switch="large_signal",
    ),
)
_NEUTRAL: dict[str, Any] = {f.name: f.default for f in fields(OpAmp)} | {"dc_gain": IDEAL_GAIN}


def with_ideal_opamps(circuit: Circuit) -> Circuit:
    """Return `circuit` with op-amps that add no error at rest."""
    return _with_links(circuit, [])


def opamp_stages(board: LinearBoard) -> Iterator[tuple[OpAmpLink, LinearBoard]]:
    """Yield each link that `board` has, and the board with the figures up to this link.

    The last one is `board` itself. There is none for op-amps without any such figure.
    """
    models = board.circuit.models.values()
    links = [link for link in LINKS if any(map(link.acts_on, models))]
    for count, link in enumerate(links[:-1], 1):
        yield link, LinearBoard(_with_links(board.circuit, links[:count]))
    if links:
        yield links[-1], board


def outputs_at_rest(board: LinearBoard) -> Floats:
    """Return u of every channel at the equilibrium, V, (N,).

    Raises
    ------
    EngineError
        The board has no equilibrium.
    """
    rest = board.equilibrium
    return np.array([output.sign * rest[output.node] for output in board.circuit.outputs])


def _with_links(circuit: Circuit, links: list[OpAmpLink]) -> Circuit:
    """Return `circuit` with the figures of `links` only."""
    kept = set[str]().union(*(link.fields for link in links))
    every = set[str]().union(*(link.fields for link in LINKS))
    absent = {name: _NEUTRAL[name] for name in every - kept}
    models = {name: replace(model, **absent) for name, model in circuit.models.items()}
    return replace(circuit, models=models)


def predicted_change(design: PlannedBoard) -> Floats | None:
    """Return how far the resistors of a board move the optimum, to first order, V, (N,).

    The board with the exact resistors that the scene asks for, and with ideal op-amps, rests at the
    optimum. Its sensitivities, with the conductances' deviations, predict the outputs of the board
    as built: rounded to a series, or varied.

    Returns
    -------
    ndarray (N,) or None
        None where no resistor deviates, and for a board with other resistors than the scene's.

    Raises
    ------
    InputError
        The board with exact resistors cannot be built.
    EngineError
        It has no equilibrium.
    """
    chosen = design.scene.design.model_copy(update={"resistor_series": "exact"})
    scene = design.scene.model_copy(update={"design": chosen})
    exact = with_ideal_stages(synthesise(scene, design.problem))
    wanted, built = resistances(exact), resistances(with_ideal_stages(design.circuit))
    if wanted.keys() != built.keys():
        return None
    deviations = {name: 1.0 - ohms / built[name] for name, ohms in wanted.items()}
    if not any(deviations.values()):
        return None
    slopes = RestSensitivity.of(LinearBoard(with_ideal_opamps(exact))).resistors()
    moves = [deviation * slopes[name] for name, deviation in deviations.items()]
    return np.asarray(np.sum(moves, axis=0))


def resistances(circuit: Circuit) -> dict[str, float]:
    """Return the resistance of every resistor by its name in the deck, ohm."""
    found = {f"R{part.name}": part.ohms for part in circuit.resistors}
    for matrix in circuit.matrices:
        for k, n, *_, ohms in matrix.elements():
            found[f"{matrix.name}_{k + 1}_{n + 1}"] = ohms
    return found
