"""Evidence of a small-signal analysis: one complex plot with the requested frequencies."""

from __future__ import annotations

import numpy as np

from taction.netlist_gen.analysis import SmallSignal
from taction.system.array_types import Complexes, Floats
from taction.system.errors import BadEvidence, SimulationError
from taction.verification.engines.ngspice.ending import Ending
from taction.verification.engines.ngspice.evidence import check_ending, documented
from taction.verification.engines.ngspice.noise_evidence import FREQUENCY_TOLERANCE
from taction.verification.engines.ngspice.raw_file import read_complex
from taction.verification.engines.ngspice.screening import Deck

PLOT = "AC Analysis"


def small_signal_response(deck: Deck, ending: Ending) -> tuple[Floats, Complexes]:
    """Return the frequencies (P,), Hz, and the voltages of the saved nodes (P, K), V.

    Raises
    ------
    SimulationError
        One of its kinds; `BadEvidence` where the plot, its vectors or frequencies are others than
        those asked for, or a value is not finite.
    """
    try:
        check_ending(ending)
        return _checked(deck, *read_complex(ending.raw))
    except SimulationError as error:
        raise documented(error, ending) from None


def _checked(
    deck: Deck, name: str, vectors: tuple[str, ...], data: Complexes
) -> tuple[Floats, Complexes]:
    if not isinstance(deck.analysis, SmallSignal):
        raise BadEvidence(f"the analysis is {type(deck.analysis).__name__}, not SmallSignal")
    wanted = tuple(f"v({node.lower()})" for node in deck.saved)
    if name != PLOT or vectors[:1] != ("frequency",) or set(vectors[1:]) != set(wanted):
        text = f"the plot is {name!r} with {', '.join(vectors)}"
        raise BadEvidence(f"{text}; {PLOT!r} with frequency and {', '.join(wanted)} was asked for")
    band, found = deck.analysis.band, data[:, 0].real
    expected = band.start * 10.0 ** (np.arange(band.steps + 1) / band.density)
    if found.shape != expected.shape or not np.allclose(
        found, expected, rtol=FREQUENCY_TOLERANCE, atol=0.0
    ):
        raise BadEvidence(
            f"{len(found)} frequencies; {len(expected)} from {band.start:g} to {band.stop:g} Hz"
            " were asked for"
        )
    if not np.isfinite(data).all():
        raise BadEvidence("a voltage is not finite")
    return found, data[:, [vectors.index(vector) for vector in wanted]]
