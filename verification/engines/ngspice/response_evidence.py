"""The evidence that a small-signal run must show before its result is accepted."""

from __future__ import annotations

import numpy as np

from netlist_gen.analysis import Response
from spice_models.array_types import Complexes, Floats
from spice_models.errors import BadEvidence, SimulationError
from verification.engines.ngspice.ending import Ending
from verification.engines.ngspice.evidence import check_ending, documented
from verification.engines.ngspice.raw_file import read_raw
from verification.engines.ngspice.screening import Deck

PLOT = "AC Analysis"
SAME = 1e-9  # relative difference of a frequency that ngspice reached by multiplication


def accepted_response(deck: Deck, ending: Ending) -> tuple[Floats, Complexes]:
    """Return the frequencies (P,), Hz, and the voltages of the saved nodes (P, K).

    Raises
    ------
    SimulationError
        As for a transient: the process failed, or points, vectors or values are not those asked
        for.
    """
    try:
        check_ending(ending)
        plot = read_raw(ending.raw, kind="complex")
        expected = ["frequency", *(f"v({node.lower()})" for node in deck.saved)]
        if plot.name != PLOT or sorted(plot.vectors) != sorted(expected):
            raise BadEvidence(
                f"plot {plot.name!r} with {', '.join(plot.vectors)} was not asked for"
            )
        values = np.array(plot.data).view(np.complex128)
        columns = values[:, [plot.vectors.index(name) for name in expected]]
        _check(deck, columns)
    except SimulationError as error:
        raise documented(error, ending) from None
    return np.ascontiguousarray(columns[:, 0].real), np.ascontiguousarray(columns[:, 1:])


def _check(deck: Deck, columns: Complexes) -> None:
    if not isinstance(deck.analysis, Response):
        raise BadEvidence("the deck has no small-signal analysis")
    if not np.all(np.isfinite(columns)):
        raise BadEvidence("the response is not finite")
    band = deck.analysis.band
    wanted = band.start * 10.0 ** (np.arange(band.steps + 1) / band.density)
    if columns.shape[0] != wanted.size or not np.allclose(columns[:, 0].real, wanted, SAME, 0.0):
        raise BadEvidence(f"{columns.shape[0]} frequencies; {wanted.size} were asked for")
