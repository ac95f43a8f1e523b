"""The cards of a noise analysis: noise of the sensors, one ``.noise`` for each band."""

from __future__ import annotations

from collections.abc import Iterable

from taction.netlist_gen.analysis import Noise
from taction.netlist_gen.board.circuit import NoiseCurrent
from taction.spice_models.thermal_noise import THERMAL

SOURCE = "Vnoise noise_in 0 0.0 ac 1.0"
"""The input that ngspice asks for. It is connected to nothing: input-referred noise is not used."""

SAVED = ".save onoise_spectrum onoise_total"


def noise_cards(analysis: Noise, node: str, sensors: Iterable[NoiseCurrent] = ()) -> list[str]:
    """Return the cards of `analysis` for the voltage of a node.

    The noise of a sensor is the thermal current of a resistor on a node of its own.

    Examples
    --------
    >>> from taction.netlist_gen.analysis import Band
    >>> noise_cards(Noise((Band(1.0, 20, 20),)), "v_1")[2]
    '.noise v(v_1) Vnoise dec 20 1.0 10.0'
    """
    cards = [
        f".noise v({node}) Vnoise dec {band.density} {band.start!r} {band.stop!r}"
        for band in analysis.bands
    ]
    lines = []
    for part in sensors:
        ohms = THERMAL / part.density**2
        lines.append(f"Rnoise_{part.name} noise_{part.name} 0 {ohms!r}")
        lines.append(f"Gnoise_{part.name} 0 {part.node} noise_{part.name} 0 {1.0 / ohms!r}")
    return [*lines, SOURCE, SAVED, *cards]
